"""Models on whole cells of the circle: enclosed values, magnitudes of cascades, and the proof of a weight."""

import dataclasses
import itertools

import control
import numpy as np
import pytest

from robustid.guarantees import magnitude_weight
from robustid.guarantees.cascade import arcs, cascade, factors, highest_ratio, lowest_ratio
from robustid.guarantees.cells import enclose
from support.weights import biquad, largest_on, pair, random_model, values_of

pytestmark = pytest.mark.quick


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
