"""Modes of passive plants: functions whose non-negative combinations are positive real."""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from robustid.bases.function import Function, FunctionKind
from robustid.bases.parametric import ParametricBasis, stack_bases
from robustid.core import as_array, hz_words
from robustid.errors import InputError


def passive_modes(omega: ArrayLike, damping: ArrayLike) -> ParametricBasis:
    r"""Two functions for every mode of a mobility, positive real each: their non-negative combinations are all that are.

    .. math:: \frac{2 d s}{s^2 + 2 d s + \omega^2}, \quad \frac{2 d (s + 2 d)}{s^2 + 2 d s + \omega^2}, \qquad d = \zeta \omega

    Of a real pole, zeta = 1: ``omega/(s + omega)`` and ``s/(s + omega)``, those of resistors with capacitors or inductors.

    Parameters
    ----------
    omega : float or sequence, rad/s
        Natural frequencies.
    damping : float or sequence
        Damping ratios, 0 < zeta <= 1; 1 stands for one real pole -omega, as in `kautz`.

    Returns
    -------
    ParametricBasis
        Of continuous time, for a `PositiveReal` class: its decay is then about what the modes leave.

    Raises
    ------
    InputError
        Other than positive frequencies, or damping ratios outside of (0, 1].

    Notes
    -----
    (b_1 s + b_0)/(s^2 + 2 d s + omega^2) is positive real iff 0 <= b_0 <= 2 d b_1: its real part on the axis is
    (b_0 omega^2 + (2 d b_1 - b_0) w^2)/|.|^2. Of several ports the coefficients are matrices, positive semidefinite of reciprocal
    plants; the class asks less of them, R_ii >= 0 and |R_ij| at most the mean of the largest R_ii and R_jj (geometric): guarantees
    and refutations hold, the modes of its model need not be passive (`make_passive`).

    Examples
    --------
    >>> import robustid as rid
    >>> rid.passive.passive_modes(100.0, 0.01).labels
    ('passive mode 15.92 Hz, velocity', 'passive mode 15.92 Hz, damped')
    """
    omega, damping = (np.atleast_1d(as_array(name, value)) for name, value in (("omega", omega), ("damping", damping)))
    if omega.ndim != 1 or damping.shape != omega.shape:
        raise InputError(
            f"`omega` and `damping` must have the same length; got shapes {omega.shape} and {damping.shape}"
        )
    if np.any(omega <= 0):
        raise InputError(f"`omega` must be positive; got {omega.min():g} rad/s")
    if np.any((damping <= 0) | (damping > 1)):
        raise InputError(
            "`damping` must hold ratios between 0 and 1 (1 for a real pole);"
            f" got {damping.min():g} to {damping.max():g}"
        )
    return stack_bases([_passive_mode(w, z) for w, z in zip(omega.tolist(), damping.tolist(), strict=True)])


def _passive_mode(omega: float, damping: float) -> ParametricBasis:
    if damping == 1:
        functions = _functions(omega, " (real pole), low-pass", " (real pole), high-pass")
        A, B, C, D = np.array([[-omega]]), np.array([[omega]]), np.array([[1.0], [-1.0]]), np.array([[0.0], [1.0]])
        return ParametricBasis(A, B, C, D, 0.0, functions, np.array([-omega], complex))
    d = damping * omega
    A, B = np.array([[0.0, omega], [-omega, -2 * d]]), np.array([[0.0], [1.0]])
    C = 2 * d * np.array([[0.0, 1.0], [2 * damping, 1.0]])
    pole = complex(-d, omega * np.sqrt(1 - damping**2))
    poles = np.array([pole, pole.conjugate()])
    functions = _functions(omega, ", velocity", ", damped")
    return ParametricBasis(A, B, C, np.zeros((2, 1)), 0.0, functions, poles)


def _functions(omega: float, *ends: str) -> tuple[Function, ...]:
    kind = FunctionKind.PASSIVE
    return tuple(Function(f"{kind.value} {hz_words(omega / (2 * np.pi), 4)}{end}", kind) for end in ends)
