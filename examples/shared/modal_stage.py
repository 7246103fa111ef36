"""A simulated 13x4 positioning stage: three rigid-body and 17 flexible modes, positions in µm over currents in A.

A plate that floats, seen out of plane: four voice coils, thirteen position sensors. Everything is modal: the shapes of a free
plate at the coils and at the sensors, real with proportional damping, complex with general damping. The example and the benchmark
`modal_stage.py` fit it.
"""

from typing import NamedTuple

import numpy as np

import robustid as rid

MASS, SIDES = 12.0, np.array([0.62, 0.5])  # kg, m: evenly filled
MOTOR = 27.0  # N/A
COILS = np.array([[-0.24, -0.19], [0.26, -0.17], [0.21, 0.2], [-0.25, 0.18]])  # m from the centre
RING = [
    (-0.29, -0.23),
    (0.29, -0.22),
    (0.28, 0.23),
    (-0.29, 0.22),
    (0.02, -0.23),
    (0.03, 0.23),
    (-0.29, 0.01),
    (0.29, 0.02),
]
INSIDE = [(0.05, 0.04), (-0.13, -0.09), (0.15, -0.08), (0.12, 0.12), (-0.15, 0.1)]
SENSORS = np.array(RING + INSIDE)
MODES, FIRST_HZ = 17, 95.0
RELATIVE, FLOOR = 0.01, 0.02  # noise: part of every entry, µm/A


class Stage(NamedTuple):
    """Poles and shapes: ``sum c b'/(s^2 + 2 zeta omega s + omega^2)`` over the modes, rigid ones first; µm, A."""

    frequency: np.ndarray  # (20,) rad/s
    damping: np.ndarray
    shapes: np.ndarray  # (13, 20) at the sensors, complex with general damping
    drives: np.ndarray  # (20, 4) at the coils

    @property
    def order(self):
        return 2 * self.frequency.size

    def response(self, omega):
        """P(j omega), (F, 13, 4)."""
        s = 1j * omega[:, None]
        p = self.frequency[3:] * (-self.damping[3:] + 1j * np.sqrt(1 - self.damping[3:] ** 2))
        R = self.shapes.T[3:, :, None] * self.drives[3:, None, :] / (2j * p.imag)[:, None, None]
        rigid = (self.shapes[:, :3] @ self.drives[:3]).real
        flexible = np.tensordot(1 / (s - p), R, 1) + np.tensordot(1 / (s - p.conj()), R.conj(), 1)
        return flexible + rigid / s[:, :, None] ** 2


def shapes_at(points, numbers):
    """Deflection (points, 20) per sqrt(kg) of three rigid modes and bending with these numbers of half waves."""
    waves = np.pi * numbers / SIDES
    bending = 2 * np.prod(np.cos(waves * (points[:, None] + SIDES / 2)), axis=2)
    gyration = SIDES / np.sqrt(12)
    return np.column_stack([np.ones(len(points)), points / gyration, bending]) / np.sqrt(MASS)


def stage(*, general=False, seed=0):
    """The plant; with general damping its shapes are complex (dashpots between the modes turn their phases)."""
    rng = np.random.default_rng(seed)
    pairs = np.array([(p, q) for p in range(8) for q in range(8) if p + q > 1], dtype=float)
    stiffness = np.sum((pairs / SIDES) ** 2, axis=1)
    chosen = np.argsort(stiffness, kind="stable")[:MODES]
    frequency = 2 * np.pi * FIRST_HZ * stiffness[chosen] / stiffness[chosen[0]]
    # Holes, cables and mirrors: every mode is off by some per cent, and no node is where it should be.
    frequency = frequency * rng.uniform(0.96, 1.04, MODES)
    damping = np.exp(rng.uniform(np.log(0.003), np.log(0.02), MODES))
    look, drive = shapes_at(SENSORS, pairs[chosen]), shapes_at(COILS, pairs[chosen])
    look[:, 3:] += 0.05 * rng.standard_normal(look[:, 3:].shape)
    drive[:, 3:] += 0.05 * rng.standard_normal(drive[:, 3:].shape)
    if general:
        look, drive = look + 0j, drive + 0j
        look[:, 3:] *= np.exp(0.3j * rng.standard_normal((len(look), MODES)))
        drive[:, 3:] *= np.exp(0.3j * rng.standard_normal((len(drive), MODES)))
    none = np.zeros(3)
    return Stage(np.append(none, frequency), np.append(none, damping), 1e6 * look, (MOTOR * drive).T)


def measured(plant, seed, *, low=40, high=260):
    """The response from 5 to 1100 Hz with noise, and the weight of one over its standard deviation."""
    hz = np.concatenate([np.geomspace(5, 80, low, endpoint=False), np.linspace(80, 1100, high)])
    omega = 2 * np.pi * hz
    truth = plant.response(omega)
    sigma = RELATIVE * np.abs(truth) + FLOOR
    noise = np.random.default_rng([seed, 1]).standard_normal((2, *truth.shape)) / np.sqrt(2)
    return rid.FrequencyResponse(omega, truth + sigma * (noise[0] + 1j * noise[1])), rid.fits.Weight(1 / sigma)


def between(omega):
    """Frequencies that were not measured: between those that were."""
    return np.sqrt(omega[1:] * omega[:-1])


def relative_error(response, truth):
    """Root mean square over frequency of the error relative to the truth, both in the norm of Frobenius."""
    ratio = np.linalg.norm(response - truth, axis=(1, 2)) / np.linalg.norm(truth, axis=(1, 2))
    return float(np.sqrt(np.mean(ratio**2)))
