"""Powers of an all-pass function: the functions, their tails, and the choice for the lines."""

import mpmath as mp
import numpy as np
import pytest

import robustid as rid
from robustid.bases import Sections, shift_pair
from robustid.identification.formulation import formulate, formulate_in
from robustid.identification.formulation.sarason import PairMap
from robustid.identification.formulation.section_choice import shortest_sections
from robustid.identification.formulation.sections import SectionMap
from robustid.identification.formulation.tails import demands, taylor_tail
from robustid.identification.formulation.taylor import taylor_length
from support.cases import slow
from support.sections_of_lines import CIRCLE, coordinates, lines
from support.taylor_members import at, random_member, shares_of_tails, taylor, wide_problem

CASES = (
    Sections([0.6], 5),
    Sections([0.5 + 0.4j], 4),
    Sections([-0.3, 0.9 * np.exp(0.3j), 0.8 - 0.1j], 3),
    Sections([0.2, 0.2, 0.7j], 6),
    Sections([0.8j], 1),
    Sections([0], 7),
)


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
    fast, general = SectionMap(sections), PairMap(sections.pair)
    x, Y = rng.standard_normal(n), rng.standard_normal((n, n))
    assert np.abs(fast.matrix(x) - general.matrix(x)).max() <= 1e-12
    assert np.abs(fast.symmetry - general.symmetry).max() <= 1e-14
    assert np.vdot(Y, fast.matrix(x)) == pytest.approx(float((sections.pair.c @ fast.stein(Y))[0] @ x), rel=1e-10)
    for _ in range(5):
        member = random_member(rng, 8, 0.8)
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


@pytest.mark.parametrize("seeds", [10, slow(60)])
def test_the_tails_of_all_samples_hold_for_random_members(seeds):
    """Lines, records from rest, periodic and with free start: sections of any kind, also times members."""
    reached = np.zeros(4)
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        problem, widths = wide_problem(rng, 1.02)
        zeros = rng.uniform(0, 0.6, 1 + seed % 2) * np.exp(1j * rng.uniform(0, np.pi, 1 + seed % 2))
        sections = Sections(np.abs(zeros) if seed % 2 else zeros, int(rng.integers(1, 5)))
        rows, theta = formulate_in(problem, sections).rows, blaschke(sections)
        for member in (random_member(rng, 6, 0.8), times(theta, random_member(rng, 4, 0.8)), theta):
            inside = coordinates(at(member, CIRCLE), sections)
            reached = np.maximum(reached, shares_of_tails(problem, widths, rows, member, inside, 1e-11))
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
    rho, share, circle = 1.1, [], CIRCLE[::8]  # what is integrated decays as 1.1^-k
    for repeats in (4, 10, 24):
        sections = Sections([0.5 + 0.3j], repeats)
        longer = Sections([0.0, *[0.5 + 0.3j] * repeats], 1)  # of zeta theta: w* theta is analytic
        zeta0 = 1 / rho
        root = np.sqrt(1 - zeta0 * circle)
        w = longer.evaluate(circle * (1 - 1e-16)) @ coordinates(root, longer)
        values = sections.all_pass(circle) ** repeats * w.conj() / w
        turns = np.unwrap(np.angle(w))[[0, -1]]
        assert abs(turns[1] - turns[0]) < 0.1  # no zeros inside: a member
        inside = coordinates(values, sections)
        cauchy = np.mean(values / (1 - zeta0 * circle.conj()))
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
        rows = formulate_in(problem, sections).rows
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
        rows = formulate_in(problem, sections).rows
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


@pytest.mark.parametrize("seeds", [2, slow(20)])
def test_the_choice_keeps_every_tail_below_a_tenth_of_the_accuracy(seeds):
    for seed in range(seeds):
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
    full = lines(np.linspace(0.001, np.pi - 0.001, 200))
    assert taylor_length(full, 1e-4) <= shortest_sections(full, 1e-5).order <= taylor_length(full, 1e-4) + 8
    # A tenth of it: several times fewer; more zeros, fewer still, but never below the capacity of the arc.
    part = lines(np.linspace(0.001, 0.1 * np.pi, 100), rho=1.005)
    assert shortest_sections(part, 1e-5).order < taylor_length(part, 1e-4) / 6
    # Samples in time see the whole circle, periodic ones their lines.
    rng = np.random.default_rng(0)
    u = np.cos(2 * np.pi * 3 * np.arange(100) / 100) + np.cos(2 * np.pi * 5 * np.arange(100) / 100)
    for initial, few in (("rest", False), ("periodic", True)):
        record = rid.TimeRecord(u, rng.standard_normal(100), dt=1.0, bound=0.1, initial=initial)
        problem = rid.MixedProblem(time=record, prior=rid.Prior(gain_bound=1.0, decay_rate=1.01))
        sections = shortest_sections(problem, 1e-5)
        assert sections.is_shift != few
        assert (sections.order <= 8) == few
        assert np.isfinite(demands(problem)[2]) != few


def test_auto_takes_the_form_with_the_least_work():
    assert formulate(lines(np.linspace(0.01, 3, 40), rho=1.005), "auto", 1e-4).exact  # 80 coefficients
    assert formulate(lines(np.linspace(0.01, 3, 400)), "auto", 1e-4).repeated.is_shift
    band = lines(np.linspace(0.001, 0.3, 400), rho=1.005)
    assert taylor_length(band, 1e-2) > 4 * formulate(band, "auto", 1e-2).count
    assert not formulate(band, "auto", 1e-2).repeated.is_shift
