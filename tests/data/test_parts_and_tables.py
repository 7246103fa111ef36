"""Slices, equality by value, and tables of measurements."""

import copy
import dataclasses
import importlib
import pickle

import numpy as np
import pytest

import robustid as rid
from robustid.errors import InputError, InputTypeError

pytestmark = pytest.mark.quick

OMEGA = np.arange(1.0, 6.0)
VALUES = np.arange(30).reshape(5, 2, 3) * (1 + 1j)
SCATTER = np.random.default_rng(0).standard_normal((5, 6, 6))
FRF = rid.FrequencyResponse(
    OMEGA,
    VALUES,
    bound=1 + VALUES.real,
    covariance=SCATTER @ SCATTER.swapaxes(1, 2),
    noise=VALUES.real,
    coherence=np.full((5, 2), 0.9),
    inputs=["a", "b", "c"],
    outputs=["x [m]", "y"],
)
RECORD = rid.TimeRecord(
    np.arange(20.0), np.arange(40.0).reshape(20, 2), dt=0.1, bound=0.5, inputs=["u [N]"], outputs=["x [m]", "y"]
)


def test_brackets_choose_points_outputs_and_inputs():
    assert FRF[1:3] == FRF.select(slice(1, 3))
    assert FRF[3].omega.tolist() == [4.0]
    assert FRF[OMEGA > 3].omega.tolist() == [4.0, 5.0]
    part = FRF[:2, "y", ["c", "a"]]
    np.testing.assert_array_equal(part.values, VALUES[:2, 1:, [2, 0]])
    np.testing.assert_array_equal(part.bound.radius, FRF.bound.radius[:2, 1:, [2, 0]])
    np.testing.assert_array_equal(part.covariance, FRF.covariance[:2][:, [[5], [1]], [5, 1]])
    np.testing.assert_array_equal(part.noise, FRF.noise[:2, 1:, [2, 0]])
    assert part.coherence.shape == (2, 1)
    assert [str(signal) for signal in (*part.outputs, *part.inputs)] == ["y", "c", "a"]
    assert FRF[:, 1, 2] == FRF.entry("y", "c")
    np.testing.assert_array_equal(FRF[:, :, 1].covariance, FRF.covariance[:, 2:4, 2:4])
    assert FRF[:] == FRF


def test_a_joint_bound_stays_where_all_entries_stay():
    joint = rid.FrequencyResponse(OMEGA, VALUES).with_column_bound(0.1)
    assert joint[1:].bound.joint == "column"
    assert joint[1:, 0].bound.joint == "entry"


@pytest.mark.parametrize(
    ("key", "sentence"),
    [
        (slice(9, 12), "selects none of the 5 frequency points"),
        ((slice(None), "z"), "`output` must be one of"),
        ((slice(None), 0, [1, 1]), "`input` must choose signals, each once"),
        ((slice(None), 0, 0, 0), "takes samples, outputs and inputs; got 4 parts"),
        ((slice(None), []), "`output` must choose signals"),
        (99, "doesn't select from 5 frequency points"),
    ],
)
def test_what_is_not_there_is_named(key, sentence):
    with pytest.raises(InputError, match=sentence):
        FRF[key]


def test_no_loop_goes_through_a_response_or_a_record():
    for thing in (FRF, RECORD):
        with pytest.raises(TypeError, match="not iterable"):
            list(thing)
        assert np.asarray(thing).shape == ()


def test_samples_of_a_record_begin_in_a_state_that_is_known_only_at_its_start():
    middle = RECORD[5:10]
    assert middle.initial == "free"
    assert middle.past_input_bound == 4.0
    assert middle.y[:, 0].tolist() == RECORD.y[5:10, 0].tolist()
    assert RECORD[:10].initial == "rest"
    assert len(RECORD[:10].u) == 10
    assert RECORD[:] == RECORD
    assert RECORD[:, "y"].outputs[0].name == "y"
    assert RECORD[-5:].y[0, 0] == 30.0
    steady = dataclasses.replace(RECORD, initial="periodic")
    assert steady[:10].initial == "free"
    for wrong in (3, slice(None, None, 2)):
        with pytest.raises(InputError, match=r"slice of neighbouring samples.*decimate"):
            RECORD[wrong]
    two = rid.TimeRecord(np.ones((9, 2)), np.ones(9), dt=1.0)
    with pytest.raises(InputError, match="other inputs of the record are not zero"):
        two[:, :, 0]


@pytest.mark.parametrize("thing", [FRF, RECORD, FRF.tangential(right=[1.0, 0.0, 0.0])])
def test_equal_values_are_equal_and_have_one_hash(thing):
    for same in (copy.deepcopy(thing), pickle.loads(pickle.dumps(thing)), dataclasses.replace(thing)):
        assert same == thing
        assert hash(same) == hash(thing)
        assert len({same, thing}) == 1
    changed = dataclasses.replace(thing, note="another")
    assert changed != thing
    assert thing != thing.with_bound(2.0)
    assert thing != "text"
    assert thing in [changed, thing]


def test_values_that_were_not_measured_are_equal_too():
    holes = np.where(np.arange(5) == 2, np.nan, 1.0)
    bound = np.where(np.arange(5) == 2, np.inf, 0.1)
    pair = [rid.FrequencyResponse(OMEGA, holes, bound=bound) for _ in range(2)]
    assert pair[0] == pair[1]


def test_rows_go_to_pandas_and_come_back():
    pandas = pytest.importorskip("pandas")
    single = FRF.entry(0, 0)
    frame = single.to_dataframe()
    assert frame.index.name == "frequency [Hz]"
    assert list(frame) == ["real", "imag", "bound"]
    again = rid.load(frame, kind="frequency", inputs=single.inputs, outputs=single.outputs)
    np.testing.assert_allclose(again.values, single.values)
    np.testing.assert_allclose(again.bound.radius, single.bound.radius)
    assert list(FRF.to_dataframe())[:3] == ["real x/a", "imag x/a", "bound x/a"]
    frame = RECORD.to_dataframe()
    assert list(frame) == ["u [N]", "x [m]", "y", "bound x", "bound y"]
    assert isinstance(frame, pandas.DataFrame)
    frame.iloc[0, 0] = 7.0  # a copy, which may be changed
    assert RECORD.u[0, 0] == 0.0


def test_without_pandas_a_sentence_says_what_to_install(monkeypatch):
    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(importlib, "import_module", missing)
    with pytest.raises(InputError, match="pip install pandas"):
        FRF.to_dataframe()


def test_signals_are_numbers_or_names():
    with pytest.raises(InputTypeError, match="`output` must be the number or name of a signal"):
        FRF[:, 1.5]
