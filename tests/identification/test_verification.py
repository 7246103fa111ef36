"""Every check of a result can fail, and degenerate problems end with an answer."""

import dataclasses

import control
import mpmath as mp
import numpy as np
import pytest
from scipy.signal import lfilter

import robustid as rid
from robustid.identification import MarginCertificate
from robustid.identification.certificate import evaluate_certificate
from robustid.identification.formulation import Candidate, ExactFormulation
from robustid.identification.model import Nominal
from robustid.identification.verification import verify
from support.cases import slow
from support.problems import CASES, identified, in_units, random_problem

PROBLEM = random_problem(2, "mixed", 14, spread=0.2, noise=4.0)


@pytest.fixture(scope="module")
def result():
    return rid.identify(PROBLEM)


def checks(result, *, claim=None, x=None, p=None, model=None, level=None):
    """The names of the checks that fail when one thing is replaced."""
    posed = ExactFormulation(PROBLEM)
    point = Candidate(
        result.coefficients if x is None else x,
        result.scaled_parameters if p is None else p,
        result.certificate.samples,
        result.certificate.ball,
        "test",
    )
    claim, model = claim or result.claim, model or result.model
    level = max(1.0, result.margin * (1 + 1e-6)) if level is None else level
    states = model.nstates - (0 if PROBLEM.parametric is None else PROBLEM.parametric.states)
    verified = verify(posed, point, Nominal(model, states, 0.0), claim, posed.data, level)
    return [check.name for check in verified.checks if not check.holds]


def test_an_untouched_result_passes(result):
    assert checks(result) == []


def test_each_check_sees_the_one_number_that_is_wrong(result):
    assert any("largest |residual|" in name for name in checks(result, level=0.5 * result.margin))
    large = result.coefficients * 1.5 / ExactFormulation(PROBLEM).data.sarason.norm(result.coefficients)
    assert any("in the ball" in name for name in checks(result, x=large))
    moved = result.coefficients.copy()
    moved[0] += 1e-6
    assert any("interpolation data" in name for name in checks(result, x=moved))
    A = np.array(result.model.A)
    A[:2, :2] = np.diag([0.999, 0.99])  # a slow pole where G must decay
    slow = control.ss(A, result.model.B, result.model.C, result.model.D, result.model.dt)
    assert any("|pole|" in name for name in checks(result, model=slow))
    claim = result.claim
    lower = dataclasses.replace(claim, margin=claim.margin * (1 - 1e-6))
    assert any("reaches it" in name for name in checks(result, claim=lower))
    outside = dataclasses.replace(claim, x=claim.x * 1.01)
    assert any("reaches it" in name for name in checks(result, claim=outside))
    narrow = dataclasses.replace(claim, accuracy=1e-18)
    assert any("width" in name for name in checks(result, claim=narrow))
    swapped = dataclasses.replace(claim, margin=claim.certificate.value * 0.9)
    assert any("width" in name for name in checks(result, claim=swapped))
    bold = dataclasses.replace(claim.certificate, value=claim.certificate.value + 1e-4)
    assert any("certificate" in name for name in checks(result, claim=dataclasses.replace(claim, certificate=bold)))


def test_a_nan_in_any_residual_fails(result):
    C = np.array(result.model.C)
    C[0, 0] = np.nan
    broken = control.StateSpace(result.model.A, result.model.B, result.model.C, result.model.D, 0.01)
    broken.C = C
    assert any("largest |residual|" in name for name in checks(result, model=broken))


def exact_value(certificate, data):
    """The certificate's bound with 60 digits, the arrays taken as exact."""
    mp.mp.dps = 60
    A, c, S = (mp.matrix(a.tolist()) for a in (data.sarason.pair.A, data.sarason.pair.c, certificate.ball))
    multipliers = [mp.mpc(v) for v in certificate.samples]
    Y = S - A * S * A.T
    nuclear = mp.fsum(mp.svd_r(Y, compute_uv=False))
    fit = mp.fsum(mp.re(mp.conj(a) * mp.mpc(b)) for a, b in zip(multipliers, data.rows.y, strict=True))
    cS = c * S
    gain = [
        mp.fsum(mp.re(mp.conj(mp.mpc(e)) * v) for e, v in zip(data.rows.E.dense()[:, j], multipliers, strict=True))
        for j in range(S.rows)
    ]
    mismatch = mp.sqrt(mp.fsum((g - cS[0, j]) ** 2 for j, g in enumerate(gain)))
    weight = mp.fsum(abs(v) for v in multipliers)
    return float((fit - nuclear - mismatch) / weight)


@pytest.mark.parametrize("case", ["time", "frequency", "mixed"])
def test_the_rounding_allowance_covers_the_rounding(case):
    """Stated value <= value with 60 digits, where rounding is hardest: rho near 1, bounds far below K."""
    for seed in range(2):
        base = random_problem(seed, case, 8, spread=1e-4)
        problem = base.with_prior(decay_rate=1 + 1e-5, gain_bound=0.02)
        result, data = rid.identify(problem), ExactFormulation(problem).data
        claimed = evaluate_certificate(
            result.certificate.samples, result.certificate.ball, result.margin, data.rows, data.sarason
        )
        assert result.margin_lower > 1
        assert claimed <= exact_value(result.certificate, data) <= result.margin * (1 + 1e-9)


@pytest.mark.parametrize("seeds", [1, slow(2)])
def test_tight_bounds_reach_the_accuracy(seeds):
    """Bounds of 1e-4 to 1e-8 of K: the proven interval is as narrow as asked, in all."""
    for spread, noise in ((1e-3, 3.0), (1e-5, 0.9), (1e-7, 0.9)):
        for seed in range(seeds):
            for case in CASES:
                identified(random_problem(100 + seed, case, 28, spread=spread, noise=noise))


def line_data(values, bound=0.1):
    return rid.FrequencyResponse(np.linspace(1, 300, 14), values, bound=bound, dt=0.01)


PRIOR = rid.Prior(gain_bound=1.0, decay_rate=1.1)


@pytest.mark.parametrize(
    "data",
    [
        {"frequency": line_data(np.zeros(14))},
        {"time": rid.TimeRecord(np.ones(30), np.zeros(30), dt=0.01, bound=0.1)},
        {"time": rid.TimeRecord(np.zeros(12), np.zeros(12), dt=0.01, bound=0.1)},
        {"time": rid.TimeRecord(np.zeros(12), np.zeros(12), dt=0.01, bound=0.1, initial="periodic")},
        {"time": rid.TimeRecord(np.ones(20), np.zeros(20), dt=0.01, bound=0.1, initial="free")},
        {"frequency": [line_data(np.zeros(14)), line_data(np.zeros(14))]},
    ],
)
def test_zero_data_have_margin_zero(data):
    result = identified(rid.MixedProblem(prior=PRIOR, **data))
    assert result.consistent
    assert result.margin < 1e-6


def test_data_of_the_parametric_part_alone_with_tiny_bounds():
    basis = rid.kautz([30.0], [0.01], dt=0.01)
    omega = np.linspace(1, 300, 14)
    frf = line_data(basis.response(omega * 0.01) @ [1.0, 2.0], bound=1e-12)
    result = rid.identify(rid.MixedProblem(frequency=frf, prior=PRIOR, parametric=basis))
    assert result.margin < 1


def test_huge_data_are_refuted_and_not_crashed_on():
    record = rid.TimeRecord(np.ones(20), 1e20 * np.ones(20), dt=0.01, bound=0.1)
    result = rid.identify(rid.MixedProblem(time=record, prior=PRIOR))
    assert result.status is rid.Status.INCONSISTENT


def test_objective_margin_stays_inside_consistent_bounds():
    base = random_problem(0, "mixed", 14, spread=0.2, noise=4.0)
    exact = rid.identify(base, accuracy=1e-8).margin * (1 + 2e-5)
    result = rid.identify(in_units(base, 1.0, exact), objective="margin", accuracy=0.1)
    assert result.consistent
    assert max(r.ratio.max() for r in result.residuals) <= 1 + 1e-6


def test_widening_for_an_unknown_past_is_exactly_what_it_can_do():
    """The response to the worst past of coefficients at their bounds, in closed form; half the past explains half of it."""
    K, rho, past = 1.0, 1.25, 2.0
    tail = K * rho ** -np.arange(1, 400.0)  # |g_k| <= K rho^-k is the bound that the widening uses
    u = np.zeros(12)
    y = np.array([past * tail[k:].sum() for k in range(12)])  # constant past input `past`, g_k at its bound
    bound = 1e-6
    prior = rid.Prior(gain_bound=K, decay_rate=rho)

    def margin(allowed):
        record = rid.TimeRecord(u, y, dt=1.0, bound=bound, initial="free", past_input_bound=allowed)
        return rid.identify(rid.MixedProblem(time=record, prior=prior)).margin

    widening = past * K * rho ** -np.arange(12.0) / (rho - 1)
    assert margin(past) == pytest.approx(np.max(y / (bound + widening)), rel=1e-6)
    assert margin(past) <= 1
    assert margin(past / 2) > 1.9


def test_nyquist_line_of_a_periodic_record_counts_once():
    u = np.array([1.0, -1.0] * 4)  # only the Nyquist line is excited: y = F(-1) u
    w, bound = 0.7, 0.01
    record = rid.TimeRecord(u, w * u, dt=1.0, bound=bound, initial="periodic")
    problem = rid.MixedProblem(time=record, prior=rid.Prior(gain_bound=0.5, decay_rate=1.1))
    assert problem.coefficients == 1
    assert rid.identify(problem).margin == pytest.approx((w - 0.5) / bound, abs=1e-5)


def test_valid_repeated_pairs_are_accepted_and_unstable_systems_refused():
    pairs = rid.kautz([2 * np.pi * 5], [0.002], dt=5e-5, repeat=3)
    frf = rid.FrequencyResponse(2 * np.pi * np.linspace(1, 20, 10), np.ones(10), bound=0.1, dt=5e-5)
    assert not rid.MixedProblem(frequency=frf, prior=PRIOR, parametric=pairs).parametric.has_integrator
    unstable = control.ss([[1 + 5e-7]], [[1]], [[1]], [[0]], 5e-5)
    with pytest.raises(rid.InputError, match="inside the unit circle"):
        rid.MixedProblem(frequency=frf, prior=PRIOR, parametric=unstable)


@pytest.mark.parametrize("seeds", [6, slow(20)])
def test_a_worst_case_past_is_covered_for_a_real_system(seeds):
    """A system of the class driven by a bounded past: never refuted."""
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        K, rho = 1.0, 1.2
        a = 0.75  # G = b/(1 - a z^-1), pole inside 1/rho, |G| <= K on |z| = 1/rho
        b = K * (1 - a * rho)
        u = 3 * np.sign(rng.standard_normal(140))
        y = lfilter([b], [1, -a], u)[100:]
        record = rid.TimeRecord(
            u[100:], y + 1e-3 * rng.uniform(-1, 1, 40), dt=1.0, bound=1e-3, initial="free", past_input_bound=3.0
        )
        prior = rid.Prior(gain_bound=K, decay_rate=rho)
        assert rid.identify(rid.MixedProblem(time=record, prior=prior)).consistent


def test_a_certificate_of_the_wrong_size_is_no_certificate(result):
    short = MarginCertificate(
        result.certificate.samples[:-1], result.certificate.ball, result.margin, result.margin_lower
    )
    data = ExactFormulation(PROBLEM).data
    with pytest.raises(ValueError, match=r"."):
        short.verify(data.rows, data.sarason)


def test_modes_that_exceed_the_gain_many_times_are_verified_up_to_their_rounding():
    """A peak of 1e8 K at damping .002, in the truncated form: only rounding is forgiven, not an amplitude off by 1e-10."""
    dt, modes = 1e-3, rid.kautz([200.0], [0.002], dt=1e-3)
    omega = np.union1d(np.linspace(20, 3000, 150), np.linspace(195, 205, 41))
    values = modes.response(omega * dt) @ [1.0, 0.5]
    prior = rid.Prior(gain_bound=1e-8 * np.abs(values).max(), decay_rate=1.1)
    frf = rid.FrequencyResponse(omega, values, bound=2 * prior.gain_bound, dt=dt)
    found = rid.identify(rid.MixedProblem(frequency=frf, prior=prior, parametric=modes), form="taylor")
    assert found.verified_status is rid.Status.CONSISTENT
    point = Candidate(found.coefficients, found.scaled_parameters * (1 + 1e-10), *(np.zeros(0),) * 2, "test")
    model = found.model
    states = model.nstates - found.problem.parametric.states
    parts = found.formulation, point, Nominal(model, states, 0.0), found.claim, found.formulation.data, 1.0
    failed = [check.name for check in verify(*parts).failed]
    assert any("central interpolant" in name for name in failed)
