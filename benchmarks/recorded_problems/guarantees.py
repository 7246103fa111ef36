"""Bounds of all consistent systems: sweeps, boxes of poles, bands, contradictions, families, weights, margins."""

from __future__ import annotations

import control
import numpy as np

import robustid as rid

from .plants import DT, HZ, compliance_problem, matrix_problem, matrix_record, matrix_response, structure
from .registry import of, problem

AT = HZ * np.array([5.0, 17.4, 30.0])
BOX = HZ * np.array([[17.65, 17.69]]), np.array([[0.0036, 0.0044]])
CONTROLLER = control.ss(control.tf([0.2, -0.15], [1, -0.5], DT))


def error_facts(error):
    names = "omega upper lower sigma_upper sigma_lower magnitude phase gap certified nominal summary"
    return of(error, names) | {
        "intervals": [error.parameters.lower, error.parameters.upper],
        "vertices": [one.vertices for one in error.values],
        "verified": error.verify(),
    }


@problem()
def worst_case_discrete(_):
    error = rid.worst_case_error(rid.identify(structure(lines=4, samples=4)), omega=AT[:2], directions=6, rtol=0.1)
    circle = error.circle
    return error_facts(error) | {
        "circle": of(circle, "edges bound lower peak converged"),
        "hinf": error.hinf,
        "weight": of(error.weight(order=2), "model ratio order certified"),
        "margin": of(error.robust_stability_margin(CONTROLLER), "margin frequency status guaranteed"),
    }


@problem(quick=True)
def worst_case_continuous(_):
    error = rid.worst_case_error(rid.identify(compliance_problem(lines=8)), omega=AT, directions=4, rtol=0.2)
    return error_facts(error)


@problem()
def worst_case_matrix(_):
    found = rid.identify(matrix_problem(matrix_response(lines=4), prior=rid.Prior(gain_bound=0.4, decay_rate=1.5)))
    return error_facts(rid.worst_case_error(found, omega=HZ * np.array([10.0, 30.0]), directions=3, rtol=0.3))


@problem(quick=True)
def worst_case_poles(_):
    asked = structure(lines=4, samples=4)
    found = rid.guarantee.worst_case_over_poles(rid.identify(asked), *close_box(), omega=AT[:2], directions=4, cells=2)
    names = "upper magnitude omega sigma_upper covered certified poles too_wide claim_count not_relaxed_enough summary"
    return of(found, names)


def close_box():
    """The box of the two modes, the first known well."""
    omega, damping = BOX
    return np.vstack([HZ * np.array([[8.99, 9.01]]), omega]), np.vstack([[[0.099, 0.101]], damping])


def band_facts(band):
    names = "omega centre radius range amplitudes bounded narrowed certified open_ranges summary"
    low, high = band.range
    between = np.linspace(low, 0.99 * high if np.isfinite(high) else 4 * AT[-1], 40)
    centre, radius = band.at(between)
    return of(band, names) | {"between": [centre, radius]}


@problem()
def band_fixed(_):
    found = rid.identify(structure())
    band = rid.band(found)
    return band_facts(band) | {
        "error": band.error_at(AT),
        "upper": band.upper,
        "hinf": band.hinf,
        "circle": of(band.circle, "edges bound"),
        "static gain": band.static_gain,
        "impulse": band.impulse_response(12),
        "step": band.step_response(12),
        "peak": band.peak_step(12),
        "verified": band.verify(),
        "weight": of(band.weight(order=2), "model ratio certified"),
        "margin": of(band.robust_stability_margin(CONTROLLER), "margin frequency status"),
    }


@problem(quick=True)
def band_box(_):
    band = rid.band(structure(lines=10, samples=10), box=close_box(), omega=AT)
    return band_facts(band) | {"verified": band.verify()}


@problem()
def band_continuous(_):
    asked = compliance_problem(lines=14)
    box = HZ * np.array([[2.99, 3.01], [17.66, 17.68]]), np.array([[0.019, 0.021], [0.0095, 0.0105]])
    return {"fixed": band_facts(rid.band(asked)), "box": band_facts(rid.band(asked, box=box, omega=AT))}


@problem()
def band_matrix(_):
    frf = matrix_response()
    found = {
        "plain": rid.band(matrix_problem(frf, matrix_record()), omega=AT),
        "symmetric": rid.band(matrix_problem(matrix_response(symmetric=True), symmetric=True), omega=AT),
    }
    return {name: band_facts(one) | of(one, "sigma_upper" if one.model else "radius") for name, one in found.items()}


@problem(quick=True)
def band_records(_):
    from .identification import record_of

    frf = rid.FrequencyResponse(
        np.linspace(5.0, 300.0, 6), 1 / (1 - 0.5 * np.exp(-1j * DT * np.linspace(5.0, 300.0, 6))), bound=0.05, dt=DT
    )
    prior = rid.Prior(gain_bound=3.0, decay_rate=1.3)
    return {
        initial: band_facts(rid.band(rid.MixedProblem(frequency=frf, time=record_of(initial), prior=prior)))
        for initial in ("rest", "free", "periodic")
    }


@problem()
def band_refined(_):
    found = rid.identify(structure(lines=4, samples=4))
    band = rid.band(found, knots=40).refine(found, omega=AT[:2])
    return band_facts(band) | {"error": band.error_at(AT), "words": band.narrowing_words}


@problem(quick=True)
def contradiction(_):
    names = "entry omega time measured centre radius bound excess factor points multipliers verify summary"
    lines = {"lines": structure(hz=17.0, time=False), "record": structure(hz=17.0), "box": structure(hz=15.0)}
    box = HZ * np.array([[8.99, 9.01], [14.9, 15.1]]), np.array([[0.099, 0.101], [0.0036, 0.0044]])
    found = {name: rid.guarantee.contradiction(one, box=box if name == "box" else None) for name, one in lines.items()}
    none = rid.guarantee.contradiction(structure())
    facts = {name: None if one is None else of(one, names) for name, one in found.items()}
    for name in ("centre", "radius", "multipliers"):  # over the box hardly determined: 3e-5 apart on two processors
        del facts["box"][name]
    return facts | {"none": none is None}


def member(gain, seed):
    """Gain times (0.4 + 0.3/z)/(1 - 0.2/z), measured at five lines."""
    omega = np.array([2.0, 8.0, 14.0, 20.0, 26.0])
    z = np.exp(-0.1j * omega)
    error = 0.018 * np.exp(1j * HZ * np.random.default_rng(seed).uniform(0, 1, omega.size))
    values = gain * (0.4 + 0.3 * z) / (1 - 0.2 * z) + error
    frf = rid.FrequencyResponse(omega, values, bound=0.02, dt=0.1)
    return rid.identify(rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=3.0, decay_rate=2.0)))


@problem(quick=True)
def family(_):
    members = [
        rid.guarantee.Member(member(gain, k), name, amplitude=10 * gain)
        for k, (name, gain) in enumerate({"weak": 0.8, "strong": 1.3}.items())
    ]
    found = rid.family(members, omega=[0.0, 2.0, 11.0, 20.0], directions=6, interval=(5, 13))
    controller = control.ss([], [], [], 0.1, 0.1)
    margin = found.robust_stability_margin(controller)
    return of(found, "upper uppers sigma_upper nominal model tried drivers names not_known certified summary") | {
        "cover": found.cover("multiplicative"),
        "hinf": found.hinf,
        "weight": of(found.weight(order=1), "model ratio"),
        "margin": of(margin, "margin frequency status"),
        "moved": found.with_model(control.ss([], [], [], 1.0, 0.1)).upper,
    }


@problem(quick=True)
def coverage(_):
    frf = structure(time=False).frequency[0]
    wide = frf.with_bound(2 * frf.bound.radius)
    rng = np.random.default_rng(6)
    later = [
        rid.FrequencyResponse(
            frf.omega, frf.values + size * frf.bound.radius * np.exp(1j * HZ * rng.random(frf.values.shape)), dt=DT
        ).with_bound(frf.bound.radius)
        for size in (0.5, 1.5, 4.0)
    ]
    names = "contradicted excess largest next_record scores sentences share summary verdict where in_order exchangeable"
    names += " judgement power"
    return {
        "records": of(rid.coverage(wide, later), names),
        "one": of(rid.coverage(wide, later[:1]), names),
        "about a band": of(rid.coverage(rid.band(rid.identify(structure()), omega=frf.omega), later), names),
    }


@problem(quick=True, near=("near/", "far/"))
def refute(_):
    asked = structure(lines=4, samples=4)
    found = rid.identify(asked)
    values = found.model(np.exp(1j * AT * DT))
    near, far = (rid.FrequencyResponse(AT, values + away, bound=0.02, dt=DT) for away in (0.0, 0.5))
    names = "refuted ratio attainable inside worst verify summary"
    return {"near": of(rid.refute(found, near), names), "far": of(rid.refute(found, [far, asked.time[0]]), names)}


@problem()
def tube_and_diameter(_):
    found = rid.identify(structure(lines=4, samples=4))
    tube = rid.guarantee.response_tube(found, input="step", times=[0.0, 0.01, 0.03])
    diameter = rid.guarantee.diameter(found.problem, omega=AT[:1], directions=4, rtol=0.3)
    return {
        "tube": of(tube, "times nominal lower upper error_upper error_lower peak error_peak verify summary"),
        "diameter": of(diameter, "omega upper lower largest summary"),
    }


@problem()
def structured_weights(_):
    nominal = control.ss(np.diag([0.9, 0.5]), np.eye(2), [[0.1, 0.2], [0.0, 0.5]], np.zeros((2, 2)), 0.1)
    edges = np.linspace(0, np.pi, 7) / 0.1
    bound = 0.02 * (1 + np.arange(6))[:, None, None] * np.array([[1.0, 0.5], [0.2, 2.0]])
    controller = control.ss([], [], [], 0.1 * np.eye(2), 0.1)
    found = rid.guarantee.structured_weights(nominal, edges, bound, controller=controller, order=1)
    kinds = ("additive", "multiplicative", "inverse")
    largest = bound.max(axis=(1, 2))
    margins = [rid.guarantee.robust_stability_margin(nominal, controller, edges, largest, kind=kind) for kind in kinds]
    one = rid.guarantee.uncertainty_weight(nominal, edges, largest, kind="multiplicative", order=2)
    return {
        "weights": [
            of(one, "structure order radius certified left right") | {"margin": one.margin.margin} for one in found
        ],
        "margins": [of(one, "margin frequency status structure margins") for one in margins],
        "multiplicative": of(one, "kind model ratio certified"),
    }


@problem(near=("errors/",))
def growing(_):
    """A bound at one frequency after the other, of a plant with an integrator."""
    from robustid.guarantees import growing_error

    frf = structure(time=False, lines=5).frequency[0]
    basis = rid.integrators(dt=DT)
    values = frf.values + (basis.response(frf.omega * DT) @ [0.01])[:, None, None]
    asked = rid.MixedProblem(
        frequency=rid.FrequencyResponse(frf.omega, values, bound=0.3, dt=DT),
        prior=rid.Prior(gain_bound=200.0, decay_rate=1.02),
        parametric=basis,
    )
    found = rid.identify(asked)
    errors = list(growing_error(found, AT, directions=4, gap=0.2))
    return {"errors": [of(one, "omega upper lower") for one in errors], "band": band_facts(rid.band(found))}


@problem()
def verified_exactly(_):
    """In ball arithmetic, every rounding enclosed."""
    asked = structure(lines=3, samples=3, extra_hz=())
    found = rid.identify(asked)
    box = rid.guarantee.worst_case_over_poles(found, *close_box(), omega=AT[:1], directions=3, cells=1)
    wrong = rid.guarantee.contradiction(structure(hz=17.0, lines=3, samples=3))
    return {
        "band": rid.band(found, omega=AT, knots=12).verify(exact=True),
        "contradiction": wrong.verify(exact=True),
        "box": box.verify(),
    }


@problem(near=("continuous/error/",))
def many_lines(_):
    """Enough samples for forms of few coefficients: sections, one entry and matrices, and their worst-case errors."""
    table = {}
    for name, asked in {
        "discrete": structure(lines=40, samples=20),
        "continuous": compliance_problem(lines=40),
        "matrix": matrix_problem(matrix_response(lines=16)),
        "symmetric": matrix_problem(matrix_response(lines=12, symmetric=True), symmetric=True),
    }.items():
        found = rid.identify(asked, form="sections" if asked.symmetric else "auto")
        table[name] = of(found, "status margin form length model")
        if name in ("discrete", "continuous"):
            error = rid.worst_case_error(found, omega=AT[:1], directions=4, rtol=0.2)
            table[name]["error"] = of(error, "upper lower certified")
    return table
