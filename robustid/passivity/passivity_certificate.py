"""Proofs of passivity: a matrix P, and its inequalities evaluated in exact numbers. Knows nothing of how P was found."""

from __future__ import annotations

import dataclasses
import functools
import operator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robustid.core import Frozen, Real, freeze
from robustid.passivity.exact_matrices import Exact, beside, is_positive_definite, solved, symmetric_blocks
from robustid.passivity.passivity_refined import Equation

if TYPE_CHECKING:
    import control

BOUNDED, POSITIVE, NEGATIVE = "bounded real", "positive real", "negative imaginary"
KINDS = (BOUNDED, POSITIVE, NEGATIVE)


@dataclasses.dataclass(frozen=True, eq=False)
class PassivityCertificate(Frozen):
    r"""A matrix that proves passivity at all frequencies, infinity included.

    .. math:: X = S^T P S \succ 0, \quad
        \begin{bmatrix} A^T X + X A & X B \\ B^T X & 0 \end{bmatrix} + \Pi \prec 0

    with A moved by `decay`, and Π of C and D: ``[C D]' [C D] - bound^2 [0 0; 0 I]`` for "bounded real",
    ``-[0 C'; C D + D' + 2 bound I]`` for "positive real", and the same for the realisation (A, B, C A, C B) of
    ``s (F - D)`` with D symmetric for "negative imaginary".

    With `exact_limit` the claim is that of bound 0 where the response falls to zero, at infinity or (negative imaginary) at
    omega = 0, and no strict inequality can hold: X is corrected, in exact numbers, to keep the equations ``X F = K`` that follow,
    and ``A' X + X A`` is shown negative definite but for directions in which it vanishes.

    Attributes
    ----------
    kind : {"bounded real", "positive real", "negative imaginary"}
    decay : float, 1/s
        The claim holds in the half-plane Re s > -decay.
    bound : float
        Of the largest singular value; or of how far the smallest eigenvalue of the Hermitian part is below zero.
    coordinates, P : (n, n) arrays
        S and P.
    P_rest : (n, n) array, optional
        What is to be added to P: next to the limit one double an entry is not enough.
    exact_limit : bool
    """

    kind: str
    _: dataclasses.KW_ONLY
    decay: float
    bound: float
    coordinates: Real
    P: Real
    P_rest: Real | None = None
    exact_limit: bool = False

    def __post_init__(self) -> None:
        self._set(coordinates=freeze(self.coordinates), P=freeze(self.P))
        if self.P_rest is not None:
            self._set(P_rest=freeze(np.asarray(self.P_rest, dtype=float)))

    def verify(self, model: control.StateSpace) -> bool:
        """Say whether it proves its claim about a continuous model: every number exact, no rounding, no solver."""
        given = matrices_of(model, self.decay)
        if not self.P.size:
            return _static(self, given)
        S, inverse = Exact.of(self.coordinates), np.asarray(np.linalg.inv(self.coordinates), dtype=float)
        parts = [self.P] if self.P_rest is None else [self.P, self.P_rest]
        exact = functools.reduce(operator.add, [Exact.of((part + part.T) / 2) for part in parts])
        if not is_positive_definite(exact):
            return False  # else X is, since the rest says that A' X + X A has no kernel that X could have
        X = S.T @ exact @ S
        return _in_the_limit(self.kind, given, X, inverse) if self.exact_limit else _strict(self, given, X, inverse)


class Matrices(NamedTuple):
    """A moved by the decay, B, C and D of a model, exact."""

    A: Exact
    B: Exact
    C: Exact
    D: Exact


class Face(NamedTuple):
    """Equations ``X F = K`` of every proof, and the directions, columns of F, in which ``A' X + X A`` vanishes."""

    F: Exact
    K: Exact
    null: Exact | None


def matrices_of(model: control.StateSpace, decay: float) -> Matrices:
    """The matrices of a model without rounding."""
    A, B, C, D = (Exact.of(np.asarray(part, dtype=float)) for part in (model.A, model.B, model.C, model.D))
    return Matrices(A + Exact.of(decay * np.eye(len(A.digits))), B, C, D)


def face_of(kind: str, given: Matrices) -> Face | None:
    """The equations of a response that vanishes at infinity or at zero; None where there are none."""
    if kind == BOUNDED or (kind == NEGATIVE and not given.D.is_symmetric()):
        return None
    A, B, C, D = _asked(kind, given)
    static, factor = solved(A, B)  # A^{-1} B factor
    if factor == 0:
        return None
    at_infinity = D.symmetrised().is_zero()
    at_zero = (D.times(factor) - C @ static).symmetrised().is_zero()
    if not at_zero:
        return Face(B, C.T, None) if at_infinity else None
    if kind == NEGATIVE:
        others = given.C.T.times(-factor)  # -A^{-T} C' factor
    else:
        others, other = solved(A.T, -C.T)
        others = others if other == factor else -others  # determinants, but for the sign
    return Face(beside(B, static), beside(C.T, others), static) if at_infinity else Face(static, others, None)


def _asked(kind: str, given: Matrices) -> Matrices:
    """The realisation that is to be bounded or positive real: for "negative imaginary" that of s (F - D)."""
    return Matrices(given.A, given.B, given.C @ given.A, given.C @ given.B) if kind == NEGATIVE else given


def equation_of(claim: PassivityCertificate, model: control.StateSpace) -> Equation:
    """The inequality of a claim, without rounding."""
    A, B, C, D = _asked(claim.kind, matrices_of(model, claim.decay))
    if claim.kind == BOUNDED:
        return Equation(A, B, C.T @ C, C.T @ D, _end(claim, D))
    return Equation(A, B, Exact.of(np.zeros((len(A.digits),) * 2)), -C.T, _end(claim, D))


def _static(claim: PassivityCertificate, given: Matrices) -> bool:
    """The claim about a model without states."""
    end = _end(claim, given.D)
    return is_positive_definite(-end) or (claim.kind != BOUNDED and claim.bound >= 0 and end.is_zero())


def _end(claim: PassivityCertificate, D: Exact) -> Exact:
    """The last block of the inequality."""
    eye = Exact.of(np.eye(len(D.digits)))
    bound = Exact.of(np.array([[claim.bound]]))
    if claim.kind == BOUNDED:
        square = bound @ bound
        return D.T @ D - Exact(eye.digits * square.digits[0, 0], eye.power + square.power)
    return -(D.symmetrised() + Exact(eye.digits * bound.digits[0, 0] * 2, eye.power + bound.power))


def _strict(claim: PassivityCertificate, given: Matrices, X: Exact, inverse: Real) -> bool:
    if claim.kind == NEGATIVE and not given.D.is_symmetric():
        return False
    A, B, C, D = _asked(claim.kind, given)
    T = Exact.of(inverse)  # well-scaled coordinates; any will do
    corner, side = (X @ A).symmetrised(), X @ B
    if claim.kind == BOUNDED:
        corner, side = corner + C.T @ C, side + C.T @ D
    else:
        side = side - C.T
    block = symmetric_blocks(T.T @ corner @ T, T.T @ side, _end(claim, D))
    return is_positive_definite(-block)


def _in_the_limit(kind: str, given: Matrices, X: Exact, inverse: Real) -> bool:
    """The claim of bound 0: X is first corrected to X F = K, which leaves a factor > 0 of no consequence on all of it."""
    face = face_of(kind, given)
    if face is None:
        return False
    F, K, null = face
    cross = F.T @ K
    if not cross.is_symmetric() or not is_positive_definite(cross):
        return False
    adjugate, factor = solved(cross, Exact.of(np.eye(len(cross.digits))))
    # With Z = (F'K)^{-1} it is K Z K' + (I - F Z K')' X (I - F Z K'), all of it times factor^2.
    XF, ZK = X @ F, adjugate @ K.T
    kept = X.times(factor**2) + (K @ ZK).times(factor) - (XF @ ZK).symmetrised().times(factor) + ZK.T @ (F.T @ XF) @ ZK
    decrease, T = -(kept @ given.A).symmetrised(), Exact.of(inverse)
    if null is not None:
        if not (decrease @ null).is_zero():
            return False
        normal = np.asarray(np.linalg.solve(inverse, null.directions()[0]), dtype=float)
        rest = np.linalg.qr(normal, mode="complete")[0][:, normal.shape[1] :]
        across = T @ Exact.of(rest)
        scaled = beside(across, null)
        if not is_positive_definite(scaled.T @ scaled):
            return False
        return is_positive_definite(across.T @ decrease @ across)
    return is_positive_definite(T.T @ decrease @ T)
