"""What the tests of weights and margins share: models, bounds, and their largest values."""

import itertools

import control
import numpy as np


def pair(angle, damping):
    pole = np.exp((-damping + 1j * np.sqrt(1 - damping**2)) * angle)
    return [pole, pole.conj()]


def biquad(zeros, poles):
    """Its magnitude as a function of the angle."""
    return lambda theta: np.abs(np.polyval(np.poly(zeros), z := np.exp(1j * theta)) / np.polyval(np.poly(poles), z))


def largest_on(function, edges, count=400):
    return np.array([function(np.linspace(a, b, count)).max() for a, b in itertools.pairwise(edges)])


def modulus(weight, omega):
    return np.abs(values_of(weight.model, omega)[:, 0, 0])


def check_densely(weight, count=100_000):
    """Against the bound of the cells, at the edges too; stable and minimum-phase."""
    W = weight.model
    inside = np.concatenate([W.poles(), np.linalg.eigvals(W.A - W.B @ W.C / W.D)]) if W.nstates else np.zeros(1)
    assert np.abs(inside).max() < 1
    edges = weight.edges
    low = max(edges[0], edges[1] * 1e-3)
    half = count // 2
    omega = np.concatenate([np.linspace(edges[0], edges[-1], half), np.geomspace(low, edges[-1], half), edges])
    omega = np.clip(omega, edges[0], edges[-1])
    right = np.clip(np.searchsorted(edges, omega, side="right") - 1, 0, weight.bound.size - 1)
    left = np.clip(np.searchsorted(edges, omega, side="left") - 1, 0, weight.bound.size - 1)
    ratio = modulus(weight, omega) / weight.bound[[left, right]]
    assert ratio.min() >= 1 - 1e-9
    assert ratio.max() <= weight.ratio * (1 + 1e-9)
    assert weight.certified
    return ratio


def random_model(rng, ny, nu, states=4, radius=0.9):
    A = rng.normal(size=(states, states))
    A *= radius / np.abs(np.linalg.eigvals(A)).max()
    return control.ss(A, rng.normal(size=(states, nu)), rng.normal(size=(ny, states)), rng.normal(size=(ny, nu)), 0.1)


def values_of(model, omega):
    """(F, ny, nu), by solving with the state space: along no formula of the library."""
    z = np.exp(1j * omega * model.dt)
    if not model.nstates:
        return np.tile(model.D.astype(complex), (z.size, 1, 1))
    x = np.linalg.solve(z[:, None, None] * np.eye(model.nstates) - model.A, np.tile(model.B, (z.size, 1, 1)))
    return model.C @ x + model.D


def mode(damping=0.02, gain=1.0):
    return control.ss(control.tf([0.1 * gain, 0.1 * gain], np.real(np.poly(pair(0.6, damping))), 0.1))
