"""Supports of the entries of matrices: an independent judge, closed forms, parts of the problem, laws, both forms."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.guarantees import consistent_set
from robustid.guarantees.polygons import value_sets_at
from robustid.guarantees.value_set import along
from robustid.identification.formulation import parts_of
from support.cases import slow
from support.matrix_plants import discs_of, random_matrix_problem, unknowns_of


def judge_support(problem, omega, entry, angle):
    """max Re(exp(-j angle) F_ab) over Pick's matrix with one more complex node, with cvxpy's own norms, by Clarabel."""
    import cvxpy as cp

    lines = np.unique(np.concatenate([[omega], *(f.omega for f in problem.frequency)]))
    contraction, F, _ = unknowns_of(problem, lines, 0)
    p, q, size = F.shape[1:]
    n, unknown = 2 * lines.size, cp.Variable(size)
    limits = [cp.sigma_max(cp.reshape(contraction @ unknown, (n * q, n * p), order="C")) <= 1]
    if problem.symmetric:
        parts = [(part - part.swapaxes(1, 2)).reshape(-1, size) for part in (F.real, F.imag)]
        limits += [part @ unknown == 0 for part in parts]
    for experiment in problem.frequency:
        for y, A in discs_of(experiment, F[np.searchsorted(lines, experiment.omega)]):
            limits.append(cp.norm(cp.hstack([part(y) - part(A) @ unknown for part in (np.real, np.imag)])) <= 1)
    row = np.real(np.exp(-1j * angle) * F[np.searchsorted(lines, omega)][entry])
    program = cp.Problem(cp.Maximize(row @ unknown), limits)
    program.solve(solver="CLARABEL")
    return float(program.value)


@pytest.mark.filterwarnings("ignore:Solution may be inaccurate")
@pytest.mark.parametrize(
    ("p", "q", "options"),
    [
        slow(2, 2, {}),
        slow(2, 2, {"symmetric": True}),
        (2, 1, {"parametric": rid.kautz([0.8], [0.1], dt=1.0, delay=1)}),
        (1, 2, {"scaled": True}),
        slow(3, 2, {}),
        slow(2, 2, {"scaled": True, "symmetric": True}),
        slow(2, 2, {"parametric": rid.kautz([0.8], [0.1], dt=1.0, delay=1)}),
    ],
)
def test_the_judge_finds_the_same_support_of_every_entry(p, q, options):
    """Pick's matrix at complex nodes, cvxpy: 1e-5 of the size, from above for the certificate and from below for the member."""
    options = dict(options)
    scaled = options.pop("scaled", False)
    problem, _ = random_matrix_problem(2, p, q, 2, rho=1.4, **options)
    if scaled:
        scaling = np.full((p, q), 2.0)
        scaling[0, -1] = 1.0 if p != q else 2.0
        scaling[-1, -1] = 3.0
        problem = problem.with_prior(scaling=scaling)
    omega = 2.2
    consistent = consistent_set(rid.identify(problem))
    here = consistent.with_node(omega)
    for found in value_sets_at(consistent, omega, 3, 1e-3):
        size = np.abs(found.support).max()
        weights = here.value_weights(omega, found.entry)
        for k, angle in enumerate(found.directions):
            judge, extreme = (
                judge_support(problem, omega, found.entry, angle),
                here.extreme(along(angle, *weights), 1e-7),
            )
            assert extreme.upper == pytest.approx(judge, abs=1e-5 * size)
            assert extreme.attained == pytest.approx(judge, abs=1e-5 * size)
            assert extreme.attained <= extreme.upper
            assert found.support[k] >= judge - 1e-5 * size
            reached = np.real(np.exp(-1j * angle) * found.matrices[:, *found.entry])
            assert np.nanmax(reached) <= judge + 1e-5 * size


@pytest.mark.parametrize(
    "options", [slow({}), {"symmetric": True}, {"parametric": rid.kautz([0.8], [0.1], dt=1.0, delay=1)}]
)
def test_entries_alone_are_bounded_from_above(options):
    """A part of the problem sees the samples of one entry: its bound is proved, and nowhere below that of all of it."""
    problem, _ = random_matrix_problem(2, 2, 2, 2, rho=1.4, **options)
    here = consistent_set(rid.identify(problem)).with_node(2.2)
    for entry in ((0, 0), (0, 1), (1, 1)):
        for angle in (0.4, 2.5):
            functional = along(angle, *here.value_weights(2.2, entry))
            part, whole = here.bounded(functional, 1e-6), here.extreme_of_all(functional, 1e-6)
            size = abs(whole.upper - functional(here.center.x, here.center.p))
            assert part.certificate.verify(functional, here.data.rows, here.data.sarason)
            assert part.upper >= whole.attained
            assert part.upper <= whole.upper + 0.5 * size
            assert not here.bounded(functional_of_two(here), 1e-6)


def functional_of_two(here):
    """A functional that no part sees alone."""
    x, p, tail = (a + b for a, b in zip(*(here.value_weights(2.2, entry) for entry in ((0, 0), (1, 1))), strict=True))
    return along(0.3, x, p, tail)


def test_parts_are_samples_that_no_other_entry_shares():
    problem, _ = random_matrix_problem(6, 2, 2, 2, rho=1.4)
    data = rid.identify(problem).formulation.data
    assert [(part.outputs.tolist(), part.inputs.tolist()) for part in parts_of(data)] == [
        ([i], [j]) for i in (0, 1) for j in (0, 1)
    ]
    record = rid.TimeRecord(np.eye(3, 2), np.zeros((3, 2)), dt=1.0, bound=10.0)
    rows = rid.identify(dataclasses.replace(problem, time=record)).formulation.data
    assert [(part.outputs.tolist(), part.inputs.tolist()) for part in parts_of(rows)] == [([0], [0, 1]), ([1], [0, 1])]
    line = rid.FrequencyResponse([2.9], np.zeros((1, 2, 2)), bound=10.0, dt=1.0).tangential(left=[1.0, 1.0])
    columns = rid.identify(dataclasses.replace(problem, frequency=(*problem.frequency, line))).formulation.data
    assert [(part.outputs.tolist(), part.inputs.tolist()) for part in parts_of(columns)] == [
        ([0, 1], [0]),
        ([0, 1], [1]),
    ]
    both = dataclasses.replace(problem, frequency=(*problem.frequency, line), time=record)
    assert parts_of(rid.identify(both).formulation.data) == ()
    for part in parts_of(rows):
        x, p = np.random.default_rng(0).standard_normal((2, rows.sarason.size)), np.zeros((2, 0))
        mine = part.restricted(x[0], p[0])
        everywhere = part.replaced(0 * x[1], p[1], mine)
        here = (part.data.rows.E @ mine[0], (rows.rows.E @ everywhere[0])[part.samples])
        np.testing.assert_allclose(*here, atol=1e-12)
        assert part.data.sarason.norm(mine[0]) == pytest.approx(rows.sarason.norm(everywhere[0]))


def test_no_data_gives_the_scaled_gain_bound_and_the_lens_of_every_entry():
    """As of one channel: K s_ab; imaginary direction K s_ab (1 - sqrt(1 - s^2))/s, s = 2 |Im zeta|/|1 - zeta^2|."""
    K, rho, omega, scales = 2.0, 1.2, 1.2, np.array([[1.0, 3.0], [0.5, 2.0]])
    frf = rid.FrequencyResponse([0.0], np.zeros((1, 2, 2)), bound=100.0, dt=1.0)
    problem = rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=K, decay_rate=rho, scaling=scales))
    zeta = np.exp(-1j * omega) / rho
    s = 2 * abs(zeta.imag) / abs(1 - zeta**2)
    side = (1 - np.sqrt(1 - s**2)) / s
    for found in value_sets_at(consistent_set(rid.identify(problem)), omega, 4, 1e-8):
        wanted = K * scales[found.entry] * np.array([1, side, 1, side])
        assert found.support == pytest.approx(wanted, rel=1e-6)
        assert np.all(found.support >= wanted)


def test_coupling_the_channels_of_a_diagonal_plant_costs_nothing():
    """sigma_max(G) <= K implies |G_ii| <= K: the sets of the coupled problem are parts of those of the separate ones."""
    problem, _ = random_matrix_problem(1, 2, 2, 3, rho=1.3)
    frf = problem.frequency[0]
    frf = dataclasses.replace(frf, values=frf.values * np.eye(2))
    problem = dataclasses.replace(problem, frequency=frf)
    together = value_sets_at(consistent_set(rid.identify(problem)), 2.4, 3, 1e-5)
    for found in together:
        one = rid.MixedProblem(frequency=frf.entry(*found.entry), prior=problem.prior)
        (alone,) = value_sets_at(consistent_set(rid.identify(one)), 2.4, 3, 1e-5)
        assert np.all(found.support <= alone.support + 1e-4 * np.abs(alone.support).max())


def test_permuted_channels_give_permuted_sets():
    problem, _ = random_matrix_problem(3, 2, 1, 2, rho=1.4)
    frf = problem.frequency[0]
    turned = dataclasses.replace(problem, frequency=dataclasses.replace(frf, values=frf.values[:, ::-1]))
    sets = [value_sets_at(consistent_set(rid.identify(one)), 2.5, 3, 1e-5) for one in (problem, turned)]
    first, second = ({v.entry: v for v in found} for found in sets)
    for (a, b), found in second.items():
        assert found.support == pytest.approx(first[1 - a, b].support, abs=1e-4 * np.abs(found.support).max())


def test_the_taylor_form_encloses_the_exact_one():
    """Its supports are above what the exact form attains, and what it attains below the supports of the exact form."""
    problem, _ = random_matrix_problem(4, 2, 2, 2, rho=3.0)
    results = [rid.identify(problem, form=form) for form in ("orthonormal", "taylor")]
    exact, taylor = (value_sets_at(consistent_set(result), 2.0, 3, 1e-4) for result in results)
    for one, two in zip(exact, taylor, strict=True):
        turn = np.exp(-1j * one.directions)[:, None]
        size = np.abs(one.support).max()
        assert np.all(two.support >= np.nanmax(np.real(turn * one.matrices[:, *one.entry]), axis=1))
        assert np.all(np.nanmax(np.real(turn * two.matrices[:, *one.entry]), axis=1) - two.slack <= one.support)
        assert two.support == pytest.approx(one.support, abs=1e-2 * size)
        assert two.slack < 1e-2 * size
