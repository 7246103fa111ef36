"""The options of every step, stated once: the sections of a run file, with name, default, check, meaning and spelling of each key.

A run file is validated by these sections, `robustid run --keys` lists them, the commands take from them the options that have a
`flag`, and `identify_reduced` those that have a `keyword`. Nothing here needs numpy: the command line starts with it.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

from robustid.app.run.checks import (
    AUTO,
    auto_or,
    either,
    explained,
    flag,
    key,
    listed,
    low_high,
    number,
    output_input,
    several,
    text,
    whole,
)
from robustid.app.run.class_settings import PriorChoice
from robustid.app.run.controller_settings import ControllerChoice
from robustid.app.run.loop_settings import LoopChoice
from robustid.app.run.sources import Estimate, FamilyChoice, MemberChoice, RecordSource, ResponseSource
from robustid.errors import InputError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

    from robustid.core import Options


_positive, _frequencies = number(above=0), number(least=0)


def _solver(name: str, value: object) -> str:
    wanted = text()(name, value)
    if wanted not in (AUTO, "structured"):
        from robustid.identification.solver import solver_name

        try:
            solver_name(wanted)  # refuses what isn't installed
        except InputError as error:
            raise error.reworded({"solver": name}) from None
    return wanted


def _directions(name: str, value: object) -> int:
    from robustid.guarantees import LEAST, MOST

    return whole(LEAST, MOST)(name, value)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Delay:
    """A delay that is taken out of all data."""

    seconds: float | str = key(
        auto_or(_frequencies), 0.0, help='The delay, or "auto": estimated from the response.', unit="s"
    )
    source: str | None = explained("source")
    note: str | None = explained("note")
    digest: str | None = explained("digest")


@dataclasses.dataclass(frozen=True, kw_only=True)
class FrequencyPoints:
    """The frequency points that are used; the others are kept to test what was found."""

    band_hz: tuple[float, float] | None = key(
        several(_frequencies, 2),
        help="Use only the points between two frequencies in Hz.",
        unit="Hz",
        flag="--band",
        text=low_high,
        metavar="LOW:HIGH",
    )
    every: int = key(whole(1), 1, help="Use one of so many.")
    near_hz: float | None = key(_positive, help="Use all points so near to a mode too.", unit="Hz")
    leave_out_hz: tuple[float, ...] | None = key(
        several(_frequencies),
        help="Frequency points that are left out, of the tests too: bad ones, by hand.",
        unit="Hz",
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Withheld:
    """Data that are kept out to test the result: by default whole records, else periods, else frequency points."""

    records: int | str = key(
        auto_or(whole()),
        AUTO,
        help="How many blocks of the records for a response (as many records as inputs) are kept out, the last ones; auto: half of"
        " four or more, one of three.",
    )
    periods: int | str = key(
        auto_or(whole()),
        AUTO,
        help="How many periods at the end are kept out, where one block is all there is; auto: a quarter of eight or more.",
    )
    every: int | str = key(
        auto_or(whole()),
        AUTO,
        help="Keep out one frequency point of so many, 0 for none; auto: of four, where there are 60 or more and nothing else was"
        " kept out.",
        keyword="withhold_every",
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Fit:
    """A matrix fraction that is fitted to the response first: its modes become those of the parametric part."""

    order: int | str | None = key(
        auto_or(whole(1)),
        help='McMillan degree, with two states for every rigid-body mode, or "auto": as many as the data carry. Default: none is'
        " fitted.",
    )
    rigid_body: int = key(
        whole(), 0, help="Number of rigid-body modes: undamped, poles at zero exactly.", flag="--rigid-body"
    )
    modal: str | None = key(
        text(listed("fitting", "DAMPINGS")),
        help="Keep the structure of a mechanical system: modes of rank one with complex shapes (general), or with real ones"
        " (proportional damping).",
        flag="--modal",
    )
    symmetric: bool = key(
        flag,
        False,
        help="Of a modal structure: sensors and actuators sit together, so that the response is symmetric.",
        flag="--symmetric",
    )
    quantity: str | None = key(
        text(listed("fitting", "QUANTITIES")),
        help="Of a modal structure: what the outputs measure, of inputs that are forces: position (default), velocity or"
        " acceleration.",
        flag="--quantity",
    )
    feedthrough: bool | None = key(
        flag,
        help="The response may differ from 0 at infinity: no delay. Default: of accelerations under forces, by their units, and of"
        " scattering parameters.",
        flag="--feedthrough",
    )
    time_limit: float | None = key(
        _positive,
        help="Time after which the best model so far is taken, and no further order tried.",
        unit="s",
        flag="--time-limit",
    )

    @property
    def arguments(self) -> Options:
        """The keyword arguments of `robustid.fit_mfd` and of `suggest_order`, but for the order."""
        from robustid.fitting import Modal, RigidBody

        structure: Modal | bool = False
        if self.modal is not None:
            structure = Modal(self.modal, symmetric=self.symmetric, quantity=self.quantity or "position")
        elif self.symmetric or self.quantity is not None:
            name = "symmetric" if self.symmetric else "quantity"
            raise InputError(f"`{name}` belongs to a structure of the modes: give `modal` too")
        return {
            "rigid_body": RigidBody(self.rigid_body) if self.rigid_body else None,
            "modal": structure,
            "feedthrough": self.feedthrough,
            "time_limit": self.time_limit,
        }


@dataclasses.dataclass(frozen=True, kw_only=True)
class Modes:
    """Poles of the parametric part; without `hz` they are taken from the response."""

    hz: tuple[float, ...] | None = key(several(_positive), help="Frequencies of the modes; [] for none.", unit="Hz")
    damping: tuple[float, ...] | None = key(
        several(_positive), help="Damping ratios of the modes; 1 for a single real pole at that frequency."
    )
    integrators: int = key(
        whole(0, 2),
        0,
        help="Poles at z = 1 (s = 0) in the parametric part: 1 for an integrator (torque to speed), 2 for a rigid body (torque to"
        " angle).",
        flag="--integrators",
        keyword="integrators",
    )
    count: int | None = key(whole(1), help="How many modes are looked for in the response, where hz doesn't say them.")
    repeat: int = key(
        whole(1),
        1,
        help="Multiplicity of each pair; 2 absorbs small errors of the poles.",
        flag="--repeat",
        keyword="repeat",
    )
    delay: int | None = key(
        whole(), help="Delay of the pairs; default: from the data.", unit="samples", flag="--delay", keyword="delay"
    )
    hz_interval: tuple[tuple[float, float], ...] | None = key(
        several(several(_positive, 2)), help="The pole-uncertainty box: an interval for each of hz.", unit="Hz"
    )
    damping_interval: tuple[tuple[float, float], ...] | None = key(
        several(several(_positive, 2)), help="The pole-uncertainty box: an interval for each of damping."
    )
    source: str | None = explained("source")
    note: str | None = explained("note")
    digest: str | None = explained("digest")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Identify:
    """The decision about consistency, and the factor on all bounds."""

    inflate: float | str = key(
        auto_or(_positive),
        1.0,
        help='Factor on all bounds, said in every result. "auto": the smallest with which the class (without a prior: the modes'
        " beside a non-parametric part as large as the median response, at the middle decay rate) is consistent, and 10 % more;"
        " 1 where it is without.",
        keyword="inflate",
    )
    inflate_source: str | None = explained("source")
    inflate_note: str | None = explained("note")
    inflate_digest: str | None = explained("digest")
    objective: str = key(
        text(listed("identification", "OBJECTIVES")),
        "center",
        help="Which of the systems becomes the model: center (the middle of all that are consistent), margin (the one that fits"
        " best), gain (smallest K) or order (smallest Hankel nuclear norm, the easiest to reduce).",
        flag="--objective",
        keyword="objective",
    )
    solver: str = key(
        _solver,
        "auto",
        help="auto, structured, cvxpy, or an installed cvxpy solver.",
        flag="--solver",
        keyword="solver",
    )
    accuracy: float = key(
        _positive, 1e-4, help="Width of the proven interval of the margin.", flag="--accuracy", keyword="accuracy"
    )
    form: str = key(
        text(listed("identification", "FORMS")),
        "auto",
        help="The finite problem: orthonormal (exact, up to 200 coefficients), classical (the same as published, for small data),"
        " taylor (any number of samples), sections (fewer coefficients where the frequency points fill a part of the circle only,"
        " as in oversampled data), or auto.",
        flag="--form",
        keyword="form",
    )

    time_limit: float | None = key(
        _positive,
        help="Seconds after which the margin proved so far, and a model that keeps it, are taken; so does Ctrl-C. Default: its"
        " share of the time of the run.",
        unit="s",
    )

    @property
    def arguments(self) -> Options:
        """The keyword arguments of `robustid.identify`, but for the time limit."""
        return {name: getattr(self, name) for name in ("objective", "solver", "accuracy", "form")}


@dataclasses.dataclass(frozen=True, kw_only=True)
class SmallModel:
    """Demands on the small model."""

    rigid_body: int | None = key(
        whole(1),
        help="Rigid-body modes of the small model, two poles at z = 1 each, as in `reduce_within_bounds`.",
        keyword="rigid_body",
    )
    time_limit: float | None = key(
        _positive,
        help="Seconds after which the smallest order found so far is taken; so does Ctrl-C. Default: its share of the time of the"
        " run.",
        unit="s",
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class WorstCase:
    """The error bounds over all consistent systems."""

    compute: bool = key(flag, True, help="Bound the worst-case error, the longest part of a run.", keyword="worst_case")
    at_hz: tuple[float, ...] | None = key(
        several(_frequencies), help="Frequencies of the bounds; default about 70 over the range of the data.", unit="Hz"
    )
    directions: int = key(
        _directions,
        16,
        help="Sides of the polygon around the values at a frequency, 3 to 360.",
        flag="--directions",
        keyword="directions",
    )
    rtol: float = key(
        _positive,
        0.05,
        help="Aim for the distance of the bounds from what is attained, relative.",
        flag="--rtol",
        keyword="rtol",
    )
    time_limit: float = key(
        _positive,
        300.0,
        help="Seconds after which the bounds at the frequencies finished so far are taken, spread over the range; so does Ctrl-C.",
        unit="s",
        flag="--time-limit",
    )
    circle: bool = key(
        flag,
        False,
        help="Bound the error at every frequency, between those evaluated too; may take long.",
        flag="--circle",
    )
    over_poles: bool = key(
        flag,
        False,
        help="Bound the error by semidefinite programs over the whole pole-uncertainty box, at all frequencies, beside a sweep at"
        " the poles as they were taken (`robustid bounds` writes it to NAME-poles); may take minutes. The band covers the box"
        " without it.",
        flag="--poles",
    )

    @property
    def arguments(self) -> Options:
        """The keyword arguments of a bound at many frequencies, but for the time limit."""
        return {name: getattr(self, name) for name in ("directions", "rtol")}


@dataclasses.dataclass(frozen=True, kw_only=True)
class General:
    """The subject of a run, and its time."""

    title: str | None = key(text(), help="Heading of the report.")
    time_limit: float = key(
        _positive,
        300.0,
        help="Wall-clock time of the whole way, of which every step has its share: what is found by then is written, and what was"
        " left out said.",
        unit="s",
        flag="--time-limit",
        keyword="time_limit",
    )
    entry: tuple[int | str, int | str] | None = key(
        several(either(whole(), text()), 2),
        help="Output and input, by number from 0 or by name, of the one entry of a MIMO response that is used; default all.",
        flag="--entry",
        text=output_input,
        metavar="OUTPUT,INPUT",
    )
    column: int | str | None = key(
        either(whole(), text()),
        help="Input, by number from 0 or by name, whose column of a MIMO response, all outputs, is used; default all.",
    )
    split: str | None = key(
        text(("entries", "columns")),
        help='A run of its own for every entry of a MIMO response ("entries") or every input ("columns"), as of several machines:'
        " for a matrix that is too large for one problem.",
    )


LISTS: dict[str, type[DataclassInstance]] = {
    "record": RecordSource,
    "frequency": ResponseSource,
    "members": MemberChoice,
}
SECTIONS: dict[str, type[Any]] = {
    "family": FamilyChoice,
    "loop": LoopChoice,
    "estimate": Estimate,
    "delay": Delay,
    "frequency_points": FrequencyPoints,
    "withheld": Withheld,
    "fit": Fit,
    "modes": Modes,
    "prior": PriorChoice,
    "identify": Identify,
    "small_model": SmallModel,
    "worst_case": WorstCase,
    "controller": ControllerChoice,
}
# As they stand in a run file.
PARTS: dict[str, type[Any]] = {
    "": General,
    **{f"[[{name}]]": kind for name, kind in LISTS.items()},
    **{f"[{name}]": kind for name, kind in SECTIONS.items()},
}
