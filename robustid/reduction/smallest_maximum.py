"""Smallest largest residual over linear unknowns: a second-order cone program in orthonormal coordinates."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robustid.core import Complex, Real, lengths, singular_parts
from robustid.identification.formulation import DenseDesign, NoBall
from robustid.identification.solver import Cones, Limits, Program, path, start

_RANK = 1e-12  # directions that the samples see less than this, relatively, are left alone
_LEAST = 1e-280  # largest entry of a column, below which its inverse overflows
_GAP = 1e-4  # relative, of the maximum


def orthonormal_columns(stacked: Real) -> tuple[Real, Real]:
    """U with orthonormal columns and V such that U = stacked V; columns of any size, of any rank. Columns that are not finite, of
    functions that overflow, and those too small to be divided by, have no part in U.
    """
    largest = np.abs(stacked).max(axis=0, initial=0.0)
    usable = np.isfinite(largest) & (largest > _LEAST)
    scale = np.ldexp(1.0, np.frexp(np.where(usable, largest, 1.0))[1] - 1)  # powers of two: nothing is rounded
    scaled = np.where(usable, stacked, 0.0) / scale
    norms = lengths(scaled)
    U, s, Vt = singular_parts(scaled / norms)
    kept = s > _RANK * s.max(initial=0.0)
    V = Vt[kept].T / s[kept] / norms[:, None] / scale[:, None]
    return U[:, kept], np.where(usable[:, None], V, 0.0)


def smallest_maximum(
    G: NDArray[np.float64 | np.complex128],
    y: Complex,
    discs: int,
    first: Real,
    reach: Real,
    cone: NDArray[np.intp] | None = None,
) -> tuple[Real, float]:
    """The v with the smallest max_k |y - G v|_k subject to |v_j| <= reach_j (inf: free), from a `first` one inside, and that
    maximum. The first `discs` of the N samples are complex, the imaginary parts of the others zero; `cone` (N,) numbers the
    bound of each sample, whose norm counts where several share one.
    """
    count, stacked = y.size, np.concatenate([np.real(G), np.imag(G[:discs])])
    U, V = orthonormal_columns(stacked)
    complex_rows = U[:count].astype(complex)
    complex_rows[:discs] += 1j * U[count:]
    held = np.isfinite(reach)
    rows = np.vstack([complex_rows, V[held] / reach[held, None]])
    q = U.T @ (stacked @ first)
    bounds = count if cone is None else int(cone.max(initial=-1)) + 1
    cones = Cones(bounds, None if bounds == count else cone)
    worst = float(cones.size(y - complex_rows @ q).max(initial=0.0))
    floor = 1e3 * np.finfo(float).eps * max(1.0, float(np.abs(y).max(initial=0.0)))
    if worst <= floor or not q.size:
        return first, worst
    ones, zeros = np.ones(cones.count), np.zeros(cones.count)
    limits = np.concatenate([zeros, np.ones(held.sum())]), np.concatenate([ones, np.zeros(held.sum())])
    program = Program(
        NoBall(),
        DenseDesign(rows, discs),
        cones.followed_by(int(held.sum())),
        np.concatenate([y, np.zeros(held.sum())]),
        Limits((1.0, 0.0), limits),
        1.0,
        np.zeros(q.size),
    )
    best, value = q, worst
    for at in path(program, start(program, q, 1.2 * worst)):
        reached = float(cones.size(y - complex_rows @ at.v).max())
        if reached < value:
            best, value = at.v, reached
        if at.estimate < _GAP * at.t or at.t <= floor:
            break
    return V @ best, value
