"""The two data classes: what they accept, what they refuse in which words, and that nothing changes them."""

import copy
import dataclasses
import pickle

import control
import numpy as np
import pytest

from robustid.core import hz_span, hz_words
from robustid.data import Bound, FrequencyResponse, TimeRecord
from robustid.errors import InputError, InputTypeError
from support.mimo_data import KINDS, response, same
from support.refusals import refusals

pytestmark = pytest.mark.quick
OMEGA = np.array([1.0, 2.0, 5.0])


def mimo(**options):
    rng = np.random.default_rng(1)
    values = rng.standard_normal((3, 2, 3)) + 1j * rng.standard_normal((3, 2, 3))
    root = rng.standard_normal((3, 6, 6)) + 1j * rng.standard_normal((3, 6, 6))
    given = {
        "bound": rng.uniform(0.1, 1, (3, 2, 3)),
        "covariance": root @ root.conj().swapaxes(1, 2),
        "dt": 0.1,
        "inputs": ["a [N]", "b [V]", "c"],
        "outputs": ["x [mm]", ("y", "rad")],
        "note": "made up",
    }
    return FrequencyResponse(OMEGA, values, **{**given, **options})


def two_by_two(**options):
    rng = np.random.default_rng(2)
    given = {"dt": 0.5, "bound": rng.uniform(0.1, 1, (5, 2)), "inputs": ["a", "b"], "outputs": ["x", "y"]}
    return TimeRecord(np.outer(np.arange(5), [1, 0]), rng.standard_normal((5, 2)), **{**given, **options})


# --- FrequencyResponse


test_frequency_response_refuses = refusals(
    ({"omega": [], "values": []}, "`omega` is empty"),
    ({"omega": None}, "`omega` is required", InputTypeError),
    ({"omega": [[1.0]]}, r"`omega` must have 1 dimension; got shape \(1, 1\)"),
    ({"omega": [1.0, np.nan], "values": [1, 1]}, r"`omega` must be finite; got nan at index \(1,\)"),
    ({"omega": [-1.0, 1.0], "values": [1, 1]}, "`omega` must be >= 0; got -1 rad/s, and 1 of 2 points to be left out"),
    ({"omega": [1 + 1j]}, "`omega` must be real", InputTypeError),
    ({"omega": ["one"]}, "`omega` must be an array of numbers", InputTypeError),
    ({"omega": [1.0, 32.0], "values": [1, 1], "dt": 0.1}, "must not exceed pi/dt = 31.4159 rad/s; got 32 rad/s"),
    ({"omega": [1.0, 2.0]}, r"with F = 2 from `omega`; got \(1,\)"),
    ({"omega": [1.0, 2.0], "values": np.ones((2, 2))}, r"got \(2, 2\)"),
    ({"omega": [1.0, 2.0, 3.0], "values": np.ones((2, 2, 3))}, r"got \(2, 2, 3\)"),
    ({"values": np.ones((1, 0, 1))}, r"got \(1, 0, 1\)"),
    ({"values": [np.inf]}, "`values` must be finite"),
    ({"values": [[1, 2], [3]]}, "`values` must be an array of numbers; got list", InputTypeError),
    ({"dt": 0}, "`dt` must be positive; got 0"),
    ({"coherence": 1.1}, "must lie between 0 and 1; got 1.1 to 1.1, outside at 1 of 1 points; .* leave it out"),
    ({"noise": -0.1}, "`noise` must lie between 0 and infinity"),
    ({"distortion": [1.0, 2.0]}, r"`distortion` must have shape \(1, 1, 1\); got \(2,\)"),
    ({"changed": -0.1}, "`changed` must lie between 0 and infinity"),
    ({"doubt": [1.0, 2.0]}, r"`doubt` must have shape \(1, 1, 1\); got \(2,\)"),
    ({"dt": np.nan}, "`dt` must be finite"),
    ({"dt": [0.1, 0.2]}, "`dt` must be one number", InputTypeError),
    ({"bound": 0}, "`bound` must be positive"),
    ({"bound": -1}, "`bound` must be positive"),
    ({"bound": np.nan}, "`bound` must not contain NaN"),
    ({"bound": np.inf}, "`bound` is infinite everywhere: nothing was measured"),
    ({"values": [np.nan], "bound": 1.0}, r"`values` must be finite; got \(nan\+0j\) at index \(0, 0, 0\)"),
    ({"values": [np.nan]}, "A `bound` of inf marks"),
    ({"omega": [1.0, 2.0], "values": [1, 1], "bound": [1, 1, 1]}, "`bound` must be a scalar or have shape"),
    ({"covariance": [1.0]}, r"`covariance` must have shape .* = \(1, 1, 1\)"),
    ({"inputs": ["a", "b"]}, "`inputs` must name 1 signal;"),
    ({"outputs": [3]}, "`outputs` must hold names", InputTypeError),
    ({"note": 3}, "`note` must be text; got int", InputTypeError),
    of=lambda **options: FrequencyResponse(**{"omega": [1.0], "values": [1], **options}),
)


def test_frequency_response_sorts_everything_together():
    frf, order = mimo(), [2, 0, 1]
    shuffled = FrequencyResponse(
        frf.omega[order], frf.values[order], bound=frf.bound[order], covariance=frf.covariance[order], dt=0.1
    )
    for name in ("omega", "values", "bound", "covariance"):
        np.testing.assert_array_equal(getattr(shuffled, name), getattr(frf, name))


def test_a_frequency_may_come_twice_and_nyquist_is_allowed():
    frf = FrequencyResponse([np.pi / 0.1, 1.0, 1.0], [3, 1, 2], dt=0.1)
    np.testing.assert_array_equal(frf.values.ravel(), [1, 2, 3])


def test_bound_per_line_spreads_over_entries():
    frf = mimo(bound=[1, 2, 3])
    np.testing.assert_array_equal(frf.bound, np.broadcast_to(np.array([1, 2, 3])[:, None, None], (3, 2, 3)))


def test_channel_picks_value_bound_covariance_and_names():
    frf = mimo()
    entry = frf.entry("y", 1)
    assert entry.values.shape == (3, 1, 1)
    np.testing.assert_array_equal(entry.values[:, 0, 0], frf.values[:, 1, 1])
    np.testing.assert_array_equal(entry.bound[:, 0, 0], frf.bound[:, 1, 1])
    # vec stacks columns: entry (1, 1) of a 2 x 3 matrix is number 3
    np.testing.assert_array_equal(entry.covariance[:, 0, 0], frf.covariance[:, 3, 3])
    assert [str(c) for c in entry.inputs + entry.outputs] == ["b [V]", "y [rad]"]
    assert (entry.dt, entry.note) == (0.1, "made up")
    np.testing.assert_array_equal(frf.entry(-1, -2).values, entry.values)


test_channel_refuses = refusals(
    *(
        (lambda data=data, output=output: data.entry(output, 0), *refused)
        for data in (mimo(), two_by_two())
        for output, *refused in (
            ("z", r"`output` must be one of \['x', 'y'\]; got 'z'"),
            (2, "`output` must be below 2; got 2"),
            (-3, "`output` must be below 2; got -3"),
            (0.5, "`output` must be the number or name of a signal; got 0.5", InputTypeError),
            (None, "`output` must be the number or name of a signal; got None", InputTypeError),
        )
    )
)


@pytest.mark.parametrize("lines", [[0, 2], [True, False, True], slice(None, None, 2), np.array([2, 0])])
def test_select(lines):
    frf = mimo()
    some = frf.select(lines)
    for name in ("omega", "values", "bound", "covariance"):
        np.testing.assert_array_equal(getattr(some, name), getattr(frf, name)[[0, 2]])
    assert (some.inputs, some.outputs, some.dt) == (frf.inputs, frf.outputs, frf.dt)
    assert frf.select(1).omega.tolist() == [2.0]


test_select_refuses = refusals(
    (7, "doesn't select from 3 frequency points"),
    ([True, False], "doesn't select from 3"),
    ([], "selects none"),
    ("x", "doesn't select"),
    of=lambda lines: mimo().select(lines),
)


def test_band_is_in_hz_and_includes_its_ends():
    frf = FrequencyResponse(2 * np.pi * np.arange(1.0, 6.0), np.arange(5))
    assert frf.band(2, 4).values.real.ravel().tolist() == [1, 2, 3]
    with pytest.raises(InputError, match=r"no frequency point lies between 7 and 9 Hz"):
        frf.band(7, 9)


def test_with_bound_keeps_the_rest_and_forgets_where_the_old_bound_came_from():
    bound = Bound(1.0, kind="confidence", probability=0.95, dof=7)
    frf = dataclasses.replace(mimo(), bound=bound, dof=7, coherence=np.full((3, 2), 0.9))
    wider = frf.with_bound(9.0)
    assert np.all(wider.bound == 9)
    assert (wider.note, wider.bound.kind, wider.bound.probability, wider.dof) == ("", "hard", None, 7)
    assert frf.with_bound(9.0, "guessed").note == "guessed"
    np.testing.assert_array_equal(wider.values, frf.values)


@pytest.mark.parametrize("dt", [None, 0.1])
def test_control_round_trip(dt):
    frf = mimo(dt=dt)
    frd = frf.to_control()
    assert (frd.noutputs, frd.ninputs) == (2, 3)
    assert frd.isctime(strict=True) == (dt is None)
    again = FrequencyResponse.from_control(frd, bound=frf.bound)
    np.testing.assert_array_equal(again.values, frf.values)
    np.testing.assert_array_equal(again.omega, frf.omega)
    np.testing.assert_array_equal(again.bound, frf.bound)
    assert again.dt == dt


def test_from_control_agrees_with_the_model_at_each_frequency():
    model = control.ss([[0.5, 0.1], [0, 0.3]], np.eye(2), [[1, 2]], [[0, 1]], 0.1)
    frf = FrequencyResponse.from_control(control.frequency_response(model, OMEGA))
    for k, w in enumerate(OMEGA):
        np.testing.assert_allclose(frf.values[k], model(np.exp(0.1j * w)).reshape(1, 2), rtol=1e-13)


def test_from_control_refuses_what_it_would_have_to_guess():
    unspecified = control.FRD(np.ones((1, 1, 1)), [1.0], dt=True)
    with pytest.raises(InputError, match="without a sample time; give `dt`"):
        FrequencyResponse.from_control(unspecified)
    assert FrequencyResponse.from_control(unspecified, dt=0.2).dt == 0.2
    with pytest.raises(InputTypeError, match=r"`frd` must be a control\.FrequencyResponseData; got int"):
        FrequencyResponse.from_control(3)


# --- TimeRecord

ONES = np.ones(4)

test_time_record_refuses = refusals(
    ({"u": [], "y": []}, "`u` is empty"),
    ({"y": None}, "`y` is required", InputTypeError),
    ({"y": np.ones(3)}, "same number of samples; got 4 and 3"),
    ({"y": [1, 2, np.nan, 3]}, r"`y` must be finite; got nan at index \(2,\)"),
    ({"y": 1j * ONES}, "`y` must be real", InputTypeError),
    ({"y": np.ones((2, 4))}, r"`y` has shape \(2, 4\).*transpose"),
    ({"u": np.ones((1, 4)), "y": np.ones((1, 4))}, r"`u` has shape \(1, 4\).*transpose"),
    ({"y": np.ones((4, 1, 1))}, r"`y` must have shape \(T,\) or \(T, signals\)"),
    ({"dt": -0.1}, "`dt` must be positive; got -0.1"),
    ({"bound": 0}, "`bound` must be positive"),
    ({"bound": [1, 1, 1]}, "`bound` must be a scalar or have shape"),
    ({"bound": [1, 1, 1, np.nan]}, "`bound` must not contain NaN; got 1"),
    ({"initial": "unknown"}, "`initial` must be one of .* got 'unknown'"),
    ({"reference": np.ones(3)}, "`reference` must have T = 4 samples; got 3"),
    ({"past_input_bound": -1}, "`past_input_bound` must be >= 0; got -1"),
    ({"inputs": ["a", "b"]}, "`inputs` must name 1 signal"),
    ({"note": None}, "`note` must be text; got NoneType", InputTypeError),
    of=lambda **options: TimeRecord(**{"u": ONES, "y": ONES, "dt": 0.1, **options}),
)


def test_time_record_makes_columns_and_a_time_axis():
    record = TimeRecord(ONES, ONES, dt=0.5, bound=[1, 2, 3, np.inf], reference=ONES, past_input_bound=2)
    assert record.u.shape == record.y.shape == record.bound.shape == record.reference.shape == (4, 1)
    np.testing.assert_array_equal(record.time, [0, 0.5, 1, 1.5])
    assert record.past_input_bound == 2.0


def test_time_record_channel():
    record = two_by_two()
    one = record.entry("y", "a")
    np.testing.assert_array_equal(one.y[:, 0], record.y[:, 1])
    np.testing.assert_array_equal(one.u[:, 0], record.u[:, 0])
    np.testing.assert_array_equal(one.bound[:, 0], record.bound[:, 1])
    assert (one.inputs[0].name, one.outputs[0].name) == ("a", "y")
    with pytest.raises(InputError, match="`input` = 'b': the other inputs of the record are not zero"):
        record.entry("y", "b")


# --- both


@pytest.mark.parametrize(
    "first",
    [
        mimo(),
        mimo(bound=Bound(0.1, tilt=[0.5, 0.1j, -0.9])),
        two_by_two(),
        *(response(6, joint, missing=missing) for joint, missing in KINDS),
        Bound([0.1, np.inf], kind="tolerance", probability=0.9, dof=3.0),
    ],
)
@pytest.mark.parametrize("clone", [copy.copy, copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x)), lambda x: x])
def test_copies_are_equal_and_nothing_can_be_written(first, clone):
    second = clone(first)
    same(first, second)
    for part in (second, *([] if isinstance(second, Bound) or second.bound is None else [second.bound])):
        for field in dataclasses.fields(part):
            value = getattr(part, field.name)
            assert not isinstance(value, np.ndarray) or not value.flags.writeable
            with pytest.raises(AttributeError):
                setattr(part, field.name, value)


def test_the_callers_arrays_stay_writable_and_apart():
    omega, values = np.array([1.0, 2.0]), np.array([1.0, 2.0])
    frf, record = FrequencyResponse(omega, values), TimeRecord(omega, values, dt=1)
    omega[:] = values[:] = 7
    assert frf.omega.tolist() == [1, 2]
    assert record.y.ravel().tolist() == [1, 2]


def test_channel_names_and_units():
    frf = mimo()
    assert [tuple(c) for c in frf.inputs] == [("a", "N"), ("b", "V"), ("c", "")]
    assert [str(c) for c in frf.outputs] == ["x [mm]", "y [rad]"]
    assert [c.name for c in mimo(inputs=None).inputs] == ["u1", "u2", "u3"]
    assert TimeRecord(ONES, ONES, dt=1, inputs="force [N]").inputs[0] == ("force", "N")


@pytest.mark.parametrize("power", [-60, 60])
def test_scaling_by_powers_of_two_is_exact(power):
    scale, frf, record = 2.0**power, mimo(), two_by_two()
    scaled = FrequencyResponse(frf.omega / scale, frf.values * scale, bound=frf.bound * scale, dt=0.1 * scale)
    np.testing.assert_array_equal(scaled.bound / scale, frf.bound)
    np.testing.assert_array_equal(scaled.freq_hz * scale, frf.freq_hz)
    scaled = TimeRecord(record.u, record.y * scale, bound=record.bound * scale, dt=record.dt * scale)
    np.testing.assert_array_equal(scaled.time / scale, record.time)
    np.testing.assert_array_equal(scaled.bound / scale, record.bound)


@pytest.mark.parametrize(
    ("low", "high", "words"),
    [
        (1.0, 1e4, "1 to 10000 Hz"),
        (1e3, 1e6, "1 to 1000 kHz"),
        (999.0, 1e6, "999 Hz to 1 MHz"),
        (5e5, 3e9, "500 kHz to 3 GHz"),
        (1e8, 3e9, "100 to 3000 MHz"),
        (0.0, 2e9, "0 to 2000 MHz"),
        (26.5e9, 40e12, "26.5 to 40000 GHz"),
    ],
)
def test_ranges_of_frequencies_are_said_in_the_unit_that_fits(low, high, words):
    assert hz_span(low, high) == words


@pytest.mark.parametrize(
    ("hz", "digits", "words"),
    [(97.25, 5, "97.25 Hz"), (22050.0, 5, "22050 Hz"), (22050.0, 4, "22.05 kHz"), (2.45e9, 5, "2.45 GHz"), (0.0, 5, "0 Hz"),
     (1e-7, 5, "1e-07 Hz"), (float("inf"), 5, "inf Hz")],
)  # fmt: skip
def test_a_frequency_is_said_without_a_power_of_ten(hz, digits, words):
    assert hz_words(hz, digits) == words
