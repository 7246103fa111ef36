"""Two measured things in one loop: verdicts on all pairs against pairs, passivity, refusals."""

from types import SimpleNamespace

import control
import numpy as np
import pytest

import robustid as rid
from robustid.guarantees import InterconnectionStatus
from robustid.guarantees.loop_errors import closing_error
from support.cases import slow
from support.loop_bands import (
    Around,
    all_pass,
    edge_member,
    grid,
    joined,
    loop_is_stable,
    loop_of_discs,
    stable_model,
    unstable_poles,
    values,
    with_phase,
)

STABLE, UNSTABLE, UNDECIDED = InterconnectionStatus


# ---------------------------------------------------------------------------------------------------------- known answers


@pytest.mark.parametrize("dt", [0.1, 0.0])
def test_constants_have_the_margin_of_the_exact_condition(dt):
    """The discs are the same at all frequencies: the margin t solves the closed form with t a and t b."""
    g, h, a, b, top = 0.7, 0.6, 0.4, 0.5, np.pi / dt if dt else np.inf
    source = Around(control.ss([], [], [], g, dt), [0, top], [[[a]]])
    load = Around(control.ss([], [], [], h, dt), [0, 1.0, top], [[[b]], [[b]]])
    found = rid.interconnection(source, load)
    t = found.margin
    size = 1 + g * h
    left = size**2 + t**4 * (a * b) ** 2 - t**2 * ((a * h) ** 2 + (b * g) ** 2 + 2 * a * b)
    assert found.status is STABLE
    assert 0 < left < 0.01
    np.testing.assert_allclose(found.loci, g * h)
    assert found.distance.min() == pytest.approx(size - a * h - b * g - a * b)


def test_two_known_systems_are_judged_by_their_poles():
    stable, unstable = (control.tf([gain], [1, 1]) for gain in (0.5, 8.0))
    lag = control.tf([1], [1, 2, 1])
    assert rid.interconnection(stable, lag).status is STABLE
    assert rid.interconnection(stable, lag).margin == np.inf
    found = rid.interconnection(10 * unstable, lag)
    assert found.status is UNSTABLE
    poles = control.feedback(10 * unstable, lag).poles()
    np.testing.assert_allclose(np.sort_complex(found.poles), np.sort_complex(poles[poles.real > 0]))
    assert "infinite" in found.summary()


@pytest.mark.parametrize("dt", [0.1, slow(0.0)])
@pytest.mark.parametrize("size", [(1, 1), (2, 2), slow((1, 2))])
@pytest.mark.parametrize("seeds", [range(1), slow(range(1, 40))])
def test_stable_is_never_wrong_and_beyond_the_margin_of_discs_a_pair_is_not(dt, size, seeds):
    """Pairs with errors at the edge of both bands, which are of different grids."""
    ny, nu = size
    proved = 0
    for seed in seeds:
        rng = np.random.default_rng(seed)
        top = np.pi / dt if dt else np.inf
        wide = (-2.0, -1.3) if seed % 2 == 0 else (-1.5, 0.0)
        edges = [np.append(np.append(0, np.sort(rng.uniform(0.1, 30, count))), top) for count in (3, 5)]
        source = Around(
            stable_model(rng, ny, nu, dt, 1.5), edges[0], np.tile(10 ** rng.uniform(*wide, (1, ny, nu)), (4, 1, 1))
        )
        load = Around(
            stable_model(rng, nu, ny, dt, 1.0), edges[1], np.tile(10 ** rng.uniform(*wide, (1, nu, ny)), (6, 1, 1))
        )
        found = rid.interconnection(source, load)
        nominal = loop_is_stable(source.model, load.model)
        if found.margin > 1:
            proved += 1
            assert found.status is (STABLE if nominal else UNSTABLE)
        else:
            assert found.status is not STABLE
        for part in (1.0, 0.999 * found.margin):
            for _ in range(3):
                if part <= found.margin:
                    assert loop_is_stable(edge_member(rng, source, part), edge_member(rng, load, part)) == nominal
        if size == (1, 1) and 0 < found.frequency < top:
            at_edge(source, load, found)
    assert proved >= len(seeds) // 2 - len(seeds) // 8


def at_edge(source, load, found):
    """All-pass errors with the phases that close the loop: at 0.98 of them all is as with the models, at 1.02 not."""
    dt = source.model.dt
    point = np.exp(1j * found.frequency * dt) if dt else 1j * found.frequency
    g, h = (complex(one.model(point)) for one in (source, load))
    a, b = (one.entries[0, 0, 0] for one in (source, load))
    delta, factor, _ = closing_error(loop_of_discs(g, h), np.diag([a, b]))
    assert found.margin <= factor * (1 + 1e-9)
    assert factor <= 1.01 * found.margin  # the frequency is the middle of the arc that limits
    delta = factor * delta
    errors = [with_phase(delta[k, k], point, dt) * abs(delta[k, k]) for k in (0, 1)]
    before = unstable_poles(source.model, load.model)
    for part, same in ((0.98, True), (1.02, False)):
        pair = source.model + errors[0] * part, load.model + errors[1] * part
        assert (unstable_poles(*pair) == before) == same


def outputs_times(model, factor):
    return control.ss(model.A, model.B, factor * model.C, factor * model.D, model.dt)


@pytest.mark.slow
def test_units_scale_nothing_but_the_bounds():
    rng = np.random.default_rng(1)
    edges, entries = [0.0, 3.0, np.inf], np.full((2, 2, 2), 0.05)
    source, load = (Around(stable_model(rng, 2, 2, 0.0, 1.0), edges, entries) for _ in range(2))
    found = rid.interconnection(source, load)
    for scale in (2.0**60, 2.0**-60):
        other = rid.interconnection(
            Around(outputs_times(source.model, scale), edges, entries * scale),
            Around(outputs_times(load.model, 1 / scale), edges, entries / scale),
        )
        assert other.margin == pytest.approx(found.margin, rel=1e-9)
        assert other.frequency == pytest.approx(found.frequency, rel=1e-9)


@pytest.mark.slow
def test_exchanging_both_sides_changes_nothing():
    rng = np.random.default_rng(2)
    edges = [0.0, 3.0, np.inf]
    source = Around(stable_model(rng, 1, 2, 0.0, 1.0), edges, rng.uniform(0.02, 0.2, (2, 1, 2)))
    load = Around(stable_model(rng, 2, 1, 0.0, 1.0), edges, rng.uniform(0.02, 0.2, (2, 2, 1)))
    first, second = rid.interconnection(source, load), rid.interconnection(load, source)
    assert first.margin == pytest.approx(second.margin, rel=2e-3)
    assert first.shares[0].sum() == pytest.approx(second.shares[1].sum(), abs=0.05)
    assert sum(share.sum() for share in first.shares) == pytest.approx(1)
    assert {first.limited_by, second.limited_by} == {"source", "load"}


# -------------------------------------------------------------------------------------------------------------- passivity


def port(rng, lossy):
    """A random passive 2x2 network with losses: D + sum b b'/(s + a)."""
    a, B = rng.uniform(0.5, 5, 3), rng.normal(size=(3, 2))
    return control.ss(-np.diag(a), B, B.T, lossy * np.eye(2))


@pytest.mark.slow
def test_two_lossy_networks_are_stable_with_errors_below_their_losses():
    for seed in range(2):
        rng = np.random.default_rng(seed)
        source, load = (Around(port(rng, 3.0), [0, np.inf], np.full((1, 2, 2), 1.4)) for _ in range(2))
        found = rid.interconnection(source, load)
        assert found.status is STABLE
        assert loop_is_stable(edge_member(rng, source, 1.0), edge_member(rng, load, 1.0))


def test_a_passive_class_needs_no_band_beside_a_positive_side():
    """Nothing bounds a positive-real class beyond its lines; with a resistor at its port it is stable all the same."""
    edges, entries = [0.0, 1.0, 30.0, np.inf], np.array([0.5, 2.0, np.inf])[:, None, None]
    source = Around(control.ss(control.tf([1.2, 1.0], [1, 1])), edges, entries)
    resistor = control.ss([], [], [], 3.0, 0.0)
    assert rid.interconnection(source, resistor).status is UNDECIDED
    source.problem = SimpleNamespace(prior=rid.PositiveReal(decay=0.2))
    found = rid.interconnection(source, resistor)
    assert found.status is STABLE
    assert found.passive[-1]
    against = rid.interconnection(source, -1 * resistor)
    assert against.status is not STABLE
    assert against.margin == 0
    assert "nothing bounds entry (1, 1)" in against.summary()


@pytest.mark.slow
def test_a_positive_real_class_from_data_beside_a_resistor():
    omega = np.geomspace(0.3, 30, 12)
    frf = rid.FrequencyResponse(omega, 1 / (1j * omega + 1) + 0.2, bound=0.02)
    problem = rid.MixedProblem(frequency=frf, prior=rid.PositiveReal(decay=0.2))
    error = rid.worst_case_error(rid.identify(problem), omega=omega[::3], directions=4, rtol=0.3)
    assert np.isinf(error.circle.entries[-1]).all()
    assert rid.interconnection(error, control.ss([], [], [], 3.0, 0.0)).status is STABLE


# ------------------------------------------------------------------------------------------------------------- from data


def plant_at(gain, pole, delay, z):
    return gain * (1 - pole) * z ** (1 - delay) / (z - pole)


def measured(gain, pole, omega, bound, delay=0):
    """An identification of data of a first-order plant."""
    frf = rid.FrequencyResponse(omega, plant_at(gain, pole, delay, np.exp(0.1j * omega)), bound=bound * gain, dt=0.1)
    prior = rid.Prior(gain_bound=2.5 * gain, decay_rate=1.25)
    return rid.identify(rid.MixedProblem(frequency=frf, prior=prior))


GRIDS = np.linspace(0.5, 31.0, 16), np.linspace(0.2, 30.0, 11)


@pytest.mark.parametrize(
    ("gain", "bound", "wanted"), [(4.0, 0.2, UNSTABLE), slow(2.0, 0.02, STABLE), slow(80.0, 0.02, UNSTABLE)]
)
def test_identified_pairs(gain, bound, wanted):
    """A pair that is returned keeps all samples within their bounds, and its loop is unstable by python-control."""
    source, load = measured(1.0, 0.5, GRIDS[0], bound), measured(gain, 0.7, GRIDS[1], bound, delay=1)
    found = rid.interconnection(source, rid.band(load))
    assert found.status is wanted
    if wanted is STABLE:
        assert found.pair is None
        return
    for model, side in zip(found.pair, (source, load), strict=True):
        frf = side.problem.frequency[0]
        at = values(model, frf.omega)
        assert np.all(np.abs(at - frf.values) <= np.asarray(frf.bound) * (1 + 1e-6))
        assert np.all(np.abs(model.poles()) < 1)
    assert not loop_is_stable(*found.pair)
    assert np.all(np.abs(found.poles) > 1)
    assert "unstable" in found.summary()


@pytest.mark.parametrize("seeds", [range(1), slow(range(1, 30))])
def test_no_verdict_on_noisy_data_is_wrong(seeds):
    """The truth is consistent with both: stable for all pairs means that its own loop is; a pair that is shown is consistent."""
    verdicts = []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        gain, poles, bound = 10 ** rng.uniform(-0.3, 1.0), rng.uniform(0.3, 0.75, 2), 10 ** rng.uniform(-2.0, -0.7)
        sides = []
        for k, omega in enumerate(GRIDS):
            truth = plant_at(gain if k else 1.0, poles[k], k, np.exp(0.1j * omega))
            noise = bound * (gain if k else 1.0) * np.exp(2j * np.pi * rng.random(omega.size))
            frf = rid.FrequencyResponse(omega, truth + noise, bound=np.abs(noise) * (1 + 1e-9), dt=0.1)
            prior = rid.Prior(gain_bound=3.0 * (gain if k else 1.0), decay_rate=1.2)
            sides.append(rid.identify(rid.MixedProblem(frequency=frf, prior=prior)))
        found = rid.interconnection(*sides, time_limit=20.0)
        verdicts.append(found.status)
        loop = [
            control.ss(control.tf(top, [1, -pole], 0.1))
            for top, pole in (([1 - poles[0], 0], poles[0]), ([gain * (1 - poles[1])], poles[1]))
        ]
        if found.status is STABLE:
            assert loop_is_stable(*loop)
        if found.margin > 1:
            assert loop_is_stable(*loop) == (found.status is STABLE)
        if found.pair is not None:
            assert not loop_is_stable(*found.pair)
            for model, side in zip(found.pair, sides, strict=True):
                (frf,) = side.problem.frequency
                error = np.abs(values(model, frf.omega) - frf.values)
                assert np.all(error <= np.asarray(frf.bound) * (1 + 1e-6))
    if len(verdicts) > 10:
        assert {STABLE, UNSTABLE} <= set(verdicts)


def test_a_band_beside_a_known_system(rng):
    """As the robust stability margin of that system, taken as a controller, says."""
    band = rid.band(measured(1.0, 0.5, GRIDS[0], 0.05))
    known = control.ss(control.tf([0.6], [1, -0.5], 0.1))
    found = rid.interconnection(band, known)
    assert found.margin == pytest.approx(band.robust_stability_margin(known).margin, rel=2e-3)
    assert found.limited_by == "source"
    turned = rid.interconnection(known, band)
    assert turned.margin == pytest.approx(found.margin, rel=2e-3)
    assert turned.limited_by == "load"


def test_undecided_says_what_to_measure():
    """Without data there is no pair to show: what is missing is said side by side, and doing it decides."""
    edges = [0.0, np.pi / 0.1]
    source = Around(control.ss([], [], [], 0.8, 0.1), edges, [[[1.5]]])
    load = Around(control.ss([], [], [], 0.9, 0.1), edges, [[[0.9]]])
    found = rid.interconnection(source, load)
    assert found.status is UNDECIDED
    assert 0 < found.needed[0] < 1
    assert 0 < found.needed[1] < 1
    assert len(found.wanted) == 2
    for side in (0, 1):
        for factor, status in ((0.99, STABLE), (1.02, UNDECIDED)):
            parts = [1.5, 0.9]
            parts[side] *= found.needed[side] * factor
            pair = [Around(one.model, edges, [[[part]]]) for one, part in zip((source, load), parts, strict=True)]
            assert rid.interconnection(*pair).status is status


# --------------------------------------------------------------------------------------------------------------- refusals


def test_sides_that_make_no_loop_are_refused():
    lag, wide = control.tf([1], [1, 1]), control.ss(-np.eye(2), np.eye(2), np.ones((1, 2)), 0)
    sampled = control.ss(0.5, 1.0, 1.0, 0.0, 0.1)
    frf = rid.FrequencyResponse([1.0], [1.0], bound=0.1)
    integrating = Around(control.ss(-1, 1, 1, 0), [0.5, np.inf], [[[0.1]]])
    cases = [
        (lag, wide, rid.InputError, "`load` must have 1 input and 1 output"),
        (lag, sampled, rid.InputError, "time base"),
        (lag, control.tf([1], [1, -1]), rid.InputError, "`load` must be stable"),
        (lag, frf, TypeError, "`load` must be a Band"),
        (frf, lag, TypeError, "`source` must be a Band"),
        (integrating, lag, rid.InputError, "integrator"),
        (control.ss([], [], [], -1.0, 0.0), control.ss([], [], [], 1.0, 0.0), rid.InputError, "singular for infinite"),
    ]
    for source, load, kind, words in cases:
        with pytest.raises(kind, match=words):
            rid.interconnection(source, load)


def test_a_time_limit_is_a_time():
    with pytest.raises(rid.InputError, match="`time_limit`"):
        rid.interconnection(control.tf([1], [1, 1]), control.tf([1], [1, 1]), time_limit=-1.0)


def test_a_band_without_a_model_is_refused():
    problem = measured(1.0, 0.5, GRIDS[0], 0.05).problem
    with pytest.raises(rid.InputError, match="with_model"):
        rid.interconnection(rid.band(problem, omega=[1.0], knots=20), control.ss([], [], [], 0.1, 0.1))


def test_the_judges_of_this_file_judge():
    """All-pass functions have modulus 1, the asked phase, and stable poles."""
    rng = np.random.default_rng(0)
    for dt in (0.1, 0.0):
        for _ in range(5):
            one = all_pass(rng, dt)
            np.testing.assert_allclose(np.abs(values(one, grid(dt))), 1, rtol=1e-9)
            target, omega = rng.normal() + 1j * rng.normal(), rng.uniform(1, 20)
            point = np.exp(1j * omega * dt) if dt else 1j * omega
            found = with_phase(target, point, dt)
            assert abs(complex(found(point)) - target / abs(target)) < 1e-2
            assert np.all(np.abs(found.poles()) < 1) if dt else np.all(found.poles().real < 0)
    assert joined([[all_pass(rng, 0.1)] * 2], 0.1).noutputs == 1


def test_the_figure_shows_loci_discs_and_the_point_that_they_must_not_hold():
    source = Around(control.ss([], [], [], 0.7, 0.1), [0, np.pi / 0.1], [[[0.2]]])
    figure = rid.interconnection(source, control.ss(control.tf([0.3], [1, -0.5], 0.1))).plot()
    (axes,) = figure.axes
    assert axes.get_title(loc="left") == "Eigenvalues of source times load"
    assert any(np.allclose(np.c_[line.get_data()], [[-1, 0]]) for line in axes.lines)
