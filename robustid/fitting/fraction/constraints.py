"""Constraints that a user asks of a fit: static gain, zeros, roll-off, entries that are zero."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import Protocol, cast, runtime_checkable

import numpy as np

from robustid.core import Frozen, as_array, as_count, freeze
from robustid.errors import InputError, InputTypeError
from robustid.fitting.fraction.conditions import Condition
from robustid.fitting.fraction.fraction_problem import FractionProblem


@runtime_checkable
class Constraint(Protocol):
    """A constraint, as `fit_mfd` takes it in `constraints`."""

    def apply(self, problem: FractionProblem) -> FractionProblem:
        """The problem of a right fraction with this constraint added."""
        ...

    def transposed(self) -> Constraint:
        """The constraint on P^T, for left fractions."""
        ...

    def stacked(self, shape: tuple[int, ...]) -> Constraint:
        """The constraint on the entries of P, of shape (ny, nu), as one column: row by row, for shared poles."""
        ...


def as_constraints(constraints: object) -> tuple[Constraint, ...]:
    """The constraints of a fit, checked."""
    items = tuple(cast("Iterable[object]", constraints)) if isinstance(constraints, Iterable) else (constraints,)
    good = tuple(item for item in items if isinstance(item, Constraint))
    if len(good) < len(items) or not isinstance(constraints, Iterable):
        wrong = next((item for item in items if not isinstance(item, Constraint)), items[0])
        got = type(wrong).__name__
        raise InputTypeError(f"`constraints` must be a sequence of constraints, such as [RollOff(2)]; got {got}")
    return good


@dataclasses.dataclass(frozen=True, eq=False)
class StaticGain(Frozen):
    """P(s = 0) = gain, or P(z = 1) = gain: ``N - gain D = 0`` there.

    Parameters
    ----------
    gain : (ny, nu) real array

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> from robustid.fitting import StaticGain
    >>> omega = np.linspace(1, 9, 60)
    >>> frf = rid.FrequencyResponse(omega, 1 / ((1j * omega) ** 2 + 0.2j * omega + 16))
    >>> fit = rid.fit_mfd(frf, order=2, constraints=[StaticGain([[0.1]])])
    >>> round(float(fit.model(0).real), 12)
    0.1
    """

    gain: np.ndarray

    def __post_init__(self) -> None:
        self._set(gain=freeze(as_array("gain", self.gain, ndim=2)))

    def apply(self, problem: FractionProblem) -> FractionProblem:
        """Add the constraint."""
        ny, nu = problem.values.shape[1:]
        if self.gain.shape != (ny, nu):
            raise InputError(f"`gain` must have shape (ny, nu) = {(ny, nu)}; got {self.gain.shape}")
        left = np.hstack([-self.gain, np.eye(ny)])
        return problem.with_conditions(Condition(problem.origin, ((left, np.eye(nu)),)))

    def transposed(self) -> StaticGain:
        """P^T(0) = gain^T."""
        return StaticGain(self.gain.T)

    def stacked(self, shape: tuple[int, ...]) -> StaticGain:
        """The gains of all entries as one column."""
        if self.gain.shape != shape:
            raise InputError(f"`gain` must have shape (ny, nu) = {shape}; got {self.gain.shape}")
        return StaticGain(self.gain.reshape(-1, 1))


@dataclasses.dataclass(frozen=True, eq=False)
class Zero(Frozen):
    """A transmission zero: ``direction P(point) = 0`` (right fraction) or ``P(point) direction = 0`` (left fraction).

    Parameters
    ----------
    point : complex, s in rad/s or z
    direction : (ny,) array for a right fraction, (nu,) for a left one, optional
        Real. Default: the whole response vanishes there (a blocking zero).
    """

    point: complex
    direction: np.ndarray | None = None

    def __post_init__(self) -> None:
        try:
            point = complex(self.point)
        except (TypeError, ValueError):
            raise InputTypeError(f"`point` must be a number; got {self.point!r}") from None
        if not np.isfinite(point):
            raise InputError(f"`point` must be a finite number; got {self.point}")
        direction = None if self.direction is None else freeze(as_array("direction", self.direction, ndim=1))
        self._set(point=point, direction=direction)

    def apply(self, problem: FractionProblem) -> FractionProblem:
        """Add the constraint."""
        ny, nu = problem.values.shape[1:]
        rows = np.eye(ny) if self.direction is None else self.direction[None, :]
        if rows.shape[1] != ny:
            raise InputError(f"`direction` must have {ny} entries for this form of the fraction; got {rows.shape[1]}")
        left = np.hstack([np.zeros((len(rows), nu)), rows])
        return problem.with_conditions(Condition(self.point / problem.scale, ((left, np.eye(nu)),)))

    def transposed(self) -> Zero:
        """Return the constraint itself; the direction changes its side."""
        return self

    def stacked(self, shape: tuple[int, ...]) -> Zero:
        """Return the constraint itself, of a blocking zero."""
        if self.direction is not None:
            raise InputError(
                '`direction` of a zero ties the residues of entries to each other, which form "shared" leaves free; take'
                ' form "right" or "left", or a blocking zero without direction'
            )
        return self


@dataclasses.dataclass(frozen=True)
class RollOff(Frozen):
    """|P| falls at least like 1/|s|^degree (or has this many samples of delay): numerator degrees that much below.

    Parameters
    ----------
    degree : int, at least 1
    """

    degree: int

    def __post_init__(self) -> None:
        self._set(degree=as_count("degree", self.degree, least=1))

    def apply(self, problem: FractionProblem) -> FractionProblem:
        """Add the constraint."""
        if problem.feedthrough:
            raise InputError("`feedthrough` and a roll-off exclude each other")
        if self.degree > problem.degrees.min():
            raise InputError(
                f"`degree` = {self.degree} is more roll-off than an order of {problem.order} allows"
                f" (at most {problem.degrees.min()})"
            )
        return dataclasses.replace(problem, roll_off=self.degree)

    def transposed(self) -> RollOff:
        """Return the constraint itself."""
        return self

    def stacked(self, shape: tuple[int, ...]) -> RollOff:
        """Return the constraint itself."""
        return self


@dataclasses.dataclass(frozen=True, eq=False)
class ZeroEntries(Frozen):
    """Entries of P that are zero whatever the coefficients are.

    ``N_ij = 0`` for those entries, and ``D_lj = 0`` unless column l is zero wherever column j is; D^{-1} has the same
    pattern then, so that ``P_ij = sum_l N_il (D^{-1})_lj = 0``.

    Parameters
    ----------
    mask : (ny, nu) bool array
        True where P is zero.
    """

    mask: np.ndarray

    def __post_init__(self) -> None:
        mask = np.asarray(self.mask)
        if mask.dtype != bool or mask.ndim != 2:
            raise InputError(f"`mask` must be a (ny, nu) array of bool; got {mask.dtype}, shape {mask.shape}")
        self._set(mask=freeze(mask))

    def apply(self, problem: FractionProblem) -> FractionProblem:
        """Add the constraint."""
        if self.mask.shape != problem.values.shape[1:]:
            raise InputError(f"`mask` must have shape (ny, nu) = {problem.values.shape[1:]}; got {self.mask.shape}")
        if np.all(self.mask):
            raise InputError("`mask` makes the whole response zero; leave an entry of it")
        # column l of the mask contains column j
        allowed = np.all(self.mask[:, :, None] | ~self.mask[:, None, :], axis=0)
        return dataclasses.replace(problem, zeros=problem.zeros | np.vstack([~allowed, self.mask]))

    def transposed(self) -> ZeroEntries:
        """The pattern of P^T."""
        return ZeroEntries(self.mask.T)

    def stacked(self, shape: tuple[int, ...]) -> ZeroEntries:
        """The pattern of the entries as one column."""
        if self.mask.shape != shape:
            raise InputError(f"`mask` must have shape (ny, nu) = {shape}; got {self.mask.shape}")
        return ZeroEntries(self.mask.reshape(-1, 1))
