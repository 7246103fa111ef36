"""Judges of an identification in any form: the exact form, the definition of its certificate, the responses of its model."""

import dataclasses

import numpy as np

import robustid as rid
from robustid.identification import model_residuals
from robustid.identification.certificate import evaluate_certificate
from support.problems import random_problem

ACCURACY = 1e-3


def posed_problem(case, seed, least, step):
    """Odd seeds are inconsistent; decay rates from `least` up, for which few coefficients do."""
    spread, noise = ((1.0, 0.9), (0.2, 5.0))[seed % 2]
    problem = random_problem(seed, case, 14, spread=spread, noise=noise)
    return problem.with_prior(decay_rate=least + step * (seed % 4))


def both_forms(problem, form, accuracy=ACCURACY, **options):
    """The identifications in the exact form and in this one, verified."""
    found = [rid.identify(problem, form=one, accuracy=accuracy, **options) for one in ("orthonormal", form)]
    for each in found:
        assert each.verification.passed, each.summary()
    return found


def compared(problem, exact, result):
    """Both prove the same margin and status; no system drawn from the class has a worst residual below `margin_lower`."""
    assert max(exact.margin_lower, result.margin_lower) <= min(exact.margin, result.margin) + 1e-9
    for each in (exact, result):
        assert each.margin - each.margin_lower <= ACCURACY * max(1, each.margin)
    if rid.Status.UNDECIDED not in (exact.status, result.status):
        assert exact.status is result.status
    check_certificate(result)
    check_model(problem, result)
    rng = np.random.default_rng(0)
    for _ in range(3):
        worst = max(r.ratio.max() for r in model_residuals(problem, exact.solution(rng.uniform(-1, 1))))
        assert worst >= result.margin_lower - 1e-9 * max(1, worst)


def nothing_below(result, members):
    """Its coefficients mixed with those of members of the class, of either sign: no worst residual below `margin_lower`."""
    for t, sign in ((t, sign) for t in (1e-4, 1e-3, 1e-2, 0.1, 1.0) for sign in (1, -1)):
        x = (1 - t) * result.claim.x + sign * t * next(members)
        assert result.formulation.rows.ratio(x, result.claim.p).max() >= result.margin_lower - 1e-9


def check_certificate(result):
    """Its value by its definition; changed numbers do not verify. One of value 0 claims nothing."""
    data, proof = result.formulation.data, result.certificate
    assert proof.verify(data.rows, data.sarason)
    if not proof.value:
        return
    weights, A = proof.samples, result.formulation.repeated.pair.A
    value = float((weights.conj() @ data.rows.y).real) - np.linalg.norm(proof.ball - A @ proof.ball @ A.T, "nuc")
    assert proof.value <= value - np.abs(weights) @ data.rows.tail + 1e-12
    assert evaluate_certificate(weights, proof.ball, proof.upper, data.rows, data.sarason) >= proof.value
    rng = np.random.default_rng(0)
    for changes in (
        {"value": proof.value + 1e-3 * max(1.0, proof.value)},
        {"ball": proof.ball + 0.1 * np.abs(proof.ball).max() * rng.standard_normal(proof.ball.shape)},
        {"samples": proof.samples * np.exp(1j)},
    ):
        assert not dataclasses.replace(proof, **changes).verify(data.rows, data.sarason)


def check_model(problem, result):
    """Stable; its residuals, by its frequency and its impulse response, are within what was promised."""
    model, level = result.model, max(1.0, result.margin * (1 + 1e-6)) * (1 + 1e-5)
    assert np.abs(np.linalg.eigvals(model.A)).max(initial=0.0) < 1
    found = {(r.kind, r.index): r.error for r in result.residuals}
    for i, f in enumerate(problem.frequency):
        error = f.values[:, 0, 0] - model(np.exp(1j * f.omega * problem.dt))
        assert np.abs(error - found["frequency", i]).max() <= 1e-8 * np.abs(f.values).max()
        assert (np.abs(error) / f.bound[:, 0, 0]).max() <= level
    for i, t in enumerate(problem.time):
        g, state = [model.D[0, 0]], model.B[:, 0]
        for _ in range(t.u.size - 1):
            g.append(float(model.C[0] @ state))
            state = model.A @ state
        error = t.y[:, 0] - np.convolve(t.u[:, 0], g)[: t.u.size]
        assert np.abs(error - found["time", i]).max() <= 1e-8 * max(np.abs(t.y).max(), 1)
        assert (np.abs(error) / t.bound[:, 0]).max() <= level
