"""The form of a repeated all-pass section: its functions, its tails, its proofs and its models."""

import dataclasses
import json

import mpmath as mp
import numpy as np
import pytest

import robustid as rid
from problems import random_problem
from robustid.bases import Sections, shift_pair
from robustid.identification.forms import pose, sections_of, taylor_length
from robustid.identification.residuals import model_residuals
from robustid.identification.section_choice import demands, shortest_sections
from robustid.interpolation import (
    BalancedContraction,
    SarasonMap,
    SectionMap,
    evaluate_certificate,
    measurement_rows,
    taylor_tail,
)
from robustid.reduction import hankel_singular_values
from test_taylor_form import at, polynomials, random_experiments, responses, taylor

CIRCLE = np.exp(2j * np.pi * np.arange(2**13) / 2**13)
CASES = (
    Sections([0.6], 5),
    Sections([0.5 + 0.4j], 4),
    Sections([-0.3, 0.9 * np.exp(0.3j), 0.8 - 0.1j], 3),
    Sections([0.2, 0.2, 0.7j], 6),
    Sections([0.8j], 1),
    Sections([0], 7),
)


def random_member(rng, degree):
    """A Blaschke product with zeros in |zeta| < 0.8 as (P, Q), at times half of one with half of another."""
    radii, turns = 0.8 * np.sqrt(rng.uniform(0, 1, (2, degree // 2))), rng.uniform(0, np.pi, (2, degree // 2))
    first, second = (polynomials(zeros) for zeros in radii * np.exp(1j * turns))
    if rng.uniform() < 0.5:
        return first
    return (np.convolve(first[0], second[1]) + np.convolve(second[0], first[1])) / 2, np.convolve(first[1], second[1])


def coordinates(values, sections):
    """<g, phi_j> of a function with these values on the circle."""
    return (values @ sections.evaluate(CIRCLE * (1 - 1e-16)).conj()).real / CIRCLE.size


# --- the functions ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("sections", CASES)
def test_the_functions_of_a_repeated_section(sections):
    """Orthogonal realisation of B^M; its functions by blocks, and the reproducing kernel of their span."""
    pair, n = sections.pair, sections.order
    V = np.block([[pair.A, pair.B], [pair.c, pair.d]])
    assert np.abs(V @ V.T - np.eye(n + 1)).max() <= 1e-15
    rng = np.random.default_rng(n)
    z = np.sqrt(rng.uniform(0, 0.95, 9)) * np.exp(2j * np.pi * rng.uniform(0, 1, 9))
    theta = sections.all_pass(z) ** sections.repeats
    assert np.abs(np.abs(sections.all_pass(CIRCLE)) - 1).max() <= 1e-13
    assert np.abs(sections.all_pass(np.array(sections.zeros))).max() <= 1e-15
    realised = [(pair.d + w * pair.c @ np.linalg.solve(np.eye(n) - w * pair.A, pair.B))[0, 0] for w in z]
    assert np.abs(theta - realised).max() <= 1e-14
    phi = sections.evaluate(z)
    assert np.abs(phi - pair.evaluate(z)).max() <= 1e-13
    kernel = (1 - np.outer(theta, theta.conj())) / (1 - np.outer(z, z.conj()))
    assert np.abs(phi @ phi.conj().T - kernel).max() <= 1e-13 / 0.05


@pytest.mark.parametrize("sections", CASES)
def test_the_map_of_a_repeated_section(sections):
    """Its blocks against the general map, and against g(A) of members by their Taylor series."""
    rng, n = np.random.default_rng(1), sections.order
    fast, general = SectionMap(sections), SarasonMap(sections.pair)
    x, Y = rng.standard_normal(n), rng.standard_normal((n, n))
    assert np.abs(fast.matrix(x) - general.matrix(x)).max() <= 1e-12
    assert np.abs(fast.symmetry - general.symmetry).max() <= 1e-14
    assert np.vdot(Y, fast.matrix(x)) == pytest.approx(float((sections.pair.c @ fast.stein(Y))[0] @ x), rel=1e-10)
    for _ in range(5):
        member = random_member(rng, 8)
        X, power = np.zeros((n, n)), np.eye(n)
        for g in taylor(member, 3000):
            X, power = X + g * power, power @ sections.pair.A
            if np.abs(power).max() < 1e-17:
                break
        inside = coordinates(at(member, CIRCLE), sections)
        assert np.abs(fast.matrix(inside) - X).max() <= 1e-10
        assert fast.norm(inside) <= 1 + 1e-10


def test_zeros_that_are_real_to_rounding():
    for zero in (-0.5 + 1e-17j, 0.5 - 0j, -0.5 - 0j, -1e-3 + 1e-20j, 0.5 * np.exp(1j * np.pi)):
        sections = Sections([zero, 0.3j], 2)
        assert sections.degree == sections.section.order == 3
        assert sections.pair.order == sections.order == 6
    high = lines(np.linspace(3.0, np.pi, 100), rho=1.005)  # zeros at angle pi, twice
    sections = shortest_sections(high, 1e-5)
    assert sections.degree == sections.section.order


def test_the_shift_is_a_section():
    sections = Sections.shift(6)
    assert sections.is_shift
    assert np.array_equal(sections.pair.A, shift_pair(6).A)
    assert np.array_equal(sections.pair.c, shift_pair(6).c)


# --- tails ------------------------------------------------------------------------------------------------------------


def test_the_tails_of_all_samples_hold_for_random_members():
    """Lines, records from rest, periodic and with free start: 60 problems, sections of any kind, also times members."""
    reached = np.zeros(4)
    for seed in range(60):
        rng = np.random.default_rng(seed)
        frequency, time = random_experiments(rng)
        prior = rid.Prior(gain_bound=rng.uniform(0.1, 10), decay_rate=rng.uniform(1.02, 1.3))
        problem = rid.MixedProblem(frequency=frequency, time=time, prior=prior)
        zeros = rng.uniform(0, 0.6, 1 + seed % 2) * np.exp(1j * rng.uniform(0, np.pi, 1 + seed % 2))
        sections = Sections(np.abs(zeros) if seed % 2 else zeros, int(rng.integers(1, 5)))
        rows, bound = (
            measurement_rows(problem, sections),
            1 / np.abs(measurement_rows(problem, Sections([0.5], 1)).y + 1),
        )
        del bound
        widths = np.concatenate([f.bound[:, 0, 0] for f in frequency] + [t.bound[:, 0] for t in time])
        past = np.abs(time[2].u).max() * prior.gain_bound * prior.decay_rate ** -np.arange(40.0)
        widths[-40:] += past / (prior.decay_rate - 1)
        theta = blaschke(sections)
        for member in (random_member(rng, 6), times(theta, random_member(rng, 4)), theta):
            values = responses(problem, member) / widths
            rest = np.abs(values - rows.E @ coordinates(at(member, CIRCLE), sections))
            assert np.all(rest <= rows.tail * (1 + 1e-9) + 1e-11 * np.abs(values).max())
            parts = [slice(0, 6), slice(6, 46), slice(46, 86), slice(86, 126)]
            reached = np.maximum(reached, [(rest[part] / rows.tail[part]).max() for part in parts])
    assert np.all(reached > [0.6, 0.9, 0.2, 0.9])


def blaschke(sections):
    """theta as rising coefficients of its numerator and denominator."""
    roots = np.concatenate([[a, a.conjugate()] if a.imag else [a] for a in sections.zeros] * sections.repeats)
    above = np.real(np.poly(roots))[::-1]
    return above, above[::-1]


def times(a, b):
    return np.convolve(a[0], b[0]), np.convolve(a[1], b[1])


def test_no_smaller_tail_is_true_at_the_ends_of_the_circle():
    """At real zeta0 the tail is reached as M grows: by theta w*/w, w the projection of (1 - zeta0 z)^(1/2), as Landau's."""
    rho, share = 1.1, []
    for repeats in (4, 10, 24):
        sections = Sections([0.5 + 0.3j], repeats)
        longer = Sections([0.0, *[0.5 + 0.3j] * repeats], 1)  # of zeta theta: w* theta is analytic
        zeta0 = 1 / rho
        root = np.sqrt(1 - zeta0 * CIRCLE)
        w = longer.evaluate(CIRCLE * (1 - 1e-16)) @ coordinates(root, longer)
        values = sections.all_pass(CIRCLE) ** repeats * w.conj() / w
        turns = np.unwrap(np.angle(w))[[0, -1]]
        assert abs(turns[1] - turns[0]) < 0.1  # no zeros inside: a member
        inside = coordinates(values, sections)
        cauchy = np.mean(values / (1 - zeta0 * CIRCLE.conj()))
        rest = abs(cauchy - sections.evaluate(zeta0)[0] @ inside)
        bound = taylor_tail(rid.Prior(gain_bound=1.0, decay_rate=rho), 0) * abs(sections.all_pass(zeta0)) ** repeats
        assert rest <= bound * (1 + 1e-9)
        share.append(rest / bound)
    assert share[-1] > 0.99
    assert share == sorted(share)


def test_the_tail_of_a_time_sample_is_the_distance_of_its_functional():
    rng = np.random.default_rng(0)
    u, rho = rng.standard_normal(30), 1.05
    record = rid.TimeRecord(u, np.zeros(30), dt=0.01, bound=0.5)
    problem = rid.MixedProblem(time=record, prior=rid.Prior(gain_bound=2.0, decay_rate=rho))
    for sections in CASES[:4]:
        rows = measurement_rows(problem, sections)
        for n in (0, 3, 17, 29):
            h = u[n::-1] * rho ** -np.arange(n + 1.0)
            inside = rows.E.dense()[n].real * 0.5 / 2.0
            expected = h @ sections.pair.taylor(n + 1)
            assert np.abs(inside - expected).max() <= 1e-13
            assert (rows.tail[n] * 0.5 / 2.0) ** 2 == pytest.approx(h @ h - inside @ inside, abs=1e-12 * (h @ h))


def test_the_allowance_for_rounding_covers_the_columns():
    """Next to the circle and to a zero of B: the functions and theta in 40 digits."""
    for rho in (1.1, 1.001):
        angles = np.array([0.05, 0.1, 0.1 + 1e-9, 0.3, 1.0])
        frf = rid.FrequencyResponse(angles, np.zeros(5), bound=1.0, dt=1.0)
        problem = rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=1.0, decay_rate=rho))
        sections = Sections([np.exp(0.1j) / rho, 0.95 * np.exp(0.2j)], 30)
        rows = measurement_rows(problem, sections)
        with mp.workdps(40):
            for k, angle in enumerate(angles):
                zeta = mp.expj(-mp.mpf(angle)) / mp.mpf(rho)
                B = mp.mpc(1)
                for a in sections.zeros:
                    for zero in (mp.mpc(a), mp.conj(mp.mpc(a))):
                        B *= (zeta - zero) / (1 - mp.conj(zero) * zeta)
                phi = exact_functions(sections, zeta, B)
                error = mp.norm([mp.mpc(e) - f for e, f in zip(rows.E.dense()[k], phi, strict=True)])
                tail = abs(B) ** 30 * mp.mpf(2) / mp.pi * mp.ellipk(1 / mp.mpf(rho) ** 2)
                assert tail + error <= rows.tail[k] * (1 + 1e-12)


def exact_functions(sections, zeta, B):
    section = sections.section
    left = mp.eye(section.order) - zeta * mp.matrix(section.A.T.tolist())
    e = mp.lu_solve(left, mp.matrix(section.c[0].tolist()))
    return [e[a] * B**k for k in range(sections.repeats) for a in range(section.order)]


# --- the choice -------------------------------------------------------------------------------------------------------


def lines(omega, bound=0.01, rho=1.05, gain=1.0):
    frf = rid.FrequencyResponse(omega, np.zeros(np.size(omega)), bound=bound, dt=1.0)
    return rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=gain, decay_rate=rho))


def test_the_choice_keeps_every_tail_below_a_tenth_of_the_accuracy():
    for seed in range(20):
        rng = np.random.default_rng(seed)
        low, width, count = rng.uniform(0.001, 1.5), rng.uniform(0.01, 1.5), int(rng.integers(1, 600))
        omega = np.unique(low + width * rng.uniform(0, 1, count))
        problem = lines(omega, 10 ** rng.uniform(-4, -1, omega.size), 1 + 10 ** rng.uniform(-3, -0.5))
        for accuracy in (1e-2, 1e-4):
            sections = shortest_sections(problem, 0.1 * accuracy)
            assert sections.order <= taylor_length(problem, accuracy) + 1
            size = np.abs(sections.all_pass(np.exp(-1j * omega) / problem.prior.decay_rate))
            tails = [
                (taylor_tail(problem.prior, 0) * size**M / problem.frequency[0].bound[:, 0, 0]).max()
                for M in (sections.repeats, sections.repeats - 1)
            ]
            assert tails[0] <= 0.1 * accuracy * (1 + 1e-9) < tails[1]


def test_known_choices():
    # One line: its own zeros, two coefficients, no tail.
    one = shortest_sections(lines([0.7]), 1e-5)
    assert one.order == 2
    assert abs(one.zeros[0] - np.exp(0.7j) / 1.05) <= 0.01
    # No samples that feel anything: one coefficient.
    assert shortest_sections(lines([0.7], bound=1e9), 1e-2).order == 1
    # The whole circle: nothing helps, since the mean of log|B| is at least -m log(rho).
    full = lines(np.linspace(0.001, np.pi - 0.001, 800))
    assert taylor_length(full, 1e-4) <= shortest_sections(full, 1e-5).order <= taylor_length(full, 1e-4) + 8
    # A tenth of it: several times fewer; more zeros, fewer still, but never below the capacity of the arc.
    part = lines(np.linspace(0.001, 0.1 * np.pi, 800), rho=1.005)
    assert shortest_sections(part, 1e-5).order < taylor_length(part, 1e-4) / 6
    # Samples in time see the whole circle, periodic ones their lines.
    rng = np.random.default_rng(0)
    u = np.cos(2 * np.pi * 3 * np.arange(200) / 200) + np.cos(2 * np.pi * 5 * np.arange(200) / 200)
    for initial, few in (("rest", False), ("periodic", True)):
        record = rid.TimeRecord(u, rng.standard_normal(200), dt=1.0, bound=0.1, initial=initial)
        problem = rid.MixedProblem(time=record, prior=rid.Prior(gain_bound=1.0, decay_rate=1.01))
        sections = shortest_sections(problem, 1e-5)
        assert sections.is_shift != few
        assert (sections.order <= 8) == few
        assert np.isfinite(demands(problem)[2]) != few


def test_auto_takes_the_form_with_the_least_work():
    assert sections_of(lines(np.linspace(0.01, 3, 40), rho=1.005), "auto", 1e-4) is None  # 80 coefficients
    assert sections_of(lines(np.linspace(0.01, 3, 400)), "auto", 1e-4).is_shift
    band = lines(np.linspace(0.001, 0.3, 400), rho=1.005)
    assert taylor_length(band, 1e-2) > 4 * sections_of(band, "auto", 1e-2).order
    assert not sections_of(band, "auto", 1e-2).is_shift


# --- identify ---------------------------------------------------------------------------------------------------------

ACCURACY = 1e-3


def posed_problem(case, seed):
    """Odd seeds are inconsistent."""
    spread, noise = ((1.0, 0.9), (0.2, 5.0))[seed % 2]
    problem = random_problem(seed, case, 14, spread=spread, noise=noise)
    return problem.with_prior(decay_rate=1.05 + 0.03 * (seed % 4))


@pytest.mark.parametrize("case", ["frequency", "parametric"])
@pytest.mark.parametrize("seed", range(4))
def test_the_margin_is_that_of_the_exact_form(case, seed):
    if case == "parametric":
        problem = posed_problem(case, seed)
        problem = rid.MixedProblem(frequency=problem.frequency, prior=problem.prior, parametric=problem.parametric)
    else:
        problem = posed_problem(case, seed)
    exact, result = (rid.identify(problem, form=form, accuracy=ACCURACY) for form in ("orthonormal", "sections"))
    assert result.verification.passed, result.summary()
    assert not result.sections.is_shift
    assert max(exact.margin_lower, result.margin_lower) <= min(exact.margin, result.margin) + 1e-9
    for each in (exact, result):
        assert each.margin - each.margin_lower <= ACCURACY * max(1, each.margin)
    if rid.Status.UNDECIDED not in (exact.status, result.status):
        assert exact.status is result.status
    check_certificate(problem, result)
    check_model(problem, result)
    # No system drawn from the class has a worst residual below `margin_lower`.
    rng, rows = np.random.default_rng(seed), pose(problem, result.sections).data.rows
    for _ in range(3):
        model = exact.solution(rng.uniform(-1, 1))
        worst = max(r.ratio.max() for r in model_residuals(problem, model))
        assert worst >= result.margin_lower - 1e-9 * max(1, worst)
    for t in (1e-4, 1e-2, 0.1, 1.0):
        other = coordinates(at(random_member(rng, 6), CIRCLE), result.sections)
        x = (1 - t) * result.claim.x + t * other
        assert rows.ratio(x, result.claim.p).max() >= result.margin_lower - 1e-9


def check_certificate(problem, result):
    """Its value by its definition; changed numbers do not verify."""
    data, proof = pose(problem, result.sections).data, result.certificate
    assert proof.verify(data.rows, data.sarason)
    if not proof.value:
        return
    weights, A = proof.samples, result.sections.pair.A
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
    """Stable, and its residuals, by its frequency response, are within what was promised."""
    model, level = result.model, max(1.0, result.margin * (1 + 1e-6))
    assert np.abs(np.linalg.eigvals(model.A)).max(initial=0.0) < 1
    for f, residual in zip(problem.frequency, result.residuals, strict=True):
        error = f.values[:, 0, 0] - model(np.exp(1j * f.omega * problem.dt))
        assert np.abs(error - residual.error).max() <= 1e-8 * np.abs(f.values).max()
        assert (np.abs(error) / f.bound[:, 0, 0]).max() <= level * (1 + 1e-5)


def scaled_bounds(problem, factor):
    (frf,) = problem.frequency
    return rid.MixedProblem(frequency=frf.with_bound(frf.bound * factor), prior=problem.prior)


def test_barely_consistent_and_barely_not():
    problem = posed_problem("frequency", 3)
    margin = rid.identify(problem, form="orthonormal", accuracy=1e-7).margin
    assert 0.5 < margin < 1
    for factor, status in ((1 + 3e-4, rid.Status.CONSISTENT), (1 - 3e-4, rid.Status.INCONSISTENT)):
        result = rid.identify(scaled_bounds(problem, margin * factor), form="sections")
        assert result.status is status
        assert result.verification.passed
        assert result.margin_lower <= 1 / factor <= result.margin


def test_periodic_records():
    rng = np.random.default_rng(3)
    u = sum(np.cos(2 * np.pi * k * np.arange(120) / 120 + rng.uniform(0, 6)) for k in (2, 3, 5, 7))
    for noise in (0.5, 4.0):
        spectrum = np.fft.rfft(u) * 0.2 / (1.3 - np.exp(-2j * np.pi * np.arange(61) / 120))
        y = np.fft.irfft(spectrum, 120) + 0.05 * noise * rng.uniform(-1, 1, 120)
        record = rid.TimeRecord(u, y, dt=0.01, bound=0.05, initial="periodic")
        problem = rid.MixedProblem(time=record, prior=rid.Prior(gain_bound=1.0, decay_rate=1.02))
        exact, result = (rid.identify(problem, form=form) for form in ("orthonormal", "sections"))
        assert result.verification.passed, result.summary()
        assert not result.sections.is_shift
        assert max(exact.margin_lower, result.margin_lower) <= min(exact.margin, result.margin) + 1e-9


def test_time_samples_from_rest_are_answered_by_taylor_coefficients():
    problem = random_problem(2, "mixed", 14).with_prior(decay_rate=1.25)
    taylor_form, result = (rid.identify(problem, form=form, accuracy=ACCURACY) for form in ("taylor", "sections"))
    assert result.sections == taylor_form.sections
    assert (result.margin, result.margin_lower) == (taylor_form.margin, taylor_form.margin_lower)
    assert "Taylor coefficients" in result.summary()


def oversampled(count=300, rho=1.003, top=0.01, noise=1.0, bound=0.01):
    """Lines from 0.2 to 10 Hz at dt = 1 ms, of a member: three modes with poles at 1.5 to 2.5 times the decay."""
    rng, dt = np.random.default_rng(0), 1e-3
    angles = np.linspace(2e-4, top, count) * 2 * np.pi
    poles = (1 + (rho - 1) * rng.uniform(1.5, 2.5, 3)) * np.exp(2j * np.pi * top * rng.uniform(0.1, 0.9, 3))
    weights = rng.standard_normal(3) + 1j * rng.standard_normal(3)

    def member(z):
        return sum(
            w / (1 - z / p) + w.conjugate() / (1 - z / p.conjugate()) for w, p in zip(weights, poles, strict=True)
        )

    size = np.abs(member(rho * np.exp(1j * np.linspace(0, np.pi, 20000)))).max()
    error = bound * np.sqrt(rng.random(count)) * np.exp(2j * np.pi * rng.random(count))
    values = 0.9 * member(np.exp(-1j * angles)) / size + noise * error
    frf = rid.FrequencyResponse(angles / dt, values, dt=dt, bound=bound)
    return rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=1.0, decay_rate=rho))


@pytest.mark.parametrize(("noise", "status"), [(0.99, rid.Status.CONSISTENT), (3.0, rid.Status.INCONSISTENT)])
def test_oversampled_lines_that_taylor_coefficients_can_not_answer(noise, status, tmp_path):
    problem = oversampled(noise=noise)
    with pytest.raises(rid.SizeError, match=r"needs 5\d\d\d Taylor coefficients"):
        rid.identify(problem, form="taylor")
    result = rid.identify(problem)
    assert result.status is status
    assert result.verification.passed, result.summary()
    assert not result.sections.is_shift
    assert result.length == result.coefficients.size < 200
    assert f"{result.length} coefficients of an all-pass section" in result.summary()
    check_certificate(problem, result)
    check_model(problem, result)
    # The exact form of every other or third line: its margin is at most this one.
    some = rid.MixedProblem(frequency=problem.frequency[0].select(slice(None, None, 8)), prior=problem.prior)
    assert rid.identify(some, form="orthonormal").margin_lower <= result.margin + 1e-9
    result.save(tmp_path / "sections")
    again = rid.load_identification(tmp_path / "sections")
    assert again.sections == result.sections
    assert (again.margin, again.margin_lower, again.status) == (result.margin, result.margin_lower, result.status)
    assert np.array_equal(again.model.A, result.model.A)
    assert again.verification.checks == result.verification.checks
    text = tmp_path / "sections.json"
    record = json.loads(text.read_text())
    record["sections"]["repeats"] += 1
    text.write_text(json.dumps(record))
    with pytest.raises(rid.FileFormatError, match="its sections do not belong to its coefficients"):
        rid.load_identification(tmp_path / "sections")


def test_objectives_and_other_solutions():
    problem = oversampled(60, rho=1.02)
    exact, result = (rid.identify(problem, form=form, objective="gain") for form in ("orthonormal", "sections"))
    assert result.prior.gain_bound == pytest.approx(exact.prior.gain_bound, rel=3e-4)
    assert result.verification.passed, result.summary()
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
        with pytest.raises(rid.InputError, match="`zeros` must be one or more numbers inside the unit disc"):
            Sections(zeros, 3)
    with pytest.raises(rid.InputError, match="`repeats` must be at least 1"):
        Sections([0.5], 0)
    with pytest.raises(rid.InputError, match="`form` must be one of"):
        rid.identify(oversampled(5), form="section")
    with pytest.raises(rid.SizeError, match=r"needs \d+ coefficients \(a section of degree 8, repeated\)"):
        rid.identify(lines(np.linspace(0.001, 1, 500), rho=1.001), form="sections")
    with pytest.raises(rid.SizeError, match=r"500 coefficients in the form of sections and 100000 frequency lines"):
        measurement_rows(lines(np.linspace(0.001, 1, 100_000)), Sections([0.5], 500))


# --- the model --------------------------------------------------------------------------------------------------------


def test_balanced_contractions_against_the_general_reduction():
    """Hankel values of another method, errors on the circle within the bound, bounds within the tolerance."""
    import control

    rng = np.random.default_rng(0)
    A = (
        0.99
        * np.linalg.qr(rng.standard_normal((30, 30)))[0]
        * np.append(rng.uniform(0.1, 1, 10), rng.uniform(0, 0.1, 20))
    )
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
