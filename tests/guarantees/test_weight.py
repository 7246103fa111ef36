"""Weights of every kind: what they say about every plant of a set, channel by channel; misuse."""

import copy
import pickle

import control
import numpy as np
import pytest

import robustid as rid
from robustid.guarantees import entry_weights, magnitude_weight, robust_stability_margin, uncertainty_weight
from support.pairwise import every_one
from support.weights import check_densely, largest_on, mode, modulus, random_model, values_of

pytestmark = pytest.mark.quick


# ------------------------------------------------------------------------------------------------------ kinds and channels


def drawn_errors(rng, cells_edges, bound, count):
    """Error matrices on and inside the bound, at random frequencies: (omega, E)."""
    cell = rng.integers(0, bound.shape[0], count)
    omega = rng.uniform(cells_edges[cell], cells_edges[cell + 1])
    shape = (count, *bound.shape[1:])
    size = np.where(rng.random(shape) < 0.7, 1.0, rng.random(shape))
    return omega, bound[cell] * size * np.exp(2j * np.pi * rng.random(shape))


@pytest.mark.parametrize(("kind", "channels"), every_one(["additive", "multiplicative", "inverse"], [1, 2]))
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


# ----------------------------------------------------------------------------------------------------------------- misuse


TALL, SLOWER = mode() * np.ones((2, 1)), control.ss(0.5, 1, 1, 0, 0.2)


def gain(size):
    return control.ss([], [], [], size, 0.1)


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda e, b: magnitude_weight(e, b, dt=0.0), "`dt` must be positive"),
        (lambda e, b: magnitude_weight(e, b, dt=0.2), r"`edges` must end at pi/dt = 15\.7"),
        (lambda e, b: magnitude_weight(e[::-1], b, dt=0.1), "`edges` must rise"),
        (lambda e, b: magnitude_weight(e, b[:-1], dt=0.1), r"`bound` must have shape \(10,\).*got \(9,\)"),
        (lambda e, b: magnitude_weight(e, b * (np.arange(10) != 3), dt=0.1), "must be positive; got 0 from 9.42"),
        (lambda e, b: magnitude_weight(e, b * np.nan, dt=0.1), "`bound` must be finite"),
        (lambda e, b: magnitude_weight(e, b, dt=0.1, tightness=1.0), "`tightness` must be above 1"),
        (lambda e, b: magnitude_weight(e, b, dt=0.1, order=-1), "`order` must be at least 0"),
        (lambda e, b: magnitude_weight(e, b, dt=0.1).to_control(), "`nominal` is not known"),
        (lambda e, b: uncertainty_weight(mode(), e, b, kind="relative"), "`kind` must be one of"),
        (lambda e, b: uncertainty_weight(mode(), e, b, below=0.1), "`below` serves the relative kinds"),
        (lambda e, b: uncertainty_weight(mode(), e, b, kind="multiplicative"), r"unbounded. Use kind=\"additive\""),
        (lambda e, b: uncertainty_weight(mode(), e, 9 * b, kind="inverse"), r"at [0-9.]+ rad/s: \|nominal\| may be as"),
        (lambda e, b: uncertainty_weight(control.ss(-1, 1, 1, 0), e, b), "continuous `nominal` must end at infinity"),
        (lambda e, b: entry_weights(mode(), e, b), r"`bound` must have shape \(C, ny, nu\)"),
        (lambda e, b: robust_stability_margin(mode(), TALL, e, b), "`controller` must have 1 input"),
        (lambda e, b: robust_stability_margin(mode(), SLOWER, e, b), "`controller` must have the sample"),
        (lambda e, b: robust_stability_margin(gain(1), gain(-1), e, b), "well-posed"),
    ],
)
def test_misuse_is_named(call, sentence):
    edges = np.linspace(0, np.pi, 11) / 0.1
    with pytest.raises(rid.InputError, match=sentence):
        call(edges, np.full(10, 0.1))


def test_results_survive_copies():
    weight = uncertainty_weight(mode(), np.linspace(0, np.pi, 11) / 0.1, np.geomspace(0.1, 1, 10))
    for twin in (copy.deepcopy(weight), pickle.loads(pickle.dumps(weight))):
        assert twin.certified
        assert twin.tried == weight.tried
    assert repr(weight).startswith("<UncertaintyWeight: additive, order ")
