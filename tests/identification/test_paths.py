"""The structured interior-point method: decisions on the border, degenerate input, interruption."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.identification import consistency, decide_margin
from robustid.identification import margin as margin_module
from robustid.identification.formulation import ExactFormulation
from robustid.identification.solver import analytic_center, gain_path, margin_path
from support.cases import slow
from support.interrupts import ctrl_c
from support.matrix_plants import judge_margin
from support.pairwise import every_one
from support.problems import CASES, MIXED_IS_SLOW, identified, in_units, random_problem

# --- decisions on the border, and degenerate input --------------------------------------------------------------------


@pytest.mark.parametrize("seeds", [1, slow(3)])
@pytest.mark.parametrize("case", [slow(one) if one == "time" else one for one in MIXED_IS_SLOW])
def test_barely_feasible_problems_are_decided(case, seeds):
    """K from the gain path such that the margin is 1 + d: the margin path returns it, and the proof decides."""
    decided = 0
    for seed in range(seeds):
        problem = random_problem(40 + seed, case, 10, spread=0.5, noise=1.5)
        K = problem.prior.gain_bound
        for d in (-1e-6, 1e-6):
            data = ExactFormulation(problem).data
            inside = analytic_center(data, 1 + d) if data.rows.y.size and lowest(data) < 1 else None
            if inside is None:
                continue
            *_, (_, gain, _) = gain_path(data, inside, 1 + d)
            if gain < 1e-3:
                continue  # the parametric part fits alone
            barely = problem.with_prior(gain_bound=K * gain)
            assert lowest(ExactFormulation(barely).data) == pytest.approx(1 + d, abs=1e-8)
            result = solved(barely, accuracy=1e-6)
            assert result.margin_lower <= 1 + d + 1e-8
            assert result.margin >= 1 + d - 1e-8
            assert result.status is (rid.Status.CONSISTENT if d < 0 else rid.Status.INCONSISTENT)
            decided += 1
    assert decided >= 2


def test_a_margin_is_decided_by_what_the_path_shows_first():
    """A point inside, a certificate of more, or nothing between the two; the margin itself is known from its proof."""
    data = ExactFormulation(random_problem(40, "parametric", 10, spread=0.5, noise=1.5)).data
    margin = margin_module.prove_margin(data, "structured", 1e-4)[0].margin
    assert margin > 0.1
    point = decide_margin(data, 1.2 * margin, 1.5 * margin)
    assert margin * (1 - 1e-3) <= data.margin(point.x, point.p) <= 1.2 * margin
    proof = decide_margin(data, 0.5 * margin, 0.9 * margin)
    assert 0.9 * margin < proof.value <= margin
    assert proof.verify(data.rows, data.sarason)
    assert decide_margin(data, 0.9 * margin, 1.1 * margin) is None


def lowest(data):
    return min(margin_path(data), key=lambda point: point[2])[1]


def two_lines(values, bound, K=3.0, rho=1.1, omega=(10.0, 50.0)):
    frf = rid.FrequencyResponse(omega, values, bound=bound, dt=0.01)
    return rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=K, decay_rate=rho))


def solved(problem, **options):
    return identified(problem, solver="structured", **options)


@pytest.mark.parametrize("form", ["orthonormal", "taylor"])
def test_equal_lines_that_contradict_each_other(form):
    """Two discs around one value: the margin is half the distance, whatever else is measured."""
    first = rid.FrequencyResponse([10.0, 50.0], [1.0, 0.8 - 0.5j], bound=0.1, dt=0.01)
    again = rid.FrequencyResponse([50.0] * 3, [0.8 - 0.5j, 1.0 - 0.5j, 0.9 - 0.2j], bound=0.1, dt=0.01)
    prior = rid.Prior(gain_bound=3, decay_rate=1.1)
    result = solved(rid.MixedProblem(frequency=[first, again], prior=prior), form=form)
    # The smallest disc around (0.8, -0.5), (1.0, -0.5), (0.9, -0.2): the circle through the three.
    radius = (0.1**2 + 0.3**2) / (2 * 0.3)
    assert result.margin == pytest.approx(radius / 0.1, abs=2e-4)
    assert result.margin_lower <= radius / 0.1 + 1e-9
    assert result.margin >= radius / 0.1 - 1e-9


@pytest.mark.parametrize("seeds", [1, slow(3)])
@pytest.mark.parametrize("case", CASES)
def test_every_bound_active(case, seeds):
    """Data at distance exactly 1 of a member, in every sample: consistent, and never proved to be below what it is."""
    for seed in range(seeds):
        problem = random_problem(seed, case, 12, noise=0.0)
        rng = np.random.default_rng(seed)
        off_lines = [f.bound * np.exp(1j * rng.uniform(0, 6.3, f.values.shape)) for f in problem.frequency]
        off_samples = [t.bound * rng.choice([-1, 1], t.y.shape) for t in problem.time]

        def pushed(sign, off_lines=off_lines, off_samples=off_samples, problem=problem):
            pairs = zip(problem.frequency, off_lines, strict=True), zip(problem.time, off_samples, strict=True)
            frequency = [dataclasses.replace(f, values=f.values + sign * off) for f, off in pairs[0]]
            return frequency, [dataclasses.replace(t, y=t.y + sign * off) for t, off in pairs[1]]

        (lines, records), (others, again) = pushed(1), pushed(-1)
        result = solved(dataclasses.replace(problem, frequency=lines, time=records))
        assert result.margin_lower <= 1 + 1e-9
        assert result.consistent
        # The two opposite ends of every bound: the member is all that is left.
        both = solved(dataclasses.replace(problem, frequency=lines + others, time=records + again))
        assert both.margin == pytest.approx(1, abs=2e-6)
        assert both.margin_lower == pytest.approx(1, abs=2e-6)


@pytest.mark.parametrize("form", ["orthonormal", slow("taylor")])
def test_gain_barely_enough_for_exact_values(form):
    """One line at omega = 0: the margin is (value - K)/bound, here 1e-7 from 1 on either side."""
    for d in (-1e-7, 1e-7):
        problem = two_lines([2.0], 0.1, K=2.0 - 0.1 * (1 + d), omega=[0.0])
        result = solved(problem, form=form, accuracy=1e-8 if form == "orthonormal" else 1e-4)
        assert result.margin_lower <= 1 + d <= result.margin
        if form == "orthonormal":
            assert result.consistent == (d < 0)


@pytest.mark.parametrize("rho", [1 + 1e-3, 1 + 1e-5])
def test_a_decay_rate_near_one(rho):
    """Nodes next to the circle: every value inside the gain bound is possible, and no more than that helps."""
    rng = np.random.default_rng(0)
    omega = np.linspace(5, 290, 5)
    values = 0.9 * np.exp(1j * rng.uniform(0, 6.3, 5))
    assert solved(two_lines(values, 0.01, K=1.0, rho=rho, omega=omega), form="orthonormal").consistent
    problem = two_lines(values, 0.01, K=0.5, rho=rho, omega=omega)
    tight, judge = solved(problem, form="orthonormal"), judge_margin(problem)
    assert tight.margin == pytest.approx(judge, rel=1e-6)
    assert tight.margin >= (0.9 - 0.5) / 0.01


@pytest.mark.parametrize(("case", "scale"), every_one(CASES, [1e-6, 1e6]))
def test_badly_scaled_bounds_and_units(case, scale):
    """Data, bounds and K in other units have the same margin; bounds alone scale it."""
    problem = random_problem(3, case, 12, spread=0.2, noise=4.0)
    base = solved(problem)
    assert solved(in_units(problem, scale)).margin == pytest.approx(base.margin, rel=1e-6, abs=2e-6)
    other = solved(in_units(problem, 1.0, scale))
    size = max(1.0, base.margin / scale)
    assert other.margin_lower - 1e-4 * size <= base.margin / scale
    assert base.margin_lower / scale <= other.margin + 1e-4 * size


@pytest.mark.parametrize("form", ["orthonormal", "taylor"])
def test_one_line_one_sample_zero_data(form):
    one = solved(two_lines([2.0j], 0.1, omega=[30.0]), form=form)
    assert one.consistent
    prior = rid.Prior(gain_bound=1.0, decay_rate=1.2)
    sample = rid.TimeRecord([2.0], [3.0], dt=0.1, bound=0.5)  # |g_0| <= K: |3 - 2 g_0| >= 1
    result = solved(rid.MixedProblem(time=sample, prior=prior), form=form)
    assert result.margin == pytest.approx(2.0, abs=2e-4)
    for bound in (0.5, 500.0):
        silent = rid.TimeRecord(np.zeros(5), np.zeros(5), dt=0.1, bound=bound)
        assert solved(rid.MixedProblem(time=silent, prior=prior), form=form).margin == pytest.approx(0, abs=1e-4)
    wrong = rid.TimeRecord(np.zeros(5), [0.0, 1.0, 0, 0, -0.25], dt=0.1, bound=0.5)  # nothing can explain it
    assert solved(rid.MixedProblem(time=wrong, prior=prior), form=form).margin == pytest.approx(2.0, abs=2e-4)
    zero = solved(two_lines([0.0, 0.0], 0.1), form=form)
    assert zero.margin == pytest.approx(0, abs=1e-4)
    assert zero.consistent


@pytest.mark.parametrize("form", ["orthonormal", "taylor"])
def test_an_interrupt_leaves_the_best_verified_point(form, monkeypatch):
    problem = random_problem(2, "mixed", 12, spread=0.2, noise=4.0).with_prior(decay_rate=1.3)
    whole = solved(problem, form=form, accuracy=1e-3)
    walk, stopped = margin_module.margin_path, 0
    for last in range(6):

        def interrupted(data, *rest, last=last):
            for number, point in enumerate(walk(data, *rest)):
                if number == last:
                    raise KeyboardInterrupt
                yield point

        monkeypatch.setattr(margin_module, "margin_path", interrupted)
        if not last:
            with pytest.raises(KeyboardInterrupt):
                rid.identify(problem, solver="structured", form=form, accuracy=1e-3)
            continue
        result = solved(problem, form=form, accuracy=1e-3)
        monkeypatch.setattr(margin_module, "margin_path", walk)
        assert result.margin_lower <= whole.margin
        assert result.margin >= whole.margin_lower
        if result.margin - result.margin_lower > 1e-3 * max(1, result.margin):
            stopped += 1
            assert result.accuracy > 1e-3
            assert result.notes[0].startswith("interrupted: the margin is proved to lie between")
            assert result.status in (rid.Status.UNDECIDED, rid.Status.CONSISTENT, rid.Status.INCONSISTENT)
    assert stopped >= 3


def test_an_interrupt_during_the_centring_keeps_the_proof(monkeypatch):
    problem = random_problem(1, "mixed", 28)
    whole = solved(problem)
    monkeypatch.setattr(consistency, "analytic_center", ctrl_c)
    result = solved(problem)
    assert result.claim.margin == whole.margin
    assert "interrupted" in result.notes[0]
