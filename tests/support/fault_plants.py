"""Plants of the catalogue of faults, with clean measurements of each: periodic, random, a step from rest, and a response.

Four are simulated: a stage (one light mode), an arm (three), a heater (two real poles and a delay), a matrix (2x2, three modes).
Two are measured: the motor bench and the mirror. Short records are of a plant of their own each.
"""

import dataclasses
import functools
from collections.abc import Callable

import control
import numpy as np
from scipy.linalg import block_diag

import robustid as rid
from robustid.core import simulate

PERIODS = 6
SIMULATED = ("stage", "arm", "heater", "matrix")
MEASURED = ("motor", "mirror")


@dataclasses.dataclass(frozen=True)
class Clean:
    """Measurements without a fault; what is not at hand is empty.

    Attributes
    ----------
    plant : StateSpace or None
        Of a simulated one.
    noise : float
        Standard deviation of what is added to the outputs.
    """

    name: str
    period: int
    noise: float
    periodic: tuple[rid.TimeRecord, ...]
    random: tuple[rid.TimeRecord, ...] = ()
    step: rid.TimeRecord | None = None
    response: rid.FrequencyResponse | None = None
    plant: control.StateSpace | None = None

    @property
    def dt(self):
        return self.periodic[0].dt


@dataclasses.dataclass(frozen=True)
class Recipe:
    """Plant, its period in samples, the band in Hz that is excited, and the noise in part of the rms of the output.

    `faster` gives the plant of which all poles lie so many times as far from 0.
    """

    faster: Callable[[float], control.StateSpace]
    period: int
    band_hz: tuple[float, float]
    noise: float = 0.01

    @functools.cached_property
    def plant(self):
        return self.faster(1.0)


def modal(modes, inputs, outputs, dt, faster):
    """Modes (Hz, damping) behind a zero-order hold, with input gains (modes, nu) and output gains (modes, ny)."""
    parts = []
    modes = [(faster * hz, damping) for hz, damping in modes]
    for hz, damping in modes:
        w = 2 * np.pi * hz
        parts.append(np.array([[0.0, w], [-w, -2 * damping * w]]))
    inputs, outputs = (np.asarray(gains, float) for gains in (inputs, outputs))
    B = np.vstack([np.stack([0 * row, 2 * np.pi * hz * row]) for row, (hz, _) in zip(inputs, modes, strict=True)])
    C = np.hstack([np.stack([row, 0 * row], axis=1) for row in outputs])
    return control.c2d(control.ss(block_diag(*parts), B, C, 0), dt, "zoh")


def _heater(faster, dt=1.0, delay=4):
    rates = faster * np.array([1 / 60.0, 1 / 15.0])
    A, B, C = np.diag(-rates), rates[:, None], np.array([[1.6, -0.3]])
    plant = control.c2d(control.ss(A, B, C, 0), dt, "zoh")
    late = control.ss(np.eye(delay, k=-1), np.eye(delay, 1), np.eye(1, delay, k=delay - 1), 0, dt)
    return plant * late


@functools.cache
def recipes():
    one = [[1.0]]
    stage = [(17.67, 0.01), (140.0, 0.05)], one * 2, [[1.0], [0.3]], 2e-3
    arm = [(12.3, 0.008), (29.1, 0.01), (61.0, 0.012)], one * 3, [[1.0], [0.5], [-0.3]], 4e-3
    inputs, outputs = [[1, 0.3], [0.5, -1], [0.4, 0.6]], [[1, 0.4], [-0.3, 0.8], [0.5, 0.5]]
    matrix = [(9.2, 0.01), (22.0, 0.012), (41.0, 0.01)], inputs, outputs, 5e-3
    return {
        "stage": Recipe(functools.partial(modal, *stage), 1000, (1, 100)),
        "arm": Recipe(functools.partial(modal, *arm), 1000, (1, 90)),
        "heater": Recipe(_heater, 600, (1 / 600, 0.1)),
        "matrix": Recipe(functools.partial(modal, *matrix), 800, (1, 70)),
    }


def answer(plant, u):
    """Outputs (T, ny) from rest."""
    return simulate(plant, u)[0]


def excited(recipe, rng, *, periodic, samples):
    """Inputs (T, nu): a multisine of the band, or noise of it, of random phases."""
    dt, nu = recipe.plant.dt, recipe.plant.ninputs
    signals = []
    for _ in range(nu):
        size = recipe.period if periodic else samples
        spectrum = np.zeros(size // 2 + 1, complex)
        hz = np.arange(spectrum.size) / (size * dt)
        inside = (hz >= recipe.band_hz[0] - 1e-9) & (hz <= recipe.band_hz[1])
        phases = np.exp(2j * np.pi * rng.random(inside.sum()))
        spectrum[inside] = phases if periodic else phases * rng.rayleigh(size=inside.sum())
        one = np.fft.irfft(spectrum, size)
        signals.append(np.tile(one / one.std(), -(-samples // size))[:samples])
    return np.stack(signals, axis=1)


def record(recipe, rng, *, kind="periodic", periods=PERIODS, settled=True, plant=None):
    """One record of a simulated plant, with noise; a periodic one in steady state."""
    plant, before = plant or recipe.plant, 4 * recipe.period if settled else 0
    samples = periods * recipe.period
    u = excited(recipe, rng, periodic=kind == "periodic", samples=before + samples)
    y = answer(plant, u)[before:]
    y = y + recipe.noise * y.std(axis=0) * rng.standard_normal(y.shape)
    return rid.TimeRecord(u[before:], y, dt=plant.dt, initial="periodic" if kind == "periodic" and settled else "free")


def records(recipe, rng, *, kind="periodic", count=None, **options):
    """Independent records: as many as there are inputs, or two."""
    count = count or max(2, recipe.plant.ninputs)
    return tuple(record(recipe, rng, kind=kind, **options) for _ in range(count))


def step(recipe, rng, *, plant=None, samples=60):
    """Answer to a step of the first input from rest, every sample with its bound."""
    plant = plant or recipe.plant
    u = np.zeros((samples, plant.ninputs))
    u[2:, 0] = 1.0
    y = answer(plant, u)
    bound = np.broadcast_to(0.01 * np.abs(y).max(axis=0), y.shape)
    return rid.TimeRecord(u, y + bound * rng.uniform(-0.5, 0.5, y.shape), dt=plant.dt, bound=bound, initial="rest")


def simulated(name, seed=0):
    """Clean measurements of a simulated plant."""
    return _simulated(name, seed)


@functools.lru_cache(maxsize=16)  # frozen, and half a second each
def _simulated(name, seed):
    recipe, rng = recipes()[name], np.random.default_rng([seed, *map(ord, name)])
    periodic = records(recipe, rng)
    response = rid.estimate_frf(periodic, period=recipe.period)
    noise = recipe.noise * float(periodic[0].y.std(axis=0).min())
    return Clean(
        name, recipe.period, noise, periodic, records(recipe, rng, kind="random"), step(recipe, rng), response, recipe.plant
    )  # fmt: skip


@functools.lru_cache(maxsize=16)
def short(seed):
    """A clean short record of one or two well damped modes from rest, moved by noise, a chirp or a step, and its response."""
    rng = np.random.default_rng([seed, *map(ord, "short")])
    samples, count = int(rng.integers(100, 251)), int(rng.integers(1, 3))
    modes = list(zip(np.exp(rng.uniform(*np.log([0.02, 0.3]), count)), rng.uniform(0.03, 0.3, count), strict=True))
    plant = modal(
        modes, np.ones((count, 1)), rng.choice([-1.0, 1.0], (count, 1)) * rng.uniform(0.3, 1, (count, 1)), 1.0, 1.0
    )
    time, moved = np.arange(samples), ("noise", "chirp", "step")[seed % 3]
    u = {
        "noise": rng.standard_normal(samples),
        "chirp": np.sin(2 * np.pi * (0.01 * time + 0.22 * time**2 / samples)),
        "step": (time >= rng.integers(2, samples // 5)).astype(float),
    }[moved]
    y = answer(plant, u[:, None])
    noise = float(np.exp(rng.uniform(*np.log([0.003, 0.05]))) * y.std())
    found = rid.TimeRecord(u, y + noise * rng.standard_normal(y.shape), dt=plant.dt, initial="rest")
    response = None if moved == "step" else rid.estimate_frf(found)
    return Clean(f"short, {moved}", 0, noise, (), (found,), response=response, plant=plant)


def measured(name):
    """Clean measurements of a measured plant: periodic records and their response."""
    if name == "motor":
        period, bench = 2500, rid.datasets.load("two_mass")
        part = slice(2500, 17500)  # the first period is a transient; the torsion is the sum of both angles
        found = [rid.TimeRecord(bench.u[part], bench.y[part].sum(axis=1), dt=bench.dt, initial="periodic")]
    else:
        period, found = 8192, rid.datasets.load("fsm")
    response = rid.estimate_frf(found, period=period)
    response = response.band(11, 250) if name == "motor" else response.band(500, 1700)
    cut = found[0].y.reshape(-1, period, found[0].y.shape[1])
    return Clean(name, period, float(cut.std(axis=0, ddof=1).mean()), tuple(found), response=response)
