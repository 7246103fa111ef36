"""The a-priori class of the non-parametric part."""

from __future__ import annotations

import dataclasses

from robustid._arrays import Frozen, as_positive
from robustid.errors import InputError

# Decay by half over a million samples; below, nodes can't be told from the unit circle.
_SLOWEST = 1e-6


@dataclasses.dataclass(frozen=True, kw_only=True)
class Prior(Frozen):
    """The non-parametric part G is analytic and bounded by K in the disc |z| < rho (series in the delay).

    In the engineer's variable: the poles of G lie inside |z| <= 1/rho and |G| <= K on |z| = 1/rho; the impulse
    response obeys ``|g[k]| <= gain_bound * decay_rate**-k``.

    Parameters
    ----------
    gain_bound : float
        K > 0, output unit per input unit.
    decay_rate : float
        rho > 1, per sample.

    Notes
    -----
    An assumption: data can refute it, never prove it. Source: `inanc2001` section II-B, `parrilo1998`.

    Examples
    --------
    >>> import robustid as rid
    >>> rid.Prior(gain_bound=0.2, decay_rate=1.1)
    Prior(gain_bound=0.2, decay_rate=1.1)
    """

    gain_bound: float
    decay_rate: float

    def __post_init__(self) -> None:
        self._set(
            gain_bound=as_positive("gain_bound", self.gain_bound),
            decay_rate=as_positive("decay_rate", self.decay_rate),
        )
        if self.decay_rate <= 1:
            raise InputError(
                f"`decay_rate` must exceed 1 (the impulse response decays as decay_rate**-k); got {self.decay_rate:g}"
            )
        if self.decay_rate < 1 + _SLOWEST:
            raise InputError(
                f"`decay_rate` must be at least 1 + {_SLOWEST:g}, to be told from 1 in computation;"
                f" got 1 + {self.decay_rate - 1:.3g}"
            )
