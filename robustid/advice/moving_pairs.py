"""Parametric bases whose Kautz pairs can move, and the change of the samples that a move makes."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from robustid.bases import ParametricBasis, Sections, kautz, stack_bases
from robustid.core import Complex, Frozen, Real, freeze
from robustid.errors import InputError
from robustid.identification import MixedProblem
from robustid.identification.formulation import Formulation, formulate_in

_SAME = 1e-6  # relative: a block that agrees with `kautz` so far was made by it
_STEP = 1e-4  # of a difference quotient, in the units of `units`
_LIGHTEST, _HEAVIEST = 1e-6, 0.99  # damping ratios that poles may move to
_HIGHEST = 0.999  # of the Nyquist frequency


@dataclasses.dataclass(frozen=True)
class _Pair:
    """One `kautz` mode: its place among the poles, and its form."""

    mode: int
    repeat: int
    delay: int


@dataclasses.dataclass(frozen=True, eq=False)
class MovingPairs(Frozen):
    """A parametric basis taken apart: Kautz pairs, which can move, and blocks that stay as they are."""

    parts: tuple[ParametricBasis | _Pair, ...]
    start: Real  # (M, 2), log of natural frequency [rad/s] and log of damping ratio of every pair
    dt: float

    def __post_init__(self) -> None:
        self._set(start=freeze(np.asarray(self.start, float).reshape(-1, 2)))

    @property
    def pairs(self) -> list[_Pair]:
        """The pairs that can move, in their order."""
        return [part for part in self.parts if isinstance(part, _Pair)]

    def repeated(self) -> MovingPairs:
        """Each pair once more."""
        parts = (dataclasses.replace(p, repeat=p.repeat + 1) if isinstance(p, _Pair) else p for p in self.parts)
        return dataclasses.replace(self, parts=tuple(parts))

    def at(self, poles: Real) -> ParametricBasis:
        """The basis with its pairs at these poles."""
        made: list[ParametricBasis] = []
        for part in self.parts:
            if isinstance(part, _Pair):
                omega, damping = np.exp(poles[part.mode])
                part = kautz(omega, damping, dt=self.dt, repeat=part.repeat, delay=part.delay)
            made.append(part)
        return stack_bases(made)

    def inside(self, poles: Real) -> Real:
        """Return the poles with dampings and frequencies that are possible: inside the circle, below the Nyquist frequency."""
        damping = np.clip(poles[:, 1], np.log(_LIGHTEST), np.log(_HEAVIEST))
        if not self.dt:
            return np.stack([poles[:, 0], damping], axis=1)
        turn = np.log(_HIGHEST * np.pi / self.dt) - 0.5 * np.log1p(-np.exp(2 * damping))
        return np.stack([np.minimum(poles[:, 0], turn), damping], axis=1)


def units(problem: MixedProblem, poles: Real) -> Real:
    """Steps over which the samples are approximately linear in the logs of frequency and damping, (M, 2).

    In frequency the distance of the pole from the nearest frequency point on the circle, for records of N samples 1/N rad or the
    half-width: a damping far below what the data resolve must not make the steps tiny. In damping a factor e.
    """
    turn, damping = problem.plane.turned(*np.exp(poles).T)
    half = damping * turn
    away = [np.maximum(half, 1 / record.u.shape[0]) for record in problem.time]
    for frf in problem.frequency:
        away.append(np.hypot(half, np.abs(problem.plane.angles(frf.omega)[:, None] - turn).min(axis=0)))
    return np.stack([np.min(away, axis=0) / turn, np.ones(len(poles))], axis=1)


def taken_apart(basis: ParametricBasis) -> MovingPairs:
    """Find the pairs that `kautz` made in a basis."""
    from scipy.sparse.csgraph import connected_components

    basis = basis.in_s()
    n = basis.states
    links = np.zeros((n + basis.size,) * 2, bool)
    links[:n, :n], links[n:, :n] = basis.A != 0, basis.C != 0
    label = np.asarray(connected_components(links, directed=False)[1])
    parts: list[ParametricBasis | _Pair] = []
    start: list[Real] = []
    for number in dict.fromkeys(label[n:].tolist()):
        part = _block(basis, np.flatnonzero(label[:n] == number), np.flatnonzero(label[n:] == number))
        found = _mode_of(part)
        if found is not None:
            pole, repeat, delay = found
            part = _Pair(len(start), repeat, delay)
            start.append(pole)
        parts.append(part)
    return MovingPairs(tuple(parts), np.array(start), basis.dt)


def _block(basis: ParametricBasis, states: NDArray[np.intp], functions: NDArray[np.intp]) -> ParametricBasis:
    """Some functions with the states that they need, and the poles as they are known."""
    A, kept = basis.A[states][:, states], tuple(basis.functions[int(i)] for i in functions)
    computed = np.linalg.eigvals(A) if states.size else np.zeros(0)
    poles = basis.poles[np.abs(computed[:, None] - basis.poles).argmin(axis=1)] if states.size else computed
    C = basis.C[functions][:, states]
    return ParametricBasis(A, basis.B[states], C, basis.D[functions], basis.dt, kept, poles)


def _mode_of(part: ParametricBasis) -> tuple[Real, int, int] | None:
    """Logs of frequency and damping, multiplicity and delay of what `kautz` made; None of anything else."""
    n, m = part.states, part.size
    if m < 2 or m % 2 or n < m:
        return None
    a = complex(part.A[0, 0], part.A[1, 0])
    if not (a.imag > 0 and (abs(a) < 1 if part.dt else a.real < 0)):
        return None
    s, step = (np.log(a), part.dt) if part.dt else (a, 1.0)
    size = abs(s)
    damping, delay = -s.real / size, 0 if part.D.any() or not part.dt else n - m + 1
    made = kautz(size / step, damping, dt=part.dt, repeat=m // 2, delay=delay)
    for name in "ABCD":
        own, other = getattr(part, name), getattr(made, name)
        if own.shape != other.shape or not np.allclose(own, other, rtol=_SAME, atol=_SAME * np.abs(other).max()):
            return None
    return np.log([size / step, damping]), m // 2, delay


def moved_samples(pairs: MovingPairs, formulation: Formulation, p: Real, poles: Real) -> Complex:
    """Derivatives of what the parametric part gives at the samples, to the logs of the poles, (N, 2 M), in units of the bounds.

    Of P(theta) q(theta) with the q nearest to P p: the projection of P p on the span at theta. So the scale of the functions,
    and which basis of the free transients was taken, do not matter.
    """
    problem, rows = formulation.problem, formulation.rows
    given, step = rows.P @ p, (_STEP * units(problem, poles)).ravel()

    def projected(which: int, sign: int) -> Complex:
        moved = poles.ravel().copy()
        moved[which] += sign * step[which]
        other = dataclasses.replace(problem, parametric=pairs.at(moved.reshape(-1, 2)))
        # The non-parametric part, which isn't used, has one column here.
        P: Complex = formulate_in(other, Sections.shift(1)).rows.P
        return P @ np.linalg.lstsq(rows.real(P), rows.real(given), rcond=None)[0]

    return np.stack([(projected(i, 1) - projected(i, -1)) / (2 * step[i]) for i in range(step.size)], axis=1)


def pairs_of(problem: MixedProblem) -> MovingPairs:
    """The pairs of a problem that can move; refused where there is nothing to move, or a move changes what was stated."""
    if problem.parameter_bounds is not None:
        raise InputError(
            "`problem` has `parameter_bounds`: intervals of coefficients mean other functions once poles move; leave them out"
        )
    pairs = None if problem.parametric is None else taken_apart(problem.parametric)
    if pairs is None or not pairs.start.size:
        raise InputError(
            "`problem` must have pairs made by `kautz` in its parametric part; got none, hence no poles to move. Take them"
            " from `suggest_kautz`"
        )
    return pairs
