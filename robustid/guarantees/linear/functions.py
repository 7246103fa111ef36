"""The parametric part as linear certificates see it: known functions, and modes whose poles lie in a box."""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import dataclasses
import functools
from typing import Any, Protocol

import numpy as np
import scipy.sparse.csgraph
from numpy.typing import ArrayLike, NDArray

from robustid.bases import ParametricBasis
from robustid.core import Complex, Frozen, Plane, Real, StateMatrices, as_array, simulate
from robustid.errors import InputError, InputTypeError
from robustid.guarantees.curvature import ArcDerivatives, input_normal
from robustid.guarantees.linear.pole_discs import PoleDiscs, discs_of
from robustid.identification import MixedProblem

_DELAYS = 9  # of pairs: those that are tried
_SAME = 1e-8  # relative: functions that are combinations of others up to rounding
_LEFT_OUT = 1e-3  # of a mode, by its series, where the bounds of the samples ask for no less
_TO_BOUND = 0.02  # of the bound of a sample, by the series
_NEAR = 3.0  # half-widths around a mode in which its resonance is looked for

Box = tuple[Real, Real]  # ends (M, 2) of the natural frequencies in rad/s, and of the damping ratios


class SuggestedBox(Protocol):
    """The part of a `KautzSuggestion` that a pole-uncertainty box is made of."""

    @property
    def omega_interval(self) -> Real:
        """Ends (M, 2) of the natural frequencies, rad/s."""
        ...

    @property
    def damping_interval(self) -> Real:
        """Ends (M, 2) of the damping ratios."""
        ...


BoxLike = SuggestedBox | tuple[ArrayLike, ArrayLike]


@dataclasses.dataclass(frozen=True, eq=False)
class Functions(Frozen):
    """m known functions of an entry; each coefficient belongs to one of the amplitudes.

    Amplitudes are the real coefficients of the fixed functions, then the complex c' of the modes. Further coefficients of a mode's
    series are parts of it, of bounded size.
    """

    fixed: ParametricBasis | None
    modes: PoleDiscs | None
    kept: tuple[int, ...]  # numbers of the fixed functions in the basis of the problem

    @property
    def fixed_count(self) -> int:
        """Number of fixed functions."""
        return len(self.kept)

    @property
    def amplitudes(self) -> int:
        """Number of amplitudes of an entry."""
        return self.fixed_count + (0 if self.modes is None else self.modes.middle.size)

    @functools.cached_property
    def _columns(self) -> tuple[tuple[int, float, bool], ...]:
        own = [(k, 1.0, False) for k in range(self.fixed_count)]
        modes = () if self.modes is None else self.modes.columns
        return (*own, *((self.fixed_count + mode, size, conjugate) for mode, size, conjugate in modes))

    @functools.cached_property
    def amplitude_of(self) -> NDArray[np.intp]:
        """Numbers of the amplitudes that the coefficients belong to, (m,)."""
        return np.array([one[0] for one in self._columns], dtype=int)

    @functools.cached_property
    def powers(self) -> Real:
        """Largest size of every coefficient for an amplitude of 1, (m,)."""
        return np.array([one[1] for one in self._columns])

    @functools.cached_property
    def first(self) -> NDArray[np.bool_]:
        """Mask of the coefficients that are the amplitude itself, or its conjugate, (m,)."""
        modes = () if self.modes is None else self.modes.first
        return np.array([*(True,) * self.fixed_count, *modes], dtype=bool)

    @functools.cached_property
    def conjugate(self) -> NDArray[np.bool_]:
        """Mask of those that belong to the conjugate of the amplitude, (m,)."""
        return np.array([conjugate for _, _, conjugate in self._columns], dtype=bool)

    @functools.cached_property
    def turns(self) -> Real:
        """Angles at which the functions of the amplitudes are largest among the frequencies, (amplitudes,)."""
        found = np.zeros(self.amplitudes)
        if self.fixed is not None and self.fixed.states:
            grid = np.linspace(0, np.pi, 2001)[1:-1]
            found[: self.fixed_count] = grid[np.argmax(np.abs(self.fixed.response(grid)), axis=0)]
        if self.modes is not None:
            found[self.fixed_count :] = np.angle(self.modes.middle)
        return found

    def values(self, angles: Real) -> Complex:
        """Values at exp(j angle), angles of either sign, (N, m)."""
        own = np.zeros((len(angles), 0), complex) if self.fixed is None else self.fixed.response(angles)
        return own if self.modes is None else np.concatenate([own, self.modes.values(angles)], axis=1)

    def left_out(self, angles: Real) -> Real:
        """Most that the series of the modes leave out for an amplitude of 1, (N, amplitudes)."""
        found = np.zeros((len(angles), self.amplitudes))
        if self.modes is not None:
            found[:, self.fixed_count :] = self.modes.left_out(angles)
        return found

    def responses(self, u: Real) -> Complex:
        """Responses to an input (T,) from zero initial conditions, (T, m)."""
        own = np.zeros((len(u), 0), complex)
        if self.fixed is not None:
            system: Any = StateMatrices(*self.fixed.matrices)
            own = simulate(system, u[:, None])[0].astype(complex)
        return own if self.modes is None else np.concatenate([own, self.modes.responses(u)], axis=1)

    def left_out_in_time(self, u: Real) -> Real:
        """Most that the series leave out of such responses, (T, amplitudes)."""
        found = np.zeros((len(u), self.amplitudes))
        if self.modes is not None:
            found[:, self.fixed_count :] = self.modes.left_out_in_time(u)
        return found

    def bends(self, low: Real, high: Real) -> Real:
        """Bound of the second derivative along arcs of what every amplitude does, for an amplitude of 1, (arcs, amplitudes)."""
        found = np.zeros((low.size, self.amplitudes))
        if self.fixed is not None:
            found[:, : self.fixed_count] = self._of_fixed.on_arcs(low, high)[:, :, 0]
        if self.modes is not None:
            found[:, self.fixed_count :] = self.modes.bends(low, high)
        return found

    @functools.cached_property
    def _of_fixed(self) -> ArcDerivatives:
        states: Any = self.fixed
        return ArcDerivatives(*input_normal(states.A, states.B, states.C))

    def largest_on(self, low: Real, high: Real) -> Real:
        """Bound of the modulus of the same on arcs, (arcs, amplitudes)."""
        found = np.zeros((low.size, self.amplitudes))
        if self.fixed is not None:
            ends = [np.abs(self.fixed.response(end)) for end in (low, high)]
            bent = self.bends(low, high)[:, : self.fixed_count] * ((high - low) ** 2 / 8)[:, None]
            found[:, : self.fixed_count] = np.maximum(*ends) + bent
        if self.modes is not None:
            found[:, self.fixed_count :] = self.modes.largest_on(low, high)
        return found


def fixed_functions(basis: ParametricBasis | None) -> Functions:
    """The functions of a basis, all of them known."""
    return Functions(basis, None, () if basis is None else tuple(range(basis.size)))


def functions_over(
    basis: ParametricBasis | None, plane: Plane, omega: Real, damping: Real, peaks: Real | None = None
) -> Functions:
    """The functions of a basis whose pairs have their poles anywhere in a pole-uncertainty box, a row (M, 2) a mode.

    `peaks` (M,) are sizes of the modes at their resonance in units of the bounds there: they say how many terms the series take.
    InputError for a box that has not as many modes as the basis has pairs, or does not hold their poles.
    """
    pairs = {} if basis is None else pairs_of(basis)
    if basis is None or not pairs:
        raise InputError("`box` holds poles of `kautz` pairs, and `parametric` has none; leave the box out")
    poles = np.array([pole for pole, _ in pairs.values()])
    delays = {delay for _, delay in pairs.values()}
    if len(delays) > 1:
        raise InputError(f"`box` needs pairs of one delay; those of `parametric` have {sorted(delays)}")
    order = np.argsort(np.angle(poles))
    if omega.shape != (poles.size, 2) or damping.shape != omega.shape:
        raise InputError(
            f"`box` must have one row (low, high) for each of the {poles.size} modes of `parametric`; got"
            f" {omega.shape} and {damping.shape}"
        )
    s = plane.exponents(poles[order])
    for name, ends, own in (("frequency", omega, np.abs(s)), ("damping", damping, -s.real / np.abs(s))):
        outside = (own < ends[:, 0] * (1 - 1e-9)) | (own > ends[:, 1] * (1 + 1e-9))
        if np.any(outside):
            mode = int(np.argmax(outside))
            raise InputError(
                f"`box` must hold the poles of `parametric`, by rising frequency: mode {mode + 1} has the {name}"
                f" {own[mode]:.9g}, its row is {ends[mode].tolist()}"
            )
    wanted = np.full(poles.size, _LEFT_OUT)
    if peaks is not None:
        wanted = np.minimum(wanted, _TO_BOUND / np.maximum(peaks, 1e-300))
    modes = discs_of(plane, omega, damping, delays.pop(), wanted)
    taken = {number for both in pairs for number in both}
    kept = tuple(k for k in range(basis.size) if k not in taken)
    fixed = None
    if kept:
        A, B, C, D = basis.matrices
        functions = tuple(basis.functions[k] for k in kept)
        states = np.flatnonzero(reached(basis)[list(kept)].any(axis=0))
        fixed = ParametricBasis(
            A[np.ix_(states, states)], B[states], C[np.ix_(np.array(kept), states)], D[list(kept)], basis.dt, functions,
            corner=basis.corner,
        )  # fmt: skip
    return Functions(fixed, modes, kept)


def reached(basis: ParametricBasis) -> NDArray[np.bool_]:
    """Mask of the states that every function depends on, (m, n): blocks of A that are not connected are of different modes."""
    number = scipy.sparse.csgraph.connected_components(basis.A != 0, directed=False)[1]
    return (basis.C != 0) @ (number[:, None] == number)


def pairs_of(basis: ParametricBasis) -> dict[tuple[int, int], tuple[complex, int]]:
    """Pairs of functions that span x^delay/(1 - a x) and its conjugate, or (1 + x)/(1 - a x): their numbers, a and the delay.

    Two functions of the same states that no other function has, with one pole in the upper half plane besides zeros.
    """
    if not basis.states:
        return {}
    of, angles = reached(basis), np.array([0.3, 0.9, 1.7, 2.4, 2.9])
    values, x = basis.response(angles), np.exp(-1j * angles)
    found: dict[tuple[int, int], tuple[complex, int]] = {}
    for k in range(basis.size - 1):
        states = np.flatnonzero(of[k])
        if np.flatnonzero(of[:, states].any(axis=1)).tolist() != [k, k + 1]:
            continue
        own = np.linalg.eigvals(basis.A[np.ix_(states, states)])
        own = own[np.imag(own) > 0]
        if own.size != 1:
            continue
        pole = complex(basis.poles[np.argmin(np.abs(basis.poles - own[0]))])
        for delay in range(-1 if basis.corner is not None else 0, _DELAYS):
            n = 1 + x if delay < 0 else x**delay
            span = np.stack([n / (1 - pole * x), n / (1 - np.conj(pole) * x)], axis=1)
            left = values[:, k : k + 2] - span @ np.linalg.lstsq(span, values[:, k : k + 2], rcond=None)[0]
            if np.linalg.norm(left) <= _SAME * np.linalg.norm(values[:, k : k + 2]):
                found[k, k + 1] = pole, delay
                break
    return found


def has_box(basis: ParametricBasis | None, modes: int) -> bool:
    """Return whether functions are single pairs of so many modes, besides others: a pole-uncertainty box can hold these."""
    return basis is not None and len(pairs_of(basis)) == modes


def ends_of(box: Any) -> tuple[Real, Real]:
    """The intervals of a box."""
    omega, damping = getattr(box, "omega_interval", None), getattr(box, "damping_interval", None)
    if omega is None or damping is None:
        try:
            omega, damping = box
        except (TypeError, ValueError):
            raise InputTypeError(
                "`box` must be a KautzSuggestion or a pair of (M, 2) arrays: natural frequencies in rad/s, damping ratios;"
                f" got {type(box).__name__}"
            ) from None
    omega, damping = as_array("box", omega, ndim=2), as_array("box", damping, ndim=2)
    for name, ends in (("frequencies", omega), ("damping ratios", damping)):
        if ends.shape[1:] != (2,) or np.any(ends[:, 0] > ends[:, 1]) or np.any(ends <= 0):
            raise InputError(f"`box` must hold positive ends (low, high) of the {name}; got {ends.tolist()}")
    if omega.shape != damping.shape:
        raise InputError(
            f"`box` must have one row (low, high) a mode in both parts; got {omega.shape} for the frequencies and"
            f" {damping.shape} for the damping ratios"
        )
    if np.any(damping >= 1):
        raise InputError(f"`box` must hold damping ratios below 1; got {damping.max():g}")
    return omega, damping


def functions_of(problem: MixedProblem, box: BoxLike | None) -> Functions:
    """The parametric part, with its poles in the box."""
    if box is None:
        return fixed_functions(problem.parametric)
    omega, damping = ends_of(box)
    # Largest samples around every mode, in units of their bounds, (M,): so exactly its series must be.
    found = np.zeros(len(omega))
    for points in problem.frequency:
        size = np.abs(np.where(points.bound.used, points.values, 0)) / points.bound.outer_radius
        size = size.max(axis=(1, 2))
        for k, ((low, high), (_, most)) in enumerate(zip(omega.tolist(), damping.tolist(), strict=True)):
            near = np.abs(points.omega - (low + high) / 2) <= (high - low) / 2 + _NEAR * most * high
            near[np.argmin(np.abs(points.omega - (low + high) / 2))] = True
            found[k] = max(found[k], float(size[near].max()))
    for record in problem.time:
        size = np.abs(np.where(record.bound.used, record.y, 0)) / record.bound.radius
        found = np.maximum(found, float(size.max()))
    return functions_over(problem.parametric, problem.plane, omega, damping, found)
