"""Shared by the tests: small families of plants whose truth is known."""

import numpy as np

import robustid as rid

DT = 0.1
LINES = np.array([2.0, 8.0, 14.0, 20.0, 26.0])


def truth(gain, omega, pole=0.2):
    """gain (0.4 + 0.3 z^-1)/(1 - pole z^-1)."""
    z = np.exp(-1j * np.asarray(omega) * DT)
    return gain * (0.4 + 0.3 * z) / (1 - pole * z)


def measured(gain, *, pole=0.2, bound=0.02, dt=DT, outputs=None, seed=0):
    """Its response at a few lines, with errors inside the bound."""
    error = 0.9 * bound * np.exp(2j * np.pi * np.random.default_rng(seed).uniform(0, 1, LINES.size))
    return rid.FrequencyResponse(LINES, truth(gain, LINES, pole) + error, bound=bound, dt=dt, outputs=outputs)


def identified(gain, *, gain_bound=3.0, decay_rate=2.0, parametric=None, **options):
    """A member in the class of the others."""
    prior = rid.Prior(gain_bound=gain_bound, decay_rate=decay_rate)
    frf = measured(gain, **options)
    return rid.identify(rid.MixedProblem(frequency=frf, prior=prior, parametric=parametric))
