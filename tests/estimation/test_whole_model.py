"""Single lines and seams that only a model of the whole entry shows: no larger than a bound or two."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.core import responses
from robustid.data import joint_radius
from robustid.estimation.whole_model import WholeModel, _second, odd_lines
from support.cases import slow
from support.fault_judge import CATALOGUE, faulty_of
from support.fault_plants import SIMULATED, simulated
from support.measured import realdata

CLEAN = {name: simulated(name).response for name in SIMULATED}


def told(frf):
    return [(fault.kind, fault.correction) for fault in rid.prepare.response_faults(frf)]


@pytest.mark.parametrize(
    ("name", "delay"),
    [
        ("stage", False),
        ("arm", True),
        slow("stage", True),
        slow("arm", False),
        *(slow("matrix", k) for k in (False, True)),
    ],
)
def test_a_seam_of_few_percent_is_named_at_its_place(name, delay):
    """Of 5 % in gain, or of a delay that is 0.03 rad there."""
    frf = CLEAN[name]
    half, values = frf.omega.size // 2, frf.values.copy()
    values[half:] *= np.exp(-0.03j * frf.omega[half:, None, None] / frf.omega[half]) if delay else 1.05
    (fault,) = rid.prepare.response_faults(dataclasses.replace(frf, values=values))
    assert fault.kind == "seam"
    assert f"between {frf.freq_hz[half - 1]:.5g} Hz and {frf.freq_hz[half]:.5g} Hz" in fault.words


@pytest.mark.realdata
@realdata[1]
@pytest.mark.parametrize("entry", [slow((1, 1)), slow((0, 0)), slow((0, 1)), slow((0, 2)), slow((2, 1))])
def test_of_a_long_entry_a_seam_is_named_and_none_that_is_not_there(entry):
    """It has more modes than one model of 20 poles holds: 20 degrees at 1684 Hz, of entry (2, 2), were such a model's."""
    frf = rid.estimate_frf(rid.datasets.load("fsm/train"), period=8192).entry(*entry).band(500, 1700)
    assert told(frf) == []
    values = frf.values.copy()
    values[700:] *= np.exp(-0.5j * frf.omega[700:, None, None] / frf.omega[700])
    (fault,) = rid.prepare.response_faults(dataclasses.replace(frf, values=values))
    assert fault.kind == "seam"
    assert f"between {frf.freq_hz[699]:.5g} Hz and {frf.freq_hz[700]:.5g} Hz" in fault.words


@pytest.mark.parametrize(
    ("name", "trials"), [("stage", 2), ("matrix", 1), *(slow(name, 20) for name in ("stage", "arm", "matrix"))]
)
def test_a_line_that_is_off_by_two_bounds_is_named(name, trials):
    frf, rng, found = CLEAN[name], np.random.default_rng(0), 0
    for _ in range(trials):
        at, values = int(rng.integers(8, frf.omega.size - 8)), frf.values.copy()
        values[at, 0, -1] += 2.5 * frf.bound[at, 0, -1] * np.exp(2j * np.pi * rng.random())
        found += ("outlier", f"leave out {frf.freq_hz[at]:.10g}") in told(dataclasses.replace(frf, values=values))
    assert found >= 0.8 * trials


@pytest.mark.parametrize("draws", [1000, slow(3000)])
def test_bounds_that_are_small_by_chance_make_no_line_odd(draws):
    """Of ten degrees of freedom, in one of 10 000 responses at most; taken for known ones, 38 of 3000 were told of a line."""
    rng, lines, dof = np.random.default_rng(1), 200, 10.0
    radius = joint_radius(0.95, lines, dof)
    basis = np.ones((2 * lines, 1)) / np.sqrt(2 * lines)
    told_of = 0
    for _ in range(draws):
        deviation = np.sqrt(rng.gamma(dof, 1 / dof, lines))
        left = rng.standard_normal(2 * lines) / np.sqrt(2) / np.tile(radius * deviation, 2)
        noise = float(np.linalg.norm(left) / np.sqrt(lines))
        model = WholeModel(np.ones(lines, complex), left, basis, left @ left / (2 * lines - 1), noise, dof, 4, 0.0)
        told_of += bool(odd_lines({0: model}))
    assert told_of <= 2  # 0.3 of 3000 in the mean


@pytest.mark.parametrize("power", [slow(-60), 60])
def test_units_change_nothing(power):
    frf = CLEAN["arm"]
    values = frf.values.copy()
    values[200:] *= 1.05
    scaled = rid.FrequencyResponse(
        frf.omega, 2.0**power * values, bound=2.0**power * frf.bound.outer_radius, dt=frf.dt
    )  # fmt: skip
    assert told(scaled) == [("seam", "")]


@pytest.mark.parametrize(("names", "seeds"), [(["stage"], range(1)), slow(["stage", "arm"], range(1, 50))])
def test_errors_as_large_as_their_bound_are_no_fault_and_larger_ones_are(names, seeds):
    """Everywhere exactly so large, of random phase: the worst that a bound allows. Normal errors, 0.75 of it rms, are larger."""
    small, shown = 0, 0
    for seed in seeds:
        for number, name in enumerate(names):
            frf, rng = CLEAN[name], np.random.default_rng([seed, number])
            truth = responses(simulated(name).plant, frf.omega * frf.dt)
            bound, turn = frf.bound.outer_radius, np.exp(2j * np.pi * rng.random(frf.values.shape))
            normal = 0.75 * (rng.standard_normal(turn.shape) + 1j * rng.standard_normal(turn.shape)) / np.sqrt(2)
            for errors in (turn, normal):
                measured = rid.FrequencyResponse(frf.omega, truth + bound * errors, bound=bound, dt=frf.dt)
                kinds = [kind for kind, _ in told(measured)]
                small += errors is turn and "small bound" in kinds
                shown += errors is normal and "small bound" in kinds
    assert small == 0
    assert shown >= 0.9 * len(names) * len(seeds)


@pytest.mark.parametrize("seeds", [(7,), slow(range(30))])
def test_a_mode_narrower_than_the_lines_are_apart_is_no_fault(seeds):
    """Of a fifth of their distance, and small in one of the entries: it shows on three lines there."""
    omega, dt = 2 * np.pi * np.linspace(5, 300, 200), 1e-3
    basis = rid.kautz(2 * np.pi * np.array([31.0, 74.0, 122.0, 205.0]), [0.01, 0.012, 0.008, 0.015], dt=dt, delay=1)
    for seed in seeds:
        rng = np.random.default_rng(seed)
        amplitudes = np.repeat(rng.standard_normal((4, 3)), 2, axis=0) * np.tile([1.0, 0.5], 4)[:, None]
        amplitudes[:2, 2] *= 0.02 / np.abs(amplitudes[0, 2])
        values = basis.response(omega * dt) @ amplitudes + 0.006 * np.exp(-1j * omega * dt)[:, None]
        bound = 0.01 * np.abs(values) + 1e-3 * np.median(np.abs(values), axis=0)
        values = values + bound * np.sqrt(rng.random(bound.shape)) * np.exp(2j * np.pi * rng.random(bound.shape))
        assert told(rid.FrequencyResponse(omega, values[:, :, None], bound=bound[:, :, None], dt=dt)) == []


@pytest.mark.slow
def test_most_seams_of_five_percent_are_named_in_sixty_points_of_a_process_and_none_of_clean_ones():
    named = 0
    for seed in range(40):
        clean = simulated("heater", seed)
        faulty = faulty_of(CATALOGUE["seam"], clean, "limit").response
        named += "seam" in [fault.kind for fault in rid.prepare.response_faults(faulty)]
        assert rid.prepare.response_faults(clean.response) == (), seed
    assert named >= 20


def test_a_model_whose_poles_all_explain_one_line_each_has_none_that_move():
    """Such poles are left out: a slice of a hundred (seed 8) ended in an error of numpy."""
    assert _second(np.exp(1j * np.linspace(0, 1, 5)), np.zeros(0, complex)).shape == (5, 0)
