"""Steps of the loop of a designed controller: with the plants of the models, in the range of every consistent plant."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

import numpy as np
import scipy.linalg

from robustid.controllers import ControllerDesign
from robustid.core import Real, Signal, StateMatrices, closed_loop, decay_of, poles_of, simulate
from robustid.errors import InputError
from robustid.guarantees import STEPS, LoopBounds, StepTube, settled
from robustid.guarantees import step_tubes as loop_step_tubes
from robustid.identification import as_system
from robustid.report.charts import BAND, FURTHER, NOMINAL, Axis, Chart, Layer, Panel, lighter, side_by_side
from robustid.report.design_charts import proofs_of
from robustid.report.document import Block, Drawing, Facts, Grid, Heading, Text
from robustid.report.words import at_most

_NARROWER = "rid.guarantee.step_tube(proof, identification=result)"
_SAMPLES = 2000  # of a step in continuous time
_SETTLED = 5.0  # time constants of the slowest pole
_PERIODS = 40.0  # of the fastest pole, at most
_AT = dict(zip(STEPS, ("of", "at"), strict=True))

Tubes = Mapping[tuple[str, int, int], StepTube]  # by what steps, output and set point or input


def steps_section(design: ControllerDesign) -> list[Block]:
    """Steps with the plants of the models, in the range of every consistent plant where one is proved; of a matrix each entry."""
    found = [step_tubes(one) for one in design.proofs]
    single = design.proofs[0].loop.shape == (1, 1)
    reason = next((why for _, why in found if why), "")
    words = "With the plant of the model of the band, in the range of every consistent plant, which is proved at every sample:"
    words += " phases of errors at different frequencies count as independent, so that single plants come to about half of it."
    words += " It follows from the discs of the band."
    if single:
        words += f" {_NARROWER} bounds it in the class of the plant too, and keeps the narrower of both at every sample, above all"
        words += " where the response has settled."
    if reason:
        words = f"With the plant of the model of the band alone: no range of other plants is proved, since {reason}."
    rows = [(f", band {k}" * (len(found) > 1), tubes) for k, (tubes, _) in enumerate(found, start=1) if tubes]
    told = _tube_rows if single else _matrix_rows
    facts = [(f"{name}{own}", text) for own, tubes in rows for name, text in told(tubes)]
    known = [tubes for tubes, _ in found]
    nu, ny = design.proofs[0].loop.shape
    grids = [Grid(lighter(entry_charts(design, known, of)), ny if of == STEPS[0] else nu) for of in STEPS]
    return [
        Heading("Steps of the loop", guarantee=not reason),
        Text(words, "soft", code=() if reason or not single else (_NARROWER,)),
        *([Facts(facts)] if facts else []),
        *([Drawing(step_chart(design, known))] if single else grids),
    ]


def _tube_rows(tubes: Tubes) -> list[tuple[str, str]]:
    """Numbers that no consistent plant exceeds."""
    step, load = (tubes[of, 0, 0] for of in STEPS)
    output, input_ = (signals[0] for signals in _signals(step.bounds))
    return [
        ("Overshoot", f"at most {at_most(100 * step.overshoot)} % of the set point, with every consistent plant"),
        ("After a load", f"{_far(output, load)}, {_stepped(input_)} at the input, with every consistent plant"),
    ]


def _matrix_rows(tubes: Tubes) -> list[tuple[str, str]]:
    """The same of every output: after its own set point, and after the other one and the input that move it most."""
    outputs, inputs = _signals(next(iter(tubes.values())).bounds)
    found: list[tuple[str, str]] = []
    for i, output in enumerate(outputs):
        own = tubes[STEPS[0], i, i].overshoot
        found.append((f"Overshoot of {output.name}", f"at most {at_most(100 * own)} % of its set point"))
        for of, signals in zip(STEPS, (outputs, inputs), strict=True):
            others = [j for j in range(len(signals)) if (of, i, j) != (STEPS[0], i, i)]
            if others:
                worst = max(others, key=lambda j: tubes[of, i, j].overshoot)
                far, place = _far(output, tubes[of, i, worst]), signals[worst].name
                found.append((f"After a {of} {_AT[of]} {place}", f"{far}, {_stepped(signals[worst])}"))
    return found


def _far(output: Signal, tube: StepTube) -> str:
    """Largest size of an output, in words."""
    return f"{output.name} at most {at_most(tube.overshoot)} {output.unit}".rstrip()


def _signals(bounds: LoopBounds) -> tuple[Sequence[Signal], Sequence[Signal]]:
    """Outputs and inputs of the plant."""
    return bounds.band.problem.outputs, bounds.band.problem.inputs


def _stepped(signal: Signal) -> str:
    return f"step of {' '.join(('1', signal.unit)).rstrip()}"


def step_chart(design: ControllerDesign, tubes: Sequence[Tubes] | None = None) -> Chart:
    """Steps of the loop with the plant of the model of each band: of the set point, and of a disturbance at the input.

    With the range of every consistent plant, where one is proved; `tubes`: those of every band, where they are known. Of a matrix
    an output has a row, with all set points and all inputs.
    """
    known = [step_tubes(one)[0] for one in proofs_of(design)] if tubes is None else tubes
    nu, ny = proofs_of(design)[0].loop.shape
    if (nu, ny) != (1, 1):
        first, second = (entry_charts(design, known, of) for of in STEPS)
        rows = [chart for i in range(ny) for chart in (*first[ny * i : ny * (i + 1)], *second[nu * i : nu * (i + 1)])]
        return side_by_side("steps", rows, nu + ny)
    drawn = [chart.panels[0] for of in STEPS for chart in entry_charts(design, known, of)]
    output, input_ = (signals[0] for signals in _signals(design.proofs[0]))
    given = [
        Layer(f"plant of the model{own}", *_steps(one, (0, 1)), colour, dash="solid")
        for one, own, colour in _bands(design)
    ]
    label = f"{input_},\nafter a {_stepped(output)}"
    drawn.insert(1, Panel("The same: what the controller gives", drawn[0].x, Axis(label), given))
    return Chart("steps", drawn, linked=True)


def entry_charts(design: ControllerDesign, tubes: Sequence[Tubes], of: str) -> list[Chart]:
    """Steps of every output after one of each set point, or at each input ("load"), row by row."""
    nu, ny = design.proofs[0].loop.shape
    outputs, inputs = _signals(design.proofs[0])
    signals: Sequence[Signal] = outputs if of == STEPS[0] else inputs
    before = nu if of == STEPS[0] else 0
    found: list[Chart] = []
    for i, j in itertools.product(range(ny), range(len(signals))):
        layers: list[Layer] = []
        for (_, own, colour), known in zip(_bands(design), tubes, strict=True):
            tube = known.get((of, i, j))
            if tube is not None:
                name, shade = f"range of every consistent plant{own}", BAND if colour == NOMINAL else colour
                layers.append(Layer(name, tube.times, tube.nominal, shade, low=tube.lower, high=tube.upper, fill=True))
        for one, own, colour in _bands(design):
            layers.append(Layer(f"plant of the model{own}", *_steps(one, (nu + i, before + j)), colour, dash="solid"))
        where = "set point" if of == STEPS[0] else "disturbance at the input"
        several = (nu, ny) != (1, 1)
        title = (
            f"{outputs[i].name}, {of} of {signals[j].name}"
            if several
            else f"Step of {'the' if before else 'a'} {where}"
        )
        y = Axis(f"{outputs[i]},\nafter a {_stepped(signals[j])}")
        found.append(Chart(f"steps-{of.replace(' ', '-')}-{i}-{j}", [Panel(title, Axis("time [s]"), y, layers)]))
    return found


def _bands(design: ControllerDesign) -> list[tuple[LoopBounds, str, str]]:
    """Proofs with the words that name their bands, and colours."""
    colours, several = (NOMINAL, *FURTHER), len(design.proofs) > 1
    return [(one, f" of band {k + 1}" * several, colours[k % len(colours)]) for k, one in enumerate(proofs_of(design))]


def step_tubes(bounds: LoopBounds) -> tuple[Tubes, str]:
    """Ranges of the steps of all consistent plants, by what steps, output and input, or the reason for which there are none."""
    try:
        return loop_step_tubes(bounds), ""
    except InputError as error:
        return {}, str(error)


def _steps(bounds: LoopBounds, entry: tuple[int, int]) -> tuple[Real, Real]:
    """Times, and one of the inputs and outputs of the plant after a step of 1 at one of the inputs or set points, u = C (r - y)."""
    model, dt = bounds.band.model, bounds.loop.dt
    if model is None:
        raise InputError("`result` is of a band without a model; there is no loop to simulate")
    plant = StateMatrices.of(bounds.loop.plant_of(model))
    loop = closed_loop(plant, as_system("controller", bounds.controller)[0])
    h, count = _time_of(loop, dt)
    nu, ny = bounds.loop.shape
    row, column = entry
    if not dt:
        n = len(loop.A)
        whole = scipy.linalg.expm(h * np.block([[loop.A, loop.B], [np.zeros((nu + ny, n + nu + ny))]]))
        loop = loop._replace(A=whole[:n, :n], B=whole[:n, n:])
    u = np.zeros((count, nu + ny))
    u[:, column] = 1.0 if column < nu else -1.0  # a set point stands where a disturbance at the output does: y - r
    answer = simulate(loop, u)[0][:, row]
    t: Real = h * np.arange(count, dtype=float)
    return t, answer + float(row == column >= nu)


def _time_of(loop: StateMatrices, dt: float) -> tuple[float, int]:
    """Time step and number of samples: until the slowest pole has settled, within reason."""
    poles = poles_of(loop.A)
    if dt:
        return dt, settled(poles, dt)
    slowest, fastest = decay_of(poles, dt), float(np.abs(poles).max(initial=1.0))
    end = min(_SETTLED / slowest, _PERIODS * _SAMPLES / fastest) if slowest > 0 else _SETTLED / fastest
    return end / _SAMPLES, _SAMPLES
