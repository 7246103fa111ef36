"""Random plants, stable or not, with controllers that stabilise them."""

from typing import NamedTuple

import control
import numpy as np
import scipy.linalg

import robustid as rid
from robustid.core import StateMatrices, closed_loop, decay_of, poles_of, response_at


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


class Measured(NamedTuple):
    """A machine that is not stable, measured in the loop: the true plant, what ran, R, and the problem that its lines pose."""

    plant: control.StateSpace
    controller: control.StateSpace
    loop: rid.Loop
    residual: StateMatrices
    problem: rid.MixedProblem

    def maps(self, omega):
        """True S, T, P S and - C S, (F, ny, ny) and so on."""
        at = np.exp(1j * omega * self.plant.dt)
        p, c = (response_at(StateMatrices.of(one), at) for one in (self.plant, self.controller))
        S = np.linalg.inv(np.eye(p.shape[1]) + p @ c)
        return {
            "sensitivity": S,
            "complementary_sensitivity": np.eye(p.shape[1]) - S,
            "process_sensitivity": S @ p,
            "control_sensitivity": -c @ S,
        }


def machine(seed, dt, unstable, flexible):
    """A levitated mass (one unstable pole), an oscillation that grows (two), or both, and flexible modes; sampled."""
    rng = np.random.default_rng([seed, 7])
    parts = []
    if unstable != 2:
        a = rng.uniform(2, 12)
        parts.append(control.tf([rng.uniform(0.5, 1.5) * a**2], [1, rng.uniform(0, 1) * a, -(a**2)]))
    if unstable > 1:
        w, z = rng.uniform(3, 15), rng.uniform(-0.3, -0.02)
        parts.append(control.tf([rng.uniform(0.5, 1.5) * w**2], [1, 2 * z * w, w**2]))
    for _ in range(flexible):
        w, z = rng.uniform(25, 90), rng.uniform(0.03, 0.15)
        parts.append(control.tf([rng.choice([-1, 1]) * rng.uniform(0.02, 0.15) * w**2], [1, 2 * z * w, w**2]))
    whole = control.ss(parts[0])
    for part in parts[1:]:
        whole = whole + control.ss(part)
    return control.c2d(whole, dt)


def regulator(plant):
    """State feedback of an observer, both fast."""
    A, B, C, D = plant

    def gain(A, B, cost):
        X = scipy.linalg.solve_discrete_are(A, B, cost, np.eye(B.shape[1]))
        return np.linalg.solve(np.eye(B.shape[1]) + B.T @ X @ B, B.T @ X @ A)

    F, L = gain(A, B, 100 * C.T @ C), gain(A.T, C.T, 100 * B @ B.T).T
    return StateMatrices(A - B @ F - L @ C + L @ D @ F, L, F, np.zeros((B.shape[1], C.shape[0])))


def measured_machine(seed, *, edge=True, lines=40, bound=0.02, largest=8.0, unstable=None):
    """A machine with one to three unstable poles under a regulator, and lines of its R, whose class is exactly as large as R.

    Errors are exactly as large as the bound, at `edge`; else anywhere inside. Of machines whose loops have a peak of S above the
    largest one (no engineer would run them) the next one is taken.
    """
    dt, tries = 0.01, 0
    while True:
        rng = np.random.default_rng([seed, tries, 11])
        count = 1 + seed % 3 if unstable is None else unstable
        plant = machine(1000 * seed + tries, dt, count, 1 + seed % 2)
        own = StateMatrices.of(plant)
        tries += 1
        try:
            running = regulator(own)
        except np.linalg.LinAlgError:  # unstable poles that almost cancel
            continue
        wanted = decay_of(poles_of(closed_loop(own, running).A), dt)
        grid = np.exp(1j * np.linspace(0, np.pi, 2000))
        peak = np.abs(1 / (1 + response_at(own, grid) * response_at(running, grid))).max()
        if wanted <= 0.2 or peak > largest:
            continue
        for size in 0.03 * 0.5 ** np.arange(14):
            auxiliary = StateMatrices(*(part * (1 + size * rng.standard_normal(part.shape)) for part in own))
            if decay_of(poles_of(closed_loop(auxiliary, running).A), dt) > 0.25 * wanted:
                break
        else:
            continue
        controller = control.ss(*running, dt)
        loop = rid.Loop(controller, control.ss(*auxiliary, dt))
        residual = StateMatrices.of(loop.residual_of(plant))
        rho = np.abs(poles_of(residual.A)).max() ** -0.5
        gain = np.abs(response_at(residual, np.exp(1j * np.linspace(0, np.pi, 20000)) / rho)).max() * (1 + 1e-6)
        omega = np.linspace(2, np.pi / dt - 1, lines)
        values = response_at(residual, np.exp(1j * omega * dt))
        radius = bound * np.abs(values).max()
        share = (1 - 1e-9) if edge else 0.9 * np.sqrt(rng.uniform(size=values.shape))
        error = radius * share * np.exp(2j * np.pi * rng.uniform(size=values.shape))
        frf = rid.FrequencyResponse(omega, values + error, bound=radius, dt=dt)
        problem = rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=gain, decay_rate=rho))
        return Measured(plant, controller, loop, residual, problem)
