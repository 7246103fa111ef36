"""Records of loops in which somebody made a mistake about the controller or the signals, and what names it."""

import functools
from typing import NamedTuple

import control
import numpy as np
import scipy.linalg

import robustid as rid
from robustid.core import StateMatrices, closed_loop, decay_of, poles_of, response_at, simulate
from support.loops import machine, measured_machine, pair_of, regulator

SIZES = ((1, 1), (1, 1), (2, 1), (2, 2))
NOISES = (0.0, 0.001, 0.005, 0.02)


class Case(NamedTuple):
    """What is said (the loop) and recorded, what names it right: kinds, and the size where there is one."""

    loop: rid.Loop
    record: rid.TimeRecord
    effect: float  # rms of what the mistake makes of the residual, over that of the noise
    kinds: tuple
    size: float | None

    def named(self, faults):
        """The tuple holds a fault of a right kind, and of the right size."""
        sizes = [fault.size for fault in faults if fault.kind in self.kinds]
        return any(self.size is None or abs(size / self.size - 1) < 0.2 * min(1, abs(self.size - 1)) for size in sizes)


class Truth(NamedTuple):
    """A plant and the controller that runs."""

    plant: StateMatrices
    controller: StateMatrices
    dt: float


@functools.cache
def truth_of(seed):
    """Machines under a regulator, and random plants of every size, unstable both; with integrators in the controller or not."""
    if seed % 4 == 3:
        found = measured_machine(seed)
        return Truth(StateMatrices.of(found.plant), StateMatrices.of(found.controller), found.plant.dt)
    for attempt in range(1000):
        plant, controller = pair_of(
            1000 * seed + attempt, 0.1, order=3, integrators=bool(seed % 3 == 1), size=SIZES[seed // 4 % len(SIZES)]
        )
        poles = poles_of(closed_loop(plant, controller).A)
        at = np.exp(1j * np.linspace(0.0, np.pi, 300)[1:])
        p, c = response_at(plant, at), response_at(controller, at)
        peak = np.linalg.norm(np.linalg.inv(np.eye(p.shape[1]) + p @ c), 2, axis=(1, 2)).max()
        if decay_of(poles, 1.0) > 0.02 and peak < 8:
            return Truth(plant, controller, 0.1)
    raise AssertionError("no loop")


@functools.cache
def process_of(seed, ratio):
    """A slow process under a PI controller with a filter, and what the controller is at so many times the sample time."""
    rng = np.random.default_rng([seed, 3])
    dt, (slow, fast) = 0.1, rng.uniform([2.0, 0.3], [6.0, 1.0])
    plant = control.c2d(control.tf([rng.uniform(0.5, 2.0)], np.polymul([slow, 1], [fast, 1])), dt)
    own = control.tf([2.0 * slow / 3, 2.0 / 3], [rng.uniform(0.2, 0.6), 1.0, rng.choice([0.0, 0.05])])
    method = rng.choice(["zoh", "tustin"])
    running, stated = (StateMatrices.of(control.ss(control.c2d(own, time, method))) for time in (dt, ratio * dt))
    return Truth(StateMatrices.of(control.ss(plant)), running, dt), stated


@functools.cache
def slower_of(seed, step):
    """A machine whose controller runs at every so many samples of the record."""
    for attempt in range(100):
        plant = StateMatrices.of(machine(1000 * seed + attempt, 0.005, 1 + seed % 3, 1))
        try:
            controller = regulator(powered(plant, step))
        except np.linalg.LinAlgError:
            continue
        if runs(powered(plant, step), controller):
            return Truth(plant, controller, 0.005)
    raise AssertionError("no loop")


def run_of(truth, rng, *, place="input", periodic=False, samples=600, low=-np.inf, high=np.inf, step=1):
    """u, y and r of a loop that runs; u within limits, the controller at every so many samples."""
    plant, controller, _ = truth
    nu, ny = plant.B.shape[1], plant.C.shape[0]
    columns = nu if place == "input" else ny
    r = rng.standard_normal((samples, columns))
    if rng.uniform() < 0.5:  # coloured
        r = (
            1.5
            * simulate(
                StateMatrices(0.7 * np.eye(columns), np.eye(columns), 0.7 * np.eye(columns), np.eye(columns)), r
            )[0]
        )
    r = np.tile(r, (6, 1)) if periodic else r
    x, z = np.zeros(len(plant.A)), np.zeros(len(controller.A))
    if not periodic:
        z = 0.3 * rng.standard_normal(len(controller.A)) * (rng.uniform() < 0.5)  # a controller starts anyhow
    sign = {"input": 0.0, "reference": -1.0, "output": 1.0}[place]
    both = np.linalg.inv(np.eye(nu) + controller.D @ plant.D)
    u, y = np.empty((len(r), nu)), np.empty((len(r), ny))
    for k, push in enumerate(r):
        added = sign * push if sign else 0.0
        if k % step == 0:
            held = both @ (controller.C @ z + controller.D @ (plant.C @ x + added + (0.0 if sign else plant.D @ push)))
        u[k] = np.clip((0.0 if sign else push) - held, low, high)
        y[k] = plant.C @ x + plant.D @ u[k]
        if k % step == 0:
            z = controller.A @ z + controller.B @ (y[k] + added)
        x = plant.A @ x + plant.B @ u[k]
    kept = slice(-samples, None)
    return u[kept], y[kept], r[kept]


def delayed(system):
    """One sample later."""
    A, B, C, D = system
    ny, nu = D.shape
    states = np.block([[A, np.zeros((len(A), ny))], [C, np.zeros((ny, ny))]])
    return StateMatrices(states, np.vstack([B, D]), np.hstack([np.zeros((ny, len(A))), np.eye(ny)]), np.zeros((ny, nu)))


def loop_of(stated, plant, dt, place):
    """The loop as it is said; about no plant, that plant, or one beside it, whatever the controller stabilises."""
    beside = [None, plant, StateMatrices(plant.A, plant.B, 0.7 * plant.C, plant.D)]
    for one in beside:
        try:
            return rid.Loop(control.ss(*stated, dt), one and control.ss(*one, dt), excitation=place)
        except rid.errors.InputError:
            continue
    return None


def measured(arrays, level, rng):
    """With noise, or coarse, each as so large a part of its rms."""
    found = []
    for one in arrays:
        size = level * np.sqrt(np.mean((one - one.mean(axis=0)) ** 2, axis=0))
        coarse = rng.uniform() < 0.3 and level > 0
        found.append(
            np.round(one / size / 12**0.5) * size * 12**0.5 if coarse else one + size * rng.standard_normal(one.shape)
        )
    return found


def scaled(system, factor):
    return StateMatrices(system.A, system.B, factor * system.C, factor * system.D)


def powered(system, ratio):
    """At so many times the sample time, with hold; None where it has no real one."""
    A, B, C, D = system
    n, m = B.shape
    power = scipy.linalg.fractional_matrix_power(np.block([[A, B], [np.zeros((m, n)), np.eye(m)]]), ratio)
    if not np.all(np.isfinite(power)) or np.abs(np.imag(power)).max() > 1e-9 * np.abs(power).max():
        return None
    return StateMatrices(np.real(power)[:n, :n], np.real(power)[:n, n:], C, D)


def runs(plant, controller):
    return decay_of(poles_of(closed_loop(plant, controller).A), 1.0) > 0.01


MISTAKES = (
    "sign of the feedback", "delay", "gain", "saturation", "discretisation", "place", "sign of r", "unit of r", "unit of y",
    "offset", "no reference", "exchanged", "u before r", "slower controller",
)  # fmt: skip


class Said(NamedTuple):
    """What runs, and what is said of it: the controller, a plant beside, the place of r; with what names the difference."""

    truth: Truth
    stated: StateMatrices
    about: StateMatrices
    place: str
    said: str
    kinds: tuple = ()
    size: float | None = None
    step: int = 1


def said_of(mistake, seed, place, rng):
    """A loop with a mistake about the controller or the place of r, or without one."""
    truth = truth_of(seed)
    plant, running, _ = truth
    right = Said(truth, running, plant, place, place)
    if mistake == "sign of the feedback":
        return right._replace(stated=scaled(running, -1), about=scaled(plant, -1), kinds=("sign",))
    if mistake == "delay":
        if runs(plant, delayed(running)) and rng.uniform() < 0.7:
            return right._replace(truth=truth._replace(controller=delayed(running)), kinds=("late",))
        return right._replace(stated=delayed(running), kinds=("late",))
    if mistake == "gain":
        size = rng.choice([0.7, 0.8, 0.9, 0.95, 1.05, 1.1, 1.25, 1.5])
        return right._replace(stated=scaled(running, 1 / size), kinds=("controller",), size=size)
    if mistake == "discretisation":
        truth, stated = process_of(seed, rng.choice([0.5, 2.0]))
        return Said(truth, stated, truth.plant, place, place, ("sample time",))
    if mistake == "slower controller":
        truth = slower_of(seed, 2)
        return Said(truth, truth.controller, powered(truth.plant, 2), "input", "input", ("sample time",), 2.0, 2)
    if mistake == "place":
        places = list(("input", "reference", "output") if plant.B.shape[1] == len(plant.C) else ("reference", "output"))
        place = places.pop(rng.integers(len(places)))
        return right._replace(place=place, said=rng.choice(places), kinds=("excitation",))
    if mistake in ("u before r", "exchanged"):
        kinds = ("excitation",) if mistake == "u before r" else ("exchanged",)
        return right._replace(place="input", said="input", kinds=kinds)
    return right


def spoiled(mistake, place, signals, rng):
    """u, y and r with a mistake about them, or without one, and what names it: kinds, size."""
    u, y, r = signals
    if mistake == "sign of r":
        return (u, y, -r), ("sign", "excitation") if place == "reference" else ("sign",), None
    if mistake == "unit of r":
        size = rng.choice([1e-3, np.pi / 180, 0.9, 1.1, 180 / np.pi, 1e3])
        return (u, y, r / size), ("unit",), size
    if mistake == "unit of y":
        size, j = rng.choice([1e-3, np.pi / 180, 0.9, 1.1, 180 / np.pi, 1e3]), rng.integers(y.shape[1])
        y[:, j] = y[:, j] / size
        return (u, y, r), ("unit", "controller"), size
    if mistake == "offset":
        return (u, y + rng.uniform(0.3, 3) * y.std(axis=0), r), ("offset",), None
    if mistake == "exchanged":
        return (r, y, u), (), None
    if mistake == "u before r":
        return (u - r, y, r), (), None
    return signals, (), None


def case_of(mistake, seed, *, samples=600):
    """A record with a mistake, or without one, ""; None where these loops do not have it."""
    rng = np.random.default_rng([seed, MISTAKES.index(mistake) if mistake else 99])
    periodic, level = bool(rng.uniform() < 0.5), NOISES[rng.integers(len(NOISES))]
    made = said_of(mistake, seed, "reference" if rng.uniform() < 0.25 else "input", rng)
    loop = loop_of(made.stated, made.about, made.truth.dt, made.said)
    if loop is None:
        return None

    def signals(**limits):
        source = np.random.default_rng([seed, 5])
        how = {"place": made.place, "periodic": periodic, "samples": samples}
        return run_of(made.truth, source, **how, step=made.step, **limits)

    limits, kinds = {}, made.kinds
    if mistake == "saturation":
        limit = rng.uniform(0.6, 0.85) * np.abs(signals()[0][samples // 2 :]).max(axis=0)
        limits, kinds = {"low": -limit, "high": limit}, ("saturated",)
    u, y, r = signals(**limits)
    if not np.all(np.isfinite(u)) or np.abs(y).max() > 1e4 * np.abs(r).max():
        return None
    arrays, more, size = spoiled(mistake, made.place, (u, y, r), rng)
    kinds, size = kinds + more, made.size if size is None else size
    initial = "periodic" if periodic else "rest"
    records = [
        rid.TimeRecord(a, b, dt=made.truth.dt, reference=c, initial=initial)
        for a, b, c in (arrays, measured(arrays, level, rng))
    ]
    clean, noisy = (loop.residual(one)[samples // 2 :] for one in records)
    effect = float(np.linalg.norm(clean) / max(np.linalg.norm(noisy - clean), 1e-9 * np.linalg.norm(noisy), 1e-300))
    record = records[1]
    if mistake == "no reference":
        record = rid.TimeRecord(record.u, record.y, dt=made.truth.dt, initial=initial)
        kinds, effect = ("no reference",), np.inf
    return Case(loop, record, effect, kinds, size)
