"""Steps and blows near the beginning of records: bounds hold their truth, up to the noise; others are left as they are."""

import dataclasses

import control
import numpy as np
import pytest

import robustid as rid
from robustid.errors import InputError
from robustid.estimation.frf import response_alone
from robustid.estimation.nonperiodic import local
from robustid.estimation.steps import is_step, local_from_rest
from support.cases import seeds

DT, SAMPLES, NOISE = 2e-3, 3000, 0.01


def two_modes():
    parts = [
        control.tf([gain * w**2], [1, 2 * zeta * w, w**2])
        for w, zeta, gain in ((2 * np.pi * 6, 0.02, 1.0), (2 * np.pi * 19, 0.01, 0.3))
    ]
    return control.c2d(control.ss(parts[0] + parts[1]), DT)


PLANTS = {
    "two modes": two_modes(),
    "a lag": control.c2d(control.ss(control.tf([1], [0.4, 1])), DT),
    "a mode that rings on": control.c2d(control.ss(control.tf([60], [1, 0.04, 60])), DT),
}


def moved(plant, seed, at, sizes, width=SAMPLES):
    """Records of steps, or of pulses of a width, from sample `at` on."""
    rng, found = np.random.default_rng(seed), []
    for size in sizes:
        u = np.zeros(SAMPLES)
        u[at : at + width] = size
        y = control.forced_response(plant, U=u).outputs
        found.append(rid.TimeRecord(u, y + NOISE * rng.standard_normal(SAMPLES), dt=DT))
    return found


def ratio(frf, plant):
    return np.abs(frf.values[:, 0, 0] - plant(np.exp(1j * frf.omega * DT))) / frf.bound.radius[:, 0, 0]


@pytest.mark.parametrize("seed", seeds(1, 20))
@pytest.mark.parametrize("sizes", [(1.0,), (1.0, 0.6, -1.0, 1.4)])
@pytest.mark.parametrize("at", [0, 3, 150])
@pytest.mark.parametrize("name", PLANTS)
def test_bounds_of_steps_hold(name, at, sizes, seed):
    """None had a line: its spectrum passes for that of a transient. Of those after a tenth of a record, four records at once, the
    bounds of a mode that rings on missed 35 of 60 times.
    """
    frf = response_alone(moved(PLANTS[name], [seed, at], at, sizes))
    assert ratio(frf, PLANTS[name]).max() <= 1.3  # 95 % jointly
    low = frf.freq_hz < 3
    assert np.median(frf.bound.radius[low, 0, 0] / np.abs(frf.values[low, 0, 0])) < 0.2


@pytest.mark.parametrize("seed", seeds(1, 20))
@pytest.mark.parametrize("at", [0, 1, 6, 100])
def test_steps_about_a_point_of_operation_are_counted_from_it(at, seed):
    """From 20 to 50 % at 22.4 degrees; the first samples say where it begins, no better than noise lets them."""
    plant = control.c2d(control.ss(control.tf([0.3], [300, 1]) * control.tf([1], [40, 1])), 5.0)
    rng, u = np.random.default_rng([seed, at]), np.where(np.arange(800) < at, 0.0, 30.0)
    y = control.forced_response(plant, U=u).outputs + 0.02 * rng.standard_normal(800)
    frf = response_alone(rid.TimeRecord(u + 20.0 * (at > 0), 22.4 + y, dt=5.0))
    assert frf.note.endswith("the records from rest, counted from where they begin")
    off = np.abs(frf.values[:, 0, 0] - plant(np.exp(5j * frf.omega)))
    assert np.all(off <= 1.2 * frf.bound.radius[:, 0, 0])  # 95 % jointly
    assert frf.bound.radius[0, 0, 0] < 0.6 * np.abs(frf.values[0, 0, 0])  # .01 in the median, up to .43


@pytest.mark.parametrize("seed", seeds(1, 20))
@pytest.mark.parametrize("at", [20, 100])
def test_outputs_on_their_way_are_not_taken_for_rest(at, seed):
    """From an earlier step they still fall by half before the next one: counted from there, bounds were left by up to 40 times."""
    plant = control.c2d(control.ss(control.tf([0.3], [300, 1]) * control.tf([1], [40, 1])), 5.0)
    rng, u = np.random.default_rng([seed, at]), np.where(np.arange(1200) < 400, 10.0, 0.0)
    u[400 + at :] = 30.0
    y = control.forced_response(plant, U=u).outputs + 0.02 * rng.standard_normal(1200)
    record = rid.TimeRecord(u[400:], y[400:], dt=5.0)
    if at == 20:
        with pytest.raises(InputError, match="passes for a transient at every spectral line"):
            response_alone(record)
        return
    frf = response_alone(record)
    off = np.abs(frf.values[:, 0, 0] - plant(np.exp(5j * frf.omega)))
    assert np.all(off <= 1.2 * frf.bound.radius[:, 0, 0])  # 95 % jointly


@pytest.mark.parametrize("seed", seeds(1, 20))
def test_a_blow_alone_tells_the_response_up_to_the_noise(seed):
    """Its bounds were 4 to 6e6 times the response, in the median."""
    plant = PLANTS["two modes"]
    frf = response_alone(moved(plant, seed, 5, [20.0], width=8))
    assert ratio(frf, plant).max() <= 1.3
    assert 40 < frf.freq_hz[-1] < 130
    assert np.median(frf.bound.radius[:, 0, 0] / np.abs(frf.values[:, 0, 0])) < 0.6


def test_lines_of_a_step_reach_the_modes_that_it_moves():
    """Those that it excites within 2 % of the lowest one end at 7 Hz."""
    assert response_alone(moved(two_modes(), 0, 100, [1.0])).freq_hz[-1] > 25


@pytest.mark.parametrize("seed", seeds(1, 20))
def test_steps_of_one_input_after_the_other_tell_a_matrix(seed):
    """The second moves long after the first quarter of the record."""
    parts = [control.ss(control.tf([gain], [slow, 1])) for gain, slow in ((2.0, 30), (0.5, 50), (0.4, 40), (1.5, 20))]
    each, both = control.append(*parts), np.kron(np.ones((2, 1)), np.eye(2))
    plant = control.c2d(
        control.ss(each.A, each.B @ both, np.kron(np.eye(2), np.ones(2)) @ each.C, np.zeros((2, 2))), 1.0
    )
    time = np.arange(1000)
    u = np.stack([time >= 50, -1.0 * (time >= 450)], axis=1)
    y = control.forced_response(plant, U=u.T).outputs.T
    frf = response_alone(rid.TimeRecord(u, y + 0.01 * np.random.default_rng(seed).standard_normal(y.shape), dt=1.0))
    true = np.moveaxis(plant(np.exp(1j * frf.omega)), -1, 0)
    assert np.max(np.abs(frf.values - true) / frf.bound.radius) <= 1.2
    assert np.all(frf.bound.radius[0] < 0.2 * np.abs(true[0]))


def test_a_step_is_constant_inputs_from_rest():
    step, zero, later = (moved(PLANTS["a lag"], 0, *how)[0] for how in ((0, [2.0]), (0, [0.0]), (5, [2.0])))
    assert [is_step(one) for one in (step, zero, later)] == [True, False, False]
    assert not is_step(dataclasses.replace(step, initial="free"))
    assert response_alone(step).omega.size
    for record, method in ((zero, None), (dataclasses.replace(step, initial="free"), None), (step, "welch")):
        with pytest.raises(InputError, match="it excites nothing"):
            response_alone(record, method=method)


@pytest.mark.parametrize("how", ["free", "moves on"])
def test_records_that_begin_otherwise_are_estimated_as_they_are(how):
    (record,) = moved(PLANTS["two modes"], 0, 600, [1.0])
    if how == "free":
        record = dataclasses.replace(record, initial="free")
    else:
        record = dataclasses.replace(record, u=record.u + (np.arange(SAMPLES) // 100 % 2)[:, None])
    found, plain = local_from_rest([record], None), local([record], None)
    np.testing.assert_array_equal(found.index, plain.index)
    np.testing.assert_array_equal(found.covariance, plain.covariance)


def test_stated_lines_are_kept():
    frf = response_alone(moved(PLANTS["two modes"], 0, 600, [1.0]), lines=[3, 9])
    np.testing.assert_allclose(frf.freq_hz, [3 / 6, 9 / 6])
