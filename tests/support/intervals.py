"""What the tests of intervals share: problems whose coefficients are cut off by intervals, and one with a known truth."""

import dataclasses

import numpy as np
from scipy.signal import lfilter

import robustid as rid
from support.problems import random_problem, small_part

FREE = (-np.inf, np.inf)
KINDS = ("outside", "one side", "fixed", "narrow", "wide", "far")


def intervals(kind, p, rng):
    """Intervals of two coefficients about a point of the consistent set, most of which cut it off."""
    a, b = p + rng.uniform(0.1, 0.6, 2) * rng.choice([-1, 1], 2)
    return {
        "outside": [(a - 0.05, a + 0.05), (b - 0.02, b + 0.08)],
        "one side": [(a, a + 3), FREE],
        "fixed": [(a, a), FREE],
        "narrow": [FREE, (b, b * (1 + 1e-9) if b > 0 else b * (1 - 1e-9))],
        "wide": [(a - 1e6, a + 1e6), (b - 2, b + 2)],
        "far": [(a + 20, a + 21), (b, b)],
    }[kind]


def tight(seed):
    """Bounds and a class that leave the coefficients little room, with few Taylor coefficients."""
    return random_problem(seed, "parametric", 10, spread=0.3, noise=2.0).with_prior(gain_bound=0.5, decay_rate=1.25)


def bounded(problem, kind, seed):
    p = rid.identify(problem).parameters
    return dataclasses.replace(problem, parameter_bounds=intervals(kind, p, np.random.default_rng(seed)))


def inside(result):
    low, high = result.problem.parameter_bounds.T
    return bool(np.all((low <= result.parameters) & (result.parameters <= high)))


def truthful(seed):
    """Data of a member within the bounds, and the coefficients of that member."""
    rng = np.random.default_rng(seed)
    dt, rho = 0.01, 1.2
    basis = rid.kautz(2 * np.pi * rng.uniform(5, 30), 0.02, dt=dt, delay=1)
    numerator, denominator = small_part(rng, 1.0, rho)
    p = 3 * rng.standard_normal(2)
    angle = np.sort(rng.uniform(0.05, 3.0, 4))
    z = np.exp(-1j * angle)
    values = basis.response(angle) @ p + np.polyval(numerator[::-1], z) / np.polyval(denominator[::-1], z)
    error = 0.99 * np.exp(2j * np.pi * rng.uniform(size=4))
    frf = rid.FrequencyResponse(angle / dt, values + 0.02 * error, bound=0.02, dt=dt)
    impulse = basis.impulse(6) @ p + lfilter(numerator, denominator, np.eye(1, 6)[0])
    u = rng.standard_normal(6)
    y = np.convolve(u, impulse)[:6]
    record = rid.TimeRecord(u, y + 0.05 * rng.choice([-0.99, 0.99], 6), bound=0.05, dt=dt)
    prior = rid.Prior(gain_bound=1.0, decay_rate=rho)
    return rid.MixedProblem(frequency=frf, time=record, prior=prior, parametric=basis), p
