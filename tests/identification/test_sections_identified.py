"""identify() in powers of an all-pass function: margins, certificates, models."""

import dataclasses

import control
import numpy as np
import pytest

import robustid as rid
from robustid.bases import Sections
from robustid.identification import model_residuals
from robustid.identification.formulation import formulate_in
from robustid.identification.truncation import BalancedContraction
from robustid.reduction import hankel_singular_values
from support.cases import slow
from support.forging import forge, kept
from support.forms import ACCURACY, both_forms, check_certificate, check_model, compared, nothing_below, posed_problem
from support.problems import identified, in_units, random_problem
from support.refusals import refused
from support.sections_of_lines import CIRCLE, coordinates, lines, oversampled
from support.taylor_members import at, random_member

# --- identify ---------------------------------------------------------------------------------------------------------


def posed(case, seed):
    """Decay rates for which few sections do; of lines only, with or without a parametric part."""
    return dataclasses.replace(posed_problem(case, seed, 1.05, 0.03), time=None)


@pytest.mark.parametrize(
    ("case", "seed"),
    [
        pytest.param(case, seed, marks=() if seed in quick else pytest.mark.slow)
        for case, quick in (("frequency", ()), ("parametric", (1,)))
        for seed in range(4)
    ],
)
def test_the_margin_is_that_of_the_exact_form(case, seed):
    problem = posed(case, seed)
    exact, result = both_forms(problem, "sections")
    assert not result.formulation.repeated.is_shift
    compared(problem, exact, result)
    rng, sections = np.random.default_rng(seed), result.formulation.repeated
    nothing_below(result, (coordinates(at(random_member(rng, 6, 0.8), CIRCLE), sections) for _ in range(10)))


def test_barely_consistent_and_barely_not():
    problem = posed("frequency", 3)
    margin = rid.identify(problem, form="orthonormal", accuracy=1e-7).margin
    assert 0.5 < margin < 1
    for factor, status in ((1 + 3e-4, rid.Status.CONSISTENT), (1 - 3e-4, rid.Status.INCONSISTENT)):
        result = identified(in_units(problem, 1.0, margin * factor), form="sections")
        assert result.status is status
        assert result.margin_lower <= 1 / factor <= result.margin


@pytest.mark.parametrize("noise", [0.5, slow(4.0)])
def test_periodic_records(noise):
    rng = np.random.default_rng(3)
    u = sum(np.cos(2 * np.pi * k * np.arange(60) / 60 + rng.uniform(0, 6)) for k in (2, 3, 5, 7))
    spectrum = np.fft.rfft(u) * 0.2 / (1.3 - np.exp(-2j * np.pi * np.arange(31) / 60))
    y = np.fft.irfft(spectrum, 60) + 0.05 * noise * rng.uniform(-1, 1, 60)
    record = rid.TimeRecord(u, y, dt=0.01, bound=0.05, initial="periodic")
    problem = rid.MixedProblem(time=record, prior=rid.Prior(gain_bound=1.0, decay_rate=1.02))
    exact, result = (identified(problem, form=form) for form in ("orthonormal", "sections"))
    assert not result.formulation.repeated.is_shift
    assert max(exact.margin_lower, result.margin_lower) <= min(exact.margin, result.margin) + 1e-9


def test_time_samples_from_rest_are_answered_by_taylor_coefficients():
    problem = random_problem(2, "mixed", 14).with_prior(decay_rate=1.25)
    taylor_form, result = (rid.identify(problem, form=form, accuracy=ACCURACY) for form in ("taylor", "sections"))
    assert result.formulation.repeated == taylor_form.formulation.repeated
    assert (result.margin, result.margin_lower) == (taylor_form.margin, taylor_form.margin_lower)
    assert "Taylor coefficients" in result.summary()


@pytest.mark.parametrize(
    ("noise", "status", "count"),
    [
        (0.99, rid.Status.CONSISTENT, 80),
        slow(3.0, rid.Status.INCONSISTENT, 80),
        slow(0.99, rid.Status.CONSISTENT, 300),
        slow(3.0, rid.Status.INCONSISTENT, 300),
    ],
)
def test_oversampled_lines_that_taylor_coefficients_can_not_answer(noise, status, count, tmp_path):
    problem = oversampled(count, noise=noise)
    refused(r"needs 5\d\d\d Taylor coefficients", rid.identify, problem, error=rid.errors.SizeError, form="taylor")
    result = identified(problem)
    assert result.status is status
    assert not result.formulation.repeated.is_shift
    assert result.formulation.count == result.coefficients.size < 200
    assert f"{result.formulation.count} coefficients of an all-pass section" in result.summary()
    check_certificate(result)
    check_model(problem, result)
    # The exact form of every other or third line: its margin is at most this one.
    some = rid.MixedProblem(frequency=problem.frequency[0].select(slice(None, None, 8)), prior=problem.prior)
    assert rid.identify(some, form="orthonormal").margin_lower <= result.margin + 1e-9
    again = kept(result, tmp_path / "sections")
    assert again.formulation.repeated == result.formulation.repeated
    assert (again.margin, again.margin_lower, again.status) == (result.margin, result.margin_lower, result.status)
    assert np.array_equal(again.model.A, result.model.A)
    assert again.verification.checks == result.verification.checks
    forge(
        tmp_path / "sections", text=lambda record: record["sections"].update(repeats=record["sections"]["repeats"] + 1)
    )
    with pytest.raises(rid.errors.FileFormatError, match="its sections do not belong to its coefficients"):
        rid.load(tmp_path / "sections")


@pytest.mark.parametrize("count", [20, slow(60)])
def test_objectives_and_other_solutions(count):
    problem = oversampled(count, rho=1.02)
    exact, result = (identified(problem, form=form, objective="gain") for form in ("orthonormal", "sections"))
    assert result.prior.gain_bound == pytest.approx(exact.prior.gain_bound, rel=3e-4)
    result = rid.identify(problem, form="sections")
    omega = np.linspace(1, 3000, 50)
    centre, radius = result.weyl_disc(omega)
    assert np.array_equal(result.solution(0.0).A, result.model.A)
    for E in (0.5, -1.0):
        other = result.solution(E)
        assert max(r.ratio.max() for r in model_residuals(problem, other)) <= 1 + 1e-5
        assert (np.abs(other(np.exp(1j * omega * problem.dt)) - centre) - radius).max() <= 1.1e-4


def test_bad_input():
    for zeros in ([], [1.0], [np.nan], [0.5, 2j]):
        refused("`zeros` must be one or more numbers inside the unit disc", Sections, zeros, 3)
    refused("`repeats` must be at least 1", Sections, [0.5], 0)
    refused("`form` must be one of", lambda: rid.identify(oversampled(5), form="section"))
    with pytest.raises(rid.errors.SizeError, match=r"needs \d+ coefficients \(a section of degree 8, repeated\)"):
        rid.identify(lines(np.linspace(0.001, 1, 500), rho=1.001), form="sections")
    with pytest.raises(
        rid.errors.SizeError, match=r"500 coefficients in the form of sections and 100000 frequency points"
    ):
        _ = formulate_in(lines(np.linspace(0.001, 1, 100_000)), Sections([0.5], 500)).rows


# --- the model --------------------------------------------------------------------------------------------------------


def test_balanced_contractions_against_the_general_reduction():
    """Hankel values of another method, errors on the circle within the bound, bounds within the tolerance."""
    rng = np.random.default_rng(0)
    sizes = np.append(rng.uniform(0.1, 1, 10), rng.uniform(0, 0.1, 20))
    A = 0.99 * np.linalg.qr(rng.standard_normal((30, 30)))[0] * sizes
    B, C, D = rng.standard_normal((30, 1)), rng.standard_normal((1, 30)), np.array([[0.3]])
    balanced, model = BalancedContraction(A, B, C, D), control.ss(A, B, C, D, 1.0)
    expected = hankel_singular_values(model)
    assert np.abs(balanced.hankel - expected[: balanced.hankel.size]).max() <= 1e-13 * expected[0]
    orders = []
    for tolerance in (1.0, 1e-3, 1e-9):
        small = balanced.truncate(tolerance)
        orders.append(small.A.shape[0])
        z = np.exp(1j * np.linspace(0, np.pi, 500))
        error = np.abs(model(z) - control.ss(*small[:4], 1.0)(z)).max()
        assert error <= small.bound <= tolerance
        assert small.bound == pytest.approx(2 * expected[orders[-1] :].sum(), rel=1e-3, abs=1e-11)
        assert np.abs(np.linalg.eigvals(small.A)).max() < 1
    assert orders == sorted(set(orders))
    whole = balanced.truncate(1e-30)  # below rounding: what stands out from it
    assert whole.bound > 1e-30
    assert np.abs(model(z) - control.ss(*whole[:4], 1.0)(z)).max() <= whole.bound
