"""Tubes of steps of a loop: a closed form, dense integrals, and steps of consistent plants, simulated by `control`."""

import dataclasses
import itertools
from types import SimpleNamespace

import control
import numpy as np
import pytest

import robustid as rid
from robustid.design import PID, Limits
from robustid.errors import InputTypeError
from robustid.guarantee import step_tube
from robustid.guarantees import STEPS, CircleBound, step_tubes
from robustid.guarantees.loop_steps import _integrals
from robustid.guarantees.outputs import consistent_outputs
from robustid.identification import nominal_model
from robustid.identification.formulation import Candidate
from support.design_cases import DT, STRUCTURES, band_of, matrix_band_of, responses
from support.loop_candidates import consistent_members, is_consistent
from support.unstable_loop import growing


def simulated(plant, controller, times, of):
    """Steps y (T, ny, inputs) as `control` has them: of r in u = C (r - y), or at the plant's input."""
    eye = control.ss([], [], [], np.eye(plant.noutputs), DT)
    loop = control.feedback(plant * controller, eye) if of == "set point" else control.feedback(plant, controller)
    found = control.step_response(loop, times, squeeze=False).outputs
    return np.moveaxis(found, 2, 0)


class FlatBand(rid.guarantee.Band):
    """A band whose bound on the whole axis is one number."""

    flat = 0.2

    @property
    def circle(self):
        edges = np.array([0.0, np.pi / DT])
        return CircleBound(edges, np.array([self.flat]), 0.0, True, (), np.full((1, 1, 1), self.flat))


def test_a_dead_beat_loop_has_its_closed_form():
    """P = 1 + Delta with |Delta| <= b at every frequency, C = 1/(z - 1): y - y_0 is w/(1 + w) at every frequency, |w| <= b.

    That is the disc about -b^2/(1 - b^2) with the radius b/(1 - b^2).
    """
    b = FlatBand.flat
    frf = rid.FrequencyResponse(np.linspace(10, 300, 8), np.ones(8), bound=b / 2, dt=DT)
    problem = rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=1.1, decay_rate=2.0))
    plain = rid.band(problem, model=control.ss([], [], [], 1.0, DT))
    band = FlatBand(**{one.name: getattr(plain, one.name) for one in dataclasses.fields(plain) if one.init})
    tube = step_tube(rid.loop_bounds(band, controller=control.ss(1.0, 1.0, 1.0, 0.0, DT)), horizon=6)
    np.testing.assert_allclose(tube.nominal, [0, 1, 1, 1, 1, 1], atol=1e-12)
    centre = (tube.upper + tube.lower) / 2 - tube.nominal
    np.testing.assert_allclose(centre, [-(b**2) / (1 - b**2), 0, 0, 0, 0, 0], atol=1e-3)
    half = (tube.upper - tube.lower) / 2
    assert np.all((half >= b / (1 - b**2)) & (half <= 1.03 * b / (1 - b**2)))


@pytest.mark.parametrize("count", [1, 2, 40, 41])
def test_integrals_over_arcs_are_those_of_every_sample(count):
    rng = np.random.default_rng(count)
    edges = np.sort(rng.uniform(0, np.pi, 31))
    pieces = SimpleNamespace(middle=(edges[1:] + edges[:-1]) / 2, half=np.diff(edges) / 2)
    c = rng.normal(size=30) + 1j * rng.normal(size=30)
    found = _integrals(c, pieces, count)
    for k in range(1, count + 1):
        direct = np.sum(np.real(c * (np.exp(1j * k * edges[1:]) - np.exp(1j * k * edges[:-1])) / (1j * k)))
        assert abs(found[k - 1] - direct) <= 1e-13


def inside(plant, controller, tubes):
    """Shares of the ranges that the steps of a plant come to: at most 1."""
    shares = []
    for (of, place), tube in tubes.items():
        y = simulated(plant, controller, tube.times, of)[:, *place]
        middle, half = (tube.upper + tube.lower) / 2, (tube.upper - tube.lower) / 2
        shares.append(float(np.max(np.abs(y - middle) / half)))
    return shares


def dense(bounds, of, points=1 << 14):
    """Half of the width from values at many angles, S divided by 1 - 1/z: in discs about the model, or about other centres."""
    theta = (np.arange(points) + 0.5) * np.pi / points
    circle = bounds.band.circle
    held = circle.sets_at(theta / DT)
    b, e, r = (one[:, 0, 0] for one in (held.bound, held.centre, held.radius))
    P, C = responses(bounds.band.model, theta / DT)[:, 0, 0], responses(bounds.controller, theta / DT)[:, 0, 0]
    S = 1 / (1 + P * C)
    moved = np.abs(S**2 * (C if of == "set point" else 1) / (1 - np.exp(-1j * theta)))
    about_model, about_centre = (
        b / (1 - np.abs(C * S * b) ** 2),
        r / (np.abs(1 + C * S * e) ** 2 - np.abs(C * S * r) ** 2),
    )
    return float(np.mean(moved * np.minimum(about_model, about_centre)))


@pytest.mark.parametrize("seed", [pytest.param(k, marks=[] if k == 3 else pytest.mark.slow) for k in range(50)])
def test_steps_of_consistent_plants_are_in_their_range(seed):
    """The true plant and consistent ones, of 50 problems a thousand; and the width is that of a dense sum."""
    plant, band = band_of(seed)
    design = rid.design_controller(band, STRUCTURES[seed % 3], limits=Limits(sensitivity_peak=2.0))
    (bounds,) = design.proofs
    tubes = {(of, (0, 0)): step_tube(bounds, of) for of in STEPS}
    for (of, _), tube in tubes.items():
        half = (tube.upper[0] - tube.lower[0]) / 2
        assert 1 <= half / dense(bounds, of) <= 1.05
    near, result = [omega for _, omega in design.shares.values() if np.isfinite(omega)], rid.identify(band.problem)
    count = 1 if seed == 3 else 20
    for one in (plant, *consistent_members(result, count, np.random.default_rng(seed), near)):
        assert max(inside(one, design.controller, tubes)) <= 1
    if seed == 3:
        tubes = {("load", (0, 0)): step_tube(bounds, "load", horizon=4, identification=result)}
        assert np.all(tubes["load", (0, 0)].upper - tubes["load", (0, 0)].lower < 1.6 * half)
        assert max(inside(one, design.controller, tubes)) <= 1


def farthest(result, model, controller, sample, sign):
    """The consistent plant whose step of the set point is about the farthest at a sample, to first order."""
    times = DT * np.arange(sample + 1)
    given = control.step_response(control.feedback(controller, model), times).outputs
    known = control.forced_response(control.feedback(1, model * controller), times, given).outputs
    outputs = consistent_outputs(result, known)
    point, none = outputs.consistent.member(outputs.functional(sample, sign), 0.02), np.zeros(0)
    return nominal_model(
        outputs.consistent.posed, Candidate(*point, none, none, ""), outputs.consistent.level, 0.0
    ).model


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_the_farthest_plants_come_near_to_the_range_that_the_class_narrows(seed):
    _, band = band_of(seed)
    design = rid.design_controller(band, STRUCTURES[seed % 3], limits=Limits(sensitivity_peak=2.0))
    (bounds,), result = design.proofs, rid.identify(band.problem)
    wide = step_tube(bounds, horizon=8)
    tube, shares = step_tube(bounds, horizon=8, identification=result), []
    assert np.all((tube.lower >= wide.lower) & (tube.upper <= wide.upper))
    for sample, sign in itertools.product((3, 5), (-1.0, 1.0)):
        one = farthest(result, bounds.band.model, design.controller, sample, sign)
        assert is_consistent(band.problem, one)
        shares += inside(one, design.controller, {("set point", (0, 0)): tube})
    assert 0.5 <= max(shares) <= 1


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_every_entry_of_a_matrix_has_a_range(seed):
    plant, band = matrix_band_of(seed)
    design = rid.design_controller(band, PID())
    (bounds,) = design.proofs
    tubes = {(of, place): step_tube(bounds, of, entry=place) for of in STEPS for place in np.ndindex(2, 2)}
    assert max(inside(plant, design.controller, tubes)) <= 1
    for (of, i, j), tube in step_tubes(bounds).items():  # on the same arcs: as wide, but for what arcs take
        assert np.ptp([one.upper[0] - one.lower[0] for one in (tube, tubes[of, (i, j)])]) <= 0.03 * (
            tube.upper[0] - tube.lower[0]
        )


def test_an_unstable_plant_in_its_loop_has_a_range():
    (plant, loop, _, band), pi = growing(), control.ss(1.0, 0.02, 1.0, 0.5, DT)
    tubes = {(of, (0, 0)): step_tube(rid.loop_bounds(band, loop, pi), of) for of in STEPS}
    assert max(inside(plant, pi, tubes)) <= 1
    assert tubes["set point", (0, 0)].upper.max() < 5
    with pytest.raises(rid.InputError, match="controller that integrates"):
        step_tube(rid.loop_bounds(band, loop))


def test_what_has_no_range_is_refused():
    _, band = band_of(3)
    pi = control.ss(1.0, 0.01, 1.0, 0.1, DT)
    bounds = rid.loop_bounds(band, controller=pi)
    for change, words in (
        ({"bounds": rid.loop_bounds(band, controller=-100 * pi)}, "must be proved"),
        ({"of": "noise"}, "`of` must be one of"),
        ({"entry": (0, 1)}, r"`entry` must be \(output, set point\) of 1 and 1"),
        ({"horizon": 0}, "`horizon`"),
    ):
        with pytest.raises(rid.InputError, match=words):
            step_tube(**{"bounds": bounds, **change})
    for change in ({"bounds": band}, {"identification": band}):
        with pytest.raises(InputTypeError, match="must be"):
            step_tube(**{"bounds": bounds, **change})
