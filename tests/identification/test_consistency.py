import dataclasses

import control
import numpy as np
import pytest

import robustid as rid
from robustid.core import simulate as simulate_all
from robustid.identification import margin, model_residuals
from robustid.identification.solver.cvxpy_backend import available_solvers
from support.cases import slow
from support.matrix_plants import judge_margin
from support.problems import CASES, MIXED_IS_SLOW, identified, in_units, random_problem, rigid_structure
from support.structure import about_structure


def simulate(model, u):
    return simulate_all(model, np.asarray(u, float)[:, None])[0][:, 0]


def flexible(size=None, **changes):
    data = rid.datasets.flexible_structure(seed=1, **(size or {}))
    return dataclasses.replace(about_structure(data, 0.2, 1.1, time=True), **changes)


@pytest.fixture(scope="module")
def found():
    """Of the simulated structure."""
    return identified(flexible())


@pytest.mark.parametrize("seeds", [1, slow(6)])
@pytest.mark.parametrize("case", CASES)
def test_margin_agrees_with_pick_s_theorem_on_random_problems(case, seeds):
    """Truth inside and outside the bounds: all within 1e-6 of an independent formulation."""
    for seed in range(seeds):
        for spread in (1.0, 0.2):
            problem = random_problem(seed, case, 10, spread=spread, noise=0.9 / spread)
            result, judge = identified(problem, accuracy=1e-6), judge_margin(problem)
            assert result.margin == pytest.approx(judge, abs=1e-6 * max(1, judge))
            assert result.margin_lower <= result.margin <= result.margin_lower + 1e-6 * max(1, judge)
            assert result.consistent == (judge <= 1)
            if spread == 1.0:
                assert result.consistent  # the truth is a member
            check_model(problem, result)


def check_model(problem, result):
    states = 0 if problem.parametric is None else problem.parametric.states
    # With Taylor coefficients among the data the central interpolant has one state less.
    assert result.model.nstates == problem.coefficients - (problem.taylor > 0) + states
    interpolation = {c.name: c.measured for c in result.verification.checks}
    assert interpolation["model minus its own interpolation data, relative"] < 1e-9
    level = max(1.0, result.margin * (1 + 1e-6))
    for residual in model_residuals(problem, result.model):
        assert residual.ratio.max() <= level * (1 + 1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("coefficients", [24, 40, 60])
def test_margin_agrees_with_general_solvers_up_to_60_coefficients(case, coefficients):
    for seed in range(10):
        problem = random_problem(100 + seed, case, coefficients, spread=0.2, noise=3.0)
        ours = identified(problem, accuracy=1e-5)
        names = [name for name in ("CLARABEL", "CVXOPT") if name in available_solvers()]
        for name in names if coefficients < 60 or seed < 2 else names[1:]:
            other = rid.identify(problem, solver=name, accuracy=1e-5)
            assert other.margin == pytest.approx(ours.margin, abs=1e-5 * max(1, ours.margin))
        assert ours.margin - ours.margin_lower <= 1e-5 * max(1, ours.margin)
        check_model(problem, ours)


@pytest.mark.parametrize("case", MIXED_IS_SLOW)
def test_the_structured_solver_agrees_with_the_conic_solver(case):
    problem = random_problem(7, case, 28, spread=0.2, noise=4.0)
    ours, other = rid.identify(problem), rid.identify(problem, solver="cvxpy")
    assert ours.solver == "structured"
    assert ours.margin == pytest.approx(other.margin, abs=1e-5 * max(1, other.margin))


def test_both_forms_give_the_same_margin():
    for case in CASES:
        problem = random_problem(3, case, 10, spread=0.2, noise=4.0)
        paper, ours = rid.identify(problem, form="classical", accuracy=1e-5), rid.identify(problem)
        assert paper.margin == pytest.approx(ours.margin, abs=1e-5 * max(1, ours.margin))


@pytest.mark.parametrize("seeds", [3, slow(8)])
@pytest.mark.parametrize("case", [slow(one) if one == "time" else one for one in MIXED_IS_SLOW])
def test_order_is_minimal(case, seeds):
    """No pole-zero cancellations: the Hankel singular values of the scaled central part stay away from rounding."""
    smallest = []
    for seed in range(seeds):
        problem = random_problem(seed, case, 12)
        result = rid.identify(problem)
        n, rho = problem.coefficients - (problem.taylor > 0), problem.prior.decay_rate
        A, B, C = result.model.A[:n, :n] * rho, result.model.B[:n], result.model.C[:, :n]
        P, Q = control.dlyap(A, B @ B.T), control.dlyap(A.T, C.T @ C)
        hankel = np.sqrt(np.abs(np.linalg.eigvals(P @ Q)))
        smallest.append(hankel.min() / hankel.max())
    # One state too many would show as 1e-8 (the square root of the rounding of PQ) in every seed.
    assert np.sum(np.array(smallest) > 1e-7) >= seeds - 1


@pytest.mark.parametrize("size", [{"lines": 5, "samples": 4}, slow(None)])
def test_objectives_choose_what_they_say(size):
    problem = flexible(size)
    results = {name: identified(problem, objective=name) for name in ("center", "margin", "gain", "order")}
    for result in results.values():
        assert result.margin == pytest.approx(results["center"].margin, abs=1e-4)
        assert max(r.ratio.max() for r in result.residuals) <= 1 + 1e-5
    assert max(r.ratio.max() for r in results["margin"].residuals) <= results["margin"].margin + 2e-4
    assert results["gain"].prior.gain_bound < 1e-3  # two true pairs need no rest
    assert results["center"].prior == problem.prior


@pytest.mark.parametrize(("solver", "coefficients"), [("auto", 26), ("cvxpy", 14)])
def test_smallest_gain_is_the_threshold_of_consistency(solver, coefficients):
    problem = random_problem(5, "mixed", coefficients, spread=0.5, noise=0.5)
    gain = rid.identify(problem, objective="gain", solver=solver).prior.gain_bound
    assert gain < problem.prior.gain_bound
    assert rid.identify(problem.with_prior(gain_bound=gain * 1.001)).consistent
    assert not rid.identify(problem.with_prior(gain_bound=gain * 0.998)).consistent


def test_order_objective_lowers_the_nuclear_norm():
    problem, norms = random_problem(8, "time", 20), []
    for name in ("order", "center"):
        result = rid.identify(problem, objective=name)
        X = result.formulation.data.sarason.matrix(result.coefficients)
        half = X.shape[0] // 2
        norms.append(np.linalg.norm(X[half:, :half], "nuc"))
    assert norms[0] < norms[1]


def test_inconsistent_data_come_with_a_proof_and_a_model():
    wrong = rid.kautz(2 * np.pi * np.array([9.0, 17.2]), [0.1, 0.004], dt=0.01, delay=1)
    result = identified(flexible(parametric=wrong))
    assert result.status is rid.Status.INCONSISTENT
    assert not result.consistent
    assert result.margin_lower > 1
    assert max(r.ratio.max() for r in result.residuals) <= result.margin * (1 + 1e-5)
    assert np.abs(np.linalg.eigvals(result.model.A)).max() < 1
    assert sum(row[3] for row in result.conflicting_samples(0.0)) == pytest.approx(1)
    near = [row for row in result.conflicting_samples(0.05) if row[0] == "frequency"]
    assert any(abs(row[2] / (2 * np.pi) - 17.5) < 2 for row in near)
    with pytest.raises(rid.errors.InconsistentDataError, match="margin"):
        result.require()


def test_other_solutions_keep_every_residual(found):
    for E in (0.7, -0.7, control.ss([[0.3]], [[0.5]], [[0.5]], [[0.1]], True)):
        for mine, theirs in zip(found.residuals, model_residuals(found.problem, found.solution(E)), strict=True):
            assert np.abs(mine.error - theirs.error).max() < 1e-9
    omega = np.linspace(5, 300, 7)
    centre, radius = found.weyl_disc(omega)
    for E in (0.0, 1.0, -1.0):
        assert np.all(np.abs(found.solution(E)(np.exp(1j * omega * 0.01)) - centre) <= radius + 1e-9)
    lines = found.problem.frequency[0].omega[1:3]
    assert found.weyl_disc(lines)[1].max() < 1e-9


def test_known_past_input_is_used_through_an_infinite_bound():
    experiment = rid.datasets.flexible_structure(seed=2, samples=40)
    u = np.sign(np.sin(2 * np.pi * 2 * experiment.time.time + 0.1))
    y = simulate(experiment.truth, u)
    bound = np.where(np.arange(40) < 25, np.inf, 0.01)
    record = rid.TimeRecord(u, np.where(np.isinf(bound), 99.0, y), dt=0.01, bound=bound)
    problem = flexible(time=record, frequency=None)
    assert problem.taylor == 40
    assert problem.samples == 15
    assert rid.identify(problem).consistent


def test_unknown_initial_state_is_not_ignored():
    """The window of a long record: consistent as "free" for 2 seeds of 2, refuted as "rest" in all."""
    for seed in range(2):
        rng = np.random.default_rng(seed)
        truth = rid.datasets.flexible_structure(seed=1).truth
        u = np.sign(rng.standard_normal(300))
        y = simulate(truth, u)[270:] + 0.02 * rng.uniform(-1, 1, 30)
        free = rid.TimeRecord(u[270:], y, dt=0.01, bound=0.02, initial="free")
        prior = rid.Prior(gain_bound=0.02, decay_rate=1.3)
        assert identified(flexible(frequency=None, time=free, prior=prior)).consistent
        rest = rid.TimeRecord(u[270:], y, dt=0.01, bound=0.02)
        assert not rid.identify(flexible(frequency=None, time=rest, prior=prior)).consistent


def test_periodic_record_is_used_through_its_lines():
    truth = rid.datasets.flexible_structure(seed=1).truth
    rng = np.random.default_rng(0)
    u = np.sign(rng.standard_normal(24))
    many = simulate(truth, np.tile(u, 800))[-24:]  # the light mode has decayed
    record = rid.TimeRecord(u, many + 0.01 * rng.uniform(-1, 1, 24), dt=0.01, bound=0.01, initial="periodic")
    problem = flexible(frequency=None, time=record)
    assert problem.coefficients == 24
    assert identified(problem).consistent
    as_rest = rid.identify(flexible(frequency=None, time=rid.TimeRecord(u, record.y, dt=0.01, bound=0.01)))
    assert not as_rest.consistent


def test_equal_frequencies_share_one_node():
    """Values that are apart at one: see `test_paths`."""
    first = rid.FrequencyResponse([10.0, 50.0], [1.0, 0.8 - 0.5j], bound=0.1, dt=0.01)
    second = rid.FrequencyResponse([50.0 * (1 + 1e-15)], [0.85 - 0.45j], bound=0.1, dt=0.01)
    problem = rid.MixedProblem(frequency=[first, second], prior=rid.Prior(gain_bound=3, decay_rate=1.1))
    assert problem.coefficients == 4
    assert rid.identify(problem).consistent


def test_integrators_in_the_parametric_part():
    rigid, truth = rigid_structure()
    omega = 2 * np.pi * np.linspace(1, 40, 12)
    F = truth(np.exp(1j * omega * 0.01))
    frf = rid.FrequencyResponse(omega, F, bound=1e-3 * np.abs(F), dt=0.01)
    u = np.ones(15)
    record = rid.TimeRecord(u, simulate(truth, u), dt=0.01, bound=1e-3)
    basis = [rigid, rid.kautz(2 * np.pi * np.array([9.0, 17.67]), [0.1, 0.004], dt=0.01, delay=1)]
    result = rid.identify(flexible(frequency=frf, time=record, parametric=basis))
    assert result.consistent
    assert np.sum(np.abs(result.model.poles() - 1) < 1e-6) == 2
    zero = rid.FrequencyResponse([0.0, 10.0], [1.0, 1.0], bound=0.1, dt=0.01)
    with pytest.raises(rid.InputError, match="integrator"):
        flexible(frequency=zero, parametric=basis)


@pytest.mark.parametrize("power", [-60, pytest.param(60, marks=pytest.mark.slow)])
def test_units_do_not_matter(power, found):
    """Amplitude and time scaled by 2^+-60 scale the result exactly."""
    problem, scale = found.problem, 2.0**power
    larger, z = rid.identify(in_units(problem, scale)), np.exp(0.01j * problem.frequency[0].omega[3])
    assert larger.margin == found.margin
    assert larger.margin_lower == found.margin_lower
    assert np.array_equal(larger.parameters, found.parameters * scale)
    assert larger.model(z) == pytest.approx(found.model(z) * scale, rel=1e-12)
    modes, (f,), (t,) = rid.datasets.flexible_structure(seed=1).modes, problem.frequency, problem.time
    slower = rid.identify(
        flexible(
            frequency=dataclasses.replace(f, omega=f.omega / scale, dt=f.dt * scale),
            time=dataclasses.replace(t, dt=t.dt * scale),
            parametric=rid.kautz(modes[:, 0] / scale, modes[:, 1], dt=0.01 * scale, delay=1),
        )
    )
    assert slower.margin == found.margin
    assert np.array_equal(slower.model.A, found.model.A)


def test_every_installed_solver_is_taken_by_name_and_checked():
    problem = random_problem(1, "mixed", 14)
    for name in available_solvers():
        result = identified(problem, solver=name, accuracy=1e-5)
        assert result.margin - result.margin_lower <= 1e-5


@pytest.mark.parametrize("fault", ["raises", "lies"])
def test_a_solver_that_fails_or_lies_is_replaced_and_named(monkeypatch, fault):
    """No answer, or an answer far outside the ball with multipliers of the wrong sign: our own solver decides."""
    problem = random_problem(2, "mixed", 14, spread=0.2, noise=4.0)
    honest, solve = rid.identify(problem), margin.solve_conic

    def faulty(*arguments, **options):
        if fault == "raises":
            raise rid.errors.SolverError("CLARABEL failed: for this test")
        found = solve(*arguments, **options)
        return dataclasses.replace(found, x=3 * found.x + 1, samples=-found.samples)

    monkeypatch.setattr(margin, "solve_conic", faulty)
    result = identified(problem)
    assert result.solver == "structured"
    assert result.margin == pytest.approx(honest.margin, abs=1e-5)


def test_control_objects_work_at_once(found):
    assert isinstance(found.model, control.StateSpace)
    assert found.model.dt == 0.01
    assert found.model.input_labels == [str(found.problem.signals[1])]
    (frf,) = found.problem.frequency
    response = control.frequency_response(found.model, frf.omega)
    assert np.abs(response.complex - frf.values[:, 0, 0]).max() <= 0.03 * (1 + 1e-6)


def test_channel_names_that_control_refuses_are_cleaned():
    frf = rid.FrequencyResponse([1.0], [0.5], bound=0.1, dt=0.1, inputs="ref. current [A]", outputs="x")
    result = rid.identify(rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=1.0, decay_rate=1.1)))
    assert result.model.input_labels == ["ref_ current [A]"]
    assert str(result.problem.signals[1]) == "ref. current [A]"


def test_summary_says_what_was_found_and_assumed(found):
    for words in ("consistent", "margin", "assumed", "verified", "certificate"):
        assert words in found.summary()
