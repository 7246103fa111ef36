"""Several plants at the edge of one class that keep all bounds of the same samples: gain exactly K, errors at their ends."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

import robustid as rid
from support.edge_bands import KINDS, NEARLY, edge_plant
from support.passive import passive_edge

STEPS = 30  # of the search for the farthest plant
LESS = 0.7  # of the distance, where it leaves the bounds of a record


@dataclasses.dataclass(frozen=True)
class EdgeTruths:
    """A problem that all of these plants keep, the box of their poles, the plants at frequencies, and the highest frequency."""

    problem: rid.MixedProblem
    box: Any
    truths: tuple[Callable[[Any], Any], ...]
    top: float


def all_pass(problem, omega, less):
    """A factor of the rest of modulus 1 where its gain is bounded, and there alone: 1 but for a turn around one frequency.

    Its zero is so much less than 1 away from the origin in the disc onto which the region of the class goes.
    """

    def zeta(w):
        return problem.region.points(problem.plane.angles(np.atleast_1d(w)))

    a = (1 - less) * np.exp(1j * np.angle(zeta(omega)[0]))

    def values(w):
        found = np.ones(np.size(w), complex)
        for zero in (a, a.conj()):
            found = found * (zero - zeta(w)) / (1 - zero.conjugate() * zeta(w)) * abs(zero) / zero
        return found[:, None, None]

    return values


def passive(kind, seed):
    """A bounded real problem of one or two ports, and its plant at frequencies."""
    of_s, problem = passive_edge(seed, "bounded", 1 + (kind == "two ports"))
    return problem, lambda w: of_s(1j * w)


def edge_truths(kind, seed, count):
    """The plant of edge_bands (or a passive one) and others as far from it as the bounds of its samples let them be.

    Each of them turns the rest around once more, mostly about a frequency of its own, and its mode is a little larger or smaller.
    """
    rng = np.random.default_rng([seed, 7])
    box, outputs = None, None
    if kind in KINDS:
        plant = edge_plant(kind, seed)
        box = None if kind in ("free record", "periodic record") else plant.box  # polygons over a box don't take those
        problem, top = plant.exact, plant.top
        first, mode, outputs = plant.truth, plant.mode, plant.outputs
    else:
        problem, first = passive(kind, seed)
        mode, top = (lambda w: 0.0 * first(w)), 10.0
    points = problem.frequency[0]
    lines, bound = points.omega, points.bound.outer_radius * NEARLY
    low, high = lines.min(), lines.max()
    start = first(lines)
    others = []
    for number in range(count - 1):
        omega = rng.uniform(low, high) if number % 3 else rng.uniform(0.001 * top, top)
        turn, size = np.exp(2j * np.pi * rng.random()), rng.uniform(0, 0.1) * rng.integers(0, 2)

        def moved(less, omega=omega, turn=turn, size=size):
            factor = all_pass(problem, omega, less)
            return lambda w: first(w) + (factor(w) - 1) * (first(w) - mode(w)) + less * size * np.real(turn) * mode(w)

        near, far = 0.0, 0.9
        for _ in range(STEPS):
            middle = (near + far) / 2
            near, far = (middle, far) if np.all(np.abs(moved(middle)(lines) - start) <= bound) else (near, middle)
        while outputs is not None and np.any(np.abs(outputs(moved(near)) - outputs(first)) > room(problem)):
            near *= LESS
        others.append(moved(near))
    turns = np.exp(2j * np.pi * rng.random(start.shape))
    away = turns * farthest(np.stack([one(lines) - start for one in others]) / turns, bound)
    frf = rid.FrequencyResponse(lines, start + away, bound=points.bound.outer_radius, dt=points.dt)
    problem = dataclasses.replace(problem, frequency=frf)
    if outputs is not None:
        own, record = outputs(first), problem.time[0]
        signs = rng.choice([-1.0, 1.0], own.size)
        away = signs * farthest(np.stack([outputs(one) - own for one in others]) * signs, room(problem))
        problem = dataclasses.replace(problem, time=dataclasses.replace(record, y=(own + away)[:, None]))
    return EdgeTruths(problem, box, (first, *others), top)


def room(problem):
    """How far the samples of the record may be from those of a plant."""
    return problem.time[0].bound.radius[:, 0] * NEARLY


def farthest(away, bound):
    """How far a sample may go along the real axis with 0 and all of `away` (count, ...) within its bound: one is at its end."""
    ends = away.real + np.sqrt(np.maximum(bound**2 - away.imag**2, 0))
    return np.minimum(ends.min(axis=0), bound)
