"""The question of a fit: the arguments of fit_mfd, checked, as problem, samples and form."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np

from robustid.core import as_array, as_count, as_flag
from robustid.data import FrequencyResponse, as_frequency_response, expected_feedthrough, stacked
from robustid.errors import InputError
from robustid.fitting.fraction.criterion import Weight
from robustid.fitting.fraction.default_weight import default_weight, exact_covariance, other_weights
from robustid.fitting.fraction.fraction_forms import checked, fitted, problem_of
from robustid.fitting.fraction.fraction_problem import FractionProblem
from robustid.fitting.fraction.rigid_body import RigidBody
from robustid.fitting.state_space.given_poles import Samples


def takes_feedthrough(frf: FrequencyResponse, stated: object, *, excluded: bool) -> bool:
    """Say whether a fit has a feed-through: as it is stated, else where the response is expected to have one."""
    if stated is not None:
        return as_flag("feedthrough", stated)
    return not excluded and expected_feedthrough(frf) is not None


class Statement(NamedTuple):
    """The question of a fit."""

    problem: FractionProblem  # of a right fraction, without constraints and rigid-body modes
    data: Samples  # the same for linear least squares
    form: str  # "left": problem and data are those of the transposed response; "shared": of its entries as one column
    shape: tuple[int, int]  # (ny, nu) of the response
    relative: bool  # whether the weight is relative as nothing is known of the noise
    others: tuple[tuple[FractionProblem, Samples], ...] = ()  # the same in other weights that may predict better


def stated(
    frf: object,
    order: object,
    domain: str | None,
    form: str | None,
    weight: Weight | np.ndarray | None,
    feedthrough: bool,
    body: RigidBody | None,
) -> Statement:
    """Check the arguments of `fit_mfd` and fill in what was left out."""
    frf = as_frequency_response("frf", frf)
    needed = None if body is None else {"input": "right", "output": "left"}[body.side]
    form = checked((needed or "right") if form is None else form)
    if body is not None and form != needed:
        raise InputError(f'`form` must be "{needed}" for rigid-body modes of side "{body.side}"; got "{form}"')
    domain = ("s" if frf.dt is None else "z") if domain is None else domain
    if domain not in ("s", "z") or (domain == "z" and frf.dt is None):
        raise InputError(
            f'`domain` must be "s", or "z" for data with a sample time `dt`; got {domain!r}, dt = {frf.dt}'
        )
    lines, counts = np.unique(frf.omega, return_counts=True)
    if lines.size < frf.omega.size:
        raise InputError(
            f"`frf` has {int(counts.max())} frequency points at {lines[np.argmax(counts)]:g} rad/s; average them, or fit one of"
            " the measurements"
        )
    order = as_count("order", order, least=1)
    given, measured = weight is not None, ~frf.missing
    frf = _filled(frf)
    if not given:
        weight = default_weight(frf, measured, correlated=form != "shared")
    elif not isinstance(weight, Weight):
        weight = Weight(as_array("weight", weight, ndim=3))
    weight = _only(weight, measured) if given else weight
    dt = frf.dt if domain == "z" else None
    plain = FractionProblem(frf.omega, frf.values, order, weight, dt=dt, feedthrough=feedthrough)
    for names, axis in ((frf.outputs, 2), (frf.inputs, 1)):
        for name, known in zip(names, np.any(weight.entries, axis=(0, axis)), strict=True):
            if not known:
                raise InputError(f"`weight` is zero for all of signal {name}; leave that signal out of `frf`")
    if not np.any(weight.apply(frf.values)):
        raise InputError("`frf` is zero wherever it has weight; there is nothing to fit")
    if form == "shared":
        # Residues of an entry without weight are free, and nothing is known of them.
        for i, j in np.argwhere(~np.any(weight.entries, axis=0)):
            raise InputError(
                f'`weight` is zero for all of the entry from {frf.inputs[j]} to {frf.outputs[i]}, whose residues form "shared"'
                ' leaves free; take form "right"'
            )
    problem = problem_of(plain, form)
    if body is not None:
        body.check(problem.values, order, problem.omega)
    data = _samples(problem, frf, form)
    if not given and data.noise is not None and exact_covariance(frf):
        data = data._replace(weight=data.noise)
    others: list[tuple[FractionProblem, Samples]] = []
    if not given and (form != "shared" or frf.values[0].size == 1):
        for other in other_weights(frf, measured):
            same = problem_of(dataclasses.replace(plain, weight=other), form)
            others.append((same, _samples(same, frf, form)))
    return Statement(problem, data, form, frf.values.shape[1:], not given and frf.covariance is None, tuple(others))


def one_weight(frf: FrequencyResponse, form: str | None) -> Weight:
    """The default weight by itself, as it is for fits of all orders, so that their costs can be compared."""
    return default_weight(_filled(frf), ~frf.missing, correlated=form != "shared")


def _filled(frf: FrequencyResponse) -> FrequencyResponse:
    """Zeros where entries are missing, with errors that are independent of all others': what has no weight says nothing."""
    if not np.any(frf.missing):
        return frf
    covariance, known = frf.covariance, stacked(~frf.missing)
    if covariance is not None:
        covariance = np.where(known[:, :, None] & known[:, None, :], covariance, np.eye(known.shape[1]))
    return dataclasses.replace(frf, values=np.where(frf.missing, 0, frf.values), covariance=covariance)


def _only(weight: Weight, measured: np.ndarray) -> Weight:
    """A weight of the user's without the entries that are missing."""
    if np.all(measured):
        return weight
    if not weight.entries_only:
        if weight.shape == measured.shape and not np.any(weight.entries[~measured]):
            return weight
        raise InputError(
            "`weight` mixes the entries of a frequency point, and `frf` misses some: give a weight per entry, or the covariance"
        )
    if weight.shape != measured.shape:
        raise InputError(f"`weight` must have shape {measured.shape} as the values; got {weight.shape}")
    return weight.scaled(measured)


def _samples(problem: FractionProblem, frf: FrequencyResponse, form: str) -> Samples:
    """The data for linear least squares: a weight per entry, and the inverse standard deviation where that is known."""
    domain, noise = "s" if problem.dt is None else "z", None
    if frf.covariance is not None:
        ny, nu = frf.values.shape[1:]
        variance = np.real(np.diagonal(frf.covariance, axis1=1, axis2=2)).reshape(-1, nu, ny).transpose(0, 2, 1)
        with np.errstate(divide="ignore"):
            noise = 1 / np.sqrt(fitted(variance, form))
        noise = np.where(problem.weight.entrywise > 0, noise, 0.0) if np.all(np.isfinite(noise)) else None
    return Samples(problem.values, problem.scale * problem.xi, problem.weight.entrywise, domain, noise)
