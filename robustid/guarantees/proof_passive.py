"""Passive plants in proof files: F + F* >= 0 is |S| <= 1 of S = (F - r)/(F + r), and discs of samples are discs."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from robustid.core import Complex, Real
from robustid.data import FrequencyResponse
from robustid.errors import InputError
from robustid.guarantees.proof_question import NOT_YET
from robustid.identification import MixedProblem, PositiveReal, Prior

_ROUNDED, _OF_CENTRE = 1e-12, 4e-16  # what a radius is changed by, relative, and of the centre, at most 1
_ROOM = 1.5  # times how far discs of samples reach beyond the property, for r


def scattering_of(problem: MixedProblem, *, inside: bool) -> tuple[MixedProblem, str]:
    """Return the problem of S, and in words what S is; its discs in those of the samples if `inside`, else around them.

    So a system S that keeps the first is one F that is consistent, and every consistent F is an S that keeps the others.
    InputError where there are modes beside the class, or several ports.
    """
    prior = problem.prior
    if not isinstance(prior, PositiveReal) or problem.entries.shape != (1, 1):
        raise InputError(NOT_YET.format("it has several ports"))
    if problem.functions:
        raise InputError(NOT_YET.format("its passive class has modes beside it"))
    imaginary = prior.passive == "negative imaginary"
    shift = Fraction(prior.slack)
    rows = [row for item in problem.frequency for row in _rows(item, imaginary)]
    size = float(np.median([abs(complex(float(a), float(b))) for _, a, b, _ in rows]))
    beyond = max((float(e - a - shift) for _, a, _, e in rows), default=0.0)
    r = Fraction(max(size, _ROOM * beyond))
    omega, values, bounds = (np.empty(len(rows), kind) for kind in (float, complex, float))
    for k, (w, a, b, e) in enumerate(rows):
        c, d = a + shift + r, b
        square = c * c + d * d - e * e  # above 0, since c is above e
        omega[k], values[k] = w, complex(float(1 - 2 * r * c / square), float(2 * r * d / square))
        change = _ROUNDED * (-1 if inside else 1)
        bounds[k] = float(2 * r * e / square) * (1 + change) + (-_OF_CENTRE if inside else _OF_CENTRE)
        if not bounds[k] > 0:
            raise InputError(NOT_YET.format("the bounds of its samples are below the rounding of doubles"))
    plant = "s F" if imaginary else "F"
    words = f"S = (G - r)/(G + r), G = {plant} + {prior.slack!r}, r = {float(r)!r}, F in the unit of the data"
    return _posed(problem, omega, values, bounds), words


def _rows(item: FrequencyResponse, imaginary: bool) -> list[tuple[float, Fraction, Fraction, Fraction]]:
    """Frequency, real and imaginary part and bound of every line, exactly; of s F in the place of F if `imaginary`."""
    used = item.bound.used[:, 0, 0]
    found: list[tuple[float, Fraction, Fraction, Fraction]] = []
    radius = item.bound.outer_radius[used, 0, 0].tolist()
    for w, y, e in zip(item.omega[used].tolist(), item.values[used, 0, 0].tolist(), radius, strict=True):
        a, b, factor = Fraction(y.real), Fraction(y.imag), Fraction(w) if imaginary else Fraction(1)
        found.append((w, *((-factor * b, factor * a) if imaginary else (a, b)), factor * Fraction(e)))
    return found


def _posed(problem: MixedProblem, omega: Real, values: Complex, bounds: Real) -> MixedProblem:
    prior, dt = problem.prior, problem.dt or None
    order = np.argsort(omega, kind="stable")
    frf = FrequencyResponse(omega[order], values[order], bound=bounds[order], dt=dt)
    own = Prior(gain_bound=1.0, decay=prior.decay) if dt is None else Prior(gain_bound=1.0, decay_rate=prior.decay_rate)
    return MixedProblem(frequency=frf, prior=own)
