"""Pole-uncertainty boxes in continuous time: bands against models with other poles in the box, and misuse."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from support.cases import seeds
from support.pole_cells import drawn_cell
from support.refusals import refused


@pytest.mark.parametrize("width", [0.0, 1e-11, 1e-3, 0.1, 0.3])
def test_cells_cover_their_poles_in_ball_arithmetic(width):
    pytest.importorskip("flint", reason="python-flint is not installed: robustid[exact]")
    from robustid.guarantees.exact_cells import relaxed_enough

    problem, omega = plant()[0], np.array([0.0, 5.0, 12.0, 300.0])
    rng = np.random.default_rng(1)
    for _ in range(6):
        cell = drawn_cell(rng, width, dt=0.0)
        assert relaxed_enough(cell, problem, omega)
        short = dataclasses.replace(cell)
        short.__dict__["radius"] = np.asarray(cell.radius) * (1 - 1e-8)
        assert width <= 1e-11 or not relaxed_enough(short, problem, omega)


OMEGA, DAMPING = np.array([5.0, 8.0]), np.array([0.02, 0.05])


def plant(seed=0, points=24, size=1):
    """Two modes with residues of rank one beside a pole at -9, noise near its bound, and a box of 0.3 % and 6 %."""
    rng, omega = np.random.default_rng(seed), np.linspace(0.5, 12, points)
    poles = (-DAMPING + 1j * np.sqrt(1 - DAMPING**2)) * OMEGA
    shapes = rng.uniform(0.5, 1.0, (2, 2, size))
    s, values = 1j * omega, np.zeros((points, size, size), complex)
    for pole, (left, right) in zip(poles, shapes, strict=True):
        values += (1 / (s - pole) + 1 / (s - pole.conj()))[:, None, None] * np.outer(left, right)
    values += (2.7 / (s + 9))[:, None, None] * rng.uniform(0.5, 1, (size, size))
    noise = 0.1 * np.exp(2j * np.pi * rng.random(values.shape))
    frf = rid.FrequencyResponse(omega, values + noise, bound=0.11)
    basis, prior = rid.kautz(OMEGA, DAMPING, dt=0), rid.Prior(gain_bound=0.5 * size, decay=4.0)
    box = OMEGA[:, None] * [0.997, 1.003], DAMPING[:, None] * [0.94, 1.06]
    return rid.MixedProblem(frequency=frf, prior=prior, parametric=basis), box


def others(problem, box, rng, count):
    """Central models of consistent problems with other poles in the box."""
    for _ in range(count):
        basis = rid.kautz(rng.uniform(*box[0].T), rng.uniform(*box[1].T), dt=0)
        found = rid.identify(dataclasses.replace(problem, parametric=basis), objective="margin", solver="structured")
        if found.consistent:
            yield found.model


@pytest.mark.parametrize("seed", seeds(1, 10))
def test_the_band_holds_models_with_poles_anywhere_in_the_box(seed, tmp_path):
    points, directions, cells, draws = (24, 6, 4, 20) if seed else (12, 4, 2, 5)
    problem, box = plant(seed, points)
    result, grid = rid.identify(problem).require(), np.array([0.0, 5.0, 8.1, 30.0])
    band = rid.guarantee.worst_case_over_poles(result, *box, omega=grid, directions=directions, cells=cells)
    assert band.certified
    assert np.all(band.upper >= rid.worst_case_error(result, omega=grid, directions=directions).lower)
    inside = 0
    for model in others(problem, box, np.random.default_rng(seed), draws):
        away = np.abs(model(1j * grid) - result.model(1j * grid))
        assert np.all(away <= band.upper[:, 0, 0])
        inside += 1
    assert inside >= 3
    assert band.upper[1, 0, 0] >= 1.2 * rid.worst_case_error(result, omega=[5.0]).upper[0, 0, 0]
    band.save(tmp_path / "band.json")
    assert rid.load(tmp_path / "band.json").verify()


def test_a_box_without_width_gives_the_band_of_its_poles():
    problem, box = plant(1, points=12)
    result, how = rid.identify(problem), {"omega": [5.0], "directions": 8, "rtol": 0.01}
    narrow = (ends.mean(axis=1, keepdims=True) * [1 - 1e-7, 1 + 1e-7] for ends in box)
    band = rid.guarantee.worst_case_over_poles(result, *narrow, cells=1, **how)
    np.testing.assert_allclose(band.upper, rid.worst_case_error(result, **how).upper, rtol=0.03)


@pytest.mark.parametrize("omega", [pytest.param(one, marks=pytest.mark.slow) for one in ([5.0], [1.0, 5.0, 9.0])])
def test_the_bound_on_the_axis_holds_models_with_poles_anywhere_in_the_box(omega):
    problem, _ = plant(2, points=8)
    box = OMEGA[:, None] * [0.999, 1.001], DAMPING[:, None] * [0.97, 1.03]
    result = rid.identify(problem)
    band = rid.guarantee.worst_case_over_poles(result, *box, omega=omega, directions=4, cells=1)
    circle = band.on_circle(1.0)
    assert circle.edges[0] == 0
    assert circle.edges[-1] == np.inf
    dense = np.concatenate([np.linspace(0, 15, 1500), np.geomspace(15, 1e5, 200)])
    bound = circle.bound[np.searchsorted(circle.edges, dense, side="right") - 1]
    models = list(others(problem, box, np.random.default_rng(2), 4))
    assert len(models) >= 3
    for model in models:
        assert np.all(np.abs(model(1j * dense) - result.model(1j * dense)) <= bound)


def test_what_the_expansion_leaves_out_between_frequencies_is_the_largest_inside():
    cell = drawn_cell(np.random.default_rng(4), 0.1, dt=0.0, modes=1)
    turn = cell.middle.imag
    ends = np.array([0.0, 3.0, 0.99 * turn[0], 1.01 * turn[0], 1.2 * turn[0], 200.0, np.inf])
    on_cells = cell.slack_on(ends[:-1], ends[1:])[:, 0, 0]
    for low, high, largest in zip(ends[:-1], ends[1:], on_cells, strict=True):
        brute = cell.slack(np.linspace(low, min(high, 1e4), 4001)).max()
        assert (
            brute <= largest <= 1.2 * brute
        )  # a pole, its conjugate and the other mode are nearest at different frequencies


@pytest.mark.slow
def test_a_matrix_with_common_poles():
    problem, box = plant(3, points=8, size=2)
    result, grid = rid.identify(problem).require(), np.array([5.0])
    band = rid.guarantee.worst_case_over_poles(result, *box, omega=grid, directions=4, cells=1)
    assert band.certified
    models = list(others(problem, box, np.random.default_rng(3), 3))
    assert models
    for model in models:
        away = np.abs(np.moveaxis(model(1j * grid) - result.model(1j * grid), -1, 0))
        assert np.all(away <= band.upper)


def test_what_has_no_box_is_refused():
    (problem, box), bounds = plant(points=10), rid.guarantee.worst_case_over_poles
    real = dataclasses.replace(problem, parametric=rid.kautz([5.0, 8.0, 30.0], [0.02, 0.05, 1.0], dt=0))
    sentence = r"must have one single `kautz` pair per mode in its parametric part$"
    refused(sentence, bounds, rid.identify(real), *box)
    modes = rid.passive.passive_modes(OMEGA, DAMPING)
    passive = dataclasses.replace(problem, prior=rid.PositiveReal(decay=4.0), parametric=modes)
    refused("that class holds them wherever they lie", bounds, rid.identify(passive), *box)
    result = rid.identify(problem)
    refused(r"`damping_interval` must lie below 1$", bounds, result, box[0], box[1] * 20)
    refused("must hold the poles", bounds, result, box[0] * 1.1, box[1])
