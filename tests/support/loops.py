"""Random plants, stable or not, with controllers that stabilise them."""

import control
import numpy as np
import scipy.linalg

from robustid.core import StateMatrices


def plant_of(rng, order, ny, nu, dt):
    """Poles up to a fifth beyond the circle, or .5 right of the axis."""
    A = rng.standard_normal((order, order))
    A *= 1.2 / np.abs(np.linalg.eigvals(A)).max()
    direct = 0.3 * rng.standard_normal((ny, nu))
    A = A if dt else A - 0.7 * np.eye(order)
    return StateMatrices(A, rng.standard_normal((order, nu)), rng.standard_normal((ny, order)), direct)


def controller_of(plant, dt, *, integrators=False):
    """State feedback of an observer, u = -C y; with an integrator at every input of the plant where it is asked for."""
    A, B, C, D = plant
    nu = B.shape[1]
    if integrators:
        one = np.eye(nu)
        states = np.block([[A, B], [np.zeros((nu, len(A))), one if dt else 0 * one]])
        A, B = states, np.vstack([np.zeros((len(A), nu)), dt * one if dt else one])
        C, D = np.hstack([C, D]), np.zeros((C.shape[0], nu))
    F, L = gain_of(A, B, dt), gain_of(A.T, C.T, dt).T
    inner = StateMatrices(A - B @ F - L @ C + L @ D @ F, L, F, np.zeros((nu, C.shape[0])))
    if not integrators:
        return inner
    E, G, H = inner.A, inner.B, inner.C
    zero = np.zeros((nu, len(E)))
    states = np.block([[E, np.zeros((len(E), nu))], [(dt or 1.0) * H, one if dt else 0 * one]])
    return StateMatrices(states, np.vstack([G, np.zeros((nu, C.shape[0]))]), np.hstack([zero, one]), inner.D)


def gain_of(A, B, dt):
    """State feedback of least cost, A - B F stable."""
    weight = np.eye(B.shape[1])
    if not dt:
        return B.T @ scipy.linalg.solve_continuous_are(A, B, np.eye(len(A)), weight)
    X = scipy.linalg.solve_discrete_are(A, B, np.eye(len(A)), weight)
    return np.linalg.solve(weight + B.T @ X @ B, B.T @ X @ A)


def pair_of(seed, dt, *, order=5, integrators=False, size=None):
    """A plant and a controller, 1x1 to 3x3."""
    rng = np.random.default_rng([seed, bool(dt), integrators])
    ny, nu = rng.integers(1, 4, 2) if size is None else size
    if integrators:  # more of them than outputs could not be seen
        ny, nu = max(ny, nu), min(ny, nu)
    plant = plant_of(rng, order, ny, nu, dt)
    return plant, controller_of(plant, dt, integrators=integrators)


def points(dt, count=7):
    return np.exp(1j * np.linspace(0.1, 3, count)) if dt else 1j * np.geomspace(0.1, 10, count)


def as_model(system, dt):
    return control.ss(*system, dt)
