"""Margins of matrix problems against Pick's matrix and cvxpy's norms, the semidefinite block by brute force, and the proofs."""

import dataclasses

import control
import numpy as np
import pytest

import robustid as rid
from robustid.identification import verify_margin_exactly
from robustid.identification.certificate import evaluate_certificate
from robustid.identification.entries import Entries
from robustid.identification.exact_evaluation import enclose_margin
from robustid.identification.formulation import ExactFormulation
from robustid.identification.formulation.sarason import PairMap
from robustid.identification.formulation.taylor import ShiftMap
from support.bounds import rebound
from support.cases import slow
from support.matrix_plants import judge_margin, random_matrix_problem, response
from support.problems import identified

SHAPES = (2, 2), (2, 3), (3, 2)
KAUTZ = rid.kautz(0.9, 0.02, dt=1.0)


def agrees(problem, tolerance=1e-5):
    """Solved, verified and as the judge says."""
    result = identified(problem, accuracy=1e-6)
    assert result.margin == pytest.approx(judge_margin(problem), rel=tolerance)
    assert result.margin - result.margin_lower <= 1e-6 * max(1, result.margin)
    return result


@pytest.mark.parametrize(("seed", "lines"), [slow(0, 3), slow(1, 3), (2, 3), *(slow(seed, 6) for seed in range(30))])
def test_random_plants(seed, lines):
    """The truth is inside for 1.2 of its own gain; half of that gives larger margins."""
    p, q = SHAPES[seed % 3]
    problem, truth = random_matrix_problem(seed, p, q, lines)
    inside = agrees(problem)
    assert inside.margin <= 1
    assert inside.order == problem.coefficients * min(p, q)
    frf = problem.frequency[0]
    assert frf.ratio(frf.values - response(truth, frf.omega)).max() <= 1 + 1e-12
    assert agrees(random_matrix_problem(seed, p, q, lines, factor=0.5)[0]).margin >= inside.margin - 1e-6


# --- every kind of data and class -----------------------------------------------------------------------------------------


def column_bounds(frf, rng):
    return rebound(frf, radius=frf.bound * rng.uniform(0.5, 2, frf.bound.shape), joint="column")


def ellipsoids(frf, rng):
    size = frf.bound[0].size
    root = rng.standard_normal((frf.omega.size, size, size)) + 1j * rng.standard_normal((frf.omega.size, size, size))
    shape = (root @ root.conj().swapaxes(1, 2) + np.eye(size)) * frf.bound[0, 0, 0] ** 2 / size
    return rid.FrequencyResponse(frf.omega, frf.values, bound=rid.Bound(joint="matrix", ellipsoid=shape), dt=frf.dt)


def directions(frf, rng):
    right = rng.standard_normal((frf.omega.size, 2, 2)) + 1j * rng.standard_normal((frf.omega.size, 2, 2))
    left = rng.standard_normal((frf.omega.size, 3, 2)) + 1j * rng.standard_normal((frf.omega.size, 3, 2))
    data = frf.tangential(right=right, left=left)
    return dataclasses.replace(data, bound=data.bound.inflated(0.5))


def missing(frf, rng):
    gone = rng.uniform(size=frf.bound.shape) < 0.3
    return dataclasses.replace(frf, values=np.where(gone, np.nan, frf.values), bound=np.where(gone, np.inf, frf.bound))


def missing_columns(frf, rng):
    return column_bounds(missing(frf, rng), rng)


def unchanged(frf, rng):
    return frf


def problem_with(change, rng, seed, lines=3, **options):
    """A problem of two inputs and outputs with another kind of samples or bounds, and the truth."""
    problem, truth = random_matrix_problem(seed, 2, 2, lines, **options)
    return dataclasses.replace(problem, frequency=change(problem.frequency[0], rng)), truth


def by_turns(first, second):
    """All pairs, of which those are run always that take each of the longer list once, the shorter one over and over."""
    return [
        pytest.param(one, two, marks=() if (i - j) % min(len(first), len(second)) == 0 else pytest.mark.slow)
        for i, one in enumerate(first)
        for j, two in enumerate(second)
    ]


DATA = column_bounds, ellipsoids, directions, missing, missing_columns


@pytest.mark.parametrize(("change", "symmetric"), by_turns(DATA, (False, True)))
def test_kinds_of_bounds(change, symmetric):
    problem, _ = problem_with(change, np.random.default_rng(2), 1, factor=0.5)
    assert agrees(dataclasses.replace(problem, symmetric=symmetric)).margin > 0.1


@pytest.mark.parametrize(("shape", "solver"), by_turns(SHAPES, ("structured", "cvxpy")))
def test_modes_scalings_and_two_experiments(shape, solver):
    (p, q), rng = shape, np.random.default_rng(3)
    problem, _ = random_matrix_problem(2, p, q, 4, factor=0.3)
    prior = dataclasses.replace(problem.prior, scaling=rng.uniform(0.5, 2, (p, q)))
    frf = problem.frequency[0]
    both = [frf.select([0, 2, 3]), column_bounds(frf.select([1, 2]), rng)]
    problem = dataclasses.replace(problem, frequency=both, prior=prior, parametric=KAUTZ)
    assert agrees(problem).margin > 0.01


@pytest.mark.parametrize("symmetric", [slow(False), True])
def test_records_and_lines_together(symmetric):
    rng = np.random.default_rng(4)
    problem, truth = random_matrix_problem(4, 2, 2, 2, factor=0.6, symmetric=symmetric)
    u = rng.standard_normal((5, 2))
    y = control.forced_response(truth, inputs=u.T).outputs.T
    size = problem.frequency[0].bound[0, 0, 0]
    record = rid.TimeRecord(u, y + 0.5 * size * rng.uniform(-1, 1, y.shape), dt=1.0, bound=0.5 * size)
    problem = dataclasses.replace(problem, time=record, symmetric=symmetric)
    assert agrees(problem).margin > 0.1
    agrees(dataclasses.replace(problem, parametric=KAUTZ))


CHANGES = unchanged, column_bounds, ellipsoids, directions


@pytest.mark.parametrize(("change", "symmetric"), by_turns(CHANGES, (False, True)))
def test_taylor_coefficients_prove_the_same(change, symmetric):
    """The proven intervals of both forms overlap, and are as narrow as asked."""
    problem, _ = problem_with(change, np.random.default_rng(5), 5, factor=0.5, rho=1.6)
    problem = dataclasses.replace(problem, symmetric=symmetric, parametric=KAUTZ)
    results = [identified(problem, form=form) for form in ("orthonormal", "taylor")]
    assert max(r.margin_lower for r in results) <= min(r.margin for r in results)
    for result in results:
        assert result.margin > 0.01
        assert result.margin - result.margin_lower <= 1e-4 * max(1, result.margin)


# --- the semidefinite block -----------------------------------------------------------------------------------------------


def maps():
    pair = ExactFormulation(random_matrix_problem(0, 1, 1, 2)[0]).data.sarason.pair
    for entries in (Entries(2, 3), Entries(3, 1), Entries(2, 2, symmetric=True)):
        yield PairMap(pair, entries)
        yield ShiftMap(5, entries)


@pytest.mark.parametrize("sarason", maps(), ids=lambda m: f"{type(m).__name__} {m.entries}")
def test_the_block_by_brute_force(sarason):
    """X(x) from its Stein equation in Kronecker form; matrices, adjoint, products and curvature as sums over unit vectors."""
    rng = np.random.default_rng(6)
    entries, n = sarason.entries, sarason.pair.order
    p, q, A, c = entries.outputs, entries.inputs, sarason.pair.A, sarason.pair.c
    unit = []
    for x in np.eye(sarason.size):
        row = entries.expand(x).transpose(0, 2, 1).reshape(p, n * q)
        left, right = np.kron(A, np.eye(p)).T, np.kron(A, np.eye(q))
        X = np.linalg.solve(
            np.eye(n * n * p * q) - np.kron(left, right.T), (np.kron(c, np.eye(p)).T @ row).ravel()
        ).reshape(n * p, n * q)
        np.testing.assert_allclose(sarason.matrix(x), X, atol=1e-12)
        H = np.kron(sarason.pair.symmetry(), np.eye(p)) @ X
        unit.append(np.block([[np.zeros((n * p, n * p)), H], [H.T, np.zeros((n * q, n * q))]]))
    unit, ball = np.array(unit), sarason.ball()
    P, Q = (a + a.T for a in rng.standard_normal((2, *unit.shape[1:])))
    x = rng.standard_normal(sarason.size)
    np.testing.assert_allclose(ball.matrices(x)[0], np.tensordot(x, unit, 1), atol=1e-12)
    np.testing.assert_allclose(ball.adjoint([P]), np.tensordot(unit, P, 2), atol=1e-11)
    np.testing.assert_allclose(ball.times(x, [P])[0], np.tensordot(x, unit, 1) @ P, atol=1e-11)
    expected = np.einsum("iab,bc,jcd,da->ij", unit, P, unit, Q, optimize=True)
    np.testing.assert_allclose(ball.curvature([(P, Q)]), (expected + expected.T) / 2, atol=1e-10)


# --- proofs -----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("change", "form"), by_turns(CHANGES, ("orthonormal", "taylor")))
def test_proofs_hold_and_forged_ones_do_not(change, form):
    pytest.importorskip("flint", reason="python-flint is not installed: robustid[exact]")
    problem, _ = problem_with(change, np.random.default_rng(7), 6, 2, factor=0.5, rho=2.0)
    result = rid.identify(dataclasses.replace(problem, parametric=KAUTZ), form=form, accuracy=1e-5)
    assert result.margin_lower > 0.01
    data, proof = result.formulation.data, result.certificate
    assert proof.verify(data.rows, data.sarason)
    assert verify_margin_exactly(proof, data.rows, data.sarason)
    numbers = proof.samples, proof.ball, proof.upper, data.rows, data.sarason
    in_doubles, exact = evaluate_certificate(*numbers), enclose_margin(*numbers)
    assert proof.value <= in_doubles <= exact <= result.margin
    assert exact - in_doubles < 1e-6
    assert float(proof.shares(data.rows).sum()) == pytest.approx(1, abs=1e-12)
    assert proof.shares(data.rows).size == data.rows.cones
    forged = [
        dataclasses.replace(proof, value=result.margin * (1 + 1e-3)),
        dataclasses.replace(proof, ball=proof.ball * 1.05),
        dataclasses.replace(proof, samples=np.roll(proof.samples, 1)),
        dataclasses.replace(proof, samples=-proof.samples),
    ]
    for wrong in forged:
        assert not wrong.verify(data.rows, data.sarason)
        assert not verify_margin_exactly(wrong, data.rows, data.sarason)


def test_no_multipliers_prove_more_than_what_a_member_reaches():
    """Any multipliers, also wild ones: their value is at most the margin of the truth, which is in the class."""
    rng = np.random.default_rng(8)
    for seed, change in enumerate(CHANGES):
        problem, truth = problem_with(change, rng, seed, factor=1.05)
        (frf,) = problem.frequency
        values = response(truth, frf.omega)
        if change is directions:
            values = frf.left @ values @ frf.right
        reached, data = frf.ratio(frf.values - values).max(), ExactFormulation(problem).data
        best = rid.identify(problem).certificate
        for spread in (0.0, 1e-3, 0.1, 1.0, 10.0):
            samples = best.samples + spread * np.abs(best.samples).max() * (
                rng.standard_normal(best.samples.shape) + 1j * rng.standard_normal(best.samples.shape)
            )
            ball = best.ball + spread * np.abs(best.ball).max() * rng.standard_normal(best.ball.shape)
            assert evaluate_certificate(samples, ball, 1.0, data.rows, data.sarason) <= reached
