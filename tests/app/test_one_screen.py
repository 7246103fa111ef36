"""A result at the terminal: one screen, and a command to go on with that runs as it is printed."""

import shlex
from pathlib import Path

import numpy as np
import pytest

import robustid as rid
from robustid.app.cli.terminal import Terminal
from support.command_line import main, one_screen, to_paste

FEWER = ["--directions", "3", "--points", "4"]  # as printed it takes longer
CLASS = ["--mode", "9:0.1", "--mode", "17.67:0.004", "--gain", "0.2", "--decay-rate", "1.1"]


@pytest.fixture(name="run")
def _run(capsys, monkeypatch):
    monkeypatch.setattr(Terminal, "wraps", True)  # as at a terminal, whose steps are drawn over each other
    return lambda arguments: main([str(part) for part in arguments], capsys, monkeypatch, columns=80)


@pytest.fixture(name="here")
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    data = rid.datasets.flexible_structure(lines=5, samples=3, extra_hz=[17.5, 17.67, 17.8])
    rid.save("my response.csv", data.frequency)
    return tmp_path


@pytest.mark.usefixtures("unsharpened")
def test_from_a_look_to_a_filter_in_c_by_the_commands_that_are_printed(here, run):
    """Quoted where a name has a space, to names that are free, with what was found by the command before."""
    called, seen = ["look", "my response.csv"], []
    while True:
        faster = {"identify": [*CLASS, "--no-reduce"], "bounds": FEWER}.get(called[0], [])
        code, out, err = run([*called, *faster])
        assert code == 0, err
        one_screen(out)
        seen.append(called[0])
        if not (offered := to_paste(out)):
            break
        (called,) = offered
    assert seen == ["look", "identify", "bounds", "reduce", "export"]
    assert {path.suffix for path in here.iterdir()} == {".csv", ".npz", ".json", ".html", ".h"}


def test_an_identification_says_verdict_error_and_what_is_not_covered_and_the_rest_on_demand(here, run):
    Path("result-bounds.json").write_text("")
    code, short, _ = run(["identify", "--frequency", "my response.csv", *CLASS, "--no-reduce"])
    assert code == 0
    one_screen(short)
    for words in ("Consistent  A system", "guaranteed error", "Not covered: a machine outside", "written: result.npz"):
        assert words in short
    assert to_paste(short)[0][:4] == ["bounds", "result", "-o", "result-bounds-2"]
    code, long, _ = run(["identify", "--frequency", "my response.csv", *CLASS, "--no-reduce", "--force", "-v"])
    assert code == 0
    assert len(long.splitlines()) > 2 * len(short.splitlines())
    for words in ("Verification", "Active constraints", "guarantee  every consistent system", "  robustid bounds"):
        assert words in long
    code, out, _ = run(["report", "result", "--no-reduce"])
    one_screen(out)
    assert to_paste(out)[0][:2] == ["bounds", "result"]


@pytest.mark.slow
def test_a_contradiction_offers_the_command_that_resolves_it(here, run):
    wrong = [part.replace("17.67", "17.2") for part in CLASS]
    code, out, _ = run(["identify", "--frequency", "my response.csv", *wrong, "--no-reduce"])
    assert code == 3
    one_screen(out)
    assert "Inconsistent  It is proved" in out
    (again,) = to_paste(out)
    assert again[-2:] == ["--force", "--apply"]
    assert run(again)[0] == 0


def test_a_fit_offers_a_proof_of_the_file_as_it_was_read(here, run):
    frf = rid.load("my response.csv")
    np.savez("bare.npz", omega=frf.freq_hz, values=frf.values.ravel(), bound=np.full(frf.omega.size, 0.03))
    code, out, err = run(["fit", "bare.npz", "--order", "4", "--frequency-unit", "Hz", "--dt=0.01"])
    assert code == 0, err
    one_screen(out)
    assert "Not covered: how far the machine is from this model" in out
    (proof,) = to_paste(out)
    assert proof[:6] == ["identify", "--frequency", "bare.npz", "--frequency-unit", "Hz", "--dt=0.01"]
    assert run([*proof, *CLASS, "--no-reduce"])[0] == 0


def test_a_record_whose_input_repeats_is_estimated_with_its_period_and_the_response_identified(here, run):
    u = np.tile(np.random.default_rng(0).standard_normal(50), 6)
    noise = 0.01 * np.random.default_rng(1).standard_normal(300)
    rid.save("bench run.csv", rid.TimeRecord(u, np.convolve(u, [0, 1, 0.5])[:300] + noise, dt=0.01))
    _, out, _ = run(["look", "bench run.csv"])
    one_screen(out)
    assert "give --period 50" in out
    (estimate,) = to_paste(out)
    assert estimate[:4] == ["frf", "bench run.csv", "--period", "50"]
    code, out, err = run(estimate)
    assert code == 0, err
    one_screen(out)
    (proof,) = to_paste(out)
    assert proof[:3] == ["identify", "--frequency", "bench run-response.npz"]
    assert run([*proof, "--mode", "none", "--gain", "2", "--decay-rate", "1.1", "--no-reduce"])[0] == 0


def test_several_files_share_a_screen(here, run):
    for k in range(4):
        names = {f"signal{i}": np.arange(30.0) for i in range(20)}
        np.savez(f"many{k}.npz", **names)
    _, out, _ = run(["look", *(f"many{k}.npz" for k in range(4))])
    one_screen(out)


@pytest.mark.parametrize("command", ["identify", "frf", "fit", "run", "control"])
def test_the_help_fits_80_columns(here, run, command):
    """No line is cut, and no column is so narrow that the page grows long."""
    code, out, _ = run([command, "--help"])
    assert code == 0
    assert max(map(len, out.splitlines())) <= 80
    assert "…" not in out
    assert len(out.splitlines()) < 200
    assert "Files and screen" in out


@pytest.mark.usefixtures("unpaged")
def test_run_lists_its_folder_in_one_line_and_goes_on_to_export(here, run):
    text = '[[frequency]]\nfile = "my response.csv"\n'
    text += "[modes]\nhz = [9.0, 17.67]\ndamping = [0.1, 0.004]\n[prior]\ngain_bound = 0.2\ndecay_rate = 1.1\n"
    Path("ask.toml").write_text(text + "[withheld]\nevery = 0\n[worst_case]\nat_hz = [9.0]\ndirections = 3\n")
    code, out, err = run(["run", "ask.toml", "-o", "out of it"])
    assert code == 0, err
    one_screen(out)
    assert "written: out of it" in out
    (model,) = to_paste(out)
    assert shlex.join(model) == "export 'out of it/small_model.npz' -o 'out of it-model.m'"
    assert run(model)[0] == 0
