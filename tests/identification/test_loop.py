"""A plant in a loop: the stable system R that is seen in open loop, and back; every identity against plain matrices."""

import dataclasses

import control
import numpy as np
import pytest

import robustid as rid
from robustid.core import StateMatrices, closed_loop, decay_of, response_at, simulate
from support.loops import pair_of, points
from support.pairwise import every_one, every_two
from support.refusals import refused

TIMES = (0.1, 0.0)
CASES = every_two(TIMES, [False, True], range(8))  # sample times, integrators, seeds


def apart(found, expected):
    return np.abs(found - expected).max() / max(1.0, np.abs(expected).max())


def case(dt, integrators, seed):
    """A loop about an auxiliary plant, and another plant that the controller stabilises too; both unstable as a rule."""
    auxiliary, controller = pair_of(seed, dt, integrators=integrators)
    rng = np.random.default_rng([seed, 1])
    for size in 0.03 * 0.5 ** np.arange(12):
        A, B, C, D = (part + size * rng.standard_normal(part.shape) for part in auxiliary)
        plant = StateMatrices(A, B, C, D)
        if decay_of(np.linalg.eigvals(closed_loop(plant, controller).A), dt) > 0:
            return rid.Loop(control.ss(*controller, dt), control.ss(*auxiliary, dt)), plant, controller
    raise AssertionError("no plant beside this one is stabilised")


@pytest.mark.parametrize(("dt", "integrators", "seed"), CASES)
def test_identities_of_the_loop(dt, integrators, seed):
    loop, plant, controller = case(dt, integrators, seed)
    at, (nu, ny) = points(dt), loop.shape
    residual = loop.residual_of(control.ss(*plant, dt))
    assert decay_of(residual.poles(), dt) > 0
    M, p, c, R = (response_at(StateMatrices.of(one), at) for one in (loop.factors, plant, controller, residual))
    back = np.linalg.inv(M)
    Dx, Nx, Nc, Dc = M[:, :nu, :nu], M[:, nu:, :nu], -M[:, :nu, nu:], M[:, nu:, nu:]
    lDc, lNc, lNx, lDx = back[:, :nu, :nu], back[:, :nu, nu:], -back[:, nu:, :nu], back[:, nu:, nu:]
    one, other = np.eye(nu), np.eye(ny)
    Tu, S = np.linalg.inv(one + c @ p), np.linalg.inv(other + p @ c)
    assert apart(R, (lDx @ p @ Tu - lNx @ Tu) @ np.linalg.inv(lDc)) < 1e-10
    assert apart((Nx + Dc @ R) @ np.linalg.inv(Dx - Nc @ R), p) < 1e-10
    assert apart((Nx + Dc @ R) @ lDc, p @ Tu) < 1e-10
    assert apart(Dc @ (lDx - R @ lNc), S) < 1e-10
    assert apart(Nc @ (lDx - R @ lNc), c @ S) < 1e-10
    again = response_at(StateMatrices.of(loop.plant_of(residual)), at)
    assert apart(again, p) < 1e-10
    gain = 0.1 * np.random.default_rng(seed).standard_normal((nu, ny))
    third = StateMatrices(controller.A, controller.B, controller.C, controller.D + gain)
    Q = response_at(StateMatrices.of(loop.parameter_of(control.ss(*third, dt))), at)
    cq = response_at(third, at)
    assert apart(np.linalg.solve(Dx + cq @ Nx, cq @ Dc - Nc), Q) < 1e-10
    det = np.linalg.det
    whole = det(lDx - R @ lNc) * det(other + p @ cq) * det(Dc - Nx @ Q)
    assert np.all(np.abs(whole - det(other + R @ Q)) < 1e-10 * np.maximum(1.0, np.abs(whole)))


@pytest.mark.parametrize(("dt", "seed"), every_one(TIMES, range(8)))
def test_another_controller_stabilises_the_plant_if_its_parameter_stabilises_the_residual(dt, seed):
    loop, plant, controller = case(dt, False, seed)
    residual, found = StateMatrices.of(loop.residual_of(control.ss(*plant, dt))), set()
    for scale in (1.0, 0.9, 0.5, 0.1, -1.0, 1.3, 3.0):
        third = StateMatrices(controller.A, controller.B, scale * controller.C, scale * controller.D)
        Q = StateMatrices.of(loop.parameter_of(control.ss(*third, dt)))
        stable = [decay_of(np.linalg.eigvals(closed_loop(*pair).A), dt) > 0 for pair in ((plant, third), (residual, Q))]
        assert stable[0] == stable[1], scale
        found.add(stable[0])
    assert found == {True, False}


def records_of(seed, *, periodic=False, noise=0.0, size=(1, 1), samples=400):
    """u and y of a loop that r drives, u = r - C y, with noise at the output."""
    auxiliary, controller = pair_of(seed, 0.1, size=size)
    rng = np.random.default_rng(seed)
    r = rng.standard_normal((samples, size[1]))
    r = np.tile(r, (12, 1)) if periodic else r
    v = noise * rng.standard_normal((len(r), size[0]))
    found = simulate(closed_loop(auxiliary, controller), np.hstack([r, v]))[0]
    kept = slice(-2 * samples, None) if periodic else slice(None)
    u, y = found[kept, : size[1]], found[kept, size[1] :]
    record = rid.TimeRecord(u, y, dt=0.1, reference=r[kept], initial="periodic" if periodic else "rest")
    return auxiliary, controller, record, v[kept]


@pytest.mark.parametrize(("periodic", "size"), every_one([False, True], [((1, 1),), ((2, 1),), ((2, 3),)]))
def test_a_record_of_the_loop_is_one_of_the_residual_in_open_loop(periodic, size):
    """Its input does not depend on the noise; without noise its output is R of it."""
    plant, controller, record, _ = records_of(3, periodic=periodic, size=size)
    other = StateMatrices(plant.A, plant.B, 1.001 * plant.C, plant.D)
    loop = rid.Loop(control.ss(*controller, 0.1), control.ss(*other, 0.1))
    opened = loop.opened(record)
    residual = StateMatrices.of(loop.residual_of(control.ss(*plant, 0.1)))
    if periodic:
        answer = simulate(residual, np.tile(opened.u, (6, 1)))[0][-len(opened.u) :]
    else:
        answer = simulate(residual, opened.u)[0]
    assert np.abs(answer - opened.y).max() < 1e-8 * max(np.abs(opened.u).max(), np.abs(opened.y).max())
    assert np.abs(loop.residual(record)).max() < 1e-8 * max(np.abs(record.u).max(), np.abs(record.y).max())
    wrong = rid.Loop(control.ss(controller.A, controller.B, 1.01 * controller.C, controller.D, 0.1), loop.auxiliary)
    assert np.abs(wrong.residual(record)).max() > 1e-3
    _, _, noisy, _ = records_of(3, periodic=periodic, size=size, noise=0.1)
    if not periodic:  # the noise of a periodic record is not
        assert apart(loop.opened(noisy).u, opened.u) < 1e-8


def test_of_a_period_that_is_opened_by_itself_nothing_depends_on_the_others():
    _, controller, record, _ = records_of(3, periodic=True, noise=0.1, samples=100)
    loop = rid.Loop(control.ss(*controller, 0.1), control.ss(*pair_of(3, 0.1, size=(1, 1))[0], 0.1))
    changed = dataclasses.replace(record, y=np.concatenate([record.y[:100], 2 * record.y[100:]]))
    first, other = (loop.opened(one, period=100) for one in (record, changed))
    assert np.array_equal(first.y[:100], other.y[:100])
    assert apart(loop.opened(changed).y[:100], first.y[:100]) > 1e-3
    # Without noise all periods are alike, and it is the record that is opened as a whole.
    _, _, clean, _ = records_of(3, periodic=True, samples=100)
    assert apart(loop.opened(clean, period=100).y, loop.opened(clean).y) < 1e-8


@pytest.mark.parametrize("place", ["reference", "output"])
def test_the_excitation_stands_where_it_is_said_to(place):
    plant, controller, record, _ = records_of(5, size=(2, 1))
    w = np.random.default_rng(0).standard_normal((400, 2))
    sign = 1 if place == "reference" else -1
    found = simulate(
        closed_loop(plant, controller), np.hstack([sign * simulate(controller, w)[0], np.zeros((400, 2))])
    )[0]
    record = rid.TimeRecord(found[:, :1], found[:, 1:], dt=0.1, reference=w)
    left = {
        one: np.abs(
            rid.Loop(control.ss(*controller, 0.1), control.ss(*plant, 0.1), excitation=one).residual(record)
        ).max()
        for one in ("reference", "output")
    }
    assert left.pop(place) < 1e-8
    assert min(left.values()) > 1e-2


def test_a_stable_controller_needs_no_auxiliary_plant_and_the_residual_is_the_closed_loop():
    gain = control.ss([], [], [], [[0.5]], 0.1)
    loop = rid.Loop(gain)
    plant = control.ss(1.1, 1.0, 1.0, 0.0, 0.1)
    at = points(0.1)
    closed = response_at(StateMatrices.of(control.feedback(plant, gain)), at)
    assert apart(response_at(StateMatrices.of(loop.residual_of(plant)), at), closed) < 1e-12
    frf = rid.FrequencyResponse(np.angle(at) / 0.1, closed, bound=0.02, dt=0.1)
    opened = loop.opened_response(frf)
    np.testing.assert_allclose(opened.values, closed)
    np.testing.assert_allclose(opened.bound.outer_radius, 0.02)
    assert repr(loop) == "<Loop: 1x1 plant, u = r - C y, dt=0.1 s>"


@pytest.mark.parametrize("dt", TIMES)
def test_a_bound_of_the_closed_loop_is_one_of_the_residual(dt):
    loop, plant, controller = case(dt, False, 2)
    at, rng = points(dt, 30), np.random.default_rng(0)
    p, c = response_at(plant, at), response_at(controller, at)
    closed = p @ np.linalg.inv(np.eye(p.shape[2]) + c @ p)
    error = rng.standard_normal(closed.shape) + 1j * rng.standard_normal(closed.shape)
    error *= 0.01 / np.abs(error)
    omega = np.angle(at) / dt if dt else at.imag
    frf = rid.FrequencyResponse(omega, closed + error, bound=0.01, dt=dt or None)
    opened = loop.opened_response(frf)
    true = response_at(StateMatrices.of(loop.residual_of(control.ss(*plant, dt))), at)
    assert np.all(np.abs(opened.values - true) <= opened.bound.outer_radius * (1 + 1e-9))


@pytest.mark.parametrize("of", ["y", "u", "sensitivity"])
@pytest.mark.parametrize("dt", TIMES)
def test_the_residual_follows_from_each_response_of_the_closed_loop(dt, of):
    square = (case(dt, False, seed) for seed in range(20))
    loop, plant, controller = next(one for one in square if one[0].shape[0] == one[0].shape[1] > 1)
    at, rng = points(dt, 30), np.random.default_rng(1)
    p, c = response_at(plant, at), response_at(controller, at)
    one = np.eye(loop.shape[0])
    closed = {
        "y": p @ np.linalg.inv(one + c @ p),
        "u": np.linalg.inv(one + c @ p),
        "sensitivity": np.linalg.inv(one + p @ c),
    }[of]
    true = response_at(StateMatrices.of(loop.residual_of(control.ss(*plant, dt))), at)
    omega = np.angle(at) / dt if dt else at.imag
    exact = loop.opened_response(rid.FrequencyResponse(omega, closed, dt=dt or None), of=of)
    assert apart(exact.values, true) < 1e-9
    error = rng.standard_normal(closed.shape) + 1j * rng.standard_normal(closed.shape)
    noisy = rid.FrequencyResponse(omega, closed + 0.01 * error / np.abs(error), bound=0.01, dt=dt or None)
    opened = loop.opened_response(noisy, of=of)
    assert np.all(np.abs(opened.values - true) <= opened.bound.outer_radius * (1 + 1e-9))


def test_wrong_loops_are_refused_in_words():
    plant, integral = control.ss(0.5, 1.0, 1.0, 0.0, 0.1), control.ss(1.0, 1.0, 0.1, 0.1, 0.1)
    refused("`auxiliary` is missing: the controller has a pole", rid.Loop, integral)
    refused("Check the sign: the feedback is negative", rid.Loop, -integral, plant)
    refused("1 output and 1 input, as the controller says; got 2 x 1", rid.Loop, integral, plant.append(plant)[:, 0])
    refused("`auxiliary` must have the sample time", rid.Loop, integral, control.ss(0.5, 1.0, 1.0, 0.0, 0.2))
    refused("`excitation` must be one of", rid.Loop, integral, plant, excitation="left")
    loop = rid.Loop(integral, plant)
    refused("`record` must have the sample time", loop.opened, rid.TimeRecord(np.ones(9), np.ones(9), dt=0.2))
    refused("1 inputs and 1 outputs", loop.opened, rid.TimeRecord(np.ones((9, 2)), np.ones(9), dt=0.1))
    refused("`controller` must have 1 output ", loop.parameter_of, control.ss([], [], [], np.ones((2, 1)), 0.1))
    refused("must have a `reference` of 1 signals", loop.residual, rid.TimeRecord(np.ones(9), np.ones(9), dt=0.1))
    refused("`of` must be one of", loop.opened_response, rid.FrequencyResponse([1.0], [1.0], dt=0.1), of="T")
    wide = rid.Loop(control.ss([], [], [], [[0.1], [0.2]], 0.1))
    refused(
        "2 outputs and 2 inputs, from r to u", wide.opened_response, rid.FrequencyResponse([1.0], [1.0], dt=0.1), of="u"
    )
    refused("not in it", wide.opened_response, rid.FrequencyResponse([1.0], [1.0], dt=0.1), of="sensitivity")


def test_the_controller_that_ran_has_a_margin_without_end_and_soon():
    """Its parameter is 0 but for rounding: nothing of that is halved until it is known to a part in a thousand."""
    plant, controller = pair_of(0, 0.1, order=2, size=(1, 1))
    loop = rid.Loop(control.ss(*controller, 0.1), control.ss(*plant, 0.1))
    parameter = loop.parameter_of(control.ss(*controller, 0.1))
    nominal = control.ss(
        0.5 * np.eye(1), np.ones((1, loop.shape[0])), np.ones((loop.shape[1], 1)), np.zeros(loop.shape[::-1]), 0.1
    )
    found = rid.guarantee.robust_stability_margin(nominal, parameter, np.linspace(0, np.pi / 0.1, 30), np.ones(29))
    assert found.guaranteed
    assert found.margin > 900


@pytest.mark.slow
def test_a_fit_of_the_opened_record_is_not_biased_by_the_loop():
    """Output error of x and z, whatever colours the noise of z; of u and y it finds no unstable plant."""
    dt, plant = 0.001, control.ss(control.c2d(control.tf([2e4], [1, 10, -2.5e3]), 0.001))
    controller = control.ss(control.tf([5.61, -5.39], [1, -0.6], dt))
    apart = []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        r, noise = rng.standard_normal(2000), 0.1 * rng.standard_normal(2000)
        y = control.forced_response(control.feedback(plant, controller), inputs=r).outputs
        y = y + control.forced_response(control.feedback(1, plant * controller), inputs=noise).outputs
        u = r - control.forced_response(controller, inputs=y).outputs
        record = rid.TimeRecord(u, y, dt=dt, reference=r)
        loop = rid.Loop(controller)
        fit = rid.fit_records(loop.opened(record), order=3)
        apart.append(rid.guarantee.nu_gap(plant, loop.plant_of(fit.model)).value)
        naive = rid.fit_records(record, order=2)
        assert rid.guarantee.nu_gap(plant, naive.model).value > 0.9
    assert max(apart) < 0.1, apart
