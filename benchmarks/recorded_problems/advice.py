"""What to choose, change and measure next."""

from __future__ import annotations

import numpy as np

import robustid as rid
from robustid.advice import content as content_of

from .plants import DT, HZ, compliance_problem, matrix_response, structure
from .registry import of, problem

FINE = tuple(np.linspace(17.2, 18.1, 10))
KAUTZ = "omega damping omega_interval damping_interval level undetermined delay reason summary"


@problem()
def suggest_kautz(_):
    frf = structure(lines=11, extra_hz=FINE, time=False).frequency[0]
    found = {"discrete": frf, "continuous": compliance_problem(lines=30).frequency[0]}
    return {name: of(rid.suggest_kautz(one), KAUTZ) for name, one in found.items()}


@problem()
def suggest_kautz_matrix(_):
    found = {
        "two modes": rid.suggest_kautz(matrix_response(lines=40, modes=2, noise=0.02)),
        "one asked": rid.suggest_kautz(matrix_response(lines=24), modes=1, repeat=2),
    }
    return {name: of(one, KAUTZ) for name, one in found.items()}


@problem()
def improve_kautz(_):
    found = rid.advise.improve_kautz(structure(hz=17.3, lines=4, samples=4))
    names = (
        "margin margin_lower omega damping omega_before damping_before repeated slope margins moved reason note summary"
    )
    return of(found, names)


@problem(quick=True)
def suggest_prior(_):
    asked = structure(lines=4, samples=4)
    names = "decay_rates gains errors reason summary safety"
    slope = rid.suggest_prior(asked, decay_rates=[1.02, 1.05, 1.1, 1.2])
    scaling = rid.advise.suggest_scaling(matrix_response(lines=8))
    falls = rid.advise.suggest_roll_off(compliance_problem())
    return {
        "slope": of(slope, names) | {"gain": slope.prior.gain_bound, "rate": slope.prior.decay_rate},
        "scaling": scaling,
        "roll-off": None if falls is None else of(falls, "gain_bound roll_off corner"),
    }


@problem()
def suggest_class(_):
    frf = structure(lines=8, extra_hz=FINE[::3], time=False).frequency[0]
    found = rid.advise.suggest_class(frequency=frf)
    names = "pairs repeat margin upper median largest worst mean note"
    return {"candidates": [of(one, names) for one in found.candidates], "summary": found.summary()}


@problem()
def suggest_next(_):
    found = rid.identify(structure(lines=4, samples=4))
    candidates = HZ * np.array([3.0, 14.0, 25.0, 45.0])
    best = rid.suggest_next(found, candidates=candidates, bound=0.02)
    return [of(one, "kind at lower upper bound guaranteed possible remaining") | {"text": str(one)} for one in best]


@problem(loose=("far/",))
def diagnose(_):
    found = {}
    for name, hz in {"moved": 17.3, "far": 14.0}.items():
        said = rid.diagnose(rid.identify(structure(hz=hz, lines=4, samples=4)), time_limit=None)
        causes = [of(one, "cause margin evidence change solves unsure sentence") for one in said.causes]
        trials = [{"change": one.name, "margin": one.margin} for one in said.corrections]
        found[name] = {"inflation": said.inflation, "causes": causes, "trials": trials} | of(
            said, "notes left_out summary"
        )
    return found


@problem(quick=True)
def content(_):
    names = "omega on between separation margin order empty ratio signs summary"
    says = structure(time=False, lines=11, gain_bound=0.1, decay_rate=1.2)
    nothing = structure(time=False, lines=11, gain_bound=10.0, decay_rate=1.005)
    return {name: of(content_of(rid.identify(one)), names) for name, one in {"says": says, "nothing": nothing}.items()}


@problem()
def sensitivity(_):
    found = rid.advise.sensitivity(structure(lines=4, samples=4), omega=HZ * np.array([5.0]))
    rows = [of(one, "what kind gain_bound decay_rate lines margin median worst") for one in found.variations]
    return {"variations": rows, "left out": found.left_out, "summary": found.summary()}


@problem(quick=True)
def prior_weight(_):
    omega, level = HZ * np.array([1.0, 5.0, 20.0, 45.0]), np.array([2.0, 1.0, 0.3, 0.1])
    return {
        "discrete": rid.advise.prior_weight(omega, level, dt=DT),
        "continuous": rid.advise.prior_weight(omega, level, order=2),
    }
