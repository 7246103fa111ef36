"""Certified amplitudes over a pole-uncertainty box: above those of drawn plants in their own normalisation, and not far above."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.guarantees import PoleCell, box_of
from robustid.guarantees.amplitude_bounds import extractions_over, largest_amplitudes
from support.cases import seeds, slow
from support.edge_bands import KINDS, edge_plant
from support.pole_cells import drawn_poles, modes_at
from support.refusals import refused

DT = 0.01
TIMES = [{"dt": DT, "delay": 0}, {"dt": DT, "delay": 2}, {"dt": 0.0, "delay": 0}]


def measured(cell, omega, truth, gain):
    """Errors at their bounds, of a statement with the modes in the middle of the cell."""
    bound = 0.01 * np.abs(truth) + 0.01 * gain
    values = truth + bound * np.exp(7j * omega) * (1 - 1e-9)
    frf = rid.FrequencyResponse(omega, values, bound=bound, dt=cell.dt or None)
    decay = {"decay_rate": 1.3} if cell.dt else {"decay": 1.3}
    basis = rid.kautz(cell.omega.mean(axis=1), cell.damping.mean(axis=1), dt=cell.dt, delay=cell.delay)
    return rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=gain, **decay), parametric=basis)


def problem_with_modes(rng, time, width, modes=2):
    """Modes that lie apart, in a box, in no order; the amplitudes c of c/(1 - a z^-1) or c/(s - a) of the plant behind the data."""
    middle = np.array([60.0, 130.0, 210.0])[:modes] * (1 + 0.05 * rng.uniform(-1, 1, modes))
    middle, damping = rng.permutation(middle), rng.uniform(0.01, 0.05, modes)
    spread = width * damping * middle
    ends = np.stack([middle - spread, middle + spread], axis=1), damping[:, None] * np.array([1 - width, 1 + width])
    cell = PoleCell(*ends, np.ones(modes), time["delay"], time["dt"])
    poles = drawn_poles(cell, rng)
    damped = 1 - np.abs(poles) if cell.dt else -poles.real
    c = damped * 10 ** rng.uniform(-0.5, 0.5, modes) * np.exp(2j * np.pi * rng.uniform(size=modes))
    gain = 0.1
    near = (middle[:, None] * (1 + damping[:, None] * np.array([-2, -0.7, 0, 0.7, 2]))).ravel()
    omega = np.sort(np.concatenate([near, rng.uniform(5, 300, 12)]))
    truth = modes_at(cell, omega, c, poles) + gain * rng.uniform(-1, 1)
    return measured(cell, omega, truth, gain), (cell.omega, cell.damping), c


@pytest.mark.parametrize("time", [slow(one) if one == TIMES[1] else one for one in TIMES], ids=str)
@pytest.mark.parametrize(("width", "plants"), [(0.2, 3), *(slow(w, 12) for w in (0.01, 0.2))])
def test_no_amplitude_of_a_drawn_plant_is_above_its_bound(time, width, plants):
    """Of plants with poles often in a corner of the box; in the median at most a quarter above (a half of the wider box)."""
    rng, ratios = np.random.default_rng(0), []
    for _ in range(plants):
        problem, box, c = problem_with_modes(rng, time, width)
        result = rid.identify(problem)
        cell = box_of(result, *box, time["delay"])
        assert np.all(np.abs(c) <= cell.amplitude)
        ratios += (cell.amplitude / np.abs(c)).tolist()
    assert np.median(ratios) <= (1.25 if width < 0.1 else 1.5)


@pytest.mark.parametrize("seed", seeds(1, 20))
@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "free record"])
def test_bounds_hold_at_the_edge_of_the_class(kind, seed):
    """Gain exactly K, poles in a corner of their box, records and matrices too: against the residues of the plants."""
    plant = next(one for k in range(40) if (one := edge_plant(kind, 40 * seed + k)).box is not None)
    proofs = extractions_over(plant.problem, *plant.box)
    found = largest_amplitudes(plant.problem, *plant.box, proofs)
    assert found.shape == (1, *plant.problem.entries.shape)
    assert np.all(np.abs(plant.residue) <= found[0])
    assert np.all(np.isfinite(found))


def test_units_scale_the_bounds_exactly():
    rng = np.random.default_rng(1)
    problem, box, _ = problem_with_modes(rng, TIMES[0], 0.05)
    frf, unit = problem.frequency[0], 2.0**40
    scaled = dataclasses.replace(
        problem,
        frequency=rid.FrequencyResponse(frf.omega, unit * frf.values, bound=unit * frf.bound.radius, dt=DT),
        prior=rid.Prior(gain_bound=unit * problem.prior.gain_bound, decay_rate=1.3),
    )
    plain, other = (box_of(rid.identify(one), *box, 0).amplitude for one in (problem, scaled))
    np.testing.assert_allclose(other, unit * plain, rtol=1e-9)


def test_modes_whose_boxes_are_close_have_no_bounds_of_their_own():
    omega = np.linspace(20, 200, 30)
    basis = rid.kautz([100.0, 102.0], [0.05, 0.05], dt=DT)
    values = basis.response(omega * DT) @ [1.0, 0.3, 0.5, 0.2]
    frf = rid.FrequencyResponse(omega, values, bound=0.01 * np.abs(values), dt=DT)
    prior = rid.Prior(gain_bound=0.5, decay_rate=1.3)
    result = rid.identify(rid.MixedProblem(frequency=frf, prior=prior, parametric=basis))
    box = np.array([[99.0, 101.0], [101.0, 103.0]]), np.array([[0.04, 0.06], [0.04, 0.06]])
    refused("of 2 modes around 16", rid.guarantee.worst_case_over_poles, result, *box, delay=0)
    assert np.all(np.isfinite(rid.band(result, box=box).radius))
