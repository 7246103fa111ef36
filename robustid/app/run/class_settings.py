"""The options that state a class: the section [prior] of a run file."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from robustid.app.run.checks import (
    AUTO,
    Check,
    auto_or,
    explained,
    hz_levels,
    key,
    listed,
    number,
    several,
    text,
    whole,
)
from robustid.app.run.toml import is_table
from robustid.errors import InputError, InputTypeError

if TYPE_CHECKING:
    from robustid.core import Options, Record
    from robustid.identification import Prior, PriorWeight


_positive = number(above=0)
POSITIVE_REAL = "positive real"  # beside which modes have a place


def _weight_model() -> Check[Mapping[str, object]]:
    """The numbers of a weight that is stable and of minimum phase."""
    roots = several(several(number(), 2))
    gain, dt = number(), number(least=0)

    def check(name: str, value: object) -> Mapping[str, object]:
        if not is_table(value) or {*value} != {"zeros", "poles", "gain", "dt"}:
            raise InputTypeError(
                f"{name} must be a table {{ zeros, poles, gain, dt }}, as the program writes it; got {value!r}"
            )
        zeros, poles = (roots(f"{name} {part}", value[part]) for part in ("zeros", "poles"))
        found = {"zeros": zeros, "poles": poles, "gain": gain(f"{name} gain", value["gain"])}
        found["dt"] = step = dt(f"{name} dt", value["dt"])
        sizes = [math.hypot(*root) - 1 if step else root[0] for root in (*zeros, *poles)]
        if max(sizes, default=-1.0) >= 0 or len(zeros) > len(poles):
            raise InputError(
                f"{name} must be stable and of minimum phase, without more zeros than poles; give weight, a table"
            )
        return found

    return check


def _experiments(name: str, value: object) -> tuple[str, ...]:
    """Names of experiments: their kind, and their number from 1."""
    found = several(text())(name, value)
    for one in found:
        kind, _, count = one.partition(" ")
        if kind not in ("frequency", "time") or not count.isdigit() or int(count) < 1:
            raise InputError(f'{name} must hold names such as "time 1" or "frequency 2"; got {one!r}')
    return tuple(found)


def _spelled(_: str, content: str) -> str:
    """The name of a physical property, however it is joined."""
    return content.replace("-", " ").replace("_", " ").lower()


def _whole_or_word(_: str, content: str) -> int | str:
    return int(content) if content.isdigit() else content


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
        help="Prior: a physical property of the whole plant in the place of a gain bound, with a decay. 'positive real': impedance,"
        " velocity per force at the same points (modes and real poles take only what is passive; over decades they can be chosen);"
        " 'negative imaginary': displacement per force; 'bounded real': scattering parameters. Without a decay it is chosen.",
        flag="--passive",
        text=_spelled,
    )
    slack: float | None = key(
        number(least=0), help="Of positive real plants: how far below 0 the real part may be, in units of the response."
    )
    scaling: tuple[tuple[float, ...], ...] | None = key(
        several(several(_positive)), help="Of MIMO responses: sizes of the entries, one row an output."
    )
    roll_off: int | str | None = key(
        auto_or(whole(1, 8)),
        help='Prior: the gain bound falls as frequency^-N above the corner, 2 for a mass line; with a corner. "auto": the steepest'
        " that leaves the gain bound nearly as small, where there is one (`suggest_roll_off`).",
        flag="--roll-off",
        text=_whole_or_word,
        metavar="N",
    )
    corner_hz: float | None = key(
        _positive, help="Prior: where the gain bound begins to fall.", unit="Hz", flag="--corner"
    )
    weight: tuple[tuple[float, float], ...] | None = key(
        several(several(number(least=0), 2)),
        help="Prior: the gain bound times a level that depends on the frequency, rows [Hz, level], between them straight in"
        " logarithms; covered from above by a small weight. In the place of a roll-off.",
        flag="--weight",
        text=hz_levels,
        metavar="HZ:LEVEL,...",
    )
    weight_model: Mapping[str, object] | None = key(
        _weight_model(),
        help="The weight of a prior that was made in Python, by its zeros and poles; written by the program.",
    )
    without: tuple[str, ...] | None = key(
        _experiments,
        help='Experiments that the class is not chosen from, such as ["time 1", "frequency 2"]: those that contradict the others,'
        " where the program chooses it. They stay in the data, and the class is held against them.",
    )
    source: str | None = explained("source")
    note: str | None = explained("note")
    digest: str | None = explained("digest")
    curve: str | None = key(
        text(), help="The curve of the smallest gain bound, from which they were taken; written by the program."
    )

    @property
    def is_stated(self) -> bool:
        """True if nothing is to be chosen."""
        if self.passive is not None:
            return self.decay is not None or self.decay_rate is not None
        return self.gain_bound is not None

    @property
    def is_from_data(self) -> bool:
        """True if a search in the data chose it, to its end or not."""
        return self.source in ("data", "stopped")

    def stated(self, dt: float | None) -> Prior | None:
        """The prior, for data of a sample time; None where it is to be chosen."""
        from robustid.identification import prior_from

        if not self.is_stated:
            return None
        names = ("gain_bound", "decay_rate", "decay", "passive", "slack")
        fields = {name: value for name in names if (value := getattr(self, name)) is not None}
        return prior_from({**fields, "scaling": self.scaling, **self.shape(dt)})

    def shape(self, dt: float | None) -> Options:
        """The roll-off or weight, as a prior takes it for data of a sample time; empty where there is none."""
        if self.weight is not None:
            return {"weight": _covering(self.weight, dt or None)}
        if self.weight_model is not None:
            return {"weight": self.weight_model}
        if self.roll_off in (None, AUTO) or self.corner_hz is None:
            return {}
        return {"roll_off": self.roll_off, "corner": 2 * math.pi * self.corner_hz}

    @classmethod
    def of(
        cls,
        prior: Prior,
        note: str | None = None,
        asked: PriorChoice | None = None,
        *,
        source: str | None = None,
        curve: str | None = None,
    ) -> PriorChoice:
        """A prior as it is stated in a run file; its weight by the table that was asked for, where there is one."""
        without = None if asked is None else asked.without
        return cls(**prior_keys(prior, asked), note=note, source=source, curve=curve, without=without)

    def check(self, names: dict[str, str]) -> None:
        """Refuse a part of a prior; `names` are those of its keys where they were given, if they are others."""
        others = ("decay_rate", "decay", "slack", "scaling", "roll_off", "corner_hz", "weight", "weight_model")
        names = {name: name for name in others} | names
        gain, *decays = (names[name] for name in ("gain_bound", "decay_rate", "decay"))
        given = [name for name, value in zip(decays, (self.decay_rate, self.decay), strict=True) if value is not None]
        if len(given) > 1:
            raise InputError(f"{given[0]} (per sample) and {given[1]} (in 1/s) say the same thing; give one of them")
        if self.passive is not None:
            self._check_passive(names)
            return
        shapes = [name for name in ("roll_off", "weight", "weight_model") if getattr(self, name) is not None]
        if len(shapes) > 1:
            one, other = (names[name] for name in shapes[:2])
            raise InputError(
                f"{one} and {other} both say how the gain bound depends on the frequency; give one of them"
            )
        if self.slack:
            raise InputError(
                f'{names["slack"]} belongs to {names["passive"]} = "positive real", which is not given; leave it out'
            )
        if (self.gain_bound is None) != (not given):
            one, other = (given[0], gain) if given else (gain, f"{decays[0]} (or {decays[1]} in 1/s)")
            raise InputError(f"{one} is given without {other}; give both, or neither to have them chosen")
        if self.roll_off == AUTO:
            if self.corner_hz is not None:
                raise InputError(
                    f"{names['corner_hz']} is chosen too where {names['roll_off']} is {AUTO}; leave it out"
                )
            return
        if (self.roll_off is None) != (self.corner_hz is None):
            order, corner = names["roll_off"], names["corner_hz"]
            one, other = (order, corner) if self.corner_hz is None else (corner, order)
            raise InputError(
                f"{one} is given without {other}: the bound falls as frequency^-N above a corner; give both"
            )

    def _check_passive(self, names: dict[str, str]) -> None:
        """Refuse what a passive class has no use for."""
        name = names["passive"]
        for other in ("gain_bound", "scaling", "roll_off", "corner_hz", "weight", "weight_model"):
            if getattr(self, other) is not None:
                raise InputError(
                    f"{names[other]} has no meaning with {name}, which bounds the plant by itself; leave it out"
                )


def prior_keys(prior: Prior, asked: PriorChoice | None = None) -> Record:
    """The keys of a prior in a run file: without the gain bound that a passive class doesn't ask for.

    A weight is stated by the table that was asked for, where there is one, else by its zeros and poles.
    """
    from robustid.identification import prior_fields

    fields = {name: value for name, value in prior_fields(prior).items() if value is not None}
    if "weight" in fields:
        model, table = fields.pop("weight"), None if asked is None else asked.weight
        fields |= {"weight_model": model} if table is None else {"weight": table}
    if prior.physical:
        fields.pop("gain_bound", None)
    if "corner" in fields:
        fields["corner_hz"] = fields.pop("corner") / (2 * math.pi)
    return fields


@functools.lru_cache(maxsize=8)
def _covering(rows: tuple[tuple[float, float], ...], dt: float | None) -> PriorWeight:
    """The weight above a table, for data of a sample time."""
    from robustid.advice import prior_weight
    from robustid.identification import as_weight

    hz, level = zip(*rows, strict=True) if rows else ((), ())
    try:
        return as_weight(prior_weight([2 * math.pi * one for one in hz], level, dt=dt))
    except InputError as error:
        raise InputError(f"[prior] weight (rows [Hz, level]): {error}") from None
