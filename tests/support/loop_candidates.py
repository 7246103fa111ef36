"""Other controllers of a machine in a loop, around where stability ends, and verdicts on them tried on consistent plants."""

import functools
from typing import NamedTuple

import control
import numpy as np

import robustid as rid
from robustid.core import StateMatrices, closed_loop, poles_of, response_at
from robustid.guarantees.consistent_set import consistent_set
from robustid.guarantees.value_set import along
from robustid.identification import largest_ratio, nominal_model
from robustid.identification.formulation import Candidate
from support.loop_truths import DT, around_small_model, response_of
from support.loops import measured_machine

GAP = 0.02  # how near to the border of the set plants are, in part of the way
ROUNDED = 1e-6
GRID = np.linspace(0, np.pi / DT, 3000)
NEAR = 0.5  # of the logarithm of a gain, from where stability ends


@functools.cache
def case_of(seed):
    """A machine in its loop, and the band of R about a small model that is near to its centre."""
    case = measured_machine(seed)
    result = rid.identify(case.problem)
    return case, result, around_small_model(result)


# ------------------------------------------------------------------------------------------------------ consistent plants


def is_consistent(problem, residual):
    """Every sample within its bound, and the class kept: poles, and the gain on its circle; from the numbers of the model.

    Of problems with a parametric part the samples alone: its poles are none of the class, and a model keeps no track of its parts.
    """
    prior, system = problem.prior, StateMatrices.of(residual)
    if largest_ratio(problem, residual) > 1 + ROUNDED:
        return False
    if problem.parametric is not None:
        return True
    circle = np.exp(1j * np.linspace(0, np.pi, 2000)) / prior.decay_rate
    return np.abs(poles_of(system.A)).max(initial=0) * prior.decay_rate < 1 and np.abs(
        response_at(system, circle)
    ).max() <= prior.gain_bound * (1 + ROUNDED)


class Plant(NamedTuple):
    """A plant and its response at `GRID`."""

    plant: control.StateSpace
    response: np.ndarray


def plant_with_response(plant):
    return Plant(plant, response_of(plant, GRID))


def consistent_plants(seed, count, near=()):
    """Plants P(R) of consistent R, some of them far out near to given frequencies."""
    case, result, _ = case_of(seed)
    rng = np.random.default_rng([seed, 31])
    return [plant_with_response(case.loop.plant_of(one)) for one in consistent_members(result, count, rng, near)]


def consistent_members(result, count, rng, near=()):
    """Systems that an identification allows: each far out in a direction at a frequency, some of these near to given ones.

    Of the interpolants of such samples one between the central one and those whose gain is all that the class allows.
    """
    every, found = consistent_set(result), []
    none, top = np.zeros(0), np.pi / result.problem.dt
    for attempt in range(3 * count):
        omega = rng.uniform(0, top)
        if near and attempt % 2:
            omega = min(near[attempt // 2 % len(near)] * np.exp(0.1 * rng.standard_normal()), 0.999 * top)
        here = every.with_node(omega)
        x, p, tail = here.value_weights(omega)
        turn = np.exp(2j * np.pi * rng.random())
        point = here.member(along(0.0, turn * x, turn * p, tail), GAP)
        if point is None:
            continue
        free = rng.choice([0.0, rng.uniform(-0.99, 0.99)])
        system = nominal_model(here.posed, Candidate(*point, none, none, ""), every.level, free).model
        if is_consistent(result.problem, system):
            found.append(system)
        if len(found) == count:
            return found
    raise AssertionError(f"{len(found)} consistent systems of {3 * count} tried")


# -------------------------------------------------------------------------------------------------------------- verdicts


class Tried(NamedTuple):
    """A verdict, what the true loop and those of consistent plants do, and what shows that it is wrong."""

    said: str  # "stable", "unstable" (a plant is shown), "undecided"
    truth: bool  # the true loop is stable
    unstable: int  # consistent plants whose loop is not
    plants: int
    errors: tuple[str, ...]

    @property
    def wrong(self):
        return bool(self.errors)


def is_stable(plant, controller):
    return bool(np.abs(poles_of(closed_loop(StateMatrices.of(plant), StateMatrices.of(controller)).A)).max() < 1)


def verdict(seed, found, plants=()):
    """What the bounds say of their controller, with the proof or the counterexample tried; `plants` with their responses."""
    case, result, _ = case_of(seed)
    controller = found.controller
    shown, truth = found.unstable_plant(result), is_stable(case.plant, controller)
    loops, errors = [is_stable(one.plant, controller) for one in plants], []
    if found.guaranteed:
        c, every = response_of(controller, GRID), (plant_with_response(case.plant), *plants)
        peak = max(float(np.abs(1 / (1 + one.response * c)).max()) for one in every)
        wrong = {
            "the true loop is not stable": not truth,
            "that of a consistent plant is not stable": not all(loops),
            "a plant is shown all the same": shown is not None,
            "a sensitivity is beyond its bound": peak > found.peaks["sensitivity"].value,
        }
        errors = [words for words, it_is in wrong.items() if it_is]
    elif shown is not None:
        wrong = {
            "the plant that is shown is stabilised": is_stable(shown.plant, controller),
            "the controller that ran does not stabilise it": not is_stable(shown.plant, case.controller),
            "it is not consistent": not is_consistent(result.problem, shown.residual),
        }
        errors = [words for words, it_is in wrong.items() if it_is]
    said = "stable" if found.guaranteed else "undecided" if shown is None else "unstable"
    return Tried(said, truth, loops.count(False), len(plants), tuple(errors))


# ------------------------------------------------------------------------------------------------------------ candidates


def candidates(seed, count):
    """Controllers at random around where stability ends: gains of the one that ran, every other one with a lead or a lag."""
    case, _, band = case_of(seed)
    low, high = rid.loop_bounds(band, case.loop).margins.gain
    rng, found = np.random.default_rng([seed, 41]), []
    while len(found) < count:
        near = np.exp(rng.uniform(-NEAR, NEAR))
        if len(found) % 2 == 0:
            end = rng.choice([low, high]) if np.isfinite(high) else low
            found.append(end * near * case.controller)
            continue
        zero = rng.uniform(0.2, 0.95)
        pole = np.clip(zero + rng.uniform(-0.2, 0.2), 0.0, 0.97)
        filtered = case.controller * control.ss(pole, 1.0, pole - zero, 1.0, DT)
        filtered = control.ss(filtered.A, filtered.B, filtered.C, filtered.D, DT)
        if is_stable(case.plant, filtered):
            ends = [end for step in (1.02, 1 / 1.02) if (end := limit_of(case.plant, filtered, step))]
            found += [rng.choice(ends) * near * filtered] if ends else []
    return found


def limit_of(plant, controller, step):
    """The gain up to or down to which the loop is stable, in steps; None where there is none within a factor of 30."""
    gain = 1.0
    while 1 / 30 < gain < 30:
        if not is_stable(plant, gain * controller):
            return gain
        gain *= step
    return None


def tried(seed, plants, count=10):
    """Verdicts on candidates of a machine, tried on consistent plants, half of them far out near to where loops come near to -1."""
    case, _, band = case_of(seed)
    every = [rid.loop_bounds(band, case.loop, one) for one in candidates(seed, count)]
    limits = [found.stability.frequency for found in every if found.stability.frequency > 0]
    these = consistent_plants(seed, plants, limits) if plants else []
    return [verdict(seed, found, these) for found in every]
