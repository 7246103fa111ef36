"""Orthonormal bases of generalised interpolation, built as a cascade of orthogonal all-pass sections."""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import dataclasses
from collections.abc import Iterable

import numpy as np

from robustid.core import Frozen, freeze, input_states


@dataclasses.dataclass(frozen=True, eq=False)
class InputNormalPair(Frozen):
    """All-pass realisation [A B; c d], orthogonal, whose A has the interpolation nodes as spectrum.

    ``A'A + c'c = I``; the functions phi_j(zeta) = (c (I - zeta A)^{-1})_j are orthonormal in H2 of the unit disc
    (Takenaka-Malmquist), so that a function g has the coefficients x_j = <g, phi_j> and

    * g(zeta_i) = phi(zeta_i) x' at every eigenvalue zeta_i of A,
    * the k-th Taylor coefficient of g is c A^k x', k below the number of zero eigenvalues.

    Notes
    -----
    Source: theory of orthonormal rational bases; `inanc2001` Theorem 1 uses the non-orthonormal basis of the same
    space.
    """

    A: np.ndarray  # A, B, c, d: (n, n), (n, 1), (1, n), (1, 1)
    B: np.ndarray
    c: np.ndarray
    d: np.ndarray

    def __post_init__(self) -> None:
        self._set(**{name: freeze(getattr(self, name)) for name in ("A", "B", "c", "d")})

    @property
    def order(self) -> int:
        """Number n of coefficients."""
        return self.A.shape[0]

    def evaluate(self, zeta: np.ndarray) -> np.ndarray:
        """The rows phi(zeta), shape (len(zeta), n)."""
        zeta = np.atleast_1d(np.asarray(zeta, dtype=complex))
        return input_states(self.A.T, self.c.T, np.ones_like(zeta), zeta)[..., 0]

    def taylor(self, count: int) -> np.ndarray:
        """The rows c A^k, k < count, shape (count, n)."""
        rows = np.empty((count, self.order))
        row = self.c
        for k in range(count):
            rows[k] = row[0]
            row = row @ self.A
        return rows

    def symmetry(self) -> np.ndarray:
        """The symmetric orthogonal T with A'T = TA: it makes T g(A) symmetric for every function g.

        A scalar all-pass function has (A, B, c) and its transpose (A', c', B') as realisations; both are
        orthogonal, so the state transformation between them is. For time data alone T is the flip that turns a
        triangular Toeplitz matrix into a Hankel matrix. Solves T = A T A + B c.
        """
        T, P = self.B @ self.c, np.array(self.A)
        while np.abs(P).max(initial=0.0) > 1e-20:
            T = T + P @ T @ P
            P = P @ P
        return (T + T.T) / 2


def input_normal_pair(
    angles: Iterable[float], radius: float, taylor: int = 0, first: Iterable[float] = ()
) -> InputNormalPair:
    """Input-normal pair with nodes radius*exp(+-j*angle) and a zero of multiplicity `taylor`.

    Each conjugate pair contributes one 2x2 section, angles 0 and pi one 1x1 section, each zero a delay. Nodes and
    delays are dealt out alternately over the two halves of the cascade, so that the off-diagonal block of g(A)
    is a Loewner/Hankel matrix between two interleaved sets of nodes.

    Parameters
    ----------
    angles : iterable of float, rad
        Distinct angles in [0, pi].
    radius : float
        Modulus of the nodes, 0 < radius < 1 (1/decay_rate).
    taylor : int
        Number of Taylor coefficients.
    first : iterable of float, rad
        Further nodes, at the head of the cascade: their functions vanish at all others.

    Examples
    --------
    >>> import numpy as np
    >>> pair = input_normal_pair(np.linspace(0, np.pi, 30), 0.98, taylor=20)
    >>> bool(np.abs(pair.A.T @ pair.A + pair.c.T @ pair.c - np.eye(pair.order)).max() < 1e-14)
    True
    """
    angles = np.sort(np.asarray(list(angles), dtype=float))
    return nodes_pair(
        [line_section(angle, radius) for angle in angles], taylor, [line_section(w, radius) for w in first]
    )


def nodes_pair(lines: list[np.ndarray], taylor: int = 0, head: list[np.ndarray] | None = None) -> InputNormalPair:
    """Input-normal pair of sections (`line_section`) in the order of their angles, dealt out as in `input_normal_pair`."""
    delays = [_real_section(0.0)] * taylor
    half = taylor // 2
    return cascade([*(head or []), *lines[0::2], *delays[:half], *lines[1::2], *delays[half:]])


def shift_pair(length: int) -> InputNormalPair:
    """The pair whose coefficients are the first `length` Taylor coefficients, in their order: phi_j(zeta) = zeta^j.

    Examples
    --------
    >>> import robustid as rid
    >>> from robustid.bases import shift_pair
    >>> shift_pair(3).taylor(3).diagonal()
    array([1., 1., 1.])
    """
    return InputNormalPair(np.eye(length, k=1), np.eye(length)[:, length - 1 :], np.eye(1, length), np.zeros((1, 1)))


def line_section(angle: float, radius: float) -> np.ndarray:
    """[a b; c d], orthogonal, of the all-pass function with the zeros radius*exp(+-j*angle), one where they are real."""
    if angle == 0.0:
        return _real_section(radius)
    if angle == np.pi:
        return _real_section(-radius)
    # Lattice form: two reflections; orthogonal for every angle without solving anything.
    k1 = -2 * radius * np.cos(angle) / (1 + radius**2)
    k2 = radius**2
    return _reflection(k1, 0) @ _reflection(k2, 1)


def _reflection(k: float, first: int) -> np.ndarray:
    s = np.sqrt((1 - k) * (1 + k))
    full = np.eye(3)
    full[first : first + 2, first : first + 2] = [[-k, s], [s, k]]
    return full


def _real_section(a: float) -> np.ndarray:
    s = np.sqrt((1 - a) * (1 + a))
    return np.array([[a, s], [s, -a]])


def cascade(sections: list[np.ndarray]) -> InputNormalPair:
    """The pair of a product of all-pass functions [a b; c d]."""
    total = sum(s.shape[0] - 1 for s in sections)
    A, B = np.zeros((total, total)), np.zeros((total, 1))
    c, d = np.zeros((1, total)), np.ones((1, 1))
    n = 0
    for section in sections:  # the output of what is there feeds the next section
        m = section.shape[0] - 1
        a, b, cs, ds = section[:m, :m], section[:m, m:], section[m:, :m], section[m:, m:]
        A[n : n + m, :n] = b @ c[:, :n]
        A[n : n + m, n : n + m] = a
        B[n : n + m] = b @ d
        c[:, :n] = ds @ c[:, :n]
        c[:, n : n + m] = cs
        d = ds @ d
        n += m
    return InputNormalPair(A, B, c, d)


def solve_stein(
    left: np.ndarray, right: np.ndarray, constant: np.ndarray, powers: list[tuple[np.ndarray, np.ndarray]] | None = None
) -> np.ndarray:
    """Solve X - left X right = constant by doubling; `constant` may be a stack (..., n, m).

    Sums constant + left constant right + ...; needs spectral radii below 1. For contractions every partial sum is
    well conditioned, however close the nodes are. `powers` are `stein_powers`, of those who solve many.
    """
    X = np.array(constant)
    for P, Q in stein_powers(left, right) if powers is None else powers:
        X = X + P @ X @ Q
    return X


def stein_powers(left: np.ndarray, right: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """The powers 1, 2, 4, ... of two matrices, until one of them vanishes."""
    found: list[tuple[np.ndarray, np.ndarray]] = []
    P, Q = np.array(left), np.array(right)
    while min(np.abs(P).max(initial=0.0), np.abs(Q).max(initial=0.0)) > 1e-20:
        found.append((P, Q))
        P, Q = P @ P, Q @ Q
    return found
