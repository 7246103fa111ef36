"""Parts of records as signals of one rational model: spectra of them, together and each, and what models leave."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from robustid.core import Complex, Real
from robustid.estimation.record_model import Fitted, Piece, carrying_lines, fitted, piece, spectra_of
from robustid.estimation.stretch import liveliest

_LINES, FEW = 500, 24  # spectral lines that are used, and needed
_AWKWARD = 2**15  # samples from which on a transform of any length takes several times that of a fast one
# A model of two parts together leaves so many times what models of each leave, and at least so much of the output; each alone
# leaves little.
RATIO, LEAST, GOOD = 6.0, 1e-4, 0.05


class Signals(NamedTuple):
    """Inputs (T, nu) and one output (T,), which go on as they began where they are periodic."""

    u: Real
    y: Real
    periodic: bool = False


class Compared(NamedTuple):
    """Models of parts together and of each: their ratio, what they leave of the outputs, and the models."""

    ratio: float
    together: float
    alone: float
    models: list[Fitted]
    pieces: list[Piece]

    @property
    def different(self) -> bool:
        """Return whether each part has a model of its own, and together they have none."""
        return self.ratio > RATIO and self.alone < GOOD and self.together - self.alone > LEAST


def fit(signals: Sequence[Signals], starts: Sequence[Complex], *, shift: int = 0) -> Fitted | None:
    """Model of parts, `shifted`."""
    pieces = _pieces([shifted(one, shift) for one in signals])
    return None if pieces is None else fitted(pieces, starts=starts)


def shifted(one: Signals, shift: int) -> Signals:
    """The output that many samples earlier."""
    if one.periodic:
        return one._replace(y=np.roll(one.y, -shift))
    if shift > 0:
        return Signals(one.u[:-shift], one.y[shift:])
    return Signals(one.u[-shift:], one.y[:shift]) if shift < 0 else one


def stretch_of(one: Signals, length: int) -> Signals:
    """The part of a very long record where the inputs are largest: a model of it is as good as one of the whole."""
    part = liveliest(one.u, length)
    return one if len(one.u) <= length else Signals(one.u[part], one.y[part])


def _pieces(signals: Sequence[Signals]) -> list[Piece] | None:
    """Spectra at the lines that the inputs of all parts carry."""
    if len({len(one.u) for one in signals}) > 1 or len(signals[0].u) < 2 * FEW:
        return None
    if len(signals[0].u) > _AWKWARD and not signals[0].periodic:
        fast = _fast_length(len(signals[0].u))
        signals = [Signals(one.u[:fast], one.y[:fast]) for one in signals]
    inputs = [spectra_of(one.u) for one in signals]
    each = [carrying_lines(one, len(signals[0].u)) for one in inputs]
    lines = functools.reduce(np.intersect1d, each)
    if lines.size < FEW or lines.size < max(one.size for one in each) / 2:
        return None
    most = max(_LINES // len(signals), 2 * FEW)
    lines = lines[np.unique(np.linspace(0, lines.size - 1, most).astype(int))] if lines.size > most else lines
    return [piece(own, one.y, lines) for own, one in zip(inputs, signals, strict=True)]


def _fast_length(samples: int) -> int:
    """Length of at most so many samples, a few percent fewer, whose transform is a fast one: 2^a 3^b 5^c."""
    odd = np.array([1, 3, 5, 9, 15, 25, 27, 45, 75, 81, 125, 135, 225])
    return int(np.max(odd * 2 ** np.floor(np.log2(samples / odd)).astype(int)))


def compared_parts(signals: Sequence[Signals], base: Fitted) -> Compared | None:
    """Parts together, and each."""
    pieces = _pieces(signals)
    if pieces is None:
        return None
    alone = [fitted([one], starts=[base.poles], orders=()) for one in pieces]
    models = [one for one in alone if one is not None]
    if len(models) < len(pieces):
        return None
    together = fitted(pieces, starts=[base.poles, models[0].poles], orders=())
    if together is None:
        return None
    noise = sum(one.cost for one in models) / sum(one.spare for one in models)
    power = sum(float(np.sum(np.abs(one.output) ** 2)) for one in pieces)
    ratio = together.noise / max(noise, 1e-24 * power)
    return Compared(ratio, together.part, max(one.part for one in models), models, pieces)


def of_all_poles(compared: Compared) -> Compared:
    """Parts together by one model with as many poles as those of each, where that leaves less.

    What models of each explain with poles of their own, by chance or because a search found more, is no difference of the parts.
    """
    poles = np.concatenate([one.poles for one in compared.models])
    more = fitted(compared.pieces, starts=[poles], orders=())
    if more is None or more.part >= compared.together:
        return compared
    alone = sum(one.cost for one in compared.models) / sum(one.spare for one in compared.models)
    ratio = min(compared.ratio, more.noise / max(alone, np.finfo(float).tiny))
    return compared._replace(ratio=ratio, together=more.part)


def percent(part: float) -> str:
    """Root of a part of the power, in words."""
    return f"{100 * float(np.sqrt(part)):.2g} %"
