"""Files as laboratories hand them over: one structure around all arrays, times that were rounded, frequencies last."""

import numpy as np
import pytest
import scipy.io

import robustid as rid
from robustid.data import uniform_step
from robustid.errors import InputError

U = np.random.default_rng(0).standard_normal(400)
HZ = np.linspace(10.0, 50.0, 41)


def test_names_in_the_only_structure_of_a_file_say_what_they_are(tmp_path):
    path = tmp_path / "stage.mat"
    scipy.io.savemat(path, {"meas": {"Ts": 5e-5, "u": U[:, None], "y": 2 * U[:, None], "comment": "x axis"}})
    record = rid.load(path)
    assert record.dt == 5e-5
    assert np.array_equal(record.y, 2 * record.u)
    assert [one.name for one in (*record.inputs, *record.outputs)] == ["u", "y"]
    named = rid.load(path, fields={"u": "meas.y", "y": "u", "dt": "Ts"})  # with the structure, and without
    assert np.array_equal(named.u, record.y)
    assert named.dt == record.dt


def test_arrays_of_several_structures_are_asked_about(tmp_path):
    path = tmp_path / "two.mat"
    scipy.io.savemat(path, {"one": {"Ts": 0.1, "u": U, "y": U}, "other": {"Ts": 0.1, "u": U, "y": U}})
    with pytest.raises(InputError, match="can't tell whether it holds frequency or time data"):
        rid.load(path)
    scipy.io.savemat(path, {"one": {"Ts": 0.0, "u": U, "y": U}})
    with pytest.raises(InputError, match=r"the sample time 'Ts' in the file must be one positive number in s; got 0"):
        rid.load(path)


@pytest.mark.parametrize("bound", [0.03, 0.03 + 0.001 * HZ])
def test_a_matrix_with_frequencies_last_and_one_bound_for_all_entries(tmp_path, bound):
    """A structure of frequencies in Hz: the line that it is read with is told, and its bound is of all entries alike."""
    values, path = np.exp(1j * np.arange(4 * HZ.size)).reshape(2, 2, HZ.size), tmp_path / "leg.mat"
    scipy.io.savemat(path, {"FRF": {"f_hz": HZ, "H": values, "bound": bound}})
    asked = rid.look(path)
    assert asked.arguments == {"axes": "output,input,frequency"}
    assert asked.kind == "frequency"
    frf = rid.load(path, **asked.arguments)
    assert np.array_equal(frf.values, np.moveaxis(values, -1, 0))
    assert np.array_equal(frf.bound.radius[:, 1, 0], np.broadcast_to(bound, HZ.size))


@pytest.mark.parametrize("rounded", ["%.6f", "%.7g", "%.9g"])
@pytest.mark.parametrize("rate", [2048.0, 3000.0, 44100.0])
def test_instants_that_were_rounded_are_uniform(rate, rounded):
    """A file of a 1/2048 s record holds 0.000488, 0.000977: its step is that of its ends."""
    time = np.array([float(rounded % (k / rate)) for k in range(6000)])
    assert uniform_step(time, time.size) == pytest.approx(1 / rate, rel=1e-6)
    with pytest.raises(InputError, match="the time is not uniform"):
        uniform_step(np.append(time, time[-1] + 2 / rate), time.size + 1)


@pytest.mark.parametrize(
    ("rate", "places", "samples"), [(3000.0, 4, 24000), (30.0, 2, 400), (30.0, 3, 100), (60.0, 3, 3000)]
)
def test_instants_that_were_rounded_to_a_third_of_a_step_are_uniform(rate, places, samples):
    """Frames of a camera in hundredths of a second: .03, .07, .10. A lost one, wherever it is, is none of them."""
    time = np.round(3.1 + np.arange(samples + 1) / rate, places)
    assert uniform_step(time, time.size) == pytest.approx(1 / rate, rel=0.3 / samples**1.5 * 12**0.5 * 4)
    for lost in (1, 2, samples // 3, samples // 2, samples - 1):
        with pytest.raises(InputError, match="the time is not uniform"):
            uniform_step(np.delete(time, lost), samples)


@pytest.mark.parametrize("places", [6, 9, 17])
def test_instants_that_jitter_are_not_uniform(places):
    jitter = 2e-5 * np.random.default_rng(1).standard_normal(6000)
    with pytest.raises(InputError, match="the time is not uniform"):
        uniform_step(np.round(np.arange(6000) * 1e-3 + jitter, places), 6000)
    lost = np.round(np.delete(np.arange(6001) / 2048, 3000), 6)  # one sample
    with pytest.raises(InputError, match="the time is not uniform"):
        uniform_step(lost, 6000)


def test_signals_with_a_time_that_jitters_are_still_proposed(tmp_path):
    path = tmp_path / "belt.csv"
    time = np.arange(400) * 1e-3 + 2e-5 * np.random.default_rng(1).standard_normal(400)
    np.savetxt(
        path, np.column_stack([time, U, U]), header="Time (s),Torque (Nm),Angle (rad)", delimiter=",", comments=""
    )
    found = rid.look(path)
    assert found.arguments["fields"] == {"time": "Time (s)", "u": "Torque (Nm)", "y": "Angle (rad)"}
    assert not any("phase" in words for _, _, words in found.rows)  # of a record an angle is a signal


def test_a_narrow_range_is_shown_with_the_digits_that_tell_its_ends():
    frf = rid.FrequencyResponse(2 * np.pi * np.array([9999500.0, 1e7, 10000500.0]), np.ones(3))
    assert "9999.5 to 10000.5 kHz" in repr(frf)
    assert "1 to 100 Hz" in repr(rid.FrequencyResponse(2 * np.pi * np.array([1.0, 100.0]), np.ones(2)))
