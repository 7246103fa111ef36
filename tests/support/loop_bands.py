"""Judges of loops of two bands: bands of any size about models, their members, and the values of discs."""

import control
import numpy as np

from robustid.core import StateMatrices, points_of, response_at
from robustid.guarantees import CircleBound
from robustid.guarantees.over_cells import AroundModel


class Around(AroundModel):
    """Everything within bounds of the entries about a model, on arcs: a band without data."""

    relative = None

    def __init__(self, model, edges, entries):
        self.model, self.edges, self.entries = model, np.asarray(edges, float), np.asarray(entries, float)

    @property
    def circle(self):
        norms = np.linalg.norm(self.entries, 2, axis=(1, 2))
        return CircleBound(self.edges, norms, 0.0, True, (), self.entries)

    def verify(self, exact=False):
        return True


def stable_model(rng, ny, nu, dt, gain):
    """A random stable model, its largest gain on a grid as asked."""
    states = int(rng.integers(1, 4))
    if dt:
        poles = rng.uniform(0.2, 0.9, states) * rng.choice([-1, 1], states)
    else:
        poles = -rng.uniform(0.3, 5.0, states)
    parts = rng.normal(size=(states, nu)), rng.normal(size=(ny, states)), rng.normal(size=(ny, nu))
    model = control.ss(np.diag(poles), *parts, dt)
    return model * (gain / np.linalg.norm(values(model, grid(dt)), 2, axis=(1, 2)).max())


def grid(dt, count=400):
    return np.linspace(0, np.pi / dt, count) if dt else np.append(0, np.geomspace(1e-2, 1e3, count))


def values(model, omega):
    return response_at(StateMatrices.of(model), points_of(omega, model.dt))


def all_pass(rng, dt):
    """A stable function of modulus 1 everywhere: a constant sign, or one with a pole or two."""
    found = control.ss([], [], [], rng.choice([-1.0, 1.0]), dt)
    for _ in range(rng.integers(0, 3)):
        if dt:
            a = rng.uniform(-0.95, 0.95)
            found = found * control.ss(control.tf([-a, 1], [1, -a], dt))
        else:
            a = 10 ** rng.uniform(-1, 1)
            found = found * control.ss(control.tf([1, -a], [1, a]))
    return found


def edge_member(rng, band, part):
    """The model, each entry with an error of `part` times the smallest bound of the arcs, everywhere."""
    ny, nu = band.entries.shape[1:]
    rows = [[all_pass(rng, band.model.dt) * (part * band.entries[:, i, j].min()) for j in range(nu)] for i in range(ny)]
    return band.model + joined(rows, band.model.dt)


def joined(rows, dt):
    """A matrix of systems of one entry each."""
    whole = None
    for i, row in enumerate(rows):
        for j, one in enumerate(row):
            left, right = np.eye(len(rows))[:, [i]], np.eye(len(row))[[j]]
            part = control.ss(one.A, one.B @ right, left @ one.C, left @ one.D @ right, dt)
            whole = part if whole is None else whole + part
    return whole


def unstable_poles(source, load):
    """Their number, by python-control."""
    poles = control.feedback(source, load).poles()
    return int(np.sum(np.abs(poles) >= 1) if source.dt else np.sum(poles.real >= 0))


def loop_is_stable(source, load):
    return not unstable_poles(source, load)


def with_phase(target, point, dt):
    """A stable function of modulus 1 everywhere whose value at a point of the axis has the phase of a number."""
    wanted = target / abs(target)
    roots = np.tanh(np.linspace(-14, 14, 400_001)) if dt else np.exp(np.linspace(-14, 14, 400_001)) * abs(point)
    found = (1 - roots * point) / (point - roots) if dt else (point - roots) / (point + roots)
    sign = np.where(np.real(found * np.conj(wanted)) > 0, 1, -1)
    best = np.argmin(np.abs(sign * found - wanted))
    a, s = roots[best], sign[best]
    top, bottom = ([-a * s, s], [1, -a]) if dt else ([s, -a * s], [1, a])
    return control.ss(control.tf(top, bottom, dt))


def loop_of_discs(g, h):
    """K S of K = [0, 1; -1, 0]: I + Delta K S is singular where (g + d)(h + e) = -1."""
    return np.array([[h, 1], [-1, g]]) / (1 + g * h)
