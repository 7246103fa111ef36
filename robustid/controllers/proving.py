"""Proof of a controller: the shares of every limit that any consistent plant takes, on the whole axis."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robustid.controllers.limits import Limits
from robustid.controllers.plants import Plants
from robustid.controllers.structure import integral_gain
from robustid.core import Budget, Progress, StateMatrices
from robustid.guarantees import LoopBounds, LoopMargins, Peak

if TYPE_CHECKING:
    import control

_LEAST = 1e-12  # of a margin that is asked for: smaller ones are none
_TINY = np.finfo(float).tiny
_ROUNDING = 1e-6  # of an integral gain
_PEAKS = {
    "sensitivity": "sensitivity_peak",
    "complementary_sensitivity": "complementary_peak",
    "control_sensitivity": "control_peak",
    "process_sensitivity": "process_peak",
}

SHARES = {
    "bandwidth": "bandwidth",
    "integral_gain": "integral gain",
    "attenuation": "attenuation",
    "control_peak": "control peak",
}  # of limits that goals state, their names in `shares`


class Proof(NamedTuple):
    """Worst cases of a controller with the plants of every band, and what it takes of every limit: with all, and with each band."""

    proofs: tuple[LoopBounds, ...]
    shares: dict[str, tuple[float, float]]
    by_band: tuple[dict[str, tuple[float, float]], ...]

    @property
    def kept(self) -> bool:
        """True if every consistent plant is stabilised and keeps all limits."""
        return all(one.guaranteed for one in self.proofs) and all(share <= 1 for share, _ in self.shares.values())


def proof_of(
    plants: Sequence[Plants], controller: control.StateSpace, limits: Limits, progress: Progress | None = None
) -> Proof:
    """Prove a controller with all plants: what it takes of every limit at most, and near which frequency (nan: of none).

    Of every band three steps are told: its bounds on arcs, peaks and margins, and the shares of templates.
    """
    told, count = Budget(None, progress, "proving the controller on the whole axis"), 3 * len(plants)
    proofs, found = list[LoopBounds](), list[Taken]()
    told.tell(0, 0)
    for k, one in enumerate(plants):
        _ = one.band.circle  # kept by the band: what follows stands on it
        told.tell(3 * k + 1, count)
        proofs.append(one.proved(controller))
        told.tell(3 * k + 2, count)
        found.append(Taken(proofs[-1].peaks, proofs[-1].margins, one.shares(controller, limits)))
        told.tell(3 * k + 3, count)
    states, dt = StateMatrices.of(controller), plants[0].dt
    by_band = tuple(shares_of(limits, [one], states, dt) for one in found)
    return Proof(tuple(proofs), shares_of(limits, found, states, dt), by_band)


class Taken(NamedTuple):
    """Numbers of one loop that limits are about: peaks, margins, and shares of the templates and of the bandwidth."""

    peaks: Mapping[str, Peak]
    margins: LoopMargins
    rows: Mapping[str, tuple[float, float]]


def _over(asked: float, left: float) -> float:
    return asked / left if left > _LEAST * asked else math.inf


def shares_of(
    limits: Limits, loops: Sequence[Taken], controller: StateMatrices, dt: float
) -> dict[str, tuple[float, float]]:
    """Largest share of every limit that any of the loops takes, and near which frequency (nan: of none)."""
    shares: dict[str, tuple[float, float]] = {}

    def told(name: str, share: float, omega: float) -> None:
        if share > shares.get(name, (-1.0, 0.0))[0]:
            shares[name] = share, omega

    for peaks, margins, rows in loops:
        for name, own in _PEAKS.items():
            limit = getattr(limits, own)
            if limit is not None:
                told(own.replace("_", " "), peaks[name].value / limit, peaks[name].omega)
        if limits.gain_margin is not None:
            told("gain margin", _over(limits.gain_margin - 1, margins.gain[1] - 1), math.nan)
        if limits.phase_margin is not None:
            told("phase margin", _over(limits.phase_margin, margins.phase), math.nan)
        if limits.delay_margin is not None:
            told("delay margin", _over(limits.delay_margin, margins.delay), math.nan)
        for name, (share, omega) in rows.items():
            told(name, share, omega)
    if limits.integral_gain is not None:
        gain = abs(integral_gain(controller, dt))
        told("integral gain", limits.integral_gain * (1 - _ROUNDING) / max(gain, _TINY), math.nan)
    return shares
