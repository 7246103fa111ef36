"""Pure delays: estimated from a response, and put back into models (taken out of data by their `without_delay`)."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from robustid.core import (
    Frozen,
    as_array,
    as_count,
    as_flag,
    as_float,
    as_kind,
    as_positive,
    as_state_space,
    counted,
    freeze,
)
from robustid.data import FrequencyResponse
from robustid.errors import InputError, InputTypeError
from robustid.estimation.pole_fit import PoleFit, Refined

if TYPE_CHECKING:
    import control

# In units of pi over the highest omega, the sample time of a record that just holds this frequency point.
_STEP = 0.5
_LONGEST = 20
_HIGHEST = 16  # order tried
_REFINED = 2  # local minima of the search that are refined
_PATIENCE = 3  # orders in a row that don't pay before the search for one ends
_EXACT = 1e-24  # squared relative misfit of numbers that are exact but for rounding
_WHOLE = 1e-6  # part of a sample that is rounding
_ALL_PASS = 8  # largest order of the filter for the fraction
_MOST_SAMPLES = 1000


@dataclasses.dataclass(frozen=True, eq=False)
class Delay(Frozen):
    """A delay that was estimated; from `estimate_delay`.

    Attributes
    ----------
    seconds : float
    deviation : float, s
        Standard deviation: where the cost has risen as much as one standard deviation costs, on the farther side (inf where it
        never does). It knows nothing of an order that is wrong.
    order : int
        Of the rational part.
    misfit : float
        Root mean square of ``|G - model|`` over its standard deviation (over ``|G|`` without a covariance), for the degrees
        of freedom: about 1 (the relative noise) where delay and order explain the response.
    searched, profile : (n,) arrays
        The delays that were tried, in s, and the misfit at each of them: one clear minimum, or nothing is determined.
    """

    seconds: float
    deviation: float
    order: int
    misfit: float
    searched: np.ndarray
    profile: np.ndarray

    def __post_init__(self) -> None:
        self._set(**{name: freeze(as_array(name, getattr(self, name), ndim=1)) for name in ("searched", "profile")})


def estimate_delay(
    frf: FrequencyResponse, *, order: int | None = None, longest: float | None = None, feedthrough: bool = False
) -> Delay:
    """Estimate the delay, a fraction of a sample too, that a rational model of low order leaves unexplained.

    ``G = exp(-s tau) sum_i r_i/(s - a_i)``, one set of poles for all entries; with `dt` what a zero-order hold and sampling
    make of it, a fraction of a sample included. The weighted misfit is minimised over tau, poles and residues together.

    Parameters
    ----------
    frf : FrequencyResponse
        With one delay for all entries; take `frf.entry` where they differ. Weighted by its covariance, else relatively.
    order : int, optional
        Number of poles. Default: the shortest description (MDL) among 1 to 16.
    longest : float, s, optional
        End of the search, which starts at 0. Default: 20 pi over the highest omega (20 samples where the frequency points reach the
        Nyquist frequency), or pi over the distance of the frequency points if that is less.
    feedthrough : bool
        Whether the rational part has a constant: where the output answers at once, such as an acceleration to a force.

    Returns
    -------
    Delay

    Raises
    ------
    InputError, InputTypeError
        Too few frequency points for the order, a search beyond 2 pi over the distance of the frequency points (where delays
        can't be told apart), something that isn't a FrequencyResponse.

    Notes
    -----
    The phase alone does not say what is a delay: resonances, antiresonances and zeros outside the circle turn it too. They are
    rational, of an order that is small; a delay is not (sampled it costs a pole at 0 for every sample, in s many). Poles above
    the true order take over the delay: the smallest order that explains the response counts. Modes that are missing
    (`order` too small, or above the band) bend the estimate. Where the output is a displacement (two poles more than zeros)
    a small shift is almost another set of residues: the cost is flat like a fourth power, and the delay less sharp. Measured
    there with noise of 2 % of the response's rms at every frequency point (weak ones drown in it): 13 of 20 delays
    within 0.1 sample, one 1.6 off, two errors beyond three times `deviation`. With 1 % noise relative to every frequency point
    all of 60 were within 0.1.

    The sample that a sampled plant without feed-through always has belongs to the hold, not to the delay. Sampled:
    1/(z - p) with a delay of d + f samples is z^-d (B0 + B1/z)/(z - p), B0 = (p^(1-f) - 1)/(p - 1), B1 = 1 - B0 (the modified
    z-transform, scaled). A search over tau by relocated poles (`gustavsen2006`) gives the start, variable projection
    (`golub1973`) the minimum.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> s = 1j * np.linspace(1, 40, 60)
    >>> frf = rid.FrequencyResponse(s.imag, np.exp(-0.03 * s) * (1 / (s**2 + 0.2 * s + 100) - 0.5 / (s**2 + 0.4 * s + 700)))
    >>> delay = rid.prepare.estimate_delay(frf, longest=0.05)
    >>> round(delay.seconds, 6), delay.order
    (0.03, 4)
    """
    hint = "; call estimate_frf first" if type(frf).__name__ == "TimeRecord" else ""
    as_kind("frf", frf, FrequencyResponse, f"a FrequencyResponse{hint}")
    frf.require_complete("`estimate_delay`")
    searched = _search_grid(frf, longest)
    fit = PoleFit(frf, feedthrough=as_flag("feedthrough", feedthrough))
    if order is not None:
        order = as_count("order", order, least=1)
    if fit.unknowns(order or 1) >= 2 * fit.samples:
        raise InputError(
            f"`frf` has {counted(frf.omega.size, 'frequency point')}, too few for a delay and"
            f" {counted(order or 1, 'pole')}; give more frequency points"
        )
    if order is not None:
        return _result(fit, order, *_at_order(fit, order, searched))
    best, shortest, worse = None, np.inf, 0
    for count in range(1, _HIGHEST + 1):
        if best is not None and (worse == _PATIENCE or fit.unknowns(count) >= 2 * fit.samples):
            break
        found = (count, *_at_order(fit, count, searched))
        misfit = found[1].cost / fit.samples
        length = fit.samples * np.log(misfit + _EXACT) + fit.unknowns(count) / 2 * np.log(2 * fit.samples)
        best, shortest, worse = (found, length, 0) if best is None or length < shortest else (best, shortest, worse + 1)
    return _result(fit, *best)  # type: ignore[misc]


def _search_grid(frf: FrequencyResponse, longest: float | None) -> np.ndarray:
    highest = frf.omega[-1]
    if frf.omega.size < 2 or highest == frf.omega[0]:
        raise InputError(f"`frf` has {counted(frf.omega.size, 'frequency point')}; a delay needs several frequencies")
    spacing = float(np.median(np.diff(np.unique(frf.omega))))
    if longest is None:
        longest = min(_LONGEST * np.pi / highest, np.pi / spacing)
    longest = as_positive("longest", longest)
    if longest >= 2 * np.pi / spacing:
        raise InputError(
            f"`longest` = {longest:g} s: frequency points {spacing / (2 * np.pi):g} Hz apart can't tell delays from those"
            f" {2 * np.pi / spacing:g} s longer; search below that"
        )
    return np.linspace(0.0, longest, 2 + int(longest * highest / np.pi / _STEP))


def _at_order(fit: PoleFit, order: int, searched: np.ndarray) -> tuple[Refined, np.ndarray, np.ndarray]:
    """The best minimum, the delays that were searched and what they cost."""
    costs, poles = fit.search(order, searched)
    around = np.concatenate([[np.inf], costs, [np.inf]])
    lowest = np.flatnonzero((costs <= around[:-2]) & (costs <= around[2:]))
    starts = lowest[np.argsort(costs[lowest])][:_REFINED]
    found = min((fit.refine(float(searched[k]), poles[int(k)]) for k in starts), key=lambda minimum: minimum.cost)
    return found, searched, costs


def _result(fit: PoleFit, order: int, found: Refined, searched: np.ndarray, costs: np.ndarray) -> Delay:
    freedom = fit.samples - fit.unknowns(order) / 2
    misfit, profile = math.sqrt(found.cost / freedom), np.sqrt(costs / freedom)
    return Delay(found.delay, fit.deviation(found), order, misfit, searched, profile)


class DelayedModel(NamedTuple):
    """A model with a delay put back; from `with_delay`."""

    model: control.StateSpace
    seconds: float
    all_pass: int  # order of the all-pass filter that does the fraction of a sample; 0: whole samples, exact

    def error(self, omega: ArrayLike) -> np.ndarray:
        """|all-pass - exp(-1j omega seconds)|: the error relative to the delayed response at frequencies in rad/s."""
        omega, dt = as_array("omega", omega), float(self.model.dt)
        if not self.all_pass:
            return np.zeros_like(omega)
        part = self.seconds / dt - _register(self.seconds / dt, self.all_pass)
        a, z = _thiran(part, self.all_pass), np.exp(1j * omega * dt)
        late = np.asarray(np.polyval(a[::-1], z) / np.polyval(a, z), dtype=complex)
        return np.abs(late - z**-part)


def with_delay(model: control.StateSpace, seconds: float) -> DelayedModel:
    """Put a delay at the inputs of a discrete model: whole samples exactly, a fraction by an all-pass filter.

    Whole samples are poles at zero. With a fraction Thiran's filter of order N = 1 to 8 does the delay D (in samples,
    N - 1/2 <= D < N + 1/2 where D is above 1/2) and poles at zero the remainder:

    ``A(z) = z^N a(1/z)/a(z)``,  ``a_k = (-1)^k C(N, k) prod_{i=0..N} (D - N + i)/(D - N + k + i)``

    |A| = 1 at every frequency, and A is stable; its phase is right at low frequencies (2 N derivatives) and wrong at pi/dt.

    Parameters
    ----------
    model : control.StateSpace
        Discrete, with its sample time. A continuous one: exact delays are not rational; use `control.pade`.
    seconds : float, s
        At least 0.

    Returns
    -------
    DelayedModel
        With `model`, and `error(omega)`: what the fraction costs.

    Raises
    ------
    InputError, InputTypeError
        Something else than a discrete model with a sample time, a negative or enormous delay.

    Notes
    -----
    Source: `thiran1971`: the all-pass with maximally flat group delay.

    Examples
    --------
    >>> import control, robustid as rid
    >>> plant = control.ss(0.5, 1.0, 1.0, 0.0, 0.01)
    >>> whole = rid.prepare.with_delay(plant, 0.02)
    >>> abs(whole.model.poles()).tolist(), whole.all_pass
    ([0.5, 0.0, 0.0], 0)
    >>> rid.prepare.with_delay(plant, 0.033).error([30.0, 100.0]).round(4).tolist()
    [0.0, 0.0032]
    """
    import control

    model = as_state_space("model", model)
    if not isinstance(model, control.StateSpace):
        raise InputTypeError(f"`model` must be a control.StateSpace; got {type(model).__name__}")
    if not model.dt or model.dt is True:
        raise InputError(
            "`model` must be discrete with its sample time; of a continuous one take control.pade(seconds, n)"
        )
    seconds = as_float("seconds", seconds)
    samples = seconds / model.dt
    if not 0 <= samples <= _MOST_SAMPLES:
        raise InputError(f"`seconds` = {seconds:g} must be from 0 to {_MOST_SAMPLES} samples of {model.dt:g} s")
    order = 0 if abs(samples - round(samples)) <= _WHOLE else min(max(round(samples), 1), _ALL_PASS)
    register = _register(samples, order)
    if not register and not order:
        return DelayedModel(model, seconds, 0)
    part = _thiran(samples - register, order)
    chain = _quotient(part[::-1], np.concatenate([part, np.zeros(register)]), model.dt)
    delayed = model * control.append(*[chain] * model.ninputs)
    labels = {"inputs": model.input_labels, "outputs": model.output_labels, "name": model.name}
    return DelayedModel(control.ss(delayed, **labels), seconds, order)


def _register(samples: float, order: int) -> int:
    """Whole samples beside an all-pass of that order."""
    return round(samples) - order if round(samples) > order else 0


def _thiran(samples: float, order: int) -> np.ndarray:
    """Coefficients a_0 = 1, ..., a_N of the all-pass with that delay."""
    if not order:
        return np.ones(1)
    i = np.arange(order + 1)
    return np.array(
        [(-1) ** k * math.comb(order, k) * np.prod((samples - order + i) / (samples - order + k + i)) for k in i]
    )


def _quotient(above: np.ndarray, below: np.ndarray, dt: float) -> control.StateSpace:
    """Polynomials in z as a state space; `below` starts with 1 and is at least as long."""
    import control

    above = np.concatenate([np.zeros(below.size - above.size), above])
    n = below.size - 1
    a = np.eye(n, k=-1)
    a[0] = -below[1:]
    return control.ss(a, np.eye(n, 1), [above[1:] - above[0] * below[1:]], above[0], dt)
