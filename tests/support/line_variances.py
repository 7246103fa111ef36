"""Chance that bounds of spectral lines fail, exactly, given what the scatter showed; variances of lines as loops make them."""

import functools

import numpy as np

from robustid.core import response_at
from robustid.data import joint_radius
from robustid.estimation.pooling import pool
from support.loop_truths import LINES, PERIOD, in_loop, measured_machine

PLACES = np.linspace(3, PERIOD // 2 - 3, LINES).astype(int)


@functools.cache
def of_loop(seed):
    """Responses (F,) and variances of the lines of a machine in its loop: of R, and of the response from u to y.

    Its noise is white noise behind one pole, as in `recorded`; the excitation is as large at every line.
    """
    case, at = measured_machine(seed), np.exp(2j * np.pi * PLACES / PERIOD)
    colour = 1 / np.abs(at - np.random.default_rng([seed, 22]).uniform(0.5, 0.95)) ** 2
    closed = response_at(in_loop(case), at)  # from [r, v] to [u, y]
    opened = response_at(case.loop.back, at) @ closed
    found = {}
    for name, both in (("R", opened), ("u to y", closed)):
        response = both[:, 1, 0] / both[:, 0, 0]
        error = (both[:, 1, 1] - response * both[:, 0, 1]) / both[:, 0, 0]
        found[name] = response, colour * np.abs(error) ** 2
    return found


def drawn(response, variance, index, periods, rng):
    """Shared variances of a drawn record, relative to the true ones, and their degrees of freedom; lines that were pooled."""
    dof = periods - 1.0
    mean = variance / periods
    error = np.sqrt(mean / 2) * (rng.standard_normal(index.size) + 1j * rng.standard_normal(index.size))
    own = mean * rng.gamma(dof, 1 / dof, index.size)
    shared = pool(own[:, None, None].astype(complex), dof, np.abs(response + error)[:, None], index, None)
    return shared.matrix[:, 0, 0].real / mean, shared.dof, shared.lines


def chance(response, variance, index, periods, rng):
    """Probability that an error is beyond the bound at any of the lines, which is to be .05, given the scatter of one record.

    The errors of the mean do not depend on the scatter, and are normal: ``1 - prod(1 - exp(-bound^2/variance))``.
    """
    part, dof, _ = drawn(response, variance, index, periods, rng)
    return -np.expm1(np.sum(np.log(-np.expm1(-(joint_radius(0.95, index.size, dof) ** 2) * part))))
