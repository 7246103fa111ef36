"""Rational functions with common poles behind the spectra of records: responses, and transients with the same poles.

A window of a short record is wide beside its resonances: two of them in it, or one at its end, are no function of low order there,
and what the order leaves is no noise. The poles are those of the whole record, so one fit of all lines finds them; what it leaves
is smooth enough for windows.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robustid.core import Complex, Projection, Real, lengths
from robustid.estimation.pole_fit import PoleFit, fractions, slopes_of

_SMOOTH = 2  # terms 1, z^-1 beside the poles
_MOST_PAIRS, _IN_VAIN = 12, 2  # pairs of poles; further ones in a row that are not worth their parameters
_EQUATIONS = 3  # real equations that a parameter asks for
_MOST, _FEWEST = 4000, 200  # lines times spectra that are fitted, and lines
_PLACES, _APART = 4, 4  # where a further pair is tried, and lines between these
_WIDTHS = (0.3, 2.0)  # lines: half-widths of a further pair; then that of real poles, which narrow ones hardly reach
_AROUND = 14  # lines on either side whose residuals give the noise of a line
_STILL = 0.05  # of the first line: where a pair stands for an integrator
_MUCH = 0.5  # of the power: what a pair that is worth a start of its own may leave
_MEETING = 1e-3  # of the distance of lines: least imaginary part of a pole
_STEPS = 10  # of the refinement of poles while pairs are added
_FAR = 1e6  # largest modulus of a pole
_ROUNDED = 1e-24  # part of the power below which residuals are rounding errors
_DEVIATIONS, _LEAST, _LIGHT = 4.0, 1e-5, 0.2  # of the intervals of modes; ends of their dampings
_SHOWN = 12.0  # standard deviations: peaks of a hair dryer's noise reach 11
_CHUNK = 2**16  # lines that are predicted at once


ModeEnds = tuple[float, float, float, float]  # ends of natural frequency, rad a sample, and of damping


class Doubt(NamedTuple):
    """Spectra, and responses at some lines, with modes that may be of the noise: places of these lines in the index."""

    lines: NDArray[np.intp]
    spectra: Complex
    values: Complex


class Predicted(NamedTuple):
    """Spectra (R, L, nz) of the outputs as the poles explain them; responses (K, nz, nx) at lines, and covariance of their vec."""

    spectra: Complex
    values: Complex
    covariance: Complex
    doubt: Doubt | None = None  # where modes were left out
    modes: tuple[ModeEnds, ...] = ()


def predicted(x: Complex, z: Complex, samples: int, index: np.ndarray, last: int, *, named: bool = False) -> Predicted:
    """Fit ``Z = G X + T`` over the lines of `index` and between, of spectra of R records x (R, L, nx), z (R, L, nz).

    G and every T are sums of partial fractions of common poles and a smooth part. Pairs are added one by one while a description
    of the data becomes shorter (`chen2008`), all poles refined together (`golub1973`). Modes are `named` where
    that is asked for, and of one record of one input and one output.
    """
    records, _, nx = x.shape
    lines: NDArray[np.intp] = np.arange(int(index[0]), int(index[-1]) + 1)
    most = max(_FEWEST, _MOST // (records * (nx + records)))
    lines = lines[:: -(-lines.size // most)]
    at = 2 * np.pi * index / samples
    nothing = Predicted(np.zeros_like(z), np.zeros((index.size, z.shape[2], nx), complex), np.zeros((1, 1, 1), complex))
    if not np.all(np.any(z[:, lines], axis=(0, 1))):
        return nothing
    fit = _Spectra(2 * np.pi * lines / samples, x[:, lines], z[:, lines])
    found, doubt = fit.described(fit.pairs()), None
    named |= x.shape[0] * x.shape[2] * z.shape[2] == 1
    modes = found.modes() if named else {}
    if found.poles.size:
        near = _APART * (fit.angle[1] - fit.angle[0])
        wide = -np.log(np.abs(found.poles)) > near  # no peaks
        if not (kept := wide | found.shown()).all():
            fewer = fit.described(fit.refined(found.poles[kept]))
            stays = wide[kept] | (np.abs(fewer.poles - found.poles[kept]) <= near)
            # A mode that runs off to what was left out shows that this is no peak of noise; modes with it and without are told.
            if np.all(stays):
                away = np.abs(at[:, None] - np.angle(found.poles[~kept])).min(axis=1)
                lines = np.flatnonzero(away <= near)
                doubt = Doubt(lines, found.spectra(x, samples, last), found.responses(at[lines])[0])
                found, modes = fewer, fewer.modes() if named else {}
            elif named:
                alike = np.flatnonzero(kept)[[j for j in fewer.modes() if stays[j]]]
                modes = {k: one for k, one in modes.items() if k in alike}
    values, covariance = found.responses(at)
    if not np.all(np.isfinite(covariance)):
        return nothing
    return Predicted(found.spectra(x, samples, last), values, covariance, doubt, tuple(modes.values()))


class _Spectra(PoleFit):
    """Partial fractions of common poles, times every input and for every record, against the spectra of the outputs."""

    def __init__(self, angle: Real, x: Complex, z: Complex) -> None:
        sizes: tuple[int, int, int] = x.shape
        self.records, self.lines, self.inputs = sizes
        self.angle = angle
        self.omega, self.dt, self.feedthrough = np.tile(angle, self.records), 1.0, True
        self.x = np.exp(1j * self.omega)
        drives, outputs = x.reshape(self.omega.size, -1), z.reshape(self.omega.size, -1)
        self.scale, self.size = (lengths(part) / np.sqrt(self.omega.size) for part in (drives, outputs))
        self.values, self.weight = outputs / self.size, np.ones(outputs.shape)
        self.drives = np.hstack([drives / self.scale, np.kron(np.eye(self.records), np.ones((self.lines, 1)))])

    def parameters(self, pairs: int) -> int:
        """Real ones of so many pairs of poles."""
        return 2 * pairs + (2 * pairs + _SMOOTH) * self.drives.shape[1] * self.values.shape[1]

    def _full(self, pairs: int) -> bool:
        """Return whether so many pairs have more parameters than the lines have equations for."""
        return _EQUATIONS * self.parameters(pairs) > 2 * self.samples

    def pairs(self) -> Complex:
        """The poles, as many as shorten the description of the spectra: from none on, and from a drift that explains much."""
        starts = [np.zeros(0, complex)]
        # A pair for an integrator, and what differs from end to end: at 0, where no line is.
        if self.angle[0] > 0 and not self._full(1):
            starts.append(np.exp(1j * _STILL * self.angle[:1]))
        cost = [self._cost(self.values, poles) for poles in starts]
        paths = [self._shortest(poles) for poles in starts[: 2 if cost[-1] < _MUCH * cost[0] else 1]]
        return min(paths, key=lambda path: path[0])[1]

    def _shortest(self, poles: Complex) -> tuple[float, Complex]:
        """Length of the shortest description with these poles and further ones, and its poles."""
        equations, vain = 2 * self.samples, 0
        best, shortest = poles, np.inf
        while True:
            power = self._cost(self.values, poles) / equations
            length = equations * np.log(max(power, _ROUNDED)) + self.parameters(poles.size) * np.log(equations)
            length += 2 * poles.size * np.log(self.lines)  # of all places where it may be
            vain = 0 if length < shortest else vain + 1
            if not vain:
                best, shortest = poles, length
            if vain == _IN_VAIN or poles.size == _MOST_PAIRS or self._full(poles.size + 1) or power <= _ROUNDED:
                return float(shortest), self.refined(best)
            poles = self.refined(self._further(poles), _STEPS)

    def refined(self, poles: Complex, steps: int | None = None) -> Complex:
        """The poles of least squares near these."""
        if poles.size:
            poles = np.asarray(self.refine(0.0, poles, held=True, steps=steps).poles, dtype=complex)
        # One that runs off stands for z, what is ahead of the input: on its way to infinity its functions vanish.
        poles = poles * (_FAR / np.maximum(np.abs(poles), _FAR))
        # The functions of a pair that meets are one, and nothing tells how far it moves: a double pole is one as near as this.
        return poles.real + 1j * np.maximum(np.abs(poles.imag), _MEETING * np.diff(self.angle[:2]).sum())

    def _further(self, poles: Complex) -> Complex:
        """The poles and a further pair, narrow or as wide as it is high, of those at the lines where most is left the best one."""
        left = np.abs(self.residuals(poles)).reshape(self.records, self.lines, -1)
        left = np.convolve(np.sum(left**2, axis=(0, 2)), np.ones(3), "same")
        spacing, tried, found = self.angle[1] - self.angle[0], list[int](), list[tuple[float, Complex]]()
        # Of matrices wide pairs took the place of narrow ones: bounds of the beam became 20 % wider.
        single = self.inputs == self.values.shape[1] == 1
        for k in np.argsort(-left).tolist():
            if len(tried) < _PLACES and all(abs(k - other) > _APART for other in tried):
                tried.append(k)
                for width in (*(lines * spacing for lines in _WIDTHS), *([self.angle[k]] * single)):
                    pole = np.exp(1j * (self.angle[k] + spacing / 4) - width)
                    more = np.append(poles, pole)
                    found.append((self._cost(self.values, more), more))
        return min(found, key=lambda one: one[0])[1]

    def _functions(self, delay: float, poles: Complex) -> Complex:
        base = _base(self.x, poles)
        return np.hstack([base * drive[:, None] for drive in self.drives.T])

    def _ways(self, poles: Complex, c: Real) -> Complex:
        each = c.reshape(self.drives.shape[1], -1)[:, : c.size // self.drives.shape[1] - _SMOOTH]
        parts = zip(self.drives.T, each, strict=True)
        return np.sum([drive[:, None] * slopes_of(self.x, poles, own) for drive, own in parts], axis=0)

    def around(self, rows: Real) -> Real:
        """Mean of real rows over the lines around every line of every record, (records lines,)."""
        power = np.sum(rows.reshape(2, self.records, -1), axis=0) / 2
        total = np.cumsum(np.pad(power, ((0, 0), (1, 0))), axis=1)
        at: NDArray[np.intp] = np.arange(int(self.lines))
        low, high = np.maximum(at - _AROUND, 0), np.minimum(at + (_AROUND + 1), self.lines)
        return np.ravel((total[:, high] - total[:, low]) / (high - low))

    def _entries(self, values: Complex, functions: Complex) -> Iterator[Projection]:
        """All outputs on the same functions, orthogonalised once."""
        basis, triangle = np.linalg.qr(_real(functions))
        for value in _real(values).T:
            along = basis.T @ value
            yield Projection(basis, triangle, along, value - basis @ along)

    def described(self, poles: Complex) -> _Description:
        """The fit at these poles, with what its errors are."""
        entries = list(self._entries(self.values, self._functions(0.0, poles)))
        changes = [_real(self._ways(poles, one.coefficients)) for one in entries]
        return _Description(self, poles, entries, changes)


class _Description:
    """Coefficients of every output at the poles, and the covariance of the responses to first order, for noise of any colour.

    With errors e, functions Q R, derivatives J by the poles, P = I - Q Q' and P J = U s V' of all outputs together, the poles err
    by da = V s^-1 U' e, the coefficients by R^-1 Q' (e - J da). The noise of a line is what the lines around it leave, over the
    part of their degrees of freedom that functions and poles leave: many of these among few lines follow the noise too
    (`mackinnon1985`).
    """

    def __init__(self, fit: _Spectra, poles: Complex, entries: list[Projection], changes: list[Real]) -> None:
        self.fit, self.poles = fit, poles
        shape = (len(entries), fit.drives.shape[1], -1)
        self.c = np.array([one.coefficients for one in entries]).reshape(shape)
        tangents = np.vstack([-one.tangent(change) for one, change in zip(entries, changes, strict=True)])
        size = lengths(np.vstack(changes))
        U, s, V = np.linalg.svd(tangents / size, full_matrices=False)
        triangle, eps = entries[0].triangle, float(np.finfo(float).eps)  # that of all entries
        # What functions that are alike make of rounding errors in the derivatives is no direction.
        alike = min(eps * float(np.linalg.cond(triangle / lengths(triangle))), np.sqrt(eps))
        told = s > alike * s.max(initial=0)
        self.ways = V[told].T / s[told] / size[:, None]  # from U' e to the poles
        self.maps: list[tuple[Real, Real]] = []  # from Q' e, and from U' e, to the coefficients
        self.inner: list[Real] = []  # covariance of Q' e
        self.mixed: list[Real] = []  # of Q' e with U' e
        self.outer = np.zeros((np.sum(told), np.sum(told)))  # covariance of U' e
        for one, change, across in zip(entries, changes, np.vsplit(U[:, told], len(entries)), strict=True):
            left = np.maximum(1 - np.sum(one.basis**2, axis=1) - np.sum(across**2, axis=1), 0)
            free = np.maximum(fit.around(left), 1 / (2 * _AROUND + 1))  # a line's at least
            noise = np.tile(fit.around(one.residual**2) / free, 2)[:, None]
            back = np.linalg.pinv(one.triangle / (length := lengths(one.triangle))) / length[:, None]
            self.maps.append((back, -back @ (one.basis.T @ change @ self.ways)))
            self.inner.append(one.basis.T @ (noise * one.basis))
            self.mixed.append(one.basis.T @ (noise * across))
            self.outer += across.T @ (noise * across)
        self.moved = self.ways @ self.outer @ self.ways.T  # covariance of the poles

    def _spread(self, output: int) -> Real:
        """Covariance of the coefficients of an output."""
        back, after = self.maps[output]
        mixed = back @ self.mixed[output] @ after.T
        return back @ self.inner[output] @ back.T + mixed + mixed.T + after @ self.outer @ after.T

    def shown(self) -> NDArray[np.bool_]:
        """Pairs that responses and transients of an output together show beyond what surrounds them, (pairs,).

        Noise of a colour has peaks too, which shorten a description that takes it for white.
        """
        count, n = self.c.shape[1:]
        found = np.zeros(self.poles.size, bool)
        for i, c in enumerate(self.c.reshape(len(self.c), -1)):
            spread = self._spread(i)
            for k in range(self.poles.size):
                own = (np.arange(count)[:, None] * n + [2 * k, 2 * k + 1]).ravel()
                part = spread[np.ix_(own, own)]
                size = np.sqrt(np.maximum(np.diag(part), np.finfo(float).tiny))  # of a pair that nearly meets 1e8 to 1
                told = c[own] / size
                found[k] |= bool(told @ np.linalg.pinv(part / size[:, None] / size) @ told >= _SHOWN**2)
        return found

    def modes(self) -> dict[int, ModeEnds]:
        """Pairs that are lightly damped, between the lines, by number: four standard deviations on either side."""
        found: dict[int, ModeEnds] = {}
        low, high = self.fit.angle[[0, -1]]
        if np.any(self.poles.imag == 0):
            return found
        shown = self.shown()
        for k, (pole, s) in enumerate(zip(self.poles, np.log(self.poles), strict=True)):
            if s.real >= 0 or not shown[k]:
                continue
            at, omega = [k, k + self.poles.size], abs(s)
            ways = np.array([1, 1j]) / pole  # of s, by the real and the imaginary part of the pole
            turn = np.array([np.real(ways * np.conj(s)) / omega, -np.real(ways) / omega])
            turn[1] += np.real(s) / omega**2 * turn[0]
            deviations = np.sqrt(np.diag(turn @ self.moved[np.ix_(at, at)] @ turn.T))
            (left, least), (right, most) = (
                np.array([omega, -s.real / omega]) + sign * _DEVIATIONS * deviations for sign in (-1, 1)
            )
            if low < left <= right < high and _LEAST < most < _LIGHT:
                found[k] = float(left), float(right), float(max(least, _LEAST)), float(most)
        return found

    def spectra(self, x: Complex, samples: int, last: int) -> Complex:
        """Spectra of the outputs as they are explained, (R, K, nz): up to the last line, 0 at the others."""
        found = np.zeros((*x.shape[:2], len(self.c)), complex)
        for part in np.array_split(np.arange(1, last + 1), -(-last // _CHUNK)):
            found[:, part] = self._spectra(2 * np.pi * part / samples, x[:, part])
        return found

    def _spectra(self, angle: Real, x: Complex) -> Complex:
        base, nx = _base(np.exp(1j * angle), self.poles), self.fit.inputs
        each = np.einsum("ln,ijn,i->lij", base, self.c, self.fit.size)
        return np.einsum("lij,rlj->rli", each[:, :, :nx], x / self.fit.scale) + each[:, :, nx:].transpose(2, 0, 1)

    def responses(self, angle: Real) -> tuple[Complex, Complex]:
        """The responses (K, nz, nx) at angles, and the covariance of their vec, columns stacked."""
        turned, nx = np.exp(1j * angle), self.fit.inputs
        base = _base(turned, self.poles)
        K, n, nz = angle.size, base.shape[1], len(self.c)
        values = np.einsum("kn,ijn,i->kij", base, self.c[:, :nx], self.fit.size) / self.fit.scale
        steady: list[Complex] = []  # by Q' e, (K, nx, m)
        moved: list[Complex] = []  # by U' e
        for c, maps in zip(self.c, self.maps, strict=True):
            own, after = (np.stack([base @ one[j * n : (j + 1) * n] for j in range(nx)], axis=1) for one in maps)
            direct = np.stack([slopes_of(turned, self.poles, c[j, : n - _SMOOTH]) for j in range(nx)], axis=1)
            steady.append(own)
            moved.append(direct @ self.ways + after)
        units = self.fit.size[:, None] / self.fit.scale
        covariance = np.zeros((K, nx, nz, nx, nz), complex)
        for i in range(nz):
            for j in range(nz):
                part = (moved[i] @ self.outer + steady[i] @ self.mixed[i]) @ _adjoint(moved[j])
                part = part + moved[i] @ _adjoint(steady[j] @ self.mixed[j])
                if i == j:
                    part = part + steady[i] @ self.inner[i] @ _adjoint(steady[i])
                covariance[:, :, i, :, j] = part * units[i][:, None] * units[j]
        return values, covariance.reshape(K, nx * nz, nx * nz)


def united(modes: Iterable[ModeEnds]) -> list[ModeEnds]:
    """Modes of several measurements, those whose ends meet in both as one."""
    found: list[ModeEnds] = []
    for one in sorted(modes):
        low, high, least, most = one
        meets = [other for other in found if other[1] >= low and other[3] >= least and other[2] <= most]
        for other in meets:
            found.remove(other)
            low, high = min(low, other[0]), max(high, other[1])
            least, most = min(least, other[2]), max(most, other[3])
        found.append((low, high, least, most))
    return found


def _base(turned: Complex, poles: Complex) -> Complex:
    """Partial fractions and smooth terms on the circle, (L, n)."""
    return np.hstack([fractions(turned, poles), turned[:, None] ** -np.arange(_SMOOTH)])


def _adjoint(matrices: Complex) -> Complex:
    return matrices.conj().swapaxes(1, 2)


def _real(values: Complex) -> Real:
    return np.concatenate([values.real, values.imag])
