"""A small model that follows the centre of a proved band: as many poles, inside every bound, and a smaller guaranteed error."""

import numpy as np
import pytest

import robustid as rid
from robustid.errors import InputTypeError
from support.edge_bands import edge_plant
from support.paper_plant import AS_THE_PAPER, structure
from support.two_mode_models import rigid_body


def edge(kind, count):
    """Consistent problems whose poles are those of the plant."""
    for seed in range(1000):
        plant = edge_plant(kind, seed)
        if plant.box is None and (result := rid.identify(plant.problem)).consistent:
            yield result, plant.truth
            count -= 1
        if not count:
            return


def structures(count):
    """A response and a record of the two modes and the rest of the paper's structure."""
    for seed in range(count):
        problem = structure(seed, **AS_THE_PAPER).with_prior(gain_bound=0.3, decay_rate=1.1)
        truth = rid.datasets.flexible_structure(seed=seed).truth
        yield rid.identify(problem), lambda omega, truth=truth: rid.core.responses(truth, omega * 0.01)


def slow_edges(kind):
    return pytest.param(lambda: edge(kind, 10), marks=pytest.mark.slow, id=kind)


def mean_error(band, omega, model):
    """Of all frequencies and entries, over the least that there is: that of a model at the centre."""
    _, radius = band.at(omega)
    known = np.isfinite(radius)
    return float(np.mean(band.error_at(omega, model)[known] / radius[known]))


@pytest.mark.parametrize(
    "cases",
    [
        pytest.param(lambda: structures(1), id="one structure"),
        pytest.param(lambda: structures(10), marks=pytest.mark.slow, id="structures"),
        *map(slow_edges, ("discrete", "continuous", "record", "symmetric")),
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
