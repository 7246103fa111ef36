"""The pages of one run file: entries of a matrix, and members of a family, whose choices become one run file."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.app.explore.callbacks import write_run_file
from robustid.app.run.run_file import read_run_file
from robustid.errors import InputError
from support.explored import pages, quiet

DATA = rid.datasets.flexible_structure(seed=0, lines=5, samples=4, extra_hz=[17.4, 17.6, 17.8]).frequency
CLASS = """[prior]
gain_bound = 0.2
decay_rate = 1.1
[worst_case]
at_hz = [5.0]
directions = 4
[small_model]
time_limit = 0.1
"""
MODES = "[modes]\nhz = [9.0, 17.67]\ndamping = [0.1, 0.004]\n"
FAMILY = """[[members]]
name = "light"
hz = [9.0, 17.67]
damping = [0.1, 0.004]
[[members]]
name = "heavy"
[[frequency]]
file = "light.csv"
member = "light"
[[frequency]]
file = "heavy.csv"
member = "heavy"
"""


def test_every_entry_of_a_matrix_has_a_page_and_a_run_file_of_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scale = np.array([[1.0, 0.5], [0.25, -1.0]])
    matrix = dataclasses.replace(DATA, values=DATA.values * scale, bound=0.03, inputs=["a", "b"], outputs=["c", "d"])
    rid.save("matrix.npz", matrix)
    (tmp_path / "ask.toml").write_text('[[frequency]]\nfile = "matrix.npz"\n' + MODES + CLASS)
    every = pages(tmp_path / "ask.toml")
    assert [one.name for one in every] == ["c / a", "c / b", "d / a", "d / b"]
    one = every[2].open(quiet)
    assert np.array_equal(one.data.responses[0].values[:, 0, 0], matrix.values[:, 1, 0])
    choice = dataclasses.replace(one.start, gain_bound=0.3, left_out_hz=(6.0,))
    write_run_file(one, choice, "explored.toml")
    (again,) = pages(tmp_path / "explored.toml")
    assert again.open(quiet).start == choice
    assert repr(again.open(quiet).problem(choice)[0]) == repr(one.problem(choice)[0])


@pytest.fixture(name="family")
def _family(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rid.save("light.csv", DATA)
    rid.save("heavy.csv", dataclasses.replace(DATA, values=0.99 * DATA.values))
    return tmp_path / "ask.toml"


def test_the_pages_of_a_family_write_one_run_file_of_all_members(family, tmp_path):
    family.write_text(FAMILY + MODES + CLASS)
    every = pages(family)
    assert [one.name for one in every] == ["light", "heavy"]
    light, heavy = (one.open(quiet) for one in every)
    softer = dataclasses.replace(light.start, hz=(9.05, 17.67), rate=1.08)
    wider = dataclasses.replace(heavy.start, gain_bound=0.3, left_out_hz=(6.0,))
    light.note(softer)
    heavy.note(wider)
    write_run_file(heavy, wider, "explored.toml")
    again = read_run_file("explored.toml")
    assert [one.hz for one in again.members] == [(9.05, 17.67), (9.0, 17.67)]
    assert (again.prior.gain_bound, again.prior.decay_rate) == (0.3, 1.08)  # the class that holds both
    assert again.frequency_points.leave_out_hz == (6.0,)
    assert [one.file for one in again.frequency] == ["light.csv", "heavy.csv"]
    # A larger class with fewer lines: no margin is larger than on its page.
    result = rid.run("explored.toml", tmp_path / "out")
    for name, page, choice in (("light", light, softer), ("heavy", heavy, wider)):
        assert result.identifications[name].margin_lower <= rid.identify(page.problem(choice)[0]).margin
    more = dataclasses.replace(heavy.start, hz=(9.0, 17.67, 20.0), damping=(0.1, 0.004, 0.01))
    with pytest.raises(InputError, match="light has 2, this page 3"):
        write_run_file(heavy, more, "more.toml")


def test_a_member_whose_modes_nothing_states_is_opened_before_a_run_file_is_written(family):
    family.write_text(FAMILY + CLASS)
    light, heavy = pages(family)
    first = light.open(quiet)
    with pytest.raises(InputError, match="open the page of heavy first"):
        write_run_file(first, first.start, "explored.toml")
    second = heavy.open(quiet)
    assert len(second.start.hz) == 2  # as many as the other page has
    write_run_file(first, first.start, "explored.toml")
    assert read_run_file("explored.toml").members[1].hz == second.start.hz
