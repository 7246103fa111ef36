"""Designs of one input and several outputs, or the other way round, and of matrices in a loop that may be infinite."""

import functools

import control
import numpy as np
import pytest

import robustid as rid
from robustid.controllers.conditions import conditions_of, integrators_of
from robustid.controllers.designing import At, Task
from robustid.controllers.discs import Discs
from robustid.controllers.goals import as_goal
from robustid.controllers.matrix_images import Quotients, discs_of_matrices
from robustid.controllers.plants import Plants
from robustid.controllers.structure import basis_of, integral_gain
from robustid.core import StateMatrices
from robustid.design import PID, Limits, Matrix
from support.design_cases import DT, largest, measured_in_loop, responses
from support.mimo_data import complex_normal

PEAK = 2.0
ROW = [PID(), PID(integral=False)]


def unit(matrices):
    return matrices / largest(matrices)[..., None, None]


def test_conditions_of_a_row_are_exact_in_the_discs_of_its_entries():
    """The least |1 + sum (c_k + Delta_k) C_k| and |sum ...| over all discs: attained where all turn against the middle."""
    rng = np.random.default_rng(1)
    centre, units, C = complex_normal(rng, 200, 1, 2), rng.uniform(0.05, 0.4, (200, 2)), complex_normal(rng, 200, 2, 1)
    discs = Discs.of(np.ones(200), centre, np.ones(200), units, entries=True)
    for offset, limits in ((1, Limits(sensitivity_peak=PEAK)), (0, Limits(sensitivity_peak=None, bandwidth=2.0))):
        (condition,) = conditions_of(limits, discs)
        middle = (offset + centre @ C)[:, 0, 0]
        against = -units * np.exp(1j * (np.angle(middle)[:, None] - np.angle(C[:, :, 0])))
        reach = np.sum(units * np.abs(C[:, :, 0]), axis=1)
        worst = np.abs(middle + np.sum(against * C[:, :, 0], axis=1))
        clear = np.abs(middle) > reach
        assert condition.excess(C)[clear] + condition.w[clear] == pytest.approx(worst[clear])
        drawn = units * rng.uniform(0, 1, (400, 200, 2)) * np.exp(2j * np.pi * rng.random((400, 200, 2)))
        every = np.abs(offset + np.sum((centre[:, 0] + drawn) * C[:, :, 0], axis=2)).min(axis=0)
        assert np.all(every >= condition.excess(C) + condition.w - 1e-12)


@functools.cache
def driven():
    """One input that moves a motor and, through a spring, a load: both speeds are measured, to 2 % at 30 lines."""
    motor = control.ss(control.zpk([], [0.9], 0.1, DT))
    load = control.ss(control.zpk([], [0.8 * np.exp(0.5j), 0.8 * np.exp(-0.5j)], 0.16, DT))
    plant = control.ss(
        np.block([[motor.A, np.zeros((1, 2))], [load.B @ motor.C, load.A]]),
        np.vstack([motor.B, load.B @ motor.D]),
        np.block([[motor.C, np.zeros((1, 2))], [np.zeros((1, 1)), load.C]]),
        np.zeros((2, 1)),
        DT,
    )
    omega = np.linspace(4.0, 312.0, 30)
    values = responses(plant, omega)
    frf = rid.FrequencyResponse(omega, values, bound=0.02 * np.abs(values) + 2e-3, dt=DT)
    problem = rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=2.5, decay_rate=1.06))
    return plant, rid.band(problem, model=plant)


def transposed(plant, band):
    """The same plant with its signals exchanged: one output of two inputs."""
    other = control.ss(plant.A.T, plant.C.T, plant.B.T, plant.D.T, DT)
    (frf,) = band.problem.frequency
    turned = rid.FrequencyResponse(
        frf.omega, frf.values.swapaxes(1, 2), bound=frf.bound.outer_radius.swapaxes(1, 2), dt=DT
    )
    return other, rid.band(rid.MixedProblem(frequency=turned, prior=band.problem.prior), model=other)


def judged(plant, band, design, proof, count):
    """No plant with values in the discs of the entries contradicts: peak of S at the input, C S, and |C P| up to the bandwidth."""
    assert np.abs(control.feedback(plant, design.controller).poles()).max() < 1
    omega = np.geomspace(0.05, np.pi / DT, 1000)
    C, low = responses(design.controller, omega), omega <= design.level
    held, rng = band.circle.sets_at(omega), np.random.default_rng(3)
    middle = responses(band.model, omega)
    for _ in range(count):
        P = middle + held.bound * np.exp(2j * np.pi * rng.random(held.bound.shape))
        L = (C @ P if P.shape[1] > 1 else P @ C)[:, 0, 0]
        assert np.abs(1 / (1 + L)).max() <= min(PEAK, proof.peaks["sensitivity"].value) * (1 + 1e-9)
        assert (largest(C) / np.abs(1 + L)).max() <= proof.peaks["control_sensitivity"].value * (1 + 1e-9)
        assert np.abs(L[low]).min() >= 1


def test_one_input_and_two_outputs():
    """At one level, found at frequencies and proved on the axis."""
    plant, band = driven()
    task = Task.of([Plants.of(band)], Matrix([ROW]), Limits(sensitivity_peak=PEAK), as_goal("bandwidth"))
    found = At(task, task.middle).found(15.0)
    proof = task.proof(found)
    assert found.controller.D.shape == (1, 2)
    assert proof.kept
    judged(plant, band, found, proof.proofs[0], 50)


def test_the_integral_gain_of_one_input_is_that_of_its_one_integrator():
    """Limits of C at frequency 0, with the sign that a stable loop needs; too many integrators or none are refused."""
    plant, band = driven()
    limits = Limits(sensitivity_peak=PEAK)
    task = Task.of([Plants.of(band)], Matrix([ROW]), limits, as_goal("integral gain"))
    found = At(task, task.middle).found(40.0)
    proof = task.proof(found)
    assert proof.kept
    z = 1 + 1e-7
    gains = np.real((z - 1) / DT * found.controller(z))[0]
    assert gains == pytest.approx([integral_gain(StateMatrices.of(found.controller), DT), 0.0], rel=1e-5, abs=1e-4)
    assert gains[0] >= 40.0 * (1 - 1e-5)
    assert np.abs(control.feedback(plant, found.controller).poles()).max() < 1
    with pytest.raises(rid.InputError, match="must hold an integrator for its gain"):
        rid.design_controller(band, Matrix([[ROW[1], ROW[1]]]), maximise="integral gain")


def test_integrators_of_two_inputs_and_three_outputs_are_asked_for_by_their_least_singular_value():
    """C is about K/s at the lowest frequency; along any isometry it is at most as far from the limit as along the best."""
    rng, count = np.random.default_rng(4), 200
    for ny, nu in ((2, 3), (3, 3)):  # of fewer inputs than outputs the transposed plant
        discs = Discs.of(np.array([0.3]), np.zeros((1, ny, nu), complex), np.ones(1), np.ones((1, nu)))
        one = integrators_of(2.0, discs)
        for C in 20 * complex_normal(rng, count, 1, nu, ny):
            least = np.linalg.svd(C, compute_uv=False)[0, -1] - one.w[0]
            excess, turn = one.judged(C)
            assert excess == pytest.approx(least)
            assert one.ahead(C, turn) == pytest.approx(least)
            other = np.linalg.qr(complex_normal(rng, 1, nu, ny))[0]
            assert one.ahead(C, other)[0] <= least + 1e-9


@pytest.mark.slow
def test_the_largest_integral_gain_of_one_input_is_that_of_a_search_and_of_the_transposed_plant():
    """Steps of all three gains about ever better ones, within the same discs: the second output brings nothing."""
    plant, band = driven()
    limits = Limits(sensitivity_peak=PEAK)
    design = rid.design_controller(band, Matrix([ROW]), limits=limits, maximise="integral gain")
    other, turned = transposed(plant, band)
    same = rid.design_controller(turned, Matrix([[one] for one in ROW]), limits=limits, maximise="integral gain")
    for one, own in ((plant, design), (other, same)):
        assert own.status.name == "PROVED"
        assert np.abs(control.feedback(one, own.controller).poles()).max() < 1
    assert same.level == pytest.approx(design.level, rel=0.01)
    plants, basis = Plants.of(band), basis_of(Matrix([ROW]), [], DT, (2, 1))
    grid = np.unique(np.concatenate([plants.grid()[::2], np.geomspace(0.1, np.pi / DT, 150)]))
    discs, V, rng = plants.discs(grid), basis.response(grid)[:, :, 0], np.random.default_rng(0)
    pool = rng.choice([-1, 1], (4000, basis.count)) * 10 ** rng.uniform(-2, 1.7, (4000, basis.count))
    for k in range(25):
        C = np.einsum("fmy,nm->nfy", V, pool)
        L, taken = np.einsum("nfy,fy->nf", C, discs.centre[:, 0]), np.einsum("nfy,fy->nf", np.abs(C), discs.units)
        levels = np.where(np.all(np.abs(1 + L) - taken >= 1 / PEAK, axis=1), np.abs(pool @ basis.integral), 0.0)
        order = [n for n in np.argsort(-levels)[:200] if levels[n] and plants.is_stable_with(basis.controller(pool[n]))]
        reached, best = levels[order[0]], pool[order[:15]]
        moved = best[rng.integers(0, len(best), 1500)]
        pool = np.concatenate([best, moved * (1 + 0.75**k * rng.standard_normal(moved.shape))])
    print(f"integral gain {design.level:.4g} 1/s, search {reached:.4g}")
    assert design.level >= 0.97 * reached


@pytest.mark.slow
def test_two_outputs_are_the_transposed_plant_with_two_inputs_and_no_search_finds_more():
    """10^4 values of plants at 10^3 frequencies; the other way round the same; 20 000 other gains in ever smaller boxes."""
    plant, band = driven()
    design = rid.design_controller(band, Matrix([ROW]), limits=Limits(sensitivity_peak=PEAK))
    assert design.status.name == "PROVED"
    judged(plant, band, design, design.proofs[0], 10_000)
    other, turned = transposed(plant, band)
    same = rid.design_controller(turned, Matrix([[one] for one in ROW]), limits=Limits(sensitivity_peak=PEAK))
    assert same.status.name == "PROVED"
    judged(other, turned, same, same.proofs[0], 1000)
    assert same.level == pytest.approx(design.level, rel=0.01)
    alone = rid.design_controller(band, Matrix([[PID(), None]]), limits=Limits(sensitivity_peak=PEAK))
    assert design.level >= 0.99 * alone.level  # what one output has, both have
    plants, basis = Plants.of(band), basis_of(Matrix([ROW]), [], DT, (2, 1))
    grid = np.unique(np.concatenate([plants.grid(), np.geomspace(0.1, np.pi / DT, 400)]))
    discs, V = plants.discs(grid), basis.response(grid)[:, :, 0]  # (F, m, 2)
    rng, best, spread = np.random.default_rng(0), [], 1.0
    sizes = 1 / np.abs(np.einsum("fmy,fy->fm", V, discs.centre[:, 0])).max(axis=0)
    pool = rng.choice([-1, 1], (4000, basis.count)) * sizes * 10 ** rng.uniform(-2.5, 1.5, (4000, basis.count))
    for _ in range(10):
        C = np.einsum("fmy,nm->nfy", V, pool)
        L, taken = np.einsum("nfy,fy->nf", C, discs.centre[:, 0]), np.einsum("nfy,fy->nf", np.abs(C), discs.units)
        kept = np.all(np.abs(1 + L) - taken >= 1 / PEAK, axis=1)
        high = np.abs(L) - taken >= 1
        levels = np.where(kept & high[:, 0], grid[np.argmin(high, axis=1) - 1], 0.0)
        order = [k for k in np.argsort(-levels)[:300] if levels[k] and plants.is_stable_with(basis.controller(pool[k]))]
        best = pool[order[:20]]
        reached, spread = levels[order[0]], 0.7 * spread
        moved = best[rng.integers(0, len(best), 2000)] * (1 + spread * rng.standard_normal((2000, basis.count)))
        pool = np.concatenate([best, moved])
    print(f"two outputs {design.level:.4g} rad/s, one {alone.level:.4g}, search {reached:.4g}")
    assert design.level >= 0.98 * reached


def quotients(rng, count, ny, nu, size):
    """Random plants about a model in a loop: P(Delta) = P0 + A Delta (I - M Delta)^-1 B."""
    value, left, right = (
        complex_normal(rng, count, ny, nu),
        complex_normal(rng, count, ny, ny),
        complex_normal(rng, count, nu, nu),
    )
    inner, running = complex_normal(rng, count, nu, ny), complex_normal(rng, count, nu, ny)
    return Quotients(value, left, right, inner, np.full((count, ny, nu), size), running)


@pytest.mark.parametrize(("ny", "nu"), [(2, 2), (1, 2)])
def test_conditions_of_matrices_that_may_be_infinite_hold_for_all_errors(ny, nu):
    """Of controllers that keep them: S, T, C S, P S and the bandwidth at 100 errors of the size of the bounds, each."""
    rng, count = np.random.default_rng(2), 150
    about = quotients(rng, count, ny, nu, 0.08)
    discs = discs_of_matrices(np.ones(count), about, np.full(count, np.inf), np.ones(count))
    assert discs.outside.all()
    change = about.bound * np.exp(2j * np.pi * rng.random((100, count, ny, nu)))
    inner = np.linalg.inv(np.eye(nu) - about.inner @ change)
    P = about.value + about.left @ change @ inner @ about.right
    top = about.right - about.inner @ discs.under @ about.value
    still = np.linalg.solve(
        top, about.inner @ discs.under
    )  # with this controller Delta does nothing; others are about it
    near = still + 0.3 * largest(still)[:, None, None] * complex_normal(rng, count, nu, ny)
    high = np.geomspace(1.0, 30.0, count)[:, None, None] * np.linalg.pinv(about.value)  # P C is about so many times I
    for name in ("sensitivity_peak", "complementary_peak", "control_peak", "process_peak", "bandwidth"):
        C = high if name == "bandwidth" else near
        S = np.linalg.inv(np.eye(ny) + P @ C)
        sizes = {
            "sensitivity_peak": S,
            "complementary_peak": np.eye(ny) - S,
            "control_peak": C @ S,
            "process_peak": S @ P,
            "bandwidth": 1.005 * np.linalg.inv(P @ C),
        }[name]
        worst, kept = largest(sizes).max(axis=0), 0
        limits = [1.0] if name == "bandwidth" else [part * np.median(worst) for part in (1.1, 1.5, 3.0, 10.0)]
        for limit in (float(one) for one in limits if name != "complementary_peak" or one > 1):
            asked = 2.0 if name == "bandwidth" else limit
            every = conditions_of(Limits(**{"sensitivity_peak": None, name: asked}), discs)
            (condition,) = (one for one in every if one.place.size)
            keeps = condition.excess(C) >= 0
            assert np.all(worst[keeps] <= limit * (1 + 1e-9)), name
            assert np.any(worst > limit), name  # else there is nothing to be wrong about
            kept += keeps.sum()
        assert kept > 3, name


def test_the_same_plant_twice_is_that_plant_alone():
    """Multiples of I: all Delta of a norm leave 1 + P C apart from 0 where all numbers do, |V (1 + P0 C)| > r |T C + U|."""
    rng, count, one = np.random.default_rng(3), 500, np.eye(2)
    value, left, right, inner, C = (complex_normal(rng, count, 1, 1) for _ in range(5))
    radius = rng.uniform(0.05, 0.6, count)
    parts = [part * one for part in (value, left, right, inner)]
    running = (
        np.linalg.inv(parts[2] - parts[3] @ np.linalg.inv(parts[1]) @ parts[0]) @ parts[3] @ np.linalg.inv(parts[1])
    )
    about = Quotients(*parts, radius[:, None, None] * one, running)
    discs = discs_of_matrices(np.ones(count), about, np.full(count, np.inf), np.ones(count))
    (condition,) = (one for one in conditions_of(Limits(sensitivity_peak=1e9), discs) if one.place.size)
    change = radius[:, None] * np.exp(2j * np.pi * np.arange(2000) / 2000)
    value, left, right, inner, number = (part[:, 0] for part in (value, left, right, inner, C))
    under = 1 - inner * change  # of P = P0 + left Delta right / (1 - inner Delta)
    curve = (
        under * (1 + value * number) + left * change * right * number
    )  # how often it runs about 0 is the count of roots
    crosses = np.abs(np.angle(np.roll(curve, -1, axis=1) / curve).sum(axis=1)) > np.pi
    assert np.array_equal(condition.excess(C * one) > 0, ~crosses)
    assert 50 < crosses.sum() < 450


@functools.cache
def carts():
    """Two free masses with lags, coupled, measured under a gain of 2 each: R has 30 lines, known to 2 %."""
    axis = control.ss(control.zpk([], [1.0, 0.4], 0.12, DT))
    whole = control.append(axis, axis)
    coupling = np.array([[1.0, 0.2], [-0.1, 0.8]])
    plant = control.ss(whole.A, whole.B, coupling @ whole.C, coupling @ whole.D, DT)
    return plant, *measured_in_loop(plant, 2 * np.eye(2))


@pytest.mark.slow
def test_matrices_that_may_be_infinite_have_a_controller_that_no_consistent_plant_contradicts(tmp_path):
    """10^4 values of R on the borders of the bounds of its entries at each of 400 frequencies, and systems near to its model."""
    plant, loop, problem, ran = carts()
    plants = Plants.of(ran)
    assert plants.discs(plants.grid()).outside[0]
    design = rid.design_controller(ran, [PID(filter=200.0)], limits=Limits(sensitivity_peak=PEAK))
    assert design.status.name == "PROVED"
    omega = np.geomspace(0.01, np.pi / DT, 400)
    C, low, one = responses(design.controller, omega), omega <= design.level, np.eye(2)
    held, middle, rng = ran.band.circle.sets_at(omega).bound, responses(ran.band.model, omega), np.random.default_rng(1)
    peak, gain = 0.0, np.inf
    for _ in range(10_000):
        R = middle + held * np.exp(2j * np.pi * rng.random(held.shape))
        under = one - 2 * R  # P = R (I - 2 R)^-1, and S = (I + P C)^-1
        P = R @ np.linalg.inv(under)
        peak = max(peak, largest(np.linalg.inv(one + P @ C)).max())
        gain = min(gain, 1 / largest(np.linalg.inv(P[low] @ C[low])).max())
    assert peak <= min(PEAK, design.proofs[0].peaks["sensitivity"].value) * (1 + 1e-9)
    assert gain >= 1
    R = loop.residual_of(plant)
    for _ in range(20):  # what is added is less than the bound of every line; the class has room for it
        turn = np.linalg.qr(complex_normal(rng, 2, 2))[0].real
        more = control.ss(control.zpk([], [rng.uniform(-0.5, 0.5)], 1.0, DT))
        more = control.ss(control.append(more, more))
        size = 9e-4 / np.abs(responses(more, omega)).max()
        other = R + control.ss(more.A, more.B, size * turn @ more.C, size * turn @ more.D, DT)
        assert largest(responses(other, omega)).max() < problem.prior.gain_bound
        closed = control.feedback(loop.plant_of(other), design.controller)
        assert np.abs(closed.poles()).max() < 1
    design.save(tmp_path / "design")
    assert rid.load(tmp_path / "design").status.name == "PROVED"
    rid.write_report(design, tmp_path / "design.html")
    print(
        f"bandwidth {design.level:.4g} rad/s; peak of S {peak:.4g} of {design.proofs[0].peaks['sensitivity'].value:.4g}, {gain:.4g}"
    )
