"""Matrices whose poles are known up to a box: shared poles, residues of every entry free."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.guarantees import box_of
from support.cases import seeds, slow
from support.edge_bands import edge_plant
from support.edge_plants import edge_problem
from support.matrix_plants import plant, response

AWAY = np.array([2e-3, 2e-2])


def box_around(basis, away=AWAY):
    """Intervals of the frequencies and of the damping ratios around the poles of single pairs."""
    logs = np.log(basis.poles[np.imag(basis.poles) > 0])
    ends = np.abs(logs), -logs.real / np.abs(logs)
    return tuple(
        end[:, None] * (1 + part * (1 + 1e-9) * np.array([-1, 1])) for end, part in zip(ends, away, strict=True)
    )


@pytest.mark.parametrize("seed", seeds(1, 50))
def test_a_plant_at_the_edge_with_its_pole_in_the_box_is_inside_the_band(seed, tmp_path):
    problem, truth, _ = edge_problem(seed, AWAY, 0.3)
    result = rid.identify(problem)
    box = box_around(problem.parametric)
    mode = float(box[0].mean())
    omega = [0.05, mode] if seed else [mode]
    band = rid.guarantee.worst_case_over_poles(
        result, *box, omega=omega, cells=2 if seed else 1, rtol=0.1 if seed else 0.5
    )
    off = truth(band.omega) - band.nominal
    assert np.all(np.abs(off) <= band.upper)
    assert np.all(np.linalg.norm(off, 2, axis=(1, 2)) <= band.sigma_upper)
    size = np.abs(truth(band.omega))
    assert np.all((band.magnitude[..., 0] <= size) & (size <= band.magnitude[..., 1]))
    assert band.certified
    first, *others = band.kept
    value = dataclasses.replace(first.values[0], support=first.values[0].support - 1e-4 * band.upper[0, 0, 0])
    forged = dataclasses.replace(first, values=(value, *first.values[1:]))
    assert not dataclasses.replace(band, kept=(forged, *others)).verify()
    assert "largest singular value" in band.summary()
    band.save(tmp_path / "band")
    again = rid.load(tmp_path / "band")
    assert np.array_equal(again.upper, band.upper)
    assert np.array_equal(again.magnitude, band.magnitude)
    assert again.summary() == band.summary()
    assert again.verify()


@pytest.mark.parametrize("symmetric", [True, slow(False)])
def test_a_box_of_one_point_gives_the_error_at_these_poles(symmetric):
    """Entries apart and tied by the ball, symmetric too: within the gap that was asked for."""
    mode = rid.kautz([1.2], [0.05], dt=1.0, delay=1)
    system, gain = plant(int(symmetric), 2, 2, 1.3, symmetric=symmetric)
    lines, residues = (np.array([0.3, 1.1, 1.3, 2.5]), np.array([[[2.0, 1.0], [1.0, -2.0]], [[1.0, 3.0], [3.0, 1.0]]]))
    values = response(system, lines) + np.tensordot(mode.response(lines), residues, 1)
    bound = np.full(values.shape, 0.1)
    bound[1, 0, 1] = bound[1, 1, 0] = np.inf
    frf = rid.FrequencyResponse(lines, values, bound=bound, dt=1.0)
    prior = rid.Prior(gain_bound=1.2 * gain, decay_rate=1.3)
    result = rid.identify(rid.MixedProblem(frequency=frf, prior=prior, parametric=mode, symmetric=symmetric))
    box = box_around(mode, (0.0, 0.0))
    band = rid.guarantee.worst_case_over_poles(result, *box, omega=[0.7])
    error = rid.worst_case_error(result, omega=[0.7], rtol=0.1)
    assert np.all(error.lower <= band.upper * (1 + 1e-9))
    assert np.all(band.upper <= error.upper * 1.1)
    assert band.upper.shape == (1, 2, 2)
    np.testing.assert_array_equal(band.with_model(error.model).upper, band.upper)
    if symmetric:
        np.testing.assert_allclose(band.upper, band.upper.swapaxes(1, 2), rtol=1e-12)
    assert band.certified


def test_the_amplitudes_of_every_entry_are_its_own_and_of_their_units():
    """Proved for each entry by its own samples; units scale them."""
    problem, _, _ = edge_problem(0, size=0.3)
    frf, units = problem.frequency[0], 2.0 ** np.array([[0, 20], [-10, 10]])
    scaled = dataclasses.replace(
        problem,
        frequency=rid.FrequencyResponse(frf.omega, units * frf.values, bound=units * frf.bound.radius, dt=1.0),
        prior=dataclasses.replace(problem.prior, scaling=units),
    )
    box = box_around(problem.parametric)
    plain, other = (box_of(rid.identify(one), *box, 1).amplitude for one in (problem, scaled))
    assert plain.shape == (1, 2, 2)
    np.testing.assert_allclose(other, units * plain, rtol=1e-3)


def test_the_time_ends_the_search_and_the_sweep():
    problem, truth, _ = edge_problem(0, AWAY, 0.3)
    result, told = rid.identify(problem), []
    box = box_around(problem.parametric)
    omega = np.linspace(0.1, 3, 9)
    band = rid.guarantee.worst_case_over_poles(
        result, *box, omega=omega, cells=2, directions=4, rtol=0.5, time_limit=0.1, progress=lambda *at: told.append(at)
    )
    assert 1 <= band.omega.size < 9
    assert told
    assert set(band.omega) <= set(omega)
    assert np.all(np.abs(truth(band.omega) - band.nominal) <= band.upper)
    assert band.certified


@pytest.mark.slow
@pytest.mark.parametrize("directions", [3, 6])
def test_entries_of_which_no_system_was_found_count_with_their_bounds(directions):
    """The set of a wide cell is too thin for a system: the truth is inside, and nothing overflows where both entries are sought."""
    plant = edge_plant("record of two inputs", 3)
    result = rid.identify(plant.problem)
    assert result.consistent
    lines = plant.problem.frequency[0].omega
    omega = np.sort(np.random.default_rng(31).uniform(lines.min(), lines.max(), 3))[:1]
    band = rid.guarantee.worst_case_over_poles(
        result, *plant.box, omega=omega, directions=directions, rtol=0.2, cells=1, delay=0
    )
    assert not np.any(band.sigma_lower)
    assert np.all(np.abs(plant.truth(band.omega) - band.nominal) <= band.upper)
    assert band.certified
