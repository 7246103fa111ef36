"""The page that is explored, but for the browser: choices, the thread that computes, pictures and words."""

import dataclasses
import threading

import numpy as np
import pytest

import robustid as rid
from robustid.app.explore.callbacks import added, compared, most_missed_hz, removed, write_run_file
from robustid.app.explore.quantities import choice_of, mode_names, quantities
from robustid.app.explore.worker import Worker, glance
from robustid.errors import InputError
from robustid.guarantees import growing_error
from robustid.report import live_figure, live_numbers, live_words, look_figure, look_words
from support.explored import opened, run_file, session, until

pytest.importorskip("dash")


@pytest.fixture(name="explored", scope="module")
def _explored(tmp_path_factory):
    return session(tmp_path_factory.mktemp("explored"))


def test_lines_are_left_out_by_words_and_the_words_come_back(explored):
    assert explored.points_hz.tolist() == [1, 6, 11, 16, 17.4, 17.6, 17.8, 21]
    assert explored.points("17.4:18, 1") == (1.0, 17.4, 17.6, 17.8)
    assert explored.words((1.0, 17.4, 17.6, 17.8)) == "1, 17.4:17.8"
    assert explored.points("") == ()
    for words, sentence in (
        ("many", "give frequencies in Hz"),
        ("12", "no response has a frequency point at 12 Hz"),
        ("2:3", "no frequency points from 2 to 3 Hz"),
    ):
        with pytest.raises(InputError, match=sentence):
            explored.points(words)


def test_fields_without_a_sensible_number_name_themselves(explored):
    every = quantities(explored)
    modes = mode_names(explored)
    assert modes[:4] == ["hz-0", "damping-0", "hz-1", "damping-1"]
    assert [one.name for one in every] == [*modes, "gain", "rate"]
    values = [2, *(one.shown for one in every)]
    assert choice_of(explored, every, [*values, None]) == explored.start
    for place, wrong, sentence in (
        (1, None, "Mode 1, frequency .Hz.: give a number above 0"),
        (4, 4.0, "Mode 2, damping ratio: give a number above 0 and at most 1; got 4"),
        (len(values) - 1, 0.9, "decay rate ρ: give a number above 1"),
    ):
        changed = [*values[:place], wrong, *values[place + 1 :], ""]
        with pytest.raises(InputError, match=sentence):
            choice_of(explored, every, changed)


def test_a_mode_is_added_where_the_model_misses_the_data_most_and_removed_again(explored):
    every = quantities(explored)
    modes, rest = [one.shown for one in every[:-2]], [one.shown for one in every[-2:]]
    with pytest.raises(InputError, match="wait for the margin"):
        added(None, 2, modes)
    alone = removed(1, 2, modes)
    choice = choice_of(explored, every, [*alone, *rest, ""])
    assert (choice.hz, choice.damping) == ((9.0,), (0.1,))
    result = rid.identify(explored.problem(choice)[0])
    assert result.margin > 1
    assert 17 < most_missed_hz(result) < 18.5  # the mode that is not there is at 17.67 Hz
    again = added(result, *split(alone))
    choice = choice_of(explored, every, [*again, *rest, ""])
    assert choice.hz == (9.0, most_missed_hz(result))
    assert rid.identify(explored.problem(choice)[0]).margin < result.margin
    none = removed(0, *split(alone))
    choice = choice_of(explored, every, [*none, *rest, ""])
    assert choice.hz == ()
    problem, _ = explored.problem(choice)
    assert problem.parametric is None
    # A mode between two moves up, and what is free stays free.
    first = removed(0, 2, modes)
    assert first == [1, 17.67, 0.004, *modes[4:], 9.0, 0.1]


def split(fields):
    """The number of modes, and their fields."""
    return fields[0], fields[1:]


def test_a_choice_is_written_as_a_run_file_that_poses_the_same_problem(explored, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there").mkdir()
    choice = dataclasses.replace(explored.start, hz=(9.1, 17.6), gain_bound=0.3, left_out_hz=(6.0, 17.8))
    problem, _ = explored.problem(choice)
    assert [f.omega.size for f in problem.frequency] == [6]
    path = write_run_file(explored, choice, "there/mine.toml")
    again = opened(path)
    assert again.start == choice
    assert repr(again.problem(again.start)[0]) == repr(problem)
    assert rid.identify(again.problem(choice)[0]).margin == rid.identify(problem).margin
    for name, sentence in (
        ("mine.txt", "ends in .toml"),
        ("there/mine.toml", "exists"),
        ("no/x.toml", "does not exist"),
    ):
        with pytest.raises(InputError, match=sentence):
            write_run_file(explored, choice, name)


def test_modes_that_are_moved_are_those_of_no_fit_and_of_no_box(tmp_path):
    path = run_file(tmp_path)
    _, rest = path.read_text().split("[modes]")
    boxes = "hz_interval = [[8.9, 9.1], [17.6, 17.7]]\ndamping_interval = [[0.09, 0.11], [0.003, 0.005]]\n"
    whole = path.read_text().replace("compute = false", "over_poles = true").replace("[prior]", boxes + "[prior]")
    fitted = path.read_text().split("[modes]")[0] + "[fit]\norder = 4\n[prior]" + rest.split("[prior]")[1]
    for text in (whole, fitted):
        path.write_text(text)
        one = opened(path)
        moved = dataclasses.replace(one.start, hz=(9.05, 17.6))
        for choice in (one.start, moved):
            path.write_text(one.stated(choice).text())
            again = opened(path)
            assert repr(again.problem(again.start)) == repr(one.problem(choice))
            assert again.run.modes.hz == choice.hz


def test_frequency_points_that_are_left_out_are_none_of_a_run_and_must_be_there(explored, tmp_path):
    path = run_file(tmp_path, more="[frequency_points]\nleave_out_hz = [6.0, 21.0]\n")
    result = rid.run(path, tmp_path / "out")
    assert result.identification.problem.frequency[0].freq_hz.max() == pytest.approx(17.8)
    assert result.withheld is None
    for hz, sentence in (([12.0], "no response has a frequency point at 12 Hz"), (explored.points_hz, "leave one in")):
        path.write_text(run_file(tmp_path).read_text() + f"[frequency_points]\nleave_out_hz = {list(map(float, hz))}\n")
        with pytest.raises(InputError, match=sentence):
            rid.run(path, tmp_path / "none")


def test_the_error_of_a_watched_computation_is_the_guaranteed_one(explored):
    result = rid.identify(explored.problem(explored.start)[0])
    omega, sides = np.array([20.0, 60.0, 111.0]), []
    found = list(growing_error(result, omega, directions=4, gap=0.01, progress=lambda _, *one: sides.append(one)))
    assert [one.omega.size for one in found] == [1, 2, 3]
    assert sides == [(k, 12) for k in range(1, 13)]
    whole = rid.worst_case_error(result, omega=omega, directions=4)
    assert np.allclose(found[-1].upper, whole.upper, rtol=1e-6)
    assert found[-1].certified
    # Nothing is drawn between them: that is what the band is for.
    parts = [live_figure(result, one)["data"] for one in found]
    assert not any(trace.get("fill") for part in parts for trace in part)
    assert live_words(result, found[0])[2].startswith("Every plant that agrees")


def with_box(folder):
    """The page of modes with the intervals that data left of them."""
    path = run_file(folder)
    boxes = "hz_interval = [[8.9, 9.1], [17.6, 17.7]]\ndamping_interval = [[0.09, 0.11], [0.003, 0.005]]\n"
    path.write_text(path.read_text().replace("[prior]", boxes + "[prior]"))
    return opened(path)


def test_a_look_proves_a_band_over_the_box_until_a_mode_is_moved(tmp_path):
    one = with_box(tmp_path)
    moved = dataclasses.replace(one.start, hz=(9.05, 17.67))
    stiffer = dataclasses.replace(one.start, gain_bound=0.25)  # no mode is moved
    for choice, words in (
        (one.start, "anywhere in their box"),
        (stiffer, "anywhere in their box"),
        (moved, "taken as exact"),
    ):
        found = glance(one, choice)
        assert (found.band.box is None) == (choice == moved)
        assert found.band.certified
        omega, truth = np.linspace(0.5, 300.0, 200), true_response()
        centre, radius = found.band.at(omega)
        if choice != moved:
            assert np.all(np.abs(truth(omega) - centre[:, 0, 0]) <= radius[:, 0, 0])
        whole = rid.band(found.check.problem, box=found.band.box, omega=[1.0])
        ratio = radius / whole.at(omega)[1]
        assert np.median(ratio) < 1.1
        assert ratio.max() < 1.6
        assert f"proved band, poles {words}" in names(look_figure(found.check, found.band))


def true_response():
    """The plant that the data are of."""
    model = rid.datasets.flexible_structure(seed=0, lines=5, samples=4, extra_hz=[17.4, 17.6, 17.8]).truth
    return lambda omega: model(np.exp(1j * omega * model.dt))


def names(figure):
    return [trace["name"] for trace in figure["data"]]


def test_a_look_at_a_contradiction_draws_no_band_and_says_why(explored):
    far = glance(explored, dataclasses.replace(explored.start, hz=(6.0, 17.67)))
    assert far.band is None
    margin = rid.identify(far.check.problem).margin
    assert 1 < far.check.margin <= margin
    key, verdict, guarantee = look_words(far.check)
    assert key == "inconsistent"
    assert verdict.startswith("Inconsistent, margin at least")
    assert guarantee.startswith("No band is drawn")
    figure = look_figure(far.check)
    assert "contradicted by the others" in names(figure)
    assert not any(trace.get("fill") for trace in figure["data"])


def test_the_state_of_the_page_holds_the_band_before_and_after_the_margin(explored):
    worker, near = Worker(explored), dataclasses.replace(explored.start, hz=(9.05, 17.67))
    try:
        worker.ask(near)
        until(lambda: worker.found.look is not None and worker.found.look.choice == near)
        first = look_figure(worker.found.look.check, worker.found.look.band)
        until(lambda: worker.found.band is not None)
        found = worker.found
        assert found.band.model is found.identification.model
        own = rid.band(found.look.check.problem, knots=400)
        omega = np.linspace(0.5, 300.0, 50)
        assert np.array_equal(found.band.at(omega), own.at(omega))
        second = live_figure(found.identification, None, found.band)
        for figure, error in ((first, "radius of the band"), (second, "proved error")):
            assert {"proved band, poles taken as exact", f"{error}, poles taken as exact"} <= set(names(figure))
        assert live_words(found.identification, None, found.band)[2].startswith("Proved at every frequency")
        worker.ask(dataclasses.replace(near, hz=(6.0, 17.67)))
        until(lambda: not worker.found.doing)
        assert worker.found.band is None
    finally:
        worker.close()


def test_a_choice_that_is_kept_stays_beside_the_newest_one(explored):
    worker, near = Worker(explored), dataclasses.replace(explored.start, hz=(9.05, 17.67))
    try:
        with pytest.raises(InputError, match="wait for it"):
            worker.keep()
        worker.ask(explored.start)
        until(lambda: worker.found.band is not None)
        worker.keep()
        kept = worker.kept
        assert worker.found.number > kept.number  # the page draws it
        worker.ask(near)
        until(lambda: worker.found.band is not None)
        found = worker.found
        assert (kept.choice, found.choice) == (explored.start, near)
        (table,) = compared(explored, kept, found)
        rows = {
            cells[0]: cells[1:]
            for cells in ([cell.children for cell in row.children] for row in table.children[1].children)
        }
        assert rows["modes [Hz] (damping)"] == ["9 (0.1), 17.67 (0.004)", "9.05 (0.1), 17.67 (0.004)"]
        assert rows["gain bound K"] == ["0.2", "0.2"]
        margins = [live_numbers(one.identification, one.band)[0][1] for one in (kept, found)]
        assert rows["margin"] == margins
        assert margins[0] != margins[1]
        errors = [float(words.split()[0]) for words in rows["proved error, largest"]]
        assert errors == pytest.approx([one.band.hinf for one in (kept, found)], rel=1e-3)
        figure = live_figure(found.identification, None, found.band, kept=kept.band)
        line = next(one for one in figure["data"] if one["name"] == "kept choice: proved error")
        own = live_figure(kept.identification, None, kept.band)
        before = next(one for one in own["data"] if one["name"].startswith("proved error"))
        assert np.array_equal(line["y"], before["y"])
        worker.forget()
        assert compared(explored, worker.kept, worker.found) == []
    finally:
        worker.close()


def test_while_a_mode_is_dragged_every_look_that_was_begun_is_shown(explored, monkeypatch):
    begun, may_end = threading.Event(), threading.Event()

    def slow(session, choice):
        begun.set()
        assert may_end.wait(30)
        return glance(session, choice)

    monkeypatch.setattr("robustid.app.explore.worker.glance", slow)
    worker = Worker(explored)
    first, second = (dataclasses.replace(explored.start, hz=(hz, 17.67)) for hz in (9.05, 9.1))
    looks = []
    try:
        worker.ask(first)
        assert begun.wait(30)
        worker.ask(second)
        may_end.set()
        until(lambda: looks.append(worker.found) or worker.found.identification is not None)
        seen = [one.look.choice for one in looks if one.look is not None]
        assert set(seen) == {first, second}
        assert all(one.choice == second for one in looks)
    finally:
        worker.close()


def test_the_newest_choice_is_computed_and_can_be_cancelled(explored):
    worker = Worker(explored)
    far, near = (dataclasses.replace(explored.start, hz=(hz, 17.67)) for hz in (6.0, 9.0))
    try:
        worker.ask(far)
        worker.ask(near)
        until(lambda: worker.found.error is not None)
        assert worker.found.choice == near
        assert worker.found.doing
        worker.cancel()
        assert worker.found.cancelled
        assert worker.found.error is not None  # what is proved stays
        worker.ask(far)
        until(lambda: not worker.found.doing)
        assert worker.found.identification.margin > 1
        assert "carry the proof: response at" in live_words(worker.found.identification)[2]
        worker.ask(dataclasses.replace(far, left_out_hz=(12.0,)))
        until(lambda: worker.found.trouble)
        assert "no response has a frequency point at 12 Hz" in worker.found.trouble
    finally:
        worker.close()
