r"""Mistakes about the controller that ran while a record was made: each is tried, and what makes the loop's equation hold is told.

A mistake changes a term of the equation (`loop_terms`): its energy e is compared before and after. Noise that is recorded with a
signal is part of its term and of e; it draws a fitted factor towards 0, which explains at most the part e/V of e, V the energy of
the term. A change counts where it explains several times that much, and more than chance.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robustid.core import Real, StateMatrices
from robustid.data import Fault, FaultKind, TimeRecord
from robustid.errors import InputError
from robustid.identification.loop_terms import (
    LAWS,
    SHIFTS,
    Observer,
    Signals,
    Terms,
    resampled,
    separately,
    span,
    total,
)

Mask = NDArray[np.bool_]
_ROUNDING = 1e-18  # of the energy of the largest term: below, the equation is kept exactly
_LEAST = 0.15  # part of what a change leaves that it must explain
_CHANCE = 40.0  # and the same times the number of samples
_ATTENUATED = 4.0  # times what noise in the term itself explains
_HALF = 0.5  # of the energy is left at most where other samples or controllers are compared, or a constant is rounded
_ALIKE = 1.02  # energies of changes that explain equally well
_RATIOS = (2, 3, 4, 5, 8, 10)  # of sample times
_FEWEST = 60  # samples that are compared
_EDGES = (1e-9, 0.02, 0.05, 0.1)  # parts of the range of an input within which it is at its limit
_INTEGRATES = 1e-6  # D~ at frequency 0, below which the controller integrates and no constant of u shows
_LAGS = 30  # taps of the response from r
_SLOW = tuple(np.exp(-1 / np.array([10.0, 30.0, 100.0, 300.0])))  # and its slow poles
_MOSTLY, _CLEAR = 0.5, 0.03  # part of e that r explains, and of the signals that e has, where no change is found
_STILL = 0.03  # part of what a change explains that follows r after it at most
_ENOUGH = 0.7  # of the part of e that follows r: a change that explains less is not what is wrong
_SAME = 0.02  # part by which a unit may miss a usual one
_OPPOSITE = 0.05  # part by which a factor may miss -1
_UNITS = (1e-6, 1e-3, 0.01, 0.1, np.pi / 180, 1 / (2 * np.pi), 1 / 9.80665)


class Trial(NamedTuple):
    """A change that may explain the record: the error that it leaves, with its terms, and what would be said."""

    terms: Terms
    left: Real
    energy: float
    numbers: int  # that are fitted
    needed: float  # part of the energy that it must explain
    counts: bool
    kind: FaultKind
    words: str
    where: str
    size: float | None


def loop_faults(controller: StateMatrices, decay: float, excitation: str, record: TimeRecord) -> tuple[Fault, ...]:
    """Faults of a record, or of what is said about the loop, with r at its place; the decay of the loop is in 1/samples."""
    if record.reference is None:
        words = (
            "the record has no reference: r = u + C y is what the loop's equation makes it, so that nothing tells whether this"
            " controller ran. Record r, or take `with_reference` and believe the controller"
        )
        return (Fault(FaultKind.NO_REFERENCE, words, where="reference"),)
    signals = Signals(record.u, record.y, record.reference, record.initial == "periodic")
    terms = Terms(Observer.of(controller, decay), signals, excitation)
    if terms.count < _FEWEST:
        return ()
    before = terms.left(terms.error)
    energy = terms.energy(before)
    if energy <= _ROUNDING:
        return ()
    follows = energy * _follows_reference(terms, before)
    tried = [one for one in _Trials(terms, decay, before, record).all() if one.counts]
    found = _best([one for one in tried if energy - one.energy >= _ENOUGH * follows])
    if found:
        still = _follows_reference(found[0].terms, found[0].left)
        if still > _MOSTLY and still * found[0].energy > _STILL * (energy - found[0].energy):
            found = []
    share = float(np.sqrt(energy))
    evidence = f"{_percent(share)} of the signals are left of u = {LAWS[excitation]}"
    if not found:
        if follows < _MOSTLY * energy or share < _CLEAR:
            return ()
        words = (
            "another controller ran than the stated one: the record does not keep its equation, and no single change of sign, gain,"
            " delay, place of r, unit or sample time makes it so"
        )
        return (Fault(FaultKind.CONTROLLER, words, f"{evidence}, and follow r", where="controller", size=share),)
    evidence += f", {_percent(float(np.sqrt(found[0].energy)))} with this change"
    if len(found) > 1:
        evidence += f"; {len(found)} changes explain it equally well, and one of them is right"
    return tuple(Fault(one.kind, one.words, evidence, where=one.where, size=one.size) for one in found)


def _best(tried: list[Trial]) -> list[Trial]:
    """The change that leaves least, and those that leave as little; a number is fitted where it explains clearly more."""
    costs = [max(one.energy, _ROUNDING) * (1 + one.numbers * max(_LEAST, _CHANCE / one.terms.count)) for one in tried]
    least = min(costs, default=0.0)
    best = [one for one, cost in zip(tried, costs, strict=True) if cost == least]
    return [
        one for one, cost in zip(tried, costs, strict=True) if cost <= _ALIKE * least and one.numbers == best[0].numbers
    ]


def _peaked(error: Real) -> float:
    """Times by which the scatter of a sum over an error exceeds that of white noise: 1 for white noise."""
    lines: Real = np.sum(np.abs(np.fft.rfft(error - np.mean(error, axis=0), axis=0)[1:]) ** 2, axis=1)
    mean = max(float(np.mean(lines)), np.finfo(float).tiny)
    return max(1.0, float(np.mean((lines / mean) ** 2)) / 2)


def _percent(share: float) -> str:
    return f"{float(f'{100 * share:.2g}'):g} %"


def _follows_reference(terms: Terms, left: Real) -> float:
    """Part of an error that follows r by a short response, beyond what as many unrelated columns do."""
    r, nu = terms.signals.r, terms.error.shape[1]
    slow = StateMatrices(np.diag(_SLOW), np.ones((len(_SLOW), 1)), np.eye(len(_SLOW)), np.zeros((len(_SLOW), 1)))
    late = np.hstack(
        [np.stack([np.roll(one, lag) for one in r.T for lag in range(_LAGS)], axis=1)]
        + [separately(slow, one[:, None], periodic=terms.signals.periodic)[0] for one in r.T]
    )
    late = late[terms.kept][_LAGS:]
    basis, error = span(late), left.reshape(-1, nu)[_LAGS:]
    if len(late) < 3 * late.shape[1]:
        return 0.0
    part = float(np.sum((basis.T @ error) ** 2)) / max(float(np.sum(error**2)), np.finfo(float).tiny)
    share = basis.shape[1] / len(late)
    return max(0.0, (part - share) / (1 - share))


class _Trials:
    """Every change that is tried."""

    def __init__(self, terms: Terms, decay: float, before: Real, record: TimeRecord) -> None:
        self.terms, self.decay, self.before = terms, decay, before
        self.energy = terms.energy(before)
        self.inputs = [f"input {one.name}" for one in record.inputs]
        self.outputs = [f"output {one.name}" for one in record.outputs]

    def all(self) -> Iterator[Trial]:
        yield from self.of_terms()
        yield from self.places()
        yield from self.offsets()
        yield from self.sample_times()
        yield from self.slower()
        yield from self.saturated()

    def trial(
        self,
        error: Real,
        kind: FaultKind,
        words: str,
        where: str,
        *,
        size: float | None = None,
        term: float = np.inf,
        noisy: float | None = None,
        numbers: int = 0,
    ) -> Trial:
        """A change that leaves an error, beside the energies of the term that it changes and, at most, of the noise of it."""
        energy = self.terms.energy(error)
        noise = (energy if noisy is None else noisy) / max(term, np.finfo(float).tiny)
        peaked = _peaked(error.reshape(-1, self.terms.error.shape[1]))
        needed = max(_LEAST, (1 + numbers) * _CHANCE * peaked / self.terms.count, _ATTENUATED * noise)
        counts = self.energy > (1 + needed) * energy
        return Trial(self.terms, error, energy, numbers, needed, counts, kind, words, where, size)

    # --- sign, factor and delay of a term ---

    def of_terms(self) -> Iterator[Trial]:
        terms = self.terms
        a, b, c = (total(part) for part in (terms.a, terms.b, terms.c))
        within = terms.place == "input"
        yield from self.scaled(b if within else b + c, "controller")
        yield from self.scaled(c, "reference")
        if within:
            yield from self.scaled(a, self.inputs[0] if len(self.inputs) == 1 else "all inputs")
        if len(terms.b) > 1 and not within:
            yield from self.scaled(b, "all outputs")
        if len(terms.b) > 1 or not within:
            for name, one in zip(self.outputs, terms.b, strict=True):
                yield from self.scaled(one, name)
        if len(terms.c) > 1:
            for j, one in enumerate(terms.c):
                yield from self.scaled(one, f"reference {j + 1}")
        if len(terms.a) > 1:
            for i, (name, one) in enumerate(zip(self.inputs, terms.a, strict=True)):
                if within:
                    yield from self.scaled(one, name)
                    one = one + terms.c[i]
                yield from self.scaled(one, f"controller, {name}", inverse=True)

    def scaled(self, term: Real, where: str, *, inverse: bool = False) -> Iterator[Trial]:
        """One term with another sign, factor or delay; `inverse`: the rest of its input has them."""
        moving = self.terms.left(term)
        energy = self.terms.energy(moving)
        if energy == 0:
            return
        own = inverse or where == "controller"
        yield self.trial(
            self.before - 2 * moving, FaultKind.SIGN, _sign_words(where, own), where, size=-1.0, term=energy
        )
        factor = 1 - float(self.before @ moving) / float(moving @ moving)
        found = 1 / factor if inverse and factor else factor
        usual = next((one for unit in _UNITS for one in (unit, 1 / unit) if abs(abs(found) / one - 1) < _SAME), None)
        kind = FaultKind.CONTROLLER if own and usual is None else FaultKind.UNIT
        number = float(np.copysign(usual, found)) if usual else float(f"{found:.4g}")
        # Noise draws a factor from 1 into 0 to 1.
        noisy, reached = (self.energy, energy) if 0 < factor < 1 else (None, factor**2 * energy)
        left = self.before + (factor - 1) * moving
        words = _factor_words(where, number, own)
        if abs(factor + 1) > _OPPOSITE:  # it is that sign
            yield self.trial(left, kind, words, where, size=number, term=reached, noisy=noisy, numbers=1)
        for shift in [*range(-SHIFTS, 0), *range(1, SHIFTS + 1)]:
            moved = self.before + self.terms.left(self.terms.moved(term, shift)) - moving
            late = -shift if inverse else shift
            yield self.trial(moved, FaultKind.LATE, _late_words(where, late, own), where, size=float(late), term=energy)

    # --- where r is added ---

    def places(self) -> Iterator[Trial]:
        terms = self.terms
        nu, ny = len(terms.a), len(terms.b)
        rest, energy = terms.error - total(terms.c), terms.energy(terms.left(total(terms.c)))
        for place, law in LAWS.items():
            if place == terms.place or terms.signals.r.shape[1] != (nu if place == "input" else ny):
                continue
            words = f'r is added at the {place}, u = {law}: give excitation="{place}"'
            error = terms.left(rest + total(terms.excited(place)))
            yield self.trial(error, FaultKind.EXCITATION, words, "reference", term=energy)
        words = "u was recorded before r is added, u = -C y: record u + r, or give their sum as the input"
        if terms.place == "input":
            yield self.trial(terms.left(rest), FaultKind.EXCITATION, words, "input", term=energy)
            words = "u and r are exchanged: the column of the input holds r, that of the reference u"
            error = terms.left(total(terms.b) - total(terms.a) - total(terms.c))
            yield self.trial(error, FaultKind.EXCHANGED, words, "input and reference", term=energy)

    # --- levels ---

    def offsets(self) -> Iterator[Trial]:
        """A constant beside every input of the plant."""
        terms = self.terms
        ones = [terms.left(one) for one in _channels(terms.error)]
        columns = np.stack(ones, axis=1)
        basis = span(columns)
        error = self.before - basis @ (basis.T @ self.before)
        level: Real = np.asarray(np.linalg.lstsq(columns, self.before, rcond=None)[0], dtype=float)
        at_one = np.eye(len(terms.observer.states)) - terms.observer.states
        D, N = (
            one.D + one.C @ np.linalg.solve(at_one, one.B) for one in (terms.observer.inputs, terms.observer.outputs)
        )
        of_y: Real = np.asarray(np.linalg.lstsq(N, level, rcond=None)[0], dtype=float)
        said = [f"{_numbers(of_y)} in y"] if np.linalg.norm(N @ of_y - level) < 0.1 * np.linalg.norm(level) else []
        if np.linalg.svd(D, compute_uv=False).min() > _INTEGRATES:
            said.append(f"{_numbers(np.asarray(np.linalg.solve(D, level), dtype=float))} in u - r")
        words = (
            f"a constant is left, {' or '.join(said) or _numbers(level)}: an offset of a sensor, or a setpoint, that is still"
            " in the record. Subtract it, or count all signals from the point of operation"
        )
        size = float(of_y[np.argmax(np.abs(of_y))]) if of_y.size else None
        one = self.trial(error, FaultKind.OFFSET, words, "output", size=size, numbers=basis.shape[1])
        yield one._replace(counts=one.counts and one.energy < _HALF * self.energy)

    # --- sample times ---

    def sample_times(self) -> Iterator[Trial]:
        """The same continuous controller at another sample time."""
        for ratio in [1 / one for one in _RATIOS] + [float(one) for one in _RATIOS]:
            for other in resampled(self.terms.observer.controller, ratio):
                words = (
                    f"what ran is the stated controller as discretised with {ratio:.4g} times its sample time: discretise it with"
                    " the one at which it runs, and give the record at that one"
                )
                yield from self.other(other, self.terms.signals, words, ratio)

    def slower(self) -> Iterator[Trial]:
        """The controller at every so many samples of the record."""
        for step in _RATIOS:
            words = (
                f"the controller runs once in {step} samples of the record: take one sample of {step}, those at which it runs, and"
                " give their sample time to record and controller"
            )
            for first in range(step if len(self.terms.signals.u) >= step * (_FEWEST + 2 * SHIFTS) else 0):
                signals = self.terms.signals.every(step, first)
                yield from self.other(self.terms.observer.controller, signals, words, float(step))

    def other(self, controller: StateMatrices, signals: Signals, words: str, ratio: float) -> Iterator[Trial]:
        """Another controller, or other samples, in parts of their own signals."""
        try:
            terms = Terms(Observer.of(controller, self.decay), signals, self.terms.place)
        except InputError:  # an unstable pole that does not show
            return
        left = terms.left(terms.error)
        energy = terms.energy(left) * float(np.mean(terms.sizes / self.terms.sizes) ** 2)
        counts = energy < _HALF * self.energy and terms.count >= _FEWEST
        if counts and signals is self.terms.signals:  # a controller that amplifies noise less leaves less, too
            followed = self.energy * _follows_reference(self.terms, self.before)
            counts = followed - energy * _follows_reference(terms, left) > _HALF * (self.energy - energy)
        yield Trial(terms, left, energy, 0, 0.0, counts, FaultKind.SAMPLE_TIME, words, "controller", ratio)

    # --- limits ---

    def saturated(self) -> Iterator[Trial]:
        """Inputs at their limits, where nothing is asked of the controller: the fewest samples that explain it equally well."""
        found = [one for one in self.at_limits() if one.counts]
        least = max(min((one.energy for one in found), default=0.0), _ROUNDING)
        yield from [one for one in found if one.energy <= _ALIKE * least][:1]

    def at_limits(self) -> Iterator[Trial]:
        """The same, with edges of the limits that are wider and wider."""
        terms, u = self.terms, self.terms.signals.u
        low, high = np.min(u, axis=0), np.max(u, axis=0)
        known, seen = terms.signals.balance(terms.place)
        for edge in _EDGES:
            skipped: Mask = (u >= high - edge * (high - low)) | (u <= low + edge * (high - low))
            share = float(np.mean(skipped))
            if np.sum(skipped) < 4 or share > 0.6:
                continue
            (left, energy), (_, before) = (
                self.left_beside(known, seen, ignored) for ignored in (skipped, np.zeros_like(skipped))
            )
            words = (
                f"u stays at its limits, {_numbers(low)} and {_numbers(high)}, in {_percent(share)} of the samples, and only there"
                " it isn't what the controller asks for: excite less, or leave these stretches out"
            )
            counts = energy < _HALF * before
            energy *= self.energy / max(before, np.finfo(float).tiny)
            yield Trial(terms, left, energy, 0, 0.0, counts, FaultKind.SATURATED, words, "input", share)

    def left_beside(self, known: Real, seen: Real, skipped: Mask) -> tuple[Real, float]:
        """Error where nothing is skipped, and its energy."""
        error, free = self.terms.observer.skipping(known, seen, skipped)
        basis, flat = span(self.terms.columns(free)), self.terms.columns(error[:, :, None])[:, 0]
        left = flat - basis @ (basis.T @ flat)
        return left, float(left @ left) / max(1, np.count_nonzero(~skipped[self.terms.kept]) - basis.shape[1])


def _channels(error: Real) -> Iterator[Real]:
    """Constants, beside one input after another."""
    for i in range(error.shape[1]):
        one = np.zeros_like(error)
        one[:, i] = 1.0
        yield one


def _numbers(values: Real) -> str:
    return ", ".join(f"{one:.4g}" for one in np.atleast_1d(values))


def _sign_words(where: str, own: bool) -> str:
    if own:
        return f"the feedback of the {where} has the other sign: give the controller with the other sign"
    return f"{where} has the other sign: give it with the other one"


def _factor_words(where: str, factor: float, own: bool) -> str:
    if own:
        return (
            f"the {where} that ran has {factor:.4g} times the stated gain: give it with this gain, or y times {factor:.4g} if y is"
            " in another unit"
        )
    return f"{where} must be {factor:.4g} times as large: it is in another unit"


def _late_words(where: str, shift: int, own: bool) -> str:
    many = f"{abs(shift)} sample{'s' if abs(shift) > 1 else ''}"
    if own:
        return f"the {where} that ran has {many} of delay {'more' if shift > 0 else 'less'} than the stated one"
    return f"{where} is recorded {many} too {'early' if shift > 0 else 'late'}"
