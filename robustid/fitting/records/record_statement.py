"""The question of a fit of records: the arguments of fit_records, checked, as spectral lines."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from robustid.core import Real, as_array
from robustid.data import FrequencyResponse, TimeRecord, as_frequency_response, as_records
from robustid.errors import InputError
from robustid.fitting.fraction.criterion import Weight
from robustid.fitting.fraction.default_weight import exact_covariance
from robustid.fitting.fraction.statement import stated
from robustid.fitting.records.record_lines import Experiments, Lines, spectra
from robustid.identification import check_model

_SAME_DT = 1e-9


def checked_records(records: Any) -> tuple[TimeRecord, ...]:
    """The records, if they belong together and every sample of them counts."""
    given = tuple(as_records("records", records))
    for number, record in enumerate(given):
        if abs(record.dt - given[0].dt) > _SAME_DT * given[0].dt:
            raise InputError(
                f"`records` must have one sample time; got dt = {given[0].dt:g} s, and {record.dt:g} s at position {number}"
            )
        for axis in ("inputs", "outputs"):
            names, first = ([signal.name for signal in getattr(one, axis)] for one in (record, given[0]))
            if names != first:
                raise InputError(
                    f"`records` must have the same {axis}, in one order; got {first}, and {names} at position {number}"
                )
        if not np.all(record.used):
            raise InputError(
                f"`records` has samples that are not used (an infinite bound) at position {number}; cut them off:"
                ' record.window(start, stop, past="unknown")'
            )
    return given


def checked_response(frf: Any, record: TimeRecord) -> FrequencyResponse:
    """The response, if it belongs to the records."""
    frf = as_frequency_response("frf", frf)
    if frf.dt is None or abs(frf.dt - record.dt) > _SAME_DT * record.dt:
        raise InputError(f"`frf` must have the sample time of `records`, dt = {record.dt:g} s; got dt = {frf.dt}")
    for axis in ("inputs", "outputs"):
        here, wanted = len(getattr(frf, axis)), len(getattr(record, axis))
        if here != wanted:
            raise InputError(f"`frf` must have the {wanted} {axis} of `records`; got {here}")
    return frf


def posed(
    records: tuple[TimeRecord, ...], frf: FrequencyResponse | None, order: int, feedthrough: bool, offset: bool
) -> Experiments:
    """The experiments that are fitted; InputError where the data can't carry the order."""
    nu, ny = records[0].u.shape[1], records[0].y.shape[1]
    unknowns, equations = order * (nu + ny) + feedthrough * nu * ny, 0
    for number, record in enumerate(records):
        if len(record.u) <= order:
            raise InputError(
                f"`records` has {len(record.u)} samples at position {number}, no more than `order` = {order}; lower the order or"
                " leave the record out"
            )
        unknowns += order * (record.initial == "free") + offset * ny
        equations += ny * len(record.u)
    if frf is not None:
        equations += 2 * int(np.sum(~frf.missing))
    if unknowns >= equations:
        raise InputError(
            f"`order` = {order} has {unknowns} unknowns, with those of the initial states, but the data give only {equations}"
            " equations; lower the order or give longer records"
        )
    everything = np.concatenate([record.u for record in records]), np.concatenate([record.y for record in records])
    moved, size = (np.sqrt(np.mean(part**2, axis=0)) for part in everything)
    for name, level, names in (("u", moved, records[0].inputs), ("y", size, records[0].outputs)):
        if not np.all(level):
            what = names[int(np.argmin(level))]
            raise InputError(f"`records` have `{name}` = 0 throughout in signal {what}; leave that signal out")
    unit = np.asarray(2.0 ** np.round(np.log2(moved)), dtype=float)
    columns = nu
    lines: list[Lines] = []
    for record in records:
        free = record.initial == "free"
        lines.append(spectra(record, unit, columns if free else None, offset))
        columns += free
    if frf is None:
        return Experiments(tuple(lines), unit, size, order, feedthrough)
    question = stated(frf, min(order, 1), "z", "right", None, feedthrough, None)
    problem = dataclasses.replace(question.problem, values=question.problem.values * unit)
    problem = dataclasses.replace(problem, weight=_per_unit(problem.weight, unit))
    return Experiments(tuple(lines), unit, size, order, feedthrough, problem, exact_covariance(frf))


def _per_unit(weight: Weight, unit: Real) -> Weight:
    """The weight of a response whose inputs are counted in units."""
    if weight.matrix is None:
        return weight.scaled(np.broadcast_to(1 / unit, weight.shape))
    ny = weight.shape[1]
    return dataclasses.replace(weight, matrix=weight.matrix / np.repeat(unit, ny))


def given_levels(weight: Any, ny: int) -> Real:
    """Levels that a weight per output says."""
    weight = as_array("weight", weight, ndim=1)
    if weight.shape != (ny,) or not np.all(weight > 0):
        raise InputError(f"`weight` must hold one number > 0 for each of the {ny} outputs; got {weight.tolist()}")
    return 1 / np.asarray(weight, dtype=np.float64)


def given_start(start: Any, order: int, record: TimeRecord) -> tuple[Real, Real]:
    """A and C of a model that was given."""
    model = check_model("start", start)
    shape = (model.nstates, model.noutputs, model.ninputs)
    wanted = (order, record.y.shape[1], record.u.shape[1])
    if shape != wanted or not model.isdtime(strict=True):
        raise InputError(
            f"`start` must be a discrete model of {wanted[0]} states, {wanted[1]} outputs and {wanted[2]} inputs; got"
            f" {shape[0]}, {shape[1]} and {shape[2]}, dt = {model.dt}"
        )
    return np.asarray(model.A, dtype=float), np.asarray(model.C, dtype=float)
