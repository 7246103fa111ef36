"""Magnitudes above a bound: known orders, and looseness against samples."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from robustid.guarantees import magnitude_weight
from support.cases import slow
from support.weights import biquad, check_densely, largest_on, pair


def jump(bound):
    return np.exp(np.abs(np.diff(np.log(bound))).max())


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


def resonant(*angles):
    """1 beside modes of 1 % damping, as a function of the angle."""
    modes = [pair(angle, 0.01) for angle in angles]

    def response(theta):
        z = np.exp(1j * theta)
        return np.abs(1 + sum(0.05 / ((z - p) * (z - q)) for p, q in modes))

    return response


def two_corners(omega):
    return 1 / np.abs((1j * omega * 1e-3 + 1e-4) * (1j * omega * 1e-3 + 1e-1))


def integrator(theta):
    return 1 / np.abs(np.exp(1j * theta) - 1)


NEAR_A_PEAK = np.sort(np.concatenate([np.linspace(0, np.pi, 60), 0.6 + 0.02 * np.linspace(-3, 3, 61)]))
FIVE_DECADES = np.concatenate([[0.0], np.geomspace(1e-5 * np.pi, np.pi, 150)]) / 1e-3
KNOWN = {
    "a peak of one percent damping": (resonant(0.6), NEAR_A_PEAK, {"dt": 1.0}, 2, 1.5, 10),
    "five decades of frequency and six of size": (two_corners, FIVE_DECADES, {"dt": 1e-3}, 2, 1.5, 1e5),
    "four modes": (resonant(0.3, 0.7, 1.1, 1.9), np.linspace(0, np.pi, 1001), {"dt": 1.0, "tightness": 1.1}, 8, 1.1, 1),
    "an integrator, free below the first edge": (integrator, np.geomspace(1e-3, np.pi, 80), {"dt": 1.0}, 1, 1.2, 1),
}


@pytest.mark.parametrize("name", [slow(name) if name == "four modes" else name for name in KNOWN])
def test_known_orders(name):
    """The weight is loose by little more than the bound jumps from cell to cell; the integrator's by 1.2 in all."""
    response, edges, options, order, loose, spread = KNOWN[name]
    bound = largest_on(response, edges)
    weight = magnitude_weight(edges, bound, **options)
    assert bound.max() / bound.min() > spread
    assert weight.order == order
    assert weight.ratio < loose * (1 if response is integrator else jump(bound))
    check_densely(weight)


@settings(max_examples=6, deadline=None)
@given(seed=st.integers(0, 10**6), cells=st.integers(1, 25), spread=st.floats(0.05, 2.5), order=st.integers(0, 5))
@example(seed=283, cells=25, spread=2.5, order=1)  # a root next to z = -1: |W|^2 was negative beyond it
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


@pytest.mark.parametrize("power", [-60, slow(60)])
def test_units_of_signals_and_time_change_nothing(power):
    edges = np.linspace(0, np.pi, 41) / 0.01
    bound = largest_on(lambda w: biquad(pair(0.9, 0.1), pair(0.5, 0.05))(w * 0.01), edges)
    first = magnitude_weight(edges, bound, dt=0.01)
    second = magnitude_weight(edges * 2.0**power, bound * 2.0**-power, dt=0.01 * 2.0**-power)
    assert second.order == first.order
    assert second.tried == first.tried
    assert np.array_equal(second.model.A, first.model.A)
    assert np.array_equal(second.model.D * 2.0**power, first.model.D)


@pytest.mark.parametrize("pivots", [slow(0), 1])
def test_programs_that_do_not_end_are_left_and_the_weight_is_above_the_bound(pivots, monkeypatch):
    """The simplex method may go round in a program for minutes: what was found before stands."""
    edges = np.linspace(0, np.pi, 101)
    bound = largest_on(biquad([0.5, -0.2], [0.9, 0.7]), edges)
    monkeypatch.setattr("robustid.guarantees.magnitude._PIVOTS", pivots)
    weight = magnitude_weight(edges, bound, dt=1.0)
    assert np.isfinite(weight.ratio)
    check_densely(weight)
