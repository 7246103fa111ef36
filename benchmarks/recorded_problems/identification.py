"""Margins, models and certificates of every kind of samples and of classes."""

from __future__ import annotations

import dataclasses

import control
import numpy as np

import robustid as rid

from .plants import DT, HZ, compliance_problem, matrix_problem, matrix_record, matrix_response, structure
from .registry import of, problem

NAMES = "status margin margin_lower consistent form length order tail solver parameters model notes warnings summary"


def facts(result):
    """What an identification says, and what was verified."""
    checks = result.verification.checks
    return of(result, NAMES) | {
        "limiting": result.conflicting_samples(),
        "active intervals": result.active_intervals,
        "residuals": [one.ratio for one in result.residuals],
        "verified": result.verification.passed,
        "checks": {
            check.name: [check.measured, check.limit, 1.0] for check in checks
        },  # rounding errors are parts of 1
    }


@problem(quick=True)
def identify_mixed(_):
    asked = structure()
    found = rid.identify(asked)
    omega = np.linspace(5, 300, 7)
    centre, radius = found.weyl_disc(omega)
    return facts(found) | {"problem": of(asked, "angles coefficients"), "centre": centre, "radius": radius}


@problem()
def identify_forms(_):
    asked = structure(lines=4, samples=4)
    found = {form: rid.identify(asked, form=form) for form in ("orthonormal", "classical", "taylor", "sections")}
    found["cvxpy"] = rid.identify(structure(lines=3, samples=3, extra_hz=()), solver="cvxpy")
    return {name: of(one, "status margin form solver model") for name, one in found.items()}


@problem()
def identify_objectives(_):
    from robustid.identification import OBJECTIVES

    return {one: of(rid.identify(structure(lines=4, samples=4), objective=one), "margin model") for one in OBJECTIVES}


@problem(quick=True)
def identify_inconsistent(_):
    return facts(rid.identify(structure(hz=17.0)))


@problem(quick=True)
def identify_continuous(_):
    return facts(rid.identify(compliance_problem()))


@problem(quick=True)
def identify_roll_off(_):
    found = {
        "continuous": compliance_problem(roll_off=2, corner=HZ * 60.0, gain_bound=0.4),
        "discrete": structure(roll_off=1, corner=HZ * 20.0, gain_bound=0.4),
    }
    return {name: facts(rid.identify(one)) for name, one in found.items()}


@problem(quick=True)
def identify_weighted(_):
    table = HZ * np.array([1.0, 10.0, 30.0]), np.array([1.0, 0.5, 0.2])
    weight = rid.advise.prior_weight(*table, dt=DT)
    over = rid.advise.prior_weight(*table)
    found = {"discrete": structure(weight=weight, gain_bound=0.4), "continuous": compliance_problem(weight=over)}
    return {"weight": weight, "over": over} | {name: facts(rid.identify(one)) for name, one in found.items()}


def record_of(initial, samples=12):
    """A first-order plant, in steady state where `periodic`; before it a known bound on the input where `free`."""
    rng = np.random.default_rng(4)
    u, h = rng.uniform(-1, 1, samples), 0.5 ** np.arange(200)
    past = {"rest": np.zeros(200), "free": rng.uniform(-1, 1, 200), "periodic": np.tile(u, 200 // samples)}[initial]
    y = np.convolve(np.concatenate([past, u]), h)[past.size : past.size + samples]
    y = y + 0.04 * rng.uniform(-1, 1, samples)
    more = {"past_input_bound": 1.0} if initial == "free" else {}
    return rid.TimeRecord(u, y, dt=DT, bound=0.05, initial=initial, **more)


@problem(quick=True)
def identify_records(_):
    prior = rid.Prior(gain_bound=3.0, decay_rate=1.3)
    found = {
        initial: facts(rid.identify(rid.MixedProblem(time=record_of(initial), prior=prior)))
        for initial in ("rest", "free", "periodic")
    }
    both = rid.MixedProblem(time=[record_of("rest"), record_of("periodic")], prior=prior)
    return found | {"both": facts(rid.identify(both))}


@problem(quick=True)
def identify_matrix(_):
    return facts(rid.identify(matrix_problem(matrix_response(), matrix_record())))


@problem(quick=True)
def identify_symmetric(_):
    frf = matrix_response(symmetric=True)
    return facts(rid.identify(matrix_problem(frf, symmetric=True))) | {
        "scaled": facts(
            rid.identify(
                matrix_problem(frf, prior=rid.Prior(gain_bound=0.5, decay_rate=1.15, scaling=[[1.0, 2.0], [2.0, 4.0]]))
            )
        )
    }


@problem(quick=True)
def identify_tangential(_):
    rng = np.random.default_rng(5)
    frf = matrix_response(lines=8)
    right = rng.standard_normal((8, 2, 1)) + 1j * rng.standard_normal((8, 2, 1))
    seen = frf.tangential(right=right)
    by_left = frf.tangential(left=rng.standard_normal((8, 1, 2)))
    found = {"right": seen, "left": by_left}
    return {name: {"data": one} | facts(rid.identify(matrix_problem(one))) for name, one in found.items()}


@problem(quick=True)
def identify_joint_bounds(_):
    frf = matrix_response(lines=6)
    covariance = np.broadcast_to(0.02**2 * (np.eye(4) + 0.3), (6, 4, 4))
    plain = rid.FrequencyResponse(frf.omega, frf.values, covariance=covariance, dt=DT)
    found = {
        "column": rid.FrequencyResponse(frf.omega, frf.values, bound=rid.Bound(0.08, joint="column"), dt=DT),
        "matrix": plain.with_ellipsoid(3.0),
        "confidence": plain.with_joint_bound(0.95),
    }
    return {
        name: {"bound": one.bound} | of(rid.identify(matrix_problem(one)), "status margin model")
        for name, one in found.items()
    }


@problem(quick=True)
def identify_ellipses(_):
    asked = structure(time=False)
    frf = asked.frequency[0]
    covariance = np.array([[1.0, 0.4], [0.4, 0.5]]) * (frf.bound.radius.ravel()[:, None, None] / 2) ** 2
    narrow = frf.with_ellipses(covariance, 2.0)
    found = rid.identify(dataclasses.replace(asked, frequency=narrow))
    return {"bound": narrow.bound} | facts(found)


@problem(quick=True, loose=("summary",))
def identify_parameter_bounds(_):
    one = control.ss([], [], [], 1.0, DT, name="one")
    frf = rid.FrequencyResponse([0.0, 50.0], [3.0, 3.0], bound=0.1, dt=DT)
    prior = rid.Prior(gain_bound=1.0, decay_rate=1.2)
    asked = rid.MixedProblem(frequency=frf, prior=prior, parametric=one, parameter_bounds=[(0.0, 1.0)])
    return facts(rid.identify(asked))


@problem(quick=True)
def validate_models(_):
    asked = structure()
    found = rid.identify(asked)
    names = "fit ratio outside whiteness residuals predicted summary"
    return {
        "record": of(rid.validate(found.model, asked.time[0]), names),
        "response": of(rid.validate(found.model, asked.frequency[0]), names),
    }
