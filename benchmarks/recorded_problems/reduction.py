"""Small models: truncated, within the bounds, worth having, and what they lose."""

from __future__ import annotations

import control
import numpy as np

import robustid as rid
from robustid.reduction import hankel_singular_values, hinf_error, model_worth_having

from .plants import HZ, modal_system, structure
from .registry import of, problem

NAMES = "model order hankel bound bounds status margin"


@problem(quick=True)
def truncations(_):
    model = modal_system(modes=4)
    sampled = model.sample(1 / 4000)
    weight = control.ss([[-HZ * 50]], [[HZ * 50]], [[1.0]], [[0.01]], 0)
    found = {
        "order": rid.balanced_truncation(model, order=4),
        "tol": rid.balanced_truncation(model, tol=0.1 * float(hankel_singular_values(model)[0])),
        "discrete": rid.balanced_truncation(sampled, order=4),
        "static gain": rid.balanced_truncation(model, order=4, match="static gain"),
        "band": rid.balanced_truncation(model, order=4, band_hz=(10.0, 100.0)),
        "horizon": rid.balanced_truncation(model, order=4, horizon=0.1),
        "weight": rid.balanced_truncation(model, order=4, weight=weight),
    }
    peak = hinf_error(model, found["order"].model)
    return {name: of(one, NAMES) for name, one in found.items()} | {"peak": [peak.value, peak.omega]}


@problem()
def within_bounds(_):
    found = rid.identify(structure())
    small = rid.reduce_within_bounds(found)
    inside = rid.reduce_within_bounds(found, band=rid.band(found))
    return {"small": of(small, NAMES + " tried stopped"), "in the band": of(inside, NAMES)}


@problem()
def worth_having(_):
    rng = np.random.default_rng(0)
    omega = np.linspace(2.0, 120.0, 32)
    basis = rid.kautz([30.0, 75.0], [0.05, 0.02], dt=0.01, delay=1)
    values = basis.response(omega * 0.01) @ np.array([0.5, 0.3, 0.1, 0.2])
    level = 0.02 * np.median(np.abs(values))
    values = values + level * (rng.standard_normal(32) + 1j * rng.standard_normal(32))
    frf = rid.FrequencyResponse(omega, values, bound=160 * level, dt=0.01)
    prior = rid.Prior(gain_bound=2 * float(frf.bound.radius.max()), decay_rate=1.3)
    found = rid.identify(rid.MixedProblem(frequency=frf, prior=prior, parametric=basis))
    worth = model_worth_having(found, rid.reduce_within_bounds(found), frf, time_limit=None)
    names = "orders misfits withheld carried misfit smallest_misfit fit worse best summary"
    return of(worth, names) | {"model": worth.reduction.model, "order": worth.reduction.order}


@problem(quick=True)
def continuous_of_discrete(_):
    model = modal_system(modes=3).sample(1 / 4000)
    found = rid.to_continuous(model)
    return {"model": found.model, "error": found.error}
