"""Random cells of a pole-uncertainty box, their modes, and what these are in the functions of the cell."""

import numpy as np
import scipy.linalg

import robustid as rid
from robustid.guarantees import PoleCell


def drawn_cell(rng, width, *, dt=0.01, delay=1, modes=2, shape=()):
    """Of modes in continuous time for dt = 0; ends to `width` of the damping."""
    middle = (2 * np.pi if dt else 1.0) * np.sort(rng.uniform(5, 40, modes))
    damping = rng.uniform(0.005, 0.1, modes)
    spread = width * damping * middle
    ends = np.stack([middle - spread, middle + spread], axis=1), damping[:, None] * np.array([1 - width, 1 + width])
    amplitude = rng.uniform(0.1, 2, (modes, *shape))
    return PoleCell(*ends, amplitude, delay if dt else 0, dt)


def drawn_poles(cell, rng):
    """A pole of every mode inside the cell, often at a corner."""
    t = rng.choice([0.0, 1.0, rng.uniform()], size=(2, len(cell.omega)))
    omega = cell.omega[:, 0] + t[0] * np.ptp(cell.omega, axis=1)
    damping = cell.damping[:, 0] + t[1] * np.ptp(cell.damping, axis=1)
    s = (-damping + 1j * np.sqrt(1 - damping**2)) * omega
    return np.exp(s * cell.dt) if cell.dt else s


def modes_at(cell, omega, c, poles):
    """sum of c/(1 - a z^-1) z^-delay, or of c/(s - a), and of its conjugates."""
    if not cell.dt:
        s = 1j * omega[:, None]
        return (c / (s - poles) + c.conj() / (s - poles.conj())).sum(axis=1)
    z = np.exp(-1j * omega * cell.dt)[:, None]
    return (z**cell.delay * (c / (1 - poles * z) + c.conj() / (1 - poles.conj() * z))).sum(axis=1)


def functions_at(cell, omega):
    """Values of the functions of the cell; of those of s by one solution each."""
    basis = cell.basis()
    if cell.dt:
        return basis.response(omega * cell.dt)
    return np.array(
        [(basis.C @ np.linalg.solve(1j * w * np.eye(basis.states) - basis.A, basis.B))[:, 0] for w in omega]
    )


def impulse_of(cell, c, poles, count):
    k = np.arange(count - cell.delay)
    return np.concatenate([np.zeros(cell.delay), 2 * np.real(c[:, None] * poles[:, None] ** k).sum(axis=0)])


def expansion(cell, c, poles):
    """Coefficients of modes in the functions of the cell.

    Those of c a^k in binom(k, j) a0^k are c ((a - a0)/a0)^j, those of c exp(a t) in t^j/j! exp(a0 t) are c (a - a0)^j.
    """
    p, k = [], np.arange(4) if cell.dt else np.linspace(0, 0.4, 9)
    ways = [1 + 0 * k, k, k * (k - 1) / 2 if cell.dt else k**2 / 2]
    for number, (amplitude, a, a0) in enumerate(zip(c, poles, cell.middle, strict=True)):
        one = rid.kautz(cell.omega[number].mean(), cell.damping[number].mean(), dt=cell.dt, repeat=3, delay=cell.delay)
        if cell.dt:
            values, own, away = one.impulse(cell.delay + 4)[cell.delay :], a0**k, (a - a0) / a0
        else:
            values = np.array([(one.C @ scipy.linalg.expm(one.A * t) @ one.B)[:, 0] for t in k])
            own, away = np.exp(a0 * k), a - a0
        for j in range(3):  # in units of the basis: what its functions are at these times
            plain = ways[j][:, None] * np.stack([own.real, own.imag], axis=1)
            sizes = np.abs(plain).max(axis=0) / np.abs(values[:, 2 * j : 2 * j + 2]).max(axis=0)
            factor = 2 * amplitude * away**j
            p.append(np.array([factor.real, -factor.imag]) * sizes)
    return np.concatenate(p)
