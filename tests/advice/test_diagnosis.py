"""Remedies for data that contradict the class, each against an identification of its own."""

import dataclasses

import control
import numpy as np
import pytest

import robustid as rid
from robustid.advice import diagnose
from robustid.advice.causes import judged_margin
from robustid.core import Budget
from robustid.data import FaultKind
from robustid.errors import InputTypeError, SizeError
from support.structure import about_structure, structure_problem

FINE = np.linspace(17.2, 18.1, 10)


def test_diagnosis_finds_the_missing_mode():
    problem = structure_problem(slice(1, 2), lines=6, samples=4).with_prior(gain_bound=0.2, decay_rate=1.1)
    result = rid.identify(problem)
    found = diagnose(result)
    assert found.inflation == result.margin > 1
    assert found.active == tuple(result.conflicting_samples())
    best = found.best()
    assert "one more pair, at 9.0" in best.name
    assert best.margin < 1
    margins = {one.name: one.margin for one in found.corrections}
    assert margins["K times 10"] <= margins["K times 2"] <= found.inflation * 1.001
    assert margins["each pair repeated once more"] <= found.inflation * 1.001
    assert "consistent" in found.summary()
    for trial in found.corrections:
        proved = rid.identify(trial.problem)
        assert proved.margin_lower - 1e-9 <= trial.margin <= proved.margin + 2e-3 * max(1, proved.margin)
    frf, record = (one.with_bound(found.inflation * one.bound) for (one,) in (problem.frequency, problem.time))
    inflated = dataclasses.replace(problem, frequency=frf, time=record)
    assert rid.identify(inflated).margin == pytest.approx(1, abs=1e-3)


def test_diagnosis_sees_that_repetition_absorbs_a_wrong_pole():
    data = rid.datasets.flexible_structure(lines=6, extra_hz=FINE)
    problem = about_structure(data, 0.2, 1.1, modes=data.modes * [[1, 1], [1.001, 1]])
    found = diagnose(rid.identify(problem))
    repeated = next(t for t in found.corrections if "repeated" in t.name)
    assert repeated.margin < 0.2 * found.inflation
    assert repeated.problem.parametric.size == 8
    again = diagnose(rid.identify(repeated.problem))
    assert again.corrections[0].problem.parametric.size == 12


def test_diagnosis_of_consistent_time_data_without_pairs():
    record = rid.TimeRecord([1.0, 0.0], [0.5, 0.2], dt=1.0, bound=0.1)
    found = diagnose(rid.identify(rid.MixedProblem(time=record, prior=rid.Prior(gain_bound=1.0, decay_rate=1.1))))
    assert found.inflation <= 1
    assert found.summary().startswith("The data are consistent")
    assert [t.name for t in found.corrections] == ["K times 2", "K times 10", "rho - 1 halved"]


def test_diagnosis_of_a_basis_with_real_poles_only():
    data = rid.datasets.flexible_structure()
    problem = dataclasses.replace(about_structure(data, 0.2, 1.1), parametric=control.ss(0.5, 1, 1, 0, 0.01))
    changes = [t.name for t in diagnose(rid.identify(problem)).corrections]
    assert len(changes) == 4
    assert changes[0].startswith("one more pair")


def test_the_time_ends_the_trials_and_says_which_are_left():
    record, told = rid.TimeRecord([1.0, 0.0], [0.5, 2.0], dt=1.0, bound=0.1), []
    result = rid.identify(rid.MixedProblem(time=record, prior=rid.Prior(gain_bound=1.0, decay_rate=1.1)))
    found = diagnose(result, time_limit=1e-9)
    assert found.corrections == ()
    assert found.left_out == ("K times 2", "K times 10", "rho - 1 halved", "poles moved")
    assert "no time was left for: K times 2, K times 10" in found.summary()
    whole = diagnose(result, progress=lambda text, *at: told.append(at))
    assert whole.left_out == ()
    assert told == [(k, 4) for k in (1, 2, 3, 4)]


def test_diagnose_refuses_other_things():
    with pytest.raises(InputTypeError, match="`identification` must be an Identification; got int"):
        diagnose(3)


@pytest.mark.parametrize("dt", [1e-3, None])
def test_a_missing_rigid_body_is_found(dt):
    """A free mass with a mode, of which only the mode was stated: two integrators, and not one, make the data consistent."""
    rng, omega = np.random.default_rng(0), 2 * np.pi * np.linspace(1, 100, 20)
    mode = rid.kautz(300.0, 0.02, dt=dt or 0)
    if dt:
        z = np.exp(1j * omega * dt)
        true = 50 * dt**2 / 2 * (z + 1) / (z - 1) ** 2 + 1e-6 * mode.response(omega * dt)[:, 0]
        prior, place = rid.Prior(gain_bound=1e-6, decay_rate=1.05), "z = 1"
    else:
        s = 1j * omega
        true = 50 / s**2 + 20 / (s**2 + 2 * 0.02 * 300 * s + 300**2)
        prior, place = rid.Prior(gain_bound=1e-6, decay=50.0), "s = 0"
    bound = 0.02 * np.abs(true)
    error = bound * np.exp(2j * np.pi * rng.random(20)) * rng.random(20)
    frf = rid.FrequencyResponse(omega, true + error, bound=bound, dt=dt)
    found = rid.diagnose(rid.identify(rid.MixedProblem(frequency=frf, prior=prior, parametric=mode)))
    assert str(found).splitlines()[0].startswith(f"Most likely cause: a rigid body is missing: 2 poles at {place}")
    assert found.summary().splitlines()[-1].endswith("for the program: --integrators 2.")
    assert not dt or "integrators = 2" in rid.suggest_kautz(frf).reason


def test_a_drift_that_was_removed_is_no_cause():
    frf = rid.FrequencyResponse([1.0, 2.0, 3.0], [1.0, 5.0, 1.0], bound=0.01, dt=0.1)
    words = "output y drifts by 9 % of its rms; the drift over whole periods is removed"
    removed = rid.prepare.Fault(FaultKind.DRIFT, words)
    noisy = rid.prepare.Fault(FaultKind.DISTURBED, "noisy", record=2)
    frf = dataclasses.replace(frf, faults=(removed, noisy))
    found = diagnose(rid.identify(rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=0.1, decay_rate=1.5))))
    assert str(removed) not in [cause.cause for cause in found.causes]
    assert "record 2: noisy" in [cause.cause for cause in found.causes]
    assert "Change to make: ." not in found.summary()


def test_a_change_that_no_form_takes_is_not_judged():
    w = np.logspace(1.8, 3.8, 300)
    response = rid.FrequencyResponse(w, 1 / (1j * w + 1), bound=1e-6)
    problem = rid.MixedProblem(frequency=response, prior=rid.Prior(gain_bound=1.0, decay=1e-2))
    with pytest.raises(SizeError, match="too large for every form"):
        rid.identify(problem)
    assert np.isinf(judged_margin(problem, 1.0, Budget(None)))
