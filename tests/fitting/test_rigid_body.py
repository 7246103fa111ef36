"""Rigid-body modes: exact by structure, found from the data, worth their variance."""

import dataclasses

import control
import numpy as np
import pytest
import scipy.linalg
import scipy.signal

import robustid as rid
from robustid.fitting import FractionProblem, RigidBody, StaticGain, Weight, fit_mfd, polynomial_nodes, sk_step
from robustid.fitting.fraction.conditions import RigidModes
from support.cases import slow
from support.mfd_systems import OMEGA as FEW
from support.mfd_systems import noisy, random_modal_system, relative_error
from support.refusals import refusals

OMEGA = 2 * np.pi * np.geomspace(2, 1500, 130)
DT = 1 / 4000
# outputs, inputs, rigid-body modes, flexible modes, side, sample time
CASES = [
    slow(4, 4, 3, 5, "input", None),
    slow(4, 4, 1, 7, "input", None),
    slow(4, 4, 2, 6, "input", None),  # its optimum is far: ten times the others
    slow(4, 4, 1, 5, "input", None),
    slow(3, 3, 3, 3, "input", None),
    (3, 3, 2, 2, "input", None),
    (1, 1, 1, 3, "input", None),
    slow(2, 4, 1, 7, "input", None),
    slow(4, 4, 3, 5, "output", None),
    slow(2, 2, 2, 4, "input", DT),
    (2, 2, 2, 1, "input", DT),
    slow(3, 3, 1, 5, "input", DT),
    slow(4, 2, 1, 3, "output", DT),
    (3, 2, 1, 2, "output", DT),
]


@dataclasses.dataclass(frozen=True)
class Machine:
    """Undamped rigid-body modes with dense directions and lightly damped flexible ones, as a state space."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    drives: np.ndarray  # of the rigid-body modes, (count, nu)
    shapes: np.ndarray  # (ny, count)
    dt: float | None

    @property
    def order(self):
        return len(self.A)

    def response(self, omega):
        points = 1j * omega if self.dt is None else np.exp(1j * omega * self.dt)
        return self.C @ np.linalg.solve(points[:, None, None] * np.eye(self.order) - self.A, self.B.astype(complex))


def machine(seed, ny, nu, count, modes, dt=None):
    rng = np.random.default_rng(seed)
    frequency = 2 * np.pi * np.exp(rng.uniform(*np.log((30, 1000)), modes))
    damping = rng.uniform(0.005, 0.02, modes)
    unit = 2 * np.pi * 30
    drives, shapes = rng.standard_normal((count, nu)), rng.standard_normal((ny, count))
    blocks = [w * np.array([[0, 1], [-1, -2 * zeta]]) for w, zeta in zip(frequency, damping, strict=True)]
    A = scipy.linalg.block_diag(*blocks, unit * np.eye(2 * count, k=count))
    B, C = np.zeros((len(A), nu)), np.zeros((ny, len(A)))
    B[1 : 2 * modes : 2] = frequency[:, None] * rng.standard_normal((modes, nu))
    C[:, : 2 * modes : 2] = 0.3 * rng.standard_normal((ny, modes))
    B[2 * modes + count :], C[:, 2 * modes : 2 * modes + count] = unit * drives, shapes
    if dt is not None:
        A, B, C = scipy.signal.cont2discrete((A, B, C, np.zeros((ny, nu))), dt)[:3]
    return Machine(A, B, C, drives, shapes, dt)


def fitted(plant, seed, level, count, *, omega=OMEGA, **settings):
    truth = plant.response(omega)
    values = noisy(np.random.default_rng([seed, 1]), truth, level) if level else truth
    frf = rid.FrequencyResponse(omega, values, dt=plant.dt)
    body = settings.pop("rigid_body", RigidBody(count, side=settings.pop("side", "input")))
    settings = {"order": plant.order, "weight": 100 / np.abs(truth), "rigid_body": body} | settings
    return fit_mfd(frf, **settings), truth


def angle(found, true):
    """Sine of the angle between two row spaces."""
    return np.sin(np.max(scipy.linalg.subspace_angles(found.T, true.T)))


def check_structure(fit, count):
    """2 count poles and rank deficiency count, exactly, read from the zeros of A and not from an eigenvalue routine."""
    origin = 0.0 if fit.problem.dt is None else 1.0
    A = np.asarray(fit.model.A)
    flexible = len(A) - 2 * count
    N = A[flexible:, flexible:] - origin * np.eye(2 * count)
    assert not np.any(A[:flexible, flexible:])
    assert not np.any(A[flexible:, :flexible])
    assert not np.any(N @ N)
    assert np.linalg.matrix_rank(N) == count
    rest = np.linalg.svd(A[:flexible, :flexible] - origin * np.eye(flexible), compute_uv=False)
    assert rest[-1] > 1e-6 * rest[0]
    assert np.array_equal(fit.fraction.poles[flexible:], np.full(2 * count, origin))
    poles = np.linalg.eigvals(A[:flexible, :flexible])
    assert np.all(poles.real < 0 if fit.problem.dt is None else np.abs(poles) < 1)
    assert fit.stable


@pytest.mark.parametrize("seeds", [1, slow(2)])
@pytest.mark.parametrize(("ny", "nu", "count", "modes", "side", "dt"), CASES)
def test_rigid_poles_are_exact_and_directions_found(ny, nu, count, modes, side, dt, seeds):
    """1 % noise: structure, error at the statistical floor, directions within 1 %; without noise the response itself."""
    for seed in range(seeds):
        plant = machine(seed, ny, nu, count, modes, dt)
        fit, truth = fitted(plant, seed, 0.01, count, side=side)
        check_structure(fit, count)
        assert fit.model.nstates == plant.order
        assert relative_error(fit.fraction.response(OMEGA), truth) <= 3e-3
        assert fit.fraction.error <= 1e-6
        assert np.all(fit.condition_numbers - 1 <= 1e-12)
        found, true = fit.rigid_directions, plant.drives
        if side == "output":
            found, true = found.T, plant.shapes.T
        assert angle(found, true) <= 1e-2
        exact, _ = fitted(plant, seed, 0.0, count, side=side)
        check_structure(exact, count)
        assert relative_error(exact.fraction.response(OMEGA), truth) <= 1e-8


@pytest.mark.parametrize(("seeds", "modes"), [(1, 2), slow(3, 5)])
def test_directions_are_refined_with_less_noise(seeds, modes):
    """Angle to the truth proportional to the noise, for every machine."""
    for seed in range(seeds):
        plant = machine(seed, 3, 3, 1, modes)
        fits = [fitted(plant, seed, level, 1)[0] for level in (1e-2, 1e-3, 1e-4)]
        angles = [angle(fit.rigid_directions, plant.drives) for fit in fits]
        assert angles[1] <= 0.2 * angles[0]
        assert angles[2] <= 0.2 * angles[1]


def test_given_directions_are_held_exactly():
    plant = machine(0, 3, 4, 2, 6)
    fit, truth = fitted(plant, 0, 0.01, 2, rigid_body=RigidBody(2, directions=plant.drives))
    check_structure(fit, 2)
    assert angle(fit.rigid_directions, plant.drives) <= 1e-14
    chains = np.asarray(fit.model.B)[-4:]
    assert not np.any(chains[:2])  # positions are not driven
    assert angle(chains[2:], plant.drives) <= 1e-14
    assert relative_error(fit.fraction.response(OMEGA), truth) <= 2e-3


@pytest.mark.parametrize(("ny", "nu", "count", "modes"), [(1, 1, 1, 3), (2, 2, 2, 2), (2, 2, 1, 3), slow(2, 2, 2, 4)])
def test_factor_inside(ny, nu, count, modes):
    """With as many modes as inputs both factors are the same set; else the poles are exact all the same."""
    plant = machine(1, ny, nu, count, modes)
    fit, truth = fitted(plant, 1, 0.01, count, rigid_body=RigidBody(count, factor="inside"))
    check_structure(fit, count)
    assert fit.rigid_directions is None
    if count == nu:
        other, _ = fitted(plant, 1, 0.01, count)
        assert fit.cost == pytest.approx(other.cost, rel=1e-6)
        assert relative_error(fit.fraction.response(OMEGA), truth) <= 3e-3


@pytest.mark.parametrize(("seeds", "lines"), [(5, 130), slow(40, 200)])
def test_variance_at_low_frequency_is_lower_than_without(seeds, lines):
    """2x2, noise realisations: lower error in the lowest quarter of the lines in all but one, and rms at most two thirds."""
    omega, low = 2 * np.pi * np.geomspace(2, 1500, lines), slice(lines // 4)
    plant, pairs = machine(2, 2, 2, 1, 3), []
    for seed in range(seeds):
        fit, truth = fitted(plant, seed, 0.01, 1, omega=omega)
        free, _ = fitted(plant, seed, 0.01, 1, omega=omega, rigid_body=None, start=fit.model, stable=False)
        assert free.cost <= fit.cost * (1 + 1e-9)
        pairs.append([relative_error(f.fraction.response(omega[low]), truth[low]) for f in (fit, free)])
    rigid, without = np.array(pairs).T
    assert np.sum(rigid < without) >= seeds - 1
    assert np.linalg.norm(rigid) <= 2 / 3 * np.linalg.norm(without)


@pytest.mark.parametrize(("size", "order"), [(1, 4), (2, 8)])
def test_sk_step_against_constrained_least_squares_in_monomials(size, order):
    """The same step, written down with powers and solved in the null space of the constraint: equal D and N."""
    omega = np.geomspace(0.1, 1.0, 40)
    plant = machine(3, size, size, 1, order // 2 - 1)
    values = noisy(np.random.default_rng(3), plant.response(2 * np.pi * 300 * omega), 0.05)
    weight = Weight.relative(values)
    directions = np.hstack([[[1.0]], np.full((1, size - 1), 0.7)])
    problem = FractionProblem(omega, values, order, weight)
    problem = dataclasses.replace(problem, rigid=RigidModes(directions, np.array([0]), True, False))
    xi, _ = polynomial_nodes(omega, None)
    old = np.array([np.eye(size) * (x**2 + 0.3 * x + 0.2) + 0.1 * x for x in xi])
    fraction, condition = sk_step(problem, old)

    degree = order // size
    rows, fixed = [], []
    for k, x in enumerate(xi):
        left = np.hstack([values[k], -np.eye(size)])
        W = np.diag(weight.entries[k].T.ravel()) @ np.kron(np.linalg.inv(old[k]).T, left)
        rows.append(np.hstack([W * x**power for power in range(degree)]))
        fixed.append(W @ np.eye(2 * size, size).T.ravel() * x**degree)
    rows, fixed = np.concatenate(rows), np.concatenate(fixed)
    rows, fixed = np.vstack([rows.real, rows.imag]), np.concatenate([fixed.real, fixed.imag])
    # directions D_0 = directions D_1 = 0; unknowns vec([D; N]) by power
    one = np.kron(np.eye(size), np.hstack([directions, np.zeros((1, size))]))
    allowed = scipy.linalg.null_space(np.kron(np.eye(2, degree), one))
    c = allowed @ np.linalg.lstsq(rows @ allowed, -fixed, rcond=None)[0]
    powers = np.concatenate([c.reshape(degree, size, 2 * size).transpose(0, 2, 1), np.eye(2 * size, size)[None]])
    X = np.einsum("pk,pij->kij", xi ** np.arange(degree + 1)[:, None], powers)
    np.testing.assert_allclose(fraction.denominators, X[:, :size], rtol=0, atol=1e-8 * np.abs(X).max())
    np.testing.assert_allclose(fraction.numerators, X[:, size:], rtol=0, atol=1e-8 * np.abs(X).max())
    assert condition - 1 <= 1e-12


def fitted_with(body, *, omega=OMEGA, **options):
    frf = rid.FrequencyResponse(omega, machine(0, 2, 3, 1, 2).response(OMEGA))
    return fit_mfd(frf, **{"order": 6, "rigid_body": body} | options)


test_bad_input = refusals(
    (lambda: RigidBody(0), "count"),
    (lambda: RigidBody(1, side="both"), "side"),
    (lambda: RigidBody(1, factor="beside"), "factor"),
    (lambda: RigidBody(2, directions=np.ones((1, 3))), "directions"),
    (lambda: RigidBody(2, directions=[[1.0, 2.0], [2.0, 4.0]]), "independent"),
    (lambda: RigidBody(1, directions=[[1.0, np.nan]]), "directions"),
    (lambda: RigidBody(1, directions=[[1.0, 2.0]], factor="inside"), "directions"),
    (lambda: fitted_with(RigidBody(4)), "inputs"),
    (lambda: fitted_with(RigidBody(3)), "outputs"),
    (lambda: fitted_with(RigidBody(3, side="output")), "outputs"),
    (lambda: fitted_with(RigidBody(2), order=3), "order"),
    (lambda: fitted_with(RigidBody(1, directions=[[1.0, 2.0]])), r"shape \(1, 3\) for 3 inputs"),
    (lambda: fitted_with(RigidBody(1, directions=[[1.0, 2.0, 3.0, 4.0]])), r"got \(1, 4\)"),
    (
        lambda: fitted_with(RigidBody(1, directions=np.ones((3, 1)), side="output")),
        r"shape \(2, 1\) for 2 outputs; got \(3, 1\)",
    ),
    (lambda: fitted_with(RigidBody(1), form="left"), "form"),
    (lambda: fitted_with(RigidBody(1, side="output"), form="right"), "form"),
    (lambda: fitted_with(RigidBody(1), start=control.rss(1, 2, 3)), "`start` must have at least 2 states"),
    (lambda: fitted_with(3), "3 modes, more than there are outputs"),
    (lambda: fitted_with(RigidBody(1), constraints=[StaticGain(np.ones((2, 3)))]), "static"),
    (lambda: fitted_with(RigidBody(1), omega=OMEGA - OMEGA[0]), "0 Hz"),
)


@pytest.mark.parametrize("seeds", [1, slow(3)])
def test_an_input_and_an_output_that_the_rigid_body_does_not_see(seeds):
    """A piezo pair whose response is 1e-5 of the rigid body's: directions to 1e-3 of its own size, all seeds."""
    for seed in range(seeds):
        plant = machine(seed, 3, 3, 2, 4)
        B, C = plant.B.copy(), plant.C.copy()
        B[-2:, 2], C[2, -4:-2] = 0.0, 0.0
        B[:, 2], C[2] = 1e-2 * B[:, 2], 1e-2 * C[2]
        plant = dataclasses.replace(plant, B=B, C=C)
        fit, truth = fitted(plant, seed, 0.01, 2)
        check_structure(fit, 2)
        assert relative_error(fit.fraction.response(OMEGA), truth) <= 3e-3
        assert np.abs(np.linalg.solve(fit.rigid_directions[:, :2], fit.rigid_directions)[:, 2]).max() <= 1e-3 * 1e-2


@pytest.mark.parametrize("form", ["right", pytest.param("left", marks=pytest.mark.slow)])
def test_decoupling_shows_the_rigid_body_alone(form):
    rng = np.random.default_rng(0)
    directions, shapes = rng.standard_normal((2, 3)), rng.standard_normal((4, 2))
    s = 1j * FEW[:, None, None]
    flexible = random_modal_system(1, 4, 3, 3)
    truth = 1e4 * shapes @ directions / s**2 + flexible.response(1j * FEW)
    body = rid.RigidBody(2, side="input" if form == "right" else "output")
    fit = fit_mfd(rid.FrequencyResponse(FEW, truth), order=10, rigid_body=body)
    T_y, T_u = fit.decoupling
    rest = T_y @ fit.model(1e-4j) @ T_u * 1e-4j**2  # far below the first mode
    expected = np.zeros((4, 3))
    expected[:2, :2] = np.eye(2)
    np.testing.assert_allclose(rest, expected, atol=1e-7)


@pytest.mark.parametrize("dt", [None, 0.01])
def test_a_rigid_body_alone_has_nothing_to_refine(dt):
    omega = np.geomspace(1, 100, 60)
    s = 1j * omega
    plant = 1 / s**2 if dt is None else dt**2 / 2 * (np.exp(s * dt) + 1) / (np.exp(s * dt) - 1) ** 2
    noise = 1 + 0.01 * np.random.default_rng(0).standard_normal(60)
    frf = rid.FrequencyResponse(omega, plant * noise, dt=dt)
    fit = rid.fit_mfd(frf, order=2, rigid_body=rid.RigidBody(1))
    np.testing.assert_allclose(fit.poles, 0 if dt is None else 1, atol=1e-12)
    assert np.sqrt(fit.cost / 60) < 0.02
