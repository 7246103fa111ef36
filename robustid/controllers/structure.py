"""Structures of controllers: products of factors with free numerators, one or a matrix of them.

A product of factors is a row of states with fixed poles; with its numerator free it is linear in one number more than it has
states: ``C(z) = sum_k x_k b_k(z)``. A numerator of real numbers splits into those of the factors again.
"""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, cast

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from robustid.controllers.factors import Factor
from robustid.core import (
    Complex,
    Real,
    StateMatrices,
    as_array,
    as_float,
    bilinear_in_z,
    counted,
    freeze,
    points_of,
    response_at,
    series,
)
from robustid.errors import InputError, InputTypeError

if TYPE_CHECKING:
    import control

_ROUNDING = 1e-9  # of a pole of an integrator

Product = Factor | Sequence[Factor]


@dataclasses.dataclass(frozen=True, eq=False)
class Matrix:
    """Controllers of several loops, from every measured output to every input.

    Parameters
    ----------
    rows : sequence of rows
        A row for every input of the plant, an entry for every output: factors, or None for nothing.
    actuators : (nu, k) array, optional
        Of k axes: the controller is ``actuators @ C @ sensors``, with k rows. Default: the inputs are the axes.
    sensors : (k, ny) array, optional
        From the outputs to the axes.

    Examples
    --------
    >>> from robustid.design import PID, Matrix, Notch
    >>> Matrix([[PID(), None], [None, [PID(), Notch(300.0)]]]).shape
    (2, 2)
    """

    rows: Sequence[Sequence[Product | None]]
    _: dataclasses.KW_ONLY
    actuators: Real | None = None
    sensors: Real | None = None

    def __post_init__(self) -> None:
        found = tuple(tuple(None if one is None else as_product(one) for one in row) for row in self.rows)
        if not found or not found[0] or len({len(row) for row in found}) > 1:
            raise InputError("`rows` must be rows of one length; an entry is a factor, factors or None")
        if not any(one for row in found for one in row):
            raise InputError("`rows` must hold at least one factor")
        object.__setattr__(self, "rows", found)
        for name, side, count in (("actuators", 1, len(found)), ("sensors", 0, len(found[0]))):
            if getattr(self, name) is None:
                continue
            value = as_array(name, getattr(self, name), ndim=2)
            if value.shape[side] != count:
                raise InputError(
                    f"`{name}` must have {count} {('rows', 'columns')[side]}, one to each axis; got shape {value.shape}"
                )
            object.__setattr__(self, name, freeze(value))

    @property
    def into(self) -> Real:
        """From the rows to the inputs of the plant."""
        return np.eye(len(self.rows)) if self.actuators is None else self.actuators

    @property
    def out_of(self) -> Real:
        """From the outputs of the plant to the columns."""
        return np.eye(len(self.rows[0])) if self.sensors is None else self.sensors

    @property
    def shape(self) -> tuple[int, int]:
        """Inputs and outputs of the plant."""
        return len(self.into), self.out_of.shape[1]


Entry = tuple[int, int, tuple[Factor, ...]]


def entries_of(structure: tuple[Factor, ...] | Matrix, shape: tuple[int, int]) -> list[Entry]:
    """Places (input, output) of factors, for a plant of so many outputs and inputs; of factors alone one loop to each output."""
    ny, nu = shape
    if not isinstance(structure, Matrix):
        if ny != nu:
            raise InputError(
                f"`structure` must be a Matrix for {counted(ny, 'output')} and {counted(nu, 'input')}: factors alone"
                " are one loop to each output"
            )
        return [(k, k, structure) for k in range(ny)]
    if structure.shape != (nu, ny):
        raise InputError(
            f"`structure` must be from the {counted(ny, 'output')} of the plant to its {counted(nu, 'input')}, {nu}"
            f" rows of {counted(ny, 'entry')}; got"
            f" {structure.shape[0]} rows of {structure.shape[1]}"
        )
    return [
        (i, j, as_product(one)) for i, row in enumerate(structure.rows) for j, one in enumerate(row) if one is not None
    ]


def free_of(entries: Sequence[Entry]) -> list[tuple[float, float]]:
    """Intervals of the numbers that are searched."""
    return [interval for *_, factors in entries for one in factors for interval in one.free]


@dataclasses.dataclass(frozen=True)
class Basis:
    """Functions that a controller of a structure is a combination of, with real factors, each in its entry."""

    parts: tuple[tuple[int, int, StateMatrices], ...]  # entry, and its functions: one input, an output for every one
    integral: Real  # (m,) of each, lim s b(s)
    dt: float
    into: Real  # (nu, k): from the rows of entries to the inputs of the plant
    out_of: Real  # (l, ny): from its outputs to the columns

    @property
    def shape(self) -> tuple[int, int]:
        """Inputs and outputs of the plant."""
        return len(self.into), self.out_of.shape[1]

    @property
    def held(self) -> NDArray[np.bool_]:
        """Entries that hold something, (k, l)."""
        found = np.zeros((self.into.shape[1], len(self.out_of)), dtype=bool)
        for i, j, _ in self.parts:
            found[i, j] = True
        return found

    @property
    def count(self) -> int:
        """Number of functions."""
        return sum(len(one.D) for *_, one in self.parts)

    @property
    def integrators(self) -> Iterator[tuple[int, int, Real]]:
        """Entries with an integrator, and its factor by those of all functions, (m,)."""
        place = 0
        for i, j, one in self.parts:
            own = np.zeros(self.count)
            own[place : place + len(one.D)] = self.integral[place : place + len(one.D)]
            place += len(one.D)
            if own.any():
                yield i, j, own

    def response(self, omega: Real) -> Complex:
        """Values at frequencies in rad/s, (F, m, nu, ny)."""
        return self.into @ self.axes(omega) @ self.out_of

    def axes(self, omega: Real) -> Complex:
        """Values between the axes, (F, m, k, l): each function in its entry alone."""
        points, place = points_of(omega, self.dt), 0
        found = np.zeros((omega.size, self.count, *self.held.shape), complex)
        for i, j, one in self.parts:
            found[:, place : place + len(one.D), i, j] = response_at(one, points)[:, :, 0]
            place += len(one.D)
        return found

    def controller(self, factors: Real) -> control.StateSpace:
        """The combination."""
        A, B, C = list[Real](), list[Real](), list[Real]()
        D, place = np.zeros(self.shape, dtype=float), 0
        for i, j, one in self.parts:
            own = factors[None, place : place + len(one.D)]
            place += len(one.D)
            A.append(one.A)
            B.append(one.B * self.out_of[j])
            C.append(self.into[:, i : i + 1] * (own @ one.C))
            D += np.outer(self.into[:, i], self.out_of[j]) * float(own[0] @ one.D[:, 0])
        return StateMatrices(scipy.linalg.block_diag(*A), np.vstack(B), np.hstack(C), D).model(self.dt)


def as_product(structure: object) -> tuple[Factor, ...]:
    """The factors of a product, checked."""
    found: list[Factor] = []
    for one in cast("Sequence[object]", structure) if isinstance(structure, list | tuple) else (structure,):
        if not isinstance(one, Factor):
            raise InputTypeError(
                f"`structure` must be factors of robustid.design, such as PID(filter=500.0) or [PID(), Notch(300.0)]; got"
                f" {type(one).__name__}"
            )
        found.append(one)
    if not found:
        raise InputError("`structure` must hold at least one factor")
    return tuple(found)


def as_structure(structure: object) -> tuple[Factor, ...] | Matrix:
    """Factors of every loop, or a matrix of them."""
    return structure if isinstance(structure, Matrix) else as_product(structure)


def basis_of(
    structure: Sequence[Factor] | Matrix, at: Sequence[float], dt: float, shape: tuple[int, int] = (1, 1)
) -> Basis:
    """Functions of a structure for a plant of so many outputs and inputs, with searched numbers `at`, in the order of `free_of`."""
    given = structure if isinstance(structure, Matrix) else tuple(structure)
    parts: list[tuple[int, int, StateMatrices]] = []
    integral: list[Real] = []
    place = 0
    for i, j, factors in entries_of(given, shape):
        count = sum(len(one.free) for one in factors)
        chain, integrators = _product(factors, at[place : place + count], dt)
        place += count
        parts.append((i, j, chain))
        integral.append(_residues(chain, dt)[:, 0] if integrators else np.zeros(len(chain.D)))
    ny, nu = shape
    into, out_of = (given.into, given.out_of) if isinstance(given, Matrix) else (np.eye(nu), np.eye(ny))
    return Basis(tuple(parts), np.concatenate(integral), dt, into, out_of)


def _product(factors: Sequence[Factor], at: Sequence[float], dt: float) -> tuple[StateMatrices, int]:
    """Functions of a product of factors, and the number of its integrators."""
    integrators, poles, fixed, place = 0, list[complex](), list[StateMatrices](), 0
    for one in factors:
        count = len(one.free)
        found = one.parts(at[place : place + count])
        place += count
        integrators += found.integrator
        poles += found.poles
        fixed += [bilinear_in_z(filter_, dt) if dt else filter_ for filter_ in found.filters]
        for system, base in found.systems:
            if base is not None and not math.isclose(as_float("dt", base), dt, rel_tol=1e-9):
                raise InputError(f"`structure` holds a fixed model with dt = {base:g} s; the plant has dt = {dt:g} s")
            if system.D.shape != (1, 1):
                raise InputError("`structure` holds a fixed model of several inputs or outputs; give one of one each")
            fixed.append(system)
    chain = _chain(poles, integrators, dt)
    for one in fixed:
        chain = series(one, chain)
    return chain, integrators


def _chain(poles: Sequence[complex], integrators: int, dt: float) -> StateMatrices:
    """The constant and the states of a row of sections, each driven by an all-pass of those before: integrators are last."""
    whole = StateMatrices(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((0, 0)), np.zeros((0, 1)))
    out = StateMatrices(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.ones((1, 1)))  # of the row so far
    for pole in sorted(poles, key=lambda one: one.real):
        section = _section(pole, dt)
        whole, out = _lengthened(whole, out, section)
    for _ in range(integrators):
        step = np.array([[1.0 if dt else 0.0]])
        gain = np.array([[dt or 1.0]])
        whole, out = _lengthened(whole, out, StateMatrices(step, gain, np.eye(1), np.zeros((1, 1))))
    n = len(whole.A)
    return StateMatrices(
        whole.A, whole.B, np.vstack([np.zeros((1, n)), np.eye(n)]), np.vstack([np.ones((1, 1)), np.zeros((n, 1))])
    )


def _section(pole: complex, dt: float) -> StateMatrices:
    """An all-pass with a pole, or with a pair, whose states are of the size of its input."""
    if dt:
        at = np.exp(pole * dt) if np.isfinite(pole.real) else 0.0
        bottom: Real = np.asarray(np.real(np.poly([at, np.conj(at)] if pole.imag else [at])), dtype=float)
        top: Real = bottom[::-1]
    else:
        bottom = np.asarray(np.real(np.poly([pole, np.conj(pole)] if pole.imag else [pole])), dtype=float)
        top = bottom * (-1.0) ** np.arange(len(bottom) - 1, -1, -1)
    A, B, C, D = _canonical(top, bottom)
    if not dt:  # states in the units of the pole
        scale = np.abs(pole) ** np.arange(len(A))
        A, B, C = A * scale / scale[:, None], B / scale[:, None], C * scale
        B, C = B * np.abs(pole), C / np.abs(pole)
    return StateMatrices(A, B, C, D)


def _canonical(top: Real, bottom: Real) -> tuple[Real, Real, Real, Real]:
    import scipy.signal

    A, B, C, D = (np.asarray(one, dtype=float) for one in scipy.signal.tf2ss(np.trim_zeros(top, "f"), bottom))
    return A[::-1, ::-1], B[::-1], C[:, ::-1], D


def _lengthened(
    whole: StateMatrices, out: StateMatrices, section: StateMatrices
) -> tuple[StateMatrices, StateMatrices]:
    """The states of a row with those of one more section, and the output of all."""
    E, F, G, H = section
    A = np.block([[whole.A, np.zeros((len(whole.A), len(E)))], [F @ out.C, E]])
    B = np.vstack([whole.B, F @ out.D])
    row = StateMatrices(A, B, np.hstack([H @ out.C, G]), H @ out.D)
    return StateMatrices(A, B, np.zeros((0, len(A))), np.zeros((0, 1))), row


def integral_gain(controller: StateMatrices, dt: float) -> float:
    """Factor of the integrator of a controller; of a matrix the smallest singular value of those factors. 0 where it has none."""
    A = controller.A
    if not len(A):
        return 0.0
    pole = 1.0 if dt else 0.0
    if np.min(np.abs(scipy.linalg.eigvals(A) - pole)) > _ROUNDING * _size(A, dt):
        return 0.0
    factors = _residues(controller, dt)
    return float(factors[0, 0]) if factors.shape == (1, 1) else float(np.linalg.svd(factors, compute_uv=False)[-1])


def _size(A: Real, dt: float) -> float:
    return 1.0 if dt else max(1.0, float(np.abs(A).max()))


def _residues(system: StateMatrices, dt: float) -> Real:
    """Factors of the integrators, ``lim s b(s)`` or ``lim (z - 1)/dt b(z)``, from every input to every output."""
    A, B, C, _ = system
    values, left, right = scipy.linalg.eig(A, left=True)
    away = np.abs(values - (1.0 if dt else 0.0))
    own = away <= away.min() + _ROUNDING * _size(A, dt)
    V, W = right[:, own], left[:, own].conj().T
    factors: Complex = np.asarray(C @ V @ np.linalg.solve(W @ V, W @ B), dtype=complex)
    return factors.real / (dt or 1.0)
