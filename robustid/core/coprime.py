r"""Coprime factors: a system of any poles as a quotient of stable ones, and the factors of a loop of two systems.

With a state feedback F that makes :math:`A + B F` stable, :math:`P = N D^{-1}` has the stable right factors

.. math:: \begin{bmatrix} D \\ N \end{bmatrix} = \begin{bmatrix} I \\ D_P \end{bmatrix}
          + \begin{bmatrix} F \\ C + D_P F \end{bmatrix} (\xi I - A - B F)^{-1} B .

Those of a plant P and of a controller C that stabilises it, with u = r - C y, make the matrix of the loop

.. math:: M = \begin{bmatrix} D & -N_c \\ N & D_c \end{bmatrix}, \qquad
          M^{-1} = \begin{bmatrix} \tilde D_c & \tilde N_c \\ -\tilde N & \tilde D \end{bmatrix},

both stable (`tay1989`, `vidyasagar1985`): the states of the inverse are those of the loop, so that no second feedback is needed.
"""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import numpy as np
import scipy.linalg

from robustid.core.planes import bilinear_in_s
from robustid.core.state_space import Complex, Numbers, Real, StateMatrices
from robustid.errors import InputError

_SINGULAR = 1e-13  # relative: what is smaller is rounding
_EDGE, _NEWTON = 0.1, 6  # distance of a pole from z = -1 at which it is moved first; steps
_ROUNDING = 1e-12  # of the largest pole: a decay that is smaller is none


def poles_of(A: Numbers) -> Complex:
    """Eigenvalues."""
    return np.asarray(np.linalg.eigvals(A), dtype=complex)


def decay_of(poles: Complex, dt: float) -> float:
    """The decay in 1/s of the slowest of some poles; infinity of none, not positive where one is not stable."""
    if not poles.size:
        return np.inf
    if not dt:
        return -float(np.max(poles.real))
    with np.errstate(divide="ignore"):  # a delay decays within a sample
        return -float(np.max(np.log(np.abs(poles)))) / dt


def loop_is_stable(poles: Complex, dt: float) -> bool:
    """Say whether the closed-loop poles are stable by more than rounding."""
    return decay_of(poles, dt) > _ROUNDING * (1 / dt if dt else np.abs(poles).max(initial=0.0))


def mirroring_feedback(system: StateMatrices, dt: float, decay: float) -> Real:
    r"""A state feedback that mirrors the poles that are slower than a decay at it, and leaves the others where they are.

    With least energy in the input: :math:`A_u Y A_u^T - Y = B_u B_u^T`, or :math:`A_u Y + Y A_u^T = B_u B_u^T`, of the slower poles
    shifted by the decay, and :math:`F = -B_u^T (Y + B_u B_u^T)^{-1} A_u` or :math:`-B_u^T Y^{-1}` (`zhou1996`, section 13.2).
    InputError: if the input does not move one of them.
    """
    A, B = (np.exp(decay * dt) * np.asarray(part) for part in system[:2]) if dt else (system.A, system.B)
    A = A if dt else A + decay * np.eye(len(A))
    if not A.size:
        return np.zeros((B.shape[1], 0))

    def stays(pole: complex) -> bool:
        return abs(pole) <= 1.0 if dt else pole.real <= 0.0

    schur, basis, kept = scipy.linalg.schur(A, output="complex", sort=stays)
    schur, basis = np.asarray(schur, dtype=complex), np.asarray(basis, dtype=complex)
    slow, drive = schur[kept:, kept:], basis.conj().T[kept:] @ B
    if not slow.size:
        return np.zeros((B.shape[1], len(A)))
    energy = drive @ drive.conj().T
    if dt:
        back = np.asarray(np.linalg.inv(slow), dtype=complex)
        reach = scipy.linalg.solve_discrete_lyapunov(back, back @ energy @ back.conj().T)
    else:
        reach = scipy.linalg.solve_continuous_lyapunov(slow, energy)
    levels = np.linalg.eigvalsh(reach)
    if levels[0] <= _SINGULAR * abs(levels[-1]):
        raise InputError("a pole that is not stable must be moved by the inputs and seen in the outputs; one is not")
    after = np.asarray(np.linalg.solve(reach + energy, slow) if dt else np.linalg.inv(reach), dtype=complex)
    return -np.real(drive.conj().T @ after @ basis.conj().T[kept:])


def stabilised_by(controller: StateMatrices, dt: float, decay: float) -> StateMatrices:
    """A plant that a controller stabilises: an observer of it and a feedback of its states, which decay at least so fast.

    InputError: if a pole of the controller that is not stable is hidden.
    """
    E, F, G, H = controller
    feedback = mirroring_feedback(controller, dt, decay)
    gain = -mirroring_feedback(StateMatrices(E.T, G.T, F.T, H.T), dt, decay).T
    nu, ny = H.shape
    return StateMatrices(E + F @ feedback - gain @ (G + H @ feedback), -gain, feedback, np.zeros((ny, nu)))


def balanced_scales(system: StateMatrices) -> StateMatrices:
    """The system with states scaled by powers of two, so that the matrices of its Riccati equations are balanced."""
    A, B, C, D = system
    if not A.size:
        return system
    both = np.abs(np.vstack([np.hstack([A, B @ B.T]), np.hstack([C.T @ C, A.T])]))
    np.fill_diagonal(both, 0.0)
    scales = scipy.linalg.lapack.dgebal(both, scale=True)[3]
    there, back = np.split(np.log2(scales), 2)
    scale = np.exp2(np.round((there - back) / 2))
    return StateMatrices(A * scale / scale[:, None], B / scale[:, None], C * scale, D)


def normalising_feedback(system: StateMatrices, dt: float) -> tuple[Real, Real]:
    """State feedback and input scaling of normalised right factors, ``D* D + N* N = I`` (`zhou1996`, theorem 13.37).

    numpy.linalg.LinAlgError: if the Riccati equation has no stabilising solution to working precision.
    """
    A, B, C, D = system
    weight = np.eye(B.shape[1]) + D.T @ D
    if not A.size:
        feedback = np.zeros((B.shape[1], 0))
    elif dt:
        # The least cost is that of the system under any other feedback, and of its image in continuous time.
        before = np.zeros((B.shape[1], len(A)))
        if np.min(np.abs(poles_of(A) + 1)) < _EDGE:  # of the image: infinity
            before = mirroring_feedback(system, dt, _EDGE / dt)
        X = _least_cost(bilinear_in_s(right_factors(system, before), 2.0))
        weight = weight + B.T @ X @ B
        feedback = -np.linalg.solve(weight, D.T @ C + B.T @ X @ A)
    else:
        X = _least_cost(right_factors(system, np.zeros((B.shape[1], len(A)))))
        feedback = -np.linalg.solve(weight, D.T @ C + B.T @ X)
    levels, basis = np.linalg.eigh(weight)
    return np.asarray(feedback, dtype=float), (basis / np.sqrt(levels)) @ basis.T


def _least_cost(system: StateMatrices) -> Real:
    r"""The X with :math:`x^T X x` the least :math:`\int |C x + D u|^2 dt` under stabilising inputs, in continuous time.

    From the stable invariant subspace of the Hamiltonian matrix, then by Newton's method: where closed-loop poles are near the axis
    the subspace has half of the digits.
    """
    A, B, C, D = system
    weight, n = D.T @ D, len(A)
    gain = np.linalg.solve(weight, D.T @ C)
    free, left = A - B @ gain, C - D @ gain
    hamiltonian = np.block([[free, -B @ np.linalg.solve(weight, B.T)], [-left.T @ left, -free.T]])
    _, basis, kept = scipy.linalg.schur(hamiltonian, sort="lhp")
    if kept != n:
        raise np.linalg.LinAlgError("poles on the axis")
    X = np.asarray(np.linalg.solve(basis[:n, :n].T, basis[n:, :n].T), dtype=float)
    size = np.inf
    for _ in range(_NEWTON):
        X = (X + X.T) / 2
        feedback = -np.asarray(np.linalg.solve(weight, D.T @ C + B.T @ X), dtype=float)
        closed, outputs = A + B @ feedback, C + D @ feedback
        triangle, basis = scipy.linalg.schur(closed, check_finite=False)
        if decay_of(poles_of(triangle), 0.0) <= _SINGULAR * np.linalg.norm(closed):
            raise np.linalg.LinAlgError("poles on the axis")
        missing = basis.T @ (closed.T @ X + X @ closed + outputs.T @ outputs) @ basis
        step, scale, _ = scipy.linalg.lapack.dtrsyl(triangle, triangle, missing, trana="T")
        step = -(basis @ step @ basis.T) / scale
        X = X + step
        before, size = size, float(np.linalg.norm(step))
        if size <= _SINGULAR * np.linalg.norm(X) or size > before / 2:  # what is left is rounding
            break
    return (X + X.T) / 2


def right_factors(system: StateMatrices, feedback: Real, scale: Real | None = None) -> StateMatrices:
    """The factors ``[D; N]`` of a state feedback, times a matrix from the right."""
    A, B, C, D = system
    scale = np.eye(B.shape[1]) if scale is None else scale
    outputs, direct = np.vstack([feedback, C + D @ feedback]), np.vstack([np.eye(B.shape[1]), D])
    return StateMatrices(A + B @ feedback, B @ scale, outputs, direct @ scale)


def normalised_factors(system: StateMatrices, dt: float) -> StateMatrices:
    """The normalised right factors ``[D; N]``."""
    return right_factors(system, *normalising_feedback(system, dt))


def inverse(system: StateMatrices) -> StateMatrices:
    """The inverse of a square system whose feedthrough is regular."""
    A, B, C, D = system
    back: Real = np.asarray(np.linalg.inv(D), dtype=float)
    return StateMatrices(A - B @ back @ C, B @ back, -back @ C, back)


def series(first: StateMatrices, second: StateMatrices) -> StateMatrices:
    """The response ``second(first(u))``."""
    A, B, C, D = first
    E, F, G, H = second
    states = np.block([[A, np.zeros((len(A), len(E)))], [F @ C, E]])
    return StateMatrices(states, np.vstack([B, F @ D]), np.hstack([H @ C, G]), H @ D)


def exchanged(system: StateMatrices, count: int) -> StateMatrices:
    """The system whose first inputs and outputs, so many of both, have changed sides: from what was put out to what was put in."""
    A, B, C, D = system
    back: Real = np.asarray(np.linalg.inv(D[:count, :count]), dtype=float)
    first, rest = np.hstack([back, -back @ D[:count, count:]]), D[count:, :count]
    inputs = B[:, :count] @ first
    inputs[:, count:] += B[:, count:]
    direct = np.vstack([first, rest @ first])
    direct[count:, count:] += D[count:, count:]
    own = back @ C[:count]
    return StateMatrices(A - B[:, :count] @ own, inputs, np.vstack([-own, C[count:] - rest @ own]), direct)


def right_quotient(system: StateMatrices, count: int) -> StateMatrices:
    """``Z X^-1`` of a system ``[X; Z]``, whose first outputs X are as many as its inputs."""
    A, B, C, D = exchanged(system, count)
    return StateMatrices(A, B, C[count:], D[count:])


def left_quotient(system: StateMatrices, count: int) -> StateMatrices:
    """``X^-1 Z`` of a system ``[X, Z]``, whose first inputs, those of X, are as many as its outputs."""
    A, B, C, D = system
    back: Real = np.asarray(np.linalg.inv(D[:, :count]), dtype=float)
    rest = back @ D[:, count:]
    return StateMatrices(A - B[:, :count] @ back @ C, B[:, count:] - B[:, :count] @ rest, back @ C, rest)


def is_well_posed(plant: StateMatrices, controller: StateMatrices) -> bool:
    """Say whether the loop of two systems has a solution: I + C P is regular for infinite frequencies, in any units."""
    if not plant.D.any() or not controller.D.any():  # it is I; units cannot balance a triangle
        return True
    balanced, _ = scipy.linalg.matrix_balance(_algebraic(plant, controller))
    return bool(np.linalg.cond(balanced) <= 1 / _SINGULAR)


def _algebraic(plant: StateMatrices, controller: StateMatrices) -> Real:
    """``[I, C; -P, I]`` for infinite frequencies."""
    ny, nu = plant.D.shape
    return np.block([[np.eye(nu), controller.D], [-plant.D, np.eye(ny)]])


def closed_loop(plant: StateMatrices, controller: StateMatrices) -> StateMatrices:
    """The inverse of ``[I, C; -P, I]``: from what is added at the input and at the output of a plant to u and y, u = r - C y.

    Raises
    ------
    InputError
        If the loop has no solution: I + C P is singular for infinite frequencies.
    """
    (A, B, C, _), (E, F, G, _) = plant, controller
    nu, ny = B.shape[1], C.shape[0]
    if not is_well_posed(plant, controller):
        raise InputError("plant and controller make no loop: I + C P is singular for infinite frequencies")
    states = scipy.linalg.block_diag(A, E)
    inputs = scipy.linalg.block_diag(B, F)
    # M of the unfactored systems: rows u, y; of the inputs of plant and controller, the latter with the sign of u = r - C y.
    outputs = np.block([[np.zeros((nu, len(A))), G], [-C, np.zeros((ny, len(E)))]])
    return inverse(StateMatrices(states, inputs, outputs, _algebraic(plant, controller)))


def loop_factors(plant: StateMatrices, controller: StateMatrices, dt: float) -> StateMatrices:
    """The matrix M of a loop; its `inverse` has the left factors.

    The poles of M that the feedbacks place are as fast as those of the loop at least.
    InputError: if the controller does not stabilise the plant.
    """
    loop = closed_loop(plant, controller)
    poles = poles_of(loop.A)
    decay = decay_of(poles, dt)
    if not loop_is_stable(poles, dt):
        worst = poles[np.argmax(np.abs(poles) if dt else poles.real)]
        raise InputError(f"the loop must be stable; got a closed-loop pole at {worst:.6g}")
    nu, ny = plant.B.shape[1], plant.C.shape[0]
    slow = decay if np.isfinite(decay) else 0.0
    (A, B, C, D), (E, F, G, H) = (
        right_factors(system, mirroring_feedback(system, dt, slow)) for system in (plant, controller)
    )
    top, bottom = slice(0, ny), slice(ny, None)  # of the controller: D_c, N_c
    outputs = np.block([[C[:nu], -G[bottom]], [C[nu:], G[top]]])
    direct = np.block([[D[:nu], -H[bottom]], [D[nu:], H[top]]])
    return StateMatrices(scipy.linalg.block_diag(A, E), scipy.linalg.block_diag(B, F), outputs, direct)
