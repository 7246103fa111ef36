"""Intervals of the parametric coefficients: against closed forms, an independent solver, and the laws of a hard constraint."""

import dataclasses

import control
import numpy as np
import pytest
from scipy.signal import lfilter

import robustid as rid
from problems import judge_margin, random_problem, small_part
from robustid.advice import diagnose
from robustid.identification.forms import pose
from robustid.interpolation import certify_margin, evaluate_certificate
from robustid.report.facts import assumptions
from robustid.solve import analytic_center, gain_path, margin_path, solve_conic, support_path

FREE = (-np.inf, np.inf)
KINDS = ("outside", "one side", "fixed", "narrow", "wide", "far")


def intervals(kind, p, rng):
    """Intervals of two coefficients about a point of the consistent set, most of which cut it off."""
    a, b = p + rng.uniform(0.1, 0.6, 2) * rng.choice([-1, 1], 2)
    return {
        "outside": [(a - 0.05, a + 0.05), (b - 0.02, b + 0.08)],
        "one side": [(a, a + 3), FREE],
        "fixed": [(a, a), FREE],
        "narrow": [FREE, (b, b * (1 + 1e-9) if b > 0 else b * (1 - 1e-9))],
        "wide": [(a - 1e6, a + 1e6), (b - 2, b + 2)],
        "far": [(a + 20, a + 21), (b, b)],
    }[kind]


def tight(seed):
    """Bounds and a class that leave the coefficients little room, with few Taylor coefficients."""
    return random_problem(seed, "parametric", 10, spread=0.3, noise=2.0).with_prior(gain_bound=0.5, decay_rate=1.25)


def bounded(problem, kind, seed):
    p = rid.identify(problem).parameters
    return dataclasses.replace(problem, parameter_bounds=intervals(kind, p, np.random.default_rng(seed)))


def inside(result):
    low, high = result.problem.parameter_bounds.T
    return bool(np.all((low <= result.parameters) & (result.parameters <= high)))


# --- known answers ----------------------------------------------------------------------------------------------------


def one_constant(value, low, high, dt=0.01):
    """y = p + G at omega = 0, |G| <= 1: the margin is the distance of y from [low - 1, high + 1] over the bound."""
    frf = rid.FrequencyResponse([0.0, 50.0], [value, value], bound=0.1, dt=dt)
    prior = rid.Prior(gain_bound=1.0, decay_rate=1.2)
    one = control.ss([], [], [], 1.0, dt)
    return rid.MixedProblem(frequency=frf, prior=prior, parametric=one, parameter_bounds=[(low, high)])


@pytest.mark.parametrize(
    "options", [{"solver": "cvxpy"}, {"solver": "structured"}, {"form": "taylor"}, {"form": "sections"}]
)
@pytest.mark.parametrize(("low", "high"), [(0.0, 1.0), (1.0, 1.0), (-5.0, 1.0), (-1e7, 1.0), (1 - 1e-7, 1.0)])
def test_a_constant_out_of_reach(options, low, high):
    result = rid.identify(one_constant(3.0, low, high), **options)
    assert result.status is rid.Status.INCONSISTENT
    assert result.verification.passed, result.summary()
    assert result.margin_lower <= 10 + 1e-9
    assert result.margin == pytest.approx(10, abs=1e-3)
    assert result.margin >= 10 - 1e-9
    assert result.margin - result.margin_lower <= 1e-3
    assert result.parameters == pytest.approx([1.0], abs=2e-6)
    assert inside(result)
    ends = [end for _, end in result.active_intervals]
    assert (1.0 in ends) == (low < high) or 0 < high - low < 1e-6  # narrower than what the samples tell apart
    below = rid.identify(one_constant(-4.0, -1.0, 2.0), **options)  # -4 is 2 below [-2, 3]
    assert below.margin == pytest.approx(20, abs=2e-3)
    assert below.active_intervals[0][1] == -1.0
    assert rid.identify(one_constant(2.5, 0.0, 2.0), **options).consistent
    assert rid.identify(one_constant(2.5, 0.0, 2.0), **options).active_intervals == ()


def test_the_extremes_of_a_coefficient_are_the_ends_of_its_interval():
    """Where the samples say little, max and min of a coefficient over the set are the ends that were stated."""
    for kind in ("outside", "one side", "fixed", "wide"):
        problem = random_problem(1, "parametric", 10, spread=0.3)
        bounds = np.array(intervals(kind, np.array([0.3, -0.4]), np.random.default_rng(0)))
        loose = [rid.FrequencyResponse(f.omega, f.values, bound=1e9, dt=f.dt) for f in problem.frequency]
        problem = rid.MixedProblem(
            frequency=loose, prior=problem.prior, parametric=problem.parametric, parameter_bounds=bounds
        )
        data = pose(problem).data
        center = analytic_center(data, 1.0)
        for i, k in np.argwhere(np.isfinite(bounds)):
            sign = 2 * k - 1
            along = sign * np.eye(2)[i] / data.rows.column_scale  # of the coefficient in its own unit
            values = [
                value for _, value, _ in support_path(data, center, 1.0, (np.zeros(data.sarason.pair.order), along))
            ]
            found = values[-1] if values else float(along @ center.p)
            assert sign * found == pytest.approx(bounds[i, k], rel=1e-7, abs=1e-7)


# --- an independent solver --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_margin_against_the_paper_s_theorem(kind):
    """Clarabel on the printed inequality with the intervals written out; Taylor forms enclose the same number."""
    active = positive = 0
    for seed in range(20):
        problem = bounded(tight(seed), kind, seed)
        judge = judge_margin(problem)
        result = rid.identify(problem, solver="structured")
        size = max(1.0, judge)
        assert result.margin == pytest.approx(judge, abs=2e-6 * size)
        assert result.margin_lower <= judge + 1e-6 * size
        assert result.margin - result.margin_lower <= 2e-5 * size
        assert result.verification.passed, result.summary()
        assert inside(result)
        active += bool(result.active_intervals)
        positive += judge > 1e-3
        if seed % 4 == 0:
            conic = rid.identify(problem, solver="cvxpy")
            assert conic.margin == pytest.approx(judge, abs=1e-5 * size)
            assert conic.margin_lower == pytest.approx(judge, abs=1e-5 * size)
            taylor = rid.identify(problem, form="taylor")
            assert taylor.verification.passed
            assert taylor.margin_lower - 1e-6 * size <= judge <= taylor.margin + 1e-6 * size
            assert taylor.margin - taylor.margin_lower <= 1e-4 * size
    assert positive >= 15
    assert active >= {"outside": 15, "one side": 5, "far": 5}.get(kind, 0)


@pytest.mark.parametrize("kind", KINDS)
def test_gain_and_centre_with_intervals(kind):
    """The smallest gain against Clarabel; every point on the way keeps to the intervals; the centre is stationary."""
    for seed in range(4):
        problem = bounded(tight(seed), kind, seed)
        data = pose(problem).data
        *_, (best, _, _) = margin_path(data)
        level = 1.1 * data.margin(best.x, best.p) + 0.1
        center = analytic_center(data, level)
        walk = list(gain_path(data, center, level))
        assert all(data.rows.within(point.p) for point, _, _ in walk)
        conic = solve_conic(data, "gain", solver="cvxpy", factor=level)
        assert walk[-1][1] == pytest.approx(data.sarason.norm(conic.x), abs=2e-6)
        value = barrier(data, level, center.x, center.p)
        rng = np.random.default_rng(seed)
        for _ in range(5):  # the centre maximises the barrier: it falls in every direction
            step = 1e-3 * rng.standard_normal(center.x.size)
            low, high = data.rows.ends.T
            room = np.minimum(np.minimum(center.p - low, high - center.p), 1.0)
            step_p = 1e-3 * room * rng.standard_normal(center.p.size)
            assert barrier(data, level, center.x + step, center.p + step_p) <= value


def barrier(data, level, x, p):
    """log det(I - X'X) + sum log(level^2 - |e|^2) + sum log(1 - ((p - middle)/half)^2)."""
    low, high = data.rows.ends.T
    held = np.isfinite(low) & (low < high)
    out = 2 * (p - low)[held] / (high - low)[held] - 1
    e, X = data.rows.ratio(x, p), np.tensordot(x, data.sarason.basis, 1)
    if e.max() >= level or np.linalg.norm(X, 2) >= 1 or np.abs(out).max(initial=0) >= 1:
        return -np.inf
    total = np.linalg.slogdet(np.eye(x.size) - X.T @ X)[1] + np.log(level**2 - e**2).sum()
    return total + np.log(1 - out**2).sum()


# --- certificates -----------------------------------------------------------------------------------------------------


def test_a_certificate_belongs_to_its_intervals():
    """Evaluated under wider intervals it proves no more than holds there; under its own, what it says."""
    for seed in range(10):
        problem = bounded(tight(seed), "outside", seed)
        result = rid.identify(problem, solver="structured")
        proof, own = result.certificate, pose(problem).data
        assert proof.verify(own.rows, own.sarason)
        assert proof.shares(own.rows).sum() == pytest.approx(1)
        middle, half = problem.parameter_bounds.mean(axis=1), np.diff(problem.parameter_bounds)[:, 0] / 2
        for factor in (1.5, 4.0, 1e3):
            wider = dataclasses.replace(
                problem, parameter_bounds=np.stack([middle - factor * half, middle + factor * half], 1)
            )
            data = pose(wider).data
            value = evaluate_certificate(proof.samples, proof.ball, proof.upper, data.rows, data.sarason)
            slope = np.real(own.rows.P.conj().T @ proof.samples) * own.rows.column_scale
            assert value == pytest.approx(proof.value - (factor - 1) * np.abs(slope) @ half, abs=1e-9 * factor)
            assert value <= judge_margin(wider) + 1e-6
        assert not proof.verify(data.rows, data.sarason) or result.margin_lower < 1e-6


def test_certificates_from_arbitrary_multipliers_hold_for_members():
    """Random multipliers, good or bad: no member with coefficients in their intervals is below the value."""
    proved = 0
    for seed in range(30):
        rng = np.random.default_rng(seed)
        problem = random_problem(seed, "parametric", 8, spread=0.05)
        bounds = [(20.0, 21.0), FREE if seed % 2 else (-1.0, 1.0)]
        data = pose(dataclasses.replace(problem, parameter_bounds=bounds)).data
        rows, n = data.rows, data.sarason.pair.order
        *_, (found, _, _) = margin_path(data)
        scatter = 1e-3 * (rng.standard_normal(rows.y.size) + 1j * rng.standard_normal(rows.y.size))
        scatter[rows.discs :] = scatter[rows.discs :].real
        weights = found.samples + np.abs(found.samples).max() * scatter
        proof = certify_margin(weights, found.ball, data.margin(found.x, found.p), rows, data.sarason)
        proved += proof.value > 1
        low, high = rows.ends.T
        free = ~rows.held
        for _ in range(50):
            x = rng.standard_normal(n)
            x *= rng.uniform() / data.sarason.norm(x)
            p = rng.uniform(np.where(free, 0, low), np.where(free, 0, high))
            rest = rows.real(rows.y - rows.E @ x - rows.P @ p)
            p[free] = np.linalg.lstsq(rows.real(rows.P[:, free]), rest, rcond=None)[0]
            assert data.margin(x, p) >= proof.value
    assert proved >= 20


# --- laws -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("power", [-60, 60])
@pytest.mark.parametrize("form", ["orthonormal", "taylor", "sections"])
def test_units_do_not_matter(power, form):
    for kind in KINDS:
        problem = bounded(tight(3), kind, 3)
        unit = 2.0**power
        scaled = rid.MixedProblem(
            frequency=[rid.FrequencyResponse(f.omega, unit * f.values, bound=unit * f.bound, dt=f.dt) for f in problem.frequency],
            time=[rid.TimeRecord(t.u, unit * t.y, bound=unit * t.bound, dt=t.dt) for t in problem.time],
            prior=rid.Prior(gain_bound=unit * problem.prior.gain_bound, decay_rate=problem.prior.decay_rate),
            parametric=problem.parametric,
            parameter_bounds=unit * problem.parameter_bounds,
        )  # fmt: skip
        first, second = (rid.identify(p, solver="structured", form=form) for p in (problem, scaled))
        assert second.margin == first.margin
        assert second.margin_lower == first.margin_lower
        assert np.array_equal(second.parameters, unit * first.parameters)


def truthful(seed):
    """Data of a member within the bounds, and the coefficients of that member."""
    rng = np.random.default_rng(seed)
    dt, rho = 0.01, 1.2
    basis = rid.kautz(2 * np.pi * rng.uniform(5, 30), 0.02, dt=dt, delay=1)
    numerator, denominator = small_part(rng, 1.0, rho)
    p = 3 * rng.standard_normal(2)
    angle = np.sort(rng.uniform(0.05, 3.0, 4))
    z = np.exp(-1j * angle)
    values = basis.response(angle) @ p + np.polyval(numerator[::-1], z) / np.polyval(denominator[::-1], z)
    error = 0.99 * np.exp(2j * np.pi * rng.uniform(size=4))
    frf = rid.FrequencyResponse(angle / dt, values + 0.02 * error, bound=0.02, dt=dt)
    impulse = basis.impulse(6) @ p + lfilter(numerator, denominator, np.eye(1, 6)[0])
    u = rng.standard_normal(6)
    y = np.convolve(u, impulse)[:6]
    record = rid.TimeRecord(u, y + 0.05 * rng.choice([-0.99, 0.99], 6), bound=0.05, dt=dt)
    prior = rid.Prior(gain_bound=1.0, decay_rate=rho)
    return rid.MixedProblem(frequency=frf, time=record, prior=prior, parametric=basis), p


@pytest.mark.parametrize("form", ["orthonormal", "taylor", "sections"])
def test_intervals_around_the_truth_never_refute(form):
    for seed in range(6):
        problem, p = truthful(seed)
        free = rid.identify(problem, form=form)
        before = free.margin
        for half in (3.0, 0.3, 1e-3, 1e-9, 0.0):  # nested: the margin only rises
            bounds = np.stack([p - half, p + half], 1) + half * np.random.default_rng(seed).uniform(-1, 1, (2, 1)) * (
                half == 3
            )
            result = rid.identify(dataclasses.replace(problem, parameter_bounds=bounds), form=form)
            assert result.consistent
            assert result.verification.passed
            assert result.margin >= before - 1e-4
            assert inside(result)
            before = result.margin_lower if half < 3 else before


def test_a_fixed_coefficient_belongs_to_the_data():
    """The margin is that of the data minus the known function, with the other function alone."""
    for seed in range(6):
        problem = tight(seed)
        basis, value = problem.parametric, 1.7
        rest = dataclasses.replace(basis, C=basis.C[1:], D=basis.D[1:], labels=basis.labels[1:])
        (f,), (t,) = problem.frequency, problem.time
        lines = f.values[:, 0, 0] - value * basis.response(f.omega * f.dt)[:, 0]
        samples = t.y[:, 0] - value * np.convolve(t.u[:, 0], basis.impulse(t.y.size)[:, 0])[: t.y.size]
        frequency = rid.FrequencyResponse(f.omega, lines, bound=f.bound, dt=f.dt)
        time = rid.TimeRecord(t.u, samples, bound=t.bound, dt=t.dt)
        subtracted = rid.MixedProblem(frequency=frequency, time=time, prior=problem.prior, parametric=rest)
        fixed = dataclasses.replace(problem, parameter_bounds=[(value, value), FREE])
        first, second = rid.identify(fixed, solver="structured"), rid.identify(subtracted, solver="structured")
        assert first.margin == pytest.approx(second.margin, abs=1e-6 * max(1, second.margin))
        assert first.parameters[0] == value
        assert first.parameters[1] == pytest.approx(second.parameters[0], rel=1e-3, abs=1e-3)


def test_free_ends_change_nothing():
    problem = tight(5)
    same = dataclasses.replace(problem, parameter_bounds=[FREE, FREE])
    first, second = (rid.identify(p, solver="structured") for p in (problem, same))
    assert (first.margin, first.margin_lower) == (second.margin, second.margin_lower)
    assert np.array_equal(first.parameters, second.parameters)


@pytest.mark.parametrize("objective", ["center", "margin", "gain", "order"])
def test_every_objective_keeps_to_the_intervals(objective):
    for kind in ("outside", "one side", "fixed", "wide"):
        for noise in (0.5, 2.0):
            problem = bounded(random_problem(2, "parametric", 8, spread=0.4, noise=noise), kind, 2)
            result = rid.identify(problem, objective=objective)
            assert result.verification.passed, result.summary()
            assert inside(result)


def test_unknown_states_and_intervals_together():
    """Free transients stand beside the bounded coefficients."""
    problem, p = truthful(0)
    record = problem.time[0]
    free = rid.TimeRecord(record.u, record.y, bound=record.bound, dt=record.dt, initial="free")
    for bounds in (np.stack([p - 0.1, p + 0.1], 1), np.stack([p + 50, p + 51], 1), np.stack([p, p], 1)):
        changed = dataclasses.replace(problem, time=[free], parameter_bounds=bounds)
        result = rid.identify(changed)
        assert result.verification.passed, result.summary()
        assert inside(result)
        assert result.consistent == (bounds[0, 0] < p[0] + 1)


# --- what people see --------------------------------------------------------------------------------------------------


def test_storage_summary_and_advice(tmp_path):
    problem = bounded(random_problem(0, "parametric", 8, spread=0.3, noise=3.0), "outside", 1)
    result = rid.identify(problem)
    assert problem.samples == sum(r.axis.size for r in result.residuals)
    assert {end for _, end in result.active_intervals} <= set(problem.parameter_bounds.ravel())
    (name, end), *_ = result.active_intervals
    assert f"interval   the coefficient of {name} is at the end {end:.6g} of its interval" in result.summary()
    assert any(
        what == "Intervals" and name in words and "is at the end" in words for what, words in assumptions(result)
    )
    result.save(tmp_path / "result")
    again = rid.load_identification(tmp_path / "result")
    assert np.array_equal(again.problem.parameter_bounds, problem.parameter_bounds)
    assert again.verification.passed
    assert again.active_intervals == result.active_intervals
    trials = {trial.change: trial.margin for trial in diagnose(result).trials}
    assert trials["coefficients without intervals"] < 0.9 * result.margin
    assert "each pair repeated once more" in trials
    smaller = rid.suggest_prior(dataclasses.replace(problem, parameter_bounds=None), decay_rates=[1.2]).gains[0]
    assert rid.suggest_prior(problem, decay_rates=[1.2]).gains[0] >= smaller
    wrong = dataclasses.replace(problem, parameter_bounds=problem.parameter_bounds + 1e6)
    assert "an interval of its coefficients is wrong" in rid.suggest_prior(wrong, decay_rates=[1.2]).reason


def test_a_forged_point_outside_its_interval_fails():
    problem = bounded(random_problem(0, "parametric", 8, spread=0.3, noise=3.0), "outside", 1)
    data = pose(problem).data
    *_, (point, _, _) = margin_path(data)
    for shift in (1.5, -1.5):
        p = point.p + shift * np.eye(2)[0] * np.diff(data.rows.ends[0])
        assert data.margin(point.x, p) == np.inf
    assert data.margin(point.x, point.p) < np.inf


@pytest.mark.parametrize(
    ("bounds", "words"),
    [
        ([0.0, 1.0], "shape \\(m, 2\\) with m = 2"),
        ([[0.0, 1.0]], "got \\(1, 2\\)"),
        ([[0.0, np.nan], [0.0, 1.0]], "number 0 .* must not be NaN"),
        ([[0.0, 1.0], [2.0, 1.0]], "number 1 .* lower end above the upper one: 2 > 1"),
        ([[0.0, np.inf], [0.0, 1.0]], "number 0 .* one infinite end"),
        ([[0.0, 1.0], [-np.inf, 1.0]], "number 1 .* one infinite end"),
        ([[np.inf, np.inf], [0.0, 1.0]], "number 0 .* one infinite end"),
        ([["a", "b"], ["c", "d"]], "must be an array of numbers"),
        ([[0.0, 1j], [0.0, 1.0]], "must be real"),
    ],
)
def test_bad_intervals(bounds, words):
    problem = random_problem(0, "parametric", 8)
    with pytest.raises(rid.RobustIdError, match=words):
        dataclasses.replace(problem, parameter_bounds=bounds)


def test_intervals_need_functions():
    problem = random_problem(0, "mixed", 8)
    with pytest.raises(rid.InputError, match="`parametric`, which is missing"):
        dataclasses.replace(problem, parameter_bounds=[[0.0, 1.0]])


def test_intervals_take_the_place_of_samples_that_tell_coefficients_apart():
    """One line, four functions: refused with free coefficients, and a bounded set where all of them lie in intervals."""
    data = rid.flexible_structure(lines=1, samples=2)
    modes = rid.kautz(*data.modes.T, dt=0.01, delay=1)
    prior = rid.Prior(gain_bound=0.1, decay_rate=1.3)
    with pytest.raises(rid.errors.InputError, match="cannot tell its 4 functions"):
        rid.identify(rid.MixedProblem(frequency=data.frequency, prior=prior, parametric=modes))
    box = np.tile([-20.0, 20.0], (4, 1))
    held = rid.identify(rid.MixedProblem(frequency=data.frequency, prior=prior, parametric=modes, parameter_bounds=box))
    assert held.consistent
    error = rid.worst_case_error(held, omega=[30.0], directions=4)
    assert error.certified
    assert np.all(np.abs(held.parameters) <= 20)
    # One complex line tells two real functions apart, not three.
    free = np.where(np.arange(4)[:, None] < 3, FREE, box)
    partly = rid.MixedProblem(frequency=data.frequency, prior=prior, parametric=modes, parameter_bounds=free)
    with pytest.raises(rid.errors.InputError, match="cannot tell its 3 functions"):
        rid.identify(partly)
