"""Weights above a bound: known orders, and the proof on the whole circle."""

import dataclasses
import itertools

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robustid.guarantees import magnitude_weight
from robustid.guarantees.cascade import arcs, cascade, factors, highest_ratio, lowest_ratio
from support.weights import check_densely, largest_on, pair


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def biquad(zeros, poles):
    return lambda theta: np.abs(np.polyval(np.poly(zeros), z := np.exp(1j * theta)) / np.polyval(np.poly(poles), z))


def jump(bound):
    return np.exp(np.abs(np.diff(np.log(bound))).max())


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
