"""Balanced truncation: closed forms, the bound at every order, unstable parts, units, refusals."""

import control
import numpy as np
import pytest
import scipy.linalg as sla

from robustid.errors import InputTypeError
from robustid.reduction import ReductionStatus, balanced_truncation, hankel_singular_values
from support.cases import slow
from support.pairwise import every_one
from support.reduction_models import SMALL_MODELS, gap, mode, peak, points_of, random_model, response
from support.refusals import refusals


@pytest.mark.parametrize(("zeta", "omega"), every_one([0.5, 0.02, 1e-3, 1e-5], [1.0, 111.0, 1e4]))
def test_single_mode_has_its_closed_form(zeta, omega):
    model, exact = mode(zeta, omega)
    np.testing.assert_allclose(hankel_singular_values(model), exact, rtol=1e-14 / zeta)


@pytest.mark.parametrize(("zeta", "rtol"), [(0.5, 1e-12), (1e-3, 1e-10), (1e-5, 1e-8)])
def test_bilinear_transformation_keeps_the_hankel_values(zeta, rtol):
    # At zeta = 1e-5 the poles are 1e-6 from the circle.
    model, exact = mode(zeta, 50.0)
    sampled = control.sample_system(model, 0.002, method="bilinear")
    assert np.min(1 - np.abs(sampled.poles())) < 0.12 * zeta
    np.testing.assert_allclose(hankel_singular_values(sampled), exact, rtol=rtol)


@pytest.mark.parametrize(("rotate", "length"), every_one([False, True], [1, 7, 60]))
def test_finite_impulse_response_has_the_values_of_its_hankel_matrix(length, rotate):
    rng = np.random.default_rng(length)
    taps = rng.standard_normal(length)
    q = np.linalg.qr(rng.standard_normal((length, length)))[0] if rotate else np.eye(length)
    model = control.StateSpace(q @ np.eye(length, k=-1) @ q.T, q[:, :1], taps[None] @ q.T, 0, 1.0)
    exact = sla.svdvals(sla.hankel(taps))
    np.testing.assert_allclose(hankel_singular_values(model), exact, atol=1e-12 * exact[0])


def test_distinct_values_count_once():
    # A delay of five samples: every Hankel value is 1, and no model of lower order comes nearer than 2 * 1.
    model = control.StateSpace(np.eye(5, k=-1), np.eye(5)[:, :1], np.eye(5)[-1:], 0, 1.0)
    reduction = balanced_truncation(model, order=2)
    np.testing.assert_allclose(reduction.hankel, 1.0, rtol=1e-14)
    np.testing.assert_allclose(reduction.bounds, [2, 2, 2, 2, 2, 0], rtol=1e-14)


@pytest.mark.parametrize("models", [4, pytest.param(150, marks=pytest.mark.slow)])
@pytest.mark.parametrize(("discrete", "match"), every_one([False, True], [None, "static gain"]))
def test_bound_holds_at_every_order_of_random_models(match, discrete, models):
    # 150 models each in continuous and discrete time: 1189 truncations each, all stable and within.
    checked = 0
    for seed in range(models):
        model = random_model(np.random.default_rng(seed), discrete=discrete)
        points, zero = points_of(model), np.array([1.0 if discrete else 0.0])
        floor = 1e-10 * peak(model, points)
        for order in range(model.nstates + 1):
            reduction = balanced_truncation(model, order=order, match=match)
            assert reduction.model.nstates == reduction.order == order
            assert reduction.model.dt == model.dt
            if match:
                assert gap(model, reduction.model, zero) <= floor
            else:
                assert np.array_equal(reduction.model.D, model.D)
            poles = reduction.model.poles()
            assert np.all(np.abs(poles) < 1) if discrete else np.all(poles.real < 0)
            assert gap(model, reduction.model, points) <= reduction.bound * (1 + 1e-9) + floor
            assert reduction.bound == reduction.bounds[order]
            checked += 1
        assert reduction.model is model  # at the full order
        assert reduction.status is ReductionStatus.UNREDUCED
        assert reduction.bounds.shape == (model.nstates + 1,)
        assert np.all(np.diff(reduction.bounds) <= 0)
        assert np.all(reduction.bounds[:-1] > 0)
        assert reduction.bounds[-1] == 0
    assert checked > 6 * models


@pytest.mark.parametrize("seeds", [10, slow(40)])
@pytest.mark.parametrize("discrete", [False, True])
def test_minimal_part_comes_out_balanced(discrete, seeds):
    for seed in range(seeds):
        model = random_model(np.random.default_rng(seed), discrete=discrete)
        n = model.nstates
        A, B = sla.block_diag(model.A, 0.3 if discrete else -1.0), np.vstack([model.B, np.zeros((1, model.ninputs))])
        idle = control.StateSpace(A, B, np.hstack([model.C, np.ones((model.noutputs, 1))]), model.D, model.dt)
        reduction = balanced_truncation(idle, order=n)
        a, b, c = reduction.model.A, reduction.model.B, reduction.model.C
        solve = sla.solve_discrete_lyapunov if discrete else (lambda a, q: sla.solve_continuous_lyapunov(a, -q))
        for gramian in (solve(a, b @ b.T), solve(a.T, c.T @ c)):
            np.testing.assert_allclose(gramian, np.diag(reduction.hankel[:n]), atol=1e-9 * reduction.hankel[0])


@pytest.mark.parametrize("modes", [80, pytest.param(200, marks=pytest.mark.slow)])
def test_many_states_close_to_the_circle(modes):
    # Up to 400 states, of damping 0.001: the gramians' conditions are beyond 1/eps.
    rng = np.random.default_rng(1)
    angle = np.linspace(0.05, 3.0, modes)
    turns = (np.array([[np.cos(w), np.sin(w)], [-np.sin(w), np.cos(w)]]) for w in angle)
    a = sla.block_diag(*(np.exp(-1e-3 * w) * turn for w, turn in zip(angle, turns, strict=True)))
    size = np.repeat(10.0 ** np.linspace(0, -9, modes), 2)
    b, c = size[:, None] * rng.standard_normal((2 * modes, 2)), size * rng.standard_normal((2, 2 * modes))
    model = control.StateSpace(a, b, c, 0, 1.0)
    reduction = balanced_truncation(model, tol=1e-6)
    points = points_of(model)[::10]
    assert reduction.status is ReductionStatus.REDUCED
    assert reduction.order < modes
    assert np.max(np.abs(reduction.model.poles())) < 1
    assert gap(model, reduction.model, points) <= reduction.bound <= 1e-6 * reduction.hankel[0]


MODE, _ = mode(0.1, 3.0)


@pytest.mark.parametrize(("model", "tol"), [(MODE, 0.0), (MODE, 1e-18), (MODE, 1e-9), (MODE + MODE, 0.0)])
def test_unreachable_tolerance_keeps_the_full_order_and_says_so(model, tol):
    # The trap: other implementations silently fall to order 1 here. Of two equal modes half of the states are idle.
    reduction = balanced_truncation(model, tol=tol)
    assert reduction.order == model.nstates
    assert reduction.bound == 0
    assert reduction.status is ReductionStatus.UNREDUCED


@pytest.mark.parametrize("seeds", [12, slow(50)])
def test_tolerance_takes_the_smallest_order_that_meets_it(seeds):
    for seed in range(seeds):
        model = random_model(np.random.default_rng(seed), discrete=bool(seed % 2))
        reduction = balanced_truncation(model, tol=0.3)
        assert reduction.bound <= 0.3 * reduction.hankel[0]
        assert reduction.order == 0 or reduction.bounds[reduction.order - 1] > 0.3 * reduction.hankel[0]


@pytest.mark.parametrize("seeds", [12, slow(50)])
def test_states_that_do_nothing_go_by_default(seeds):
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        model = random_model(rng, discrete=bool(seed % 2))
        doubled = model + 0.5 * model  # twice the states, the same poles
        reduction = balanced_truncation(doubled)
        assert reduction.order <= model.nstates
        points = points_of(model)
        assert gap(doubled, reduction.model, points) < 3e-8 * peak(doubled, points)


def test_order_above_the_rank_is_not_filled_with_noise():
    reduction = balanced_truncation(MODE + MODE, order=3)
    assert reduction.order == 2
    assert reduction.status is ReductionStatus.FEWER


@pytest.mark.parametrize("seeds", [10, slow(40)])
@pytest.mark.parametrize("discrete", [pytest.param(False, marks=pytest.mark.slow), True])
def test_unstable_part_is_kept_exactly(discrete, seeds):
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        stable = random_model(rng, discrete=discrete)
        free = np.array([[0.0, 1.0, 0], [0, 0, 0], [0, 0, 0.3]])  # a rigid body and a growing mode
        a, b = sla.expm(0.2 * free) if discrete else free, rng.standard_normal((3, stable.ninputs))
        unstable = control.StateSpace(a, b, rng.standard_normal((stable.noutputs, 3)), 0 * stable.D, stable.dt)
        whole = stable + unstable
        q = np.linalg.qr(rng.standard_normal((whole.nstates, whole.nstates)))[0]
        model = control.StateSpace(q @ whole.A @ q.T, q @ whole.B, whole.C @ q.T, whole.D, whole.dt)
        alone = balanced_truncation(stable, order=stable.nstates - 1)
        reduction = balanced_truncation(model, order=model.nstates - 1, unstable="keep")
        np.testing.assert_allclose(reduction.hankel, alone.hankel, atol=1e-7 * alone.hankel[0])
        assert np.all(np.isinf(reduction.bounds[:3]))
        np.testing.assert_allclose(reduction.bounds[3:], alone.bounds, atol=1e-6 * alone.hankel[0])
        arc = np.exp(1j * np.linspace(0.3, 3, 20))
        points = 1.3 * arc if discrete else 0.5 + 1j * np.geomspace(0.1, 10, 20)
        assert gap(alone.model + unstable, reduction.model, points) <= 1e-7 * peak(whole, points)


def test_lightly_damped_is_not_taken_for_unstable():
    angle = 0.3
    for distance in (1e-5, 1e-8, 1e-10):
        a = (1 - distance) * np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        model = control.StateSpace(a, [[1.0], [0.0]], [[1.0, 0.5]], 0, 1e-3)
        assert balanced_truncation(model, order=1).hankel[0] > 0.1 / distance


@pytest.mark.parametrize("seeds", [5, slow(20)])
def test_units_of_the_channels_scale_everything_exactly(seeds):
    for seed in range(seeds):
        model = random_model(np.random.default_rng(seed), discrete=bool(seed % 2))
        order = model.nstates // 2
        plain = balanced_truncation(model, order=order)
        for power in (-60, 60):
            scale = 2.0**power
            scaled = control.StateSpace(model.A, model.B * scale, model.C, model.D * scale, model.dt)
            other = balanced_truncation(scaled, order=order)
            np.testing.assert_array_equal(other.hankel, plain.hankel * scale)
            np.testing.assert_array_equal(other.bounds, plain.bounds * scale)
            np.testing.assert_array_equal(other.model.A, plain.model.A)
            np.testing.assert_array_equal(other.model.B * np.exp2(-power / 2), plain.model.B)
            assert balanced_truncation(scaled, tol=0.1).order == balanced_truncation(model, tol=0.1).order


@pytest.mark.parametrize("seeds", [5, slow(20)])
def test_unit_of_time_changes_nothing(seeds):
    for seed in range(seeds):
        model = random_model(np.random.default_rng(seed), discrete=False)
        plain = balanced_truncation(model, tol=0.1)
        for power in (-60, 60):
            scaled = control.StateSpace(model.A * 2.0**power, model.B * 2.0**power, model.C, model.D, 0)
            other = balanced_truncation(scaled, tol=0.1)
            assert other.order == plain.order
            np.testing.assert_allclose(other.hankel, plain.hankel, rtol=1e-9)


@pytest.mark.parametrize("seeds", [5, slow(20)])
def test_units_of_the_states_change_nothing(seeds):
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        model = random_model(rng, discrete=bool(seed % 2))
        scale = 2.0 ** rng.integers(-60, 60, model.nstates)
        a, b, c = model.A * scale[:, None] / scale, model.B * scale[:, None], model.C / scale
        scaled = control.StateSpace(a, b, c, model.D, model.dt)
        plain = hankel_singular_values(model)
        np.testing.assert_allclose(hankel_singular_values(scaled), plain, atol=1e-9 * plain[0])


def test_names_of_the_channels_survive():
    model = control.ss([[-1.0]], [[1.0]], [[1.0]], 0, inputs=["current"], outputs=["torsion"])
    reduced = balanced_truncation(model, order=0).model
    assert (reduced.input_labels, reduced.output_labels) == (["current"], ["torsion"])


def test_static_and_silent_models():
    static = control.StateSpace([], [], [], [[2.0]])
    assert balanced_truncation(static).bounds.tolist() == [0.0]
    silent = control.StateSpace([[0.5]], [[0.0]], [[1.0]], 1.0, 1.0)
    assert balanced_truncation(silent).order == 0


STABLE = control.ss([[-1.0]], [[1.0]], [[1.0]], 0)
INTEGRATOR = control.ss([[0.0]], [[1]], [[1]], 0)


test_bad_input_is_named = refusals(
    (lambda: balanced_truncation([[1.0]]), "`model` must be a control.StateSpace or TransferFunction", InputTypeError),
    (lambda: balanced_truncation(control.ss([[np.nan]], [[1]], [[1]], 0)), "matrix A"),
    (lambda: balanced_truncation(control.StateSpace([[0.5]], [[1]], [[1]], 0, None)), "dt = None"),
    (lambda: balanced_truncation(STABLE, order=2), "at most the order of the model, 1"),
    (lambda: balanced_truncation(STABLE, order=-1), "at least 0"),
    (lambda: balanced_truncation(STABLE, order=0.5), "integer", InputTypeError),
    (lambda: balanced_truncation(STABLE, order=1, tol=0.1), "not both"),
    (lambda: balanced_truncation(STABLE, tol=-1.0), "`tol` must be >= 0"),
    (lambda: balanced_truncation(STABLE, tol=np.nan), "finite"),
    (lambda: balanced_truncation(STABLE, unstable="drop"), '"refuse" or "keep"'),
    (lambda: balanced_truncation(control.ss([[0.2]], [[1]], [[1]], 0)), r"real part \+0\.2 1/s"),
    (lambda: balanced_truncation(INTEGRATOR), 'unstable="keep"'),
    (lambda: balanced_truncation(control.ss([[1.0]], [[1]], [[1]], 0, 0.1)), r"\|z\| = 1"),
    (lambda: balanced_truncation(control.ss([[0, -2], [2, 0]], [[1], [1]], [[1, 1]], 0, 0.01)), "25 Hz"),
    (lambda: balanced_truncation(control.ss([[-1.5]], [[1]], [[1]], 0, True)), "z = -1.5"),
    (lambda: balanced_truncation(INTEGRATOR, order=0, unstable="keep"), "unstable states to keep"),
)


@pytest.mark.realdata
@SMALL_MODELS
@pytest.mark.parametrize("count", [3, pytest.param(1000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("discrete", [pytest.param(False, marks=pytest.mark.slow), True])
def test_bound_holds_at_every_order_of_the_benchmark_models(benchmark_model, discrete, count):
    """At so many orders, the smallest and the largest among them; 1000 are all."""
    model = benchmark_model
    if discrete:
        model = control.sample_system(model, 0.5 / np.median(np.abs(model.poles())))
    points = points_of(model, 20)
    points = points[:: max(1, points.size // (10 if count == 5 else 40))]
    values = response(model.A, model.B, model.C, model.D, points)
    largest = np.max(np.linalg.norm(values, 2, axis=(1, 2)))
    full = balanced_truncation(model, order=model.nstates - 1)
    a, b, c, d = full.model.A, full.model.B, full.model.C, full.model.D
    assert full.bounds.shape == (model.nstates + 1,)
    for r in np.unique(np.linspace(0, full.order, count).astype(int)):  # the truncations are nested
        left = values - response(a[:r, :r], b[:r], c[:, :r], d, points)
        assert np.max(np.linalg.norm(left, 2, axis=(1, 2))) <= full.bounds[r] + 1e-9 * largest
        poles = np.linalg.eigvals(a[:r, :r])
        assert np.all(np.abs(poles) < 1 if discrete else poles.real < 0)
    for r in (full.order // 3, full.order // 2)[: 1 if count == 5 else 2]:
        truncated = balanced_truncation(model, order=r).model
        np.testing.assert_allclose(truncated.A, a[:r, :r], atol=1e-12 * np.max(np.abs(a)))
