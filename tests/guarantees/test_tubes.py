"""Prediction tubes: proved, attained, in closed form where there is one, and the truth inside."""

import concurrent.futures
import copy
import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.core import simulate
from robustid.guarantees import outputs, response_tube, tube_ends
from robustid.guarantees.outputs import tail_bounds
from robustid.identification import Functional
from robustid.identification.formulation import choice
from support.cases import slow
from support.problems import CASES, in_units, random_problem, truth_of

SLACK = 1e-9  # of rounding in the comparisons, relative to the outputs


def first_coefficient(g0, *, K=1.0, rho=1.5):
    """Identification of a class with g_0 known."""
    record = rid.TimeRecord([1.0], [g0], dt=0.1, bound=1e-7 * K)
    return rid.identify(rid.MixedProblem(time=record, prior=rid.Prior(gain_bound=K, decay_rate=rho)))


@pytest.fixture(scope="module")
def mixed():
    return rid.identify(random_problem(3, "mixed", 12))


HUNDRED = [slow(seed, case, "orthonormal") for case in CASES for seed in range(100, 125)]


@pytest.mark.parametrize(
    ("seed", "case", "form"), [*((3, case, "orthonormal") for case in CASES), (3, "frequency", "taylor"), *HUNDRED]
)
def test_truth_is_inside(seed, case, form):
    u = np.random.default_rng(seed).standard_normal(16)
    problem = random_problem(seed, case, 12)
    result = rid.identify(problem, form=form, accuracy=0.05 if form == "taylor" else 1e-4)  # loose: fewer coefficients
    tube = response_tube(result, input=u, times=problem.dt * np.array([0, 1, 7, 15]))
    truth = np.convolve(u, truth_of(seed, case)[0](16))[tube.samples]
    assert np.all((tube.lower <= truth) & (truth <= tube.upper))
    assert np.all(tube.lower <= tube.attained[:, 0])
    assert np.all(tube.attained[:, 1] <= tube.upper)
    assert np.all(tube.attained[:, 0] <= tube.attained[:, 1])
    assert np.all(tube.error_lower <= tube.error_upper)
    assert np.all(tube.upper - tube.attained[:, 1] <= 0.02 * (tube.upper - tube.lower) + SLACK)
    assert tube.verify()


@pytest.mark.parametrize(("K", "g0"), [(1.0, 0.0), (1.0, 0.6), (40.0, -30.0)])
def test_second_coefficient_in_closed_form(K, g0):
    # |g_1| <= K (1 - g_0^2/K^2)/rho, attained.
    rho = 1.5
    tube = response_tube(first_coefficient(g0, K=K, rho=rho), horizon=2, gap=1e-3)
    exact = K * (1 - (g0 / K) ** 2) / rho
    for end, attained in ((tube.upper[1], tube.attained[1, 1]), (-tube.lower[1], -tube.attained[1, 0])):
        assert attained <= exact + 2e-7 * K
        assert exact * (1 - 1e-6) <= end <= exact * (1 + 2e-3)
    step = response_tube(first_coefficient(g0, K=K, rho=rho), input="step", horizon=2, gap=1e-3)
    assert step.upper[1] == pytest.approx(g0 + exact, rel=2e-3, abs=1e-6 * K)
    assert step.peak == pytest.approx(abs(g0) + exact, rel=2e-3)


def test_programs_that_are_too_much_work_leave_the_others_to_sums(monkeypatch):
    # A bound of 1e-7 around g_0 = 0 leaves |g_1| <= K/rho, which sums of one sample prove too.
    result = first_coefficient(0.0)
    monkeypatch.setattr(tube_ends, "_SECONDS", 1e3)  # not one of them
    tube = response_tube(result, horizon=2, gap=1e-3)
    assert (tube.solved, tube.samples.tolist(), tube.verify()) == (0, [0, 1], True)
    assert tube.upper[1] == pytest.approx(1 / 1.5, rel=1e-3)
    other = random_problem(3, "mixed", 12)
    result, u = rid.identify(other), np.random.default_rng(3).standard_normal(16)
    each = tube_ends._seconds(outputs.consistent_outputs(result, u[:, None]))
    monkeypatch.setattr(tube_ends, "_AT_ONCE", 2.5 * each)  # one of them
    tube = response_tube(result, input=u)
    assert (tube.solved, tube.complete, tube.verify()) == (1, True, True)
    assert not dataclasses.replace(tube, upper=tube.upper - 1e-3 * np.ptp(tube.upper)).verify()
    truth = np.convolve(u, truth_of(3, "mixed")[0](16))[tube.samples]
    assert np.all((tube.lower <= truth) & (truth <= tube.upper))
    narrow = response_tube(result, input=u, times=other.dt * np.array([1, 7, 15]))
    assert np.all(tube.lower[narrow.samples] <= narrow.attained[:, 0])
    assert np.all(tube.upper[narrow.samples] >= narrow.attained[:, 1])
    assert np.isfinite(response_tube(result, horizon=16).error_l1)  # the parameters by sums
    assert "15 of the samples" in tube.summary()


def test_a_form_that_misses_part_of_the_functional_pays_its_norm(monkeypatch):
    # Basis {1}: the representative K zeta/rho of g_1 is all missed, so that |g_1| <= K/rho whatever g_0.
    result = first_coefficient(0.6)
    monkeypatch.setattr(outputs, "formulate_over", lambda *_: None)
    tube = response_tube(result, horizon=2)
    assert tube.upper[1] == pytest.approx(1 / 1.5, rel=1e-6)
    assert tube.upper[1] >= 1 / 1.5
    assert tube.verify()
    assert tube.error_lower[1] == 0  # the rest can be anything: nothing is known to be attained
    assert np.all(tube.error_lower <= tube.error_upper)


@pytest.mark.parametrize("case", ["mixed", slow("frequency")])
def test_forms_agree(case, monkeypatch):
    result = rid.identify(random_problem(5, case, 10))
    options = {"input": "step", "horizon": 12, "times": [0.02, 0.11], "gap": 1e-3}
    exact = response_tube(result, **options)
    assert exact._outputs.consistent.posed.exact
    monkeypatch.setattr(choice, "LARGEST_EXACT", 1)
    taylor = response_tube(result, **options)
    assert taylor._outputs.consistent.posed.count > 12
    width = exact.upper - exact.lower
    np.testing.assert_allclose(taylor.upper, exact.upper, atol=5e-3 * width.max())
    np.testing.assert_allclose(taylor.lower, exact.lower, atol=5e-3 * width.max())
    monkeypatch.setattr(choice, "LONGEST_TAYLOR", 1)
    tails = response_tube(result, **options)
    assert tails._outputs.consistent.posed.exact
    for tube in (taylor, tails):
        for one, other in ((tube, exact), (exact, tube)):  # each is proved: no attained value of the other is outside
            assert np.all(one.lower <= other.attained[:, 0] + SLACK)
            assert np.all(other.attained[:, 1] - SLACK <= one.upper)
        assert tube.verify()


@pytest.mark.parametrize("initial", ["free", "periodic"])
def test_records_that_do_not_start_at_rest(initial):
    # The truth is consistent with any such record whose bounds are wide enough; the tube is from rest all the same.
    problem = random_problem(3, "mixed", 12)
    record = dataclasses.replace(problem.time[0], initial=initial, bound=np.full((6, 1), 20.0))
    result = rid.identify(dataclasses.replace(problem, time=record))
    tube = response_tube(result, horizon=9, times=[0.0, 0.02, 0.08])
    truth = truth_of(3, "mixed")[0](9)[tube.samples]
    assert np.all((tube.lower <= truth) & (truth <= tube.upper))
    assert tube.verify()


def test_barely_consistent_data():
    problem = random_problem(3, "mixed", 12)
    margin = rid.identify(problem).margin
    result = rid.identify(in_units(problem, 1.0, margin * (1 + 2e-7)), accuracy=1e-8)
    assert 1 - 1e-6 < result.margin <= 1
    options = {"horizon": 8, "times": [0.0, 0.03]}
    tube, wide = response_tube(result, **options), response_tube(rid.identify(problem), **options)
    assert tube.verify()
    assert np.all(tube.upper - tube.lower < 1e-2 * (wide.upper - wide.lower))
    f = tube._outputs._impulses[0] @ tube._outputs.consistent.center.x
    assert np.all((tube.lower <= f[tube.samples]) & (f[tube.samples] <= tube.upper))


def test_more_data_never_widen_a_tube():
    problem = random_problem(7, "mixed", 16)
    frf, record = problem.frequency[0], problem.time[0]
    fewer = dataclasses.replace(
        problem,
        frequency=frf.select(slice(0, 2)),
        time=dataclasses.replace(record, u=record.u[:5], y=record.y[:5], bound=record.bound[:5]),
    )
    options = {"horizon": 10, "times": [0.0, 0.03, 0.09]}
    many, few = (response_tube(rid.identify(p), **options) for p in (problem, fewer))
    assert np.all(few.lower <= many.attained[:, 0] + SLACK)
    assert np.all(many.attained[:, 1] - SLACK <= few.upper)
    assert np.all(many.upper - many.lower <= (few.upper - few.lower) * 1.02)


def test_l1_and_peaks_cover_members():
    result = rid.identify(random_problem(2, "parametric", 16))
    tube = response_tube(result, horizon=10)
    assert tube.complete
    long = np.eye(4000, 1)
    nominal = simulate(result.model, long)[0][:, 0]
    errors = [simulate(result.solution(E), long)[0][:, 0] - nominal for E in (-1.0, -0.5, 0.8, 1.0)]
    errors.append(truth_of(2, "parametric")[0](4000) - nominal)
    for error in errors:
        assert np.abs(error).sum() <= tube.error_l1
        assert np.abs(error).max() <= tube.error_peak
        assert np.abs(error + nominal)[:10].max() <= tube.peak
    assert max(np.abs(e).sum() for e in errors) > 0.01 * tube.error_l1
    assert np.isfinite(tube.error_l1)


def test_l1_after_the_horizon():
    # g_0 = 0 and nothing else known, model 0: sum over k >= 1 of K rho^-k = K/(rho - 1).
    tube = response_tube(first_coefficient(0.0, K=3.0), horizon=1)
    assert tube.error_l1 == pytest.approx(6.0, rel=1e-5)
    assert tube.error_l1 >= 6.0
    assert tube.error_peak == pytest.approx(2.0, rel=1e-5)
    # A rest that is next to nothing: the error is (p - q)'P, with members at the ends of the intervals.
    problem = random_problem(2, "parametric", 16)
    basis, omega = problem.parametric, np.array([50.0, 100.0])
    values = basis.response(omega * basis.dt) @ [1.0, -2.0]
    frf = rid.FrequencyResponse(omega, values, bound=0.1, dt=basis.dt)
    prior = rid.Prior(gain_bound=1e-6, decay_rate=1.5)
    result = rid.identify(rid.MixedProblem(frequency=frf, parametric=basis, prior=prior))
    tube = response_tube(result, horizon=2)
    consistent, P = tube._outputs.consistent, basis.impulse(5000)
    n = consistent.data.sarason.pair.order
    worst = []
    for index in (0, 1):
        p = consistent.extreme(Functional(np.zeros(n), consistent.parameter_weights(index)), 1e-3).p
        worst.append(np.abs(P @ (p / consistent.data.rows.column_scale - result.parameters)).sum())
    bound = tube.parameters.upper - tube.parameters.lower
    assert 0.1 * tube.error_l1 < max(worst) <= tube.error_l1 <= np.abs(P).sum(axis=0) @ bound + 1e-4


@pytest.mark.parametrize("signal", [slow("impulse"), "step"])
def test_samples_left_out_are_bounded_from_the_class(signal, mixed):
    every = response_tube(mixed, input=signal, horizon=14)
    some = response_tube(mixed, input=signal, horizon=14, times=[0.0, 0.03, 0.04, 0.1])
    assert every.complete
    assert not some.complete
    assert np.all(some._errors >= every.error_lower)
    assert some.peak >= every.peak * 0.98
    assert some.error_peak >= every.error_lower.max()
    np.testing.assert_allclose(some._errors[some.samples], every.error_upper[some.samples], rtol=0.02)
    assert some._errors[13] < np.inf


def test_an_uncertain_integrator_has_no_l1_norm():
    omega = np.array([5.0, 20.0, 80.0])
    basis = rid.bases.ParametricBasis([[1.0]], [[1.0]], [[1.0]], [[0.0]], 0.01, ("integrator",))
    frf = rid.FrequencyResponse(omega, basis.response(omega * 0.01)[:, 0], bound=0.05, dt=0.01)
    problem = rid.MixedProblem(frequency=frf, parametric=basis, prior=rid.Prior(gain_bound=0.5, decay_rate=1.3))
    tube = response_tube(rid.identify(problem), horizon=4)
    assert np.isinf(tube.error_l1)
    assert np.isfinite(tube.peak)
    assert np.all((tube.lower[1:] <= 1) & (tube.upper[1:] >= 1))


@pytest.fixture(scope="module")
def tube(mixed):
    return response_tube(mixed, horizon=8, times=[0.0, 0.05])


def test_tampered_certificates_fail(tube):
    assert tube.verify()
    first = tube.certificates[0]
    weaker = dataclasses.replace(first, value=first.value - 1e-3)
    forged = dataclasses.replace(first, level=0.0)
    other = dataclasses.replace(first, samples=1.1 * first.samples)
    for bad in (weaker, forged, other, tube.certificates[1]):
        assert not dataclasses.replace(tube, certificates=(bad, *tube.certificates[1:])).verify()
    assert not dataclasses.replace(tube, certificates=tube.certificates[:-1]).verify()
    assert not dataclasses.replace(tube, upper=tube.upper - 1e-6).verify()
    assert not dataclasses.replace(tube, lower=tube.lower + 1e-6).verify()
    assert not dataclasses.replace(tube, u=2 * tube.u).verify()
    assert not dataclasses.replace(tube, samples=tube.samples[::-1]).verify()


def test_units_of_the_output_scale_the_tube(mixed, tube):
    s = 2.0**40
    large = response_tube(rid.identify(in_units(mixed.problem, s)), horizon=8, times=[0.0, 0.05])
    np.testing.assert_allclose(large.upper, s * tube.upper, rtol=1e-6)
    np.testing.assert_allclose(large.error_l1, s * tube.error_l1, rtol=1e-6)


def test_executor_progress_copy_and_text(mixed, tube):
    seen = []
    with concurrent.futures.ThreadPoolExecutor(2) as pool:
        again = response_tube(
            mixed, horizon=8, times=[0.0, 0.05], executor=pool, progress=lambda text, done, of: seen.append((done, of))
        )
    assert seen == [(1, 2), (2, 2)]
    np.testing.assert_array_equal(again.upper, tube.upper)
    assert copy.deepcopy(tube).verify()
    assert not tube.upper.flags.writeable
    text = tube.summary()
    assert "2 of 8 samples" in text
    assert f"{tube.error_l1:.4g}" in text
    assert f"{tube.peak:.4g}" in text
    assert "2 of 8 samples" in repr(tube)


class First(concurrent.futures.Executor):
    """Bounds the first sample only, and keeps which ones it was given."""

    def map(self, work, samples):
        self.samples = samples
        return map(work, samples[:1])


@pytest.mark.parametrize(("horizon", "count"), [(100, 60), (12, 12)])
def test_default_horizon_and_times(horizon, count):
    result = first_coefficient(0.0, rho=1.3)
    executor = First()
    assert response_tube(result, executor=executor).u.size == int(np.ceil(np.log(100) / np.log(1.3)))
    response_tube(result, horizon=horizon, executor=executor)
    assert len(executor.samples) == count
    assert (executor.samples[0], executor.samples[-1]) == (0, horizon - 1)
    assert np.ptp(np.diff(executor.samples)) <= 1  # evenly spread


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"input": "ramp"}, "`input` must be one of"),
        ({"input": np.ones((3, 2))}, r"`input` must have shape \(H,\).*\(3, 2\)"),
        ({"input": [1.0, np.nan]}, "`input` must be finite"),
        ({"input": np.ones(3), "horizon": 4}, "`horizon` must not exceed the 3 samples of `input`; got 4"),
        ({"horizon": 0}, "`horizon` must be at least 1; got 0"),
        ({"horizon": 4, "times": [0.015]}, "`times` must be sample instants .* dt = 0.01 s; got 0.015"),
        ({"horizon": 4, "times": [0.04]}, "`times` must be sample instants of the horizon, 0 to 0.03 s.*got 0.04"),
        ({"horizon": 4, "times": []}, "`times` is empty"),
        ({"gap": -1}, "`gap` must be positive"),
    ],
)
def test_a_sentence_for_each_option(mixed, options, sentence):
    with pytest.raises(rid.InputError, match=sentence):
        response_tube(mixed, **options)


def test_what_has_no_tube(mixed):
    with pytest.raises(rid.errors.InputTypeError, match="`identification` must be an Identification; got MixedProblem"):
        response_tube(mixed.problem)
    with pytest.raises(rid.InputError, match=r'`error_l1` is the norm of an impulse response.*"impulse"'):
        _ = response_tube(first_coefficient(0.0), input="step", horizon=1).error_l1
    record = rid.TimeRecord([1.0], [5.0], dt=0.1, bound=0.1)
    refuted = rid.identify(rid.MixedProblem(time=record, prior=rid.Prior(gain_bound=1.0, decay_rate=1.5)))
    with pytest.raises(rid.errors.InconsistentDataError, match="inconsistent"):
        response_tube(refuted)


def test_a_budget_leaves_the_samples_that_are_finished(mixed):
    whole = response_tube(mixed, horizon=6)
    part = response_tube(mixed, horizon=6, time_limit=1e-9)
    assert part.samples.size == 1
    np.testing.assert_allclose(part.upper, whole.upper[part.samples], rtol=1e-9)
    assert part.verify()


@pytest.mark.quick
@pytest.mark.parametrize("start", [slow(1), 7])
def test_tails_of_impulse_responses(start):
    for a in (0.3, -0.9, 0.9999):
        total, largest = tail_bounds(np.array([[a]]), np.array([[2.0]]), np.array([[3.0]]), start)
        assert total[0] == pytest.approx(6 * abs(a) ** (start - 1) / (1 - abs(a)), rel=1e-6)
        assert total[0] >= 6 * abs(a) ** (start - 1) / (1 - abs(a)) * (1 - 1e-12)
        assert largest[0] == pytest.approx(6 * abs(a) ** (start - 1), rel=1e-6, abs=1e-8)
    pair = rid.kautz(20.0, 0.004, dt=0.01, delay=1)
    h = np.abs(pair.impulse(100_000))[start:]
    total, largest = tail_bounds(pair.A, pair.B, pair.C, start)
    np.testing.assert_allclose(total, h.sum(axis=0), rtol=1e-5)
    np.testing.assert_allclose(largest, h.max(axis=0), rtol=1e-5)
    assert np.all(total >= h.sum(axis=0) * (1 - 1e-12))
    assert np.all(largest >= h.max(axis=0) * (1 - 1e-12))
    assert np.isinf(tail_bounds(np.eye(1), np.eye(1), np.eye(1), start)[0][0])
