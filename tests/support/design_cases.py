"""Judges of designs: random plants in bands, and the best controller by search over its numbers alone."""

import functools

import control
import numpy as np

import robustid as rid
from robustid.controllers import PID, Limits, LowPass
from robustid.controllers.plants import Plants
from robustid.controllers.structure import basis_of
from robustid.core import StateMatrices, points_of, response_at

DT = 0.01
PEAK = 2.0
RATE = 1.04


def responses(model, omega):
    return response_at(StateMatrices.of(model), points_of(omega, model.dt or 0))


def values_of(model, omega):
    """Response of one input and one output, (F,)."""
    return responses(model, omega)[:, 0, 0]


def largest(matrices):
    """Largest singular values."""
    return np.linalg.norm(matrices, 2, axis=(-2, -1))


def gain_of(plant, rate, count):
    """The largest singular value of a stable plant on |z| = 1/rate."""
    circle = np.exp(1j * np.linspace(0, np.pi, count)) / rate
    return np.linalg.norm(response_at(StateMatrices.of(plant), circle), 2, axis=(1, 2)).max()


def sizes_of(F, C):
    """Sizes of the maps of the loop of a plant and a controller, by their values."""
    S = 1 / np.abs(1 + F * C)
    return {
        "sensitivity": S,
        "complementary_sensitivity": np.abs(F * C) * S,
        "process_sensitivity": np.abs(F) * S,
        "control_sensitivity": np.abs(C) * S,
    }


@functools.cache
def band_of(seed):
    """The band of a random plant of one to three poles and up to two samples of delay, known to a few percent at 40 lines."""
    rng = np.random.default_rng([45, seed])
    poles = list(rng.uniform(0.5, 0.93, rng.integers(1, 3)))
    if rng.random() < 0.6:
        size, angle = rng.uniform(0.75, 0.93), rng.uniform(0.2, 1.5)
        poles += [size * np.exp(1j * angle), size * np.exp(-1j * angle)]
    zeros = list(rng.uniform(-0.8, 0.6, len(poles) - 1))
    plant = control.ss(control.zpk(zeros, [*poles, *[0.0] * rng.integers(0, 3)], 1.0, DT))
    plant = plant / plant(1.0).real
    omega = np.linspace(3.0, 310.0, 40)
    true = values_of(plant, omega)
    bound = rng.uniform(0.02, 0.05) * np.abs(true) + 0.005
    return plant, measured_band(rng, plant, omega, true, bound, 2000)


def measured_band(rng, plant, omega, true, bound, count):
    """The band about a small model of a plant with errors inside of its bounds, of a class of a tenth more than its gain."""
    values = true + bound * rng.uniform(0, 1, true.shape) * np.exp(2j * np.pi * rng.uniform(size=true.shape))
    frf = rid.FrequencyResponse(omega, values, bound=bound, dt=DT)
    prior = rid.Prior(gain_bound=float(1.1 * gain_of(plant, RATE, count)), decay_rate=RATE)
    model = rid.balanced_truncation(plant, tol=1e-3).model
    return rid.band(rid.MixedProblem(frequency=frf, prior=prior), model=model)


@functools.cache
def lag_band():
    """The band of 0.1/(z - 0.9), known to 0.01 at 40 lines."""
    plant = control.ss(control.tf([0.1], [1, -0.9], DT))
    omega = np.linspace(3.0, 312.0, 40)
    values = values_of(plant, omega)
    frf = rid.FrequencyResponse(omega, values, bound=0.01, dt=DT)
    problem = rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=1.2, decay_rate=1.08))
    return rid.band(problem, model=plant)


class Judge:
    """The bandwidth that combinations of a structure reach within the same bounds, on a dense grid, and the best one."""

    def __init__(self, band, structure, at=()):
        self.plants = Plants.of(band)
        self.basis = basis_of(structure, at, DT)
        grid = np.unique(np.concatenate([self.plants.grid(), np.geomspace(0.1, np.pi / DT, 300)]))
        self.discs = self.plants.discs(grid)
        self.values = self.basis.response(grid)[:, :, 0, 0]
        self.centre = self.discs.centre[:, 0, 0]

    def levels(self, factors):
        """Of every row of factors (N, m), 0 where a limit is broken."""
        C = factors @ self.values.T
        size = self.discs.radius * np.abs(C)
        kept = np.all(np.abs(1 + self.centre * C) - size >= 1 / PEAK, axis=1)
        high = np.abs(self.centre * C) - size >= 1
        count = np.where(high.all(axis=1), high.shape[1], np.argmin(high, axis=1))
        return np.where(kept & (count > 0), self.discs.omega[np.maximum(count - 1, 0)], 0.0)

    def best(self, rng, starts=40_000, rounds=14):
        """The highest level of a controller that stabilises, by random search in ever smaller boxes about the best ones."""
        m = self.basis.count
        sizes = 1 / np.abs(self.centre[:, None] * self.values).max(axis=0)
        pool = rng.choice([-1, 1], (starts, m)) * sizes * 10 ** rng.uniform(-2.5, 1.5, (starts, m))
        for k in range(rounds):
            levels = self.levels(pool)
            kept = np.flatnonzero(levels)
            some = (
                rng.permutation(kept)[:600] if k == 0 else kept
            )  # the highest of all may stand on the wrong side of -1
            order = sorted({*some.tolist(), *kept[np.argsort(-levels[kept])[:400]].tolist()}, key=lambda i: -levels[i])
            order = [i for i in order[:1000] if self.stable(pool[i])][:30]
            if not order:
                return 0.0
            best = pool[order]
            spread = 0.7 ** (k + 1)
            moved = best[rng.integers(0, len(best), 4000)]
            moved = moved * (1 + spread * rng.standard_normal(moved.shape))
            pool = np.concatenate([best, moved])
        return float(levels[order[0]])

    def stable(self, factors):
        return self.plants.is_stable_with(self.basis.controller(factors))


STRUCTURES = ([PID()], [PID(filter=150.0)], [PID(), LowPass(150.0, 1)])


def reached(seed):
    """(bandwidth of the design, bandwidth by search, the design) of a random problem."""
    plant, band = band_of(seed)
    structure = STRUCTURES[seed % len(STRUCTURES)]
    design = rid.design_controller(band, structure, limits=Limits(sensitivity_peak=PEAK))
    at = [one[0] for factor in structure for one in factor.free]
    judge = Judge(band, structure, at)
    return plant, design, judge.best(np.random.default_rng(seed))


@functools.cache
def matrix_band_of(seed, lines=40, size=2):
    """The band of a random plant of coupled axes, each of one to four poles, known to a few percent."""
    rng = np.random.default_rng([46, seed])
    coupling = np.eye(size) + rng.uniform(-0.35, 0.35, (size, size)) * (1 - np.eye(size))
    axes = []
    for _ in range(size):
        poles = list(rng.uniform(0.5, 0.93, rng.integers(1, 3)))
        if rng.random() < 0.5:
            radius, angle = rng.uniform(0.75, 0.93), rng.uniform(0.2, 1.5)
            poles += [radius * np.exp(1j * angle), radius * np.exp(-1j * angle)]
        zeros = list(rng.uniform(-0.8, 0.6, len(poles) - 1))
        one = control.ss(control.zpk(zeros, [*poles, *[0.0] * rng.integers(0, 2)], 1.0, DT))
        axes.append(one / one(1.0).real)
    whole = control.append(*axes)
    plant = control.ss(whole.A, whole.B, coupling @ whole.C, coupling @ whole.D, DT)
    omega = np.linspace(3.0, 310.0, lines)
    true = responses(plant, omega)
    bound = rng.uniform(0.01, 0.03) * np.abs(true) + 0.003
    return plant, measured_band(rng, plant, omega, true, bound, 1000)


def measured_in_loop(plant, gain):
    """(loop, problem of R, bounds of the loop) of a plant under a gain, with 30 lines known to 2 %."""
    loop = rid.Loop(control.ss([], [], [], gain, DT))
    R, lines = loop.residual_of(plant), np.linspace(4.0, 312.0, 30)
    values = responses(R, lines)
    frf = rid.FrequencyResponse(lines, values, bound=0.02 * np.abs(values) + 1e-3, dt=DT)
    problem = rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=1.5, decay_rate=1.08))
    return loop, problem, rid.loop_bounds(rid.band(problem, model=R), loop)
