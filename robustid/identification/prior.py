"""The a-priori class of the non-parametric part."""

from __future__ import annotations

import dataclasses
from typing import Any, ClassVar

import numpy as np

from robustid.core import Frozen, Plane, Real, Record, as_array, as_count, as_positive, hz_words, time_words
from robustid.errors import InputError
from robustid.identification.weighting import ONE, PriorWeight, as_weight

# Decay by half over a million samples; below, nodes can't be told from the unit circle.
_SLOWEST = 1e-6
_STEEPEST = 8  # roll-off


@dataclasses.dataclass(frozen=True, kw_only=True)
class Prior(Frozen):
    """The non-parametric part G is analytic and bounded by K beyond the frequencies: its impulse response decays.

    In discrete time in the disc |z| < rho (series in the delay): the poles of G lie inside |z| <= 1/rho and |G| <= K on
    |z| = 1/rho; the impulse response obeys ``|g[k]| <= gain_bound * decay_rate**-k``. In continuous time in Re s > -alpha: the
    poles have real parts of at most -alpha and |G(s)| <= K on Re s = -alpha.

    Parameters
    ----------
    gain_bound : float
        K > 0, output unit per input unit.
    decay_rate : float
        rho > 1, per sample. One of `decay_rate` and `decay`.
    decay : float, 1/s
        alpha > 0. For discrete data it stands for ``rho = exp(alpha dt)``.
    scaling : (ny, nu) array, optional
        For MIMO: the largest singular value of G divided by it, entry by entry, is below K. So that no signal
        dominates: sizes of the outputs over sizes of the inputs, ``numpy.divide.outer(sizes_y, sizes_u)``, or any gains of the
        entries (a matrix of higher rank costs as many times the states). Ones where there is none.
    roll_off : int, optional
        n: G falls as omega^-n above the `corner`. In continuous time ``|G| <= K |1 + j omega/corner|**-n`` on Re s = -alpha, in
        discrete time ``|G| <= K |(1 - a)/(1 - a exp(-j omega dt))|**n``, a = exp(-corner dt), on |z| = 1/rho: a smaller class
        than that without.
    corner : float, rad/s
        Where the roll-off begins.
    weight : control.StateSpace or control.TransferFunction, optional
        W, stable and of minimum phase, of one input and one output and of the same kind of time as the data (with their dt):
        ``|G| <= K |W(j omega)|`` on Re s = -alpha, ``|G| <= K |W(exp(j omega dt))|`` on |z| = 1/rho; hence
        ``|G| <= K |W(alpha + j omega)|`` and ``K |W(rho exp(j omega dt))|`` at the frequencies. From a table: `prior_weight`. One
        of `weight` and `roll_off`.

    Notes
    -----
    An assumption: data can refute it, never prove it. Source: `inanc2001` section II-B, `parrilo1998`.

    Examples
    --------
    >>> import robustid as rid
    >>> rid.Prior(gain_bound=0.2, decay_rate=1.1)
    Prior(gain_bound=0.2, decay_rate=1.1)
    >>> rid.Prior(gain_bound=0.2, decay=30.0)
    Prior(gain_bound=0.2, decay=30.0)

    Outputs of 50 um and 1e-4 rad, an input of 10 V: K is without unit then.

    >>> rid.Prior(gain_bound=0.2, decay_rate=1.1, scaling=[[5.0], [1e-5]]).scales(2, 1).ravel()
    array([5.e+00, 1.e-05])

    A mass line: displacement per force above 200 Hz.

    >>> rid.Prior(gain_bound=1e-6, decay=30.0, roll_off=2, corner=1257.0)
    Prior(gain_bound=1e-06, decay=30.0, roll_off=2, corner=1257.0)
    """

    gain_bound: float
    decay_rate: Any = None
    decay: Any = None
    scaling: Any = None
    roll_off: Any = None
    corner: Any = None
    weight: Any = None

    positive_real: ClassVar[bool] = False
    passive: ClassVar[str] = ""  # name of the physical property
    physical: ClassVar[str] = ""  # the property of the plant that stands in the place of a guess of K

    def __post_init__(self) -> None:
        self._set(gain_bound=as_positive("gain_bound", self.gain_bound))
        if self.scaling is not None:
            matrix = as_array("scaling", self.scaling, ndim=2)
            if not np.all(matrix > 0):
                raise InputError(f"`scaling` must be positive; got a smallest entry of {matrix.min(initial=0.0):g}")
            self._set(scaling=tuple(tuple(map(float, row)) for row in matrix))
        self._check_weight()
        if (self.decay_rate is None) == (self.decay is None):
            raise InputError(
                "`decay_rate` (rho, per sample) or `decay` (alpha, in 1/s) must be given to the prior, one of the two;"
                f" got {'neither' if self.decay is None else 'both'}"
            )
        if self.decay is not None:
            self._set(decay=as_positive("decay", self.decay))
            return
        self._set(decay_rate=as_positive("decay_rate", self.decay_rate))
        if self.decay_rate <= 1:
            raise InputError(
                f"`decay_rate` must exceed 1 (the impulse response decays as decay_rate**-k); got {self.decay_rate:g}"
            )
        if self.decay_rate < 1 + _SLOWEST:
            raise InputError(
                f"`decay_rate` must be at least 1 + {_SLOWEST:g}, to be told from 1 in computation;"
                f" got 1 + {self.decay_rate - 1:.3g}"
            )

    def _check_weight(self) -> None:
        """Check and convert what says how the bound depends on the frequency."""
        if (self.roll_off is None) != (self.corner is None):
            given, missing = ("roll_off", "corner") if self.corner is None else ("corner", "roll_off")
            raise InputError(
                f"`{given}` of the prior is given without `{missing}`: the non-parametric part falls as omega**-roll_off above"
                " the corner [rad/s]; give both, or neither"
            )
        if self.roll_off is not None:
            if self.weight is not None:
                raise InputError("`roll_off` and `weight` both say how the bound of the prior falls; give one of them")
            self._set(roll_off=as_count("roll_off", self.roll_off, least=1), corner=as_positive("corner", self.corner))
            if self.roll_off > _STEEPEST:
                raise InputError(
                    f"`roll_off` must be at most {_STEEPEST}: the power of 1/omega, 2 for a mass; got {self.roll_off}"
                )
        if self.weight is not None:
            self._set(weight=as_weight(self.weight))

    def __repr__(self) -> str:
        scaling = "" if self.scaling is None else f", scaling={[list(row) for row in self.scaling]}"
        shape = "" if self.roll_off is None else f", roll_off={self.roll_off!r}, corner={self.corner!r}"
        shape += "" if self.weight is None else f", weight={self.weight!r}"
        return f"Prior(gain_bound={self.gain_bound!r}, {decay_argument(self)}{scaling}{shape})"

    @property
    def weighted(self) -> bool:
        """Say whether the bound depends on the frequency."""
        return self.roll_off is not None or self.weight is not None

    @property
    def weight_words(self) -> str:
        """Words on how the bound depends on the frequency, to follow |G| <= K; empty where it does not."""
        if self.roll_off is not None:
            return f", rolling off as omega^-{self.roll_off} above {hz_words(self.corner / (2 * np.pi), 4)}"
        return "" if self.weight is None else f" times {self.weight}"

    def weight_in(self, plane: Plane) -> PriorWeight:
        """The weight W of the class, G = W phi, in the variable of a plane, s or z; the prior is one of the same kind of time.

        That of the border, W(s + alpha) or W(rho z): without poles and zeros where the class is analytic.

        Raises
        ------
        InputError
            A weight of the other kind of time or of another sample time.
        """
        if not self.weighted:
            return ONE
        weight, n = self.weight, self.roll_off
        if weight is None and plane.dt:
            a = float(np.exp(-self.corner * plane.dt))
            weight = PriorWeight((0j,) * n, (complex(a),) * n, (-np.expm1(-self.corner * plane.dt)) ** n, plane.dt)
        elif weight is None:
            weight = PriorWeight((), (complex(-self.corner),) * n, self.corner**n, 0.0)
        if abs(weight.dt - plane.dt) > 1e-9 * plane.dt:
            raise InputError(
                f"`weight` of the prior is of {time_words(weight.dt)}, the data of {time_words(plane.dt)}; give a weight of the"
                " same kind, or `roll_off` and `corner`, which serve for both"
            )
        return weight.moved(times=1 / self.decay_rate) if plane.dt else weight.moved(plus=-self.decay)

    @property
    def rate(self) -> float:
        """The decay rate per sample, or the decay in 1/s."""
        return float(self.decay_rate if self.decay is None else self.decay)

    @property
    def least(self) -> float:
        """Lower bound of the real part of a positive-real class."""
        return 0.0

    @property
    def property_words(self) -> str:
        """The physical property of a passive class, as it is printed."""
        return f"{self.physical} (passive)"

    @property
    def slope(self) -> float:
        """Bound of |dG/dz| on the unit circle, K rho/(rho^2 - 1), or of |dG/ds| on the imaginary axis, K/(2 alpha)."""
        if self.decay is None:
            return self.gain_bound * self.decay_rate / (self.decay_rate**2 - 1)
        return self.gain_bound / (2 * self.decay)

    def with_rate(self, rate: float) -> Prior:
        """The same class with another decay, of the same kind."""
        return dataclasses.replace(self, **{"decay_rate" if self.decay is None else "decay": rate})

    @property
    def decay_words(self) -> str:
        """The decay of the impulse responses of the class, in words."""
        return f"decay rate {self.decay_rate:g}" if self.decay is None else f"decay {self.decay:g} 1/s"

    @property
    def where(self) -> str:
        """The region of the class, as it is printed."""
        return f"|z| < {self.decay_rate:g}" if self.decay is None else f"Re s > -{self.decay:g} 1/s"

    def decays_as(self, other: Prior) -> bool:
        """Say whether another class is analytic in the same region."""
        return (self.decay_rate, self.decay) == (other.decay_rate, other.decay)

    def sampled(self, dt: float) -> Prior:
        """The class of discrete time for a sample time in s: ``rho = exp(alpha dt)`` where a decay in 1/s is given."""
        if self.decay is None:
            return self
        return dataclasses.replace(self, decay=None, decay_rate=float(np.exp(self.decay * dt)))

    def scales(self, outputs: int, inputs: int) -> Real:
        """The scaling as a matrix, (ny, nu): G = scales * (a function of the ball K)."""
        if self.scaling is None:
            return np.ones((outputs, inputs))
        scales = np.array(self.scaling)
        if scales.shape != (outputs, inputs):
            raise InputError(
                f"`scaling` of the prior must have shape (ny, nu) = {(outputs, inputs)}, as the data; got {scales.shape}"
            )
        return scales


def decay_argument(prior: Prior) -> str:
    """The decay as an argument of a class, as it is printed."""
    return f"decay_rate={prior.decay_rate!r}" if prior.decay is None else f"decay={prior.decay!r}"


def any_prior(dt: float | None, scaling: object = None, **shape: Any) -> Prior:
    """A prior without meaning but for scaling and roll-off, where a problem needs one, for data of a sample time or without."""
    return Prior(gain_bound=1.0, scaling=scaling, **({"decay_rate": 1.05} if dt else {"decay": 1.0}), **shape)


def prior_fields(prior: Prior) -> Record:
    """Fields from which a prior was made, for storage and copies; `passive` names the property of passive classes."""
    fields = {field.name: getattr(prior, field.name) for field in dataclasses.fields(prior)}
    del fields["decay" if prior.decay is None else "decay_rate"]
    for name in ("roll_off", "corner", "weight"):
        if fields[name] is None:
            del fields[name]
    if prior.weight is not None:
        fields["weight"] = prior.weight.fields
    return {"passive": prior.passive, **fields} if prior.passive else fields
