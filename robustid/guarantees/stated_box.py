"""Pole-uncertainty boxes as they are stated: checked against the poles of an identification."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from robustid.bases import ParametricBasis, kautz
from robustid.core import Complex, Real, as_array, exponents_of
from robustid.errors import InputError
from robustid.identification import Identification


def checked_box(
    identification: Identification, omega: ArrayLike | None, damping: ArrayLike | None, delay: int
) -> tuple[Real, Real, int]:
    """Ends of a pole-uncertainty box and the delay of its pairs.

    InputError: intervals that do not hold the poles of the identification, other bases than one pair per mode, records with
    other than zero initial conditions.
    """
    problem = identification.problem
    delay = delay if problem.dt else 0
    poles = _modes(identification, delay)
    omega, damping = _intervals(omega, damping, poles.size, problem.dt)
    for record in problem.time:
        if record.initial != "rest":
            raise InputError(
                f'`identification` has a time record with initial="{record.initial}": what poles in a pole-uncertainty'
                " box do to its initial state is not bounded here; use a frequency response (`estimate_frf`) or a record"
                " with zero initial conditions"
            )
    logs = exponents_of(poles, problem.dt)
    for name, ends, own in (
        ("omega_interval", omega, np.abs(logs)),
        ("damping_interval", damping, -logs.real / np.abs(logs)),
    ):
        outside = (own < ends[:, 0] * (1 - 1e-9)) | (own > ends[:, 1] * (1 + 1e-9))
        if np.any(outside):
            mode = int(np.argmax(outside))
            raise InputError(
                f"`{name}` must hold the poles of `identification`, in their order. Mode {mode + 1} has {own[mode]:.9g}, got"
                f" {ends[mode].tolist()}. Identify with poles in it first"
            )
    return omega, damping, delay


def _modes(identification: Identification, delay: int) -> Complex:
    """The pole of every mode, in the upper half plane: in z, or in s in continuous time."""
    problem = identification.problem
    basis = problem.parametric
    if basis is None:
        raise InputError(
            "`identification` has no parametric part, hence no poles that could lie in a pole-uncertainty box"
        )
    poles = basis.in_s().poles[np.imag(basis.poles) > 0]
    if has_single_pairs(basis):
        logs = exponents_of(poles, problem.dt)
        pairs = kautz(np.abs(logs), -logs.real / np.abs(logs), dt=problem.dt, delay=delay).on(problem.plane)
        count = delay + 4  # a pair has two functions of second order
        if np.allclose(pairs.impulse(count), basis.impulse(count), rtol=1e-9, atol=1e-12):
            return poles
    if problem.prior.passive:
        raise InputError(
            "`identification` is of a passive class, beside which no pole-uncertainty box is bounded: leave its modes out and"
            " choose a `decay` below their smallest damping times frequency, in rad/s; that class holds them wherever they lie"
        )
    raise InputError(
        "`identification` must have one single `kautz` pair per mode in its parametric part"
        + f", of the `delay` that is said here ({delay})" * bool(problem.dt)
    )


def has_single_pairs(basis: ParametricBasis | None) -> bool:
    """Return whether functions may be one pair for each mode, whose poles a box could hold: no real or repeated ones."""
    if basis is None:
        return False
    poles = basis.poles[np.imag(basis.poles) > 0]
    return 0 < 2 * np.unique(poles).size == basis.size


def _intervals(omega: ArrayLike | None, damping: ArrayLike | None, modes: int, dt: float) -> tuple[Real, Real]:
    """The intervals, checked; None is refused as missing."""
    omega, damping = as_array("omega_interval", omega, ndim=2), as_array("damping_interval", damping, ndim=2)
    for name, ends in (("omega_interval", omega), ("damping_interval", damping)):
        if ends.shape != (modes, 2):
            raise InputError(
                f"`{name}` must have one row (low, high) for each of the {modes} modes of `parametric` (one kautz pair each);"
                f" got shape {ends.shape}"
            )
        if np.any(ends[:, 0] > ends[:, 1]) or np.any(ends <= 0):
            raise InputError(f"`{name}` must hold positive ends, low <= high; got {ends.tolist()}")
    if np.any(damping >= 1) or np.any(omega * dt >= np.pi):
        rest = " and `omega_interval` below pi/dt" if dt else ""
        raise InputError(f"`damping_interval` must lie below 1{rest}")
    return omega, damping
