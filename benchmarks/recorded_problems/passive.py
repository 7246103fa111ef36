"""Passive classes, and passive models of fits."""

from __future__ import annotations

import control
import numpy as np

import robustid as rid

from .identification import facts
from .plants import HZ, foster, mobility_response, noisy, scattering
from .registry import of, problem

DECAY = 0.5 * 0.05 * HZ * 31.0


@problem(quick=True)
def passive_positive_real(_):
    asked = rid.MixedProblem(frequency=mobility_response(), prior=rid.PositiveReal(decay=DECAY, slack=0.02))
    found = rid.identify(asked)
    error = rid.worst_case_error(found, omega=HZ * np.array([30.0, 42.0]), directions=4, rtol=0.2)
    return facts(found) | {"error": of(error, "upper lower magnitude phase certified")}


@problem(quick=True)
def passive_negative_imaginary(_):
    asked = rid.MixedProblem(frequency=mobility_response(turn=1), prior=rid.NegativeImaginary(decay=DECAY, slack=0.02))
    return facts(rid.identify(asked))


@problem(quick=True)
def passive_bounded_real(_):
    omega = np.geomspace(0.5, 50.0, 7)
    frf = noisy(scattering(foster(ports=2, modes=2)), omega, 0.005)
    found = rid.identify(
        rid.MixedProblem(
            frequency=rid.FrequencyResponse(omega, frf.values, bound=0.03), prior=rid.BoundedReal(decay=0.02)
        )
    )
    return facts(found)


@problem(quick=True)
def passive_modes_of_mobility(_):
    basis = rid.passive.passive_modes(HZ * np.array([31.0, 52.0]), [0.06, 0.05])
    asked = rid.MixedProblem(
        frequency=mobility_response(), prior=rid.PositiveReal(decay=HZ * 10.0, slack=0.02), parametric=basis
    )
    return {"basis": basis.response(HZ * np.array([10.0, 31.0, 80.0]))} | facts(rid.identify(asked))


@problem(quick=True)
def passive_turned_sensor(_):
    frf = mobility_response(lines=8)
    turned = rid.FrequencyResponse(frf.omega, -frf.values, bound=frf.bound)
    found = rid.identify(rid.MixedProblem(frequency=turned, prior=rid.PositiveReal(decay=DECAY, slack=0.02)))
    return facts(found) | {"diagnosis": rid.diagnose(found, time_limit=None).summary()}


def proof(found):
    return of(found, "kind holds status margin peak omega bands decay summary")


@problem(quick=True, loose=("scattering/omega",))
def prove_passive(_):
    scattered, impedance = scattering(foster()), foster()
    worse = control.ss(scattered.A, scattered.B, scattered.C, 1.02 * scattered.D + 0.3 * np.eye(2), 0)
    found = {
        "scattering": rid.prove_passive(scattered),
        "impedance": rid.prove_passive(impedance, kind="positive real"),
        "not passive": rid.prove_passive(worse),
    }
    verified = found["scattering"].certificate.verify(scattered)
    return {name: proof(one) for name, one in found.items()} | {"verified": verified}


@problem(loose=("model/proof/omega", "small/proof/omega", "data/"))
def make_passive(_):
    scattered = scattering(foster())
    worse = control.ss(scattered.A, scattered.B, 1.03 * scattered.C, 1.02 * scattered.D, 0)
    names = "model order status error margin"
    data = noisy(scattered, np.geomspace(0.3, 300, 30), 1e-3)
    found = {"model": rid.passive.make_passive(worse), "data": rid.passive.make_passive(worse, response=data)}
    found["small"] = rid.passive.reduce_passive(scattered, order=3)
    return {name: of(one, names) | {"proof": proof(one.passivity)} for name, one in found.items()}
