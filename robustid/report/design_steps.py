"""Steps of the loop of a designed controller: with the plants of the models, in the range of every consistent plant."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg

from robustid.controllers import ControllerDesign
from robustid.core import Real, Signal, StateMatrices, closed_loop, decay_of, poles_of, simulate
from robustid.errors import InputError
from robustid.guarantees import STEPS, LoopBounds, StepTube, settled, step_tube
from robustid.identification import as_system
from robustid.report.charts import BAND, FURTHER, NOMINAL, Axis, Chart, Layer, Panel
from robustid.report.design_charts import proofs_of
from robustid.report.document import Block, Drawing, Facts, Heading, Text
from robustid.report.words import at_most

_NARROWER = "rid.guarantee.step_tube(proof, identification=result)"
_SAMPLES = 2000  # of a step in continuous time
_SETTLED = 5.0  # time constants of the slowest pole
_PERIODS = 40.0  # of the fastest pole, at most


def steps_section(design: ControllerDesign) -> list[Block]:
    """Steps with the plants of the models, in the range of every consistent plant where one is proved."""
    found = [step_tubes(one) for one in design.proofs]
    reason = next((why for _, why in found if why), "")
    words = "With the plant of the model of the band, in the range of every consistent plant, which is proved at every sample:"
    words += " phases of errors at different frequencies count as independent, so that single plants come to about half of it."
    words += f" It follows from the discs of the band. {_NARROWER} bounds it in the class of the plant too, and keeps the narrower"
    words += " of both at every sample, above all where the response has settled."
    if reason:
        words = f"With the plant of the model of the band alone: no range of other plants is proved, since {reason}."
    rows = [(f", band {k}" * (len(found) > 1), tubes) for k, (tubes, _) in enumerate(found, start=1) if tubes]
    facts = [(f"{name}{own}", text) for own, tubes in rows for name, text in _tube_rows(tubes)]
    drawn = Drawing(step_chart(design, [tubes for tubes, _ in found]))
    return [
        Heading("Steps of the loop", guarantee=not reason),
        Text(words, "soft", code=() if reason else (_NARROWER,)),
        *([Facts(facts)] if facts else []),
        drawn,
    ]


def _tube_rows(tubes: Sequence[StepTube]) -> list[tuple[str, str]]:
    """Numbers that no consistent plant exceeds."""
    step, load = tubes
    output, input_ = (signals[0] for signals in _signals(step.bounds))
    size = f"{at_most(load.overshoot)} {output.unit}".rstrip()
    return [
        ("Overshoot", f"at most {at_most(100 * step.overshoot)} % of the set point, with every consistent plant"),
        ("After a load", f"{output.name} at most {size}, {_stepped(input_)} at the input, with every consistent plant"),
    ]


def _signals(bounds: LoopBounds) -> tuple[Sequence[Signal], Sequence[Signal]]:
    """Outputs and inputs of the plant."""
    return bounds.band.problem.outputs, bounds.band.problem.inputs


def _stepped(signal: Signal) -> str:
    return f"step of {' '.join(('1', signal.unit)).rstrip()}"


def step_chart(design: ControllerDesign, tubes: Sequence[Sequence[StepTube]] | None = None) -> Chart:
    """Steps of the loop with the plant of the model of each band: of the set point, and of a disturbance at the input.

    With the range of every consistent plant, where one is proved; `tubes`: those of every band, where they are known.
    """
    known = [step_tubes(one)[0] for one in proofs_of(design)] if tubes is None else tubes
    colours = (NOMINAL, *FURTHER)
    panels: list[list[Layer]] = [[], [], []]
    for k, one in enumerate(proofs_of(design)):
        own = "" if len(design.proofs) == 1 else f" of band {k + 1}"
        t, answers = _steps(one)
        for layers, tube in zip(panels[::2], known[k], strict=False):
            name, low, high = f"range of every consistent plant{own}", tube.lower, tube.upper
            shade = colours[k % len(colours)] if k else BAND
            layers.append(Layer(name, tube.times, tube.nominal, shade, low=low, high=high, fill=True))
        for layers, y in zip(panels, answers, strict=True):
            layers.append(Layer(f"plant of the model{own}", t, y, colours[k % len(colours)], dash="solid"))
    time = Axis("time [s]")
    titles = "Step of the set point", "The same: what the controller gives", "Step of a disturbance at the input"
    output, input_ = (signals[0] for signals in _signals(design.proofs[0]))
    first, second = f"after a {_stepped(output)}", f"after a {_stepped(input_)}"
    labels = f"{output},\n{first}", f"{input_},\n{first}", f"{output},\n{second}"
    drawn = [
        Panel(title, time, Axis(label), layers) for title, label, layers in zip(titles, labels, panels, strict=True)
    ]
    return Chart("steps", drawn, linked=True)


def step_tubes(bounds: LoopBounds) -> tuple[list[StepTube], str]:
    """Ranges of the steps of all consistent plants, of the set point and of a load, or the reason for which there are none."""
    try:
        return [step_tube(bounds, of) for of in STEPS], ""
    except InputError as error:
        return [], str(error)


def _steps(bounds: LoopBounds) -> tuple[Real, tuple[Real, Real, Real]]:
    """Times; output and input after a step of the set point, u = C (r - y); output after a step at the input of the plant."""
    model, dt = bounds.band.model, bounds.loop.dt
    if model is None:
        raise InputError("`result` is of a band without a model; there is no loop to simulate")
    plant = StateMatrices.of(bounds.loop.plant_of(model))
    loop = closed_loop(plant, as_system("controller", bounds.controller)[0])
    h, count = _time_of(loop, dt)
    if not dt:
        n = len(loop.A)
        whole = scipy.linalg.expm(h * np.block([[loop.A, loop.B], [np.zeros((2, n + 2))]]))
        loop = loop._replace(A=whole[:n, :n], B=whole[:n, n:])
    u = np.zeros((count, 2))
    u[:, 1] = -1.0  # the set point stands where a disturbance at the output does, with the other sign: y - r
    error = simulate(loop, u)[0]
    disturbed = simulate(loop, u[:, ::-1] * -1.0)[0]
    t: Real = h * np.arange(count, dtype=float)
    return t, (1 + error[:, 1], error[:, 0], disturbed[:, 1])


def _time_of(loop: StateMatrices, dt: float) -> tuple[float, int]:
    """Time step and number of samples: until the slowest pole has settled, within reason."""
    poles = poles_of(loop.A)
    if dt:
        return dt, settled(poles, dt)
    slowest, fastest = decay_of(poles, dt), float(np.abs(poles).max(initial=1.0))
    end = min(_SETTLED / slowest, _PERIODS * _SAMPLES / fastest) if slowest > 0 else _SETTLED / fastest
    return end / _SAMPLES, _SAMPLES
