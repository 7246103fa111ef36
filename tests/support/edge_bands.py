"""Plants at the very edge of the class for every kind of samples: gain exactly K, errors as large as their bounds.

The poles of the mode are those of the problem, or in a corner of their box. Modes are n(x)/(1 - a x) with complex factors, records
convolutions with impulse responses, taken from the values all around the circle.
"""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import numpy as np

import robustid as rid
from support.edge_plants import inner

IN_TIME = "record", "free record", "periodic record", "record of two inputs"
MATRICES = "symmetric", "matrix"
KINDS = ("discrete", "continuous", "roll-off", *IN_TIME, *MATRICES)
DT, SIZE = 0.01, 2**16
CORNER = 300.0  # rad/s, of the class with roll-off
NEARLY = 1 - 1e-9  # an error at its bound, whatever its rounding


@dataclasses.dataclass(frozen=True)
class EdgePlant:
    """A problem, the box of its poles (None: they are exact), its plant at frequencies in rad/s, and the highest one to look at.

    `residue` (ny, nu) is the c of its mode c/(s - p), or c x^delay/(1 - a x), which `mode` is at frequencies. `exact` is the
    problem with the poles of the plant itself, with which it is consistent; `outputs` are what a plant does in the record, without
    noise.
    """

    problem: rid.MixedProblem
    box: tuple[Any, Any] | None
    truth: Callable[[Any], Any]
    top: float
    residue: Any
    exact: rid.MixedProblem
    mode: Callable[[Any], Any]
    outputs: Callable[[Any], Any] | None

    def frequencies(self, rng, count):
        return rng.uniform(0.001 * self.top, self.top, count)


def blaschke(zeros, zeta):
    """Product of the factors of zeros and of their conjugates: of modulus 1 on the circle."""
    found = np.ones_like(zeta)
    for a in zeros:
        found = found * (zeta - a) * (zeta - np.conj(a)) / ((1 - np.conj(a) * zeta) * (1 - a * zeta))
    return found


@functools.lru_cache(maxsize=32)
def edge_plant(kind, seed):
    """The same for the same numbers."""
    rng = np.random.default_rng([KINDS.index(kind), seed])
    ny, nu = (2, 2) if kind in MATRICES else (1, 2 if kind == "record of two inputs" else 1)
    gain, part, delay = 10 ** rng.uniform(-2, 1), float(rng.choice([0, 0.02, 0.1, 0.3])), int(rng.integers(0, 3))
    middle, damping = 2 * np.pi * rng.uniform(5, 25), 10 ** rng.uniform(-2.5, -1.3)
    corner = 1 + part * rng.choice([-1, 1], 2) * [damping, 1]
    box = middle * (1 + part * damping * np.array([[-1, 1]])), damping * (1 + part * np.array([[-1, 1]]))
    turn = corner[1] * damping
    pole = middle * corner[0] * (-turn + 1j * np.sqrt(1 - turn**2))
    size = gain * 10 ** rng.uniform(0, 2) * (rng.standard_normal((ny, nu)) + 1j * rng.standard_normal((ny, nu)))
    size = size + size.T if kind == "symmetric" else size
    lines = 2 * np.pi * rng.uniform(0.5, 45, rng.integers(8, 30))
    lines = np.sort(np.concatenate([lines, [0.99 * middle, 1.01 * middle]]))
    if kind in ("continuous", "roll-off"):
        prior, rest = continuous_class(rng, kind, gain)
        residue = size * -pole.real
        of_pole = fraction(lambda s: 1 / (s - pole), residue)
        at, dt, top = (lambda w: 1j * w), None, 2 * np.pi * 100
        basis, own = (rid.kautz(middle * by, d, dt=0) for by, d in ((1, damping), (corner[0], turn)))
    else:
        prior, rest = discrete_class(rng, kind, gain)
        a = np.exp(pole * DT)
        residue = size * (1 - abs(a))
        of_pole = fraction(lambda x: x**delay / (1 - a * x), residue)
        at, dt, top = (lambda w: np.exp(-1j * w * DT)), DT, np.pi / DT
        basis, own = (rid.kautz(middle * by, d, dt=DT, delay=delay) for by, d in ((1, damping), (corner[0], turn)))

    def truth(omega):
        return of_pole(at(omega)) + rest(at(omega))

    values = truth(lines)
    bound = rng.choice([0.01, 0.03]) * np.abs(values) + 0.01 * gain
    values = values + bound * np.exp(2j * np.pi * rng.random(values.shape)) * NEARLY
    time, outputs = record(rng, kind, truth, nu, gain) if kind in IN_TIME else (None, None)
    problem = rid.MixedProblem(
        frequency=rid.FrequencyResponse(lines, values, bound=bound, dt=dt),
        time=time,
        prior=prior, parametric=basis, symmetric=kind == "symmetric",
    )  # fmt: skip
    exact = dataclasses.replace(problem, parametric=own) if part else problem
    return EdgePlant(problem, box if part else None, truth, top, residue, exact, lambda w: of_pole(at(w)), outputs)


@functools.lru_cache(maxsize=32)
def edge_band(kind, seed):
    """The band over the box of such a plant, which several tests are about."""
    plant = edge_plant(kind, seed)
    return rid.band(plant.problem, box=plant.box, omega=[1.0])


def fraction(function, size):
    """size function(z) + conj(size function(conj z)) at z (F,): a pair of poles, real in time."""

    def values(z):
        return size * function(z)[:, None, None] + size.conj() * function(z.conj()).conj()[:, None, None]

    return values


def discrete_class(rng, kind, gain):
    """The prior, and a function of x of gain exactly K for |x| <= rho."""
    rho, zeros = rng.choice([1.02, 1.1, 1.3]), some_zeros(rng)
    shape = {"symmetric": (2, 2), "matrix": (2, 2), "record of two inputs": (1, 2)}.get(kind, (1, 1))
    U, seed = np.linalg.qr(rng.standard_normal((2, 2)))[0], rng.integers(2**32)

    def rest(x):
        if kind == "symmetric":
            factors = np.stack([blaschke(zeros[k::2], x / rho) for k in range(2)], axis=1)
            return gain * np.einsum("ik,fk,jk->fij", U, factors, U)
        if kind == "matrix":  # Blaschke and Potapov: a product whose directions differ
            parts = [inner(np.random.default_rng([seed, k]), 2, 2, x / rho) for k in range(2)]
            return gain * parts[0] @ parts[1]
        return gain * inner(np.random.default_rng(seed), *shape, x / rho)

    return rid.Prior(gain_bound=gain, decay_rate=rho), rest


def continuous_class(rng, kind, gain):
    """The prior, and a function of s of gain exactly K for Re s >= -alpha, or exactly the bound that falls."""
    decay, zeros = 10 ** rng.uniform(0, 1.3), some_zeros(rng)
    falls = {"roll_off": 2, "corner": CORNER} if kind == "roll-off" else {}

    def rest(s):
        weight = (1 + (s + decay) / CORNER) ** -2.0 if falls else 1.0
        return gain * (weight * blaschke(zeros, (50 - decay - s) / (50 + decay + s)))[:, None, None]

    return rid.Prior(gain_bound=gain, decay=decay, **falls), rest


def some_zeros(rng):
    count = rng.integers(1, 5)
    return rng.uniform(0.1, 0.97, count) * np.exp(1j * rng.uniform(0, np.pi, count))


def record(rng, kind, truth, nu, gain):
    """Samples with errors of either sign, as large as their bounds, and the function that they are of any plant."""
    past, samples = (200, 20) if kind == "free record" else (0, 32 if kind == "periodic record" else 20)
    u = rng.uniform(-1, 1, (past + samples, nu)) if past else rng.standard_normal((samples, nu))

    def outputs(plant):
        h = np.fft.irfft(plant(2 * np.pi * np.arange(SIZE // 2 + 1) / SIZE / DT)[:, 0], SIZE, axis=0)
        if kind == "periodic record":  # the sum over all periods before
            h = h.reshape(-1, samples, nu).sum(axis=0)
            return np.fft.irfft((np.fft.rfft(h, axis=0) * np.fft.rfft(u, axis=0)).sum(axis=1), samples)
        return sum(np.convolve(u[:, j], h[: past + samples, j])[past : past + samples] for j in range(nu))

    y = outputs(truth)
    bound = np.full(samples, 0.02 * np.abs(y).max() + 1e-6 * gain)
    y = y + bound * rng.choice([-1, 1], samples) * NEARLY
    start = {"free record": {"initial": "free", "past_input_bound": 1.0}, "periodic record": {"initial": "periodic"}}
    return rid.TimeRecord(u[past:], y, dt=DT, bound=bound, **start.get(kind, {})), outputs
