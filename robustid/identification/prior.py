"""The a-priori class of the non-parametric part."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from robustid.core import Frozen, Real, as_array, as_positive
from robustid.errors import InputError

# Decay by half over a million samples; below, nodes can't be told from the unit circle.
_SLOWEST = 1e-6


@dataclasses.dataclass(frozen=True, kw_only=True)
class Prior(Frozen):
    """The non-parametric part G is analytic and bounded by K in the disc |z| < rho (series in the delay).

    In the forward-shift convention: the poles of G lie inside |z| <= 1/rho and |G| <= K on |z| = 1/rho; the impulse
    response obeys ``|g[k]| <= gain_bound * decay_rate**-k``.

    Parameters
    ----------
    gain_bound : float
        K > 0, output unit per input unit.
    decay_rate : float
        rho > 1, per sample.
    scaling : (ny, nu) array, optional
        For MIMO: the largest singular value of G divided by it, entry by entry, is below K. So that no signal
        dominates: sizes of the outputs over sizes of the inputs, ``numpy.divide.outer(sizes_y, sizes_u)``, or any gains of the
        entries (a matrix of higher rank costs as many times the states). Ones where there is none.

    Notes
    -----
    An assumption: data can refute it, never prove it. Source: `inanc2001` section II-B, `parrilo1998`.

    Examples
    --------
    >>> import robustid as rid
    >>> rid.Prior(gain_bound=0.2, decay_rate=1.1)
    Prior(gain_bound=0.2, decay_rate=1.1)

    Outputs of 50 um and 1e-4 rad, an input of 10 V: K is without unit then.

    >>> rid.Prior(gain_bound=0.2, decay_rate=1.1, scaling=[[5.0], [1e-5]]).scales(2, 1).ravel()
    array([5.e+00, 1.e-05])
    """

    gain_bound: float
    decay_rate: float
    scaling: Any = None

    def __post_init__(self) -> None:
        self._set(
            gain_bound=as_positive("gain_bound", self.gain_bound),
            decay_rate=as_positive("decay_rate", self.decay_rate),
        )
        if self.scaling is not None:
            self._set(scaling=_as_scaling(self.scaling))
        if self.decay_rate <= 1:
            raise InputError(
                f"`decay_rate` must exceed 1 (the impulse response decays as decay_rate**-k); got {self.decay_rate:g}"
            )
        if self.decay_rate < 1 + _SLOWEST:
            raise InputError(
                f"`decay_rate` must be at least 1 + {_SLOWEST:g}, to be told from 1 in computation;"
                f" got 1 + {self.decay_rate - 1:.3g}"
            )

    def __repr__(self) -> str:
        scaling = "" if self.scaling is None else f", scaling={[list(row) for row in self.scaling]}"
        return f"Prior(gain_bound={self.gain_bound!r}, decay_rate={self.decay_rate!r}{scaling})"

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


def _as_scaling(value: Any) -> tuple[tuple[float, ...], ...]:
    """The matrix, as numbers that can be compared."""
    matrix = as_array("scaling", value, ndim=2)
    if not np.all(matrix > 0):
        raise InputError(f"`scaling` must be positive; got a smallest entry of {matrix.min(initial=0.0):g}")
    return tuple(tuple(map(float, row)) for row in matrix)


def prior_fields(prior: Prior) -> dict[str, Any]:
    """Fields from which a prior was made, for storage and copies."""
    return {field.name: getattr(prior, field.name) for field in dataclasses.fields(prior)}
