"""One output of a record against the prediction of a response: what is left, as it is and after each correction."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robustid.core import Real, counted
from robustid.data import FaultKind, TimeRecord
from robustid.estimation.inside_band import band_sequences
from robustid.estimation.record_model import scaled_solution
from robustid.estimation.response_model import Predicted, ResponseModel, Simulated

_BLOCK, _BLOCK_AT_MOST, _BLOCKS = 400, 2000, 4  # samples of a part that is looked at, and parts
_SHORTEST, _SEQUENCES = 8, 8  # samples of a part, and sequences in it
# A correction leaves a third of what was left, one whose number was chosen to fit a tenth; and at most so much of the output.
_BETTER, _BEST, _GOOD = 3.0, 10.0, 0.2
_UNITS = (1e-6, 1e-3, 0.01, np.pi / 180, 1 / 9.80665, 0.5, 2.0, 9.80665, 180 / np.pi, 100.0, 1e3, 1e6)
_TIMES = (1e-6, 1e-3, 0.5, 2.0, 1e3, 1e6)
_RATIOS = np.geomspace(0.25, 4, 121)  # of sample times that are tried where no usual one explains the record
_NARROWED = 4  # times that the best of them is sought more closely
_SHIFTS, _SPIKES = 50, 3
_SAME = 0.02  # part by which a unit may miss a usual one
_TRIED = 2  # shifts of each sign that are judged in full
_TAPS, _SPARE, _LEAST = (12, 20, 0.01)  # of a record's own model: taps, numbers beyond unknowns, least noise
# Samples at the beginning, bounds by which one of them is off where it is not at rest, and numbers that a free response must leave.
_BEGIN, _SEEN, _SPARE_OF_START = 3, 3.0, 4
_ROUNDING = 1e-9  # part of an output


Known = dict[tuple[str, float, bool, bool], Simulated]


class Left(NamedTuple):
    """Rest that a prediction leaves of an output: squares in units of the bound, their number, and the residual (T,)."""

    cost: float
    samples: int
    residual: Real

    @property
    def times(self) -> float:
        """Rms in units of the bound; infinite where nothing is looked at."""
        return float(np.sqrt(self.cost / self.samples)) if self.samples else np.inf


class Remedy(NamedTuple):
    """A correction that was tried: kind, words with a place for the outputs, what undoes it, its number, unknowns, and rest."""

    kind: FaultKind
    words: str
    correction: str
    size: float
    unknowns: int
    left: Left
    usual: bool = True  # else a number was chosen to fit


class _Block(NamedTuple):
    """Samples, and the sequences (samples, n) with which they are looked at."""

    rows: slice
    sequences: Real


class RecordTrial:
    """One output of a record beside a response.

    Attributes
    ----------
    bounded : bool
    spare : float
        Degrees of freedom of the noise without a bound; infinite with one.
    sigma : float
        Size of the errors of the output; NaN where there is no bound, and the record is too short to show its noise.
    before : Left
        By the record as it is.
    """

    def __init__(self, model: ResponseModel, record: TimeRecord, output: int, simulated: Known | None = None) -> None:
        self.model, self.output, self._simulated = model, output, {} if simulated is None else simulated
        self.u, self.y, self.dt, self.initial = record.u, record.y[:, output], record.dt, record.initial
        self.used: NDArray[np.bool_] = record.used[:, output]
        self.predicted = self._predicted()
        self._free = model.free(len(record.u), record.dt)
        # A sensor has an offset; of a record from rest it is looked at.
        samples = len(record.u)
        self._open = {"free": self._free, "periodic": np.ones((samples, 1)), "rest": np.zeros((samples, 0))}[
            record.initial
        ]
        self._blocks = self._cut(1.0)
        self.sigma, self.bounded, self.spare = 1.0, record.bound is not None, np.inf
        if record.bound is not None:
            used: Real = record.bound.radius[self.used, output]
            self.sigma = float(np.sqrt(np.mean(used**2))) if used.size else np.nan
        else:
            self.sigma = self._own_noise()
        size = _ROUNDING * float(np.abs(self.y[self.used]).max(initial=0.0))
        self.sigma = max(self.sigma, size) or 1.0
        known = np.isfinite(self.sigma)
        self.before = self._left(self.y, self.predicted) if known else Left(0.0, 1, np.zeros_like(self.y))

    @property
    def rms(self) -> float:
        """Root mean square of the output where it is used."""
        return float(np.sqrt(np.mean(self.y[self.used] ** 2)))

    def best(self) -> Remedy | None:
        """Correction after which little is left; the likeliest of those that do."""
        tried = self._slower()
        if self._blocks:
            tried += [*self._units(), *self._late(), *self._exchanged()]
            tried += [*self._begun(), *self._struck(), *(self._raised() if self.initial == "rest" else [])]
        good = [one for one in tried if self._believed(one.left, one.usual)]
        return min(good, key=self._score, default=None)

    def _believed(self, left: Left, usual: bool = True) -> bool:
        share = self.before.times / (_BETTER if usual else _BEST)
        return left.times <= max(1.0, min(share, _GOOD * self.rms / self.sigma))

    def _score(self, one: Remedy) -> float:
        """Bayesian information criterion of the means of what is left, and the unknowns that it took."""
        return max(self.before.samples, 1) * float(np.log(max(one.left.times**2, 1e-300))) + one.unknowns * float(
            np.log(max(self.before.samples, 2))
        )

    # --- what is left ---

    def _predicted(
        self, u: Real | None = None, of: str = "input", faster: float = 1.0, initial: str = "", *, slopes: bool = True
    ) -> Predicted:
        """Prediction at the input, or another one with its name."""
        periodic = (initial or self.initial) == "periodic"
        key = (of, faster, periodic, slopes)
        if key not in self._simulated:
            u = self.u if u is None else u
            found = self.model.simulated(u, self.dt * faster, periodic=periodic, slopes=slopes)
            if not slopes:
                return self.model.predicted(found, self.output)
            self._simulated[key] = found
        return self.model.predicted(self._simulated[key], self.output)

    def _cut(self, faster: float) -> list[_Block]:
        """Parts of the record, each with the sequences of the band of the response."""
        cycles = self.dt * faster / (2 * np.pi)
        omega = self.model.fit.omega
        low, high = float(omega.min()) * cycles, min(float(omega.max()) * cycles, 0.5)
        if high > low > 0:  # two digits of the edges, so that sequences are seldom computed anew
            low, high = _rounded(low, np.ceil), _rounded(high, np.floor)
        longest = int(np.clip(np.ceil(_SEQUENCES / max(high - min(low, high), 1e-4)), _BLOCK, _BLOCK_AT_MOST))
        used = self.used.copy()
        if self.initial == "free":  # the first answers are those to an input before the record
            used[: min(_TAPS, len(used) // 4)] = False
        ends = np.flatnonzero(np.diff(np.concatenate([[0], used.astype(int), [0]])))
        parts: list[tuple[int, int]] = []
        for start, stop in ends.reshape(-1, 2):
            each = (stop - start) // max(1, round((stop - start) / longest))
            parts += [(int(k), int(k + each)) for k in range(start, stop - each + 1, each) if each >= _SHORTEST]
        chosen = np.unique(np.linspace(0, max(len(parts) - 1, 0), _BLOCKS).astype(int))
        found: list[_Block] = []
        for a, b in [parts[int(k)] for k in chosen] if parts else []:
            # Before a record from rest there was nothing: that is known too.
            before = b - a if a == 0 and self.initial == "rest" else 0
            found.append(_Block(slice(a, b), band_sequences(b - a + before, low, high)[before:]))
        return [one for one in found if one.sequences.shape[1]]

    def _left(
        self,
        y: Real,
        predicted: Predicted,
        *,
        sigma: float | None = None,
        extra: Real | None = None,
        blocks: list[_Block] | None = None,
    ) -> Left:
        """Least squares of what a response leaves open of a prediction, and of extra columns without a bound."""
        sigma, blocks = sigma or self.sigma, self._blocks if blocks is None else blocks
        r, q = self.model.known[self.output]
        extra = np.zeros((len(y), 0)) if extra is None else extra
        extra = np.hstack([extra, self._open])
        slopes = np.hstack([predicted.slopes, extra])
        rows = [one.sequences.T @ slopes[one.rows] / sigma for one in blocks]
        rights = [one.sequences.T @ (y - predicted.outputs)[one.rows] / sigma for one in blocks]
        known = np.hstack([r, np.zeros((len(r), extra.shape[1]))])
        found = scaled_solution(np.vstack([known, *rows]), np.concatenate([q, *rights]))
        least = scaled_solution(r, q)
        cost = float(np.sum((np.concatenate([q, *rights]) - np.vstack([known, *rows]) @ found) ** 2)) - float(
            np.sum((q - r @ least) ** 2)
        )
        count = sum(one.sequences.shape[1] for one in blocks) - extra.shape[1]
        return Left(max(cost, 0.0), max(count, 0), y - predicted.outputs - slopes @ found)

    def _own_noise(self) -> float:
        """Noise that a model of the record alone leaves: its poles are those of the response, and any short delay."""
        slopes = self.predicted.slopes
        late = [
            np.concatenate([np.zeros((k, self.u.shape[1])), self.u[: len(self.u) - k]])
            for k in range(min(_TAPS, len(self.u)))
        ]
        columns = np.hstack([slopes, *late, self._free])
        rows = np.vstack(
            [np.zeros((0, columns.shape[1])), *(one.sequences.T @ columns[one.rows] for one in self._blocks)]
        )
        rights = np.concatenate([np.zeros(0), *(one.sequences.T @ self.y[one.rows] for one in self._blocks)])
        self.spare = float(rights.size - columns.shape[1])
        if self.spare < _SPARE:
            return np.nan
        noise = float(np.linalg.norm(rights - rows @ scaled_solution(rows, rights))) / np.sqrt(self.spare)
        return max(noise, _LEAST * float(np.linalg.norm(rights)) / np.sqrt(rights.size))

    # --- corrections ---

    def _units(self) -> list[Remedy]:
        """Sign and unit: the number by which the prediction is multiplied."""
        slopes, blocks = self.predicted.slopes, self._blocks
        columns = np.hstack([self.predicted.outputs[:, None], slopes, self._open])
        rows = np.vstack([one.sequences.T @ columns[one.rows] for one in blocks]) / self.sigma
        rights = np.concatenate([one.sequences.T @ self.y[one.rows] for one in blocks]) / self.sigma
        r, _ = self.model.known[self.output]
        gain = float(scaled_solution(np.delete(rows, slice(1, 1 + slopes.shape[1]), axis=1), rights)[0])
        for _ in range(3):  # what is open of the response goes with the gain
            if gain == 0:
                return []
            known = np.hstack([np.zeros((len(r), 1)), r / abs(gain), np.zeros((len(r), self._open.shape[1]))])
            gain = float(scaled_solution(np.vstack([rows, known]), np.concatenate([rights, np.zeros(len(r))]))[0])
        if not np.isfinite(gain) or gain == 0:
            return []
        factor = 1 / gain
        usual = [one for one in (1.0, *_UNITS) if abs(abs(factor) / one - 1) < _SAME]
        factor = float(np.copysign(usual[0], factor)) if usual else float(f"{factor:.4g}")
        left = self._left(factor * self.y, self.predicted, sigma=abs(factor) * self.sigma)
        if factor == -1:
            words = "the sign of {where} is the opposite of that of the response"
            return [Remedy(FaultKind.SIGN, words, "negate", -1.0, 0, left)]
        if factor == 1:
            return []
        sign = " with the opposite sign" if factor < 0 else ""
        words = f"the response asks for {abs(factor):.4g} times {{where}}{sign}: the two are in different units"
        number = int(not usual)
        return [Remedy(FaultKind.UNIT, words, f"times {factor:.8g}", 1 / factor, number, left, bool(usual))]

    def _late(self) -> list[Remedy]:
        """Output that comes some samples late, or early."""
        most = min(_SHIFTS, len(self.y) // 3)
        held = np.repeat(self.u[-1:], most, axis=0)
        periodic = self.initial == "periodic"
        longer = self.predicted if periodic else self._predicted(np.vstack([self.u, held]), "longer input")
        all_ = np.hstack([longer.outputs[:, None], longer.slopes])
        if periodic:
            all_ = np.vstack([all_[-most:], all_, all_[:most]])
        else:
            all_ = np.vstack([np.zeros((most, all_.shape[1])), all_])
        total, costs = len(self.y), dict[int, float]()
        for shift in range(-most, most + 1):
            left = self.y - all_[most - shift : most - shift + total, 0]
            costs[shift] = sum(float(np.sum((one.sequences.T @ left[one.rows]) ** 2)) for one in self._blocks)
        ranked = sorted((shift for shift in costs if shift), key=lambda shift: costs[shift])
        found: list[Remedy] = []
        # Of an input that never changes an earlier output is one that does not start at rest.
        early = [k for k in ranked if k < 0][:_TRIED] if np.any(self.u != self.u[0]) else []
        for shift in [k for k in ranked if k > 0][:_TRIED] + early:
            moved = all_[most - shift : most - shift + total]
            left = self._left(self.y, Predicted(moved[:, 0], moved[:, 1:]))
            word, correction = ("much", "advance") if shift > 0 else ("little", "delay")
            words = f"by the response there are {counted(abs(shift), 'sample')} of delay too {word} in {{where}}"
            found.append(Remedy(FaultKind.LATE, words, f"{correction} {abs(shift)}", float(shift), 1, left))
        return found

    def _slower(self) -> list[Remedy]:
        """Sample time that is so many times the stated one."""
        usual: list[float] = [*_TIMES, *([] if self.model.fit.dt is None else [self.model.fit.dt / self.dt])]
        lefts = {ratio: self._at_ratio(ratio) for ratio in usual if abs(ratio - 1) > _SAME}
        some = self._blocks and self.initial != "periodic"  # periods would be others, too
        if some and not any(self._believed(left) for left in lefts.values()):
            rough = {float(ratio): self._roughly(float(ratio)) for ratio in _RATIOS}
            best, step = min(rough, key=lambda ratio: rough[ratio]), float(np.log(_RATIOS[1] / _RATIOS[0]))
            for _ in range(_NARROWED):
                found = {
                    float(ratio): self._at_ratio(float(ratio)) for ratio in best * np.exp(step * np.linspace(-1, 1, 7))
                }
                best, step = min(found, key=lambda ratio: found[ratio].times), step / 3
                lefts = {float(f"{best:.4g}"): found[best]}
        best = min(lefts, key=lambda ratio: lefts[ratio].times)
        words = f"the response agrees with a sample time of {self.dt * best:.6g} s, {best:.5g} times the stated one, for {{where}}"
        if best not in usual:
            words += f"; or the plant is {'slower' if best < 1 else 'faster'} by so much"
        number = int(best not in usual)
        return [Remedy(FaultKind.SAMPLE_TIME, words, f"time times {best:.8g}", best, number, lefts[best], not number)]

    def _roughly(self, ratio: float) -> float:
        """Squares that are left at a sample time, with the response as it is."""
        block = self._blocks[0]
        left = (
            self.y[: block.rows.stop]
            - self._predicted(self.u[: block.rows.stop], "beginning", ratio, slopes=False).outputs
        )
        return float(np.sum((block.sequences.T @ left[block.rows]) ** 2))

    def _at_ratio(self, ratio: float) -> Left:
        return self._left(self.y, self._predicted(faster=ratio), blocks=self._cut(ratio))

    def _exchanged(self) -> list[Remedy]:
        if self.u.shape[1] > 1 or self.model.coefficients.shape[2] > 1:
            return []
        u = self.u[:, 0]
        size = float(np.linalg.norm(u) / max(float(np.linalg.norm(self.y)), 1e-300))
        left = self._left(u, self._predicted(self.y[:, None], "output"), sigma=size * self.sigma)
        words = "the response holds from {where} to the input: the two are exchanged"
        return [Remedy(FaultKind.EXCHANGED, words, "exchange", self.before.times, 0, left)]

    def _begun(self) -> list[Remedy]:
        """Start that is not at rest: already periodic, or anything."""
        found: list[Remedy] = []
        if self.initial == "periodic":
            left = self._left(self.y, self._predicted(initial="rest"))
            words = 'the record begins at rest and was called periodic, as {where} shows: give initial="rest"'
            found.append(Remedy(FaultKind.NOT_AT_REST, words, "", self.before.times, 0, left))
        elif self.initial == "rest":
            left = self._left(self.y, self._predicted(initial="periodic"))
            words = 'the record is in periodic steady state from its first sample on, as {where} shows: give initial="periodic"'
            found.append(Remedy(FaultKind.NOT_AT_REST, words, "", self.before.times, 0, left))
        begins: Real = np.abs(self.before.residual[self.used][: max(_BEGIN, len(self.y) // 20)])
        if self.initial != "free" and np.any(begins > _SEEN * self.sigma):
            free = self._free
            left = self._left(self.y, self.predicted, extra=free)
            if left.samples >= _SPARE_OF_START:
                words = 'the record does not start at rest: a free response explains what is left of {where}. Give initial="free"'
                found.append(Remedy(FaultKind.NOT_AT_REST, words, "", self.before.times, free.shape[1], left))
        return found

    def _raised(self) -> list[Remedy]:
        """Constant offset."""
        left = self._left(self.y, self.predicted, extra=np.ones((len(self.y), 1)))
        raised = float(np.mean((self.y - self.predicted.outputs - left.residual)[self.used]))
        by = float(np.median(self.y[self.used] - self.predicted.outputs[self.used])) if self.used.any() else raised
        words = f"the response leaves a constant, {by:.4g}, of {{where}}: it is counted from another point of operation"
        return [Remedy(FaultKind.OFFSET, words, "detrend", by, 1, left)]

    def _struck(self) -> list[Remedy]:
        """Single samples."""
        extra, at, left = np.zeros((len(self.y), 0)), list[int](), self.before
        found: list[Remedy] = []
        for _ in range(_SPIKES):
            size: Real = np.where(self.used, np.abs(left.residual), 0)
            size[at] = 0
            at.append(int(np.argmax(size)))
            column = np.zeros((len(self.y), 1))
            column[at[-1]] = 1
            extra = np.hstack([extra, column])
            left = self._left(self.y, self.predicted, extra=extra)
            places = ", ".join(f"{k} ({k * self.dt:.4g} s)" for k in sorted(at))
            by = float(np.abs(self.y - self.predicted.outputs)[at].max())
            words = (
                f"the response explains {{where}} but for {'samples' if len(at) > 1 else 'sample'} {places}, by up to {by:.3g}:"
                f" leave {'them' if len(at) > 1 else 'it'} out, by an infinite bound"
            )
            found.append(Remedy(FaultKind.SPIKE, words, "", by, 2 * len(at), left))
        return found


def _rounded(number: float, way: Callable[[float], float]) -> float:
    """Two significant digits."""
    unit = 10.0 ** (np.floor(np.log10(number)) - 1)
    return float(way(number / unit) * unit)
