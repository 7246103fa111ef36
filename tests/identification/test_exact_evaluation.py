"""Certificates in ball arithmetic, against the same formulas in 60 digits and against the evaluation in doubles."""

import dataclasses
import sys

import mpmath as mp
import numpy as np
import pytest

import robustid as rid
from robustid.bases import Sections
from robustid.identification import Functional, evaluate_support, verify_margin_exactly
from robustid.identification.certificate import evaluate_certificate
from robustid.identification.exact_evaluation import enclose_margin, enclose_support
from robustid.identification.formulation import ExactFormulation, formulate_in
from robustid.identification.formulation.taylor_columns import ShiftColumns
from support.bounds import rebound
from support.cases import seeds
from support.problems import random_problem

pytest.importorskip("flint", reason="python-flint is not installed: robustid[exact]")

FORMS = {
    "time": ("time", 0, {}),
    "frequency": ("frequency", 0, {}),
    "mixed": ("mixed", 0, {}),
    "parametric": ("parametric", 0, {}),
    "taylor": ("mixed", 24, {}),
    "taylor, parametric": ("parametric", 24, {}),
    "ellipses": ("parametric", 0, {"tilt": True}),
    "taylor, ellipses": ("mixed", 24, {"tilt": True}),
    "intervals": ("parametric", 0, {"ends": [[-30.0, 30.0], [-20.0, 10.0]]}),
    "one interval": ("parametric", 24, {"ends": [[-30.0, 30.0], [-np.inf, np.inf]]}),
}


def arrays(name):
    case, length, extra = FORMS[name]
    problem = dataclasses.replace(random_problem(3, case, 10), parameter_bounds=extra.get("ends"))
    if extra.get("tilt"):
        (frf,) = problem.frequency
        tilted = rebound(frf, tilt=0.4 * np.exp(1j * np.arange(frf.omega.size)))
        problem = dataclasses.replace(problem, frequency=tilted)
    data = formulate_in(problem, Sections.shift(length) if length else None).data
    return data.rows, data.sarason


def multipliers(rows, sarason, seed):
    """Any multipliers prove something; those of the free parameters must meet their equation, or the bound is infinite."""
    rng = np.random.default_rng(seed)
    N, n = rows.y.size, sarason.pair.order
    samples = rng.standard_normal(N) + 1j * rng.standard_normal(N) * (np.arange(N) < rows.discs)
    Y = rng.standard_normal((n, 3)) @ rng.standard_normal((3, n))
    functional = Functional(rng.standard_normal(n), rng.standard_normal(rows.P.shape[1]), 0.01)
    return functional, samples, Y


def matrix(a):
    return mp.matrix(a.tolist()) if a.size else mp.matrix(*a.shape)


def reference(functional, samples, S, level, rows, sarason):
    """The bound without the free parameters, by the formula, in 60 digits; Taylor columns from their exponentials."""
    n, E = sarason.pair.order, rows.E
    l_re, l_im = [[mp.mpf(float(v)) for v in part] for part in (samples.real, samples.imag)]
    pairs = (l_re, rows.y.real), (l_im, rows.y.imag)
    total = sum(a * mp.mpf(b) for one, y in pairs for a, b in zip(one, y.tolist(), strict=True))
    tails = [mp.mpf(level) + t for t in rows.tail.tolist()]
    total += sum(mp.hypot(a, b) * t for a, b, t in zip(l_re, l_im, tails, strict=True))
    A, c, S = matrix(sarason.pair.A), matrix(sarason.pair.c), matrix(S)
    total += sum(mp.svd_r(S - A * S * A.T, compute_uv=False))
    cS, misfit = c * S, []
    for j in range(n):
        inner = mp.mpf(0)
        for k in range(rows.y.size):
            sample = mp.mpc(l_re[k], l_im[k])
            if isinstance(E, ShiftColumns) and k < E.angles.size:
                entry = mp.mpf(E.gain[k]) * mp.mpf(E.decay[j]) * mp.expjpi(-mp.mpf(E.angles[k]) * j / mp.pi)
                entry += (0 if E.tilt is None else mp.mpc(E.tilt[k])) * mp.conj(entry)
            elif isinstance(E, ShiftColumns):
                entry = mp.mpf(E.real[k - E.angles.size, j])
            else:
                entry = mp.mpc(E.array[k, j])
            inner += mp.re(mp.conj(entry) * sample)
        misfit.append(mp.mpf(functional.x[j]) - inner - cS[0, j])
    total += mp.sqrt(sum(v * v for v in misfit))
    for i in np.flatnonzero(rows.held):
        slope = mp.mpf(functional.p[i])
        for k in range(rows.y.size):
            slope -= mp.re(mp.conj(mp.mpc(rows.P[k, i])) * mp.mpc(l_re[k], l_im[k]))
        total += max(slope * mp.mpf(e) for e in rows.ends[i].tolist())
    return total + mp.mpf(functional.tail)


@pytest.mark.parametrize("seed", seeds(1, 2))
@pytest.mark.parametrize("name", FORMS)
def test_the_enclosure_of_a_support_is_right_and_the_double_never_below_it(name, seed):
    rows, sarason = arrays(name)
    functional, samples, Y = multipliers(rows, sarason, seed)
    free = ~rows.held
    if free.any():  # P'l = d, but for rounding
        P = np.vstack([rows.P.real, rows.P.imag])[:, free]
        wanted = functional.p.copy()
        wanted[free] = P.T @ np.concatenate([samples.real, samples.imag])
        functional = Functional(functional.x, wanted, functional.tail)
    found = enclose_support(functional, samples, Y, 1.0, rows, sarason)
    plain = evaluate_support(functional, samples, Y, 1.0, rows, sarason)
    with mp.workdps(60):
        true = reference(functional, samples, sarason.stein(Y), 1.0, rows, sarason)
        assert true <= found
        if not free.any():
            assert found - true < 1e-13 * rows.y.size * abs(true)
    assert found <= plain
    assert plain - found < 1e-7 * abs(plain)


@pytest.mark.parametrize("seed", seeds(1, 2))
@pytest.mark.parametrize("name", FORMS)
def test_the_enclosure_of_a_margin_is_right_and_the_double_never_above_it(name, seed):
    rows, sarason = arrays(name)
    _, samples, Y = multipliers(rows, sarason, seed)
    P = np.vstack([rows.P.real, rows.P.imag])[:, ~rows.held]
    flat = np.concatenate([samples.real, samples.imag])
    flat = flat - P @ np.linalg.lstsq(P, flat, rcond=None)[0]
    samples = flat[: samples.size] + 1j * flat[samples.size :]
    S = sarason.stein(Y)
    found = enclose_margin(samples, S, 1.0, rows, sarason)
    plain = evaluate_certificate(samples, S, 1.0, rows, sarason)
    nothing = Functional(np.zeros(sarason.pair.order), np.zeros(rows.P.shape[1]))
    with mp.workdps(60):
        # margin * weight >= Re<l, y> - (...), which is minus the bound of the zero functional with -l, at level 0.
        weight = mp.fsum(mp.hypot(float(a.real), float(a.imag)) for a in samples)
        true = -reference(nothing, -samples, S, 0.0, rows, sarason) / weight
        assert found <= true
        if rows.held.all():
            assert true - found < 1e-13 * rows.y.size * abs(true)
    assert plain <= found
    assert found - plain < 1e-7 * abs(found)


def test_certificates_of_results_hold_in_ball_arithmetic_and_overstated_ones_do_not():
    result = rid.identify(random_problem(2, "parametric", 14, spread=0.2, noise=4.0))
    data = ExactFormulation(result.problem).data
    proof = result.certificate
    assert result.margin_lower > 1
    assert verify_margin_exactly(proof, data.rows, data.sarason)
    object.__setattr__(proof, "value", proof.value * (1 + 1e-9))
    assert not verify_margin_exactly(proof, data.rows, data.sarason)


@pytest.mark.parametrize("form", ["orthonormal", "taylor"])
def test_claims_of_a_worst_case_error_hold_and_overstated_ones_do_not(form):
    result = rid.identify(random_problem(2, "mixed", 8), form=form)
    error = rid.worst_case_error(result, omega=[0.0, 100.0], directions=4)
    claims = list(error.claims())
    assert len(claims) == 6
    for claim in claims:
        assert claim.verify(exact=True)
        value = claim.certificate.value * (1 - 1e-9 * np.sign(claim.certificate.value))
        object.__setattr__(claim.certificate, "value", value)
        assert not claim.verify(exact=True)


def test_without_the_library_there_is_one_sentence(monkeypatch):
    rows, sarason = arrays("time")
    functional, samples, Y = multipliers(rows, sarason, 0)
    monkeypatch.setitem(sys.modules, "flint", None)
    with pytest.raises(rid.InputError, match=r"robustid\[exact\]"):
        enclose_support(functional, samples, Y, 1.0, rows, sarason)
