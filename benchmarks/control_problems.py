"""Problems of `controllers.py`: measured machines with their bands, structures, withheld records; bands that are wider, or none."""

import dataclasses
import functools
from typing import Any, NamedTuple

import control
import numpy as np
from band_problems import TWO_PI, beam_halves, class_of, periods_of
from bands import modal_model

import robustid as rid
from robustid.design import PID, Attenuation, LowPass, Notch
from robustid.guarantees import Band, CircleBound, ErrorSets
from support.design_cases import values_of

FIRST = ([0], [0])
THINNED, LINES = 16, 8  # lines of the mirror: every so manieth shows the modes, and is used
NOTHING = 1e-9  # of the largest response: radius of a nominal model alone
PARTS = 4  # of an arc on which the size of a weight is bounded by its ends


class Machine(NamedTuple):
    """A band of measured data, what else was measured, structures with their goals."""

    name: str
    band: Band
    withheld: dict[str, rid.FrequencyResponse]
    structures: dict[str, tuple[Any, Any]]
    refined: tuple[float, float]  # Hz: where polygons are taken

    @property
    def result(self):
        """The identification of its problem, of which members are taken."""
        return rid.identify(self.band.problem)


def banded(problem):
    """The band about a model of the data, of order 16 at most: the central one, without states that hardly count."""
    result = rid.identify(problem).require()
    model = result.model
    if model.nstates > 16:
        model = rid.balanced_truncation(model, order=16).model
    band = rid.band(problem)
    choices = [band.with_model(one) for one in (model, modal_model(problem))]
    return min(choices, key=lambda one: float(np.median(one.circle.bound)))


# ---------------------------------------------------------------------------------------------------------------- machines

MOTOR = {
    "PI": ([PID()], "bandwidth"),
    "PI, notch, low-pass": ([PID(), Notch(TWO_PI * 77, 0.3), LowPass(TWO_PI * 200, 2)], "bandwidth"),
    "PID": ([PID(filter=TWO_PI * 300)], "bandwidth"),
    "PID, notch, low-pass": (
        [PID(filter=TWO_PI * 300), Notch(TWO_PI * 77, 0.3), LowPass(TWO_PI * 300, 2)],
        "bandwidth",
    ),
}
DAMPED = Attenuation(TWO_PI * 11.1, TWO_PI * 11.35)
BEAM = {
    "a pair of poles": ([Notch(TWO_PI * 11.2, 0.3)], DAMPED),
    "and a low-pass": ([Notch(TWO_PI * 11.2, 0.3), LowPass(TWO_PI * 40, 2)], DAMPED),
    "two pairs": ([Notch(TWO_PI * 11.2, 0.3), Notch(TWO_PI * 22.5, 0.3)], DAMPED),
}
MIRROR = {
    "PI": ([PID()], "bandwidth"),
    "PI, low-pass": ([PID(), LowPass(TWO_PI * 300, 2)], "bandwidth"),
    "PI, two notches": ([PID(), Notch(TWO_PI * 636, 0.3), Notch(TWO_PI * 806, 0.3)], "bandwidth"),
    "PI, two notches, low-pass": (
        [PID(), Notch(TWO_PI * 636, 0.3), Notch(TWO_PI * 806, 0.3), LowPass(TWO_PI * 1500)],
        "bandwidth",
    ),
}


LAG = {"PI": ([PID()], "bandwidth"), "PID": ([PID(filter=150.0)], "bandwidth")}


def motor_benches():
    """Every second period, and the others: the last periods of these two by two."""
    from motor_torsion import PERIOD, torsion_record

    record = torsion_record()
    halves = [periods_of(record, PERIOD, slice(start, None, 2)) for start in (0, 1)]
    for k, name in enumerate(("even periods", "odd periods")):
        other = halves[1 - k]
        count = len(other.u) // PERIOD
        judges = {"all others": other} | {
            f"{first + 1} and {first + 2}": periods_of(other, PERIOD, slice(first, first + 2))
            for first in range(0, count - 1, 2)
        }
        train = rid.estimate_frf(halves[k], period=PERIOD)
        yield Machine(
            f"motor bench, {name}",
            banded(class_of(train)[0]),
            {label: rid.estimate_frf(one, period=PERIOD) for label, one in judges.items()},
            MOTOR,
            (0.3, 150.0),
        )


def beams():
    """Every second line; the others are not withheld records, but other lines of the same."""
    train, judge = beam_halves(FIRST)
    yield Machine("beam entry", banded(class_of(train)[0]), {"lines between": judge}, BEAM, (2.0, 60.0))


@functools.cache
def mirror_responses(volts):
    """Training records, bounded for the next one, and the block that is kept out."""
    name = {0.2: "fsm_200mV", 0.3: "fsm"}[volts]
    train, test = rid.datasets.load(f"{name}/train"), rid.datasets.load(f"{name}/test")
    return rid.estimate_frf(train, period=8192, about="next record"), rid.estimate_frf(test, period=8192)


def mirrors(cases=((0.3, 0),)):
    """Entries of the diagonal at an amplitude, from 0.8 Hz to 3 kHz; the class has as much gain as the lines need."""
    for volts, entry in cases:
        train, judge = (one.entry(entry, entry) for one in mirror_responses(volts))
        modes = rid.suggest_kautz(train.select(slice(None, None, THINNED)))
        basis = rid.kautz(modes.omega, modes.damping, dt=train.dt, delay=modes.delay)
        gain = 2 * float(np.median(np.abs(train.values)))
        while True:
            problem = rid.MixedProblem(
                frequency=train.select(slice(None, None, LINES)),
                prior=rid.Prior(gain_bound=gain, decay_rate=1.1),
                parametric=basis,
            )
            if rid.identify(problem).consistent:
                break
            gain *= 1.5
        name = f"mirror ({entry + 1}, {entry + 1}), {1000 * volts:g} mV"
        yield Machine(name, banded(problem), {"block kept out": judge}, MIRROR, (1.0, 1500.0))


def lags():
    """A lag with a delay, simulated: 30 lines whose bounds are a fifth of their size, values as they are."""
    omega, dt = np.linspace(3.0, 310.0, 30), 0.01
    z = np.exp(1j * omega * dt)
    plant = control.ss(control.tf([0.1], [1, -0.9, 0], dt))
    values = 0.1 / (z * (z - 0.9))
    frf = rid.FrequencyResponse(omega, values, bound=0.2 * np.abs(values) + 0.002, dt=dt)
    problem = rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=1.6, decay_rate=1.03))
    yield Machine("simulated lag", rid.band(problem, model=plant), {}, LAG, (0.05, 30.0))


# ------------------------------------------------------------------------------------------------------------- other bands


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class BandOfArcs(Band):
    """The same band with other bounds on the whole axis: those are all that a design and its proof take of it."""

    arcs: CircleBound

    @property
    def circle(self):
        """The bounds on the whole axis."""
        return self.arcs


def with_arcs(band, edges, bound, sets=None):
    """The band with the bounds of arcs in place of its own."""
    given = {one.name: getattr(band, one.name) for one in dataclasses.fields(Band) if one.init}
    return BandOfArcs(**given, arcs=CircleBound(edges, bound, 0.0, True, (), sets=sets))


def with_corners(band, count=12, narrow=0.4):
    """The band with polygons on every arc, about ellipses in its discs: drawn, not solved, for times alone."""
    circle = band.circle
    middle = (circle.edges[1:] + circle.edges[:-1]) / 2
    along = np.angle(values_of(band.model, middle))[:, None]
    theta, sets = 2 * np.pi * np.arange(count) / count, circle.sets
    reach = np.hypot(np.cos(theta - along), narrow * np.sin(theta - along)) * sets.radius[:, 0]
    supports = (sets.centre[:, 0] * np.exp(-1j * theta)).real + reach
    held = ErrorSets.of_supports(sets.bound, sets.centre, sets.radius, supports)
    return with_arcs(band, circle.edges, circle.bound, held)


def of_weight(band, order=None):
    """The band with |W| as its bound, W the stable weight of an order above it on the whole axis; and W."""
    weight, edges = band.weight(order=order), band.circle.edges
    parts = np.linspace(0, 1, PARTS, endpoint=False)
    fine = np.append((edges[:-1, None] + np.diff(edges)[:, None] * parts).ravel(), edges[-1])
    size = np.abs(weight.model(np.exp(1j * fine * weight.model.dt)))
    own = np.repeat(band.circle.bound, PARTS)
    return with_arcs(band, fine, np.maximum(np.maximum(size[1:], size[:-1]), own)), weight


def of_nominal(band):
    """The band with no width: its model alone."""
    edges, size = band.circle.edges, np.abs(band.nominal).max()
    return with_arcs(band, edges, np.full(edges.size - 1, NOTHING * size))
