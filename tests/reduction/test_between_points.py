"""Between and beyond the lines: small models against the identified one where nothing was measured."""

import control
import numpy as np
import pytest

import robustid as rid
from robustid.identification import largest_ratio
from robustid.reduction.between_points import Guard
from support.matrix_plants import plant, response
from support.problems import rigid_structure

DENSE = np.linspace(0, np.pi, 2001)


def low_lines(seed, level):
    """A random plant of order 8 with lines up to a third of the Nyquist frequency only."""
    rng = np.random.default_rng(seed)
    poles = np.array([0.93 * np.exp(0.3j), 0.95 * np.exp(0.7j), 0.7 * np.exp(1.4j), 0.6])
    residues = rng.standard_normal(4) + 1j * rng.standard_normal(4)
    angles = np.linspace(0.05, 1.0, 30)
    z = np.exp(1j * angles)[:, None]
    F = np.sum(residues / (z - poles) + residues.conj() / (z - poles.conj()), axis=1)
    size = np.abs(F).max()
    noise = np.sqrt(rng.uniform(size=30)) * np.exp(2j * np.pi * rng.uniform(size=30))
    frf = rid.FrequencyResponse(angles / 0.01, F + level * size * noise, bound=level * size, dt=0.01)
    return rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=2 * size, decay_rate=1.03))


def resonance(pole):
    return control.ss(control.tf([1.0], np.real(np.poly([pole, pole.conjugate()])), 1.0))


def excess(identification, model, gains):
    """Largest |G - F|/(K S + the largest |F| within a tenth of the frequency)/margin, angle by angle, on a dense grid."""
    poles = np.abs(np.angle(np.append(model.poles(), identification.model.poles())))
    angles = np.unique(np.concatenate([DENSE, poles]))
    F, G = response(identification.model, angles), response(model, angles)
    found = 0.0
    for w, f, g in zip(angles, F, G, strict=True):
        around = np.abs(F[np.abs(angles - w) <= 0.1 * w]).max(axis=0)
        found = max(found, np.max(np.abs(g - f) / (gains + around)))
    return found / max(1, identification.margin)


def compared(monkeypatch, seed, level):
    """Of both models the order and the excess over what is allowed, without and with the guard; None without a consistent class."""
    result = rid.identify(low_lines(seed, level))
    if not result.consistent:
        return None
    with monkeypatch.context() as patch:
        patch.setattr(Guard, "check", lambda *_: (0.0, None))
        free = rid.reduce_within_bounds(result)
    held = rid.reduce_within_bounds(result)
    assert held.margin == pytest.approx(largest_ratio(result.problem, held.model), rel=1e-9)
    assert max(dict(held.tried)[held.order], held.margin) <= 1
    gain = result.prior.gain_bound
    return free.order, excess(result, free.model, gain), held.order, excess(result, held.model, gain)


def test_a_resonance_that_no_line_sees_is_removed(monkeypatch):
    free_order, free, held_order, held = compared(monkeypatch, 8, 0.02)
    assert free > 100
    assert held <= 1.01
    assert held_order <= free_order + 1


@pytest.mark.slow
def test_resonances_that_no_line_sees_at_40_seeds(monkeypatch):
    found = [compared(monkeypatch, seed, level) for seed in range(20) for level in (0.005, 0.02)]
    free_orders, free, held_orders, held = np.array([one for one in found if one]).T
    more = np.bincount((held_orders - free_orders).astype(int) + 1)
    print(f"{free.size} consistent; beyond without the guard: {np.sum(free > 1.01)}, up to {free.max():.3g}; with it")
    print(f"{np.sum(held > 1.01)}; one order less, equal, more, ...: {more}")
    assert np.sum(free > 2) >= 5
    assert np.all(held <= 1.01)
    assert np.all(held_orders <= free_orders + 1)


def test_excess_is_that_of_a_slow_judge():
    """Two outputs: a resonance beyond the lines in one entry of a model."""
    model, _ = plant(0, 2, 2, 1.2)
    angles = np.linspace(0.1, 1.5, 12)
    frf = rid.FrequencyResponse(angles, response(model, angles), bound=0.05, dt=1.0)
    scaling = np.array([[1.0, 2.0], [0.5, 1.0]])
    prior = rid.Prior(gain_bound=4.0, decay_rate=1.05, scaling=scaling)
    result = rid.identify(rid.MixedProblem(frequency=frf, prior=prior))
    narrow = resonance(0.999 * np.exp(2.5j))
    spoilt = result.model + control.ss(narrow.A, narrow.B * [[0.05, 0]], [[1], [0]] * narrow.C, np.zeros((2, 2)), 1.0)

    judged, lines = Guard(result, 0, max(1.0, result.margin)).check(spoilt, 1.0)
    assert judged > 2
    assert judged == pytest.approx(excess(result, spoilt, 4.0 * scaling), rel=0.02)
    assert lines.omega.size == 1
    assert lines.omega[0] == pytest.approx(2.5, abs=1e-3)
    np.testing.assert_allclose(lines.values, response(result.model, lines.omega), rtol=1e-8)

    assert Guard(result, 0).check(result.model, 1.0) == (0.0, None)


def test_integrators_are_compared_from_the_lowest_line_on():
    rigid, _ = rigid_structure()
    omega = np.linspace(5, 100, 30)
    F = response(rigid, omega * 0.01)[:, 0, 0]
    frf = rid.FrequencyResponse(omega, F, bound=0.02 * np.abs(F), dt=0.01)
    prior = rid.Prior(gain_bound=1e-4, decay_rate=1.1)
    result = rid.identify(rid.MixedProblem(frequency=frf, prior=prior, parametric=rigid))
    assert Guard(result, 2).check(result.model, 1.0) == (0.0, None)
    narrow = resonance(0.999 * np.exp(2.5j))
    spoilt = result.model + control.ss(narrow.A, narrow.B, 1e-6 * narrow.C, 0, 0.01)
    judged, lines = Guard(result, 2).check(spoilt, 1.0)
    assert judged > 2
    assert lines.omega[0] * 0.01 == pytest.approx(2.5, abs=1e-3)
