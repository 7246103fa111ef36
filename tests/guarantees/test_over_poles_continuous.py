"""Pole-uncertainty boxes in continuous time: expansions against drawn poles, relaxations against drawn plants, bands, misuse."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scipy.linalg

import robustid as rid
from robustid.guarantees import PoleCell
from robustid.identification.formulation import ExactFormulation
from support.cases import seeds


def draw(rng, width, modes=2):
    middle, damping = np.sort(rng.uniform(5, 40, modes)), rng.uniform(0.005, 0.1, modes)
    spread = width * damping * middle
    ends = np.stack([middle - spread, middle + spread], axis=1), damping[:, None] * np.array([1 - width, 1 + width])
    return PoleCell(*ends, rng.uniform(0.1, 2, modes), 0, 0.0)


def drawn_poles(cell, rng):
    """A pole of every mode inside the cell, often at a corner."""
    t = rng.choice([0.0, 1.0, rng.uniform()], size=(2, cell.amplitude.size))
    omega = cell.omega[:, 0] + t[0] * np.ptp(cell.omega, axis=1)
    damping = cell.damping[:, 0] + t[1] * np.ptp(cell.damping, axis=1)
    return (-damping + 1j * np.sqrt(1 - damping**2)) * omega


def expansion(cell, c, poles):
    """Coefficients of c exp(a t) in the functions of the cell: those of t^j/j! exp(a0 t) are c (a - a0)^j."""
    p, times = [], np.linspace(0, 0.4, 9)
    for number, (amplitude, a, a0) in enumerate(zip(c, poles, cell.middle, strict=True)):
        one = rid.kautz(cell.omega[number].mean(), cell.damping[number].mean(), dt=0, repeat=3)
        values = np.array([(one.C @ scipy.linalg.expm(one.A * t) @ one.B)[:, 0] for t in times])
        for j, ways in enumerate((1 + 0 * times, times, times**2 / 2)):
            plain = ways[:, None] * np.stack([np.exp(a0 * times).real, np.exp(a0 * times).imag], axis=1)
            sizes = np.abs(plain).max(axis=0) / np.abs(values[:, 2 * j : 2 * j + 2]).max(axis=0)
            factor = 2 * amplitude * (a - a0) ** j
            p.append(np.array([factor.real, -factor.imag]) * sizes)
    return np.concatenate(p)


def responses(basis, omega):
    """Values of functions of s on the axis, by one solution each."""
    eye = np.eye(basis.states)
    return np.array([(basis.C @ np.linalg.solve(1j * w * eye - basis.A, basis.B))[:, 0] for w in omega])


def modes_at(omega, c, poles):
    s = 1j * omega[:, None]
    return (c / (s - poles) + c.conj() / (s - poles.conj())).sum(axis=1)


@pytest.mark.parametrize("width", [1e-11, 0.01, 0.1, 0.3])
def test_the_radius_covers_the_box(width):
    rng, largest = np.random.default_rng(0), 0.0
    for _ in range(20):
        cell = draw(rng, width)
        for _ in range(50):
            ratio = np.abs(drawn_poles(cell, rng) - cell.middle) / cell.radius
            assert ratio.max() <= 1
            largest = max(largest, float(ratio.max()))
    assert largest >= (0.7 if width > 1e-3 else 0.05)  # there the allowance for rounding is a part of it


def test_a_mode_in_the_cell_is_a_repeated_pair_and_a_small_remainder():
    """Coefficients within the intervals leave no more than the remainder on the axis, of which nothing is left at infinity."""
    rng, tightest = np.random.default_rng(0), 0.0
    for _ in range(20):
        cell = draw(rng, 0.15)
        poles = drawn_poles(cell, rng)
        c = cell.amplitude * np.exp(2j * np.pi * rng.uniform(size=poles.size))
        ends, p = cell.intervals(), expansion(cell, c, poles)
        assert np.all((ends[:, 0] <= p * (1 + 1e-12)) & (p * (1 - 1e-12) <= ends[:, 1]))
        omega = np.concatenate([np.linspace(0, 100, 300), poles.imag])
        left = np.abs(modes_at(omega, c, poles) - responses(cell.basis(), omega) @ p)
        bound = cell.remainder(omega).sum(axis=1)
        assert np.all(left <= bound * (1 + 1e-9) + 1e-12)
        tightest = max(tightest, float((left / bound).max()))
    assert tightest >= 0.05
    assert np.all(cell.remainder(np.array([np.inf])) == 0)


def test_plants_with_poles_in_the_cell_solve_its_relaxed_problem():
    """Seventy drawn plants, measured with errors at the limit and against the expansion, on tilted lines."""
    rng, needed = np.random.default_rng(10), 0
    for _ in range(70):
        cell = draw(rng, 0.1 * rng.uniform())
        poles = drawn_poles(cell, rng)
        c = cell.amplitude * rng.choice([1.0, rng.uniform()]) * np.exp(2j * np.pi * rng.uniform(size=poles.size))
        gain, g = 0.3, rng.uniform(-1, 1)  # the rest is a constant: K g, of the coefficients g c
        omega = np.sort(np.concatenate([rng.uniform(2, 60, 12), poles.imag]))
        p, truth = expansion(cell, c, poles), modes_at(omega, c, poles)
        bound, tilt = rng.uniform(0.01, 0.1, omega.size), 0.8 * rng.uniform(size=omega.size) * np.exp(7j * omega)
        left = truth - responses(cell.basis(), omega) @ p
        left = left + tilt * left.conj()
        pushed = bound * np.exp(1j * np.angle(left))  # any direction where nothing is left
        error = (pushed - tilt * pushed.conj()) / (1 - np.abs(tilt) ** 2)
        frf = rid.FrequencyResponse(omega, truth + gain * g + error, bound=rid.Bound(bound, tilt=tilt))
        prior = rid.Prior(gain_bound=gain, decay=1.3)
        relaxed = cell.relaxed(rid.MixedProblem(frequency=frf, prior=prior))
        data = ExactFormulation(relaxed).data
        scaled = p * data.rows.column_scale
        assert data.rows.within(scaled)
        ratio = data.rows.ratio(g * data.sarason.pair.c[0], scaled)
        assert ratio.max() <= 1 + 1e-10
        old = frf.bound.ravel()[np.isin(frf.omega, relaxed.frequency[0].omega)]
        needed += np.max(ratio * relaxed.frequency[0].bound.ravel() / old) > 1 + 1e-6
    assert needed >= 60


@pytest.mark.parametrize("width", [0.0, 1e-11, 1e-3, 0.1, 0.3])
def test_cells_cover_their_poles_in_ball_arithmetic(width):
    pytest.importorskip("flint", reason="python-flint is not installed: robustid[exact]")
    from robustid.guarantees.exact_cells import relaxed_enough

    problem, omega = plant()[0], np.array([0.0, 5.0, 12.0, 300.0])
    rng = np.random.default_rng(1)
    for _ in range(5):
        cell = draw(rng, width)
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
    band = rid.worst_case_over_poles(result, *box, omega=grid, directions=directions, cells=cells)
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
    result, how = rid.identify(problem), {"omega": [1.1, 5.0], "directions": 12, "rtol": 0.01}
    narrow = (ends.mean(axis=1, keepdims=True) * [1 - 1e-7, 1 + 1e-7] for ends in box)
    band = rid.worst_case_over_poles(result, *narrow, cells=1, **how)
    np.testing.assert_allclose(band.upper, rid.worst_case_error(result, **how).upper, rtol=0.03)


def test_the_bound_on_the_axis_holds_models_with_poles_anywhere_in_the_box():
    problem, _ = plant(2, points=8)
    box = OMEGA[:, None] * [0.999, 1.001], DAMPING[:, None] * [0.97, 1.03]
    result = rid.identify(problem)
    band = rid.worst_case_over_poles(result, *box, omega=[1.0, 5.0, 9.0], directions=4, cells=1)
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
    cell = draw(np.random.default_rng(4), 0.1, modes=1)
    turn = cell.middle.imag
    ends = np.array([0.0, 3.0, 0.99 * turn[0], 1.01 * turn[0], 1.2 * turn[0], 200.0, np.inf])
    on_cells = cell.slack_on(ends[:-1], ends[1:])[:, 0, 0]
    for low, high, largest in zip(ends[:-1], ends[1:], on_cells, strict=True):
        brute = cell.slack(np.linspace(low, min(high, 1e4), 4001)).max()
        assert (
            brute <= largest <= 1.2 * brute
        )  # a pole, its conjugate and the other mode are nearest at different frequencies


def test_a_matrix_with_common_poles():
    problem, box = plant(3, points=8, size=2)
    result, grid = rid.identify(problem).require(), np.array([5.0])
    band = rid.worst_case_over_poles(result, *box, omega=grid, directions=4, cells=1)
    assert band.certified
    models = list(others(problem, box, np.random.default_rng(3), 3))
    assert models
    for model in models:
        away = np.abs(np.moveaxis(model(1j * grid) - result.model(1j * grid), -1, 0))
        assert np.all(away <= band.upper)


def test_what_has_no_box_is_refused():
    problem, box = plant(points=10)
    real = dataclasses.replace(problem, parametric=rid.kautz([5.0, 8.0, 30.0], [0.02, 0.05, 1.0], dt=0))
    with pytest.raises(rid.InputError, match=r"must have one single `kautz` pair per mode in its parametric part$"):
        rid.worst_case_over_poles(rid.identify(real), *box)
    passive = dataclasses.replace(
        problem, prior=rid.PositiveReal(decay=4.0), parametric=rid.passive_modes(OMEGA, DAMPING)
    )
    with pytest.raises(rid.InputError, match="that class holds them wherever they lie"):
        rid.worst_case_over_poles(rid.identify(passive), *box)
    with pytest.raises(rid.InputError, match=r"`damping_interval` must lie below 1$"):
        rid.worst_case_over_poles(rid.identify(problem), box[0], box[1] * 20)
    with pytest.raises(rid.InputError, match="must hold the poles"):
        rid.worst_case_over_poles(rid.identify(problem), box[0] * 1.1, box[1])
