"""Statements of proof files on arcs of the frequency axis: bounds of a + b F, or of c/(a + b F), with arcs as fine as they need."""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from robustid.core import Complex, Real, Record, StateMatrices, balancing, normalising_feedback, scaled_states
from robustid.errors import InputError
from robustid.guarantees.linear.entry_band import EntryBand
from robustid.guarantees.linear.pole_discs import PoleDiscs
from robustid.guarantees.proof_question import NOT_YET
from robustid.reduction import Parts, gramian_factors

MOST_STATES = 64  # of functions in a file
_WIDER = 1 + 1e-8
_ROUNDED = (
    1e-12  # of the largest bound, added to all: near a zero of a known function doubles are off by more than that
)
_CLOSE, _CLOSER = (
    1.02,
    1 + 5e-7,
)  # times what the ends of an arc say: farther claims are halved; above a target, until there
_BITS, _NEWTON = 200, 4  # of balanced states, after the point; steps to an inverse
_RESERVE = 1e-7  # of the root of a Gramian, added so that every state is reached and seen
_ROUNDS, _MOST = 24, 30_000  # of halving arcs, and knots

Exact = list[list[Fraction]]


class Known(NamedTuple):
    """Functions a, b and perhaps c of z, C (z - A)^-1 B + D, exactly."""

    A: Exact
    B: Exact
    C: Exact
    D: Exact

    @classmethod
    def error_of(cls, model: StateMatrices) -> Self:
        """Return a = -model and b = 1: a + b F is the error."""
        A, B, C, D = _scaled(model)
        minus = [[-one for one in row] for row in (*C, *D)]
        return cls(A, B, [minus[0], [Fraction(0)] * len(A)], [minus[1], [Fraction(1)]])

    @classmethod
    def loop_of(cls, controller: StateMatrices, gain: float, dt: float) -> Self:
        """Return factors of a controller b/a, and c = a: c/(a + b F) is the sensitivity. `gain`: of the plant, about.

        Those of its states fed back: whatever the feedback is, their quotient is the controller exactly.
        """
        A, B, C, D = _scaled(controller)
        own = StateMatrices(*(np.array(one, float).reshape(shape) for one, shape in _shapes(A, B, C, D)))
        states = StateMatrices(own.A, own.B, own.C * gain, own.D * gain)
        g = [Fraction(one) for one in (np.ravel(normalising_feedback(states, dt)[0]) if A else np.zeros(0)).tolist()]
        closed = [[a + b[0] * one for a, one in zip(row, g, strict=True)] for row, b in zip(A, B, strict=True)]
        numerator = [c + D[0][0] * one for c, one in zip(C[0], g, strict=True)]
        return cls(closed, B, [g, numerator, g], [[Fraction(1)], D[0], [Fraction(1)]])

    @property
    def control(self) -> Self:
        """The same with c = b: the control sensitivity."""
        return self._replace(C=[*self.C[:2], self.C[1]], D=[*self.D[:2], self.D[1]])

    def within(self, x: float, y: float, peak: float) -> Self:
        r"""Factors of which \|c/(a + b F)\| is at most 1 where \|x S + y\| is at most `peak`, S the sensitivity.

        E = a + b F keeps out of a disc: \|E - t a\| >= r \|x a\|/(r^2 - y^2) with t = x y/(r^2 - y^2), r the peak. Where r is
        less than \|y\| it stays in one, of the radius r \|x a\|/(y^2 - r^2): then \|(a + b F)/c\| is at most 1.
        """
        square = peak**2 - y**2
        one, size = 1 - Fraction(x * y / square), Fraction(abs(x * peak / square))
        a, b, _ = self.C
        return self._replace(C=[[one * v for v in a], b, [size * v for v in a]], D=[[one], self.D[1], [size]])

    def grown(self, model: StateMatrices, factor: float) -> Self:
        """Factors of the loop with plants m + k (F - m): errors around a model, k times as large; c = 0, only zeros matter."""
        Am, Bm, Cm, Dm = _scaled(model)
        k, (a, b, _), d = Fraction(factor), self.C, self.D[1][0]
        through = [(1 - k) * Dm[0][0] * one for one in b]
        A = [row + [Fraction(0)] * len(Am) for row in self.A]
        A += [[into[0] * one for one in b] + row for into, row in zip(Bm, Am, strict=True)]
        none = [Fraction(0)] * len(Am)
        first = [one + two for one, two in zip(a, through, strict=True)] + [(1 - k) * one for one in Cm[0]]
        C = [first, [k * one for one in b] + none, [Fraction(0)] * len(A)]
        D = [[self.D[0][0] + (1 - k) * Dm[0][0] * d], [k * d], [Fraction(0)]]
        return self._replace(A=A, B=self.B + [[into[0] * d] for into in Bm], C=C, D=D)

    def behind(self, factors: StateMatrices) -> Self:
        """Return a' and b' of a u + b y = (a' + b' R) x, c = 0, of a plant that was measured in a loop: [u; y] = M [x; R x].

        `factors`: the matrix M of that loop. Functions of one input are transposed: M^T [a; b].
        """
        n = len(factors.A)
        shapes = (n, n), (n, 2), (2, n), (2, 2)
        Am, Bm, Cm, Dm = (
            np.array(one, dtype=object).reshape(shape).T for one, shape in zip(_scaled(factors), shapes, strict=True)
        )
        C, D = (
            np.array(one[:2], dtype=object).reshape(2, width) for one, width in ((self.C, len(self.A)), (self.D, 1))
        )
        A = [row + [Fraction(0)] * len(Am) for row in self.A]
        A += [[*into, *row] for into, row in zip((Cm @ C).tolist(), Am.tolist(), strict=True)]
        if len(A) > MOST_STATES:
            raise InputError(NOT_YET.format(f"functions of {len(A)} states, of {MOST_STATES} possible, take part"))
        after = [[*own, *through] for own, through in zip((Dm @ C).tolist(), Bm.tolist(), strict=True)]
        none = [[Fraction(0)] * len(A)], [[Fraction(0)]]
        return self._replace(A=A, B=self.B + (Cm @ D).tolist(), C=after + none[0], D=(Dm @ D).tolist() + none[1])

    @classmethod
    def maps_of(cls, factors: StateMatrices, back: StateMatrices) -> dict[str, Self]:
        """Return a and b of the maps a + b R of the loop that ran, of one input and one output, by their names.

        `factors`: M, whose answer [u; y] to x = D r of an excitation r at the input of the plant, or N d of one at its output, is
        linear in R; [D, N]: the first row of its inverse, `back`, transposed here.
        """
        Am, Bm, Cm, Dm = _scaled(back)
        A, B = [list(row) for row in zip(*Am, strict=True)], [[one] for one in Cm[0]]
        (D, N), none = [[row[k] for row in Bm] for k in (0, 1)], [Fraction(0)] * len(Am)
        (d, n), zero = Dm[0], Fraction(0)
        given = {
            "sensitivity": ([D, none], [[d], [zero]]),
            "complementary_sensitivity": ([none, N], [[zero], [n]]),
            "process_sensitivity": ([none, D], [[zero], [d]]),
            "control_sensitivity": ([N, none], [[n], [zero]]),
        }
        found = {name: cls(A, B, *rows).behind(factors) for name, rows in given.items()}
        return {name: one._replace(C=one.C[:2], D=one.D[:2]).balanced for name, one in found.items()}

    @property
    def balanced(self) -> Self:
        """The same functions, stable ones, in states that are about balanced, to `_BITS` after the point.

        The norms that bound their curvature are near it there; of a series of factors with close poles they are thousands of times
        as large.
        """
        A, B, C, _ = self.matrices
        if not A.size:
            return self
        left, right = (
            np.hstack([one, _RESERVE * float(np.linalg.norm(one)) * np.eye(len(A))])
            for one in gramian_factors(Parts(A, B, C), discrete=True)
        )
        into, _ = balancing(left, right).projections(len(A))
        T, V, one = _exact(into), _exact(np.asarray(np.linalg.inv(into), dtype=float)), _exact(np.eye(len(A)))
        for _ in range(_NEWTON):
            V = V + V @ (one - T @ V)
        a, b, c = (np.array(part, dtype=object) for part in self[:3])
        return self._replace(A=_rounded(V @ a @ T), B=_rounded(V @ b), C=_rounded(c @ T))

    @property
    def text(self) -> Record:
        """The functions as a file has them."""
        found: Record = {name: [[_dyadic(one) for one in row] for row in getattr(self, name)] for name in "AC"}
        return found | {name: [_dyadic(row[0]) for row in getattr(self, name)] for name in "BD"}

    @property
    def matrices(self) -> StateMatrices:
        """In double precision."""
        return StateMatrices(*(np.array(one, float).reshape(shape) for one, shape in _shapes(*self)))


class Arcs(NamedTuple):
    """Knots as angles, their names in a file, and the bound of every arc between them."""

    angles: Real
    edges: list[str]
    bounds: list[str]


def arcs_of(
    band: EntryBand,
    known: Known,
    omega: Real,
    target: Callable[[Real], Real],
    *,
    loop: bool,
    least: float = 0.0,
    most: int = _MOST,
) -> Arcs | None:
    """Return arcs between frequencies, halved until their bounds are close to what their ends say, or as small as is asked for.

    `target`: the bounds that are asked for on arcs with these middles. None where an arc has no bound. Bounds below `least`
    need not be close; no more than `most` knots are taken.
    """
    at = Between(band, known.matrices, loop)
    angles = at.angles(omega)
    ends, claims = at.claims(angles)
    for _ in range(_ROUNDS):
        asked = target((angles[:-1] + angles[1:]) / 2)
        with np.errstate(invalid="ignore"):
            wide = (claims > _CLOSE * np.maximum(ends, least)) | ((claims > asked) & (claims > _CLOSER * ends))
        if not wide.any() or omega.size + wide.sum() > most:
            break
        omega = np.union1d(omega, (omega[:-1] + omega[1:])[wide] / 2)
        angles = at.angles(omega)
        ends, claims = at.claims(angles)
    if not np.all(np.isfinite(claims)):
        return None
    edges, bounds = (
        list(map(repr, omega.tolist())),
        list(map(repr, (claims * _WIDER + _ROUNDED * claims.max()).tolist())),
    )
    edges[0], edges[-1] = "0" if omega[0] == 0 else edges[0], "half"
    return Arcs(angles, edges, bounds)


class Between:
    """Bounds that discs at knots give between them, as the checker computes it."""

    def __init__(self, band: EntryBand, known: StateMatrices, loop: bool) -> None:
        self._band, self._known, self._loop = band, known, loop
        functions, problem = band.samples.functions, band.samples.problem
        basis, self._modes = functions.fixed, functions.modes
        none = StateMatrices(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((0, 0)), np.zeros((0, 1)))
        self._functions = none if basis is None else StateMatrices(*map(np.asarray, basis.matrices))
        centre, radius = band.extraction.known.centre, band.extraction.known.radius
        self._reach = np.abs(centre) + radius
        self._size = float(np.abs(band.extraction.known.largest).max(initial=0.0))
        rho = problem.prior.decay_rate
        self._of_class = problem.prior.gain_bound * rho / (rho - 1) ** 2

    def angles(self, omega: Real) -> Real:
        """Angles of frequencies, the last one half a turn."""
        return np.append(omega[:-1] * float(self._band.samples.problem.dt or 1.0), np.pi)

    def claims(self, angles: Real) -> tuple[Real, Real]:
        """Return what the discs say at the ends of every arc, the larger of both, and what they prove on it."""
        z = np.exp(1j * angles)
        known = _values(self._known, z)
        known = np.concatenate([known, np.ones((z.size, 3 - known.shape[1]), complex)], axis=1)
        value, radius = self._band.at(np.minimum(angles, self._band.angles[-1]))
        reach = radius * _WIDER + 1e-15 * (np.abs(value) + self._size)
        centre, away = known[:, 0] + known[:, 1] * value, np.abs(known[:, 1]) * reach
        centre = np.where((angles == 0) | (angles == np.pi), centre.real, centre)  # as the checker has it
        with np.errstate(invalid="ignore", divide="ignore"):
            off = self._off(z, known, value, reach)
            # Of |above/below|: the known function c, 1 if there is none, and a + b F.
            above, below = (known[:, 2], np.zeros(z.size), off[2]), (centre, away, off[1])
            if not self._loop:
                above, below = below, above
            u = below[0][:-1] + below[0][1:]
            u, found = u / np.abs(u), list[Real]()
            for side in (slice(None, -1), slice(1, None)):
                least = (u.conj() * below[0][side]).real - below[1][side] - below[2]
                most = np.abs(above[0][side]) + above[1][side] + above[2]
                found.append(np.where(least > 0, most / least, np.inf))
            least, most = np.abs(below[0]) - below[1], np.abs(above[0]) + above[1]
            values = np.where(least > 0, most / least, np.inf)
            return np.maximum(values[:-1], values[1:]), np.maximum(*found) * (1 + 1e-12)

    def _off(self, z: Complex, known: Complex, value: Complex, reach: Real) -> list[Real]:
        """Distances that a, a + b F and c may have from their chords."""
        chord = np.abs(z[1:] - z[:-1])
        eighth = np.where(chord < 1, chord**2 / (8 - 2 * chord**2), np.inf)
        middle, half = (z[1:] + z[:-1]) / 2, chord / 2
        off = eighth * _bends(self._known, middle, half)
        fixed = len(self._functions.D)
        parametric = self._reach[:fixed] @ _bends(self._functions, middle, half)
        if self._modes is not None:
            parametric = parametric + self._reach[fixed:] @ _bends_of_modes(self._modes, middle, half)
        f = eighth * (self._of_class + parametric)
        db, df = np.abs(known[1:, 1] - known[:-1, 1]), np.abs(value[1:] - value[:-1]) + reach[1:] + reach[:-1]
        first = np.abs(known[:-1, 1]), np.abs(value[:-1]) + reach[:-1]
        whole = off[0] + db * df / 4 + (first[0] + db) * f + off[1] * (first[1] + df + f)
        return [off[0], whole, off[2] if len(off) > 2 else np.zeros(whole.size)]


def _resolvents(system: StateMatrices, z: Complex) -> Complex:
    return np.asarray(np.linalg.inv(z[:, None, None] * np.eye(len(system.A)) - system.A), dtype=complex)


def _values(system: StateMatrices, z: Complex) -> Complex:
    """Values, (N, m)."""
    return (system.C @ (_resolvents(system, z) @ system.B) + system.D)[:, :, 0]


def _bends(system: StateMatrices, z: Complex, reach: Real) -> Real:
    """Bounds of |f'| + |f''| within a distance of points, (m, N), infinite where a pole is too near."""
    R = _resolvents(system, z)
    size, state = np.linalg.norm(R, axis=(1, 2)), np.linalg.norm(R @ system.B, axis=(1, 2))
    rows = np.linalg.norm(system.C @ R, axis=2).T
    left = 1 - reach * size
    g = np.where(left > 0, 1 / np.where(left > 0, left, 1.0), np.inf)
    return np.where(rows > 0, rows * state * (g**2 + 2 * size * g**3), 0.0)


def _bends_of_modes(modes: PoleDiscs, middle: Complex, reach: Real) -> Real:
    """Bounds of |d2/dt2| of modes of amplitude 1 with their poles anywhere, (M, N), infinite where one is too near."""
    total = np.zeros((modes.middle.size, middle.size))
    powers = np.array([0, 1] if modes.delay < 0 else [modes.delay])[:, None, None]
    first = modes.distance[:, None]
    for poles in (modes.middle, modes.middle.conj()):
        d = np.abs(middle - poles[:, None]) - reach
        size = 1 / (np.where(d > 0, d, 1.0) * (1 - first))
        pole = (1 + first) * size
        found = size * ((powers + pole) ** 2 + pole**2 + pole).sum(axis=0)
        total += np.where(d > 0, found, np.inf)
    return total


def _scaled(system: StateMatrices) -> tuple[Exact, Exact, Exact, Exact]:
    """The matrices with states scaled by powers of two, exactly."""
    A, B, C = scaled_states(system.A, system.B, system.C)
    if len(A) > MOST_STATES:
        raise InputError(NOT_YET.format(f"a model of {len(A)} states, of {MOST_STATES} possible, takes part"))
    A, B, C, D = ([[Fraction(one) for one in row] for row in part.tolist()] for part in (A, B, C, system.D))
    return A, B, C, D


def _exact(matrix: Real) -> NDArray[np.object_]:
    return np.array([[Fraction(one) for one in row] for row in matrix.tolist()], dtype=object)


def _rounded(matrix: NDArray[np.object_]) -> Exact:
    return [[Fraction(round(one * 2**_BITS), 2**_BITS) for one in row] for row in matrix.tolist()]


def _shapes(A: Exact, B: Exact, C: Exact, D: Exact) -> list[tuple[Exact, tuple[int, int]]]:
    n, m = len(A), len(D)
    return [(A, (n, n)), (B, (n, 1)), (C, (m, n)), (D, (m, 1))]


def _dyadic(value: Fraction) -> str:
    return (
        f"{value.numerator}p-{value.denominator.bit_length() - 1}" if value.denominator > 1 else f"{value.numerator}p+0"
    )
