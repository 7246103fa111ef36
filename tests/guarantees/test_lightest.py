"""Bounds of many coefficients in the lighter form, Taylor or, in continuous time, sections: the same set, whatever the form."""

import sys

import numpy as np
import pytest

import robustid as rid
from robustid.core import response
from robustid.guarantees import consistent_set
from support.cases import slow
from support.forging import kept


@pytest.fixture(scope="module")
def result():
    """32 points of a smooth plant with a light mode: 64 coefficients, decay so fast that some 40 Taylor coefficients do."""
    rng = np.random.default_rng(1)
    angle = np.linspace(0.1, 2.6, 32)
    basis = rid.kautz(0.9, 0.01, dt=1.0, delay=1)

    def truth(omega):
        return basis.response(omega) @ [0.8, 0.3] + 0.2 / (1 - 0.4 * np.exp(-1j * omega))

    noise = 0.01 * np.sqrt(rng.uniform(0, 1, 32)) * np.exp(2j * np.pi * rng.uniform(0, 1, 32))
    frf = rid.FrequencyResponse(angle, truth(angle) + noise, bound=0.01, dt=1.0)
    prior = rid.Prior(gain_bound=0.7, decay_rate=1.4)
    return rid.identify(rid.MixedProblem(frequency=frf, parametric=basis, prior=prior)), truth


@pytest.mark.parametrize(("points", "directions"), [([10], 4), slow([3, 10, 20], 6)])
def test_bounds_of_both_forms_enclose_the_same_errors(result, tmp_path, monkeypatch, points, directions):
    found, truth = result
    assert found.formulation.exact
    assert found.problem.coefficients == 64
    assert not consistent_set(found).posed.exact
    omega = found.problem.frequency[0].omega[points] + 0.02
    options = {"omega": omega, "directions": directions, "rtol": 0.1}
    light = rid.worst_case_error(found, **options)
    assert light.certified
    assert np.all(np.abs(truth(omega) - response(found.model, omega)) <= light.upper[:, 0, 0])
    assert kept(light, tmp_path / "light").certified
    monkeypatch.setattr(sys.modules[consistent_set.__module__], "lightest", lambda posed, accuracy: posed)
    assert consistent_set(found).posed.exact
    exact = rid.worst_case_error(found, **options)
    slack = 1e-4  # of the bounds of the samples: the tails
    assert np.all(light.lower <= exact.upper * (1 + 1e-9))
    assert np.all(exact.lower <= light.upper * (1 + 1e-9))
    np.testing.assert_allclose(light.upper, exact.upper, rtol=0.1, atol=slack * 0.01)


def test_few_coefficients_and_slow_decay_stay_exact(result):
    found, _ = result
    problem = found.problem.with_prior(gain_bound=2.0, decay_rate=1.02)
    assert consistent_set(rid.identify(problem)).posed.exact


@pytest.fixture(scope="module")
def continuous():
    """A continuous plant of two light modes with noise at nine tenths of its bound, at 30 points."""
    rng, points = np.random.default_rng(0), 30
    omega = 2 * np.pi * np.linspace(5, 60, points)
    modes = 2 * np.pi * np.array([12.0, 31.0]), np.array([0.01, 0.005])

    def plant(s):
        parts = (g * w**2 / (s**2 + 2 * z * w * s + w**2) for g, w, z in zip((1, -2), *modes, strict=True))
        return sum(parts) + 0.5 * 400 / (s + 400)

    clean = plant(1j * omega)
    bound = 0.02 * np.abs(clean)
    values = clean + 0.9 * bound * np.exp(2j * np.pi * rng.random(points))
    frf = rid.FrequencyResponse(omega, values, bound=bound)
    prior = rid.Prior(gain_bound=1.5, decay=150.0)
    return rid.identify(rid.MixedProblem(frequency=frf, parametric=rid.kautz(*modes, dt=0), prior=prior)), plant


def test_few_coefficients_give_the_bounds_of_the_exact_form(continuous, monkeypatch):
    """Between the frequency points by the section; far outside, where its tail is as large as the class, by the exact form."""
    result, plant = continuous
    omega = 2 * np.pi * np.array([3.0, 300.0])
    found = rid.worst_case_error(result, omega=omega, directions=3)
    light = consistent_set(result)
    assert result.formulation.exact
    assert not light.posed.exact
    assert [light.posed_at(w).exact for w in omega] == [False, True]
    monkeypatch.setattr(sys.modules[consistent_set.__module__], "lightest", lambda posed, accuracy: posed)
    exact = rid.worst_case_error(result, omega=omega, directions=3)
    assert np.all(np.abs(found.upper / exact.upper - 1) < 0.03)
    assert np.all(found.lower <= exact.upper * (1 + 1e-9))
    assert np.all(exact.lower <= found.upper * (1 + 1e-9))
    assert np.all(np.abs(np.squeeze(result.model(1j * omega)) - plant(1j * omega)) <= found.upper[:, 0, 0])


@pytest.mark.slow
def test_saved_bounds_of_both_forms_are_verified(continuous, tmp_path):
    options = {"omega": 2 * np.pi * np.array([31.0, 300.0]), "directions": 4, "resume": tmp_path / "folder"}
    found = rid.worst_case_error(continuous[0], **options)
    assert found.verify()
    for again in (kept(found, tmp_path / "bounds"), rid.worst_case_error(continuous[0], **options)):  # resumed
        assert np.array_equal(again.upper, found.upper)
