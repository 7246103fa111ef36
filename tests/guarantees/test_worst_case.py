"""Worst-case errors: closed forms, drawn truths, laws, certificates, and bad input."""

import dataclasses

import control
import numpy as np
import pytest

import robustid as rid
from robustid.core import Choice, Source, response
from robustid.guarantees import consistent_set
from robustid.guarantees.polygons import value_set
from robustid.guarantees.value_set import value_set_claims
from robustid.identification import Functional, certify_support, evaluate_support
from support.cases import slow
from support.interrupts import ctrl_c_when
from support.pairwise import every_one
from support.problems import CASES, random_experiment, random_problem
from support.refusals import refused

K, RHO, DT = 2.0, 1.2, 0.1


def identified(frequency=None, time=None, gain=K, rho=RHO, **options):
    prior = rid.Prior(gain_bound=gain, decay_rate=rho)
    return rid.identify(rid.MixedProblem(frequency=frequency, time=time, prior=prior), **options)


def one_line(omega, value, bound):
    return identified(rid.FrequencyResponse([omega], [value], bound=bound, dt=DT))


# Closed forms (theory: Schwarz-Pick and its real-coefficient form).


def test_no_data_gives_the_gain_bound_and_the_lens():
    """Real direction: K. Imaginary direction, real coefficients: K (1 - sqrt(1 - s^2))/s, s = 2 |Im zeta|/|1 - zeta^2|."""
    result = one_line(0.0, 0.0, 10 * K)  # a sample that says nothing
    for omega in (3.0, 12.0, 25.0):
        zeta = np.exp(-1j * omega * DT) / RHO
        s = 2 * abs(zeta.imag) / abs(1 - zeta**2)
        found = value_set(consistent_set(result), omega, 4, 1e-8)
        side = K * (1 - np.sqrt(1 - s**2)) / s
        assert found.support == pytest.approx([K, side, K, side], rel=1e-6)
        assert np.abs(found.points[[0, 2]]) == pytest.approx([K, K], rel=1e-6)
        assert found.points[[1, 3]].imag == pytest.approx([side, -side], rel=1e-6)
        assert np.all(found.support >= [K, side, K, side])


@pytest.mark.parametrize(("value", "bound"), every_one([0.0, 1.1, -1.7, 1.999], [1e-9, 1e-4]))
def test_one_real_value_gives_picks_disc(value, bound):
    """At real nodes: |(v - w)/(1 - vw)| <= |zeta - zeta_1|/|1 - zeta zeta_1|, both ends attained, at an end of w's interval."""
    result = one_line(0.0, value, bound)
    found = value_set(consistent_set(result), np.pi / DT, 8, 1e-8)
    here, there = -1 / RHO, 1 / RHO
    r = abs((here - there) / (1 - here * there))
    high, low = (value + bound) / K, (value - bound) / K
    ends = (high + r) / (1 + high * r), (low - r) / (1 - low * r)
    assert found.directions == pytest.approx([0, np.pi])
    assert found.support == pytest.approx([K * ends[0], -K * ends[1]], rel=1e-6, abs=1e-6)
    assert found.points.real == pytest.approx([K * ends[0], K * ends[1]], rel=1e-6, abs=1e-6)


def test_one_exact_complex_value_stays_in_picks_disc():
    """With real coefficients the disc is an outer bound: never exceeded, and the real line's value is exact."""
    value, omega = 0.6 - 0.8j, 10.0
    result = one_line(omega, value, 1e-8)
    node = np.exp(-1j * omega * DT) / RHO
    for at in (9.0, 14.0):
        zeta = np.exp(-1j * at * DT) / RHO
        r, w = abs((zeta - node) / (1 - np.conj(node) * zeta)), value / K
        center = K * w * (1 - r**2) / (1 - r**2 * abs(w) ** 2)
        radius = K * r * (1 - abs(w) ** 2) / (1 - r**2 * abs(w) ** 2)
        found = value_set(consistent_set(result), at, 16, 1e-4)
        assert np.abs(found.points - center).max() <= radius * (1 + 1e-6)
        assert np.abs(found.points - center).max() >= 0.5 * radius


def test_two_taylor_coefficients():
    """|g_1| <= K (1 - (g_0/K)^2)/rho: the response at zeta = +-1/rho given g_0 = 0 is at most K/rho in modulus."""
    record = rid.TimeRecord([1.0], [0.0], bound=1e-9, dt=DT)
    result = identified(time=record)
    found = value_set(consistent_set(result), 0.0, 3, 1e-8)
    assert found.support == pytest.approx([K / RHO, K / RHO], rel=1e-6)


# Drawn truths.


MANY = [slow(seed, case, 12, 16, 3) for case in CASES for seed in range(100, 125)]
FINE = [slow(seed, case, 12, 64, 3) for case in CASES for seed in range(100, 105)]


@pytest.mark.parametrize(
    ("seed", "case", "coefficients", "directions", "count"),
    [
        *((0, case, 10, 16, 3) for case in CASES if case not in ("mixed", "time")),
        (7, "time", 6, 64, 1),
        *(
            slow(*one)
            for one in (
                (0, "mixed", 10, 16, 3),
                (0, "time", 10, 16, 3),
                (7, "time", 6, 64, 3),
                (7, "parametric", 6, 64, 3),
            )
        ),
        *MANY,
        *FINE,
    ],
)
def test_the_truth_is_inside_and_the_gap_closes_with_more_directions(seed, case, coefficients, directions, count):
    """In every polygon and interval; upper bounds are above attained errors, by at most 5 %, of 64 directions 1 %."""
    problem, truth = random_experiment(seed, case, coefficients)
    result = rid.identify(problem)
    assert result.consistent
    omega = np.random.default_rng(seed).uniform(0.02, 3.1, count) / problem.dt
    error = rid.worst_case_error(result, omega=omega, directions=directions)
    values = truth.response(error.omega * problem.dt)
    upper, lower = error.upper[:, 0, 0], error.lower[:, 0, 0]
    for found, value in zip(error.values, values, strict=True):
        assert found.excludes(value) <= 0
        low, high = found.magnitude
        assert low <= abs(value) <= high
        first, last = found.phase
        turn = np.angle(value * np.exp(-1j * (first + last) / 2))
        assert abs(turn) <= (last - first) / 2 + 1e-12
    assert np.all(np.abs(values - error.nominal) <= upper)
    assert np.all(lower <= upper)
    if truth.weights is not None:
        assert np.all((error.parameters.lower <= truth.weights) & (truth.weights <= error.parameters.upper))
        ends = np.stack([error.parameters.lower, error.parameters.upper], axis=1)
        assert np.all((error.parameters.attained - ends) * [1, -1] >= 0)
        assert np.all(np.abs(error.parameters.attained - ends) <= 2e-3 * np.diff(ends))
    assert error.certified
    assert np.max(1 - lower / upper) <= (0.05 if directions == 16 else 0.01)


@pytest.mark.parametrize(
    ("case", "seed", "omega"),
    [("time", 1, [150.0]), *(slow(*each, [20.0, 150.0]) for each in (("time", 1), ("parametric", 0)))],
)
def test_the_taylor_form_gives_the_same_bounds(case, seed, omega):
    problem = random_problem(seed, case, 8)
    exact, taylor = (rid.identify(problem, form=form) for form in ("auto", "taylor"))
    options = {"omega": omega, "directions": 4 * len(omega), "rtol": 1e-3}
    here = rid.worst_case_error(exact, **options)
    there = rid.worst_case_error(taylor, model=exact.model, **options)
    assert there.certified
    assert np.all(there.upper >= here.lower)
    assert there.upper == pytest.approx(here.upper, rel=2e-3)


@pytest.mark.parametrize("case", [slow("mixed"), "parametric"])
def test_more_data_never_widen_the_set(case):
    """Support functions and the error of a fixed nominal, with lines and samples added."""
    problem = random_problem(5, case, 16)
    frf, record = problem.frequency[0], problem.time[0]
    shorter = dataclasses.replace(record, u=record.u[:5], y=record.y[:5], bound=record.bound[:5])
    less = dataclasses.replace(problem, frequency=frf.select(slice(0, None, 2)), time=shorter)
    few, many = rid.identify(less), rid.identify(problem)
    options = {"omega": [30.0], "directions": 6, "rtol": 5e-3, "model": few.model}
    wide, narrow = rid.worst_case_error(few, **options), rid.worst_case_error(many, **options)
    for a, b in zip(wide.values, narrow.values, strict=True):
        assert np.all(b.support <= a.support + 5e-3 * np.ptp(a.support))
    assert np.all(narrow.lower <= wide.upper)
    assert np.all(narrow.upper <= wide.upper * 1.005)


def test_any_stable_nominal_and_no_new_solution():
    problem, truth = random_experiment(2, "parametric", 12)
    result = rid.identify(problem)
    error = rid.worst_case_error(result, omega=[40.0, 200.0])
    small = rid.balanced_truncation(result.model, order=3).model
    other = error.with_model(small)
    assert other.values is error.values
    values = truth.response(other.omega * problem.dt)
    assert np.all(np.abs(values - response(small, other.omega * problem.dt)) <= other.upper[:, 0, 0])


# Certificates.


@pytest.fixture(scope="module")
def error():
    return rid.worst_case_error(rid.identify(random_problem(3, "parametric", 8)), omega=[60.0], directions=4)


def test_every_certificate_verifies_and_forged_ones_do_not(error):
    consistent, found = error.consistent_set, error.values[0]
    assert all(claim.verify() for claim in value_set_claims(consistent, found))
    lower = dataclasses.replace(found, support=found.support - 1e-6)
    assert not any(claim.verify() for claim in value_set_claims(consistent, lower))
    here = consistent.with_node(found.omega)
    x, p, tail = here.value_weights(found.omega)
    functional = Functional(np.real(x), np.real(p), tail)
    certificate = found.certificates[0]
    rows, sarason = here.data.rows, here.data.sarason
    assert certificate.verify(functional, rows, sarason)
    rng = np.random.default_rng(0)
    for _ in range(20):
        # Other multipliers are valid too, and prove less: the maximum itself is attained.
        samples = certificate.samples * (1 + 0.01 * rng.standard_normal(certificate.samples.size))
        forged = evaluate_support(functional, samples, certificate.left @ certificate.right.T, 1.0, rows, sarason)
        assert forged >= found.points[0].real
    other = dataclasses.replace(rows, y=rows.y + np.abs(rows.y) + 1)  # what was measured is shifted by one bound
    assert not certificate.verify(functional, other, sarason)


def test_random_multipliers_never_prove_too_little():
    """Any multipliers give an upper bound: against the truth's own value, 200 draws."""
    problem, truth = random_experiment(6, "parametric", 8)
    consistent = consistent_set(rid.identify(problem))
    omega = 70.0
    here = consistent.with_node(omega)
    x, p, tail = here.value_weights(omega)
    functional, value = Functional(np.real(x), np.real(p), tail), truth.response(np.array([omega * problem.dt]))[0].real
    rng, rows = np.random.default_rng(0), here.data.rows
    n, count = here.data.sarason.pair.order, rows.y.size
    for _ in range(200):
        samples = (rng.standard_normal(count) + 1j * rng.standard_normal(count)) * rng.exponential()
        samples[rows.discs :] = samples[rows.discs :].real
        found = certify_support(functional, samples, rng.standard_normal((n, n)), 1.0, rows, here.data.sarason)
        assert found.value >= value


def test_barely_consistent_data_are_bounded_too():
    frf = rid.FrequencyResponse([10.0, 20.0], [1.0, 1.0], bound=0.01, dt=DT)
    problem = rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=K, decay_rate=RHO))
    rough = rid.identify(problem, objective="gain")
    gain = rough.prior.gain_bound
    tight = rid.identify(problem.with_prior(gain_bound=gain * (1 + 1e-7)))
    if tight.consistent:
        error = rid.worst_case_error(tight, omega=[15.0])
        assert error.certified
        assert 0 <= error.lower.max() <= error.upper.max() <= 0.1


def test_poles_from_the_same_data_are_warned_of(error):
    assert "warning" not in error.summary()
    noted = dataclasses.replace(error.identification, choices={"modes": Choice(None, Source.DATA, "one")})
    assert "does not cover" in dataclasses.replace(error, identification=noted).summary()


# Bad input.


@pytest.fixture(scope="module")
def result():
    return rid.identify(random_problem(0, "mixed", 8))


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"directions": 2}, rid.InputError, "`directions` must be at least 3"),
        ({"directions": 1000}, rid.InputError, "at most 360"),
        ({"rtol": 0}, rid.InputError, "`rtol` must be positive"),
        ({"omega": [1000.0]}, rid.InputError, "pi/dt"),
        ({"omega": [-1.0]}, rid.InputError, "between 0 and pi/dt"),
        ({"omega": []}, rid.InputError, "empty"),
        ({"omega": [np.nan]}, rid.InputError, "finite"),
        ({"model": 3}, rid.errors.InputTypeError, "`model` must be a control.StateSpace"),
        ({"model": control.ss(1.1, 1, 1, 0, 0.01)}, rid.InputError, "stable"),
        ({"model": control.ss(0.5, 1, 1, 0, 0.02)}, rid.InputError, "dt of the data"),
        ({"model": control.ss(0.5, 1, 1, 0)}, rid.InputError, "discrete-time"),
        ({"model": control.ss(0.5 * np.eye(2), np.eye(2), np.eye(2), 0, 0.01)}, rid.InputError, "one input"),
    ],
)
def test_bad_input(result, options, error, words):
    refused(words, rid.worst_case_error, result, error=error, **options)


def test_inconsistent_data_have_no_band():
    result = identified(rid.FrequencyResponse([1.0, 1.1], [5.0, -5.0], bound=0.01, dt=DT))
    refused("no consistent system", rid.worst_case_error, result, error=rid.errors.InconsistentDataError)
    refused("must be an Identification", rid.worst_case_error, result.model, error=rid.errors.InputTypeError)


# Budgets.


def test_frequencies_that_a_budget_allows_are_spread_over_the_range():
    result = rid.identify(random_experiment(1, "mixed", 12)[0])
    grid = np.linspace(10.0, 100.0, 8)
    whole = rid.worst_case_error(result, omega=grid, directions=4)
    part = rid.worst_case_error(result, omega=grid, directions=4, time_limit=1e-9)
    assert part.omega.size == 1
    np.testing.assert_array_equal(np.sort([*part.omega, *part.missing]), grid)
    assert "1 of 8 frequencies" in part.unfinished
    assert part.unfinished in part.summary()
    assert whole.unfinished == ""
    np.testing.assert_allclose(part.upper, whole.upper[grid == part.omega], rtol=1e-9)
    stop = ctrl_c_when(lambda text, done, count: done == 2)
    left = rid.worst_case_error(result, omega=grid, directions=4, progress=stop)
    assert left.omega.size == 2


def test_parameters_that_a_time_limit_leaves_out_are_named_and_completed(tmp_path):
    result = rid.identify(random_experiment(1, "parametric", 12)[0])
    whole = rid.worst_case_error(result, omega=[20.0], directions=4)
    part = rid.worst_case_error(result, omega=[20.0], directions=4, time_limit=1e-9)
    assert not part.parameters.complete
    assert not part.parameters.certificates
    assert part.certified
    np.testing.assert_array_equal(part.upper, whole.upper)
    part.save(tmp_path / "part")
    again = rid.load(tmp_path / "part")
    assert again.certified
    assert not again.parameters.complete
    refused(r"call on_circle of completed\(\)", part.on_circle)
    np.testing.assert_array_equal(part.completed().parameters.upper, whole.parameters.upper)
    assert whole.completed() is whole
