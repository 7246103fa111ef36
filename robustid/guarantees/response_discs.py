"""Discs that are said to hold a response: of a band, a worst-case error, or a response with its bound."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

from robustid.core import Complex, Real, plane_of
from robustid.data import FrequencyResponse
from robustid.errors import InputError, InputTypeError
from robustid.guarantees.band_result import Band
from robustid.guarantees.family_result import Family
from robustid.guarantees.over_cells import WorstCase

Discs = Band | WorstCase | FrequencyResponse


class ResponseDiscs(NamedTuple):
    """Discs that are said to hold the response: `omega` (F,) rad/s, `centre` and `radius` (F, ny, nu), `dt` in s or 0."""

    omega: Real
    centre: Complex
    radius: Real
    dt: float

    @classmethod
    def of(cls, thing: object) -> ResponseDiscs:
        """The band of a worst-case error, of a family, or of a response with its bound."""
        if isinstance(thing, FrequencyResponse):
            if thing.bound is None:
                raise InputError("`band` is a response without a bound; use with_bound(...), or estimate_frf")
            return cls(thing.omega, thing.values, thing.bound.outer_radius, float(thing.dt or 0.0))
        if isinstance(thing, Band):
            radius = dataclasses.replace(thing, model=None).upper  # about the centres, polygons included
            return cls(thing.omega, thing.centre, radius, thing.problem.dt)
        if isinstance(thing, WorstCase):
            model, omega = thing.model, thing.omega
            return cls(omega, plane_of(model.dt, omega).values_at(model, omega), thing.upper, float(model.dt))
        raise InputTypeError(
            "`band` must be a Band, a WorstCaseError, a WorstCaseOverPoles, a Family or a FrequencyResponse; got"
            f" {type(thing).__name__}"
        )


def discs_by_condition(band: Discs) -> dict[str, Discs]:
    """Bands of the members of a family by their names, around their own models; of one machine its band, without a name."""
    if not isinstance(band, Family):
        return {"": band}
    return {m.name: m.result.with_model(m.identification.model) for m in band.members}
