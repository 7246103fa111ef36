"""MIMO plants of few modes, and their frequency responses with bounded errors."""

import control
import numpy as np
import pytest

import robustid as rid
from robustid.core import responses
from robustid.identification import largest_ratio

DT = 0.01
HZ = np.array([4.0, 9.0, 17.0])


def plant(rng, modes, outputs=2, inputs=2):
    """Modes of rank one, 1 to 5 % damped."""
    omega, damping = 2 * np.pi * HZ[:modes], rng.uniform(0.01, 0.05, modes)
    poles = np.exp((-damping + 1j * np.sqrt(1 - damping**2)) * omega * DT)
    A = np.kron(np.diag(poles.real), np.eye(2)) + np.kron(np.diag(poles.imag), [[0, -1], [1, 0]])
    gain = np.repeat(1 - np.abs(poles), 2)
    B = gain[:, None] * rng.standard_normal((2 * modes, inputs))
    C = rng.standard_normal((outputs, 2 * modes))
    return control.ss(A, B, C, 0, DT), rid.kautz(omega, damping, dt=DT, delay=1)


def lines(rng, truth, bound=0.05, count=30):
    omega = 2 * np.pi * np.linspace(1, 22, count)
    exact = responses(truth, omega * DT)
    noise = rng.uniform(-1, 1, (2, *exact.shape)) * bound / np.sqrt(2)
    return rid.FrequencyResponse(omega, exact + noise[0] + 1j * noise[1], bound=bound, dt=DT)


def measured(seed=0, **options):
    """A plant of two modes, its basis and its response."""
    rng = np.random.default_rng(seed)
    truth, basis = plant(rng, 2)
    return truth, basis, lines(rng, truth, **options)


def damping_of(model):
    """Damping ratios of the pairs, by frequency."""
    poles = np.log(model.poles()[model.poles().imag > 0])
    return (-poles.real / np.abs(poles))[np.argsort(np.abs(poles))]


def keeps(problem, small, order):
    """A small model, judged from its numbers: its order, every sample, stable poles."""
    assert small.order == small.model.nstates <= order
    assert small.margin == pytest.approx(largest_ratio(problem, small.model), rel=1e-9)
    assert small.margin <= 1
    poles = small.model.poles()
    assert np.all((np.abs(poles) < 1) | (poles == 1))


def found_at(problem, truth, order, **options):
    """The small model of a problem that its truth keeps to, at most of this order."""
    assert largest_ratio(problem, truth) <= 1
    small = rid.reduce_within_bounds(rid.identify(problem), **options)
    keeps(problem, small, order)
    return small
