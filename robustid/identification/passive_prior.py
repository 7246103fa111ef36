"""Passive classes: a physical property of the whole plant in the place of a guessed gain bound."""

from __future__ import annotations

import dataclasses
from typing import Any, ClassVar

from robustid.core import Plane, Record, as_positive
from robustid.errors import InputError
from robustid.identification.prior import Prior, decay_argument
from robustid.identification.weighting import PriorWeight


@dataclasses.dataclass(frozen=True, kw_only=True)
class BoundedReal(Prior):
    """The whole plant is passive in its scattering parameters: its largest singular value is at most 1, by physics.

    G = F, there is no parametric part, and K = 1 is no guess: sigma_max(S) <= 1 in Re s > -alpha, or in the disc |z| < rho.
    Networks with losses everywhere have an alpha > 0: at most the smallest real part of their poles, in magnitude.

    Parameters
    ----------
    decay : float, 1/s
        alpha > 0. One of `decay` and `decay_rate`.
    decay_rate : float
        rho > 1, per sample.

    Notes
    -----
    At alpha = 0 data on the axis say nothing between their frequency points: |S| <= 1 at each of them is all there is to test.
    Source: Nevanlinna-Pick interpolation, `ball1990`.

    Examples
    --------
    >>> import robustid as rid
    >>> rid.BoundedReal(decay=2e9)
    BoundedReal(decay=2000000000.0)
    """

    gain_bound: float = 1.0

    passive: ClassVar[str] = "bounded real"
    physical: ClassVar[str] = "sigma_max(F) <= 1"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.gain_bound != 1.0 or self.scaling is not None or self.weighted:
            raise InputError(
                "`gain_bound` of a BoundedReal class is 1, without a scaling or a roll-off; got"
                f" {self.gain_bound:g}. For another bound give Prior(gain_bound=...), for waves of other reference impedances"
                " convert the data first"
            )

    def __repr__(self) -> str:
        return f"BoundedReal({decay_argument(self)})"


@dataclasses.dataclass(frozen=True, kw_only=True)
class PositiveReal(Prior):
    """The plant is passive as force and velocity, or current and voltage, at the same points: F + F^H >= -2 slack, by physics.

    In Re s > -alpha, or in the disc |z| < rho. No gain bound is needed: the data bound every such function (Harnack's
    inequality). With lightly damped modes of one port (`passive_modes` as `parametric`, whose coefficients then are not negative)
    it is what they leave that is positive real there, and alpha may be larger than their damping.

    Parameters
    ----------
    decay : float, 1/s
        alpha > 0. One of `decay` and `decay_rate`.
    decay_rate : float
        rho > 1, per sample.
    slack : float
        In the unit of F, at least 0. A mode c s/(s^2 + 2 d s + w^2) of a mobility vanishes at s = 0, hence its real part
        is negative a little beyond the axis: for alpha up to 2 d/3 at least -c alpha/(w^2 - 2 d alpha + alpha^2). The sum of these
        over the modes admits it.
    gain_bound : float, optional
        Scale of the numbers, which has no influence on the class; the largest response in the data by default.

    Notes
    -----
    At alpha = 0 data on the axis say nothing between their frequency points: the sign of the real part at each of them is all
    there is to test. Source: Caratheodory and Toeplitz; in the orthonormal basis F(A) + F(A)' >= 0.

    Examples
    --------
    >>> import robustid as rid
    >>> rid.PositiveReal(decay=20.0)
    PositiveReal(decay=20.0)
    """

    gain_bound: Any = None
    slack: float = 0.0

    positive_real: ClassVar[bool] = True
    passive: ClassVar[str] = "positive real"
    physical: ClassVar[str] = "F + F^H >= 0"

    def __post_init__(self) -> None:
        if self.gain_bound is None:
            self._set(gain_bound=1.0)
            super().__post_init__()
            self._set(gain_bound=None)
        else:
            super().__post_init__()
        if self.scaling is not None or self.weighted:
            name = "scaling" if self.scaling is not None else "weight" if self.weight is not None else "roll_off"
            raise InputError(f"`{name}` has no meaning for a PositiveReal class, which has no gain bound; leave it out")
        self._set(slack=as_positive("slack", self.slack) if self.slack else 0.0)

    @property
    def least(self) -> float:
        """-slack."""
        return -self.slack

    @property
    def property_words(self) -> str:
        """F + F^H and its lower bound."""
        return f"F + F^H >= {-2 * self.slack if self.slack else 0:g} (passive)"

    def __repr__(self) -> str:
        slack = f", slack={self.slack!r}" if self.slack else ""
        return f"{type(self).__name__}({decay_argument(self)}{slack})"


@dataclasses.dataclass(frozen=True, kw_only=True, repr=False)
class NegativeImaginary(PositiveReal):
    """The plant is passive as force and displacement at the same points: s F is positive real, by physics.

    Of continuous time: behind a zero-order hold a displacement is none. F = G/s with G of the class of `PositiveReal`, whose
    parameters these are; the slack is one of velocities.

    Parameters
    ----------
    decay : float, 1/s
        alpha > 0.
    slack : float
        In the unit of F times rad/s, see `PositiveReal`.
    gain_bound : float, optional
        Scale of the numbers, without influence on the class.

    Notes
    -----
    The model may drift: s F need not vanish at s = 0, where nothing was measured. Source: Lanzon and Petersen; F + F^H by s F.

    Examples
    --------
    >>> import robustid as rid
    >>> rid.NegativeImaginary(decay=20.0)
    NegativeImaginary(decay=20.0)
    """

    passive: ClassVar[str] = "negative imaginary"
    physical: ClassVar[str] = "s F + (s F)^H >= 0"

    def __post_init__(self) -> None:
        if self.decay_rate is not None:
            raise InputError(
                "`decay_rate` has no meaning for a NegativeImaginary class, which is one of continuous time; give its `decay` in"
                " 1/s, and the response without a sample time"
            )
        super().__post_init__()

    def sampled(self, dt: float) -> Prior:
        """Refused: behind a zero-order hold a displacement is not negative imaginary."""
        raise InputError(
            f"`prior` is a NegativeImaginary class, of continuous time, and the data have a sample time of {dt:g} s: give the"
            " response without it, if it was measured without a hold"
        )

    def weight_in(self, plane: Plane) -> PriorWeight:
        """1/s, whatever the decay."""
        return PriorWeight((), (0j,), 1.0, 0.0)

    @property
    def property_words(self) -> str:
        """The property and its bound."""
        return f"s F + (s F)^H >= {-2 * self.slack if self.slack else 0:g} (passive)"


PASSIVE: dict[str, type[Prior]] = {kind.passive: kind for kind in (PositiveReal, BoundedReal, NegativeImaginary)}
PASSIVE_NAMES = tuple(PASSIVE)


def prior_from(fields: Record) -> Prior:
    """The prior of such fields; a gain bound of None of a passive class is left to it."""
    fields = dict(fields)
    kind = fields.pop("passive", None)
    if kind is None:
        return Prior(**fields)
    return PASSIVE[kind](**{name: value for name, value in fields.items() if value is not None})
