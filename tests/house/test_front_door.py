"""The front door: help by task, and names of other programs that lead to the right one."""

import subprocess
import sys

import pytest

import robustid as rid

pytestmark = pytest.mark.quick


def test_help_lists_names_by_task_and_they_exist():
    words = {word.strip(",;.") for word in rid.__doc__.split()}
    named = words & set(rid.__all__)
    assert len(named) > 45
    assert {"load", "identify", "diagnose", "worst_case_error", "fit_mfd", "save", "plot"} <= named


@pytest.mark.parametrize(("typed", "meant"), sorted(rid._MEANT.items()))
def test_names_of_other_programs_lead_to_the_right_one(typed, meant):
    thing = rid
    for part in meant.split("."):
        thing = getattr(thing, part)
    assert callable(thing)
    with pytest.raises(AttributeError, match=f"robustid.{meant} is what you look for"):
        getattr(rid, typed)


def test_a_slip_of_the_pen_is_named_and_nothing_is_invented():
    with pytest.raises(AttributeError, match=r"robustid\.identify is what you look for"):
        getattr(rid, "indentify")  # noqa: B009 - a name that is not there
    with pytest.raises(AttributeError, match=r"help\(robustid\) lists them by task"):
        getattr(rid, "xyzzy")  # noqa: B009
    assert not hasattr(rid, "__wrapped__")


def test_extras_stand_in_the_help_of_commands():
    done = subprocess.run(
        [sys.executable, "-m", "robustid", "verify", "--help"], capture_output=True, text=True, check=True
    )
    assert "robustid[exact]" in " ".join(done.stdout.split())
