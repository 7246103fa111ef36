"""Rigid-body modes in a state space: chains of two integrators, exact by structure."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.linalg

from robustid.core import Complex, StateMatrices
from robustid.errors import InputError
from robustid.fitting.state_space.given_poles import diagonal_blocks


def chain(count: int, origin: float) -> np.ndarray:
    """`count` chains of two integrators: positions first, then velocities."""
    return origin * np.eye(2 * count) + np.eye(2 * count, k=count)


def nearest_poles(eigenvalues: np.ndarray, origin: float, count: int) -> np.ndarray:
    """Mask of the `count` eigenvalues nearest to the origin, complex pairs kept together."""
    distance = np.abs(eigenvalues - origin)
    real = np.flatnonzero(np.imag(eigenvalues) == 0)
    upper = np.flatnonzero(np.imag(eigenvalues) > 0)
    real, upper = real[np.argsort(distance[real])], upper[np.argsort(distance[upper])]
    best: tuple[float, np.ndarray] | None = None
    for pairs in range(count // 2 + 1):
        if pairs > upper.size or count - 2 * pairs > real.size:
            continue
        chosen = np.isin(np.arange(eigenvalues.size), real[: count - 2 * pairs])
        for k in upper[:pairs]:
            chosen |= (eigenvalues == eigenvalues[k]) | (eigenvalues == eigenvalues[k].conj())
        size = float(distance[chosen].max(initial=0.0))
        if np.sum(chosen) == count and (best is None or size < best[0]):
            best = size, chosen
    if best is None:
        raise InputError(f"{eigenvalues.size} poles are too few for {count // 2} rigid-body modes; raise `order`")
    return best[1]


def sorted_schur(A: np.ndarray, origin: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Real Schur form with the `count` eigenvalues nearest to the origin last."""
    T, Z = scipy.linalg.schur(A)[:2]
    if count == len(A):
        return T, Z
    eigenvalues: Complex = np.asarray(np.linalg.eigvals(T), dtype=complex)
    near = nearest_poles(eigenvalues, origin, count)

    def flexible(re: float, im: float) -> bool:
        gap = np.abs(eigenvalues - (re + 1j * im))
        return bool(gap[~near].min() < gap[near].min())

    T, Z, split = scipy.linalg.schur(A, sort=flexible)  # type: ignore[misc]
    if split != len(A) - count:
        raise np.linalg.LinAlgError("the rigid-body poles don't separate from the flexible ones")
    return T, Z


def split_rigid(model: StateMatrices, count: int, origin: float, directions: np.ndarray | None) -> StateMatrices:
    """Transform a model of this form, but for rounding and noise, to exact rigid-body chains in a block of their own:
    ``A = diag(A_f, [[0, I], [0, 0]] + origin I)`` and, with constant input directions (count, nu), ``B = [B_f; 0; directions]``.
    No eigenvalue routine tells poles that are exact by structure (it splits a double pole by sqrt(eps)).
    """
    A, B, C, D = model
    T, Z = sorted_schur(A, origin, 2 * count)
    k = len(A) - 2 * count
    Y = scipy.linalg.solve_sylvester(T[:k, :k], -T[k:, k:], -T[:k, k:]) if k else np.zeros((0, 2 * count))
    left, right = np.asarray(Z.T @ B, dtype=float), C @ Z
    Bf, Br = left[:k] - Y @ left[k:], left[k:]
    Cf, Cr = right[:, :k], right[:, k:] + right[:, :k] @ Y
    U, sizes, Vt = np.linalg.svd(T[k:, k:] - origin * np.eye(2 * count))
    # N V = U S: in the basis (U S^1/2, V S^-1/2) the nilpotent part is the chain itself.
    root = np.sqrt(sizes[:count])
    basis = np.hstack([U[:, :count] * root, Vt[:count].T / root])
    Br, Cr = np.asarray(np.linalg.solve(basis, Br), dtype=float), Cr @ basis
    if directions is not None:
        # B = [K G; G] with G = gain * directions: the velocity of the chain's start goes into the outputs.
        pinv = np.linalg.pinv(directions)
        gain, slope = Br[count:] @ pinv, Br[:count] @ pinv
        position, velocity = Cr[:, :count], Cr[:, count:]
        Cr = np.hstack([position @ gain, velocity @ gain + position @ slope])
        Br = np.vstack([np.zeros(directions.shape), directions])
    blocks = diagonal_blocks(T[:k, :k], chain(count, origin))
    return StateMatrices(blocks, np.vstack([Bf, Br]), np.hstack([Cf, Cr]), D)


def input_priority(model: StateMatrices, states: np.ndarray, step: int) -> tuple[int, ...]:
    """The inputs, those first whose A^k B adds most when all have had the same number of turns, of `step` degrees each: block
    Arnoldi from B until less than a whole round is left, then a pivoted QR of what they still add. `states` (F, n, nu), the
    weighted response of the states, says how much a direction of the state space matters.
    """
    n, nu = model.B.shape
    flat = states.transpose(1, 0, 2).reshape(n, -1)
    U, sizes, _ = np.linalg.svd(np.hstack([np.real(flat), np.imag(flat)]), full_matrices=False)
    metric = np.maximum(sizes, 1e-14 * sizes[0])
    A, block = (U.T / metric[:, None]) @ model.A @ (U * metric), (U.T / metric[:, None]) @ model.B
    shift = A / np.linalg.norm(A, 2)
    basis = np.zeros((n, 0))
    rounds = step * (n // (step * nu))
    for k in range(rounds + 1):
        for _ in range(2):
            block = block - basis @ (basis.T @ block)
        if k >= rounds:
            break
        # The inputs keep their identity: a triangular factor would mix them, an orthonormal basis beside them doesn't.
        basis = np.hstack([basis, scipy.linalg.orth(block)])
        block = shift @ block / max(float(np.linalg.norm(block)), 1e-300)
    return tuple(int(k) for k in scipy.linalg.qr(block, pivoting=True, mode="r")[1])  # type: ignore[index]


class Decoupling(NamedTuple):
    """Transformations that show the rigid body alone: ``output P input`` has ``I/s^2`` in its first rows and columns."""

    output: np.ndarray  # (ny, ny); T_y: the first rows read the rigid-body coordinates, the others do not see them
    input: np.ndarray  # (nu, nu); T_u: the first columns push one rigid-body mode each, the others none


def decoupling(model: StateMatrices, count: int) -> Decoupling:
    """T_y and T_u of a model with `count` exact chains of integrators at the end of its state (`split_rigid`)."""
    directions, shapes = model.B[-count:], model.C[:, -2 * count : len(model.A) - count]
    T_u = np.hstack([np.linalg.pinv(directions), scipy.linalg.null_space(directions)])
    T_y = np.vstack([np.linalg.pinv(shapes), scipy.linalg.null_space(shapes.T).T])
    return Decoupling(T_y, T_u)
