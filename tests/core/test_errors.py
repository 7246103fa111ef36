"""Errors carry data: what is said in other surroundings is made from them, not from their sentence."""

import copy
import pickle

import pytest

from robustid import errors
from robustid.app.cli.screen import in_words
from robustid.app.run.checks import too_large
from robustid.app.run.reading import in_options, in_run_file
from robustid.errors import FileFormatError, InputError, Remedy, SizeError

pytestmark = pytest.mark.quick

FIELDS = Remedy({"fields": {"u": "a b", "y": ["p", "q"]}, "axes": "signal,time", "frequency_unit": "Hz"})


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, lambda error: pickle.loads(pickle.dumps(error))])
def test_copies_keep_the_data(copied):
    error = copied(InputError("`u`: give ", FIELDS, ".", argument="u", got=3, place="a.csv"))
    assert (error.argument, error.got, error.place, error.remedy) == ("u", 3, "a.csv", FIELDS.arguments)
    assert str(error) == '`u`: give `fields={"u": "a b", "y": ["p", "q"]}, axes="signal,time", frequency_unit="Hz"`.'
    assert error.args == (str(error),)


def test_every_kind_of_error_takes_parts():
    names = ("RobustIdError", "InputError", "FileFormatError", "DatasetNotFoundError", "SolverError", "SizeError")
    kinds = [getattr(errors, name) for name in names]
    assert {str(kind("a ", Remedy({"dt": 1.0}))) for kind in kinds} == {"a `dt=1.0`"}
    assert (InputError("a").remedy, str(InputError())) == ({}, "")


def test_a_remedy_in_the_words_of_the_surroundings():
    assert in_run_file(FIELDS) == '`fields = { u = "a b", y = ["p", "q"] }; axes = "signal,time"; unit = "Hz"`'
    options = "--time-field 'u=a b' --time-field y=p --time-field y=q --axes signal,time --frequency-unit Hz"
    assert in_options(FIELDS, "time") == options
    assert in_options(Remedy({"omega": 3.0}, "3 rad/s"), "time") == "3 rad/s"


def test_names_are_looked_up_and_others_stay():
    error = InputError("`order` and `tol`, as `order`; got 'order'")
    assert error.said({"order": "--order"}) == "--order and `tol`, as --order; got 'order'"
    assert error.said({"order": "--order"}, unknown=str) == "--order and tol, as --order; got 'order'"
    with pytest.raises(InputError, match=r"^--order and `tol`"), in_words({"order": "--order"}):
        raise error


def test_a_place_is_said_once():
    error = FileFormatError("no numbers").at("a.csv")
    assert str(error.at("b.csv")) == "a.csv: no numbers"
    assert str(FileFormatError("a.csv is empty", place="a.csv").at("a.csv")) == "a.csv is empty"


def test_too_large_data_are_made_smaller_in_the_words_of_the_program():
    with pytest.raises(SizeError) as caught, too_large("--first N"):
        raise SizeError("`problem` has 9 coefficients; up to 3 are possible. ", Remedy({}, 'Use form="taylor"'))
    words = "the problem has 9 coefficients; up to 3 are possible. Use a part of the data: --first N"
    assert str(caught.value) == words
