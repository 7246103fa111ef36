"""The numerator of a controller that was found, split into those of the factors of its structure."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import scipy.linalg

from robustid.controllers.by_hand import HZ, Corner, Gains, Kept, OneRoot, Section, Sections, TwoRoots, shifted
from robustid.controllers.factors import FIR, PID, Factor, Fixed, LeadLag, LowPass, Notch
from robustid.controllers.structure import basis_of
from robustid.core import Complex, Real, StateMatrices, points_of, response_at
from robustid.errors import InputError
from robustid.identification import as_system

_POINTS = 400  # frequencies at which numerators are compared
_BELOW, _BESIDE = 1e-5, 100.0  # of half the sample rate, or of the poles: where they begin and end
_LOST = 1e-6  # of the values of the controller
_FAR = 1e-10  # of 1 over the distance of a zero, in that of the poles: nearer to 0 it is at infinity


class _Placed(NamedTuple):
    """A factor with what was searched of it."""

    factor: Factor
    at: tuple[float, ...]

    @property
    def poles(self) -> list[complex]:
        """Poles of its section in s, both of a pair."""
        found = self.factor.parts(self.at)
        return [one for pole in found.poles for one in ((pole, pole.conjugate()) if pole.imag else (pole,))]

    @property
    def zeros(self) -> int:
        """Zeros that are free."""
        return len(self.poles) + self.factor.parts(self.at).integrator


def split(controller: object, structure: Sequence[Factor], searched: Sequence[float], dt: float) -> Sections:
    """Sections of a controller of a product of factors, whose searched numbers are given in their order.

    Complex zeros go to the notches of the nearest natural frequency, real ones to leads and lags, what is left to the PID: its
    gains are those of the polynomial. A factor whose zeros have no such numbers (at negative z, one stable and one not) stays as
    it was found.

    Raises
    ------
    InputError
        A controller that no numbers of this structure make.
    """
    placed, place = list[_Placed](), 0
    for one in structure:
        count = len(one.free)
        placed.append(_Placed(one, tuple(map(float, searched[place : place + count]))))
        place += count
    system, omega = as_system("controller", controller)[0], _frequencies(placed, dt)
    values = response_at(system, points_of(omega, dt))[:, 0, 0]
    factors = _factors(placed, dt, values, omega)
    free = [one for one in placed if not isinstance(one.factor, LowPass | Fixed)]
    numerator = _made(free, dt, factors)
    zeros = _zeros(numerator, dt)
    found = _Split(free, zeros, dt)
    found.assign()
    point = shifted_points(omega, dt)
    poles = np.concatenate([_poles(one, dt) for one in free] or [np.zeros(0, complex)])
    whole = response_at(numerator, points_of(omega, dt))[:, 0, 0]
    leading = float(np.real(np.mean(whole * _product(point, poles) / _product(point, zeros))))
    return found.sections(placed, leading, omega)


def shifted_points(omega: Real, dt: float) -> Complex:
    """Points of frequencies, counted from frequency 0."""
    return shifted(np.asarray(1j * omega, dtype=complex), dt)


def _frequencies(placed: Sequence[_Placed], dt: float) -> Real:
    if dt:
        return np.geomspace(_BELOW, 0.999, _POINTS) * math.pi / dt
    sizes = [abs(pole) for one in placed for pole in one.poles if np.isfinite(pole)] or [1.0]
    return np.geomspace(min(sizes) / _BESIDE, max(sizes) * _BESIDE, _POINTS)


def _factors(placed: Sequence[_Placed], dt: float, values: Complex, omega: Real) -> Real:
    """Factors of the functions of a structure that give values at frequencies."""
    basis = basis_of([one.factor for one in placed], [x for one in placed for x in one.at], dt)
    functions = basis.response(omega).reshape(omega.size, -1)
    sizes = np.maximum(np.abs(values), np.finfo(float).tiny)
    weighed = functions / sizes[:, None]
    columns = np.concatenate([weighed.real, weighed.imag])
    wanted = np.concatenate([(values / sizes).real, (values / sizes).imag])
    scale = np.linalg.norm(columns, axis=0)
    factors: Real = np.asarray(np.linalg.lstsq(columns / scale, wanted)[0], dtype=float)
    if np.abs(columns / scale @ factors - wanted).max(initial=0.0) > _LOST:
        raise InputError("`controller` must be one of its structure: no numerator gives its values")
    return factors / scale


def _made(placed: Sequence[_Placed], dt: float, factors: Real) -> StateMatrices:
    basis = basis_of([one.factor for one in placed], [x for one in placed for x in one.at], dt)
    return StateMatrices.of(basis.controller(factors))


def _zeros(system: StateMatrices, dt: float) -> Complex:
    """Finite zeros, counted from frequency 0."""
    A, B, C, D = system
    n = len(A)
    if not n:
        return np.zeros(0, complex)
    inner = A - np.eye(n) if dt else A
    size = float(np.abs(inner).max()) or 1.0
    pencil = np.block([[inner / size, B / size], [C, D]])
    ends = scipy.linalg.block_diag(np.eye(n), np.zeros((1, 1)))
    above, below = scipy.linalg.eigvals(pencil, ends, homogeneous_eigvals=True)
    finite = np.abs(below) > _FAR * np.abs(above)
    return np.asarray(size * above[finite] / below[finite], dtype=complex)


def _poles(one: _Placed, dt: float) -> Complex:
    """Poles of a factor, counted from frequency 0."""
    given = np.array([pole for pole in one.poles if np.isfinite(pole)], dtype=complex)
    delays = len(one.poles) - given.size
    integrators = np.zeros(int(one.factor.parts(one.at).integrator), complex)
    return np.concatenate([integrators, shifted(given, dt), np.full(delays, -1.0 + 0j)])


def _product(points: Complex, roots: Complex) -> Complex:
    return np.prod(points[:, None] - roots, axis=1)


class _Split:
    """Zeros on their way to the factors."""

    def __init__(self, placed: Sequence[_Placed], zeros: Complex, dt: float) -> None:
        self.dt, self.placed = dt, list(placed)
        self.pairs = [complex(one) for one in zeros if one.imag > 0]
        self.reals = [float(one.real) for one in zeros if one.imag == 0]
        self.own: dict[int, list[complex]] = {}  # zeros of every factor that has them

    def assign(self) -> None:
        """Give every factor its zeros where they make one of its kind."""
        notches = self._of(Notch)
        self._greedy(notches, self.pairs, lambda k, zero: abs(math.log(abs(self._exponent(zero)) / self._natural(k))))
        twos = [both for both in itertools.combinations(self.reals, 2) if self._alike(both)]
        self._greedy_reals([k for k in notches if k not in self.own], twos)
        leads = self._of(LeadLag)
        ones = [(one,) for one in self.reals if self._known(one)]
        self._greedy_reals(leads, ones)
        pids = self._of(PID)
        if self.pairs and len(pids) == 1 and self.placed[pids[0]].zeros == 1:
            self._join(pids[0], [k for k in leads if k not in self.own])
        for k in self._of(PID):
            self._rest(k)

    def _of(self, kind: type) -> list[int]:
        return [k for k, one in enumerate(self.placed) if isinstance(one.factor, kind)]

    def _exponent(self, zero: complex) -> complex:
        return complex(np.log1p(zero)) / self.dt if self.dt else zero

    def _natural(self, k: int) -> float:
        """Natural frequency of the poles of a notch or a lead."""
        poles = self.placed[k].poles
        return float(np.abs(np.prod(poles))) ** (1 / len(poles))

    def _known(self, zero: float) -> bool:
        """Say whether a real zero is one of a real number in s, and not 0."""
        return zero != 0 and (not self.dt or zero > -1)

    def _alike(self, both: tuple[float, ...]) -> bool:
        return all(map(self._known, both)) and both[0] * both[1] > 0

    def _greedy(self, slots: list[int], pairs: list[complex], distance: Callable[[int, complex], float]) -> None:
        open_ = set(slots)
        while open_ and pairs:
            k, zero = min(itertools.product(sorted(open_), pairs), key=lambda one: distance(*one))
            self.own[k] = [zero, zero.conjugate()]
            open_.remove(k)
            pairs.remove(zero)

    def _greedy_reals(self, slots: list[int], groups: Sequence[tuple[float, ...]]) -> None:
        """Real zeros, one or two at a time, to the nearest poles."""
        open_ = set(slots)
        left: list[tuple[float, ...]] = list(groups)
        while open_ and left:

            def distance(one: tuple[int, tuple[float, ...]]) -> float:
                sizes = [math.log(abs(self._exponent(zero))) for zero in one[1]]
                return abs(sum(sizes) / len(sizes) - math.log(self._natural(one[0])))

            k, group = min(itertools.product(sorted(open_), left), key=distance)
            self.own[k] = [complex(one) for one in group]
            open_.remove(k)
            for zero in group:
                self.reals.remove(zero)
            left = [one for one in left if not set(one) & set(group)]

    def _join(self, pid: int, leads: list[int]) -> None:
        """PI and a lead with two complex zeros are a PID, whose derivative ends at the pole of the lead."""
        if leads and isinstance(factor := self.placed[pid].factor, PID) and factor.integral:
            at = self.placed[leads[0]].at
            self.placed[pid] = _Placed(PID(filter=at[0]), at)
            self.own = {k - (k > leads[0]): zeros for k, zeros in self.own.items()}
            del self.placed[leads[0]]

    def _rest(self, k: int) -> None:
        """Zeros of a PID, of those that are left: those nearest to frequency 0; fewer where some are at infinity."""
        room, found = self.placed[k].zeros, list[complex]()
        if room >= 2 and self.pairs:
            zero = min(self.pairs, key=abs)
            self.pairs.remove(zero)
            found, room = [zero, zero.conjugate()], room - 2
        for zero in sorted(self.reals, key=abs)[:room]:
            self.reals.remove(zero)
            found.append(complex(zero))
        if self.pairs and len(found) < self.placed[k].zeros:
            self.reals += [one.real for one in found]  # a pair needs what stays open here
            return
        self.own[k] = found

    def sections(self, placed: Sequence[_Placed], leading: float, omega: Real) -> Sections:
        """The row, with the factor of the numerator where it belongs: in the gains, in what is kept, or as the gain of all."""
        parts: dict[int, Section] = {k: one for k in self.own if (one := self._section(k)) is not None}
        for k in parts:
            leading /= float(np.real(np.prod(_poles(self.placed[k], self.dt)) / np.prod(self.own[k])))
        pids = [k for k in self._of(PID) if k in self.own]
        kept = [one for k, one in enumerate(self.placed) if k not in self.own]
        row: list[Section] = []
        for k in pids:
            row.append(self._gains(k, leading))
            leading = 1.0
        row += [parts[k] for k in sorted(parts)]
        for one in placed:
            if isinstance(one.factor, LowPass):
                row.append(Corner(one.at[0] / HZ, one.factor.order))
            if isinstance(one.factor, Fixed):
                row.append(Kept("known model", as_system("model", one.factor.model)[0]))
        if kept:
            row.append(self._kept(kept, leading, omega))
            leading = 1.0
        return Sections(self.dt, leading, tuple(row))

    def _section(self, k: int) -> Section | None:
        """A notch or a lead with its zeros."""
        factor, (pole, *_) = self.placed[k].factor, self.placed[k].at or (0.0,)
        s = [self._exponent(zero) for zero in self.own[k]]
        if isinstance(factor, LeadLag):
            return OneRoot(-s[0].real / HZ, pole / HZ)
        if not isinstance(factor, Notch):
            return None
        omega = math.sqrt(abs(s[0] * s[1]))
        return TwoRoots(omega / HZ, -(s[0] + s[1]).real / (2 * omega), pole / HZ, float(factor.damping))

    def _gains(self, k: int, leading: float) -> Gains:
        """Gains of the polynomial ``leading (w - n_1)(w - n_2)`` over w and w - a."""
        placed, zeros = self.placed[k], np.array(self.own[k], dtype=complex)
        integral, (filter_, *_) = placed.factor.parts(placed.at).integrator, placed.at or (None,)
        unit, pole = self.dt or 1.0, 0.0
        if filter_ is not None:
            pole = float(shifted(np.array([-filter_]), self.dt)[0].real)

        def numerator(w: float) -> float:
            return leading * float(np.real(np.prod(w - zeros)))

        direct = leading if zeros.size == placed.zeros else 0.0
        ki = numerator(0.0) / (-pole if filter_ is not None else 1.0) / unit if integral else None
        if filter_ is None:
            return Gains(direct, ki)
        slope = numerator(pole) / (pole * (pole if integral else 1.0))  # kd times -pole/unit
        return Gains(direct - slope, ki, slope * unit / -pole, filter_ / HZ)

    def _kept(self, kept: Sequence[_Placed], leading: float, omega: Real) -> Kept:
        """Factors without numbers of their own, with the zeros that are left."""
        zeros = np.array([*self.reals, *self.pairs, *(one.conjugate() for one in self.pairs)], dtype=complex)
        point = shifted_points(omega, self.dt)
        poles = np.concatenate([_poles(one, self.dt) for one in kept])
        values = leading * _product(point, zeros) / _product(point, poles)
        names: dict[type[Factor], str] = {FIR: "past samples", PID: "PID", Notch: "notch", LeadLag: "lead or lag"}
        words = ", ".join(names[type(one.factor)] for one in kept)
        return Kept(words, _made(kept, self.dt, _factors(kept, self.dt, values, omega)))
