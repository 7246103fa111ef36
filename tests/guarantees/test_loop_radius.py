"""Largest nu-gap over a consistent set, against members of it and values on the edge of its discs."""

import types

import control
import numpy as np
import pytest

import robustid as rid
from robustid.core import StateMatrices, points_of, response_at
from robustid.guarantees.loop_radius import farthest_plant
from support.loop_bands import Around, edge_member, grid
from support.loops import pair_of
from support.pairwise import every_one
from support.unstable_loop import growing


def case_of(seed, dt, shape, part):
    """A loop, a model of its R, and the band of everything within `part` of the model's size about it, on a few cells."""
    plant, controller = pair_of(seed, dt, order=3, size=shape)
    other = StateMatrices(plant.A + 0.02, plant.B, plant.C, plant.D)
    loop = rid.Loop(controller.model(dt), plant.model(dt))
    model = loop.residual_of(other.model(dt))
    size = np.abs(response_at(StateMatrices.of(model), points_of(grid(dt), dt))).max()
    edges = np.linspace(0, np.pi / dt, 9) if dt else np.array([0.0, 1.0, 10.0, np.inf])
    entries = part * size * np.random.default_rng(seed).uniform(0.5, 1.0, (edges.size - 1, *shape))
    band = Around(model, edges, entries)
    band.problem = types.SimpleNamespace(dt=dt or None)
    return loop, band


@pytest.mark.parametrize("dt", [0.0, 0.1])
@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in range(1, 6))])
def test_of_one_input_and_output_it_is_the_largest_distance_on_the_discs(seed, dt):
    loop, band = case_of(seed, dt, (1, 1), 0.3)
    found = farthest_plant(band, loop, band.model)
    omega = np.concatenate(
        [
            np.linspace(low, min(high, 300.0), 1500)[:-1]
            for low, high in zip(band.edges[:-1], band.edges[1:], strict=True)
        ]
    )
    bound = np.repeat(band.entries[:, 0, 0], 1499)
    points = points_of(omega, dt)
    M = response_at(loop.factors, points)
    R = loop.response_of(band.model, omega)[:, 0, 0]
    P = response_at(StateMatrices.of(loop.plant_of(band.model)), points)[:, 0, 0]
    worst = 0.0
    for turn in np.exp(2j * np.pi * np.arange(120) / 120):
        u, y = M[:, :, 0].T + M[:, :, 1].T * (R + bound * turn)
        chord = np.abs(y - P * u) / np.sqrt((1 + np.abs(P) ** 2) * (np.abs(u) ** 2 + np.abs(y) ** 2))
        worst = max(worst, chord.max())
    assert worst <= found.value * (1 + 1e-9)
    assert worst > 0.98 * found.value


@pytest.mark.parametrize(("dt", "shape"), every_one([0.0, 0.1], [((1, 1),), ((2, 2),), ((2, 1),)]))
@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in range(1, 5))])
def test_no_member_is_farther(seed, dt, shape):
    loop, band = case_of(seed, dt, shape, 0.1)
    found, rng = farthest_plant(band, loop, band.model), np.random.default_rng(seed)
    plant = loop.plant_of(band.model)
    for _ in range(4):
        member = loop.plant_of(edge_member(rng, band, 1.0))
        assert rid.guarantee.nu_gap(plant, member).value <= found.value * (1 + 1e-6)


def test_an_open_band_says_nothing():
    loop, band = case_of(0, 0.1, (1, 1), 0.1)
    band.entries[3] = np.inf
    assert farthest_plant(band, loop, band.model).value == 1.0


def test_of_a_known_plant_nothing_is_away():
    loop, band = case_of(1, 0.1, (1, 1), 1e-9)
    assert farthest_plant(band, loop, band.model).value < 1e-6


def test_a_controller_with_a_larger_margin_stabilises_all():
    """Known plant 1/(z - 1.1) with R known to .02: the margin of the gain .5 is proved against all by one number."""
    plant, loop, R, band = growing()
    gap = rid.loop_bounds(band, loop).largest_nu_gap()
    assert 0.001 < gap.value < rid.guarantee.ncf_margin(plant, control.ss([], [], [], 0.5, 0.01)).value
    for sign in (1, -1):
        assert rid.guarantee.nu_gap(plant, loop.plant_of(R + sign * 0.01)).value <= gap.value
