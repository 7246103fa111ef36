"""State-space models: their matrices, their response at any points and their simulation in time."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from robustid.core.kept import kept_by_content

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]
Numbers = NDArray[np.inexact]  # real or complex
Array = NDArray[Any]

_BLOCK = 1024  # columns worked on at once: they stay in the cache


class StateSpace(Protocol):
    """The part of a `control.StateSpace` that evaluation and simulation need."""

    A: Real
    B: Real
    C: Real
    D: Real


class Model(StateSpace, Protocol):
    """A `control.StateSpace`, which has no types of its own: what is asked of one here."""

    dt: Any  # in s; None or True where it is not known
    nstates: int
    ninputs: int
    noutputs: int
    input_labels: list[str]
    output_labels: list[str]

    def poles(self) -> Complex:
        """Eigenvalues of A."""
        ...

    def isdtime(self, strict: bool = False) -> bool:
        """Say whether it is of discrete time."""
        ...

    def __call__(self, x: ArrayLike, *, squeeze: bool, warn_infinite: bool) -> Complex:
        """Values at points s or z."""
        ...


class StateMatrices(NamedTuple):
    """The real matrices A, B, C, D of a state space in s, in z, or in a series variable."""

    A: Real
    B: Real
    C: Real
    D: Real

    @classmethod
    def of(cls, model: StateSpace | StateMatrices) -> StateMatrices:
        """The matrices of a model."""
        A, B, C, D = (np.asarray(part, dtype=float) for part in (model.A, model.B, model.C, model.D))
        return cls(A, B, C, D)

    def model(self, dt: float, **labels: list[str]) -> Model:
        """The model with a sample time in s, 0 in continuous time, and labels of its inputs and outputs."""
        import control

        return control.ss(*self, dt, **labels)

    def transposed(self) -> StateMatrices:
        """The realisation of the transposed response."""
        return StateMatrices(self.A.T, self.C.T, self.B.T, self.D.T)


def norms(matrices: Complex | Real) -> Real:
    """Largest singular values, (N, p, q) to (N,)."""
    if matrices.shape[1:] == (1, 1):
        return np.abs(matrices[:, 0, 0])
    # The root of the largest eigenvalue of A* A, as exact as by singular values and in half of their time.
    size = np.abs(matrices).max(axis=(1, 2), initial=0.0)
    scaled = matrices / np.where(size > 0, size, 1.0)[:, None, None]
    if min(matrices.shape[1:]) > 1 and matrices.shape[1:] != (2, 2):
        if matrices.shape[1] < matrices.shape[2]:
            scaled = scaled.swapaxes(1, 2)
        return size * np.sqrt(np.linalg.eigvalsh(scaled.conj().swapaxes(1, 2) @ scaled)[:, -1])
    # Of one or two of them, without a decomposition of each matrix: by its trace and its entries.
    squares = np.sum(scaled.real**2 + scaled.imag**2, axis=1)  # of the columns
    largest = squares.sum(axis=1)
    if 1 not in matrices.shape[1:]:
        across = np.abs(np.sum(scaled[:, :, 0].conj() * scaled[:, :, 1], axis=1))
        largest = largest / 2 + np.hypot((squares[:, 0] - squares[:, 1]) / 2, across)
    return size * np.sqrt(largest)


def points_of(omega: Real, dt: float | None) -> Complex:
    """Points s = j omega of frequencies in rad/s, or z = exp(j omega dt) where there is a sample time (not None or 0)."""
    return np.asarray(np.exp(1j * omega * dt) if dt else 1j * omega, dtype=np.complex128)


def scaled_states(A: Real, B: Real, C: Real) -> tuple[Real, Real, Real]:
    """Balance the scales of the states by powers of two, from A alone: exact, whatever the units of the signals."""
    if not A.size:
        return A, B, C
    with np.errstate(invalid="ignore"):  # scipy also reads the scales as a permutation, which isn't used
        balanced, (scale, _) = scipy.linalg.matrix_balance(A, permute=False, separate=True)
    return balanced, B / scale[:, None], C * scale


@kept_by_content(most=1000, results=4)  # states: a page asks for one model many times; 32 MB of the largest
def _schur_of(A: Numbers) -> tuple[Complex, Complex]:
    """Complex Schur form and basis of a matrix."""
    T, basis = scipy.linalg.schur(A, output="complex")
    T.setflags(write=False)
    basis.setflags(write=False)
    return T, basis


class Response:
    """The response of a state space at any points: one Schur form, then one substitution for all points of a block.

    A factorisation of ``xi I - A`` for every point takes n/3 times as many operations, an eigenvector basis fails at double
    poles (rigid-body modes). The states are not scaled: the scales of a chain of integrators that rounding has touched are
    arbitrary, and make it two poles whose responses cancel. `scaled_states` helps where the coordinates are physical.

    Attributes
    ----------
    poles : (n,) complex array
        Eigenvalues of A.
    """

    def __init__(self, system: tuple[Real, Real, Real, Real]) -> None:
        A, B, C, D = system
        self._feedthrough = np.asarray(D, dtype=float)
        if A.size:
            self._schur, basis = _schur_of(np.ascontiguousarray(A))
            self._right, self._left = basis.conj().T @ B, C @ basis
        else:
            self._schur, self._right, self._left = (np.asarray(part, dtype=complex) for part in (A, B, C))
        self.poles: Complex = np.diagonal(self._schur)

    def at(self, points: ArrayLike) -> Complex:
        """``D + C (xi I - A)^{-1} B`` at points xi = s or z, (F, ny, nu); inf or nan at a pole."""
        points = np.atleast_1d(np.asarray(points, dtype=complex))
        return self._substituted(points, np.ones_like(points))

    def series(self, zeta: ArrayLike) -> Complex:
        """``D + zeta C (I - zeta A)^{-1} B``, the delay (series) convention with zeta = 1/z, (F, ny, nu)."""
        points = np.atleast_1d(np.asarray(zeta, dtype=complex))
        return self._substituted(np.ones_like(points), points)

    def _substituted(self, direct: Complex, factor: Complex) -> Complex:
        """``D + f C (d I - f A)^{-1} B`` at points (d, f): back-substitution for all points of a block."""
        T, right, left = self._schur, self._right, self._left
        n, q = right.shape
        values = np.repeat(self._feedthrough.astype(complex)[None], direct.size, axis=0)
        block = max(1, _BLOCK // max(q, 1))
        for first in range(0, direct.size if n else 0, block):
            d, f = direct[first : first + block, None], factor[first : first + block, None]
            x = np.empty((n, d.size * q), complex)
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                for row in range(n - 1, -1, -1):  # (d I - f T) x = right, from the last row up
                    rest = (T[row, row + 1 :] @ x[row + 1 :]).reshape(d.size, q)
                    x[row] = ((right[row] + f * rest) / (d - f * T[row, row])).ravel()
                outputs = (left @ x).reshape(-1, d.size, q)
                values[first : first + block] += f[..., None] * outputs.transpose(1, 0, 2)
        return values


def input_states(A: Real, B: Real, points: ArrayLike, factor: ArrayLike = 1.0) -> Complex:
    """States ``(d I - f A)^{-1} B`` at points d = s or z, f = 1; or d = 1, f = 1/z in the series convention, (F, n, nu).

    One factorisation a point: its error is a rounding of A in its own structure. A Schur form (`Response`) rounds A as a dense
    matrix once for all points, which splits multiple poles: of a lightly damped pair repeated three times the response at its
    resonance is good to 5e-8 this way and to 2e-5 from the Schur form. Many states take n/3 times as long.

    Examples
    --------
    >>> input_states(np.zeros((1, 1)), np.ones((1, 1)), [2.0, 4.0]).ravel().real
    array([0.5 , 0.25])
    """
    d, f = np.broadcast_arrays(np.asarray(points, dtype=complex), np.asarray(factor, dtype=complex))
    left = d[:, None, None] * np.eye(len(A)) - f[:, None, None] * A
    return np.asarray(
        np.linalg.solve(left, np.broadcast_to(B.astype(complex), (d.size, *B.shape))), dtype=np.complex128
    )


def response_at(system: tuple[Real, Real, Real, Real], points: ArrayLike) -> Complex:
    """Response ``D + C (xi I - A)^{-1} B`` at complex points xi = s or z, (F, ny, nu); inf or nan at a pole.

    Examples
    --------
    >>> one, none = np.ones((1, 1)), np.zeros((1, 1))
    >>> response_at((-one, one, one, none), [0, 1j]).ravel()
    array([1. +0.j , 0.5-0.5j])
    """
    return Response(system).at(points)


def series_at(system: tuple[Real, Real, Real, Real], zeta: ArrayLike) -> Complex:
    """Response ``D + zeta C (I - zeta A)^{-1} B``, in the delay (series) convention with zeta = 1/z, (F, ny, nu)."""
    return Response(system).series(zeta)


def responses(model: StateSpace, angles: ArrayLike) -> Complex:
    """Values at exp(j*angle) of a discrete model, (F, ny, nu)."""
    return series_at(StateMatrices.of(model), np.exp(-1j * np.asarray(angles, dtype=float)))


def response(model: StateSpace, angles: ArrayLike) -> Complex:
    """Values at exp(j*angle) of a discrete SISO model, (F,)."""
    return responses(model, angles)[:, 0, 0]


def simulate(model: StateSpace | StateMatrices, u: Real, start: Real | None = None) -> tuple[Real, Real]:
    """Output (T, ny) of a discrete model driven by u (T, nu) from the state `start`, and the state after the last sample.

    Default: zero initial conditions.
    """
    A, B, C, D = StateMatrices.of(model)
    drive = u @ B.T
    states = np.empty((u.shape[0], len(A)))
    state = np.zeros(len(A)) if start is None else start
    with np.errstate(over="ignore", invalid="ignore"):
        for k, push in enumerate(drive):
            states[k] = state
            state = A @ state + push
        return states @ C.T + u @ D.T, state
