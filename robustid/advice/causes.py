"""Causes of a contradiction, or of data that no class can be blamed for: what was tried, what shows it, the change to make."""

from __future__ import annotations

import dataclasses
import enum
import logging
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robustid.bases import ParametricBasis, as_basis, kautz
from robustid.core import Budget, Complex, Plane, Real, Source
from robustid.data import Fault, FrequencyResponse
from robustid.errors import InputError, SizeError
from robustid.estimation import MISTAKES, correct, response_faults
from robustid.identification import Identification, MixedProblem
from robustid.identification.formulation import formulate
from robustid.identification.solver import margin_path

_log = logging.getLogger(__name__)

_DIGITS = 1e-3  # relative gap at which the margin of a trial is taken
HELPS = 3.0  # a correction that makes the margin so many times smaller is a cause
# Coefficients above which corrections are tried with so many frequency points of each response.
_MOST, _POINTS = 100, 30
_SAME_POLE = 1e-2  # of the distance to the circle: eigenvalue routines split repeated poles, by far less
_SPARE = 1.1  # of bounds that are widened
_OF_UNITS = 300.0
_IN_PER_CENT = 0.1  # damping ratios from here on may be in per cent
_AS_UNITS = ", as where values are in a unit 1000 times smaller than their bound"
_AS_SAMPLED = (
    "; so it is, too, where a sampled response is taken for one of continuous time: then state its sample time"
)
_KNOWN = (
    "state the modes that you know, or a gain bound and a decay; or measure longer, so that several lines lie in every resonance, a"
    " plant that does not change meanwhile; of a plant that only its controller holds, state that controller ([loop] in a run file)"
)
# Kind of the data, number of the experiment, rad/s or s, and dual weight of an active constraint.
Active = tuple[str, int, float, float]
SLIGHTLY = 1.5  # margin up to which bounds are the first suspicion

_UNIT = "times 0.001"
_SHORT_OF_UNIT = "times 0.03"
_SMALLER = 0.5
_FEWEST = 10  # samples that can tell corrections apart

# Corrections of a response beside records, or within a passive class; then those that the response alone contradicts.
_AGAINST = ("negate", "exchange", "times 0.001", "times 1000", "times 0.5", "times 2", "times 57.29578", "times 0.017453293",
            "times 1e-06", "times 1e+06")  # fmt: skip
_FIRST = ("conjugate", "transpose")
_ALONE = ("frequency in Hz", "frequency in rad/s", "frequency times 1000", "phase in radians", "advance 1", "delay 1", "integrate",
          "differentiate", "integrate twice", "magnitude linear")  # fmt: skip
_OF_RECORDS = (
    ("negate", "the outputs of the record have the opposite sign"),
    ("exchange", "input and output of the record are exchanged"),
    ("advance 1", "the outputs of the record come one sample late"),
    ("delay 1", "the outputs of the record come one sample early"),
)
_STARTS = (
    ("periodic", "the record is in periodic steady state, and was taken to start at rest"),
    ("free", "the record doesn't start at rest: what went in before still shows"),
)
_OF_MODES = (
    (2 * math.pi, 1.0, "the frequencies of the modes are in Hz and were taken as rad/s"),
    (1 / (2 * math.pi), 1.0, "the frequencies of the modes are in rad/s and were taken as Hz"),
    (1.0, 0.01, "the damping of the modes is in per cent and was taken as a ratio"),
)


class Kind(enum.IntEnum):
    """Kind of a correction, the most likely cause first: more modes can be tested by the data.

    A larger class only asks less of them.
    """

    DATA = enum.auto()  # the response with another phase or sign, or its derivative or integral
    MODE = enum.auto()  # one more
    POLES = enum.auto()  # elsewhere, repeated, or at z = 1
    INTERVALS = enum.auto()  # of the coefficients
    DECAY = enum.auto()
    OTHER = enum.auto()


class Cause(NamedTuple):
    """A possible cause of an inconsistency, with its correction.

    Attributes
    ----------
    cause : str
        In words.
    change, option : str
        The correction in Python and for the program; "" where there is none.
    problem : MixedProblem
        With the correction; as it was posed where nothing here can make it.
    kind : Kind
    name : str
        Of the correction, in a list of what other classes would bring.
    evidence : str
        What shows the cause.
    margin : float or None
        With the correction, reached by a system to 0.1 %; None where it was not computed.
    unsure : bool
        Whether it could as well be a class that is too small.
    """

    cause: str
    change: str
    option: str
    problem: MixedProblem
    kind: Kind = Kind.DATA
    name: str = ""
    evidence: str = ""
    margin: float | None = None
    unsure: bool = False

    @property
    def solves(self) -> bool:
        """True where the data are consistent with the change."""
        return self.margin is not None and self.margin <= 1

    @property
    def sentence(self) -> str:
        """The change to make."""
        return self.change + (f"; for the program: {self.option}" if self.option else "")


def corrected(problem: MixedProblem, *corrections: str, records: bool = False) -> MixedProblem:
    """The problem with corrections of all responses, or of all records (`correct`)."""
    words = [each for one in corrections for each in (["integrate"] * 2 if one == "integrate twice" else [one])]
    if records:
        return dataclasses.replace(problem, time=[correct(record, *words) for record in problem.time], faults=())
    changed = [correct(frf, *words) for frf in problem.frequency]
    prior = problem.prior
    if not problem.prior.positive_real:
        return dataclasses.replace(problem, frequency=changed, faults=())
    # Constant and modes of such a class are posed anew.
    modes = problem.parametric if problem.functions else None
    prior = dataclasses.replace(prior, gain_bound=None)
    return MixedProblem(frequency=changed, prior=prior, parametric=modes, symmetric=problem.symmetric)


def correction_change(correction: str, records: bool = False) -> tuple[str, str]:
    """Spelling of a correction in Python, and for the program."""
    name, flag = ("record", "--time-correct") if records else ("frf", "--frequency-correct")
    words = ["integrate", "integrate"] if correction == "integrate twice" else [correction]
    return (
        f"{name} = rid.prepare.correct({name}, {', '.join(repr(word) for word in words)})".replace("'", '"'),
        " ".join(f'{flag} "{word}"' for word in words),
    )


def faults_of(problem: MixedProblem) -> list[Fault]:
    """Faults of the responses that no class has to be assumed for, each once."""
    found: dict[str, Fault] = {}
    for frf in problem.frequency:
        if isinstance(frf, FrequencyResponse):
            for fault in response_faults(frf):
                found.setdefault(fault.words, fault)
    return list(found.values())


def causes_without_class(problem: MixedProblem, margin: float, budget: Budget) -> list[Cause]:
    """Causes that the data show by themselves, with the margin after their correction."""
    causes: list[Cause] = []
    for fault in faults_of(problem):
        if not fault.correction:
            read_again = "read the file again with the role phase_deg"
            causes.append(Cause(fault.words, read_again, "", problem, evidence=fault.evidence))
            continue
        cause = Cause(fault.words, *correction_change(fault.correction), problem, evidence=fault.evidence)
        try:
            cause = cause._replace(problem=corrected(problem, fault.correction))
            after = judged_margin(cause.problem, max(1.0, margin / HELPS), budget)
            words = f"{fault.evidence}; with the correction the margin is {after:.3g} in place of {margin:.4g}"
            cause = cause._replace(evidence=words, margin=after)
        except InputError:
            pass
        causes.append(cause)
    of_records = [fault for frf in problem.frequency for fault in getattr(frf, "faults", ()) if not fault.undone]
    shown = "the records show it"
    return causes + [Cause(words, "", "", problem, evidence=shown) for words in dict.fromkeys(map(str, of_records))]


def corrections_of(problem: MixedProblem) -> Iterator[Cause]:
    """Causes whose correction can be tried."""
    responses = [frf for frf in problem.frequency if isinstance(frf, FrequencyResponse)]
    if len(responses) < len(problem.frequency) or problem.samples < _FEWEST:
        return
    tried: list[tuple[str, str, bool]] = []
    if responses:
        both = bool(problem.time) or bool(problem.prior.physical)
        tried += [(one, MISTAKES[one], False) for one in (*_FIRST, *(_AGAINST if both else ()), *_ALONE)]
    of_records = _OF_RECORDS[1:] if responses else _OF_RECORDS
    tried += [(*one, True) for one in of_records if problem.time]
    for correction, cause, records in tried:
        if correction == "transpose" and len(problem.outputs) * len(problem.inputs) == 1:
            continue
        try:
            changed = corrected(problem, correction, records=records)
        except InputError:  # frequencies beyond pi/dt, no sample time, a frequency 0
            continue
        yield Cause(cause, *correction_change(correction, records), changed)
    for start, cause in _STARTS:
        if problem.time and all(record.initial == "rest" for record in problem.time):
            try:
                began = [dataclasses.replace(record, initial=start) for record in problem.time]
                changed = dataclasses.replace(problem, time=began)
            except InputError:  # no whole number of periods, functions that are infinite there
                continue
            yield Cause(cause, f'TimeRecord(..., initial="{start}")', f"--initial {start}", changed)
    yield from _other_modes(problem)


def _other_modes(problem: MixedProblem) -> Iterator[Cause]:
    """The modes of the parametric part in other units."""
    basis = problem.parametric
    if basis is None or problem.prior.physical or problem.parameter_bounds is not None or not np.all(basis.poles.imag):
        return
    modes = modes_of(problem)
    for factor, scale, cause in _OF_MODES:
        parts: list[ParametricBasis] = []
        omega, damping = zip(*(mode_of(pole, problem.plane) for pole, _ in modes), strict=True)
        omega, damping = factor * np.concatenate(omega), np.concatenate(damping)
        damping = np.where(damping >= _IN_PER_CENT, scale * damping, damping)
        if problem.dt and np.any(omega * np.sqrt(np.maximum(1 - damping**2, 0)) * problem.dt >= np.pi):
            continue
        for at, ratio, (_, count) in zip(omega, damping, modes, strict=True):
            parts.append(kautz(at, ratio, dt=problem.dt, repeat=count, delay=int(problem.dt > 0)))
        try:
            changed = dataclasses.replace(problem, parametric=as_basis(parts, problem.plane))
        except InputError:
            continue
        numbers = [f"{at:.6g}" for at in omega], [f"{ratio:.4g}" for ratio in damping]
        change = f"rid.kautz([{', '.join(numbers[0])}], [{', '.join(numbers[1])}], ...)  # rad/s, ratio"
        option = " ".join(f"--mode {at / (2 * np.pi):.6g}:{r:.4g}" for at, r in zip(omega, damping, strict=True))
        yield Cause(cause, change, option, changed)


# Either of the axis of the data or of the modes can be in the wrong unit: both are tried.
_AXES = {MISTAKES["frequency in Hz"], MISTAKES["frequency in rad/s"], _OF_MODES[0][2], _OF_MODES[1][2]}


def tried_causes(problem: MixedProblem, margin: float, active: Sequence[Active], budget: Budget) -> list[Cause]:
    """Corrections that leave a margin at least three times smaller; no more after one that makes the data consistent."""
    small, limit = _smaller(problem, active), max(1.0, margin / HELPS)
    found: list[Cause] = []
    for one in corrections_of(problem):
        if budget.over:
            break
        if one.cause not in _AXES and any(cause.solves for cause in found):
            continue
        try:
            if _only_smaller(problem, one.problem, budget):
                continue
            after = judged_margin(one.problem if small is None else _part(one.problem, small), limit, budget)
            if small is not None and after <= limit:
                after = judged_margin(one.problem, limit, budget)
        except InputError:
            continue
        if after <= margin / HELPS:
            words = f"with it the margin is {after:.3g} in place of {margin:.4g}"
            found.append(one._replace(evidence=words, margin=after))
    found.sort(key=lambda one: float(one.margin or 0.0))
    solved = [one for one in found if one.solves]
    return solved or found


def _only_smaller(problem: MixedProblem, changed: MixedProblem, budget: Budget) -> bool:
    """Return whether a response without records need only be smaller to fit below K, so that its correction shows nothing."""
    if problem.time or problem.prior.physical or changed.frequency is problem.frequency:
        return False
    before, after = (float(np.median([np.median(np.abs(f.values)) for f in p.frequency])) for p in (problem, changed))
    factor = after / max(before, np.finfo(float).tiny)
    return 0 < factor < _SMALLER and judged_margin(corrected(problem, f"times {factor!r}"), 1.0, budget) <= 1


def unit_cause(problem: MixedProblem, margin: float, budget: Budget) -> list[Cause]:
    """A response without records in a unit 1000 times smaller: where a class that is 30 times larger is too small too."""
    if problem.time or problem.prior.physical or problem.samples < _FEWEST or budget.over:
        return []
    responses = [frf for frf in problem.frequency if isinstance(frf, FrequencyResponse)]
    if len(responses) < len(problem.frequency) or judged_margin(corrected(problem, _SHORT_OF_UNIT), 1.0, budget) <= 1:
        return []
    cause = Cause(MISTAKES[_UNIT], *correction_change(_UNIT), corrected(problem, _UNIT), unsure=True)
    after = judged_margin(cause.problem, 1.0, budget)
    words = f"with it the margin is {after:.3g} in place of {margin:.4g}; a K that is 30 times larger isn't enough"
    return [cause._replace(evidence=words, margin=after)] if after <= 1 else []


def judged_margin(problem: MixedProblem, enough: float, budget: Budget) -> float:
    """A margin that some system reaches: to 0.1 %, or less exactly where it is surely above `enough`.

    Infinite where none was reached in time, or where no form of the class takes a problem of this size.
    """
    margin = np.inf
    try:
        posed = formulate(problem, accuracy=_DIGITS)
    except SizeError as error:
        _log.info("a change is not judged (%s)", error)
        return margin
    for _, margin, gap in margin_path(posed.data):
        if gap <= _DIGITS * max(margin, 1.0) or margin - 2 * gap > enough or budget.over:
            break
    return float(margin)


def bound_cause(problem: MixedProblem, margin: float) -> Cause:
    """Bounds that are too small: the factor with which the class is consistent, and a little more."""
    factor = _rounded_up(_SPARE * margin)
    frequency = [frf.with_bound(frf.bound.inflated(factor), frf.note) for frf in problem.frequency]
    time = [record.with_bound(record.bound.inflated(factor), record.note) for record in problem.time]
    sorts = (("frf", problem.frequency), ("record", problem.time))
    changes = [f'{name} = rid.prepare.correct({name}, "bound times {factor:g}")' for name, data in sorts if data]
    options: list[str] = []
    for kind, data in (("frequency", problem.frequency), ("time", problem.time)):
        radii = [np.asarray(item.bound.radius)[np.isfinite(item.bound.radius)] for item in data]
        if not radii:
            continue
        sizes = np.concatenate(radii)
        constant = np.ptp(sizes) <= 1e-9 * sizes.max()
        options.append(
            f"--{kind}-bound {factor * sizes[0]:.4g}" if constant else f'--{kind}-correct "bound times {factor:g}"'
        )
    changed = dataclasses.replace(problem, frequency=frequency, time=time)
    return Cause(
        "the bounds on the errors are too small for this class",
        "; ".join(changes),
        " ".join(options),
        changed,
        evidence=f"it needs {margin:.4g} times as much"
        + (_AS_UNITS if margin > _OF_UNITS else "")
        + (_AS_SAMPLED if margin > SLIGHTLY and not (problem.dt or problem.prior.physical) else ""),
        margin=margin / factor,
    )


def class_cause(identification: Identification) -> Cause | None:
    """The class that the program put in the place of one that holds the data, as it found none; None of any other class."""
    prior, problem = identification.choices.get("prior"), identification.problem
    if prior is None or not prior.in_place:
        return None
    if prior.source is Source.STOPPED:
        what, change = "the time was over before a class was found that holds the data", "a larger time limit"
    else:
        what, change = "no class that was tried and says anything holds the data", _KNOWN
    return Cause(what, change, "", problem, evidence="the one that is refuted stands in its place")


def _rounded_up(factor: float) -> float:
    """Three digits, not less."""
    unit = 10.0 ** (math.floor(math.log10(factor)) - 2)
    return math.ceil(factor / unit - 1e-9) * unit


def _smaller(problem: MixedProblem, active: Sequence[Active]) -> list[NDArray[np.intp]] | None:
    """Frequency points of each response to try with: those of the active constraints, and some spread over all; None for all."""
    if problem.coefficients <= _MOST or not problem.frequency:
        return None
    chosen: list[NDArray[np.intp]] = []
    for k, frf in enumerate(problem.frequency):
        spread = [round(at) for at in np.linspace(0, len(frf.omega) - 1, min(_POINTS, len(frf.omega))).tolist()]
        at = [omega for kind, index, omega, _ in active if kind == "frequency" and index == k]
        own = [int(np.argmin(np.abs(frf.omega - omega))) for omega in at]
        chosen.append(np.array(sorted({*spread, *own})))
    return chosen


def _part(problem: MixedProblem, chosen: list[NDArray[np.intp]]) -> MixedProblem:
    frequency = [frf.select(points) for frf, points in zip(problem.frequency, chosen, strict=True)]
    return dataclasses.replace(problem, frequency=frequency)


# --- modes of the parametric part -----------------------------------------------------------------------------------------------


def mode_of(poles: Complex, plane: Plane) -> tuple[Real, Real]:
    """Natural frequency in rad/s and damping ratio of complex poles."""
    logs = np.log(poles)
    size = np.abs(logs)
    return plane.modes(size, -np.log(np.abs(poles)) / size)


def modes_of(problem: MixedProblem) -> list[tuple[Complex, int]]:
    """Complex poles of the parametric part, upper half, each with its multiplicity."""
    poles = np.zeros(0) if problem.parametric is None else problem.parametric.poles
    left = list(poles[poles.imag > 0])
    modes: list[tuple[Complex, int]] = []
    while left:
        same = [a for a in left if abs(a - left[0]) <= _SAME_POLE * (1 - abs(left[0]))]
        left = [a for a in left if a not in same]
        modes.append((np.array([np.mean(same)], complex), len(same)))
    return modes
