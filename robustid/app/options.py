"""The options of every step, stated once: the sections of a run file, with name, default, check, meaning and spelling of each key.

A run file is validated by these sections, `robustid run --keys` lists them, the commands take from them the options that have a
`flag`, and `identify_reduced` those that have a `keyword`. Nothing here needs numpy: the command line starts with it.
"""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, Any

from robustid.app.checks import (
    AUTO,
    auto_or,
    either,
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
from robustid.app.sources import Estimate, FamilyChoice, MemberChoice, RecordSource, ResponseSource
from robustid.errors import InputError

if TYPE_CHECKING:
    from robustid.identification import Prior

_positive, _frequencies = number(above=0), number(least=0)
_NOTE = "How the program chose these values, in words; written by the program."


def _solver(name: str, value: Any) -> str:
    wanted = text()(name, value)
    if wanted not in (AUTO, "structured"):
        from robustid.identification.solver import solver_name

        try:
            solver_name(wanted)  # refuses what isn't installed
        except InputError as error:
            raise InputError(str(error).replace("`solver`", name)) from None
    return wanted


def _directions(name: str, value: Any) -> int:
    from robustid.guarantees import LEAST, MOST

    return whole(LEAST, MOST)(name, value)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Delay:
    """A delay that is taken out of all data."""

    seconds: float | str = key(
        auto_or(_frequencies), 0.0, help='The delay, or "auto": estimated from the response.', unit="s"
    )
    note: str | None = key(text(), help=_NOTE)


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
        text(listed("mfd", "DAMPINGS")),
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
        text(listed("mfd", "QUANTITIES")),
        help="Of a modal structure: what the outputs measure, of inputs that are forces: position (default), velocity or"
        " acceleration.",
        flag="--quantity",
    )
    feedthrough: bool = key(
        flag,
        False,
        help="The response may differ from 0 at infinity: accelerometers, no delay.",
        flag="--feedthrough",
    )
    time_limit: float | None = key(
        _positive,
        help="Time after which the best model so far is taken, and no further order tried.",
        unit="s",
        flag="--time-limit",
    )

    @property
    def arguments(self) -> dict[str, Any]:
        """The keyword arguments of `robustid.fit_mfd` and of `suggest_order`, but for the order."""
        from robustid.mfd import Modal, RigidBody

        structure: Any = False
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
        help="Poles at z = 1 in the parametric part: 1 for an integrator (torque to speed), 2 for a rigid body (torque to angle).",
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
    hz_interval: tuple | None = key(
        several(several(_positive, 2)), help="The pole-uncertainty box: an interval for each of hz.", unit="Hz"
    )
    damping_interval: tuple | None = key(
        several(several(_positive, 2)), help="The pole-uncertainty box: an interval for each of damping."
    )
    note: str | None = key(text(), help=_NOTE)


@dataclasses.dataclass(frozen=True, kw_only=True)
class PriorChoice:
    """Class of the non-parametric part; without numbers it is taken from the curve of the smallest gain bound."""

    gain_bound: float | None = key(
        _positive, help="Prior: gain bound K of the non-parametric part, in units of the response.", flag="--gain"
    )
    decay_rate: float | None = key(
        number(above=1), help="Prior: decay rate rho > 1 of the non-parametric part, per sample.", flag="--decay-rate"
    )
    decay: float | None = key(
        _positive,
        help="Prior: decay of the non-parametric part, in the place of the decay rate; of responses of continuous time.",
        unit="1/s",
        flag="--decay",
    )
    passive: str | None = key(
        text(listed("identification", "PASSIVE_NAMES")),
        help="Prior: a physical property of the whole plant in the place of a gain bound, without modes, with a decay. Positive"
        " real: impedance, velocity per force at the same points; bounded real: scattering parameters.",
        flag="--passive",
    )
    slack: float | None = key(
        number(least=0), help="Of positive real plants: how far below 0 the real part may be, in units of the response."
    )
    scaling: tuple | None = key(
        several(several(_positive)), help="Of MIMO responses: sizes of the entries, one row an output."
    )
    roll_off: int | None = key(
        whole(1, 8),
        help="Prior: the gain bound falls as frequency^-N above the corner, 2 for a mass line; with a corner.",
        flag="--roll-off",
    )
    corner_hz: float | None = key(
        _positive, help="Prior: where the gain bound begins to fall.", unit="Hz", flag="--corner"
    )
    note: str | None = key(text(), help=_NOTE)

    @property
    def stated(self) -> Prior | None:
        """The prior; None where it is to be chosen."""
        from robustid.identification import prior_from

        names = ("gain_bound", "decay_rate", "decay", "passive", "slack")
        fields = {name: value for name in names if (value := getattr(self, name)) is not None}
        if not {"gain_bound", "passive"} & set(fields):
            return None
        return prior_from({**fields, "scaling": self.scaling, **self.shape})

    @property
    def shape(self) -> dict[str, Any]:
        """The roll-off, as a prior takes it; empty where there is none."""
        if self.roll_off is None or self.corner_hz is None:
            return {}
        return {"roll_off": self.roll_off, "corner": 2 * math.pi * self.corner_hz}

    @classmethod
    def of(cls, prior: Prior, note: str | None = None) -> PriorChoice:
        """A prior as it is stated in a run file.

        Raises
        ------
        InputError
            One with a weight, which has no keys there.
        """
        return cls(**prior_keys(prior), note=note)

    def check(self, names: dict[str, str]) -> None:
        """Refuse a part of a prior; `names` are those of its keys where they were given, if they are others."""
        others = ("decay_rate", "decay", "slack", "scaling", "roll_off", "corner_hz")
        names = {name: name for name in others} | names
        gain, *decays = (names[name] for name in ("gain_bound", "decay_rate", "decay"))
        given = [name for name, value in zip(decays, (self.decay_rate, self.decay), strict=True) if value is not None]
        if len(given) > 1:
            raise InputError(f"{given[0]} (per sample) and {given[1]} (in 1/s) say the same thing; give one of them")
        if self.passive is not None:
            self._check_passive(names, bool(given))
            return
        if self.slack:
            raise InputError(
                f'{names["slack"]} belongs to {names["passive"]} = "positive real", which is not given; leave it out'
            )
        if (self.gain_bound is None) != (not given):
            one, other = (given[0], gain) if given else (gain, f"{decays[0]} (or {decays[1]} in 1/s)")
            raise InputError(f"{one} is given without {other}; give both, or neither to have them chosen")
        if (self.roll_off is None) != (self.corner_hz is None):
            order, corner = names["roll_off"], names["corner_hz"]
            one, other = (order, corner) if self.corner_hz is None else (corner, order)
            raise InputError(
                f"{one} is given without {other}: the bound falls as frequency^-N above a corner; give both"
            )

    def _check_passive(self, names: dict[str, str], decays: bool) -> None:
        """Refuse what a passive class has no use for."""
        name = names["passive"]
        for other in ("gain_bound", "scaling", "roll_off", "corner_hz"):
            if getattr(self, other) is not None:
                raise InputError(
                    f"{names[other]} has no meaning with {name}, which bounds the plant by itself; leave it out"
                )
        if not decays:
            raise InputError(
                f"{name} is given without {names['decay']} (in 1/s): say how far left of the axis the plant is passive, at most the"
                " smallest real part of its poles, in magnitude"
            )


def prior_keys(prior: Prior) -> dict[str, Any]:
    """The keys of a prior in a run file: without the gain bound that a passive class doesn't ask for.

    Raises
    ------
    InputError
        A prior with a weight.
    """
    from robustid.identification import prior_fields

    fields = {name: value for name, value in prior_fields(prior).items() if value is not None}
    if "weight" in fields:
        raise InputError(
            "`prior` has a `weight`, for which run files have no key: state it by `roll_off` and `corner`, or take identify() and"
            " reduce_within_bounds() one after the other"
        )
    if prior.physical:
        fields.pop("gain_bound", None)
    if "corner" in fields:
        fields["corner_hz"] = fields.pop("corner") / (2 * math.pi)
    return fields


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
    inflate_note: str | None = key(text(), help=_NOTE)
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
        help="Seconds after which the margin proved so far, and a model that keeps it, are taken; so does Ctrl-C.",
        unit="s",
        flag="--time-limit",
    )

    @property
    def arguments(self) -> dict[str, Any]:
        """The keyword arguments of `robustid.identify`."""
        return {name: getattr(self, name) for name in ("objective", "solver", "accuracy", "form", "time_limit")}


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
        help="Seconds after which the smallest order found so far is taken; so does Ctrl-C.",
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
    time_limit: float | None = key(
        _positive,
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
        help="Cover the pole-uncertainty box that the data leave too, where the poles were taken from them (`robustid bounds`"
        " writes it to NAME-poles); may take minutes.",
        flag="--poles",
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class General:
    """The subject of a run."""

    title: str | None = key(text(), help="Heading of the report.")
    entry: tuple | None = key(
        several(either(whole(), text()), 2),
        help="Output and input, by number from 0 or by name, of the one entry of a MIMO response that is used; default all.",
        flag="--entry",
        text=output_input,
        metavar="OUTPUT,INPUT",
    )


# As they stand in a run file.
PARTS: dict[str, Any] = {
    "": General,
    "[[record]]": RecordSource,
    "[[frequency]]": ResponseSource,
    "[[members]]": MemberChoice,
    "[family]": FamilyChoice,
    "[estimate]": Estimate,
    "[delay]": Delay,
    "[frequency_points]": FrequencyPoints,
    "[withheld]": Withheld,
    "[fit]": Fit,
    "[modes]": Modes,
    "[prior]": PriorChoice,
    "[identify]": Identify,
    "[small_model]": SmallModel,
    "[worst_case]": WorstCase,
}
