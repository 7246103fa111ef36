"""A frequency response without a sample time: from the file to the page, by command and by run file."""

import json

import numpy as np
import pytest

import robustid as rid
from robustid.formats import origin


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """The folder of a measured compliance: two modes over a static rest."""
    folder = tmp_path_factory.mktemp("continuous")
    rng = np.random.default_rng(4)
    omega = np.unique(
        np.concatenate([np.geomspace(4, 90, 14), 20 * (1 + 0.02 * np.linspace(-2, 2, 7)), 50 + np.arange(-2, 3)])
    )
    s = 1j * omega
    value = 400 / (s**2 + 2 * 0.02 * 20 * s + 400) + 0.5 * 2500 / (s**2 + 2 * 0.02 * 50 * s + 2500) + 0.05
    bound = 0.02 * np.abs(value)
    value = value + 0.8 * bound * np.exp(2j * np.pi * rng.random(omega.size))
    table = np.column_stack([omega / (2 * np.pi), value.real, value.imag, bound])
    np.savetxt(folder / "frf.csv", table, delimiter=",", header="freq_hz,real,imag,bound", comments="")
    return folder


def test_one_command_makes_the_page(measured, run, monkeypatch):
    monkeypatch.chdir(measured)
    code, out, err = run(["identify", "--frequency", "frf.csv", "-o", "found", "--report", "page.html", "--no-reduce"])
    assert code == 0, err
    assert "taken as a response of continuous time; give --dt for a sampled one" in out + err
    found = rid.load(measured / "found.npz")
    assert found.model.dt == 0
    assert [mode.omega for mode in found.modes] == pytest.approx([20, 50], rel=2e-3)
    page = (measured / "page.html").read_text()
    for words in ("Re s &gt; −α", "s-plane", "Impulse response", "continuous time"):
        assert words in page or words.replace("&gt;", ">") in page or words in json.dumps(page), words
    assert "Nyquist" not in page


def test_formats_in_which_nothing_is_sampled_need_no_warning(measured, tmp_path):
    frf = rid.load(measured / "frf.csv")
    rid.save(tmp_path / "kept.csv", frf)
    hz = np.linspace(2.2e9, 2.7e9, 20)
    rid.save(tmp_path / "filter.s1p", rid.FrequencyResponse(2 * np.pi * hz, 0.5 + 0.1j * np.cos(hz)))
    (tmp_path / "cell.csv").write_text(
        "freq/Hz,Re(Z)/Ohm,-Im(Z)/Ohm\n" + "".join(f"{k},{k + 1},{k}\n" for k in range(1, 9))
    )
    files = {measured / "frf.csv": False, tmp_path / "kept.csv": True, tmp_path / "filter.s1p": True,
             tmp_path / "cell.csv": True}  # fmt: skip
    assert {path: origin(path, "frequency", None).continuous for path in files} == files


@pytest.mark.slow
@pytest.mark.usefixtures("unreduced")
def test_a_run_file_states_a_decay(measured):
    text = """
        frequency = [{ file = "frf.csv" }]
        [modes]
        hz = [3.1831, 7.9577]
        damping = [0.02, 0.02]
        [prior]
        gain_bound = 0.3
        decay = 80.0
        [worst_case]
        at_hz = [3.2]
        directions = 3
    """
    (measured / "run.toml").write_text("\n".join(line.strip() for line in text.splitlines()))
    done = rid.run(measured / "run.toml", folder=measured / "out")
    assert done.identification.consistent
    assert done.identification.prior == rid.Prior(gain_bound=0.3, decay=80.0)
    assert done.reduction.model.dt == 0
    assert done.identification.problem.dt == 0
    again = (measured / "out" / "run.toml").read_text()
    assert "decay = 80.0" in again


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--gain", "1", "--decay-rate", "1.1"], "--decay in 1/s"),
        (["--gain", "1", "--decay-rate", "1.1", "--decay", "3"], "--decay-rate (per sample) and --decay (in 1/s)"),
        (["--decay", "3"], "--decay is given without --gain"),
        (["--gain", "1", "--decay", "-3"], "--decay must be positive"),
    ],
)
def test_decays_are_checked(measured, run, monkeypatch, arguments, words):
    monkeypatch.chdir(measured)
    code, out, err = run(["identify", "--frequency", "frf.csv", "--mode", "3.2:0.02", *arguments])
    assert code == 2
    assert words in " ".join((out + err).split())


@pytest.mark.slow
def test_a_run_with_a_fit_gives_the_same_again(measured):
    """The order is chosen; the box of a real pole that the data hardly tell would reach below 0 Hz."""
    (measured / "fit.toml").write_text(
        '[[frequency]]\nfile = "frf.csv"\n[fit]\norder = 7\n[worst_case]\ncompute = false\n'
    )
    first = rid.run(measured / "fit.toml", measured / "fitted")
    assert min(low for low, _ in first.run_file.modes.hz_interval) > 0
    again = rid.run(measured / "fitted" / "run.toml", measured / "again")
    assert again.identification.margin == first.identification.margin


@pytest.mark.slow
def test_two_continuous_members_are_a_family(measured, tmp_path):
    frf = rid.load(measured / "frf.csv", kind="frequency")
    basis = rid.kautz([20.0, 50.0], [0.02, 0.02], dt=0)
    prior = rid.Prior(gain_bound=0.3, decay=80.0)
    members = []
    for name, gain in (("one", 1.0), ("other", 1.02)):
        data = rid.FrequencyResponse(frf.omega, gain * frf.values, bound=frf.bound)
        problem = rid.MixedProblem(frequency=data, prior=prior, parametric=basis)
        members.append(rid.guarantee.Member(rid.identify(problem), name))
    both = rid.family(members, omega=[10.0, 20.0, 60.0])
    assert both.model.dt == 0
    both.save(tmp_path / "family.json")
    assert rid.load(tmp_path / "family.json").model.dt == 0
    rid.write_report(both, tmp_path / "family.html")
