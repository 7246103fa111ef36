"""State-space model of a matrix fraction, through orthonormal polynomials and never through monomials."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg

from robustid.core import Frozen, StateMatrices, freeze, input_states, lengths, points_of, response_at
from robustid.errors import InputError
from robustid.fitting.fraction.fraction_forms import fitted, oriented, shared_model
from robustid.fitting.fraction.fraction_problem import FractionProblem
from robustid.fitting.fraction.krylov_blocks import stacked, times_xi
from robustid.fitting.fraction.node_fraction import NodeFraction
from robustid.fitting.fraction.vector_polynomials import VectorPolynomials, orthonormal_polynomials, polynomial_nodes
from robustid.fitting.state_space.integrator_chains import split_rigid

if TYPE_CHECKING:
    import control


@dataclasses.dataclass(frozen=True, eq=False)
class FractionModel(Frozen):
    """A fraction with its minimal realisation ``P = N D^{-1} = C (xi I - A)^{-1} B + D_0`` (on the basis of `bultheel2005`):
    ``x = Pi w``, ``u = D w``, ``y = N w``, Pi (order x nu) of column degrees below those of D, orthonormal for ``Pi D^{-1}`` on
    the data. ``xi Pi = A Pi + B D``, ``N = C Pi + D_0 D``; A is block Hessenberg (comrade form).
    """

    A: np.ndarray  # A to D are in the unit of the nodes, of the right fraction; of size = McMillan degree
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    basis: VectorPolynomials
    degrees: np.ndarray  # (nu,) row degrees of D
    scale: float  # s = scale*xi; 1 in discrete time
    dt: float | None
    # "left": of the transposed data, P^T; "shared": of their entries as one column; `model`, `response`, `numerator`
    # and `denominator` are those of the data
    form: str
    # Largest difference from N D^{-1} at the frequency points, relative to its norm there; measured on noisy 4 x 4
    # systems of order 40: below 1e-8.
    error: float
    select: np.ndarray | None = None  # Pi = basis select (basis.size, order), row by row; None: the basis itself
    # With rigid-body modes or modal structure: the state space in s or z that has these exactly, chains of
    # integrators last; `model`, `poles` and `response` are taken from it.
    rigid: StateMatrices | None = None
    rigid_count: int = 0
    shape: tuple[int, int] | None = None  # (ny, nu) of the data where poles are shared

    def __post_init__(self) -> None:
        self._set(**{name: freeze(getattr(self, name)) for name in (*"ABCD", "degrees")})

    @property
    def matrices(self) -> StateMatrices:
        """The state space in s or z, of the right fraction."""
        if self.rigid is not None:
            return self.rigid
        return StateMatrices(self.scale * self.A, self.scale * self.B, self.C, self.D)

    @property
    def model(self) -> control.StateSpace:
        """The model as a `control.StateSpace`."""
        import control

        matrices = self.matrices
        if self.form == "left":
            matrices = matrices.transposed()
        elif self.form == "shared" and self.shape is not None:
            matrices = shared_model(matrices, self.shape)
        return control.ss(*matrices, 0 if self.dt is None else self.dt)

    @property
    def poles(self) -> np.ndarray:
        """Poles in s (rad/s) or z; those of rigid-body modes, exact, last."""
        A = self.matrices.A
        flexible = len(A) - 2 * self.rigid_count
        origin = 0.0 if self.dt is None else 1.0
        return np.concatenate([np.linalg.eigvals(A[:flexible, :flexible]), np.full(2 * self.rigid_count, origin)])

    def response(self, omega: np.ndarray) -> np.ndarray:
        """Frequency response (F, ny, nu) at omega in rad/s."""
        omega = np.asarray(omega, dtype=float)
        return self.oriented(response_at(self.matrices, points_of(omega, self.dt)))

    def denominator(self, points: np.ndarray) -> np.ndarray:
        """D at complex points s or z: (m, nu, nu), (m, ny, ny) of a left fraction, (m, 1, 1) of shared poles; monic in s/scale."""
        values = self._fraction(points)[0]
        return values.transpose(0, 2, 1) if self.form == "left" else values

    def numerator(self, points: np.ndarray) -> np.ndarray:
        """N at complex points s or z: (m, ny, nu)."""
        return self.oriented(self._fraction(points)[1])

    def oriented(self, array: np.ndarray) -> np.ndarray:
        """Entries of the right fraction that was fitted as those of the data (F, ny, nu)."""
        return oriented(array, self.form, self.shape)

    def fitted(self, array: np.ndarray) -> np.ndarray:
        """Entries of the data (F, ny, nu) as those of the right fraction that was fitted."""
        return fitted(array, self.form)

    @property
    def states_in_all(self) -> int:
        """Number of states of `model`: that of the poles, times the smaller number of signals where they are shared."""
        return len(self.A) * (min(self.shape) if self.form == "shared" and self.shape is not None else 1)

    def states(self, xi: np.ndarray) -> np.ndarray:
        """Pi^T at points in the unit of the nodes, (m, nu, order)."""
        values = self.basis.polynomials(xi)
        return values if self.select is None else values @ self.select

    def _fraction(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        xi = np.asarray(points, dtype=complex) / self.scale
        Pi = self.states(xi).transpose(0, 2, 1)
        # Rows of degree 0 of D are rows of the identity; the others follow from xi Pi = A Pi + B D.
        free = self.degrees > 0
        D = np.broadcast_to(np.eye(free.size, dtype=complex), (xi.size, free.size, free.size)).copy()
        last = slice(None) if self.select is not None else self.basis.blocks[-1].here
        rest = xi[:, None, None] * Pi[:, last] - self.A[last] @ Pi - self.B[last][:, ~free] @ D[:, ~free]
        D[:, free] = np.linalg.pinv(self.B[last][:, free]) @ rest
        return D, self.C @ Pi + self.D @ D


def realise(problem: FractionProblem, fraction: NodeFraction, *, form: str = "right") -> FractionModel:
    """State-space model of a fraction that is known by its values at the frequency points, of the order of the problem that it
    was fitted to: for "left" the transposed problem, for "shared" the stacked one. `error` says how well it reproduces the
    fraction.
    """
    response = fraction.response
    lines, ny, nu = response.shape
    size = np.linalg.norm(response, axis=(1, 2))
    # Every point with its own size: a mode far below the highest is as exact as that one.
    line = 1.0 / np.maximum(size, np.finfo(float).tiny ** 0.5 + 1e-12 * size.max())
    line = (line / np.linalg.norm(line))[:, None, None]
    weighted = line * np.linalg.inv(fraction.denominators).transpose(0, 2, 1)
    constants = stacked(np.broadcast_to(line * np.eye(nu), (lines, nu, nu)).astype(complex))
    low = problem.tied[1]
    limits = problem.degrees - 1
    limits[low] += 1
    basis = orthonormal_polynomials(weighted, problem.xi, limits)
    select = _tied(problem, fraction, basis) if low.size else None
    states = basis.values if select is None else basis.values @ select
    columns = np.hstack([states, constants])
    A, B = np.zeros((problem.order, problem.order)), np.zeros((problem.order, nu))
    last = slice(0, None)
    if select is None:
        # xi Pi of every block but the last one is in the recursion: (xi Phi, new components) = Phi G.
        for G, (before, here, _) in zip(basis.recursion[1:], basis.blocks[1:], strict=True):
            A[before, : here.stop] = G[:, : before.stop - before.start].T
        last = basis.blocks[-1].here
    solution = np.linalg.lstsq(columns, times_xi(basis.xi, states[:, last]), rcond=None)[0]
    A[last], B[last] = solution[: problem.order].T, solution[problem.order :].T
    outputs = stacked((line * response).transpose(0, 2, 1))
    C, D = np.zeros((ny, problem.order)), np.zeros((ny, nu))
    if problem.feedthrough:
        solution = np.linalg.lstsq(columns, outputs, rcond=None)[0]
        C[:], D[:] = solution[: problem.order].T, solution[problem.order :].T
    else:
        C[:] = (states.T @ outputs).T
    outputs = _held_outputs(problem, StateMatrices(A, B, C, D))
    scale = polynomial_nodes(problem.omega, problem.dt)[1]
    model = FractionModel(A, B, outputs, D, basis, problem.degrees, scale, problem.dt, form, 0.0, select)
    if problem.rigid is not None:
        count = problem.rigid.count
        directions = fraction.held.directions if problem.rigid.outside else None
        rigid = split_rigid(model.matrices, count, problem.origin, directions)
        model = dataclasses.replace(model, rigid=rigid, rigid_count=count)
    points = scale * basis.xi
    difference = np.linalg.norm(response_at(model.matrices, points) - response, axis=(1, 2))
    return dataclasses.replace(model, error=float(np.max(difference / np.maximum(size, 1e-12 * size.max()))))


def _held_outputs(problem: FractionProblem, model: StateMatrices) -> np.ndarray:
    """C moved as little as it takes to meet the conditions on the response, and the roll-off, to rounding: the states are
    orthonormal at the frequency points, so that the smallest change of C is the smallest change of the response.
    """
    A, B, C, D = model
    nu = B.shape[1]
    rows: list[np.ndarray] = []
    right: list[np.ndarray] = []
    for condition in problem.conditions:
        ((left, _),) = condition.terms
        # Not `response_at`: at a real point the imaginary rows must be zero exactly.
        (states,) = input_states(A, B, [condition.point])
        # left [I; P] = 0 with P = C states + D, as equations on vec C
        both = np.asarray(np.kron(states.T, left[:, nu:]), dtype=np.complex128)
        fixed = -(left[:, :nu] + left[:, nu:] @ D).T.ravel() + 0j
        rows += [both.real, both.imag]
        right += [fixed.real, fixed.imag]
    moment = B
    for _ in range(0 if problem.feedthrough else problem.roll_off - 1):
        rows.append(np.kron(moment.T, np.eye(len(C))))
        right.append(np.zeros(int(nu) * len(C)))
        moment = A @ moment
    if not rows:
        return C
    system = np.concatenate(rows)
    size = lengths(system, axis=1)
    inverse = scipy.linalg.pinv(system / size[:, None], rtol=1e-12)
    vector = C.T.ravel()
    for _ in range(2):
        vector = vector - inverse @ ((system @ vector - np.concatenate(right)) / size)
    return vector.reshape(C.shape[1], C.shape[0]).T


def _tied(problem: FractionProblem, fraction: NodeFraction, basis: VectorPolynomials) -> np.ndarray:
    """Orthonormal combinations (basis.size, order) of the rows x for which x D^{-1} is strictly proper: where degrees go by
    twos D is not column-reduced, and the highest coefficients of x are tied as those of N are.
    """
    high, low = problem.tied
    highest = basis.derivatives(np.inf, 1)[0].real
    if fraction.held.highest is None:
        raise InputError("`fraction` lacks its highest coefficients; take it from a step of the fit")
    return scipy.linalg.null_space(highest[low] - fraction.held.highest[high[:, None], low].T @ highest[high])
