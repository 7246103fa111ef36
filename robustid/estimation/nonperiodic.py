"""Responses of any excitation: the local rational method."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from robustid.core import counted, hz_words
from robustid.data import Caveat, TimeRecord, stacked, variances
from robustid.errors import InputError
from robustid.estimation.changes import CHANGED, added_variance, beyond_chance
from robustid.estimation.common_poles import ModeEnds, predicted, united
from robustid.estimation.divided import divided, some_told, widening
from robustid.estimation.estimate import Estimate
from robustid.estimation.excited_lines import checked_lines, driven_lines, excited_lines, window_means

ORDER = 2  # of the numerators of G and T, and of their denominator: one resonance in a window
_SPARE = 20  # residuals beyond the unknowns in a window: degrees of freedom of the covariance
_TOLD = (
    0.3  # of the input whose sign turns half-way, that the input itself does not follow: both halves drive the plant
)
SURE = 1e-5  # chance of any block of lines, in any entry, that halves differ so much: the model of a window is not all
_LATE = ("time", "records")  # what is split in halves
_FLAT = 1e-6  # smallest denominator, and square root of the smallest pivot
_TINY = float(np.finfo(float).tiny)
_TRIED, _MAX_CONDITION = 50, 1e6  # windows that are to tell the inputs apart, and of their equations
_CHUNK = 2**22  # numbers in the largest array


def local(
    records: list[TimeRecord], lines: ArrayLike | None, band: tuple[int, int] | None = None, *, rest: int = 0
) -> Estimate:
    """Fit ``Y = G U + T`` with ``G = N/D``, ``T = M/D``, ``D(0) = 1``, over a window around every line: see `estimate_frf`.

    In closed loop the responses of u and y to the reference are fitted, and divided. Lines that are looked for stay in the band.
    So many samples of `rest` that were put before have none of the noise that lines show.
    """
    first = records[0]
    samples, nu, ny = len(first.u), first.u.shape[1], first.y.shape[1]
    loop = first.reference is not None and first.reference.shape[1] == nu
    drives = np.stack([np.asarray(r.reference if loop else r.u) for r in records])
    answers = np.stack([np.hstack([r.y, r.u]) if loop else r.y for r in records])
    x, z = spectra_of(drives), spectra_of(answers)
    half, last = half_window(*drives.shape[::2]), (samples - 1) // 2  # the highest line that isn't real
    if last < 2 * half + 1:
        raise InputError(
            f"`record` has {counted(samples, 'sample')}: the local method needs {2 * (2 * half + 1) + 1} for"
            f" {counted(nu, 'input')} and"
            f" {counted(len(records), 'experiment')}; measure longer"
        )
    index = excited_lines(x, half, last, ORDER + 1) if lines is None else checked_lines(lines, last)
    if lines is None and band is not None:
        index = index[(index >= band[0]) & (index <= band[1])]
    _check_independent(x, index, half, last)
    spread = samples / (samples - rest)
    dof = _spare(*drives.shape[::2]) / spread
    free = dof - (ORDER + 1) * nu  # beside the changes of a window
    signs = _signs(*drives.shape[:2])[: None if free >= 1 else 0]
    found = _fitted(
        x, z, np.stack([spectra_of(sign * drives) for sign in signs]) if len(signs) else signs, index, samples
    )
    # In a window of noise alone the change has a third more variance than is stated, its denominator holding some of the noise: far
    # lines, of which each says something of its own, would show that, as a change of every long record.
    shared = float(2 * half + 1)
    changes, modes = np.zeros(found.values.shape), list[ModeEnds]()
    for late, change, sure in zip(_LATE, found.change.swapaxes(0, 1), found.sure.swapaxes(0, 1), strict=False):
        added = added_variance(2 * change, 2 * spread * sure, free, chance=SURE, shared=shared)
        if np.any(added):
            apart, own = _apart(drives, answers, index, found.values, late)
            added, modes = np.maximum(added, np.where(sure > 0, apart, 0)), [*modes, *own]
        changes += added
    values, of_noise = found.values, found.of_noise * spread
    of_changes, unsure = (stacked(part)[:, None, :] * np.eye(of_noise.shape[1]) for part in (changes, found.unsure))
    parts, others = (of_noise + (of_changes + unsure), of_noise, of_changes), values + found.doubt
    driven = driven_lines(x, half)[index]
    if loop:
        wider, told = widening(values, parts[0], ny, dof)
        driven = driven & told if lines is not None else some_told(driven & told)
        others = divided(others, of_noise, ny)[0]
        parts = [divided(values, part, ny)[1] * wider[:, None, None] for part in parts]
        values = divided(values, of_noise, ny)[0]
    covariance, *levels = parts
    noise, changed = (np.sqrt(variances(part, values.shape)) for part in levels)
    known = tuple(united(modes)) if np.any(changes) else found.modes  # of a loop they are not those of the plant in it
    y, u = z[:, :, :ny], z[:, :, ny:] if loop else x
    power = window_means(np.mean(np.abs(y) ** 2, axis=0), half)[index]
    return Estimate(
        index=index,
        step=2 * np.pi / (samples * first.dt),
        values=values,
        covariance=covariance,
        dof=dof,
        excitations=len(records) // nu or 1,
        coherence=np.clip(1 - found.residual[:, :ny] / np.where(power > 0, power, 1), 0, 1),
        rounding=_rounding(u, y, values, index, half),
        source=f"local rational method{' by the reference' if loop else ''}, windows of {2 * half + 1} spectral lines"
        f" ({hz_words((2 * half + 1) / (samples * first.dt), 3)}){CHANGED if np.any(changes) else ''}",
        noise=noise,
        changed=changed if np.any(changes) else None,
        doubt=others - values if np.any(found.doubt) else None,
        caveats=(Caveat.CHANGING,) * bool(np.any(changes)),
        driven=driven,
        modes=() if loop else known,
    )


def _check_independent(x: np.ndarray, index: np.ndarray, half: int, last: int) -> None:
    """Refuse signals whose responses no window tells apart."""
    if x.shape[2] == 1:
        return
    shared = _windows(x, index[:: -(-index.size // _TRIED)], half, last).shared
    size = np.linalg.norm(shared, axis=1)
    if np.linalg.cond(shared / np.where(size > 0, size, 1)[:, None]).min() > _MAX_CONDITION:
        raise InputError(
            f"`record`: the signals of the excitation are not independent in any window of {2 * half + 1} spectral lines, so that"
            " nothing tells the responses to them apart; move the inputs by independent signals, or one at a time"
        )


def _signs(records: int, samples: int) -> np.ndarray:
    """-1 in the first half of the time, 1 in the second, of every record and of all together, (2 or 1, records, samples, 1)."""
    times = np.arange(records * samples).reshape(records, samples)
    signs = [np.where(times[:1] < samples // 2, -1.0, 1.0) * np.ones((records, 1))]
    if records > 1:
        signs.append(np.where(times < times.size // 2, -1.0, 1.0))
    return np.stack(signs)[..., None]


class _Fitted(NamedTuple):
    """Responses at lines (f, nz, nx), covariances of their vec from noise alone, and what modes that are left out in doubt add."""

    values: np.ndarray
    of_noise: np.ndarray
    doubt: np.ndarray
    residual: np.ndarray  # (f, nz) variances
    change: np.ndarray  # (f, 2 or 1, nz, nx) halves of the changes from half to half
    sure: np.ndarray  # their variances, 0 where both halves do not tell
    modes: tuple[ModeEnds, ...]

    @property
    def unsure(self) -> np.ndarray:
        return np.abs(self.doubt) ** 2 / 2


def _fitted(
    x: np.ndarray, z: np.ndarray, turned: np.ndarray, index: np.ndarray, samples: int, *, named: bool = False
) -> _Fitted:
    """Responses at lines, which need not be whole, by the poles of all lines and windows about what these leave."""
    half, last = half_window(*x.shape[::2]), (samples - 1) // 2
    known = predicted(x, z, samples, index, last, named=named)
    chunk = max(1, _CHUNK // ((2 * half + 1) * len(x) * _unknowns(*x.shape[::2]) * 2))

    def fitted(spectra: np.ndarray, index: np.ndarray) -> list[np.ndarray]:
        pieces = np.array_split(index, -(-index.size // chunk))
        parts = [_fit(x, z - spectra, turned, part, half, last) for part in pieces]
        return [np.concatenate(piece) for piece in zip(*parts, strict=True)]

    values, covariance, residual, change, sure = fitted(known.spectra, index)
    values = values + known.values
    added = np.zeros(values.shape, complex)
    if (doubt := known.doubt) is not None and doubt.lines.size:
        # Modes that may be of the noise are left out: as likely as not, the response is the one with them.
        others = fitted(doubt.spectra, index[doubt.lines])[0] + doubt.values
        added[doubt.lines] = others - values[doubt.lines]
    return _Fitted(values, covariance + known.covariance, added, residual, change, sure, known.modes)


def _apart(
    drives: np.ndarray, answers: np.ndarray, index: np.ndarray, values: np.ndarray, late: str
) -> tuple[np.ndarray, list[ModeEnds]]:
    """Mean square distances (f, nz, nx) of values from those of two halves alone, where these differ beyond chance; modes of both.

    A change at a resonance has a double pole, which a window smooths; each half has its own poles. A class holds the plant of
    either half only where it has the modes of both: within bounds that hold the difference, those of their mean are hidden.
    """
    samples = drives.shape[1]
    axis = 1 if late == "time" else 0
    ends = slice(drives.shape[axis] // 2), slice(-(drives.shape[axis] // 2), None)
    halves = [[part[:, end] if axis else part[end] for part in (drives, answers)] for end in ends]
    shape, length = halves[0][0].shape[::2], halves[0][0].shape[1]
    if (length - 1) // 2 < 2 * half_window(*shape) + 1:
        return np.zeros(values.shape), []
    at, none = index * (length / samples), np.zeros((0, *drives.shape))
    first, last = (
        _fitted(spectra_of(drive), spectra_of(answer), none, at, length, named=True) for drive, answer in halves
    )
    noise = np.mean([variances(one.of_noise, values.shape) + one.unsure for one in (first, last)], axis=0)
    shared = (2 * half_window(*shape) + 1) / (float(np.median(np.diff(at))) if at.size > 1 else 1.0)
    seen = beyond_chance(last.values - first.values, noise, _spare(*shape), SURE, shared)
    square = np.mean([np.abs(one.values - values) ** 2 for one in (first, last)], axis=0)
    return np.where(seen, square, 0.0), [*first.modes, *last.modes]


def spectra_of(signals: np.ndarray) -> np.ndarray:
    """Transforms of signals (..., samples, n)."""
    return np.fft.rfft(signals, axis=-2) / signals.shape[-2]


def _unknowns(records: int, nx: int) -> int:
    """Complex ones of a window."""
    return (ORDER + 1) * (nx + records) + ORDER


def half_window(records: int, nx: int) -> int:
    """Lines of a window on either side."""
    return int(max(-(-((_unknowns(records, nx) + _SPARE) / records - 1) // 2), ORDER + 1))


def _spare(records: int, nx: int) -> float:
    """Degrees of freedom of a window."""
    return float(records * (2 * half_window(records, nx) + 1) - _unknowns(records, nx))


class _Windows(NamedTuple):
    """Regressors of all outputs around every line."""

    lines: np.ndarray  # (f, w) of the transform
    high: np.ndarray  # (f, r, ORDER) powers of the offset from 1 on, for every experiment
    shared: np.ndarray  # (f, r, p) of N and M
    size: np.ndarray  # (f, nx) of the excitation: its columns are scaled by it
    powers: np.ndarray  # (f, w, ORDER + 1) of the offset
    mirrored: np.ndarray  # (low, r, r) of windows across line 0: 1 where one equation is of the line -k of the other

    def surer(self, power: np.ndarray) -> np.ndarray:
        """Variances (f, ...) of residuals, at low lines not below that of the first window that is not across line 0.

        Residuals at -k repeat those at k, and say less of the noise than their number.
        """
        low = len(self.mirrored)
        return np.concatenate([np.maximum(power[:low], power[-1]), power[low:]])

    def directed(self, maps: np.ndarray) -> np.ndarray:
        """Times the variance, (f,), of errors alike in all directions of the complex plane that are nowhere smaller.

        Errors e = M n of noise n, with E n n^H = s^2 I and E n n^T = s^2 J for the mirrored lines J, have E |e|^2 = s^2 |M|^2 and
        E e^2 = s^2 M J M^T: along one direction (1 + |E e^2|/E |e|^2) times as much as if they were alike in all.
        """
        found = np.ones(len(maps))
        if low := len(self.mirrored):
            maps = maps[:low]
            along = np.abs(np.einsum("fijr,frs,fijs->fij", maps, self.mirrored, maps, optimize=True))
            found[:low] += np.max(along / np.maximum(np.sum(np.abs(maps) ** 2, axis=3), _TINY), axis=(1, 2))
        return found


def _windows(x: np.ndarray, index: np.ndarray, half: int, last: int) -> _Windows:
    # Beyond line 0, of offsets, lines are conjugates: the window stays centred. Responses need not be smooth beyond the last one:
    # half a sample of delay turns by pi there.
    width, first = np.arange(2 * half + 1), np.minimum(np.floor(index).astype(int) - half, last - 2 * half)[:, None]
    lines, low = np.maximum(first, 1) + width, int(np.sum(first < 1))
    if low:
        centred = first[:low] + width
        centred -= centred <= 0
        one, other = (_gain(x, index[:low], part, half) for part in (centred, lines[:low]))
        surer = np.mean(one / other, axis=1) < 1  # not where only the lines above are excited
        lines[:low] = np.where(surer[:, None], centred, lines[:low])
    powers, size, shared = _regressors(x, index, lines, half)
    pairs, rows = np.equal(lines[:low, :, None], -lines[:low, None]), shared.shape[1]
    mirrored = np.einsum("ed,fvw->fevdw", np.eye(len(x)), pairs).reshape(low, rows, rows)
    return _Windows(lines, np.tile(powers[:, :, 1:], (1, len(x), 1)), shared, size, powers, mirrored)


def _regressors(x: np.ndarray, index: np.ndarray, lines: np.ndarray, half: int) -> tuple[np.ndarray, ...]:
    """Powers, sizes and shared regressors of windows: see `_Windows`."""
    powers = ((lines - index[:, None]) / half)[:, :, None] ** np.arange(ORDER + 1)
    size = np.sqrt(np.mean(np.abs(_at(x, lines)) ** 2, axis=(0, 2)))
    size = np.where(size > 0, size, 1)
    free = np.einsum("ed,fws->fewds", np.eye(len(x)), powers).reshape(len(index), len(x) * lines.shape[1], -1)
    return powers, size, np.concatenate([_forced(x, lines, size, powers), free], axis=2)


def _gain(x: np.ndarray, index: np.ndarray, lines: np.ndarray, half: int) -> np.ndarray:
    """Variances (f, nx) that noise of variance 1 gives the response at lines, without a denominator."""
    _, size, shared = _regressors(x, index, lines, half)
    return _sum(_pseudo_inverses(shared)[:, : x.shape[2]].swapaxes(1, 2)) / size**2


def _at(spectra: np.ndarray, lines: np.ndarray) -> np.ndarray:
    """Spectra (R, K, n) of real signals at lines (f, w) of either sign, (R, f, w, n)."""
    there = spectra[:, np.abs(lines)]
    return np.where((lines < 0)[..., None], there.conj(), there)


def _forced(x: np.ndarray, lines: np.ndarray, size: np.ndarray, powers: np.ndarray) -> np.ndarray:
    """Regressors of a response to the excitation (records, K, nx), (f, r, p)."""
    drive = (_at(x, lines) / size[:, None]).transpose(1, 0, 2, 3)  # (f, e, w, nx)
    forced = powers[:, None, :, :, None] * drive[:, :, :, None, :]
    return forced.reshape(len(lines), drive.shape[1] * drive.shape[2], -1)


def _fit(
    x: np.ndarray, z: np.ndarray, turned: np.ndarray, index: np.ndarray, half: int, last: int
) -> tuple[np.ndarray, ...]:
    """Values (f, nz, nx), covariance (f, nz nx, nz nx) of vec, and variance of the residuals (f, nz).

    Then half of what the response changes by from the first half of the time to the second, (f, nz, nx), and its variance.
    """
    nx, nz, asked = x.shape[2], z.shape[2], len(index)
    if index[0] <= half:
        index = np.append(index, half + 1)  # the first window that is not across line 0
    windows = _windows(x, index, half, last)
    polynomial = _pseudo_inverses(windows.shared)
    rows, unknowns = windows.shared.shape[1:]
    values = np.empty((len(index), nz, nx), complex)
    maps = np.empty((len(index), nz, nx, rows), complex)
    left = np.empty((len(index), nz, rows), complex)
    change, sure = (np.zeros((len(index), len(turned), nz, nx), kind) for kind in (complex, float))
    for i in range(nz):
        target = _at(z[:, :, i : i + 1], windows.lines)[..., 0].transpose(1, 0, 2).reshape(len(index), rows)
        solution, inverse, left[:, i] = _one_output(windows, polynomial, target)
        values[:, i], maps[:, i] = solution[:, :nx], inverse[:, :nx]
        for k, drive in enumerate(turned):
            change[:, k, i], sure[:, k, i] = _changed(windows, drive, target)
    spread = left @ left.conj().swapaxes(1, 2) / (rows - unknowns - ORDER)  # (f, nz, nz)
    more = np.sqrt(windows.surer(power := np.einsum("fii->fi", spread).real) / np.maximum(power, _TINY))
    spread = spread * more[:, :, None] * more[:, None, :]
    # vec with columns stacked: entry (i, j) at j nz + i.
    gram = np.einsum("fijr,fklr->fjilk", maps, maps.conj(), optimize=True)
    covariance = (gram * spread[:, None, :, None, :]).reshape(len(index), nx * nz, nx * nz)
    units = np.repeat(1 / windows.size, nz, axis=1)
    covariance = covariance * units[:, :, None] * units[:, None, :]
    covariance = covariance * windows.directed(maps)[:, None, None]
    sizes = windows.size[:, None, None, :]
    found = (values / sizes[:, 0], covariance, np.einsum("fii->fi", spread).real, change / sizes, sure / sizes**2)
    return tuple(part[:asked] for part in found)


def _changed(windows: _Windows, drive: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Half of the change of the response, (f, nx), and its variance; 0 where the drives of both halves do not tell.

    ``Y = G U + T + C V``: V is the transform of the input whose sign turns half-way, C a polynomial of the order of N and M. Least
    squares of C beside all that the plain model follows.
    """
    forced = _forced(drive, windows.lines, windows.size, windows.powers)
    plain = np.concatenate([windows.shared, -windows.high * target[:, :, None]], axis=2)
    size = np.linalg.norm(plain, axis=1)
    q = np.linalg.qr(plain / np.where(size > 0, size, 1)[:, None])[0]
    beside, left = (part - q @ (q.conj().swapaxes(1, 2) @ part) for part in (forced, target[:, :, None]))
    inverse = _pseudo_inverses(beside)
    found = (inverse @ left)[:, :, 0]
    spread = _sum(left[:, :, 0] - (beside @ found[:, :, None])[:, :, 0]) / (
        target.shape[1] - plain.shape[2] - forced.shape[2]
    )
    told = np.linalg.norm(beside, axis=1) > _TOLD * np.linalg.norm(forced, axis=1)
    variance = np.where(told, _sum(inverse.swapaxes(1, 2)) * windows.surer(spread)[:, None], 0)
    nx = drive.shape[2]
    return found[:, :nx], variance[:, :nx] * windows.directed(inverse[:, None, :nx])[:, None]


def _one_output(windows: _Windows, polynomial: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, ...]:
    """Coefficients, their dependence on errors of the output, and residuals: with a denominator where it is worth it."""
    shared, dof = windows.shared, windows.shared.shape[1] - windows.shared.shape[2]
    solution = np.einsum("fpr,fr->fp", polynomial, target)
    plain = target - np.einsum("frp,fp->fr", shared, solution)
    tail = -windows.high * target[:, :, None]
    beside = tail - shared @ (polynomial @ tail)
    poles = np.einsum("fpr,fr->fp", _pseudo_inverses(beside), plain)
    below = 1 + np.einsum("frs,fs->fr", windows.high, poles)
    weight = 1 / np.where(np.abs(below) > _FLAT, below, _FLAT)
    # Divided by the denominator: a small one makes the errors of the equation small, not those of the fit.
    rest = _sum((plain - np.einsum("frp,fp->fr", beside, poles)) * weight)
    k = np.flatnonzero(rest < _sum(plain))
    # As if they had as many degrees of freedom as with a denominator.
    left, inverse = plain * np.sqrt((dof - ORDER) / dof), polynomial.copy()
    if k.size:
        design = np.concatenate([shared[k], tail[k]], axis=2)
        weighted = _pseudo_inverses(design * weight[k, :, None])
        fraction = np.einsum("fpr,fr->fp", weighted, target[k] * weight[k])
        left[k] = (target[k] - np.einsum("frp,fp->fr", design, fraction)) * weight[k]
        solution[k], inverse[k] = fraction[:, :-ORDER], weighted[:, :-ORDER]
    return solution, inverse, left


def _sum(errors: np.ndarray) -> np.ndarray:
    return np.sum(np.abs(errors) ** 2, axis=1)


def _pseudo_inverses(design: np.ndarray) -> np.ndarray:
    """Pseudo-inverses of full-rank designs, columns scaled to one size first."""
    size = np.linalg.norm(design, axis=1)
    size = np.where(size > 0, size, 1)
    q, r = np.linalg.qr(design / size[:, None])
    small = np.abs(np.einsum("fii->fi", r)).min(axis=1) < _FLAT**2
    if np.any(small):
        r = r + np.where(small, _FLAT**2, 0.0)[:, None, None] * np.eye(r.shape[1])
    return np.linalg.solve(r, q.conj().swapaxes(1, 2)) / size[:, :, None]


def _rounding(u: np.ndarray, y: np.ndarray, values: np.ndarray, index: np.ndarray, half: int) -> np.ndarray:
    """Rounding error of the transforms relative to the input in the window."""
    size = np.sqrt(window_means(np.max(np.abs(u) ** 2, axis=0), half))[index]
    scale = np.abs(y).max(axis=(0, 1))[:, None] + np.abs(values) @ np.abs(u).max(axis=(0, 1))[:, None]
    return 64 * np.finfo(float).eps * scale / np.where(size > 0, size, 1)[:, None, :]
