"""Whole cases of bands and withheld data whose truth is known: true bands, and bands that are three times too narrow.

Three times too narrow: the largest error of the centre over the frequencies of the withheld data, between their lines too, is
three times the radius that is claimed there. Either the radii are scaled by one factor until that is so ("scaled"), or the plant is
not that of the records any more: a mode of it is moved until the band is that wrong ("moved").
"""

import dataclasses

import control
import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import brentq

import robustid as rid
from robustid.estimation import response_alone

DT, PERIOD, TRANSIENT = 0.01, 250, 40
LINES = np.arange(4, 64)
TIMES = 3.0
KINDS = ("records", "periods", "lines")


@dataclasses.dataclass(frozen=True)
class Case:
    """A true band, one that is three times too narrow, and the withheld data of both."""

    band: rid.FrequencyResponse
    narrow: rid.FrequencyResponse
    withheld: list
    of_narrow: list
    kind: str
    holds: bool  # the truth is in the band, as it is where the bounds of the records that were used hold


def plant(modes, gains):
    """Modes in rad/s with damping ratios, behind a zero-order hold."""
    a, b, c = [], [], []
    for (w, d), gain in zip(modes, gains, strict=True):
        a.append([[0, w], [-w, -2 * d * w]])
        b += [[0.0], [w]]
        c += [2 * d * gain, 0.0]
    return control.c2d(control.ss(block_diag(*a), b, [c], 0), DT, "zoh")


def at(system, omega):
    """Response at frequencies in rad/s, (F, 1, 1), by modes: far quicker than one solution a frequency."""
    poles, vectors = np.linalg.eig(system.A)
    z = np.exp(1j * np.atleast_1d(omega) * DT)[:, None]
    parts = (system.C @ vectors).ravel() * np.linalg.solve(vectors, system.B).ravel()
    return (np.sum(parts / (z - poles), axis=1) + system.D).reshape(-1, 1, 1)


def record(rng, system, periods, noise):
    """Periods of one multisine in steady state, with noise at the output."""
    spectrum = np.zeros(PERIOD // 2 + 1, complex)
    spectrum[LINES] = np.exp(2j * np.pi * rng.random(LINES.size)) * PERIOD / np.sqrt(2 * LINES.size)
    response = at(system, 2 * np.pi * np.arange(spectrum.size) / (PERIOD * DT)).ravel()
    u, y = (np.tile(np.fft.irfft(part, PERIOD), periods) for part in (spectrum, spectrum * response))
    return rid.TimeRecord(u, y + noise * rng.standard_normal(y.size), dt=DT, initial="periodic")


def estimated(records):
    return response_alone(records, period=PERIOD)


def problem_of(rng, frf, modes):
    """The class of a user who knows about where the modes are: with the poles exactly, or in a box of some per cent."""
    part = float(rng.choice([0.0, 0.02, 0.05]))
    prior = rid.Prior(gain_bound=0.2, decay_rate=1.1)
    problem = rid.MixedProblem(frequency=frf, prior=prior, parametric=rid.kautz(*modes.T, dt=DT, repeat=1))
    width = part * modes[:, 1] * modes[:, 0]
    if not part:
        return problem, None
    box = modes[:, :1] + np.outer(width, [-1, 1]), modes[:, 1:] * (1 + part * np.array([[-1, 1]]))
    return problem, box


def moved_until(ratio, modes, gains):
    """The plant with its first mode moved, and larger, until the error of the band is three times its radius somewhere."""

    def shifted(size):
        return plant(modes * [[1 + min(size, 3) * modes[0, 1], 1], [1, 1]], gains * [1 + size / 3, 1])

    return shifted(brentq(lambda size: ratio(shifted(size)) - TIMES, 0.0, 1e4, xtol=1e-3))


def held_out(rng, kind, noise):
    """Withheld records of their own excitations, or further periods of one, of different numbers: what makes them of any plant."""
    periods, count = int(rng.choice([2, 8, 16, 64])), int(rng.integers(1, 4)) if kind == "records" else 1
    seeds = rng.integers(0, 2**31, count)
    return lambda system: [estimated(record(np.random.default_rng(s), system, periods, noise)) for s in seeds]


def case(kind, seed, how="scaled"):
    """The same for the same numbers; of lines of the same records the plant can't have moved."""
    rng = np.random.default_rng([KINDS.index(kind), seed])
    modes = np.stack([rng.uniform([30.0, 80.0], [60.0, 130.0]), 10 ** rng.uniform(-2, -1.3, 2)], axis=1)
    gains, noise = rng.uniform(0.3, 1.0, 2), 10 ** rng.uniform(-2.5, -0.5)
    system = plant(modes, gains)
    frf = estimated(record(rng, system, 8, noise))
    if kind == "lines":
        out = np.arange(LINES.size) % 4 == 2
        frf, kept = frf.select(~out), frf.select(out)
        later = lambda _: [kept]  # noqa: E731
    else:
        later = held_out(rng, kind, noise)
    problem, box = problem_of(rng, frf, modes)
    omega = 2 * np.pi * LINES / (PERIOD * DT)
    band = rid.band(problem, box=box, omega=omega)
    dense = np.linspace(omega[0], omega[-1], 3000)
    middle, reach = band.at(dense)

    def ratio(one):
        return float(np.max(np.abs(at(one, dense) - middle) / reach))

    other = moved_until(ratio, modes, gains) if how == "moved" else system
    sizes = ratio(system), ratio(other) / TIMES
    factors = (1.0, 1.0 if how == "moved" else sizes[1])
    discs = [rid.FrequencyResponse(omega, band.centre, bound=size * band.radius, dt=DT) for size in factors]
    return Case(*discs, later(system), later(other), kind, sizes[0] <= 1)
