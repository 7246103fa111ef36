"""Between and beyond the lines: small models against the identified one where nothing was measured."""

import control
import numpy as np
import pytest

import robustid as rid
from robustid.errors import InputTypeError
from robustid.identification import largest_ratio
from robustid.reduction.between_points import Guard
from support.edge_bands import edge_plant
from support.matrix_plants import plant, response
from support.paper_plant import AS_THE_PAPER, structure
from support.problems import rigid_structure
from support.two_mode_models import rigid_body

DENSE = np.linspace(0, np.pi, 501)  # and the angles of all poles


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


def test_a_passive_model_may_grow_beyond_its_data_as_an_inductance_or_a_capacitance():
    omega = np.geomspace(1, 100, 7)
    for truth in (lambda s: 1 + s / 10, lambda s: 1 + 10 / (s + 0.1)):
        frf = rid.FrequencyResponse(omega, truth(1j * omega), bound=0.01 * np.abs(truth(1j * omega)))
        result = rid.identify(rid.MixedProblem(frequency=frf, prior=rid.PositiveReal(decay=0.05)))
        small = rid.reduce_within_bounds(result)
        assert small.order == 1
        beyond = np.array([1e-2, 1e3])
        np.testing.assert_allclose(small.model(1j * beyond), truth(1j * beyond), rtol=0.1)


# --- near the centre of a proved band


def edge(kind, count):
    """Consistent problems whose poles are those of the plant."""
    for seed in range(1000):
        plant = edge_plant(kind, seed)
        if plant.box is None and (result := rid.identify(plant.problem)).consistent:
            yield result, plant.truth
            count -= 1
        if not count:
            return


def structures(count, **sizes):
    """A response and a record of the two modes and the rest of the paper's structure."""
    for seed in range(count):
        problem = structure(seed, **AS_THE_PAPER | sizes).with_prior(gain_bound=0.3, decay_rate=1.1)
        truth = rid.datasets.flexible_structure(seed=seed).truth
        yield rid.identify(problem), lambda omega, truth=truth: rid.core.responses(truth, omega * 0.01)


def mean_error(band, omega, model):
    """Of all frequencies and entries, over the least that there is: that of a model at the centre."""
    _, radius = band.at(omega)
    known = np.isfinite(radius)
    return float(np.mean(band.error_at(omega, model)[known] / radius[known]))


@pytest.mark.parametrize(
    "cases",
    [
        pytest.param(lambda: structures(1, lines=6, samples=6), id="one structure"),
        pytest.param(lambda: structures(10), marks=pytest.mark.slow, id="structures"),
        *(
            pytest.param(lambda kind=kind: edge(kind, 10), marks=pytest.mark.slow, id=kind)
            for kind in ("discrete", "continuous", "record", "symmetric")
        ),
    ],
)
def test_the_order_stays_the_bounds_are_kept_and_the_guaranteed_error_falls(cases):
    fallen, rng = [], np.random.default_rng(0)
    for result, truth in cases():
        problem = result.problem
        band = rid.band(result)
        before, after = (rid.reduce_within_bounds(result, band=one) for one in (None, band))
        assert after.order == before.order == after.model.nstates
        assert after.margin <= 1
        frf = problem.frequency[0]
        missed = np.abs(problem.plane.values_at(after.model, frf.omega) - frf.values)
        assert np.all(missed <= frf.bound.radius * (1 + 1e-9))
        poles = after.model.poles()
        assert np.all(np.abs(poles) < 1) if frf.dt else np.all(poles.real < 0)
        omega = rng.uniform(*band.range, 400)
        fallen.append(mean_error(band, omega, after.model) / mean_error(band, omega, before.model))
        # Any model's guaranteed error holds the truth: the bounds do not depend on how the model was found.
        apart = np.abs(truth(omega) - problem.plane.values_at(after.model, omega))
        assert np.all(apart <= band.error_at(omega, after.model) * (1 + 1e-9))
    # Frequencies that the search did not see: hardly worse anywhere, better as a rule.
    assert max(fallen) < 1.05
    assert np.median(fallen) <= 1.0


@pytest.mark.slow
def test_rigid_bodies_stay_exact():
    frf, basis = rigid_body(0.1)
    prior = rid.Prior(gain_bound=0.5, decay_rate=1.1)
    result = rid.identify(rid.MixedProblem(frequency=frf, prior=prior, parametric=basis))
    assert result.consistent
    found = rid.reduce_within_bounds(result, band=rid.band(result))
    assert np.sum(np.abs(found.model.poles() - 1) < 1e-6) == 2
    assert found.margin <= 1


def test_a_band_is_asked_for():
    result = rid.identify(structure(0))
    with pytest.raises(InputTypeError, match="`band` must be the result of band"):
        rid.reduce_within_bounds(result, band=result.model)
