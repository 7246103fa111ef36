"""Distances of plants in a loop against brute force, closed forms and the inequality that they are made for."""

import control
import numpy as np
import pytest

import robustid as rid
from robustid.core import Response, StateMatrices
from robustid.errors import InputError, InputTypeError
from support.loop_distances import angles_of_graphs, chordal, gap, largest, margin_gain
from support.loop_extremes import extreme, gap_by_svd
from support.loops import as_model, controller_of, plant_of, points
from support.refusals import refusals

TIMES = (0.1, 0.0)
tf = control.tf


def gap_of(first, second, dt):
    return rid.guarantee.nu_gap(as_model(first, dt), as_model(second, dt)).value


def values(model, at):
    return Response(StateMatrices.of(model)).at(at)


def moved(rng, plant, size):
    return StateMatrices(*(part + size * rng.standard_normal(part.shape) for part in plant))


def two_plants(seed, dt):
    """Plants of 1x1 to 3x3 with up to 7 states, stable or not: near each other, or not at all."""
    rng = np.random.default_rng([seed, 7])
    ny, nu = rng.integers(1, 4, 2)
    first = plant_of(rng, int(rng.integers(1, 8)), ny, nu, dt)
    if seed % 2:
        return first, plant_of(rng, int(rng.integers(1, 8)), ny, nu, dt)
    return first, moved(rng, first, 10 ** rng.uniform(-4, -0.3))


def with_axis_poles(plant, dt, rng):
    """An integrator at every input and an undamped pair beside, seen by the first output."""
    A, B, C, D = plant
    nu = B.shape[1]
    turn = 0.3 if dt else 2.0
    pair = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    pair = pair if dt else np.array([[0.0, turn], [-turn, 0.0]])
    states = np.zeros((len(A) + nu + 2,) * 2)
    states[: len(A), : len(A)], states[: len(A), len(A) : len(A) + nu] = A, B
    states[len(A) : -2, len(A) : -2] = np.eye(nu) if dt else 0.0
    states[-2:, -2:] = pair
    inputs = np.vstack([np.zeros((len(A), nu)), np.eye(nu), rng.standard_normal((2, nu))])
    return StateMatrices(states, inputs, np.hstack([C, D, rng.standard_normal((len(C), 2))]), 0 * D)


@pytest.mark.parametrize("seeds", [6, pytest.param(1500, marks=pytest.mark.slow)])
@pytest.mark.parametrize("dt", TIMES)
def test_gap_is_what_brute_force_finds(dt, seeds):
    wound = 0
    for seed in range(seeds):
        pair = two_plants(seed, dt)
        expected = gap(*pair, dt)
        wound += expected == 1.0
        assert angles_of_graphs(*pair, points(dt)) == pytest.approx(chordal(*pair, points(dt)), rel=1e-6, abs=1e-12)
        assert gap_of(*pair, dt) == pytest.approx(expected, rel=1e-8), seed
    assert 0.1 * seeds < wound < 0.6 * seeds  # both cases are met


@pytest.mark.parametrize("seed", [6, 11, 18, 30])
def test_gap_of_plants_of_a_large_gain(seed):
    """Beside 1e16 the identity in the formula is rounded away: a peak was missed, a sine off by 1e-7, a matrix singular."""
    first, second, dt = extreme(seed)
    assert gap_of(first, second, dt) == pytest.approx(gap_by_svd(first, second, dt), rel=1e-9)


def test_a_winding_number_that_rounding_hides_is_refused():
    first, second, dt = extreme(298)
    assert gap_by_svd(first, second, dt) < 0.01
    with pytest.raises(InputError, match="winds about the other"):  # it was answered with 1
        gap_of(first, second, dt)


@pytest.mark.parametrize("seeds", [2, pytest.param(300, marks=pytest.mark.slow)])
@pytest.mark.parametrize("dt", TIMES)
def test_gap_of_plants_with_poles_on_the_axis(dt, seeds):
    for seed in range(seeds):
        rng = np.random.default_rng([seed, 11])
        ny = int(rng.integers(1, 4))
        first = with_axis_poles(plant_of(rng, 2, ny, int(rng.integers(1, ny + 1)), dt), dt, rng)
        second = (
            moved(rng, first, 10 ** rng.uniform(-4, -1))
            if seed % 2
            else first._replace(B=first.B * rng.uniform(0.5, 2))
        )
        for pair in ((first, second), (second, first)):
            assert gap_of(*pair, dt) == pytest.approx(gap(*pair, dt, offset=1e-5), rel=1e-8), seed


@pytest.mark.parametrize("seeds", [3, pytest.param(500, marks=pytest.mark.slow)])
@pytest.mark.parametrize("dt", TIMES)
def test_gap_is_a_distance(dt, seeds):
    """Symmetric, zero for one plant in other coordinates, at most 1, the same of transposed plants; a triangle inequality."""
    for seed in range(seeds):
        first, second = two_plants(seed, dt)
        third = moved(np.random.default_rng(seed), first, 0.1)
        found = gap_of(first, second, dt)
        assert 0 < found <= 1
        assert gap_of(second, first, dt) == pytest.approx(found, rel=1e-8)
        assert gap_of(first.transposed(), second.transposed(), dt) == pytest.approx(found, rel=1e-8)
        assert found <= gap_of(first, third, dt) + gap_of(third, second, dt) + 1e-9
        basis = np.random.default_rng(seed).standard_normal(first.A.shape) + 3 * np.eye(len(first.A))
        turned = StateMatrices(
            np.linalg.solve(basis, first.A @ basis), np.linalg.solve(basis, first.B), first.C @ basis, first.D
        )
        assert gap_of(first, turned, dt) < 1e-9


@pytest.mark.parametrize("seeds", [6, pytest.param(1000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("dt", TIMES)
def test_a_loop_loses_no_more_than_the_gap(dt, seeds):
    """arcsin b(P2, C) >= arcsin b(P1, C) - arcsin gap: a controller whose margin exceeds the gap stabilises the other plant."""
    used = 0
    for seed in range(seeds):
        rng = np.random.default_rng([seed, 3])
        first = plant_of(rng, 3, *rng.integers(1, 3, 2), dt)
        second, controller = moved(rng, first, 10 ** rng.uniform(-3, -0.5)), as_model(controller_of(first, dt), dt)
        before, after = (rid.guarantee.ncf_margin(as_model(one, dt), controller).value for one in (first, second))
        apart = gap_of(first, second, dt)
        used += apart < before
        assert np.arcsin(after) >= np.arcsin(before) - np.arcsin(apart) - 1e-8
        assert after > 0 or apart >= before
    assert used > 0.3 * seeds


@pytest.mark.parametrize("seeds", [3, pytest.param(500, marks=pytest.mark.slow)])
@pytest.mark.parametrize("dt", TIMES)
def test_margin_is_what_brute_force_finds_and_the_same_with_both_exchanged(dt, seeds):
    for seed in range(seeds):
        rng = np.random.default_rng([seed, 5])
        plant = plant_of(rng, int(rng.integers(1, 6)), *rng.integers(1, 4, 2), dt)
        controller = controller_of(plant, dt)
        found = rid.guarantee.ncf_margin(as_model(plant, dt), as_model(controller, dt))
        marks = np.concatenate([np.linalg.eigvals(one.A) for one in (plant, controller)])
        gain = largest(lambda at, pair=(plant, controller): margin_gain(*pair, at), dt, np.abs(marks))
        assert found.value == pytest.approx(1 / gain, rel=1e-8), seed
        if np.isfinite(found.omega):
            there = np.exp(1j * found.omega * dt) if dt else 1j * found.omega
            assert 1 / margin_gain(plant, controller, np.array([there]))[0] == pytest.approx(found.value, rel=1e-8)
        exchanged = rid.guarantee.ncf_margin(as_model(controller, dt), as_model(plant, dt)).value
        assert exchanged == pytest.approx(found.value, rel=1e-8)


def test_closed_forms():
    for a, b in ((2.0, 3.0), (1e-8, 1e8), (5.0, -0.2), (0.0, 0.0), (0.0, 1e3), (-4.0, 4.0)):
        expected = abs(a - b) / np.sqrt((1 + a * a) * (1 + b * b))
        assert rid.guarantee.nu_gap(tf([a], [1]), tf([b], [1])).value == pytest.approx(expected, rel=1e-12)
        loop = 0.0 if 1 + a * b == 0 else abs(1 + a * b) / np.sqrt((1 + a * a) * (1 + b * b))
        assert rid.guarantee.ncf_margin(tf([a], [1]), tf([b], [1])).value == pytest.approx(loop, rel=1e-12)
    for eps in (1e-9, 1e-4, 0.3, 100.0, -1e-6, -0.5):  # eps/sqrt((1 + w^2)(1 + w^2 + eps^2))
        for pair in ((tf([1], [1, 0]), tf([1], [1, eps])), (tf([1], [1, eps]), tf([1], [1, 0]))):
            found = rid.guarantee.nu_gap(*pair)
            assert found.value == pytest.approx(abs(eps) / np.hypot(1, eps), rel=1e-6 if abs(eps) < 1e-8 else 1e-9)
    stable, unstable = tf([1], [1, 0.02]), tf([1], [1, -0.02])
    assert rid.guarantee.nu_gap(stable, unstable).value == pytest.approx(0.04 / 1.0004, rel=1e-12)
    assert rid.guarantee.ncf_margin(tf([1], [1, 0]), tf([1], [1])).value == pytest.approx(np.sqrt(0.5), rel=1e-12)
    assert rid.guarantee.ncf_margin(tf([1], [1, 0]), tf([-1], [1])) == (0.0, pytest.approx(np.nan, nan_ok=True))
    assert rid.guarantee.ncf_margin(tf([1], [1]), tf([-1], [1])) == (0.0, np.inf)  # no loop at all
    # 1 + P2* P1 turns around zero once although no frequency shows a distance of 1.
    winding = rid.guarantee.nu_gap(tf([10], [1]), tf([10, -10], [1, 1]))
    assert winding.value == 1
    assert np.isnan(winding.omega)
    opposite = rid.guarantee.nu_gap(tf([1], [1, 1]), tf([-1], [1, 1]))
    assert opposite.value == 1


def test_gap_is_continuous_where_the_winding_number_changes():
    """k and k (s - a)/(s + b): with a from positive to negative, det(I + P2* P1) passes zero; both sides tend to 1."""
    for size in 10.0 ** -np.arange(1, 17):
        for sign in (1, -1):
            # 1 + P2(0) P1(0) = sign size: the gap is 1 - O(size^2) on the one side and 1 on the other.
            first, second = tf([2.0], [1]), tf([2.0, -0.5 * (1 - sign * size)], [1, 1])
            found = rid.guarantee.nu_gap(first, second).value
            assert 1 - 0.3 * size**2 - 1e-9 <= found <= 1
            if size > 1e-5:
                assert (found == 1) == (sign < 0)


@pytest.mark.parametrize("dt", TIMES)
def test_scales_of_states_do_not_matter(dt):
    first, second = two_plants(4, dt)
    found = gap_of(first, second, dt)
    scale = 2.0 ** np.linspace(-40, 40, len(first.A)).round()
    other = StateMatrices(first.A / scale[:, None] * scale, first.B / scale[:, None], first.C * scale, first.D)
    assert gap_of(other, second, dt) == pytest.approx(found, rel=1e-12)


@pytest.mark.parametrize("normalised", [True, False])
@pytest.mark.parametrize("dt", TIMES)
def test_factors_are_stable_coprime_and_have_the_system_as_quotient(dt, normalised):
    for seed in range(12):
        rng = np.random.default_rng([seed, 13])
        ny = int(rng.integers(1, 4))
        plant = plant_of(rng, int(rng.integers(0, 5)) + 1, ny, int(rng.integers(1, ny + 1)), dt)
        plant = with_axis_poles(plant, dt, rng) if seed % 2 else plant
        found = rid.guarantee.coprime(as_model(plant, dt), normalised=normalised)
        at = points(dt)
        N, D, left_N, left_D = (values(part, at) for part in found)
        P = values(as_model(plant, dt), at)
        np.testing.assert_allclose(P @ D, N, atol=1e-9 * max(1, np.abs(N).max()))
        np.testing.assert_allclose(left_D @ P, left_N, atol=1e-9 * max(1, np.abs(left_N).max()))
        for part in found:
            poles = part.poles()
            assert np.all(np.abs(poles) < 1 if dt else poles.real < 0)
        if normalised:
            for one, other in (
                (D.conj().swapaxes(1, 2) @ D, N.conj().swapaxes(1, 2) @ N),
                (left_D @ left_D.conj().swapaxes(1, 2), left_N @ left_N.conj().swapaxes(1, 2)),
            ):
                np.testing.assert_allclose(one + other, np.broadcast_to(np.eye(one.shape[1]), one.shape), atol=1e-9)
        # Without common zeros: [D; N] has full rank at the unstable poles of the plant, where D is singular.
        poles = np.linalg.eigvals(plant.A)
        unstable = poles[np.abs(poles) > 1 + 1e-6] if dt else poles[poles.real > 1e-6]
        if unstable.size:
            both = np.concatenate([values(found.denominator, unstable), values(found.numerator, unstable)], axis=1)
            assert np.linalg.svd(both, compute_uv=False)[:, -1].min() > 1e-6


def test_unnormalised_factors_mirror_what_is_not_stable_and_move_nothing_else():
    found = rid.guarantee.coprime(tf([1], np.poly([1.0, -2.0])), normalised=False)
    np.testing.assert_allclose(np.sort(found.denominator.poles().real), [-2, -1], rtol=1e-12)
    found = rid.guarantee.coprime(tf([1], np.poly([2.0, 0.5]), 0.1), normalised=False)
    np.testing.assert_allclose(found.denominator.poles().real, [0.5, 0.5], rtol=1e-7)
    # A pole on the axis: to the decay of the slowest other pole, of the plant or of the normalised factors.
    found = rid.guarantee.coprime(tf([1], np.poly([0.0, -0.02])), normalised=False)
    np.testing.assert_allclose(np.sort(found.left_denominator.poles().real), [-0.02, -0.02], rtol=1e-6)
    found = rid.guarantee.coprime(tf([0.03], [1, 0]), normalised=False)
    np.testing.assert_allclose(found.denominator.poles().real, [-0.03], rtol=1e-9)


HIDDEN = control.ss([[1.0, 0], [0, -1]], [[0.0], [1]], [[1.0, 1]], 0)
UNSEEN = control.ss([[0.0, 0], [0, -1]], [[1.0], [1]], [[0.0, 1]], 0)
LAG, GAIN, ROW = tf([1], [1, 1]), tf([2], [1]), control.ss([], [], [], [[1.0, 2.0]])
WIDE = tf([[[1], [1]]], [[[1, 1], [1, 2]]])

test_bad_input_is_named = refusals(
    (lambda: rid.guarantee.nu_gap(3, LAG), "`first` must be a control.StateSpace", InputTypeError),
    (
        lambda: rid.guarantee.nu_gap(ROW, LAG),
        "`second` must have 1 outputs and 2 inputs, those of `first`; got 1 and 1",
    ),
    (
        lambda: rid.guarantee.nu_gap(LAG, tf([1], [1, 0.5], 0.1)),
        "`second` must have the time base of `first`, dt = 0; got dt = 0.1",
    ),
    (lambda: rid.guarantee.nu_gap(LAG, control.ss(-1, 1, 1, 0, None)), "`second` has dt = None"),
    (lambda: rid.guarantee.nu_gap(LAG, control.ss(-1, 1, np.nan, 0)), "`second` must be finite"),
    (lambda: rid.guarantee.nu_gap(HIDDEN, LAG), r"`first` .* hidden pole at 0 Hz \(real part \+1 1/s\)"),
    (lambda: rid.guarantee.nu_gap(LAG, UNSEEN), "`second` must be moved by its inputs and seen in its outputs"),
    (lambda: rid.guarantee.coprime(UNSEEN), "`model` must be moved by its inputs and seen in its outputs"),
    (lambda: rid.guarantee.coprime(tf([1, 0, 0], [1, 1])), "`model` must be proper"),
    (lambda: rid.guarantee.coprime(LAG, normalised="no"), "`normalised` must be True or False", InputTypeError),
    (lambda: rid.guarantee.coprime(tf([1e-9], [1, 0, 1e8])), "`model` must"),
    (
        lambda: rid.guarantee.ncf_margin(ROW, LAG),
        "`controller` must have 2 outputs and 1 inputs, those of `plant` reversed; got 1 and 1",
    ),
    (lambda: rid.guarantee.ncf_margin(LAG, tf([1], [1, 0.5], 0.1)), "`controller` must have the time base of `plant`"),
)


def test_a_matrix_of_transfer_functions_is_taken_as_the_system_that_it_is():
    both = control.ss(np.diag([-1.0, -2.0]), np.eye(2), [[1.0, 1.0]], [[0.0, 0.0]])
    assert rid.guarantee.nu_gap(WIDE, both).value < 1e-8


def test_hidden_states_that_are_stable_and_static_gains_of_any_time_base_are_taken():
    shown = control.ss([[-5.0, 0], [0, -1]], [[1.0], [1]], [[0.0, 1]], 0)
    assert rid.guarantee.nu_gap(LAG, shown).value < 1e-12
    assert (
        rid.guarantee.nu_gap(tf([1], [1, -0.5], 0.1), GAIN).value
        == rid.guarantee.nu_gap(GAIN, tf([1], [1, -0.5], 0.1)).value
        <= 1
    )
    assert rid.guarantee.ncf_margin(ROW, control.ss([], [], [], [[1.0], [2.0]])).value == pytest.approx(1)
    assert rid.guarantee.nu_gap(tf([1], [1, 0], True), tf([1], [1, 0.1], True)).value > 0
