"""Experiments of one plant of which one has a fault: responses and records, short, so that a class is chosen in seconds."""

import dataclasses
import functools

import numpy as np

import robustid as rid
from robustid.app.run.measurements import Measured
from robustid.app.run.posing import posed
from robustid.app.run.run_file import RunFile
from robustid.app.run.run_folder import Surroundings
from robustid.app.run.settings import Withheld
from support.fault_plants import recipes, record, simulated, step

# A correction that undoes each fault; of another plant there is none.
UNDONE = {
    "sign": "negate",
    "unit": "times 0.001",
    "small": "times 1000",
    "late": "advance 3",
    "scale": "times 0.6",
    "plant": "",
}
KINDS = {"sign": "sign", "unit": "unit", "small": "unit", "late": "late", "scale": "unit", "plant": "other plant"}
SPARE = 4.5  # standard deviations of the noise that a bound is


def thinned(frf, lines):
    """About so many of the lines."""
    return frf.select(np.arange(frf.omega.size) % max(1, frf.omega.size // lines) == 0)


def with_fault(data, fault, other=None):
    """Data with a fault; `other` makes them of another plant."""
    if fault == "plant":
        return other()
    words = {"sign": "negate", "unit": "times 1000", "small": "times 0.001", "scale": "times 1.5", "late": "delay 3"}
    if fault == "clean":
        return data
    if fault == "late" and isinstance(data, rid.TimeRecord):
        return dataclasses.replace(data, y=np.vstack([np.zeros((3, data.y.shape[1])), data.y[:-3]]))
    return rid.prepare.correct(data, words[fault])


def structure(seed, fault="clean", lines=11, samples=20):
    """The response of the flexible structure at so many lines, 11 are too few for a model of it, and a step of 20 samples."""
    data = rid.datasets.flexible_structure(seed=seed, lines=lines, samples=samples)
    response, given = data.frequency, data.time

    def faster():
        at = 1.15 * np.arange(len(given.u))
        kept = at <= len(given.u) - 1
        y = np.interp(at[kept], np.arange(len(given.u)), given.y[:, 0])
        return dataclasses.replace(given, u=given.u[kept], y=y, bound=given.bound.radius[kept])

    return [response], [with_fault(given, fault, faster)]


def responses(name, seed, faults, lines=20):
    """Independent responses of a simulated plant, as many as there are faults."""
    found = []
    for k, fault in enumerate(faults):
        clean = simulated(name, seed + 1000 * k)

        def other(clean=clean, k=k):
            recipe, rng = recipes()[name], np.random.default_rng([seed, k])
            records = tuple(record(recipe, rng, plant=recipe.faster(1.05)) for _ in clean.periodic)
            return rid.estimate_frf(records, period=clean.period)

        found.append(with_fault(thinned(clean.response, lines), fault, lambda other=other: thinned(other(), lines)))
    return found, []


def records(name, seed, faults, samples=25):
    """Records from rest of a simulated plant, as many as there are faults: a step, then noise."""
    recipe, found = recipes()[name], []
    for k, fault in enumerate(faults):

        def made(plant=None, k=k):
            rng = np.random.default_rng([seed, k])
            if k == 0:
                whole = step(recipe, rng, plant=plant)
            else:
                whole = record(recipe, rng, kind="random", periods=1, settled=False, plant=plant)
                radius = np.broadcast_to(SPARE * recipe.noise * whole.y.std(axis=0), whole.y.shape)
                whole = dataclasses.replace(whole, bound=radius, initial="rest")
            first = slice(0, samples)
            return dataclasses.replace(
                whole, u=whole.u[first], y=whole.y[first], bound=whole.bound.radius[first]
            )  # fmt: skip

        found.append(with_fault(made(), fault, lambda made=made: made(recipe.faster(1.15))))
    return [], found


@functools.cache
def chosen_of_structure(seed, fault="clean"):
    """The choice for the response and the step of a structure, which several tests are about."""
    return chosen(structure(seed, fault))


def chosen(data, *, reference=False, run=None):
    """The run file and the problem with the class that the program chooses."""
    run = RunFile(withheld=Withheld(every=0)) if run is None else run
    run, problem, _ = posed(run, Measured(*map(tuple, data)), Surroundings(), reference=reference)
    return run, problem
