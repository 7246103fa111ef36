"""What the tests of the smallest model share: problems of the plant of paper 1."""

import numpy as np

import robustid as rid
from robustid.core import simulate
from support.bounds import rebound

AS_THE_PAPER = {"lines": 11, "samples": 20}


def structure(seed, *, parametric=True, lines=8, samples=10):
    """The plant of paper 1: with its two pairs, or without, where K and rho are so wide that the data are consistent.

    From 26 coefficients for the 42 of the paper (`AS_THE_PAPER`): a fifth of the time.
    """
    data = rid.datasets.flexible_structure(seed=seed, lines=lines, samples=samples)
    basis = rid.kautz(data.modes[:, 0], data.modes[:, 1], dt=0.01, delay=1) if parametric else None
    prior = rid.Prior(gain_bound=0.2, decay_rate=1.1) if parametric else rid.Prior(gain_bound=10, decay_rate=1.015)
    return rid.MixedProblem(frequency=data.frequency, time=data.time, prior=prior, parametric=basis)


def mixed(kind, seed=0, samples=40):
    """Lines with ellipses and a record of the plant of paper 1, from rest, from an unknown state, or in steady state."""
    data, rng = rid.datasets.flexible_structure(seed=1), np.random.default_rng(seed)
    u = np.sign(rng.standard_normal(samples))
    y = simulate(data.truth, np.tile(u, 60)[:, None])[0][-samples:, 0] + 0.02 * rng.uniform(-1, 1, samples)
    if kind == "rest":
        y = simulate(data.truth, u[:, None])[0][:, 0] + 0.02 * rng.uniform(-1, 1, samples)
    bound = np.full(samples, 0.02)
    bound[::7] = np.inf
    record = rid.TimeRecord(u, y, dt=0.01, bound=bound, initial=kind)
    basis = rid.kautz(data.modes[:, 0], data.modes[:, 1], dt=0.01, delay=1)
    frf = rebound(data.frequency, tilt=0.2 * np.exp(1j * np.arange(11)))
    prior = rid.Prior(gain_bound=0.02, decay_rate=1.3)
    return rid.MixedProblem(frequency=frf, time=record, prior=prior, parametric=basis)
