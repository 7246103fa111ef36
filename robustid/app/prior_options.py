"""The options that state a class: the section [prior] of a run file."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, Any

from robustid.app.checks import AUTO, auto_or, key, listed, number, several, text, whole
from robustid.errors import InputError

if TYPE_CHECKING:
    from robustid.identification import Prior

_positive = number(above=0)
_NOTE = "How the program chose these values, in words; written by the program."


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
        " real: impedance, velocity per force at the same points; negative imaginary: displacement per force; bounded real:"
        " scattering parameters.",
        flag="--passive",
    )
    slack: float | None = key(
        number(least=0), help="Of positive real plants: how far below 0 the real part may be, in units of the response."
    )
    scaling: tuple | None = key(
        several(several(_positive)), help="Of MIMO responses: sizes of the entries, one row an output."
    )
    roll_off: int | str | None = key(
        auto_or(whole(1, 8)),
        help='Prior: the gain bound falls as frequency^-N above the corner, 2 for a mass line; with a corner. "auto": the steepest'
        " that leaves the gain bound nearly as small, where there is one (`suggest_roll_off`).",
        flag="--roll-off",
        text=lambda _, content: int(content) if content.isdigit() else content,
        metavar="N",
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
        if self.roll_off in (None, AUTO) or self.corner_hz is None:
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
