"""Weights above a bound: known orders, the proof on the whole circle, and what they say about every plant of a set."""

import dataclasses
import itertools
import warnings

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import robustid as rid
from robustid.certify import (
    MarginStatus,
    entry_weights,
    guaranteed_margin,
    magnitude_weight,
    uncertainty_weight,
)
from robustid.certify.cascade import arcs, cascade, factors, highest_ratio, lowest_ratio
from robustid.certify.enclosure import enclose


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def biquad(zeros, poles):
    return lambda theta: np.abs(np.polyval(np.poly(zeros), z := np.exp(1j * theta)) / np.polyval(np.poly(poles), z))


def pair(angle, damping):
    pole = np.exp((-damping + 1j * np.sqrt(1 - damping**2)) * angle)
    return [pole, pole.conj()]


def largest_on(function, edges, count=400):
    return np.array([function(np.linspace(a, b, count)).max() for a, b in itertools.pairwise(edges)])


def jump(bound):
    return np.exp(np.abs(np.diff(np.log(bound))).max())


def modulus(weight, omega):
    return np.abs(values_of(weight.model, omega)[:, 0, 0])


def check_densely(weight, count=100_000):
    """Against the bound of the cells, at the edges too; stable and minimum-phase."""
    W = weight.model
    inside = np.concatenate([W.poles(), np.linalg.eigvals(W.A - W.B @ W.C / W.D)]) if W.nstates else np.zeros(1)
    assert np.abs(inside).max() < 1
    edges = weight.edges
    low = max(edges[0], edges[1] * 1e-3)
    half = count // 2
    omega = np.concatenate([np.linspace(edges[0], edges[-1], half), np.geomspace(low, edges[-1], half), edges])
    omega = np.clip(omega, edges[0], edges[-1])
    right = np.clip(np.searchsorted(edges, omega, side="right") - 1, 0, weight.bound.size - 1)
    left = np.clip(np.searchsorted(edges, omega, side="left") - 1, 0, weight.bound.size - 1)
    ratio = modulus(weight, omega) / weight.bound[[left, right]]
    assert ratio.min() >= 1 - 1e-9
    assert ratio.max() <= weight.ratio * (1 + 1e-9)
    assert weight.certified
    return ratio


# ---------------------------------------------------------------------------------------------------------------- the fit


@pytest.mark.parametrize(
    ("zeros", "poles"),
    [
        ([0.3], [0.95]),
        ([0.5, -0.2], [0.9, 0.7]),
        (pair(0.9, 0.05), pair(0.6, 0.05)),
        ([0.2, *pair(0.9, 0.1)], [-0.5, *pair(0.5, 0.05)]),
    ],
)
def test_the_order_of_a_rational_bound_is_found(zeros, poles):
    """Known answer: |W| of order r itself lies within the largest jump of its cell maxima, and no smaller order near it."""
    edges = np.linspace(0, np.pi, 401)
    bound = largest_on(biquad(zeros, poles), edges)
    weight = magnitude_weight(edges, bound, dt=1.0, tightness=1.01)
    assert weight.order == len(poles)
    assert weight.ratio <= 1.01 * jump(bound)
    assert all(ratio > 1.05 * jump(bound) for order, ratio in weight.tried if order < len(poles))
    check_densely(weight)


def test_one_state_is_as_tight_as_the_best_of_all_zeros_and_poles(rng):
    """Brute force over (zero, pole), each on a grid in log(1 +- root)."""
    edges = np.concatenate([[0.0], np.geomspace(0.05, np.pi, 12)])
    bound = np.exp(rng.normal(size=12) * 0.3 - np.linspace(0, 2, 12))
    weight = magnitude_weight(edges, bound, dt=1.0, order=1)
    theta = np.unique(np.concatenate([edges, np.linspace(0, np.pi, 300)]))
    right = np.clip(np.searchsorted(edges, theta, side="right") - 1, 0, 11)
    left = np.clip(np.searchsorted(edges, theta, side="left") - 1, 0, 11)
    low, high = np.maximum(bound[left], bound[right]), np.minimum(bound[left], bound[right])
    roots = np.tanh(np.linspace(-3, 3, 301))
    size = np.abs(np.exp(1j * theta) - roots[:, None])
    best = np.inf
    for zero in size:
        shape = zero / size
        best = min(best, float(((shape / high).max(axis=1) / (shape / low).min(axis=1)).min()))
    assert weight.ratio <= best * 1.001
    assert weight.ratio >= best * 0.98  # the grid's own coarseness


def test_a_constant_bound_takes_no_state_and_one_cell_is_enough():
    for edges in ([0.0, np.pi / 0.01], np.linspace(0, np.pi / 0.01, 7)):
        weight = magnitude_weight(edges, np.full(len(edges) - 1, 0.3), dt=0.01)
        assert weight.order == 0
        assert weight.ratio == pytest.approx(1, abs=1e-9)
        assert check_densely(weight).max() == pytest.approx(1, abs=1e-9)


def test_a_peak_of_one_percent_damping_takes_two_states():
    poles = pair(0.6, 0.01)

    def response(theta):
        z = np.exp(1j * theta)
        return np.abs(1 + 0.05 / ((z - poles[0]) * (z - poles[1])))

    edges = np.sort(np.concatenate([np.linspace(0, np.pi, 60), 0.6 + 0.02 * np.linspace(-3, 3, 61)]))
    bound = largest_on(response, edges)
    weight = magnitude_weight(edges, bound, dt=1.0)
    assert bound.max() / bound.min() > 10
    assert weight.order == 2
    assert weight.ratio < 1.5 * jump(bound)
    check_densely(weight)


def test_five_decades_of_frequency_and_six_of_size():
    edges = np.concatenate([[0.0], np.geomspace(1e-5 * np.pi, np.pi, 150)]) / 1e-3
    bound = largest_on(lambda omega: 1 / np.abs((1j * omega * 1e-3 + 1e-4) * (1j * omega * 1e-3 + 1e-1)), edges)
    weight = magnitude_weight(edges, bound, dt=1e-3)
    assert bound[0] / bound[-1] > 1e5
    assert weight.order == 2
    assert weight.ratio < 1.5 * jump(bound)
    check_densely(weight)


def test_four_modes_take_eight_states():
    modes = [pair(angle, 0.01) for angle in (0.3, 0.7, 1.1, 1.9)]
    edges = np.linspace(0, np.pi, 2001)

    def response(theta):
        z = np.exp(1j * theta)
        return np.abs(1 + sum(0.05 / ((z - p) * (z - q)) for p, q in modes))

    bound = largest_on(response, edges, 40)
    weight = magnitude_weight(edges, bound, dt=1.0, tightness=1.1)
    assert weight.order == 8
    assert weight.ratio < 1.1 * jump(bound)
    check_densely(weight)


def test_an_integrator_leaves_the_weight_free_below_the_first_edge():
    edges = np.geomspace(1e-3, np.pi, 80)
    bound = largest_on(lambda t: 1 / np.abs(np.exp(1j * t) - 1), edges)
    weight = magnitude_weight(edges, bound, dt=1.0)
    assert weight.order == 1
    assert weight.ratio < 1.2
    check_densely(weight)


@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 10**6), cells=st.integers(1, 25), spread=st.floats(0.05, 2.5), order=st.integers(0, 5))
def test_random_bounds_are_exceeded_everywhere_and_the_ratio_is_right(seed, cells, spread, order):
    rng = np.random.default_rng(seed)
    edges = np.concatenate([[0.0], np.sort(rng.uniform(1e-3, np.pi, cells - 1)), [np.pi]]) / 0.02
    bound = np.exp(np.cumsum(rng.normal(size=cells)) * spread)
    weight = magnitude_weight(edges, bound, dt=0.02, order=order)
    assert weight.order <= order
    ratio = check_densely(weight, 20_000)
    assert weight.ratio == pytest.approx(ratio.max() / ratio.min(), rel=0.01)
    ratios = [ratio for _, ratio in weight.tried]
    assert len(ratios) == order + 1
    assert weight.ratio == min(ratios) >= (jump(bound) if cells > 1 else 1)


@pytest.mark.parametrize("power", [-60, 60])
def test_units_of_signals_and_time_change_nothing(power):
    edges = np.linspace(0, np.pi, 41) / 0.01
    bound = largest_on(lambda w: biquad(pair(0.9, 0.1), pair(0.5, 0.05))(w * 0.01), edges)
    first = magnitude_weight(edges, bound, dt=0.01)
    second = magnitude_weight(edges * 2.0**power, bound * 2.0**-power, dt=0.01 * 2.0**-power)
    assert second.order == first.order
    assert second.tried == first.tried
    assert np.array_equal(second.model.A, first.model.A)
    assert np.array_equal(second.model.D * 2.0**power, first.model.D)


# -------------------------------------------------------------------------------------------------------------- the proof


def test_a_cascade_is_what_it_says_and_its_extremes_enclose_samples(rng):
    for trial in range(20):
        r = trial % 6
        zeros, poles = (np.array(pair(rng.uniform(0.1, 3), rng.uniform(0.01, 1)) * (r // 2)) for _ in range(2))
        zeros, poles = zeros[:r].astype(complex), poles[:r].astype(complex)
        if r % 2:
            zeros, poles = np.append(zeros, rng.uniform(-1, 1)), np.append(poles, rng.uniform(-1, 1))
        if r == 2:
            poles = np.array([0.9, -0.4], complex)
        parts = factors(cascade(zeros, poles, 0.7, 1.0))
        edges = np.sort(np.append(rng.uniform(0, np.pi, 5), [0, np.pi]))
        bound = rng.uniform(0.5, 2, 6)
        theta = np.concatenate([np.linspace(a, b, 4001) for a, b in itertools.pairwise(edges)])
        z = np.exp(1j * theta)[:, None]
        values = 0.7 * np.abs(np.prod(z - zeros, axis=1) / np.prod(z - poles, axis=1)) / np.repeat(bound, 4001)
        low, high = lowest_ratio(parts, *arcs(edges), bound), highest_ratio(parts, *arcs(edges), bound)
        assert low <= values.min() * (1 + 1e-10) <= low * 1.002
        assert high >= values.max() * (1 - 1e-10) >= high * 0.998


def tampered(weight, **entries):
    W = weight.model
    matrices = [np.array(entries.get(name, getattr(W, name))) for name in "ABCD"]
    return dataclasses.replace(weight, model=control.StateSpace(*matrices, W.dt))


def test_a_tampered_weight_or_bound_is_not_certified():
    edges = np.linspace(0, np.pi, 101)
    bound = largest_on(biquad([0.5, *pair(0.9, 0.1)], [0.9, *pair(0.6, 0.02)]), edges)
    weight = magnitude_weight(edges, bound, dt=1.0)
    W = weight.model
    assert weight.certified
    assert not tampered(weight, B=0.99 * W.B, D=0.99 * W.D).certified  # the cascade itself, one percent lower
    assert not tampered(weight, C=0.99 * W.C, D=0.99 * W.D).certified
    assert tampered(weight, B=1.01 * W.B, D=1.01 * W.D).certified
    assert not tampered(weight, A=1.2 * W.A).certified
    assert not dataclasses.replace(
        weight, bound=weight.bound * np.where(np.arange(100) == 37, weight.ratio * 1.01, 1)
    ).certified
    outside = cascade(np.array([2.0 + 0j]), np.array([0.5 + 0j]), 10.0, 1.0)  # large enough, but with its zero outside
    assert not dataclasses.replace(weight, model=outside, bound=np.full(100, 0.1)).certified


def test_the_proof_sees_a_notch_that_samples_miss():
    """Ten times as deep as wide, between two of 100 001 frequencies; and one that is lost in rounding, which proves nothing."""
    edges, angle = np.array([0.0, 1.0, np.pi]), 14540.5 * np.pi / 1e5
    for damping, least, most in ((1e-6, 0.09, 0.1), (1e-10, 0.0, 0.1)):
        notch, wide = (np.array(pair(angle, width)) for width in (damping, 10 * damping))
        assert biquad(notch, wide)(np.linspace(0, np.pi, 100_001)).min() > 0.9
        assert least <= lowest_ratio(factors(cascade(notch, wide, 1.0, 1.0)), *arcs(edges), np.ones(2)) < most * 1.001


# ------------------------------------------------------------------------------------------------------ kinds and channels


def random_model(rng, ny, nu, states=4, radius=0.9):
    A = rng.normal(size=(states, states))
    A *= radius / np.abs(np.linalg.eigvals(A)).max()
    return control.ss(A, rng.normal(size=(states, nu)), rng.normal(size=(ny, states)), rng.normal(size=(ny, nu)), 0.1)


def small_controller(rng, nominal):
    """Stabilises every stable nominal model: the largest gain of the open loop is a half."""
    controller = random_model(rng, nominal.ninputs, nominal.noutputs, states=2)
    omega = np.linspace(0, np.pi / 0.1, 2000)
    gains = [np.linalg.norm(values_of(model, omega), 2, axis=(1, 2)).max() for model in (nominal, controller)]
    return 0.5 / np.prod(gains) * controller


def values_of(model, omega):
    """(F, ny, nu), by solving with the state space: along no formula of the library."""
    z = np.exp(1j * omega * model.dt)
    if not model.nstates:
        return np.tile(model.D.astype(complex), (z.size, 1, 1))
    x = np.linalg.solve(z[:, None, None] * np.eye(model.nstates) - model.A, np.tile(model.B, (z.size, 1, 1)))
    return model.C @ x + model.D


def rescaled(model, left, right):
    return control.ss(model.A, model.B @ right, left @ model.C, left @ model.D @ right, model.dt)


def drawn_errors(rng, cells_edges, bound, count):
    """Error matrices on and inside the bound, at random frequencies: (omega, E)."""
    cell = rng.integers(0, bound.shape[0], count)
    omega = rng.uniform(cells_edges[cell], cells_edges[cell + 1])
    shape = (count, *bound.shape[1:])
    size = np.where(rng.random(shape) < 0.7, 1.0, rng.random(shape))
    return omega, bound[cell] * size * np.exp(2j * np.pi * rng.random(shape))


@pytest.mark.parametrize("channels", [1, 2])
@pytest.mark.parametrize("kind", ["additive", "multiplicative", "inverse"])
def test_every_drawn_plant_has_an_uncertainty_of_at_most_one(rng, kind, channels):
    nominal = random_model(rng, channels, channels)
    nominal.D += 8 * np.eye(channels)  # no zeros near the circle
    edges = np.linspace(0, np.pi, 31) / 0.1
    bound = rng.uniform(0.05, 0.2, (30, channels, channels))
    weight = uncertainty_weight(nominal, edges, bound, kind=kind)
    assert weight.kind == kind
    check_densely(weight, 20_000)
    omega, E = drawn_errors(rng, edges, bound, 3000)
    F_id = values_of(nominal, omega)
    F = F_id + E
    delta = {
        "additive": lambda: E,
        "multiplicative": lambda: E @ np.linalg.inv(F_id),
        "inverse": lambda: -E @ np.linalg.inv(F),  # F = (I + W delta)^-1 F_id
    }[kind]()
    sizes = np.linalg.norm(delta, 2, axis=(1, 2))
    assert np.all(sizes <= modulus(weight, omega))
    here = weight.bound[np.searchsorted(edges, omega, side="right") - 1]
    assert np.all(sizes <= here)
    assert (sizes / here).max() > 0.6  # and the bound is not idle


def test_one_channel_kinds_are_the_quotients():
    nominal = control.ss(0.5, 1.0, 1.0, 0.0, 0.1)
    edges = np.linspace(0, np.pi, 401) / 0.1
    smallest = largest_on(lambda w: -np.abs(1 / (np.exp(0.1j * w) - 0.5)), edges) * -1
    for kind, value in (("multiplicative", 0.1 / smallest), ("inverse", 0.1 / (smallest - 0.1))):
        weight = uncertainty_weight(nominal, edges, np.full(400, 0.1), kind=kind)
        assert np.all(weight.bound >= value * (1 - 1e-12))
        assert np.all(weight.bound <= value * 1.06)


def test_entries_have_weights_of_their_own(rng):
    nominal = random_model(rng, 2, 3)
    edges = np.linspace(0, np.pi, 21) / 0.1
    bound = rng.uniform(0.1, 0.2, (20, 2, 3)) * [[1, 10, 100], [1e-3, 1, 1e3]]
    weights = entry_weights(nominal, edges, bound, tightness=1.2)
    assert weights.shape == (2, 3)
    for i, j in np.ndindex(2, 3):
        check_densely(weights[i, j], 2000)
        assert np.array_equal(weights[i, j].bound, bound[:, i, j])
        omega = np.array([1.0, 7.0])
        assert values_of(weights[i, j].nominal, omega)[:, 0, 0] == pytest.approx(values_of(nominal, omega)[:, i, j])
    stacked = control.append(*[weight.model for weight in weights.ravel()])
    assert stacked.ninputs == stacked.noutputs == 6


def test_enclosed_values_hold_on_the_whole_piece(rng):
    model = random_model(rng, 2, 3, states=6, radius=0.99)
    angles = np.linspace(0, np.pi, 9)
    pieces = enclose(
        model, angles, lambda p: np.linalg.norm(p.radius, axis=(1, 2)) > 0.05 * np.linalg.norm(p.values, axis=(1, 2))
    )
    assert np.array_equal(np.unique(pieces.cell), np.arange(8))
    order = np.argsort(pieces.middle)
    middle = pieces.middle[order]
    for theta in rng.uniform(0, np.pi, 2000):
        # One of the two neighbouring pieces holds the point; both tell where they end by their order.
        k = np.searchsorted(middle, theta)
        F = values_of(model, np.array([theta / 0.1]))[0]
        near = [order[i] for i in (k - 1, k) if 0 <= i < middle.size]
        assert any(np.all(np.abs(F - pieces.values[i]) <= pieces.radius[i]) for i in near)


# ------------------------------------------------------------------------------------------------------ control and margin


def closed_loop_radius(plant, controller):
    """Largest pole of the loop with u = -K y, by python-control."""
    return np.abs(control.feedback(plant, controller).poles()).max()


def mode(damping=0.02, gain=1.0):
    return control.ss(control.tf([0.1 * gain, 0.1 * gain], np.real(np.poly(pair(0.6, damping))), 0.1))


def drawn_plant(nominal, limit, edges, bound, rng):
    """F_id + a stable E of two states, scaled so that its largest |E|/bound on the circle is `limit`."""
    poles = np.array(pair(rng.uniform(0.05, 3.0), 10 ** rng.uniform(-2.5, 0)))
    E = control.ss(control.tf(rng.normal(size=3), np.real(np.poly(poles)), 0.1))
    peak, width = np.abs(np.angle(poles[0])), 1 - np.abs(poles[0])
    omega = (
        np.concatenate([np.linspace(0, np.pi, 1500), np.clip(peak + width * np.linspace(-5, 5, 201), 0, np.pi)]) / 0.1
    )
    here = bound[np.clip(np.searchsorted(edges, omega, side="right") - 1, 0, bound.size - 1)]
    return nominal + E * (limit / (np.abs(values_of(E, omega)[:, 0, 0]) / here).max())


def test_guaranteed_means_that_every_drawn_plant_is_stabilised(rng):
    nominal, controller = mode(), control.ss(control.tf([0.2, -0.15], [1, -0.5], 0.1))
    edges = np.linspace(0, np.pi, 61) / 0.1
    bound = 0.04 + 0.1 * largest_on(lambda w: np.abs(values_of(nominal, w)[:, 0, 0]), edges, 50)
    result = uncertainty_weight(nominal, edges, bound).guaranteed_margin(controller)
    assert result.guaranteed
    assert result.margin > 1
    for scale in (1.0, result.margin * 0.999):
        for _ in range(150):
            assert closed_loop_radius(drawn_plant(nominal, scale, edges, bound, rng), controller) < 1
    # Against the condition on a dense grid.
    omega = np.linspace(0, np.pi / 0.1, 100_001)
    F, K = values_of(nominal, omega)[:, 0, 0], values_of(controller, omega)[:, 0, 0]
    here = bound[np.clip(np.searchsorted(edges, omega, side="right") - 1, 0, 59)]
    condition = here * np.abs(K / (1 + F * K))
    assert result.margin <= 1 / condition.max()
    assert result.margin >= 0.99 / condition.max()
    assert result.frequency == pytest.approx(omega[np.argmax(condition)], abs=0.2)


def all_pass_error(size, angle, direction):
    """A stable E with |E| = size everywhere whose phase at one angle is that of `direction`: (1 - a z)/(z - a) and a sign."""
    z, roots = np.exp(1j * angle), np.tanh(np.linspace(-12, 12, 200_001))
    phase = (1 - roots * z) / (z - roots)
    sign = np.where(np.real(phase * np.conj(direction)) > 0, 1, -1)
    best = np.argmin(np.abs(sign * phase - direction / abs(direction)))
    a, size = roots[best], size * sign[best]
    return control.ss(control.tf([-a * size, size], [1, -a], 0.1))


@pytest.mark.parametrize("gain", [0.05, 0.3])
def test_beyond_the_margin_a_plant_of_the_set_is_not_stabilised(gain):
    """Without a smaller set than all |E| <= bound, the margin is exact: the worst E turns E K S to -1 where |KS| is largest."""
    nominal, controller = mode(damping=0.1), control.ss([], [], [], gain, 0.1)
    assert closed_loop_radius(nominal, controller) < 1
    result = guaranteed_margin(nominal, controller, [0.0, np.pi / 0.1], [1.0])
    angle = 0.1 * result.frequency
    loop = gain / (1 + gain * values_of(nominal, np.array([result.frequency]))[0, 0, 0])
    for part, stable in ((0.99, True), (1.01, False)):
        plant = nominal + all_pass_error(part * result.margin, angle, -1 / loop)
        assert (closed_loop_radius(plant, controller) < 1) == stable
    small = guaranteed_margin(nominal, controller, [0.0, np.pi / 0.1], [1.01 * result.margin])
    assert small.status is MarginStatus.OPEN
    assert not small.guaranteed
    assert small.margin == pytest.approx(1 / 1.01, rel=1e-6)


def test_an_unstable_nominal_loop_has_no_margin():
    result = guaranteed_margin(mode(), control.ss([], [], [], 50.0, 0.1), [0.0, np.pi / 0.1], [1e-9])
    assert result.status is MarginStatus.UNSTABLE
    assert result.margin == 0
    assert not result.guaranteed


def test_an_integrator_with_a_relative_bound(rng):
    """F = (1 + E) F_id, both with an integrator, E = all-pass of size e: at the limit |T| e = 1."""
    nominal = control.ss(control.tf([0.1], [1, -1], 0.1))
    controller = control.ss(control.tf([3.0, -2.4], [1, -0.6], 0.1))
    edges = np.geomspace(0.02, np.pi, 31) / 0.1
    error = 0.2 * np.abs(values_of(nominal, edges[1:]))[:, 0, 0]
    with pytest.raises(rid.InputError, match=r"must start at 0; got 0\.2 rad/s.*below="):
        uncertainty_weight(nominal, edges, error).guaranteed_margin(controller)
    weight = uncertainty_weight(nominal, edges, error, kind="multiplicative", below=0.2)
    assert weight.edges[0] == 0
    assert np.all(weight.bound <= 0.21)
    result = weight.guaranteed_margin(controller)
    omega = np.linspace(1e-4, np.pi / 0.1, 50_001)
    L = (values_of(nominal, omega) * values_of(controller, omega))[:, 0, 0]
    assert 0.95 / np.abs(0.2 * L / (1 + L)).max() <= result.margin <= 1 / np.abs(0.2 * L / (1 + L)).max()
    for direction in np.exp(2j * np.pi * rng.random(30)):
        E = all_pass_error(0.2 * 0.99 * result.margin, rng.uniform(0, np.pi), direction)
        plant = nominal + nominal * E
        # The product has the integrator once more, uncontrolled or not: look at the loop's own equation.
        num, den = control.ss2tf(nominal), control.ss2tf(E)
        characteristic = np.polyadd(
            np.polymul(np.polymul(num.den[0][0], den.den[0][0]), [1, -0.6]),
            np.polymul(np.polymul(num.num[0][0], np.polyadd(den.den[0][0], den.num[0][0])), [3.0, -2.4]),
        )
        assert np.abs(np.roots(characteristic)).max() < 1
        assert plant.ninputs == 1


@pytest.mark.parametrize("kind", ["additive", "multiplicative", "inverse"])
def test_the_margin_of_each_kind_against_a_dense_grid_with_two_channels(rng, kind):
    nominal = random_model(rng, 2, 2)
    controller = small_controller(rng, nominal)
    edges = np.linspace(0, np.pi, 21) / 0.1
    bound = rng.uniform(0.2, 1.0, 20)
    omega = np.linspace(0, np.pi / 0.1, 40_001)
    F, K = values_of(nominal, omega), values_of(controller, omega)
    S = np.linalg.inv(np.eye(2) + F @ K)
    loop = {"additive": K @ S, "multiplicative": F @ K @ S, "inverse": S}[kind]
    here = bound[np.clip(np.searchsorted(edges, omega, side="right") - 1, 0, 19)]
    expected = 1 / (here * np.linalg.norm(loop, 2, axis=(1, 2))).max()
    result = guaranteed_margin(nominal, controller, edges, bound, kind=kind)
    assert 0.997 * expected <= result.margin <= expected * (1 + 1e-9)


def test_bounds_per_entry_do_not_depend_on_units(rng):
    nominal = random_model(rng, 2, 3)
    controller = small_controller(rng, nominal)
    edges, bound = np.linspace(0, np.pi, 11) / 0.1, rng.uniform(0.2, 1.0, (10, 2, 3))
    result = guaranteed_margin(nominal, controller, edges, bound)
    omega = np.linspace(0, np.pi / 0.1, 20_001)
    F, K = values_of(nominal, omega), values_of(controller, omega)
    here = bound[np.clip(np.searchsorted(edges, omega, side="right") - 1, 0, 9)]
    condition = np.abs(np.linalg.eigvals(here @ np.abs(K @ np.linalg.inv(np.eye(2) + F @ K)))).max()
    assert 0.997 / condition <= result.margin <= (1 + 1e-9) / condition
    left, right = np.diag([1e3, 1e-2]), np.diag([1.0, 1e4, 1e-4])
    scaled = guaranteed_margin(
        rescaled(nominal, left, right),
        rescaled(controller, np.linalg.inv(right), np.linalg.inv(left)),
        edges,
        left @ bound @ right,
    )
    assert scaled.margin == pytest.approx(result.margin, rel=3e-3)


def test_channels_that_do_not_meet_have_the_smaller_of_their_margins():
    """Two decoupled loops, whose entries are exactly zero where they would meet."""
    first, second = control.ss(0.5, 1.0, 1.0, 0.0, 0.1), mode(damping=0.2)
    edges, bound = np.linspace(0, np.pi, 11) / 0.1, np.linspace(0.3, 0.1, 10)
    alone = [guaranteed_margin(model, control.ss([], [], [], 0.1, 0.1), edges, bound) for model in (first, second)]
    both = guaranteed_margin(
        control.append(first, second),
        control.ss([], [], [], 0.1 * np.eye(2), 0.1),
        edges,
        bound[:, None, None] * (np.eye(2) + 1e-12),
    )
    assert both.margin == pytest.approx(min(result.margin for result in alone), rel=2e-3)


def test_the_pair_for_synthesis_has_the_same_values_and_the_controller_comes_back():
    nominal = mode()
    edges = np.linspace(0, np.pi, 61) / 0.1
    bound = 0.04 + 0.1 * largest_on(lambda w: np.abs(values_of(nominal, w)[:, 0, 0]), edges, 50)
    weight = uncertainty_weight(nominal, edges, bound)
    pair_ = weight.to_control()
    omega = np.linspace(0.1, 30, 50)
    s = 20j * np.tan(0.05 * omega)
    for continuous, discrete in ((pair_.nominal, nominal), (pair_.weight, weight.model)):
        assert continuous.dt == 0
        assert np.asarray(continuous(s)).ravel() == pytest.approx(values_of(discrete, omega)[:, 0, 0], rel=1e-9)
    assert pair_.weight.poles().real.max() < 0
    assert pair_.weight.zeros().real.max() < 0
    controller = control.ss(control.tf([1.0, 2.0], [1.0, 30.0]))
    back = pair_.controller(controller)
    assert values_of(back, omega)[:, 0, 0] == pytest.approx(np.asarray(controller(s)).ravel(), rel=1e-9)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)  # of control's own use of connect
        generalised = control.augw(
            pair_.nominal, w1=control.ss([], [], [], 0.1), w2=pair_.weight
        )  # what mixsyn synthesises for
    assert (generalised.ninputs, generalised.noutputs) == (2, 3)


def test_the_model_of_an_identification():
    """From data to a margin: a nominal model of tens of states, one mode of 0.4 % damping."""
    data = rid.flexible_structure(seed=0)
    prior = rid.Prior(gain_bound=0.2, decay_rate=1.1)
    basis = rid.kautz(2 * np.pi * np.array([9.0, 17.67]), [0.1, 0.004], dt=0.01)
    problem = rid.MixedProblem(frequency=data.frequency, time=data.time, prior=prior, parametric=basis)
    nominal = rid.identify(problem).model
    edges = np.linspace(0, np.pi, 101) / nominal.dt
    weight = uncertainty_weight(nominal, edges, np.linspace(0.05, 0.2, 100))
    controller = control.ss([], [], [], -0.02, nominal.dt)
    result = weight.guaranteed_margin(controller)
    omega = np.sort(np.append(np.linspace(0, edges[-1], 50_001), 2 * np.pi * (17.67 + np.linspace(-1, 1, 2001))))
    condition = weight.bound[np.clip(np.searchsorted(edges, omega, side="right") - 1, 0, 99)] * np.abs(
        0.02 / (1 - 0.02 * np.asarray(nominal(np.exp(1j * omega * nominal.dt))))
    )
    assert weight.certified
    assert 0.998 / condition.max() <= result.margin <= 1 / condition.max()
    assert result.guaranteed


# ----------------------------------------------------------------------------------------------------------------- misuse


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda e, b: magnitude_weight(e, b, dt=0.0), "`dt` must be positive"),
        (lambda e, b: magnitude_weight(e, b, dt=0.2), r"`edges` must end at pi/dt = 15\.7"),
        (lambda e, b: magnitude_weight(e[::-1], b, dt=0.1), "`edges` must rise"),
        (lambda e, b: magnitude_weight(e, b[:-1], dt=0.1), r"`bound` must have shape \(10,\).*got \(9,\)"),
        (
            lambda e, b: magnitude_weight(e, b * (np.arange(10) != 3), dt=0.1),
            "`bound` must be positive; got 0 from 9.42",
        ),
        (lambda e, b: magnitude_weight(e, b * np.nan, dt=0.1), "`bound` must be finite"),
        (lambda e, b: magnitude_weight(e, b, dt=0.1, tightness=1.0), "`tightness` must be above 1"),
        (lambda e, b: magnitude_weight(e, b, dt=0.1, order=-1), "`order` must be at least 0"),
        (lambda e, b: magnitude_weight(e, b, dt=0.1).to_control(), "`nominal` is not known"),
        (lambda e, b: uncertainty_weight(mode(), e, b, kind="relative"), "`kind` must be one of"),
        (lambda e, b: uncertainty_weight(mode(), e, b, below=0.1), "`below` serves the relative kinds"),
        (lambda e, b: uncertainty_weight(mode(), e, b, kind="multiplicative"), r"unbounded. Use kind=\"additive\""),
        (lambda e, b: uncertainty_weight(mode(), e, 9 * b, kind="inverse"), r"at [0-9.]+ rad/s: \|nominal\| may be as"),
        (lambda e, b: uncertainty_weight(control.ss(-1, 1, 1, 0), e, b), "`nominal` must be discrete"),
        (lambda e, b: entry_weights(mode(), e, b), r"`bound` must have shape \(C, ny, nu\)"),
        (lambda e, b: guaranteed_margin(mode(), mode() * np.ones((2, 1)), e, b), "`controller` must have 1 inputs"),
        (
            lambda e, b: guaranteed_margin(mode(), control.ss(0.5, 1, 1, 0, 0.2), e, b),
            "`controller` must have the sample",
        ),
        (
            lambda e, b: guaranteed_margin(control.ss([], [], [], 1, 0.1), control.ss([], [], [], -1, 0.1), e, b),
            "well-posed",
        ),
    ],
)
def test_misuse_is_named(call, sentence):
    edges = np.linspace(0, np.pi, 11) / 0.1
    with pytest.raises(rid.InputError, match=sentence):
        call(edges, np.full(10, 0.1))


def test_results_survive_copies():
    import copy
    import pickle

    weight = uncertainty_weight(mode(), np.linspace(0, np.pi, 11) / 0.1, np.geomspace(0.1, 1, 10))
    for twin in (copy.deepcopy(weight), pickle.loads(pickle.dumps(weight))):
        assert twin.certified
        assert twin.tried == weight.tried
    assert repr(weight).startswith("<UncertaintyWeight: additive, order ")
