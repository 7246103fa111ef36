"""Names and units of an identification, the models to be drawn of it, and their frequencies: shared by its sections."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, TypedDict, cast

import numpy as np

from robustid.core import (
    Complex,
    Real,
    StateMatrices,
    Unfinished,
    as_kind,
    fingerprint,
    kept_by_content,
    points_of,
    response_at,
    series_at,
)
from robustid.data import FrequencyResponse
from robustid.errors import InputError, InputTypeError
from robustid.guarantees import Sample, WorstCaseError, WorstCaseOverPoles, narrow_band
from robustid.identification import Identification, MixedProblem, Residual, check_model
from robustid.report.charts import NOMINAL, Axis, further
from robustid.report.curves import resolved
from robustid.report.words import HZ, matrix_unit_label, unit_label, units

if TYPE_CHECKING:
    import control

    from robustid.advice import Content, Diagnosis, Sensitivity
    from robustid.controllers import ControllerDesign, Improvement
    from robustid.data import TimeRecord, Undoing
    from robustid.fitting import OrderSweep
    from robustid.guarantees import Band, Coverage, LoopBounds, ResponseTube, RobustStabilityMargin, StructuredWeight
    from robustid.reduction import ModelWorth, PlantReduction, Reduction

Models = Any  # by names, one, or several
Bounded = WorstCaseError | WorstCaseOverPoles
DIRECTIONS = "combinations of outputs / combinations of inputs"
_GRID = 800  # points of a response, evenly spaced in log frequency
_AROUND = np.linspace(-1.55, 1.55, 61)  # phases across a light resonance
_NOWHERE = np.zeros(0)
_KEPT = 1000  # states of a model whose response is kept for the next chart


class Parts(TypedDict, total=False):
    """Everything that can stand beside a result on its page, under the names that `write_report` describes; None: nothing."""

    reduction: Reduction | None
    models: Mapping[str, control.StateSpace] | None
    worst_case: WorstCaseError | None
    tube: ResponseTube | None
    over_poles: WorstCaseOverPoles | None
    stability: RobustStabilityMargin | Mapping[str, RobustStabilityMargin] | None
    weights: StructuredWeight | Sequence[StructuredWeight] | None
    sensitivity: Sensitivity | Sequence[Improvement] | None
    data: FrequencyResponse | None
    order_sweep: OrderSweep | None
    records: TimeRecord | Sequence[TimeRecord] | None
    findings: Sequence[str]
    withheld: Coverage | None
    content: Content | None
    worth: ModelWorth | None
    diagnosis: Diagnosis | None
    run_file: str | None
    band: Band | None
    unfinished: Unfinished | None
    undoing: Undoing | None
    steps: Sequence[tuple[str, str]]
    loop: LoopBounds | None
    plant: PlantReduction | None
    candidates: Mapping[str, LoopBounds] | None
    design: ControllerDesign | None
    forbidden: tuple[float, float] | None
    independent: Mapping[str, bool] | None


class Posed(Protocol):
    """Result about a problem: an identification, or what was found without one."""

    @property
    def problem(self) -> MixedProblem:
        """The problem."""
        ...


def siso(identification: Posed) -> bool:
    """Return whether there is one input and one output."""
    return len(identification.problem.outputs) == len(identification.problem.inputs) == 1


def unit(identification: Posed) -> str:
    """Unit of the transfer function, "mm/N"; empty where neither signal has one, or entries have different ones."""
    found = units(identification.problem.outputs, identification.problem.inputs)
    return found.pop() if len(found) == 1 else ""


def entry_unit(identification: Posed, output: int, input_: int) -> str:
    """Unit of an entry in brackets, after a space; empty where neither signal has one."""
    return unit_label(identification.problem.outputs[output].unit, identification.problem.inputs[input_].unit)


def in_unit(text: str, identification: Posed) -> str:
    """A number with the unit of the transfer function."""
    return f"{text} {unit(identification)}".rstrip()


def about(identification: Posed) -> str:
    """Sentences on what a guarantee is about: data with a fault; mean or next record, one excitation or several; often empty."""
    problem = identification.problem
    faulty = "The data have a fault that nothing has undone: this is about them, not about the machine. "
    return faulty * bool(problem.open_faults) + "".join(f"{sentence} " for sentence in problem.about)


def scope(identification: Posed) -> str:
    """Words that a headline ends with where the data are of one excitation, or have a fault; empty else."""
    return identification.problem.scope


def mixed(identification: Identification) -> bool:
    """Return whether the entries have different units."""
    return len(units(identification.problem.outputs, identification.problem.inputs)) > 1


def sigma_unit(identification: Posed) -> str:
    """Unit of singular values, in brackets."""
    return matrix_unit_label(identification.problem.outputs, identification.problem.inputs)


def transfer(identification: Posed, output: int = 0, input_: int = 0) -> str:
    """Name of an entry of the transfer function, "displacement [mm] / force [N]"."""
    problem = identification.problem
    return f"{problem.outputs[output]} / {problem.inputs[input_]}"


def where(identification: Identification, residual: Residual) -> str:
    """Name the entry of the response, or the output of a record, that residuals are about."""
    problem, (output, input_) = identification.problem, residual.entry
    if residual.kind == "time":
        return str(problem.outputs[output or 0])
    if output is not None and input_ is not None:
        return transfer(identification, output, input_)
    if input_ is not None:
        return f"all outputs / {problem.inputs[input_]}, one bound"
    if isinstance(problem.frequency[residual.index], FrequencyResponse):
        return "all entries, one bound"
    return DIRECTIONS


def started(record: TimeRecord) -> str:
    """Say how a time record begins."""
    words = {
        "rest": "from zero initial conditions",
        "free": "from an unknown state",
        "periodic": "in periodic steady state",
    }
    return words[record.initial]


def sample_words(identification: Identification, sample: Sample) -> str:
    """Name a sample by its experiment, which has a number where there are several: "response at 13 Hz", "record 2 at 3 s"."""
    return f"{experiment_words(identification, sample.kind, sample.experiment)} {sample.place}"


def experiment_words(identification: Identification, kind: str, index: int) -> str:
    """Name an experiment, with a number where there are several of its kind."""
    problem = identification.problem
    words, given = ("response", problem.frequency) if kind == "frequency" else ("record", problem.time)
    return f"{words} {index + 1}" if len(given) > 1 else words


def numbered(text: str, index: int, count: int) -> str:
    """The text, with a number where there are several such things."""
    return f"{text} ({index + 1})" if count > 1 else text


class Shown(NamedTuple):
    """A model to be drawn, under its name and with its looks."""

    name: str
    model: control.StateSpace
    colour: str
    dash: str
    marker: str


def shown_models(identification: Identification, models: Models = None) -> list[Shown]:
    """The nominal model and the further ones."""
    out = [Shown(f"nominal model, order {identification.order}", identification.model, NOMINAL, "solid", "circle")]
    return out + other_models(models, identification.problem)


class HasSignals(Protocol):
    """Data, or a problem, with which a model must agree."""

    @property
    def outputs(self) -> Any:
        """Signals."""
        ...

    @property
    def inputs(self) -> Any:
        """Signals."""
        ...

    @property
    def dt(self) -> float | None:
        """Sample time in s; None for continuous time."""
        ...


def other_models(models: Models, data: HasSignals) -> list[Shown]:
    """Further models with their looks, each with the signals and the time base of the data."""
    found = models_by_name(models).items()
    return [
        Shown(name, checked_model(f"models[{name!r}]", one, data), *further(k)) for k, (name, one) in enumerate(found)
    ]


def models_by_name(models: Models) -> dict[str, object]:
    """Return models by their names; one, or several in a sequence, get names."""
    if models is None:
        return {}
    if isinstance(models, list | tuple):
        return {f"model {k}": one for k, one in enumerate(cast("Sequence[object]", models), start=1)}
    if isinstance(models, str):
        raise InputTypeError(f"`models` must be models, by names, in a list or one; got {models!r}")
    several = isinstance(models, Mapping)
    return by_name("models", cast("object", models), "map names to models") if several else {"model": models}


def by_name(argument: str, things: object, wanted: str) -> dict[str, object]:
    """Return what is mapped from names; refuse everything else, with what is `wanted`."""
    if not isinstance(things, Mapping):
        raise InputTypeError(f"`{argument}` must {wanted}; got {type(things).__name__}")
    found: dict[str, object] = {}
    for name, thing in cast("Mapping[object, object]", things).items():
        if not isinstance(name, str):
            raise InputTypeError(f"`{argument}` must have text as names; got {name!r}")
        found[name] = thing
    return found


def checked_model(name: str, model: object, data: HasSignals) -> control.StateSpace:
    """Return the model, if it has the signals and the time base of the data."""
    system, dt = check_model(name, model), data.dt or 0.0
    p, q = len(data.outputs), len(data.inputs)
    if (system.noutputs, system.ninputs) != (p, q):
        raise InputError(
            f"`{name}` must have {p} output{'s' * (p > 1)} and {q} input{'s' * (q > 1)}; got {system.noutputs} and"
            f" {system.ninputs}"
        )
    if system.nstates and not dt and system.dt != 0:
        raise InputError(f"`{name}` must be continuous, as the data; got dt = {system.dt}")
    if system.nstates and (system.dt is True or abs(system.dt - dt) > 1e-9 * dt):
        raise InputError(
            f"`{name}` must be discrete with dt = {dt:g} s, as the data; got dt = {system.dt}."
            f" Sample it first: control.sample_system(model, {dt:g})"
        )
    return system


def further_models(reduction: Reduction | None, models: Models) -> dict[str, control.StateSpace]:
    """The reduced model under its name, and the other ones."""
    out: dict[str, control.StateSpace] = {}
    if reduction is not None:
        out[f"reduced model, order {reduction.order}"] = reduction.model
    return out | {name: check_model(f"models[{name!r}]", one) for name, one in models_by_name(models).items()}


def band(problem: MixedProblem) -> tuple[float, float]:
    """From below the lowest frequency point (or 1/length of the longest record) to the Nyquist frequency, rad/s.

    In continuous time to twice the highest frequency point; around frequency points on less than an octave as far as they go.
    """
    if near := narrow_band(problem):
        return near
    points = problem.plane.omega(problem.angles[problem.angles > 0])
    high = problem.plane.top if problem.dt else 2 * float(points.max(initial=0.0)) or 1.0
    starts = [points.min()] if points.size else [2 * high / max(t.u.shape[0], 2) for t in problem.time]
    return min([*starts, high / 4]) / 2, high


def shown_band(identification: Posed, omega: np.ndarray = _NOWHERE) -> tuple[float, float]:
    """The `band` of the data, down to the lowest of further frequencies and up to the highest, rad/s."""
    low, high = band(identification.problem)
    return min([low, *omega[omega > 0].tolist()]), max([high, *omega.tolist()])


def hertz(problem: MixedProblem, low: float, high: float) -> Axis:
    """The frequency axis; a logarithmic one has no 0, so that samples there are put at its left end and this is said.

    Within an octave it is linear.
    """
    at_zero = bool(problem.angles.size) and problem.angles[0] == 0
    note = " (samples at 0 Hz are drawn at the left end)" if at_zero else ""
    return Axis(f"frequency [Hz]{note}", log=high > 2 * low, range=(low / HZ, high / HZ))


def responses(
    models: Sequence[control.StateSpace], problem: MixedProblem, ends: tuple[float, float], wanted: np.ndarray
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Frequencies in rad/s that resolve every model, the `wanted` ones among them, and the response (F, ny, nu) of each model."""
    omega = _grid(models, problem, *ends, wanted)
    step = np.array([problem.dt or 0.0])
    return omega, [_response(*StateMatrices.of(model), omega, step) for model in models]


@kept_by_content(most=_KEPT, results=4)
def _response(A: Real, B: Real, C: Real, D: Real, omega: Real, step: Real) -> Complex:
    """The response at frequencies in rad/s, read-only, of a model with a sample time, 0 in continuous time.

    The first screen and two sections draw the same curves.
    """
    dt = float(step[0])
    system = A, B, C, D
    values = series_at(system, points_of(-omega, dt)) if dt else response_at(system, points_of(omega, None))
    values.setflags(write=False)
    return values


def _grid(
    models: Sequence[control.StateSpace], problem: MixedProblem, low: float, high: float, wanted: np.ndarray
) -> np.ndarray:
    """Log-spaced, the points of the data, wanted ones, and as many around each light pole as its resonance needs."""
    base = np.geomspace(low, high, _GRID)
    step = base[1] / base[0] - 1
    every = np.concatenate([base, wanted, problem.plane.omega(problem.angles[problem.angles > 0])])
    poles: Complex = np.concatenate([model.poles() for model in models]).astype(complex)
    s: Complex = problem.plane.exponents(poles[np.abs(poles) > 0]) if problem.dt else poles
    light = s[np.abs(s.real) < 4 * step * s.imag]
    return resolved(every, light, _AROUND, low, high)


def checked(
    name: str, value: Bounded | ResponseTube, kind: type, function: str, identification: Identification
) -> None:
    """Refuse an argument that isn't of its kind, or isn't about this identification or a copy of it (loaded, say)."""
    as_kind(name, value, kind, f"a {kind.__name__}, from {function}()")
    if not same(value.identification, identification):
        raise InputError(
            f"`{name}` is about another identification than the one reported; give {name}.identification, or compute"
            f" {function}(identification)"
        )


def same(one: Identification, other: Identification) -> bool:
    """Return whether both are one result, as two that were loaded from its files are."""
    return one is other or _numbers(one) == _numbers(other)


def _numbers(result: Identification) -> str:
    return fingerprint((result.problem, result.claim, result.coefficients, result.scaled_parameters))


def bounded_model(
    identification: Identification, model: control.StateSpace
) -> tuple[str, dict[str, control.StateSpace]]:
    """Name of the model that errors are measured from, and the model under it where it is not the nominal one or its copy."""
    name, own = shown_models(identification)[0][:2]
    if all(np.array_equal(getattr(model, part), getattr(own, part)) for part in "ABCD"):
        return name, {}
    name = f"model, order {model.nstates}"
    return name, {name: model}


def model_size(bounded: Bounded | Band) -> np.ndarray:
    """Size of the response of the model that is bounded, (F,): its largest singular value."""
    return np.linalg.norm(bounded.nominal.reshape(bounded.upper.shape), 2, axis=(1, 2))


def error_label(identification: Posed) -> str:
    """Label of an axis of errors, of matrices their largest singular value."""
    if siso(identification):
        return f"error |F − model| of\n{transfer(identification)}"
    return f"σmax(F − model)\n{sigma_unit(identification).strip()}".strip()
