"""Worst cases at frequencies: against plants of the discs one by one, and against the proof on the whole axis."""

import control
import numpy as np
import pytest

from robustid.controllers.plants import Plants
from robustid.controllers.proving import proof_of, shares_of
from robustid.controllers.worst_at import worst_at
from robustid.core import StateMatrices, points_of, response_at
from robustid.design import Limits
from support.design_cases import DT
from support.one_design import LIMITS, PI, small_band, small_design

TURN = np.exp(1j * np.linspace(0, 2 * np.pi, 361))


def members(plants, omega):
    """Values of plants on the borders of the discs, (F, 361): Möbius maps have their extremes there."""
    discs = plants.discs(omega)
    return discs.centre[:, :, 0] + discs.radius[:, None] * TURN


def test_the_largest_values_are_those_of_plants_in_the_discs():
    plants = Plants.of(small_band())
    found = worst_at(plants, PI, plants.grid())
    assert found.stable
    assert found.clear
    F, C = members(plants, found.omega), response_at(PI, points_of(found.omega, DT))[:, 0]
    S = 1 / (1 + F * C)
    maps = {
        "sensitivity": S,
        "complementary_sensitivity": 1 - S,
        "process_sensitivity": F * S,
        "control_sensitivity": C * S,
    }
    for name, values in maps.items():
        worst = np.abs(values).max(axis=1)
        assert np.all(worst <= found.largest[name] * (1 + 1e-9)), name
        assert np.allclose(worst, found.largest[name], rtol=1e-3), name
    least = np.abs(F * C).min(axis=1)
    assert np.all(least[found.omega <= found.bandwidth] >= 1 - 1e-3)
    assert least[np.searchsorted(found.omega, found.bandwidth) + 1] < 1 + 1e-3


def test_numbers_at_frequencies_are_those_of_the_proof_or_a_little_better():
    design, plants = small_design(), Plants.of(small_band())
    found = worst_at(plants, PI, plants.grid())
    proof = design.proofs[0]
    for name, peak in proof.peaks.items():
        assert 0.97 * peak.value <= found.largest[name].max() <= peak.value * (1 + 1e-9), name
    for mine, proved in zip(found.margins, proof.margins, strict=True):
        high, low = np.atleast_1d(mine)[-1], np.atleast_1d(proved)[-1]
        assert low * (1 - 1e-9) <= high <= 1.06 * low
    limits = design.goal.asked(LIMITS, design.level)
    shares = shares_of(limits, [found.taken(limits)], PI, DT)
    assert list(shares) == list(design.shares)
    for name, (share, _) in shares.items():
        assert 0.9 * design.shares[name][0] <= share <= design.shares[name][0] * (1 + 1e-9), name


def test_templates_of_every_map_are_those_of_the_members():
    """Shares of tracking, disturbance and action on the whole axis, not below those of plants in the discs, and hardly above."""
    plants = Plants.of(small_band())
    limits = Limits(tracking=[(0.5, 4.0, 0.5)], disturbance=[(2.0, 9.0, 1.0)], action=[(40.0, 200.0, 0.6)])
    found = worst_at(plants, PI, np.unique([*plants.grid(), *np.geomspace(0.3, 300.0, 500)]))
    at, proved = found.taken(limits).rows, proof_of([plants], PI.model(DT), limits).shares
    F, C = members(plants, found.omega), response_at(PI, points_of(found.omega, DT))[:, 0]
    S = 1 / (1 + F * C)
    for name, size, (low, high) in (
        ("tracking", 0.5 / np.abs(1 - S), (0.5, 4.0)),
        ("disturbance", np.abs(F * S), (2.0, 9.0)),
        ("action", np.abs(C * S) / 0.6, (40.0, 200.0)),
    ):
        worst = size[(found.omega >= low) & (found.omega <= high)].max()
        assert at[name][0] == pytest.approx(worst, rel=1e-3), name
        assert worst <= proved[name][0] <= 1.1 * worst, name


def test_margins_are_those_of_the_members_that_are_least_stable():
    """By brute force: the least gain and phase that bring a member to -1, on a fine grid."""
    plants = Plants.of(small_band())
    found = worst_at(plants, PI, plants.grid())
    omega = np.geomspace(0.1, 0.9999 * np.pi / DT, 1200)
    L = members(plants, omega) * response_at(PI, points_of(omega, DT))[:, 0]
    discs = plants.discs(omega)
    centre, radius = discs.centre[:, 0, 0], discs.radius
    C = response_at(PI, points_of(omega, DT))[:, 0, 0]
    away = np.linspace(1.9, 2.4, 251)  # none below: the proof says so
    hit = [np.any(np.abs(k * centre * C + 1) <= k * radius * np.abs(C)) for k in away]
    assert found.margins.gain[1] == pytest.approx(away[np.argmax(hit)], rel=5e-3)
    on = np.abs(np.abs(L) - 1) < 5e-3
    phase = np.abs(np.angle(-L[on])).min()
    assert found.margins.phase == pytest.approx(phase, rel=2e-2)


def test_a_loop_that_is_not_stable_or_holds_a_plant_at_minus_one_is_not_clear():
    plants = Plants.of(small_band())
    much = PI._replace(C=40 * PI.C, D=40 * PI.D)
    found = worst_at(plants, much, plants.grid())
    assert not found.clear
    proof = proof_of([plants], control.ss(*much, DT), Limits())
    assert not proof.kept
    gain = 0.98 * float(worst_at(plants, PI, plants.grid()).margins.gain[1])
    near = PI._replace(C=gain * PI.C, D=gain * PI.D)
    assert worst_at(plants, near, plants.grid()).clear
    more = 1.1 * gain
    beyond = worst_at(plants, PI._replace(C=more * PI.C, D=more * PI.D), plants.grid())
    assert not beyond.clear
    assert np.isinf(beyond.largest["sensitivity"]).any()


def test_a_controller_of_nothing_leaves_the_plant():
    plants = Plants.of(small_band())
    nothing = StateMatrices(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.zeros((1, 1)))
    found = worst_at(plants, nothing, plants.grid())
    assert np.allclose(found.largest["sensitivity"], 1)
    assert np.allclose(found.largest["complementary_sensitivity"], 0, atol=1e-11)
    discs = plants.discs(found.omega)
    assert np.allclose(found.largest["process_sensitivity"], np.abs(discs.centre[:, 0, 0]) + discs.radius)
    assert found.bandwidth == 0
