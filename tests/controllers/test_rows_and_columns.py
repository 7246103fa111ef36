"""Designs of one input and several outputs, or the other way round, and of matrices in a loop that may be infinite."""

import functools

import control
import numpy as np
import pytest

import robustid as rid
from robustid.controllers.conditions import Discs, conditions_of
from robustid.controllers.matrix_images import Quotients, discs_of_matrices
from robustid.controllers.plants import Plants
from robustid.controllers.structure import basis_of
from robustid.core import StateMatrices, points_of, response_at
from robustid.design import PID, Limits, Matrix
from support.design_cases import DT

PEAK = 2.0
ROW = [PID(), PID(integral=False)]


def responses(model, omega):
    return response_at(StateMatrices.of(model), points_of(omega, model.dt or 0))


def random(rng, *shape):
    return rng.standard_normal(shape) + 1j * rng.standard_normal(shape)


def largest(matrices):
    return np.linalg.norm(matrices, 2, axis=(-2, -1))


def unit(matrices):
    return matrices / largest(matrices)[..., None, None]


def test_conditions_of_a_row_are_exact_in_the_discs_of_its_entries():
    """The least |1 + sum (c_k + Delta_k) C_k| and |sum ...| over all discs: attained where all turn against the middle."""
    rng = np.random.default_rng(1)
    centre, units, C = random(rng, 200, 1, 2), rng.uniform(0.05, 0.4, (200, 2)), random(rng, 200, 2, 1)
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
    frf = band.problem.frequency
    turned = rid.FrequencyResponse(
        frf.omega, frf.values.swapaxes(1, 2), bound=frf.bound.outer_radius.swapaxes(1, 2), dt=DT
    )
    return other, rid.band(rid.MixedProblem(frequency=turned, prior=band.problem.prior), model=other)


def judged(plant, band, design, count):
    """No plant with values in the discs of the entries contradicts: peak of S at the input, C S, and |C P| up to the bandwidth."""
    assert design.status.name == "PROVED"
    assert np.abs(control.feedback(plant, design.controller).poles()).max() < 1
    (proof,) = design.proofs
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


@functools.cache
def of_two_outputs():
    plant, band = driven()
    return rid.design_controller(band, Matrix([ROW]), limits=Limits(sensitivity_peak=PEAK))


def test_one_input_and_two_outputs():
    plant, band = driven()
    design = of_two_outputs()
    assert design.controller.D.shape == (1, 2)
    judged(plant, band, design, 100)


@pytest.mark.slow
def test_two_outputs_are_the_transposed_plant_with_two_inputs_and_no_search_finds_more():
    """10^4 values of plants at 10^3 frequencies; the other way round the same; 20 000 other gains in ever smaller boxes."""
    plant, band = driven()
    design = of_two_outputs()
    judged(plant, band, design, 10_000)
    other, turned = transposed(plant, band)
    same = rid.design_controller(turned, Matrix([[one] for one in ROW]), limits=Limits(sensitivity_peak=PEAK))
    judged(other, turned, same, 1000)
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
    value, left, right = random(rng, count, ny, nu), random(rng, count, ny, ny), random(rng, count, nu, nu)
    inner, running = random(rng, count, nu, ny), random(rng, count, nu, ny)
    return Quotients(value, left, right, inner, np.full((count, ny, nu), size), running)


@pytest.mark.parametrize(("ny", "nu"), [(2, 2), (1, 2)])
def test_conditions_of_matrices_that_may_be_infinite_hold_for_all_errors(ny, nu):
    """Of controllers that keep them: S, T, C S, P S and the bandwidth at 300 errors of the size of the bounds, each."""
    rng, count = np.random.default_rng(2), 400
    about = quotients(rng, count, ny, nu, 0.08)
    discs = discs_of_matrices(np.ones(count), about, np.full(count, np.inf), np.ones(count))
    assert discs.outside.all()
    change = about.bound * np.exp(2j * np.pi * rng.random((300, count, ny, nu)))
    inner = np.linalg.inv(np.eye(nu) - about.inner @ change)
    P = about.value + about.left @ change @ inner @ about.right
    top = about.right - about.inner @ discs.under @ about.value
    still = np.linalg.solve(top, about.inner @ discs.under)  # with this controller Delta does nothing; others are about it
    C = still + 0.3 * largest(still)[:, None, None] * random(rng, count, nu, ny)
    S = np.linalg.inv(np.eye(ny) + P @ C)
    found = {
        "sensitivity_peak": largest(S),
        "complementary_peak": largest(np.eye(ny) - S),
        "control_peak": largest(C @ S),
        "process_peak": largest(S @ P),
        "bandwidth": 1.005 * largest(np.linalg.inv(P @ C)),
    }
    for name, sizes in found.items():
        worst = sizes.max(axis=0)
        for part in (1.1, 1.5, 3.0, 10.0):
            limit = 2.0 if name == "bandwidth" else float(part * np.median(worst))
            if name == "complementary_peak" and limit <= 1:
                continue
            every = conditions_of(Limits(**{"sensitivity_peak": None, name: limit}), discs)
            (condition,) = (one for one in every if one.place.size)
            kept = condition.excess(C) >= 0
            assert np.all(worst[kept] <= (1.0 if name == "bandwidth" else limit) * (1 + 1e-9)), name
        assert kept.sum() > 3, name
