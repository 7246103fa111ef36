"""The guarantee over a pole-uncertainty box: the band of the flexible structure, and misuse."""

import dataclasses

import control
import numpy as np
import pytest

import robustid as rid
from robustid.core import responses
from support.cases import slow
from support.posed import proposed
from support.refusals import refused
from support.structure import about_structure

DT = 0.01


def structure(seed, fine=True, **size):
    return rid.datasets.flexible_structure(seed=seed, extra_hz=np.linspace(17.2, 18.1, 10) if fine else (), **size)


def band(seed, fine=True, hz=(5.0, 17.67), cells=8, **size):
    """The program's own poles and prior; (data, band, what the truth is away from the model, size of the model)."""
    data = structure(seed, fine, **size)
    suggested = rid.suggest_kautz(data.frequency)
    result = rid.identify(proposed([data.frequency], [data.time])[0])
    found = rid.guarantee.worst_case_over_poles(
        result,
        suggested.omega_interval,
        suggested.damping_interval,
        delay=suggested.delay,
        omega=2 * np.pi * np.array(hz),
        cells=cells,
    )
    z = np.exp(1j * found.omega * DT)
    return data, found, np.abs(data.truth(z) - result.model(z)), np.abs(result.model(z))


def test_the_program_s_own_poles_and_prior_give_a_narrow_band():
    data, found, away, size = band(0, cells=4, lines=6, samples=4)
    upper = found.upper[:, 0, 0]
    assert np.all(away <= upper)
    assert np.all(upper <= 0.04 * size)
    assert "poles inside the box" in found.summary()
    z = np.exp(1j * found.omega * DT)
    assert np.all((found.magnitude[:, 0] <= np.abs(data.truth(z))) & (np.abs(data.truth(z)) <= found.magnitude[:, 1]))


@pytest.mark.slow
def test_bands_of_twenty_experiments(capsys):
    """Median relative half-width over 1-21 Hz at most 4 %, at the resonance at most 3 %, truth inside in all."""
    hz = (1, 3, 5, 7, 9, 11, 13, 15, 16, 17, 17.67, 18.5, 20, 21)
    medians, peaks = [], []
    for seed in range(20):
        _, found, away, size = band(seed, hz=hz)
        relative = found.upper[:, 0, 0] / size
        assert np.all(away <= found.upper[:, 0, 0]), seed
        medians.append(float(np.median(relative)))
        peaks.append(float(relative[10]))
    with capsys.disabled():
        print(
            f"\nmedian {100 * max(medians):.2g} % at most, resonance {100 * max(peaks):.2g} % at most, truth inside in 20"
        )
    assert max(medians) <= 0.04
    assert max(peaks) <= 0.03


@pytest.mark.slow
def test_eleven_lines_leave_the_damping_open(capsys):
    """True poles: at most 12 % at the peak. Poles from the data: wide, truth inside, and the line to measure is at the mode."""
    data = structure(0, fine=False)
    problem = about_structure(data, 0.2, 1.3, time=True)
    error = rid.worst_case_error(rid.identify(problem), omega=[2 * np.pi * 17.67])
    peak = float(error.upper[0, 0, 0] / np.abs(error.nominal[0]))
    _, found, away, _ = band(0, fine=False, hz=(5.0, 12.0, 17.67, 18.5), cells=24)
    with capsys.disabled():
        print(f"\ntrue poles: {100 * peak:.3g} % at the peak; poles from the data: {found.upper.max():.3g}")
    assert peak <= 0.12
    assert np.all(away <= found.upper[:, 0, 0])
    assert found.upper[2, 0, 0] >= 0.3 * 7
    assert abs(found.next_line / (2 * np.pi) - 17.67) < 1


def single_mode(lines):
    """One light mode of 3.2 Hz with a delayed rest, its box, and the identification at the middle."""
    omega, basis = np.linspace(2, 100, lines), rid.kautz([20.0], [0.05], dt=0.02, delay=1)
    truth = basis.response(omega * 0.02) @ [0.5, 0.3] + 0.02 * np.exp(-3j * omega * 0.02)
    frf = rid.FrequencyResponse(omega, truth, bound=0.05 * np.abs(truth) + 0.02, dt=0.02)
    problem = rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=0.1, decay_rate=1.3), parametric=basis)
    return problem, (np.array([[19.9, 20.1]]), np.array([[0.048, 0.052]]))


@pytest.mark.parametrize(("lines", "points", "rtol", "plants"), [(7, 5, 1.0, 3), slow(25, 9, 0.1, 20)])
def test_the_bound_on_the_circle_holds_plants_with_poles_anywhere_in_the_box(lines, points, rtol, plants):
    """Plants of the class through the data with other poles, on a fine grid; more than any single one of them is allowed."""
    problem, box = single_mode(lines)
    result = rid.identify(problem)
    band = rid.guarantee.worst_case_over_poles(
        result, *box, delay=1, omega=np.linspace(0, np.pi / 0.02, points), directions=6, cells=1
    )
    sums = band.circle
    circle = band.on_circle(rtol)
    assert band.circle is circle
    dense, bounds = np.linspace(0, np.pi / 0.02, 4001), []
    for found in (sums, circle):
        assert found.edges[0] == 0
        assert found.edges[-1] == pytest.approx(np.pi / 0.02)
        bounds.append(found.bound[np.clip(np.searchsorted(found.edges, dense) - 1, 0, found.bound.size - 1)])
    bound = np.min(bounds, axis=0)
    rng, inside = np.random.default_rng(0), 0
    for _ in range(plants):
        poles = rid.kautz(rng.uniform(*box[0].T), rng.uniform(*box[1].T), dt=0.02, delay=1)
        other = rid.identify(dataclasses.replace(problem, parametric=poles), objective="margin")
        if other.consistent:
            away = responses(other.model, 0.02 * dense) - responses(result.model, 0.02 * dense)
            assert np.all(np.abs(away[:, 0, 0]) <= bound)
            inside += 1
    assert inside >= plants // 2
    assert circle.lower <= circle.largest == band.hinf
    assert np.all(band.sigma_upper <= band.hinf)
    assert np.all(band.lower == 0)  # systems of relaxed problems are none that were found
    gain = control.ss([], [], [], 0.5 / band.hinf, 0.02)
    edges, bound = band.cover()
    alone = rid.guarantee.robust_stability_margin(band.model, gain, edges, bound)
    assert band.robust_stability_margin(gain).margin == alone.margin


def test_what_the_expansion_leaves_out_on_an_arc_is_the_largest_inside_it():
    problem, box = single_mode(5)
    cell = rid.guarantee.worst_case_over_poles(
        rid.identify(problem), *box, delay=1, omega=[3.0], directions=3, cells=1
    ).cells[0]
    ends = np.array([0.0, 0.3, 0.41, 1.0, 3.0, np.pi]) / 0.02
    on_arcs = cell.slack_on(ends[:-1], ends[1:])[:, 0, 0]
    for low, high, largest in zip(ends[:-1], ends[1:], on_arcs, strict=True):
        brute = cell.slack(np.linspace(low, high, 4001)).max()
        assert brute <= largest <= 1.1 * brute  # the pole and its conjugate are nearest at different angles


def test_bad_input():
    data = structure(0)
    problem = about_structure(data, 0.1, 1.2)
    result = rid.identify(problem)
    box = data.modes[:, :1] * [0.99, 1.01], data.modes[:, 1:] * [0.9, 1.1]
    bounds = rid.guarantee.worst_case_over_poles
    refused("one row", bounds, result, box[0][:1], box[1])
    refused("low <= high", bounds, result, box[0][:, ::-1], box[1])
    refused("below 1", bounds, result, box[0], box[1] * 20)
    refused(r"must hold the poles .* Mode 2 has 111\.0", bounds, result, box[0] * [[1.0], [1.02]], box[1])
    refused(r"of the `delay` that is said here \(0\)", bounds, result, *box, delay=0)
    refused("must be an Identification", bounds, problem, *box, error=rid.errors.InputTypeError)


def test_a_box_that_the_data_refute_has_no_band():
    data = structure(0)
    wrong = data.modes * [[1.0, 1.0], [0.97, 1.0]]
    result = rid.identify(about_structure(data, 0.1, 1.2, modes=wrong))
    box = wrong[:, :1] * [0.9999, 1.0001], wrong[:, 1:] * [0.99, 1.01]
    with pytest.raises(rid.errors.InconsistentDataError, match="all 1 cells of it are refuted"):
        rid.guarantee.worst_case_over_poles(result, *box, omega=[30.0], cells=1)
