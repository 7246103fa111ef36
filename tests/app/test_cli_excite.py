"""robustid excite: a file to play, sentences, exit codes."""

import numpy as np
import pytest

import robustid as rid
from support import command_line

pytestmark = pytest.mark.quick
COMMAND = ["--band", "1:20", "--dt", "0.01", "--period", "100"]


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def run(capsys, monkeypatch):
    return lambda arguments: command_line.words(["excite", *arguments], capsys, monkeypatch)


def test_writes_what_the_library_designs_and_says_what_to_do(run):
    options = ["--inputs", "2", "--realisations", "2", "--periods", "4", "--spacing", "odd", "--seed", "3"]
    code, out, err = run([*COMMAND, *options, "--amplitude", "0.5", "--amplitude", "2", "-o", "[x].csv"])
    assert code == 0, err
    play = rid.load("[x].csv")
    same = rid.prepare.multisine(
        band_hz=(1, 20), dt=0.01, period=100, inputs=2, realisations=2, spacing="odd", amplitude=[0.5, 2], seed=3
    )
    np.testing.assert_array_equal(play.u, same.u)
    assert play.periods == 4
    for words in (
        "10 lines, 1 to 19 Hz; period 100 samples, 1 s",
        "2 inputs, 2 realisations: 4 experiments of 4 periods, 16 s in all",
        f"u1: largest |u| 0.5, rms {play.rms[0, 0]:.5g}, crest factor",
        f"to {play.crest_factors[:, 1].max():.3f}",
        "written: [x].csv",
        "Next: play every experiment, record",
        "rid.load('[x].csv')",
    ):
        assert words in out


def test_plain_random_phases_with_rms(run):
    code, out, err = run([*COMMAND, "--rms", "3", "--no-minimise-crest", "-o", "play.npz"])
    assert code == 0, err
    assert "in a loop" in out
    np.testing.assert_allclose(rid.load("play.npz").rms, 3, rtol=1e-12)


def test_nothing_is_overwritten_unless_forced(folder, run):
    (folder / "play.csv").write_text("precious")
    code, _, err = run(COMMAND)
    assert (code, (folder / "play.csv").read_text()) == (2, "precious")
    assert "play.csv exists; choose another name, or pass --force" in err
    assert run([*COMMAND, "--force"])[0] == 0
    assert rid.load("play.csv").period == 100


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--band", "1-20"], "--band must be LOW:HIGH in Hz, such as 5:200; got '1-20'"),
        (["--band", "1:50"], "--band must be (low, high) with 0 < low <= high < 50 Hz"),
        (["--band", "1.2:1.8"], "--band = (1.2, 1.8) holds no spectral line: they are multiples of 1 Hz"),
        (["--period", "1"], "--period must be at least 3; got 1"),
        (["--dt", "nan"], "--dt must be finite"),
        (["--spacing", "even"], "--spacing must be one of all, odd, random-odd, log; got 'even'"),
        (["--spacing", "log", "--lines-per-decade", "0"], "--lines-per-decade must be at least 1; got 0"),
        (["--inputs", "0"], "--inputs must be at least 1; got 0"),
        (["--periods", "0"], "--periods must be at least 1; got 0"),
        (["--amplitude", "1", "--rms", "1"], "--amplitude and --rms both set the size"),
        (["--rms", "1", "--rms", "2"], "--rms must be one number or one for each of 1 inputs"),
        (["--seed", "-1"], "--seed must be at least 0"),
        (["-o", "play.mat"], "--output play.mat must end in .csv or .npz"),
        (["-o", "nowhere/play.csv"], "the folder nowhere does not exist; create it first"),
    ],
)
def test_misuse_is_one_sentence_and_writes_nothing(options, sentence, run):
    with command_line.nothing_written():
        command_line.refused(run([*COMMAND, *options]), sentence)
