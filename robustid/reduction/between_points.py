"""Between and beyond the frequency points: how far a small model may be from the identified one where nothing was measured."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from robustid.core import Complex, Real, responses
from robustid.data import FrequencyResponse
from robustid.identification import Identification, PositiveReal

if TYPE_CHECKING:
    import control

_GRID = 1024  # angles equally spaced, and as many, a constant ratio apart, below the first of them
_SOME = 40  # points that are added with the first
_LOWEST = 1e-5  # rad, beside 0
_NEAR = 0.1  # relative: a resonance that has moved by less is the same one


class Guard:
    r"""\|G - F\| <= K S + the largest \|F\| within a tenth of the frequency, of a model G and the identified F; K S of the
    prior. At every angle; where G has integrators, from the lowest frequency point on. `times` as much where F itself misses
    its data by so much. Of a positive-real class more in proportion to the frequency above the last point, as an inductance, and
    to its inverse below the first, as a capacitance: both are passive, and a ball holds neither.
    """

    def __init__(self, identification: Identification, integrators: int, times: float = 1.0):
        problem, model = identification.problem, identification.model
        lines = np.abs(problem.angles)
        lines = np.unique(lines[lines > 0])
        lowest = min(lines.min(initial=np.inf), np.pi / _GRID)
        even = np.linspace(0, np.pi, _GRID)
        low = np.geomspace(_LOWEST, float(even[1]), _GRID, endpoint=False)
        angles = np.unique(np.concatenate([even, low, lines, (lines[1:] + lines[:-1]) / 2, resonances(model)]))
        self._lowest = lowest if integrators else 0.0
        self._ends = (lines[0], lines[-1]) if isinstance(problem.prior, PositiveReal) and lines.size else None
        self._angles = angles[angles >= self._lowest]
        self._model, self._dt = model, problem.dt
        scales = identification.prior.scales(problem.entries.outputs, problem.entries.inputs)
        self._gain, self._times = identification.prior.gain_bound * scales, times
        self._weight = problem.weighting
        self._response = responses(model, self._angles)
        self._allowed = self._allowed_at(self._angles, self._response)

    def _allowed_at(self, angles: Real, here: Complex) -> Real:
        """(F, ny, nu)."""
        first = np.searchsorted(self._angles, angles * (1 - _NEAR))
        last = np.searchsorted(self._angles, angles * (1 + _NEAR), side="right")
        sizes = np.abs(self._response)
        around = [sizes[a:b].max(axis=0, initial=0.0) for a, b in zip(first, last, strict=True)]
        gain = self._gain * self._weight.sizes(angles)[:, None, None]
        growth = self._times * self._growth(angles)[:, None, None]
        return growth * (gain + np.maximum(np.abs(here), np.array(around).reshape(here.shape)))

    def _growth(self, angles: Real) -> Real:
        """Factors of at least 1, beyond the ends of the data."""
        if self._ends is None:
            return np.ones_like(angles)
        at, first, last = (np.tan(np.maximum(turn, _LOWEST) / 2) for turn in (angles, *self._ends))
        return np.maximum(1.0, np.maximum(at / last, first / at))

    @property
    def spread(self) -> FrequencyResponse:
        """Some frequency points everywhere, with the identified model as data."""
        at = np.searchsorted(self._angles, np.linspace(self._lowest, np.pi, _SOME + 1)[1:])
        return FrequencyResponse(self._angles[at] / self._dt, self._response[at], bound=self._allowed[at], dt=self._dt)

    def check(self, model: control.StateSpace, limit: float) -> tuple[float, FrequencyResponse | None]:
        r"""The largest \|G - F\| over what is allowed; and the points that hold a model to `limit` where it is beyond, if any:
        one for every stretch of angles, with the identified model as data.
        """
        own = np.setdiff1d(resonances(model), self._angles)
        own = own[own >= self._lowest]
        response = responses(self._model, own)
        order = np.argsort(np.concatenate([self._angles, own]))
        angles = np.concatenate([self._angles, own])[order]
        values = np.concatenate([self._response, response])[order]
        allowed = np.concatenate([self._allowed, self._allowed_at(own, response)])[order]
        ratio = np.max(np.abs(responses(model, angles) - values) / allowed, axis=(1, 2))
        over = np.flatnonzero(ratio > limit)
        if not over.size:
            return float(ratio.max()), None
        stretches = np.split(over, np.flatnonzero(np.diff(over) > 1) + 1)
        at = np.array([stretch[np.argmax(ratio[stretch])] for stretch in stretches])
        return float(ratio.max()), FrequencyResponse(angles[at] / self._dt, values[at], bound=allowed[at], dt=self._dt)


def resonances(model: control.StateSpace) -> Real:
    """Angles of the poles, and half a width to either side."""
    poles = model.poles()
    poles = poles[(poles.imag >= 0) & (poles != 0)]
    angles, width = np.angle(poles), -np.log(np.abs(poles))
    found = np.concatenate([angles, angles - width, angles + width])
    return found[(found >= 0) & (found <= np.pi)]
