"""The front door: help by task, and names of other programs that lead to the right one."""

import pydoc
import subprocess
import sys

import pytest

import robustid as rid
from robustid.spellings import MEANT

pytestmark = pytest.mark.quick


def test_help_is_one_page_that_lists_every_name_by_task():
    words = {word.strip(",;.:") for word in rid.__doc__.replace("robustid.", "").split()}
    assert set(dir(rid)) - {"Identification", "__version__"} <= words
    assert len(pydoc.plain(pydoc.render_doc(rid)).splitlines()) < 120
    assert len(dir(rid)) < 60


@pytest.mark.parametrize("group", rid._GROUPS)
def test_names_of_a_group_are_its_own_and_found_from_the_front_door(group):
    module = getattr(rid, group)
    for name in module.__all__:
        assert getattr(module, name) is not None
        if name not in dir(rid) and hasattr(getattr(module, name), "__doc__") and group not in ("datasets", "errors"):
            with pytest.raises(AttributeError, match=f"robustid.{group}.{name} is what you look for"):
                getattr(rid, name)


@pytest.mark.parametrize(("typed", "meant"), sorted(MEANT.items()))
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
