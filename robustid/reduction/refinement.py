"""Models of one order fitted to time and frequency samples together: least squares, then minimax.

A model is G = D + c (zI - A)^-1 x + sum_j h_j/(z - 1)^j. With sigma = 1 + c (zI - A)^-1 d, the model num/sigma has the poles
eig(A - d c), and at d = 0 its derivative along d is -(sigma - 1) G: Gauss-Newton steps are linear problems in (num, d), whose
functions are orthonormal (Takenaka-Malmquist) however close the poles are to each other or to the circle.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from robustid.bases import Sections
from robustid.reduction.minimax import orthonormal_columns, smallest_maximum
from robustid.reduction.sample_map import SampleMap

_STEPS = 40  # of one descent
_NONE = np.zeros(0, complex)
_FLAT = 1e-3  # relative gain of a step below which a descent ends
_FIRST_RADIUS, _LEAST_RADIUS = 0.5, 1e-4  # of the trust region, in units of a pole's distance to the circle


@dataclasses.dataclass(frozen=True)
class Fit:
    """A model with its residuals at the samples.

    Attributes
    ----------
    A, c : (n, n), (n,) arrays
        Of the functions c (zI - A)^-1.
    x : (n,) array
        Their coefficients.
    fixed : (k,) array
        Coefficients of `SampleMap.fixed`: D, those of the integrators, those of the free responses.
    outputs : list of (L,) arrays
        What the stable part and D put out, by experiment.
    error : (N,) complex array
        In units of the bounds.
    """

    A: np.ndarray
    c: np.ndarray
    x: np.ndarray
    fixed: np.ndarray
    outputs: list[np.ndarray]
    error: np.ndarray

    @property
    def poles(self) -> np.ndarray:
        """Of the stable part."""
        return np.linalg.eigvals(self.A) if self.A.size else np.zeros(0, complex)

    @property
    def cost(self) -> float:
        """Root mean square of |residual|/bound: no greater than `worst`."""
        return float(np.sqrt(np.mean(np.abs(self.error) ** 2)))

    @property
    def worst(self) -> float:
        """Largest |residual|/bound."""
        return float(np.abs(self.error).max())


def pole_functions(poles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A and c of the orthonormal functions of these poles (conjugates included), all inside the unit circle.

    And for every function the size of d that moves its pole by about its distance to the circle.
    """
    upper = [complex(a) for a in poles if a.imag >= 0]
    if not upper:
        return np.zeros((0, 0)), np.zeros(0), np.zeros(0)
    sections = Sections(tuple(upper), 1)
    sizes = [np.full(2 if a.imag else 1, np.sqrt(1 - abs(a) ** 2)) for a in sections.zeros]
    return np.array(sections.section.A), sections.section.c[0].copy(), np.concatenate(sizes)


def inside(poles: np.ndarray, radius: float) -> np.ndarray:
    """Poles beyond `radius` drawn back to it."""
    size = np.abs(poles)
    return np.where(size > radius, poles * (radius / np.maximum(size, radius)), poles)


def least_squares(samples: SampleMap, poles: np.ndarray) -> Fit:
    """The best numerators for given poles."""
    A, c, _ = pole_functions(poles)
    G = np.hstack([samples.columns(A, c, samples.signals()), samples.fixed])
    U, V = orthonormal_columns(samples.real(G))
    return evaluated(samples, A, c, V @ (U.T @ samples.real(samples.y)))


def evaluated(samples: SampleMap, A: np.ndarray, c: np.ndarray, v: np.ndarray) -> Fit:
    """The model with the numerators v = (x, fixed)."""
    n = c.size
    tracks = samples.tracks
    outputs = [t.states(A, c, t.signal) @ v[:n] + v[n] * t.signal for t in tracks]
    stable = np.vstack([t.rows(out[:, None]) for t, out in zip(tracks, outputs, strict=True)])[:, 0]
    error = samples.y - stable - samples.fixed[:, 1:] @ v[n + 1 :]
    return Fit(A, c, v[:n], v[n:], outputs, error)


def pole_columns(samples: SampleMap, A: np.ndarray, c: np.ndarray, outputs: list[np.ndarray]) -> np.ndarray:
    """Derivatives of the residuals along d, times -1: -(c (zI - A)^-1) G."""
    return -samples.columns(A, c, outputs)


def moved(A: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Poles of num/sigma: the zeros of sigma = 1 + c (zI - A)^-1 d."""
    return np.linalg.eigvals(A - np.outer(d, c))


def descended(samples: SampleMap, fit: Fit, radius: float, steps: int = _STEPS, held: np.ndarray = _NONE) -> Fit:
    """Levenberg-Marquardt over the poles but those held, the numerators at their best for all (variable projection)."""
    damping = 0.1
    y = samples.real(samples.y)
    for _ in range(steps):
        moving = _apart(fit.poles, held)
        if not moving.size:
            return fit
        A, c, _ = pole_functions(fit.poles)
        L = samples.real(np.hstack([samples.columns(A, c, samples.signals()), samples.fixed]))
        A, c, size = pole_functions(moving)
        U, _ = orthonormal_columns(L)
        J = samples.real(pole_columns(samples, A, c, fit.outputs)) * size
        J, rest = J - U @ (U.T @ J), y - U @ (U.T @ y)
        left, values, right = np.linalg.svd(J, full_matrices=False)
        along, largest = left.T @ rest, values.max(initial=0.0)
        if largest == 0:
            return fit
        before = fit.cost
        while damping < 1e4:
            d = right.T @ (values * along / (values**2 + (damping * largest) ** 2))
            ahead = least_squares(samples, np.concatenate([held, inside(moved(A, c, size * d), radius)]))
            if ahead.cost < before:
                fit, damping = ahead, damping / 5
                break
            damping *= 4
        if not fit.cost < before * (1 - _FLAT):
            return fit
    return fit


def _apart(poles: np.ndarray, held: np.ndarray) -> np.ndarray:
    """The poles without those that are held."""
    for pole in held:
        poles = np.delete(poles, np.argmin(np.abs(poles - pole)))
    return poles


def levelled(samples: SampleMap, fit: Fit, radius: float, limit: float, steps: int, held: np.ndarray = _NONE) -> Fit:
    """Minimax: a sequence of convex min-max problems in (numerators, d), d in a trust region; poles that are held stay.

    Ends where a step gains less than 0.1 %, 2 % once `limit` is met; or where it cannot meet it.
    """
    trust, gain = _FIRST_RADIUS, np.inf
    fit = fixed_poles_levelled(samples, fit)
    for step in range(steps):
        worst, moving = fit.worst, _apart(fit.poles, held)
        n = moving.size
        if not n or worst < 0.5 * limit:
            return fit
        A, c, _ = pole_functions(fit.poles)
        numerators = np.hstack([samples.columns(A, c, samples.signals()), samples.fixed])
        A, c, size = pole_functions(moving)
        U, V = orthonormal_columns(samples.real(numerators))
        first = np.concatenate([V @ (U.T @ samples.real(samples.y - fit.error)), np.zeros(n)])
        reach = np.concatenate([np.full(numerators.shape[1], np.inf), trust * size])
        G = np.hstack([numerators, pole_columns(samples, A, c, fit.outputs)])
        v, expected = smallest_maximum(G, samples.y, samples.discs, first, reach)
        ahead = _stepped(samples, A, c, v, radius, held)
        part = (worst - ahead.worst) / max(worst - expected, 1e-12 * worst)
        if ahead.worst < worst:
            gain, fit = 1 - ahead.worst / worst, ahead
        trust *= 2.0 if part > 0.75 else 0.25 if part < 0.25 else 1.0
        slow = 1 - expected / worst < _FLAT or trust < _LEAST_RADIUS
        met = fit.worst <= limit and gain < 0.02
        hopeless = step > 5 and gain < 0.02 and expected > 1.3 * limit
        if slow or met or hopeless:
            return fit
    return fit


def _stepped(samples: SampleMap, A: np.ndarray, c: np.ndarray, v: np.ndarray, radius: float, held: np.ndarray) -> Fit:
    """The model num/sigma of a step: D + c (zI - A + d c)^-1 (x - d D); new numerators where poles are held or drawn back."""
    n = c.size
    d, numerators = v[-n:], v[:-n].copy()
    poles = moved(A, c, d)
    if held.size or np.abs(poles).max() > radius:
        return fixed_poles_levelled(samples, least_squares(samples, np.concatenate([held, inside(poles, radius)])))
    numerators[:n] -= d * numerators[n]
    return evaluated(samples, A - np.outer(d, c), c, numerators)


def fixed_poles_levelled(samples: SampleMap, fit: Fit) -> Fit:
    """The numerators with the smallest largest residual for the poles of a fit."""
    A, c, _ = pole_functions(fit.poles)
    G = np.hstack([samples.columns(A, c, samples.signals()), samples.fixed])
    U, V = orthonormal_columns(samples.real(G))
    first = V @ (U.T @ samples.real(samples.y))
    v, _ = smallest_maximum(G, samples.y, samples.discs, first, np.full(first.size, np.inf))
    return evaluated(samples, A, c, v)
