"""Processes: one to three real poles, side by side or in series, behind a dead time; their records, and responses beside them."""

import dataclasses

import numpy as np
import scipy.signal

import robustid as rid

CONSTANTS, DEAD = (8.0, 80.0), 6  # samples
NOISE = (0.01, 0.05)


@dataclasses.dataclass(frozen=True)
class Process:
    """Lags (1 - p)/(z - p) of time constants in samples, with gains or in series, and a dead time in samples."""

    constants: np.ndarray
    gains: np.ndarray
    series: bool
    dead: int
    omega: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0))  # of modes, which it has not
    damping: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0))

    @property
    def poles(self) -> np.ndarray:
        return np.exp(-1 / self.constants)

    def response(self, omega: np.ndarray) -> np.ndarray:
        z = np.exp(1j * np.asarray(omega))
        lags = (1 - self.poles) / (z[:, None] - self.poles)
        return (np.prod(lags, axis=1) if self.series else lags @ self.gains) * z**-self.dead

    def output(self, u: np.ndarray) -> np.ndarray:
        def lagged(x, pole):
            return scipy.signal.lfilter([0, 1 - pole], [1, -pole], x)

        late = np.concatenate([np.zeros(self.dead), u[: u.size - self.dead]])
        if not self.series:
            return np.sum([g * lagged(late, p) for g, p in zip(self.gains, self.poles, strict=True)], axis=0)
        for pole in self.poles:
            late = lagged(late, pole)
        return late


def process_of(seed: int) -> tuple[Process, rid.TimeRecord]:
    """A random process and a record of 10 to 40 of its longest time constants, cut out of a longer one."""
    rng = np.random.default_rng([seed, 99])
    count = rng.integers(1, 4)
    constants = np.sort(np.exp(rng.uniform(*np.log(CONSTANTS), count)))[::-1]
    gains = np.concatenate([[1.0], rng.uniform(0.3, 1, count - 1) * rng.choice([-1, 1], count - 1)])
    plant = Process(constants, gains, bool(rng.random() < 0.5), int(rng.integers(0, DEAD)))
    samples, before = max(int(constants[0] * np.exp(rng.uniform(*np.log([10, 40])))), 300), int(5 * constants[0])
    hold = max(int(constants[0] * rng.uniform(0.1, 1)), 1)
    size = (samples + before) // hold + 1
    levels = rng.choice([-1.0, 1.0], size) if seed % 2 else rng.standard_normal(size)
    u = np.repeat(levels, hold)[: samples + before]
    y = plant.output(u)[before:]
    y = y + np.exp(rng.uniform(*np.log(NOISE))) * y.std() * rng.standard_normal(samples)
    return plant, rid.TimeRecord(u[before:] + 5, y + 3, dt=1.0, initial="free")


def beside(seed: int) -> tuple[Process, rid.FrequencyResponse]:
    """A random process, and the response of one beside it: smoothly, 0.2 to 0.8 of bounds of 0.03 to 3 % away."""
    rng = np.random.default_rng([seed, 555])
    count = int(rng.integers(1, 4))
    constants = np.sort(np.exp(rng.uniform(*np.log(CONSTANTS), count)))[::-1]
    gains = np.concatenate([[1.0], rng.uniform(0.3, 1, count - 1) * rng.choice([-1, 1], count - 1)])
    plant = Process(constants, gains, bool(rng.random() < 0.5), int(rng.integers(0, 11)))
    lines, top = int(rng.integers(20, 80)), 2 * np.pi * np.exp(rng.uniform(*np.log([0.03, 0.3])))
    omega = np.linspace(top / lines, top, lines)
    values = plant.response(omega)
    bound = np.full(lines, np.abs(values).max() * np.exp(rng.uniform(*np.log([3e-4, 0.03]))))
    slower, larger, part = rng.standard_normal(count), rng.standard_normal(count), rng.uniform(0.2, 0.8)

    def moved(size: float) -> np.ndarray:
        changed = {"constants": constants * np.exp(size * slower), "gains": gains * (1 + size * larger)}
        return dataclasses.replace(plant, **changed).response(omega)

    low, high = 0.0, 0.5
    for _ in range(40):
        size = (low + high) / 2
        low, high = (size, high) if np.max(np.abs(moved(size) - values) / bound) < part else (low, size)
    noise = 0.1 * bound * np.exp(2j * np.pi * rng.random(lines))
    return plant, rid.FrequencyResponse(omega, moved(low) + noise, bound=bound, dt=1.0)
