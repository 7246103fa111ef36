"""A run file with `split`: every entry or column of a matrix is a run of its own; what is too large is refused at once."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import robustid as rid
from robustid.app.run import fleet, split
from robustid.app.run.fleet_item import Kept
from robustid.app.run.run_file import read_run_file
from robustid.errors import InputError, SizeError
from robustid.guarantees import FleetRow, FleetState
from support.fleets import numbers
from support.interrupts import ctrl_c
from support.run_files import CLASS, QUICK, ask


@pytest.fixture
def matrix(tmp_path):
    """A run file of two outputs and one input, with named signals."""
    one = rid.datasets.flexible_structure(lines=5, samples=4).frequency
    values = one.values * np.array([[[1.0], [-0.5]]])
    bound = one.bound.outer_radius * np.array([[[1.0], [0.5]]])
    rid.save(
        tmp_path / "g.npz", rid.FrequencyResponse(one.omega, values, bound=bound, dt=one.dt, outputs=["tip", "root"])
    )
    return ask(tmp_path, {"split": "entries", "frequency": [{"file": "g.npz"}], **CLASS, **QUICK}, name="beam.toml")


@pytest.mark.usefixtures("unreduced")
def test_every_entry_is_a_run_as_if_it_were_asked_alone(tmp_path, matrix):
    items = fleet.items_of([matrix], tmp_path / "out")
    assert [one.name for one in items] == ["beam-0-0", "beam-1-0"]
    with ThreadPoolExecutor(1) as executor:
        found = fleet.run_fleet(items, tmp_path / "out", executor, tmp_path / "out" / fleet.TABLE, thing="entry")
    assert found.states == {FleetState.CONSISTENT: 2}
    assert found.verdict == "Of 2 entries 2 consistent."
    page = (tmp_path / "out" / fleet.PAGE).read_text(encoding="utf-8")
    words = page[page.index("<body") : page.index("<script")]
    assert "a row for every entry" in words
    assert "machine" not in words.lower()
    assert "One controller for all" not in words
    assert "root / u" in (tmp_path / "out" / "beam-1-0" / "report.html").read_text(encoding="utf-8")
    alone = {"entry": [1, 0], "frequency": [{"file": "g.npz"}], **CLASS, **QUICK}
    rid.run(ask(tmp_path, alone, name="alone.toml"), tmp_path / "alone")
    assert numbers(tmp_path / "out" / "beam-1-0") == numbers(tmp_path / "alone")
    again = fleet.items_of([matrix], tmp_path / "out")
    assert again == items
    assert [fleet.run_item(one)[1] for one in again] == [0.0, 0.0]  # nothing is run twice


@pytest.mark.usefixtures("threads", "unreduced")
def test_every_column_is_a_run_of_all_outputs_of_one_input(tmp_path, run):
    one = rid.datasets.flexible_structure(lines=5, samples=4).frequency
    shape = np.array([[1.0, 0.4], [-0.5, 0.2]])
    bound = one.bound.outer_radius * np.abs(shape)
    rid.save(
        tmp_path / "g.npz",
        rid.FrequencyResponse(
            one.omega, one.values * shape, bound=bound, dt=one.dt, outputs=["tip", "root"], inputs=["left", "right"]
        ),
    )
    content = {"frequency": [{"file": "g.npz"}], **CLASS, **QUICK}
    asked = ask(tmp_path, {"split": "columns", **content}, name="beam.toml")
    code, out, _ = run(["run", asked, "-o", tmp_path / "out"])
    assert code == 0
    assert "2 runs, each with a time_limit of 300 s: " in out
    assert "All consistent" in out
    page = (tmp_path / "out" / fleet.PAGE).read_text(encoding="utf-8")
    assert "Columns of a matrix" in page
    found = rid.load(tmp_path / "out" / "beam-1" / "identification").problem
    assert ([str(one) for one in found.outputs], [str(one) for one in found.inputs]) == (["tip", "root"], ["right"])
    rid.run(ask(tmp_path, {"column": "right", **content}, name="alone.toml"), tmp_path / "alone")
    assert numbers(tmp_path / "out" / "beam-1") == numbers(tmp_path / "alone")


def test_one_run_is_no_matrix_of_runs_and_one_entry_not_all(tmp_path, matrix):
    with pytest.raises(InputError, match="on the command line: robustid run beam"):
        rid.run(matrix, tmp_path / "out")
    both = ask(tmp_path, {"split": "entries", "entry": [0, 0], "frequency": [{"file": "g.npz"}]}, name="both.toml")
    with pytest.raises(InputError, match="entry is one, split is all of them"):
        split.split_files(both, tmp_path / "out")
    column = ask(tmp_path, {"split": "columns", "column": 0, "frequency": [{"file": "g.npz"}]}, name="column.toml")
    with pytest.raises(InputError, match="column is one, split is all of them"):
        split.split_files(column, tmp_path / "out")
    with pytest.raises(InputError, match="entry is one of a column"):
        read_run_file(ask(tmp_path, {"entry": [0, 0], "column": 0, "frequency": [{"file": "g.npz"}]}))
    with pytest.raises(InputError, match=r"column = 3 is the number or name of an input: .*3"):
        rid.run(ask(tmp_path, {"column": 3, "frequency": [{"file": "g.npz"}]}, name="c.toml"), tmp_path / "c")


def test_entries_that_were_not_reached_are_named_and_many_shortened(tmp_path):
    """As after Ctrl-C: the others have no row."""
    items = [fleet.Item(f"m-{k}-0", "m.toml", str(tmp_path / f"m-{k}-0"), force=False, static=False) for k in range(14)]
    rows = [FleetRow(one.name, FleetState.CONSISTENT, "") for one in items[:2]]
    for row in rows:
        Kept(row, "").write(tmp_path / row.name)
    with ThreadPoolExecutor(1) as executor, pytest.MonkeyPatch.context() as patch:
        patch.setattr(fleet, "run_item", ctrl_c)
        found = fleet.run_fleet(items, tmp_path, executor, tmp_path / fleet.TABLE, thing="entry")
    assert found.left == tuple(one.name for one in items[2:])
    said = f"Not run yet: {', '.join(found.left[:10])} and 2 more."
    assert said in found.summary()
    assert said in (tmp_path / fleet.PAGE).read_text(encoding="utf-8")


def test_the_time_is_said_before_any_is_done_and_from_those_that_are(tmp_path):
    asked = ask(tmp_path, {"time_limit": 60.0, "frequency": [{"file": "g.npz"}]}, name="m.toml")
    items = [
        fleet.Item(f"m-{k}-0", str(asked), str(tmp_path / f"m-{k}-0"), force=False, static=False) for k in range(21)
    ]
    said = "21 runs, each with a time_limit of 60 s: 11 min at most, on 2 processes"
    assert split.time_words(items, 2) == said
    Kept(FleetRow("m-0-0", FleetState.CONSISTENT, "", seconds=12.0), "").write(tmp_path / "m-0-0")
    assert split.time_words(items, 2) == "20 of 21 are left, one took 12 s: about 2 min, on 2 processes"
    Kept(FleetRow("m-1-0", FleetState.CONSISTENT, "", seconds=1812.0), "").write(tmp_path / "m-1-0")
    said = "19 of 21 are left, 2 took in the median 912 s: about 4.8 h, divided by the number of workers"
    assert split.time_words(items, None) == said


def test_a_matrix_that_no_memory_holds_is_refused_before_its_modes_are_looked_for(tmp_path):
    large = rid.FrequencyResponse(np.linspace(10.0, 300.0, 20), np.ones((20, 100, 13)), bound=0.1, dt=0.01)
    rid.save(tmp_path / "large.npz", large)
    with pytest.raises(
        SizeError, match=r"1300 entries and 26000 samples: .* 1.1 GB.* or split = .entries. for a run of each"
    ):
        rid.run(ask(tmp_path, {"frequency": [{"file": "large.npz"}]}), tmp_path / "out")
