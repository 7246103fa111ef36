"""What the tests of the form in powers of sections share."""

import numpy as np

import robustid as rid
from support.taylor_members import polynomials

CIRCLE = np.exp(2j * np.pi * np.arange(2**13) / 2**13)


def random_member(rng, degree):
    """A Blaschke product with zeros in |zeta| < 0.8 as (P, Q), at times half of one with half of another."""
    radii, turns = 0.8 * np.sqrt(rng.uniform(0, 1, (2, degree // 2))), rng.uniform(0, np.pi, (2, degree // 2))
    first, second = (polynomials(zeros) for zeros in radii * np.exp(1j * turns))
    if rng.uniform() < 0.5:
        return first
    return (np.convolve(first[0], second[1]) + np.convolve(second[0], first[1])) / 2, np.convolve(first[1], second[1])


def coordinates(values, sections):
    """<g, phi_j> of a function with these values on the circle."""
    return (values @ sections.evaluate(CIRCLE * (1 - 1e-16)).conj()).real / CIRCLE.size


def lines(omega, bound=0.01, rho=1.05, gain=1.0):
    frf = rid.FrequencyResponse(omega, np.zeros(np.size(omega)), bound=bound, dt=1.0)
    return rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=gain, decay_rate=rho))
