"""Verdict on all pairs of two measured things in one loop, and what it stands on."""

from __future__ import annotations

import dataclasses
import enum
import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from robustid.core import Complex, Frozen, Real, Savable, as_positive, freeze, hz_words
from robustid.errors import InputError
from robustid.figures import Drawable

if TYPE_CHECKING:
    import control

    from robustid.guarantees.over_cells import AroundModel

_ALL_UNSTABLE = "unstable: every pair of consistent systems makes an unstable loop, proved on the whole axis"
_SHOWN = 3  # poles that are written out


class InterconnectionStatus(enum.Enum):
    """Verdict on the pairs; the value is the user's sentence."""

    STABLE = "stable: every pair of consistent systems makes a stable loop, proved on the whole axis"
    UNSTABLE = "unstable: a pair of consistent systems makes an unstable loop"
    UNDECIDED = "undecided: neither proved for every pair nor refuted by one"


@dataclasses.dataclass(frozen=True, eq=False)
class Interconnection(Frozen, Drawable, Savable):
    """Verdict on the loops of all pairs of a source and a load, and what it stands on.

    Attributes
    ----------
    source, load : Band, WorstCaseError, WorstCaseOverPoles, Family or control.StateSpace
        The two sides; of an identification its band.
    status : InterconnectionStatus
    margin : float
        Factor by which the bounds of both sides could grow about their models with ``det(I + G H)`` not zero at any frequency:
        above 1 all pairs are alike, stable or unstable as the pair of the models is.
    frequency : float
        Where that is least, rad/s.
    shares : tuple of two arrays
        Part of every entry of the source (ny, nu), and of the load (nu, ny), in what limits there; 1 in all.
    bounds : tuple of two arrays
        Bounds of the errors of both there, entry by entry.
    needed : tuple of two floats
        Factor on the bounds of the source alone, and of the load alone, at which nothing would stand in the way there; 1 where
        nothing does, 0 where a smaller error of that side does not help.
    edges : (C + 1,) array, rad/s
    margins : (C,) array
        The margin on every arc by itself.
    passive : (C,) boolean array
        True where both sides are passive, which proves the arc where small gain does not.
    pair : tuple of two control.StateSpace, or None
        Consistent systems whose loop is unstable. None too where every pair is proved unstable and none was found within the time.
    poles : array
        Poles of that loop that are not stable; of the loop of the models where there is no pair.
    omega : (C,) array, rad/s
        Middle of every arc.
    loci : (C, n) complex array
        Eigenvalues of the product of the models there: the generalised Nyquist plot.
    radius : (C, n) array
        Discs around them whose union holds the eigenvalues of the product of every pair.
    """

    source: AroundModel | control.StateSpace
    load: AroundModel | control.StateSpace
    status: InterconnectionStatus
    margin: float
    frequency: float
    shares: tuple[Real, Real]
    bounds: tuple[Real, Real]
    needed: tuple[float, float]
    edges: Real
    margins: Real
    passive: NDArray[np.bool_]
    pair: tuple[control.StateSpace, control.StateSpace] | None
    poles: Complex
    omega: Real
    loci: Complex
    radius: Real

    def __post_init__(self) -> None:
        arrays = ("edges", "margins", "passive", "poles", "omega", "loci", "radius")
        self._set(**{name: freeze(getattr(self, name)) for name in arrays})

    @property
    def dt(self) -> float:
        """Sample time of both in s; 0 in continuous time."""
        models: list[Any] = [getattr(one, "model", one) for one in (self.source, self.load)]
        return float(next((one.dt for one in models if one.dt is not None), 0.0))

    @property
    def stable(self) -> bool:
        """True where every pair is proved to be stable."""
        return self.status is InterconnectionStatus.STABLE

    def keeps_out(self, gain_margin_db: float, phase_margin_deg: float) -> NDArray[np.bool_]:
        r"""Proof, at each frequency of `omega`, that no eigenvalue of the product of any pair is in a forbidden region, (C,).

        The region is that of a gain and phase margin, as impedance specifications state it: ``|z| >= 10^(-GM/20)`` within PM of
        the negative real axis. A disc keeps out of it if its centre is farther from it than its radius. Between the frequencies
        nothing is said, and False is no finding: the discs are not tight.

        Parameters
        ----------
        gain_margin_db : float
            GM in dB, positive.
        phase_margin_deg : float
            PM in degrees, above 0 and below 90.
        """
        gain, phase = as_positive("gain_margin_db", gain_margin_db), as_positive("phase_margin_deg", phase_margin_deg)
        if phase >= 90:
            raise InputError(f"`phase_margin_deg` must be below 90 degrees; got {phase:g}")
        corner, angle = 10 ** (-gain / 20), math.radians(phase)
        turned: Real = np.abs(np.angle(-self.loci))
        place: Complex = np.abs(self.loci) * np.exp(1j * turned)  # mirrored, with -1 at 1
        along: Real = np.maximum((place * np.exp(-1j * angle)).real, corner)
        to_ray = np.abs(place - along * np.exp(1j * angle))
        inside = np.maximum(corner - np.abs(place), 0.0)
        distance = np.where(np.angle(place) <= angle, inside, to_ray)
        return np.asarray(np.all(distance > self.radius, axis=1))

    @property
    def limited_by(self) -> str:
        """Side with the larger part in what limits: "source" or "load"."""
        return "source" if self.shares[0].sum() >= self.shares[1].sum() else "load"

    @property
    def distance(self) -> Real:
        """Distance that the eigenvalues of the product of every pair keep from -1 at `omega`, at least, (C,); 0: none is proved."""
        return np.maximum(np.min(np.abs(1 + self.loci) - self.radius, axis=1), 0.0)

    def __repr__(self) -> str:
        where = hz_words(self.frequency / (2 * np.pi))
        return f"<Interconnection: {self.status.name.lower()}, margin {self.margin:.4g} at {where}>"

    def summary(self) -> str:
        """The verdict in plain text, with what stands in the way."""
        lines = [
            f"verdict    {_ALL_UNSTABLE if self.margin > 1 and not self.stable and self.poles.size else self.status.value}"
        ]
        if self.pair is not None or (self.poles.size and not self.stable):
            whose = "of that pair" if self.pair is not None else "of the loop of the models"
            shown = ", ".join(f"{pole:.4g}" for pole in self.poles[:_SHOWN])
            more = f" and {self.poles.size - _SHOWN} more" if self.poles.size > _SHOWN else ""
            lines.append(f"poles      {shown}{more} {whose}")
        lines.append(f"margin     {self._margin_words}")
        if self.passive.any():
            lines.append(
                f"passive    {int(self.passive.sum())} of {self.passive.size} arcs are proved by passivity of both sides"
            )
        if self.margin <= 1:
            lines += [f"measure    {one}" for one in self.wanted]
        lines.append(
            "assumed    both sides stable standing alone, and what their bands assume: class, poles, bounds of the samples"
        )
        return "\n".join(lines)

    @property
    def _margin_words(self) -> str:
        hz = hz_words(self.frequency / (2 * np.pi))
        if np.isinf(self.margin):
            return "infinite: both sides are known, or no error that is left to them closes the loop"
        if self.margin > 1:
            return f"both errors could be {self.margin:.4g} times as large; least at {hz}, where the {self.limited_by} limits"
        if not self.margin:
            return f"none; {hz} stands in the way"
        words = f"proved if both errors were at most {self.margin:.4g} times as large"
        return f"{words}; {hz} stands in the way, the {self.limited_by} most"

    @property
    def wanted(self) -> tuple[str, ...]:
        """Sentences on what to measure better, side by side: how narrow a band must become where nothing is proved."""
        hz = hz_words(self.frequency / (2 * np.pi))
        if self.margin > 1:
            return ()
        found: list[str] = []
        for name, share, bound, factor in zip(("source", "load"), self.shares, self.bounds, self.needed, strict=True):
            if not share.any():
                continue
            i, j = np.unravel_index(np.argmax(share), share.shape)
            if np.isinf(bound[i, j]):
                found.append(f"{name}: nothing bounds entry ({i + 1}, {j + 1}) at {hz}")
                continue
            there = f"at {hz} entry ({i + 1}, {j + 1}) is known to {bound[i, j]:.4g}"
            if factor == 0:
                found.append(f"{name}: {there}; knowing this side better does not do alone")
            else:
                found.append(
                    f"{name}: {there}; {factor:.3g} times that, in all entries, is enough with the other side as it is"
                )
        return tuple(found)
