"""Roll-offs of the prior in run files and on the command line."""

import numpy as np
import pytest

import robustid as rid
from robustid.app.options import Modes
from robustid.app.prior_options import PriorChoice
from robustid.app.proposal import propose


def test_a_run_file_states_the_roll_off_in_hz():
    prior = rid.Prior(gain_bound=0.2, decay=3.0, roll_off=2, corner=2 * np.pi * 40.0)
    stated = PriorChoice.of(prior, "a note")
    assert (stated.roll_off, stated.corner_hz) == (2, pytest.approx(40.0))
    again = stated.stated
    assert again.corner == pytest.approx(prior.corner, rel=1e-15)
    assert (again.gain_bound, again.decay, again.roll_off) == (0.2, 3.0, 2)
    assert PriorChoice(roll_off=1, corner_hz=10.0).stated is None
    assert PriorChoice(roll_off=1, corner_hz=10.0).shape == {"roll_off": 1, "corner": pytest.approx(20 * np.pi)}


def test_half_a_roll_off_and_a_weight_are_refused():
    names = {n: f"--{n}" for n in ("gain_bound", "decay_rate", "decay", "roll_off", "corner_hz")}
    with pytest.raises(rid.InputError, match="--corner_hz is given without --roll_off"):
        PriorChoice(corner_hz=10.0).check(names)
    with pytest.raises(rid.InputError, match="--roll_off is given without --corner_hz"):
        PriorChoice(roll_off=2).check(names)
    import control

    weighted = rid.Prior(gain_bound=0.2, decay=3.0, weight=control.tf(1, [1, 5]))
    with pytest.raises(rid.InputError, match="run files have no key"):
        PriorChoice.of(weighted)


def test_the_roll_off_stays_when_the_program_chooses_the_rest():
    omega = np.linspace(2.0, 60.0, 12)
    frf = rid.FrequencyResponse(omega, 1 / (1 + 1j * omega / 20) ** 2, bound=0.02)
    asked = PriorChoice(roll_off=2, corner_hz=3.2)
    found = propose(frequency=[frf], shape=asked.shape).problem.prior
    assert (found.roll_off, found.corner) == (2, pytest.approx(2 * np.pi * 3.2))
    assert rid.identify(rid.MixedProblem(frequency=frf, prior=found)).consistent


def test_auto_takes_the_roll_off_that_the_response_shows(tmp_path, monkeypatch):
    """On the way of a run file and of the command line; with a stated gain bound too; a corner beside it is refused."""
    monkeypatch.chdir(tmp_path)
    omega = np.linspace(1.0, 60.0, 30)
    frf = rid.FrequencyResponse(omega, 1 / (1 + 1j * omega / 8) ** 2, bound=0.002)
    found = propose(
        frequency=[frf], modes=Modes(hz=(), damping=()), prior=rid.Prior(gain_bound=1.0, decay=4.0), roll_off=True
    )
    assert found.problem.prior.roll_off == 2
    assert "falls as frequency^-2" in found.choices[-1]
    rid.save("frf.npz", frf)
    with open("run.toml", "w") as file:
        file.write('[[frequency]]\nfile = "frf.npz"\n[modes]\nhz = []\ndamping = []\n')
        file.write('[prior]\ngain_bound = 1.0\ndecay = 4.0\nroll_off = "auto"\n[worst_case]\ncompute = false\n')
    result = rid.run("run.toml", "out")
    assert result.identification.problem.prior.roll_off == 2
    assert result.consistent
    with pytest.raises(rid.InputError, match="corner_hz is chosen too"):
        PriorChoice(roll_off="auto", corner_hz=3.0).check({n: n for n in ("gain_bound", "decay_rate", "decay")})
