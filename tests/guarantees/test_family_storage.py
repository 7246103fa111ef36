"""Saved families: exact, verified again, refused once they are forged."""

import numpy as np
import pytest

import robustid as rid
from robustid.errors import FileFormatError
from support.families import DT, identified
from support.forging import forge


@pytest.fixture(scope="module")
def two():
    members = [rid.Member(identified(g, seed=k), load=g, date=f"2026-11-0{k + 1}") for k, g in enumerate((0.8, 1.0))]
    return rid.family(members, omega=[2.0, 9.0, np.pi / DT], directions=4)


def test_round_trip(two, tmp_path):
    two.save(tmp_path / "a")
    again = rid.load(tmp_path / "a")
    assert again.summary() == two.summary()
    assert np.array_equal(again.upper, two.upper)
    assert np.array_equal(again.centres.radius, two.centres.radius)
    assert [m.condition for m in again.members] == [m.condition for m in two.members]
    assert (again.schedule, again.interval, again.tried) == (two.schedule, two.interval, two.tried)
    assert again.certified


def test_a_bound_on_the_circle_survives(two, tmp_path):
    circle = two.on_circle(1.0)
    rid.save(tmp_path / "a", two)
    again = rid.load(tmp_path / "a")
    assert all(error.known_circle is not None for error in again.errors)
    assert np.array_equal(again.circle.bound, circle.bound)


@pytest.mark.parametrize("change", [{"members": []}, {"interval": [1]}, {"tried": 3}])
def test_edited_text_is_refused(two, tmp_path, change):
    two.save(tmp_path / "a")
    forge(tmp_path / "a", text=lambda record: record.update(change))
    with pytest.raises(FileFormatError):
        rid.load(tmp_path / "a")
