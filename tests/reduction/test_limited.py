"""Bands, horizons, weights and static gain: Gramians against quadrature, closed forms, what is kept, refusals."""

import itertools

import control
import numpy as np
import pytest
import scipy.linalg as sla

from robustid.errors import InputTypeError
from robustid.reduction import ReductionStatus, balanced_truncation
from robustid.reduction.gramians import partial_gramian_factors, split
from support.cases import slow
from support.pairwise import every_one
from support.reduction_models import gap, mode, peak, points_of, random_model, response
from support.refusals import refusals
from support.two_mode_models import two_modes


def gramians(model, **limits):
    """(Q, P) of a stable model in the states of the model itself, and those states."""
    stable, _ = split(model, "refuse")
    chosen = {"band_hz": None, "horizon": None, "weight": None} | limits
    return [factor @ factor.T for factor in partial_gramian_factors(model, stable, **chosen)], stable


def integral(values, nodes_weights):
    """Sum of weight times value, over Gauss points."""
    return sum(w * values(x) for x, w in nodes_weights)


def gauss(edges, count=24):
    x, w = np.polynomial.legendre.leggauss(count)
    for a, b in itertools.pairwise(edges):
        yield from zip((a + b) / 2 + (b - a) / 2 * x, (b - a) / 2 * w, strict=True)


def damped_model(seed, *, discrete):
    """Well enough damped for quadrature: 7 states, 2 inputs, 3 outputs."""
    rng = np.random.default_rng(seed)
    a = sla.block_diag([[-0.4, 3.0], [-3.0, -0.4]], [[-0.7, 7.0], [-7.0, -0.7]], [[-0.5, 1.0], [0.0, -0.5]], [[-4.0]])
    a = sla.expm(0.2 * a) if discrete else a
    q = np.linalg.qr(rng.standard_normal((7, 7)))[0]
    b, c = rng.standard_normal((7, 2)), rng.standard_normal((3, 7))
    return control.StateSpace(q @ a @ q.T, q @ b, c @ q.T, rng.standard_normal((3, 2)), 0.2 if discrete else 0)


@pytest.mark.parametrize(("discrete", "band"), every_one([False, True], [((0.0, 0.3),), ((0.3, 0.9),), ((1.0, 2.5),)]))
def test_gramians_of_a_band_are_the_integrals_over_it(discrete, band):
    for seed in range(3):
        model = damped_model(seed, discrete=discrete)
        (seen, reached), parts = gramians(model, band_hz=band)
        edges = np.linspace(*(2 * np.pi * np.array(band)), 40)
        point = (lambda w: np.exp(0.2j * w)) if discrete else (lambda w: 1j * w)

        def both(w, parts=parts, point=point):
            resolvent = np.linalg.inv(point(w) * np.eye(7) - parts.a)
            x, y = resolvent @ parts.b, parts.c @ resolvent
            return np.stack([(y.conj().T @ y).real, (x @ x.conj().T).real])

        # Twice the upper half, over 2 pi; the measure of the circle is the angle.
        exact = integral(both, gauss(edges)) / np.pi * (0.2 if discrete else 1.0)
        for got, expected in zip((seen, reached), exact, strict=True):
            np.testing.assert_allclose(got, expected, atol=1e-11 * np.abs(expected).max())


@pytest.mark.parametrize("seeds", [1, slow(3)])
@pytest.mark.parametrize(("discrete", "horizon"), every_one([False, True], [0.2, 1.3, 6.0]))
def test_gramians_of_a_horizon_are_the_integrals_over_it(discrete, horizon, seeds):
    for seed in range(seeds):
        model = damped_model(seed, discrete=discrete)
        (seen, reached), parts = gramians(model, horizon=horizon)

        def both(over, parts=parts):
            x, y = over @ parts.b, parts.c @ over
            return np.stack([y.T @ y, x @ x.T])

        if discrete:
            exact = sum(both(np.linalg.matrix_power(parts.a, k)) for k in range(int(horizon / 0.2 + 1e-6)))
        else:
            exact = integral(lambda t, a=parts.a: both(sla.expm(a * t)), gauss(np.linspace(0, horizon, 20)))
        for got, expected in zip((seen, reached), exact, strict=True):
            np.testing.assert_allclose(got, expected, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("discrete", [pytest.param(False, marks=pytest.mark.slow), True])
def test_gramian_with_a_weight_is_the_integral_over_all_frequencies(discrete):
    for channels in (1, 3):
        model = damped_model(0, discrete=discrete)
        weight = damped_model(5, discrete=discrete)[: (1 if channels == 1 else 2), :1]
        if channels == 3:
            b = np.hstack([weight.B, 2 * weight.B, -weight.B])
            weight = control.StateSpace(weight.A, b, weight.C, np.ones((2, 3)), weight.dt)
        (seen, reached), parts = gramians(model, weight=weight)
        dt = 0.2 if discrete else 0

        def integrand(angle, parts=parts, weight=weight, dt=dt):
            s = np.exp(1j * angle) if dt else 1j * np.tan(angle / 2)
            measure = 1.0 if dt else abs(1 - s**2) / 2  # d omega / d angle
            y = parts.c @ np.linalg.inv(s * np.eye(7) - parts.a)
            w = response(weight.A, weight.B, weight.C, weight.D, np.array([s]))[0]
            y = w * y if w.shape == (1, 1) else w @ y
            return measure * (y.conj().T @ y).real

        exact = integral(integrand, gauss(np.linspace(0, np.pi, 150), 10)) / np.pi
        np.testing.assert_allclose(seen, exact, atol=1e-10 * np.abs(exact).max())
        solve = sla.solve_discrete_lyapunov if dt else (lambda a, q: sla.solve_continuous_lyapunov(a, -q))
        plain = solve(parts.a, parts.b @ parts.b.T)
        np.testing.assert_allclose(reached, plain, atol=1e-12 * np.abs(plain).max())


@pytest.mark.parametrize("seeds", [4, slow(10)])
@pytest.mark.parametrize(
    ("discrete", "limits"), every_one([False, True], [{"band_hz": (0, np.inf)}, {"horizon": 1e5}, {"weight": 1.0}])
)
def test_limits_that_hold_everything_give_the_plain_truncation(discrete, limits, seeds):
    for seed in range(seeds):
        model = random_model(np.random.default_rng(seed), discrete=discrete)
        if np.min(np.abs(np.log(np.abs(model.poles())) / 0.2 if discrete else model.poles().real)) * 1e5 < 40:
            continue
        if "weight" in limits:
            limits = {"weight": control.StateSpace([], [], [], [[1.0]], model.dt)}
        plain = balanced_truncation(model, order=model.nstates - 1)
        other = balanced_truncation(model, order=model.nstates - 1, **limits)
        np.testing.assert_allclose(other.hankel, plain.hankel, atol=1e-10 * plain.hankel[0])
        points = points_of(model)
        assert gap(plain.model, other.model, points) < 1e-8 * peak(model, points)
        assert other.status is ReductionStatus.UNBOUNDED
        assert np.all(np.isinf(other.bounds[:-1]))
        assert other.bounds.size == model.nstates + 1
        assert other.bounds[-1] == 0


@pytest.mark.parametrize("dt", [0, 0.01])
def test_a_band_keeps_the_mode_inside_and_lets_the_larger_go(dt):
    model = two_modes(dt)
    plain = balanced_truncation(model, order=2).model
    inside = balanced_truncation(model, order=2, band_hz=(0.8, 1.2))
    assert inside.status is ReductionStatus.UNBOUNDED
    hz = [np.abs(np.log(m.poles()) / dt if dt else m.poles()).max() / (2 * np.pi) for m in (plain, inside.model)]
    np.testing.assert_allclose(hz, [10, 1], rtol=0.05)


@pytest.mark.parametrize("dt", [0, 0.01])
def test_a_weight_keeps_the_mode_where_it_is_large(dt):
    model = two_modes(dt)
    weight, _ = mode(0.05, 2 * np.pi)  # 20 at 1 Hz, 0.01 at 10 Hz
    weight = control.sample_system(1e-3 + weight * weight, dt) if dt else 1e-3 + weight * weight
    reduction = balanced_truncation(model, order=2, weight=weight)
    poles = reduction.model.poles()
    np.testing.assert_allclose(np.abs(np.log(poles) / dt if dt else poles) / (2 * np.pi), 1, rtol=0.05)


@pytest.mark.parametrize("models", [2, pytest.param(15, marks=pytest.mark.slow)])
@pytest.mark.parametrize("discrete", [pytest.param(False, marks=pytest.mark.slow), True])
def test_weighted_truncation_is_stable_at_every_order(discrete, models):
    for seed in range(models):
        rng = np.random.default_rng(seed)
        model, weight = random_model(rng, discrete=discrete), random_model(rng, discrete=discrete)[0, 0]
        for order in range(model.nstates):
            reduction = balanced_truncation(model, order=order, weight=weight)
            assert reduction.status in (ReductionStatus.UNBOUNDED, ReductionStatus.FEWER)


@pytest.mark.parametrize("models", [6, pytest.param(20, marks=pytest.mark.slow)])
def test_unstable_outcome_of_a_band_is_said(models):
    # Both outcomes occur: nothing keeps a narrow band from giving an unstable model.
    told = set()
    for seed in range(models):
        model = random_model(np.random.default_rng(seed), discrete=False)
        for order in range(1, model.nstates):
            reduction = balanced_truncation(model, order=order, band_hz=(0.3, 0.4))
            unstable = np.any(reduction.model.poles().real >= 0)
            assert (reduction.status is ReductionStatus.UNSTABLE) == unstable
            told.add(unstable)
    assert told == {False, True}


@pytest.mark.parametrize("models", [2, pytest.param(10, marks=pytest.mark.slow)])
def test_static_gain_of_a_discrete_model_is_the_bilinear_image_of_the_continuous_one(models):
    # Liu and Anderson: states at rest are at rest in both, unlike states set to zero.
    for seed in range(models):
        model = random_model(np.random.default_rng(seed), discrete=False)
        sampled = control.sample_system(model, 0.3, method="bilinear")
        for order in range(model.nstates):
            here = balanced_truncation(model, order=order, match="static gain").model
            there = balanced_truncation(sampled, order=order, match="static gain").model
            points = points_of(sampled)
            image = response(here.A, here.B, here.C, here.D, 2 / 0.3 * (points - 1) / (points + 1))
            found = response(there.A, there.B, there.C, there.D, points)
            assert np.abs(image - found).max() < 1e-8 * peak(sampled, points)


@pytest.mark.parametrize(
    "options", [{"band_hz": (0.1, 0.4)}, {"horizon": 3.0}, {"weight": control.ss(-1.0, 1.0, 1.0, 0)}]
)
def test_rigid_body_and_static_gain_of_the_rest_are_kept_with_every_limit(options):
    rng = np.random.default_rng(1)
    stable = random_model(rng, discrete=False, states=6)[:2, :1]
    stable = control.StateSpace(stable.A, stable.B[:, :1], stable.C[:1], 0, 0)
    rigid = control.ss([[0.0, 1], [0, 0]], [[0], [1]], [[2.0, 0]], 0)
    reduction = balanced_truncation(stable + rigid, order=6, unstable="keep", match="static gain", **options)
    alone = balanced_truncation(stable, order=4, match="static gain", **options)
    s = 0.5 + 1j * np.geomspace(0.1, 10, 20)
    assert gap(alone.model + rigid, reduction.model, s) < 1e-6 * peak(stable + rigid, s)
    assert abs((alone.model.dcgain() - stable.dcgain()) / stable.dcgain()) < 1e-10
    assert np.isinf(reduction.bound)


def test_units_of_input_output_and_time_scale_the_limited_ones_too():
    weight = control.ss(-1.0, 1.0, 1.0, 0.1)
    for options in ({"band_hz": (0.1, 0.4)}, {"horizon": 3.0}, {"weight": weight}):
        model = random_model(np.random.default_rng(3), discrete=False)
        plain = balanced_truncation(model, order=2, **options)
        scale = 2.0**40
        other = balanced_truncation(control.StateSpace(model.A, model.B * scale, model.C, 0, 0), order=2, **options)
        np.testing.assert_array_equal(other.hankel, plain.hankel * scale)
        np.testing.assert_array_equal(other.model.A, plain.model.A)


STABLE = control.ss([[-1.0]], [[1.0]], [[1.0]], 0)
SAMPLED = control.ss([[0.5]], [[1.0]], [[1.0]], 0, 0.1)


test_bad_input_is_named = refusals(
    ({"band_hz": (0, 1), "horizon": 1.0}, "one of `band_hz`, `horizon` and `weight`"),
    ({"band_hz": (0, 1), "order": None}, "`order` is needed with `band_hz`"),
    ({"horizon": 1.0, "order": None, "tol": 0.1}, "`order` is needed with `horizon`"),
    ({"band_hz": (1, 1)}, "low < high"),
    ({"band_hz": (-1, 1)}, "0 <= low"),
    ({"band_hz": 3.0}, "1 dimension"),
    ({"band_hz": (0, np.nan)}, "low < high"),
    ({"horizon": 0.0}, "positive"),
    ({"model": SAMPLED, "band_hz": (1, 6)}, "Nyquist frequency, 5 Hz"),
    ({"model": SAMPLED, "horizon": 0.05}, "hold a sample"),
    ({"model": control.ss([[0.5]], [[1.0]], [[1.0]], 0, True), "horizon": 1.0}, "sample time"),
    ({"weight": 2.0}, "`weight` must be a control.StateSpace", InputTypeError),
    ({"weight": control.ss(1.0, 1, 1, 0)}, "`weight` must be stable"),
    ({"weight": SAMPLED}, "time base"),
    ({"weight": control.ss(-1.0, [[1.0, 1.0]], 1, 0)}, "must be SISO"),
    ({"match": "gain"}, '`match` must be None or "static gain"'),
    of=lambda **options: balanced_truncation(**{"model": STABLE, "order": 0, **options}),
)


@pytest.mark.parametrize(
    "options", [{"band_hz": (0.1, 1)}, {"horizon": 1.0}, {"weight": STABLE}, {"match": "static gain"}]
)
def test_static_silent_and_wholly_unstable_models(options):
    static = control.StateSpace([], [], [], [[2.0]])
    assert balanced_truncation(static, order=0, **options).bound == 0
    silent = control.StateSpace([[-1.0]], [[0.0]], [[1.0]], 1.0, 0)
    np.testing.assert_array_equal(balanced_truncation(silent, order=0, **options).model.D, [[1.0]])
    rigid = control.ss([[0.0, 1], [0, 0]], [[0], [1]], [[1, 0]], 0)
    assert balanced_truncation(rigid, order=2, unstable="keep", **options).model is rigid
