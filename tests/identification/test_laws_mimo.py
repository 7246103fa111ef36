"""What must hold of problems with several channels: zeros, blocks, order and units of the channels, transposes, symmetry."""

import dataclasses

import control
import numpy as np
import pytest
import scipy.linalg

import robustid as rid
from robustid.identification.model import modes_of
from support.bounds import rebound
from support.cases import slow
from support.matrix_plants import random_matrix_problem, response
from support.pairwise import every_one
from support.problems import identified

OMEGA = np.linspace(0.01, 3.1, 60)
SOLVERS = "structured", "cvxpy"


def solved(problem, **options):
    return identified(problem, **({"accuracy": 1e-7, "solver": "structured"} | options))


def with_values(problem, change, **options):
    """The same with values and bounds changed by a function of arrays (F, p, q)."""
    (frf,) = problem.frequency
    bound = rid.Bound(change(frf.bound), joint=frf.bound.joint)
    new = rid.FrequencyResponse(frf.omega, change(frf.values), bound=bound, dt=frf.dt)
    return dataclasses.replace(problem, frequency=new, **options)


def values(model):
    return response(model, OMEGA)


def near(one, other, tolerance):
    """Relative to the largest."""
    np.testing.assert_allclose(one, other, rtol=0, atol=tolerance * np.abs(other).max())


@pytest.mark.parametrize(("p", "q", "solver"), every_one([(2, 1), (1, 2), (2, 2)], SOLVERS))
def test_channels_measured_as_zero_change_nothing(p, q, solver):
    """The class holds [g 0; 0 0], and each entry of it is in the ball: the margin is that of g, and so is the centre."""
    one = random_matrix_problem(2, 1, 1, 4, factor=0.9)[0]

    def padded(array):
        fill = 1.0 if np.isrealobj(array) else 0.0
        return np.pad(array, ((0, 0), (0, p - 1), (0, q - 1)), constant_values=fill)

    alone, among = (solved(item, solver=solver) for item in (one, with_values(one, padded)))
    assert alone.margin > 0.1
    assert among.margin == pytest.approx(alone.margin, rel=1e-6)
    expected = np.zeros((OMEGA.size, p, q), complex)
    expected[:, :1, :1] = values(alone.model)
    near(values(among.model), expected, 1e-6)


def test_independent_blocks():
    """The class holds the direct sum, and the blocks of its members are in their balls: the margin is the larger one.

    The signs of the channels of one block change nothing, so that the centre is block diagonal, that of each block alone.
    """
    parts = [random_matrix_problem(5, 2, 1, 3, factor=0.8)[0], random_matrix_problem(6, 1, 2, 3, factor=0.8)[0]]
    prior, omega = rid.Prior(gain_bound=1.0, decay_rate=1.1), parts[0].frequency[0].omega
    scaled = []
    for part, wide in zip(parts, (1.0, 1.3), strict=True):
        (frf,), size = part.frequency, 1 / part.prior.gain_bound
        scaled.append(rid.FrequencyResponse(omega, frf.values * size, bound=frf.bound * size * wide, dt=1.0))
    apart = [solved(rid.MixedProblem(frequency=frf, prior=prior)) for frf in scaled]
    whole = np.stack([scipy.linalg.block_diag(*pair) for pair in zip(*(f.values for f in scaled), strict=True)])
    bound = np.stack([scipy.linalg.block_diag(*pair) for pair in zip(*(f.bound for f in scaled), strict=True)])
    frf = rid.FrequencyResponse(omega, whole, bound=np.where(bound > 0, bound, 0.1), dt=1.0)
    together = solved(rid.MixedProblem(frequency=frf, prior=prior))
    margins = [result.margin for result in apart]
    assert min(margins) > 0.1
    assert margins[0] != pytest.approx(margins[1], rel=0.01)
    assert together.margin == pytest.approx(max(margins), rel=1e-6)
    found = values(together.model)
    assert np.abs(found[:, :2, 1:]).max() < 1e-6 * np.abs(found).max()
    assert np.abs(found[:, 2:, :1]).max() < 1e-6 * np.abs(found).max()
    if max(margins) <= 1:
        near(found[:, :2, :1], values(apart[0].model), 1e-6)
        near(found[:, 2:, 1:], values(apart[1].model), 1e-6)


@pytest.mark.parametrize(
    ("joint", "form"),
    [
        ("column", "orthonormal"),
        *(slow(*c) for c in (("entry", "orthonormal"), ("entry", "taylor"), ("column", "taylor"))),
    ],
)
def test_the_order_of_the_channels(form, joint):
    problem, _ = random_matrix_problem(3, 2, 3, 3, factor=0.8, rho=2.5)
    problem = dataclasses.replace(problem, frequency=rebound(problem.frequency[0], joint=joint))

    def permuted(array):
        return array[:, [1, 0]][:, :, [2, 0, 1]]

    other = with_values(problem, permuted)
    one, two = solved(problem, form=form), solved(other, form=form)
    assert one.margin > 0.1
    assert two.margin == pytest.approx(one.margin, rel=1e-7)
    near(values(two.model), permuted(values(one.model)), 1e-7)


@pytest.mark.parametrize("solver", [slow(one) if one == "cvxpy" else one for one in SOLVERS])
def test_units_of_the_channels_change_nothing(solver):
    """Powers of two, with the scaling of the prior: the same margin in every bit, and the scaled model."""
    problem, _ = random_matrix_problem(4, 2, 3, 3, factor=0.8)
    units = np.multiply.outer([2.0**20, 2.0**-7], [1.0, 2.0**-30, 2.0**3])
    ones = dataclasses.replace(problem, prior=dataclasses.replace(problem.prior, scaling=np.ones((2, 3))))
    other = with_values(problem, lambda array: array * units, prior=dataclasses.replace(problem.prior, scaling=units))
    one, same, two = (solved(item, solver=solver) for item in (problem, ones, other))
    assert one.margin > 0.1
    assert one.margin == same.margin == two.margin
    assert one.margin_lower == two.margin_lower
    np.testing.assert_array_equal(one.coefficients, two.coefficients)
    assert one.order == same.order == two.order
    np.testing.assert_allclose(values(two.model), values(one.model) * units, rtol=1e-9)


@pytest.mark.parametrize(("p", "q"), [(1, 2), slow(2, 3), slow(2, 2)])
def test_transposed_data_have_the_transposed_model(p, q):
    problem, _ = random_matrix_problem(7, p, q, 3, factor=0.8, parametric=rid.kautz(0.5, 0.1, dt=1.0))
    other = with_values(problem, lambda array: array.swapaxes(1, 2))
    one, two = solved(problem), solved(other)
    assert one.margin > 0.05
    assert two.margin == pytest.approx(one.margin, rel=1e-7)
    near(values(two.model), values(one.model).swapaxes(1, 2), 1e-7)
    near(two.parameters, one.parameters.swapaxes(1, 2), 1e-6)
    assert one.order == two.order


@pytest.mark.parametrize("side", ["right", slow("left")])
def test_unit_vectors_are_full_columns(side):
    problem, _ = random_matrix_problem(8, 3, 2, 3, factor=0.8)
    directions = problem.frequency[0].tangential(**{side: np.eye(2 if side == "right" else 3)})
    one, two = solved(problem), solved(dataclasses.replace(problem, frequency=directions))
    assert one.margin > 0.1
    assert two.margin == pytest.approx(one.margin, rel=1e-9)
    near(values(two.model), values(one.model), 1e-9)


def test_rotated_directions_are_the_same_class():
    """Orthogonal combinations of the inputs, errors of the columns as ellipsoids: the ball does not see them."""
    problem, _ = random_matrix_problem(9, 2, 2, 3, factor=0.8)
    frf = problem.frequency[0]
    Q = np.linalg.qr(np.random.default_rng(0).standard_normal((2, 2)))[0]
    shape = np.tile(np.diag([1.0, 2.0, 3.0, 4.0]) * frf.bound[0, 0, 0] ** 2, (3, 1, 1))
    turn = np.kron(Q.T, np.eye(2))  # of vec(G Q), columns stacked
    one, two = (
        solved(dataclasses.replace(problem, frequency=dataclasses.replace(frf, values=values, bound=bound)))
        for values, ellipsoid in ((frf.values, shape), (frf.values @ Q, turn @ shape @ turn.T))
        for bound in [rid.Bound(joint="matrix", ellipsoid=ellipsoid)]
    )
    assert one.margin > 0.1
    assert two.margin == pytest.approx(one.margin, rel=1e-6)
    near(values(two.model), values(one.model) @ Q, 1e-6)


# --- symmetric plants -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("form", ["orthonormal", slow("taylor")])
def test_a_reciprocal_plant(form):
    """The model is symmetric, the margin not below that of the larger class, and the truth is inside."""
    problem, truth = random_matrix_problem(10, 2, 2, 4, symmetric=True, rho=2.0)
    near(values(truth), values(truth).swapaxes(1, 2), 1e-13)
    one = solved(problem, form=form)
    free = solved(dataclasses.replace(problem, symmetric=False), form=form)
    found = values(one.model)
    near(found, found.swapaxes(1, 2), 1e-12 if form == "orthonormal" else 1e-9)
    assert free.margin - 1e-7 <= one.margin <= 1
    frf = problem.frequency[0]
    exact = dataclasses.replace(problem, frequency=dataclasses.replace(frf, values=response(truth, frf.omega)))
    assert solved(exact, form=form).margin < 1e-6


def test_asymmetric_errors_cost_a_symmetric_class():
    problem, _ = random_matrix_problem(11, 2, 2, 4, symmetric=True)
    skew = np.array([[0.0, 1.0], [-1.0, 0.0]])
    frf = problem.frequency[0]
    noisy = dataclasses.replace(frf, values=frf.values + 2.0 * frf.bound * skew)
    noisy = dataclasses.replace(problem, frequency=noisy)
    one, free = solved(noisy), solved(dataclasses.replace(noisy, symmetric=False))
    assert one.margin >= 2.0 - 1e-9  # the mean of the two entries leaves a residual of two bounds at least
    assert free.margin < one.margin
    found = values(one.model)
    near(found, found.swapaxes(1, 2), 1e-12)


def test_one_channel_is_symmetric_by_itself():
    problem, _ = random_matrix_problem(12, 1, 1, 4)
    other = dataclasses.replace(problem, symmetric=True)
    one, two = solved(problem), solved(other)
    assert one.margin == two.margin
    np.testing.assert_array_equal(values(one.model), values(two.model))


# --- one code path ------------------------------------------------------------------------------------------------------


def test_a_record_of_every_input_alone_is_the_record_of_all():
    """From rest, exact: the responses add up, so that margin 0 of the parts is margin 0 of the sum."""
    rng = np.random.default_rng(13)
    truth = random_matrix_problem(13, 2, 2, 3, rho=1.5)[1]
    prior = random_matrix_problem(13, 2, 2, 3, rho=1.5)[0].prior
    u = rng.standard_normal((8, 2))
    records = []
    for one in (u * [1, 0], u * [0, 1], u):
        y = control.forced_response(truth, inputs=one.T).outputs.T
        records.append(rid.TimeRecord(one, y, dt=1.0, bound=1e-3))
    result = solved(rid.MixedProblem(time=records, prior=prior), accuracy=1e-5)
    assert result.margin < 1e-4
    y = np.array(records[2].y)
    y[5, 1] += 2e-3  # twice the bound, spread over the record and the sum of the two others
    wrong = dataclasses.replace(records[2], y=y)
    result = solved(rid.MixedProblem(time=[*records[:2], wrong], prior=prior), accuracy=1e-5)
    assert result.margin == pytest.approx(2 / 3, abs=1e-4)


def test_pick_of_one_exact_matrix():
    """One value W at z = 1 (real): margin s with ||W'|| = K, |W - W'| <= s b; of W = w U, U orthogonal, known."""
    U = np.linalg.qr(np.random.default_rng(14).standard_normal((2, 2)))[0]
    frf = rid.FrequencyResponse([0.0], [1.5 * U], bound=rid.Bound(joint="matrix", ellipsoid=[np.eye(4) * 0.01]), dt=1.0)
    result = solved(rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=1.0, decay_rate=1.2)))
    # The nearest contraction in the Frobenius norm is U: |0.5 U|_F = 0.5 sqrt(2), in units of 0.1.
    assert result.margin == pytest.approx(5 * np.sqrt(2), rel=1e-6)


@pytest.mark.parametrize("delay", range(4))
def test_modes_have_the_residues_of_their_poles(delay):
    """Against Cauchy's integral around each pole; those of repeated poles are left out."""
    basis = rid.kautz([0.7, 1.5], [0.003, 0.02], dt=1.0, delay=delay)
    residues = np.random.default_rng(15).standard_normal((basis.size, 2, 3))
    found = modes_of(basis, residues)
    np.testing.assert_allclose([mode.omega for mode in found], [0.7, 1.5])
    for mode in found:
        pole = np.exp(mode.omega * (-mode.damping + 1j * np.sqrt(1 - mode.damping**2)))
        ring = 1e-4 * np.exp(2j * np.pi * np.arange(16) / 16)
        states = np.linalg.inv((pole + ring)[:, None, None] * np.eye(len(basis.A)) - basis.A)
        values = basis.D[:, 0] + (basis.C @ states @ basis.B)[..., 0]
        near(mode.residue, np.tensordot((ring @ values) / 16, residues, 1), 1e-10)
        sizes = np.linalg.svd(mode.residue, compute_uv=False)
        assert mode.rank_ratio == pytest.approx(sizes[1] / sizes[0])
    for repeat in (2, 3):
        basis = rid.kautz([0.7, 1.5], [0.003, 0.02], dt=1.0, delay=delay, repeat=repeat)
        assert modes_of(basis, np.ones((basis.size, 2, 2))) == ()
