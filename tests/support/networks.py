"""Passive networks whose responses are known: ladders, Foster sections, random lossy networks and their scattering."""

import control
import numpy as np


def rc_ladder(sections, series=1.0):
    """Impedance of a resistor before a chain of grounded unit capacitors with unit resistors between them."""
    A = np.diag(np.append(-2.0 * np.ones(sections - 1), -1.0)) + np.diag(np.ones(sections - 1), 1)
    A = A + np.diag(np.ones(sections - 1), -1)
    A[0, 0] = -1.0 if sections > 1 else 0.0
    A[-1, -1] -= 1.0  # a load
    start = np.eye(sections)[:, :1]
    return control.StateSpace(A, start, start.T, [[series]], 0)


def foster(rng, modes, ports, *, damping=1e-2, resistance=0.0, velocity=True):
    """Sum of modes r r' s/(s^2 + 2 d w s + w^2), or of r r'/(...) where not `velocity`, and a resistance at every port."""
    omega = np.geomspace(1.0, 100.0, modes) * rng.uniform(0.9, 1.1, modes)
    A, B = np.zeros((2 * modes, 2 * modes)), np.zeros((2 * modes, ports))
    for k, w in enumerate(omega):
        A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[0, 1], [-(w**2), -2 * damping * w]]
        B[2 * k + 1] = rng.standard_normal(ports)
    C = np.roll(B, 0 if velocity else -1, axis=0).T
    return control.StateSpace(A, B, C, resistance * np.eye(ports), 0)


def scattering(impedance, reference=1.0):
    """(Z - R)(Z + R)^{-1}."""
    Z, eye = impedance, np.eye(impedance.noutputs)
    inverse = np.linalg.inv(Z.D / reference + eye)
    root = np.sqrt(2 / reference)
    return control.StateSpace(
        Z.A - Z.B @ inverse @ Z.C / reference,
        root * Z.B @ inverse,
        root * inverse @ Z.C,
        (Z.D / reference - eye) @ inverse,
        0,
    )


def battery(omega):
    """Impedance of a cell in ohm: resistance and inductance of the leads, two depressed arcs, diffusion."""
    s = 1j * np.asarray(omega)
    arcs = 0.01 / (1 + (0.03 * s) ** 0.8) + 0.008 / (1 + (0.0005 * s) ** 0.85)
    return 0.015 + 2e-7 * s + arcs + 0.02 * np.tanh(np.sqrt(150 * s)) / np.sqrt(150 * s)
