"""Ellipses as bounds: their geometry, the arithmetic of tilted lines, and problems against an independent solver."""

import dataclasses

import control
import numpy as np
import pytest
from scipy.special import ellipk

import robustid as rid
from robustid.advice import diagnose
from robustid.data import bound_ratio
from robustid.identification import largest_ratio
from robustid.identification.certificate import evaluate_certificate
from robustid.identification.formulation import ExactFormulation
from robustid.identification.solver.paths import margin_path
from robustid.report.assumptions import experiments
from support.bounds import rebound
from support.matrix_plants import judge_margin
from support.problems import random_problem
from support.refusals import refusals


def covariances(rng, lines, slimness=30.0):
    """Random symmetric positive definite (F, 2, 2), with semi-axes up to so different."""
    turn = rng.uniform(0, np.pi, lines)
    U = np.stack([np.stack([np.cos(turn), -np.sin(turn)], -1), np.stack([np.sin(turn), np.cos(turn)], -1)], -2)
    axes = np.stack([np.ones(lines), slimness ** -rng.uniform(0, 1, lines)], -1) ** 2
    return U @ (axes[:, :, None] * U.swapaxes(1, 2))


def elliptic(problem, seed, deviations=1.0, slimness=30.0):
    """The problem with ellipses of the size of its discs in the place of these, and what whitens their errors."""
    (frf,) = problem.frequency
    C = covariances(np.random.default_rng(seed), frf.omega.size, slimness) * frf.bound[:, :1] ** 2
    changed = frf.with_ellipses(C, deviations)
    W = np.linalg.inv(np.linalg.cholesky(C)) / deviations
    return dataclasses.replace(problem, frequency=changed), W


# --- geometry ---------------------------------------------------------------------------------------------------------


def test_the_border_of_the_ellipse_is_that_of_the_covariance():
    rng = np.random.default_rng(0)
    C, deviations = covariances(rng, 40, 1e3) * rng.uniform(1e-8, 1e8, (40, 1, 1)), 2.5
    frf = rid.FrequencyResponse(np.arange(40.0), np.zeros(40), dt=0.01).with_ellipses(C, deviations)
    t = np.linspace(0, 2 * np.pi, 101)
    border = deviations * np.linalg.cholesky(C) @ np.stack([np.cos(t), np.sin(t)])
    e = border[:, 0] + 1j * border[:, 1]
    ratio = bound_ratio(e, frf.bound[:, :, 0], frf.bound.tilt[:, 0, 0])
    assert np.abs(ratio - 1).max() < 1e-9  # 1e-16 times the slimness squared
    small, large = deviations * np.sqrt(np.linalg.eigvalsh(C)).T
    assert np.allclose(frf.bound.inner_radius[:, 0, 0], small, rtol=1e-9)
    assert np.allclose(frf.bound.outer_radius[:, 0, 0], large, rtol=1e-9)
    ends = [
        np.exp(0.5j * np.angle(frf.bound.tilt)) * frf.bound.inner_radius,
        1j * np.exp(0.5j * np.angle(frf.bound.tilt)) * frf.bound.outer_radius,
    ]
    for e in ends:  # the axes are where the docstring says
        assert np.abs(bound_ratio(e, frf.bound, frf.bound.tilt) - 1).max() < 1e-9
        vector = np.stack([e.real, e.imag], -1)[:, 0, 0]
        inside = np.einsum("fi,fij,fj->f", vector, np.linalg.inv(C), vector)
        assert np.allclose(inside, deviations**2, rtol=1e-9)


def test_circles_have_no_tilt():
    frf = rid.FrequencyResponse([1.0, 2.0], [1.0, 2.0], dt=0.1).with_ellipses(4.0 * np.eye(2) * np.ones((2, 1, 1)), 3.0)
    assert np.all(frf.bound.tilt == 0)
    assert frf.bound.ravel() == pytest.approx([6.0, 6.0])


def test_responses_keep_their_ellipses():
    rng = np.random.default_rng(3)
    tilt = 0.9 * np.sqrt(rng.uniform(size=(4, 2, 3))) * np.exp(2j * np.pi * rng.uniform(size=(4, 2, 3)))
    values, bound = rng.standard_normal((4, 2, 3)) + 1j, rng.uniform(0.1, 1, (4, 2, 3))
    frf = rid.FrequencyResponse([4.0, 1.0, 3.0, 2.0], values, bound=rid.Bound(bound, tilt=tilt), dt=0.1)
    order = [1, 3, 2, 0]
    assert np.array_equal(frf.bound.tilt, tilt[order])
    assert np.array_equal(frf.select([0, 2]).bound.tilt, tilt[order][[0, 2]])
    assert np.array_equal(frf.band(0, 0.4).bound.tilt, tilt[order][:2])
    assert np.array_equal(frf.entry(1, 2).bound.tilt, tilt[order][:, 1:2, 2:])
    assert "ellipses" in repr(frf)
    per_line = rid.FrequencyResponse([1.0, 2.0], np.ones((2, 2, 1)), bound=rid.Bound(0.1, tilt=[0.5, 0.5j]))
    assert np.array_equal(per_line.bound.tilt[:, 1, 0], [0.5, 0.5j])


test_bad_covariances = refusals(
    ((np.eye(2), 1.0), r"`covariance` must have shape \(F, 2, 2\)"),
    (([np.eye(2), [[1.0, 0.5], [0.0, 1.0]]], 1.0), "symmetric"),
    (([np.eye(2), np.ones((2, 2))], 1.0), "positive definite; frequency point 1"),
    (([np.eye(2), -np.eye(2)], 1.0), "positive definite; frequency point 1"),
    (([np.eye(2), np.zeros((2, 2))], 1.0), "positive definite; frequency point 1"),
    (([np.eye(2), np.nan * np.eye(2)], 1.0), "must be finite"),
    ((np.ones((2, 2, 2)) * 1j, 1.0), "must be real", rid.RobustIdError),
    (([np.eye(2), np.eye(2)], 0.0), "`deviations` must be positive"),
    (([np.eye(2), np.eye(2)], "three"), "`deviations` must be", rid.RobustIdError),
    of=rid.FrequencyResponse([1.0, 2.0], [1.0, 1.0]).with_ellipses,
)


# --- the arithmetic of tilted lines -----------------------------------------------------------------------------------


def test_rows_of_a_taylor_form():
    """Columns by their formula, tilted; tails K rho^-L (2/pi) K(1/rho), which a tilt makes (1 + |kappa|) times larger."""
    problem, _ = elliptic(random_problem(0, "mixed", 12).with_prior(decay_rate=1.2), 1)
    rows = rid.identify(problem, form="taylor").formulation.data.rows
    (frf,), K, rho = problem.frequency, problem.prior.gain_bound, problem.prior.decay_rate
    kappa, bound, L = frf.bound.tilt[:, 0, 0], frf.bound[:, 0, 0], rows.E.shape[1]
    tail = K * rho**-L * 2 / np.pi * ellipk(rho**-2)
    assert np.allclose(rows.tail[: rows.discs], tail * (1 + np.abs(kappa)) / bound, rtol=1e-12)
    E = K * rho ** -np.arange(L) * np.exp(-1j * np.outer(frf.omega * frf.dt, np.arange(L)))
    E = (E + kappa[:, None] * E.conj()) / bound[:, None]
    assert np.abs(rows.E.dense()[: rows.discs] - E).max() <= 1e-12 * np.abs(E).max()
    y = frf.values[:, 0, 0]
    assert np.allclose(rows.y[: rows.discs], (y + kappa * y.conj()) / bound, rtol=1e-13)


# --- problems ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "options",
    [{"solver": "cvxpy"}, {"solver": "structured"}, {"form": "taylor"}, {"form": "sections"}, {"form": "classical"}],
)
def test_one_real_value_against_the_closed_form(options):
    """At omega = 0 F is any real f, |f| <= K: y = jv and kappa = jb give the margin v (1 - b^2)/sqrt(1 + b^2)/bound."""
    v, bound = 0.9, 0.1
    for b in (0.0, 0.5, -0.9, 0.999999):
        frf = rid.FrequencyResponse([0.0], [1j * v], bound=rid.Bound(bound, tilt=[1j * b]), dt=0.01)
        result = rid.identify(
            rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=3.0, decay_rate=1.2)), **options
        )
        expected = v * (1 - b**2) / np.sqrt(1 + b**2) / bound
        assert result.margin == pytest.approx(expected, abs=1e-4 * max(1, expected))
        assert result.margin_lower <= expected + 1e-9
        assert result.margin >= expected - 1e-9
        assert result.verification.passed, result.summary()
        if expected > 1e-3:
            f = result.model(1.0).real
            assert f == pytest.approx(2 * b * v / (1 + b**2), abs=2e-2)
    # kappa real: the axes are those of the plane, and f = 0 is best.
    frf = rid.FrequencyResponse([0.0], [1j * v], bound=rid.Bound(bound, tilt=[-0.5]), dt=0.01)
    result = rid.identify(rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=3.0, decay_rate=1.2)), **options)
    assert result.margin == pytest.approx(v * 1.5 / bound, rel=1e-4)


@pytest.mark.parametrize("seeds", [1, pytest.param(8, marks=pytest.mark.slow)])
@pytest.mark.parametrize("case", ["frequency", pytest.param("mixed", marks=pytest.mark.slow), "parametric"])
def test_margin_against_the_paper_s_theorem(case, seeds):
    """Clarabel on the printed inequality with the errors whitened by the covariances; Taylor forms enclose the number."""
    positive = 0
    for seed in range(seeds):
        problem = random_problem(seed, case, 10, noise=3.0).with_prior(gain_bound=0.2, decay_rate=1.25)
        # Not slimmer: Clarabel leaves the ball by 4e-7 K here and there, which bounds below 1e-3 K show as more than 1e-6.
        problem, W = elliptic(problem, seed, slimness=10.0)
        if case == "parametric" and seed % 2:
            problem = dataclasses.replace(problem, parameter_bounds=[(-1.0, 1.0), (-np.inf, np.inf)])
        judge = judge_margin(problem, W)
        size = max(1.0, judge)
        positive += judge > 1e-2
        result = rid.identify(problem, solver="structured")
        assert result.verification.passed, result.summary()
        assert result.margin == pytest.approx(judge, abs=3e-6 * size)
        assert result.margin_lower <= judge + 1e-6 * size
        assert result.margin - result.margin_lower <= 2e-5 * size
        # The residuals of the model, whitened by hand.
        (found, *_) = result.residuals
        vector = np.einsum("fij,fj->fi", W, np.stack([found.error.real, found.error.imag], -1))
        assert np.allclose(np.linalg.norm(vector, axis=1), found.ratio, rtol=1e-6)
        assert found.ratio.max() <= max(1.0, judge) * (1 + 1e-4)
        conic, taylor = rid.identify(problem, solver="cvxpy"), rid.identify(problem, form="taylor")
        assert conic.margin == pytest.approx(judge, abs=1e-5 * size)
        assert taylor.verification.passed, taylor.summary()
        assert taylor.margin_lower - 1e-6 * size <= judge <= taylor.margin + 1e-6 * size
        assert taylor.margin - taylor.margin_lower <= 1e-4 * size
    assert positive >= 0.75 * seeds


@pytest.mark.parametrize("seeds", [3, pytest.param(8, marks=pytest.mark.slow)])
def test_ellipses_lie_between_their_discs(seeds):
    for seed in range(seeds):
        problem, _ = elliptic(random_problem(seed, "mixed", 12, spread=0.3, noise=3.0), seed, slimness=4.0)
        (frf,) = problem.frequency
        margins = []
        for bound, tilt in (
            (frf.bound.outer_radius, None),
            (frf.bound, frf.bound.tilt),
            (frf.bound.inner_radius, None),
        ):
            changed = frf.with_bound(rid.Bound(bound, tilt=tilt))
            margins.append(rid.identify(dataclasses.replace(problem, frequency=changed), solver="structured"))
        assert margins[0].margin_lower <= margins[1].margin
        assert margins[1].margin_lower <= margins[2].margin


def test_no_tilt_is_a_disc():
    problem = random_problem(1, "mixed", 12, spread=0.3, noise=3.0)
    (frf,) = problem.frequency
    zero = dataclasses.replace(problem, frequency=rebound(frf, tilt=np.zeros(frf.omega.size)))
    for form in ("orthonormal", "taylor"):
        first, second = (rid.identify(p, solver="structured", form=form) for p in (problem, zero))
        assert second.margin == pytest.approx(first.margin, rel=1e-9)
        assert second.margin_lower == pytest.approx(first.margin_lower, rel=1e-9)


@pytest.mark.parametrize("seeds", [1, pytest.param(10, marks=pytest.mark.slow)])
@pytest.mark.parametrize("form", ["orthonormal", "taylor", "sections"])
def test_the_truth_inside_its_ellipses_is_never_refuted(form, seeds):
    """Errors on the border of every ellipse (99.9 % of it), drawn along the whole border."""
    for seed in range(seeds):
        problem, W = elliptic(random_problem(seed, "frequency", 12, noise=0.0), seed, slimness=100.0)
        (frf,) = problem.frequency
        turn = np.random.default_rng(seed).uniform(0, 2 * np.pi, frf.omega.size)
        e = np.einsum("fij,fj->fi", np.linalg.inv(W), np.stack([np.cos(turn), np.sin(turn)], -1))
        moved = dataclasses.replace(frf, values=frf.values + 0.999 * (e[:, 0] + 1j * e[:, 1])[:, None, None])
        result = rid.identify(dataclasses.replace(problem, frequency=moved), form=form)
        assert result.consistent
        assert result.verification.passed, result.summary()


@pytest.mark.parametrize(
    ("power", "form"),
    [
        (-60, "orthonormal"),
        (60, "taylor"),
        (-60, "sections"),
        *(pytest.param(*c, marks=pytest.mark.slow) for c in ((60, "orthonormal"), (-60, "taylor"), (60, "sections"))),
    ],
)
def test_units_do_not_matter(power, form):
    problem, _ = elliptic(random_problem(3, "mixed", 10, spread=0.3, noise=3.0).with_prior(decay_rate=1.25), 3)
    unit = 2.0**power
    (f,), (t,) = problem.frequency, problem.time
    scaled = rid.MixedProblem(
        frequency=dataclasses.replace(f, values=unit * f.values, bound=f.bound.inflated(unit)),
        time=dataclasses.replace(t, y=unit * t.y, bound=unit * t.bound),
        prior=rid.Prior(gain_bound=unit * problem.prior.gain_bound, decay_rate=problem.prior.decay_rate),
    )
    first, second = (rid.identify(p, solver="structured", form=form) for p in (problem, scaled))
    assert (second.margin, second.margin_lower) == (first.margin, first.margin_lower)
    C = covariances(np.random.default_rng(0), 5)
    one, other = (rid.FrequencyResponse(np.arange(5.0), np.ones(5)).with_ellipses(s**2 * C, 3.0) for s in (1.0, unit))
    assert np.array_equal(other.bound, unit * one.bound)
    assert np.array_equal(other.bound.tilt, one.bound.tilt)


def test_a_certificate_belongs_to_its_ellipses():
    """Members of the class and other multipliers: never below the value; turned ellipses take the proof away."""
    refuted = 0
    for seed in range(8):
        problem, _ = elliptic(random_problem(seed, "mixed", 10, spread=0.3, noise=3.0), seed)
        result, data = rid.identify(problem, solver="structured"), ExactFormulation(problem).data
        rng = np.random.default_rng(seed)
        *_, (best, _, _) = margin_path(data)
        for _ in range(50):
            x = best.x + 10 ** rng.uniform(-6, 0) * rng.standard_normal(best.x.size)
            x /= max(1.0, data.sarason.norm(x))
            assert data.margin(x, best.p) >= result.margin_lower
        (frf,) = problem.frequency
        turned = ExactFormulation(dataclasses.replace(problem, frequency=rebound(frf, tilt=-frf.bound.tilt))).data
        proof = result.certificate
        assert proof.verify(data.rows, data.sarason)
        value = evaluate_certificate(proof.samples, proof.ball, proof.upper, turned.rows, turned.sarason)
        assert value <= rid.identify(dataclasses.replace(problem, frequency=rebound(frf, tilt=-frf.bound.tilt))).margin
        refuted += proof.value > 1e-3 and not proof.verify(turned.rows, turned.sarason)
    assert refuted >= 5


def test_needles():
    """Ellipses a million times longer than wide: only the narrow direction counts."""
    for seed in range(4):
        rng = np.random.default_rng(seed)
        problem = random_problem(seed, "frequency", 8, spread=1.0, noise=0.0)
        (frf,) = problem.frequency
        turn = rng.uniform(0, np.pi, frf.omega.size)
        kappa = (1 - 1e-6) * np.exp(2j * turn)  # the narrow axis has the direction `turn`
        along = np.exp(1j * turn)
        far = frf.with_bound(rid.Bound(0.02, tilt=kappa))
        moved = dataclasses.replace(far, values=far.values + (100 * 1j * along)[:, None, None])  # along the needles
        result = rid.identify(dataclasses.replace(problem, frequency=moved))
        assert result.consistent
        assert result.verification.passed, result.summary()
        off = dataclasses.replace(far, values=far.values + (5 * along)[:, None, None])  # across: 500 widths
        assert rid.identify(dataclasses.replace(problem, frequency=off)).status is rid.Status.INCONSISTENT


# --- everything that compares a residual with a bound -----------------------------------------------------------------


def test_validation_and_reduction_use_the_ellipses(tmp_path):
    problem, W = elliptic(random_problem(2, "parametric", 12, spread=1.0), 2)
    (frf,) = problem.frequency
    result = rid.identify(problem)
    validation = rid.validate(result.model, frf)
    e = validation.residuals[:, 0, 0]
    whitened = np.linalg.norm(np.einsum("fij,fj->fi", W, np.stack([e.real, e.imag], -1)), axis=1)
    assert validation.ratio == pytest.approx(whitened.max(), rel=1e-9)
    assert validation.outside == int(np.sum(whitened > 1))
    assert largest_ratio(problem, result.model) == pytest.approx(max(r.ratio.max() for r in result.residuals), rel=1e-6)
    reduced = rid.reduce_within_bounds(result)
    assert largest_ratio(problem, reduced.model) == pytest.approx(reduced.margin, rel=1e-6)
    shifted = control.ss([], [], [], 0.0, frf.dt)
    alone = dataclasses.replace(
        rebound(frf.select([0]), tilt=[-0.5]), values=np.array([1.5 * frf.bound[0, 0, 0] * (1 + 0j)])
    )
    assert rid.validate(shifted, alone).ratio == pytest.approx(0.75)
    assert rid.validate(shifted, rebound(alone, tilt=[0.5])).outside == 1
    result.save(tmp_path / "result")
    again = rid.load(tmp_path / "result")
    assert np.array_equal(again.problem.frequency[0].bound.tilt, frf.bound.tilt)
    assert again.verification.passed
    assert experiments(result)[0].bound.startswith("ellipses, half-axes")


def test_advice_with_ellipses():
    """A prior and modes from elliptic data that leave the truth consistent; trials with further pairs are posed."""
    data = rid.datasets.flexible_structure()
    lines = data.frequency
    C = covariances(np.random.default_rng(0), lines.omega.size, 3.0) * lines.bound[:, :1] ** 2
    frf = lines.with_ellipses(4 * C, 1.0)
    found = rid.suggest_kautz(frf, modes=2)
    assert np.allclose(found.omega, data.modes[:2, 0], rtol=0.02)
    prior = rid.Prior(gain_bound=1.0, decay_rate=1.1)
    problem = rid.MixedProblem(frequency=frf, parametric=found.basis, prior=prior)
    suggested = rid.suggest_prior(problem, decay_rates=[1.1])
    assert suggested.prior is not None
    assert suggested.prior.gain_bound >= 2 * frf.bound.inner_radius.min() * (1 - 1e-12)
    small = problem.with_prior(gain_bound=1e-9)
    assert diagnose(rid.identify(small, form="taylor")).corrections
