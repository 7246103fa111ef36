"""Runs that end before their end: a Ctrl-C that a loop keeps back, and time that is over; the first line says so."""

import dataclasses
import html
import re
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import robustid as rid
from robustid.advice import kept_gains
from robustid.advice.smallest_gain import smallest_gain
from robustid.app.cli import screen
from robustid.app.run import sequence
from robustid.app.run.run_file import RunFile
from robustid.app.run.run_folder import Surroundings
from robustid.app.run.work import Work
from robustid.core import Budget, Interruptible, Stops, Unfinished
from support.command_line import CLASS, COMMAND
from support.interrupts import ctrl_c, ctrl_c_when
from support.run_files import CLASS as STATED
from support.run_files import DATA, QUICK, ask


def first_screen(page):
    """Words before the first figure of a page, and where its first verdict begins in them."""
    text = page.read_text(encoding="utf-8")
    text = text[text.index('aria-label="At a glance"') : text.index("<figure")]
    before, after = (html.unescape(re.sub(r"<[^>]+>", " ", part)) for part in text.split('<section class="verdict', 1))
    return before, after


def test_a_listener_hears_of_ctrl_c_that_a_loop_keeps_back():
    heard, deaf = Stops(), Stops()
    with heard.listening(), Interruptible():
        raise KeyboardInterrupt
    assert heard.interrupted
    assert not deaf.interrupted
    assert heard.unfinished.word == "Interrupted"
    with deaf.listening(), pytest.raises(KeyboardInterrupt), Interruptible(lambda: False):
        raise KeyboardInterrupt
    assert deaf.unfinished is None


def stopping(monkeypatch, holds):
    """Ctrl-C where the command says a step for which `holds(text, done, count)`."""
    told, stop = screen.told, ctrl_c_when(holds)

    def telling(*options):
        own = told(*options)
        return lambda *step: (own(*step), stop(*step))

    monkeypatch.setattr(screen, "told", telling)


def test_an_interrupted_command_exits_with_130_and_its_page_says_so_first(files, run, monkeypatch):
    with monkeypatch.context() as patch:
        stopping(patch, lambda text, done, count: count and "smallest order" in text)
        code, out, err = run([*COMMAND, *CLASS, "-o", "first", "--report", "first.html"])
    assert code == 130
    assert "interrupted: what was found by then is written" in err
    words = " ".join((out + err).split())
    assert words.index("Interrupted: Ctrl-C ended it before its end") < words.index("Consistent")
    assert "resume" not in words  # which this command has not
    assert rid.load("first").consistent
    assert "written: first.npz, first.json, first-band.npz, first-band.json, first.html" in words
    said = "Interrupted: Ctrl-C ended it before its end: what stands here was found by then"
    before, after = first_screen(files / "first.html")
    assert said in " ".join(before.split())
    assert "Consistent" in after
    said = "Interrupted: Ctrl-C ended the identification before its end: what stands here was found by then"
    again = rid.load("first")
    assert again.choices["unfinished"].value == Unfinished((), True, run="the identification")
    again.save("copied")  # and it stays with what is kept
    assert run(["report", "copied", "--no-reduce", "-o", "copied.html"])[0] == 0
    assert said in " ".join(first_screen(files / "copied.html")[0].split())


def test_ctrl_c_while_the_page_is_drawn_loses_the_page_alone(files, run, monkeypatch):
    with monkeypatch.context() as use:
        use.setattr("robustid.report.render_report", ctrl_c)
        code, out, err = run([*COMMAND, *CLASS, "-o", "drawn", "--no-reduce", "--report", "drawn.html"])
    assert code == 130
    assert "next, the page, which Ctrl-C has left out: robustid report drawn -o drawn.html" in " ".join(
        (out + err).split()
    )
    assert not (files / "drawn.html").exists()
    assert run(["report", "drawn", "--no-reduce", "-o", "drawn.html"])[0] == 0
    before, _ = first_screen(files / "drawn.html")
    assert "Interrupted" not in before  # the identification came to its end


def test_a_sweep_that_ended_before_its_end_says_so_first(folder, run):
    assert run([*COMMAND, *CLASS, "-o", "swept", "--no-reduce"])[0] == 0
    result = rid.load("swept")
    error = rid.worst_case_error(result, omega=[10.0, 20.0, 30.0], directions=3)
    rid.write_report(result, "whole.html", worst_case=error)
    assert "unfinished" not in first_screen(folder / "whole.html")[0].lower()
    rid.write_report(result, "part.html", worst_case=dataclasses.replace(error, missing=np.array([40.0])))
    before, _ = first_screen(folder / "part.html")
    assert "Unfinished: Its time limit, or Ctrl-C, ended the sweep: 3 of 4 frequencies are bounded" in before


def test_an_interrupted_sweep_over_the_order_is_said_first_and_kept_with_the_fit(tmp_path, monkeypatch, run):
    monkeypatch.chdir(tmp_path)
    omega = np.linspace(1.0, 20.0, 60)
    values = sum(1 / ((1j * omega) ** 2 + 0.02j * one * omega + one**2) for one in (3.0, 7.0, 15.0))
    rid.save("frf.npz", rid.FrequencyResponse(omega, values + 1e-4 * np.random.default_rng(0).normal(size=60)))
    stopping(monkeypatch, lambda text, done, count: "range of orders" in text and done > 2)

    class Threads(ThreadPoolExecutor):  # processes would import everything
        def end(self):
            ended.append(True)

    ended = []
    monkeypatch.setattr("robustid.core.worker_pool", lambda: Threads(1))
    code, out, err = run(["fit", "frf.npz", "--order", "auto", "-o", "fit", "--report", "fit.html"])
    said = "Interrupted: Ctrl-C ended the sweep over the order before its end"
    assert (code, ended) == (130, [True]), err
    assert " ".join(out.split()).index(said) < out.index("onverged")
    before, _ = first_screen(tmp_path / "fit.html")
    assert said in " ".join(before.split())
    assert rid.load("fit").unfinished.interrupted


def test_a_circle_that_ctrl_c_left_out_is_named(folder, run, monkeypatch):
    assert run([*COMMAND, *CLASS, "-o", "circled", "--no-reduce"])[0] == 0
    monkeypatch.setattr("robustid.guarantees.WorstCaseError.on_circle", ctrl_c)
    code, out, err = run(
        ["bounds", "circled", "--circle", "--omega", "60", "--directions", "3", "-o", "circled-bounds"]
    )
    assert code == 130, err
    said = "not finished: bounding the error between the frequencies"
    assert said in " ".join(out.split())
    arguments = ["report", "circled", "--bounds", "circled-bounds", "--no-reduce", "-o", "circled.html"]
    assert run(arguments)[0] == 0  # and a page that is made later says it first
    assert said in " ".join(first_screen(folder / "circled.html")[0].split())


def test_a_run_whose_time_is_over_ends_with_a_page_that_says_so_first(folder):
    said = []
    result = rid.run(
        ask(folder, DATA, STATED, {"time_limit": 1e-3}), "out", progress=lambda text, done, count: said.append(text)
    )
    assert "0.001 s for all of it" in said[0]
    assert result.unfinished is not None
    assert not result.unfinished.interrupted
    assert any("smallest order" in step for step in result.unfinished.steps)
    assert result.summary().startswith("Unfinished: ")
    before, after = first_screen(folder / "out" / "report.html")
    assert "Unfinished: What stands here holds" in before
    assert "Consistent" in after
    assert result.band.certified
    # A page that is made later of what the folder keeps says it too.
    rid.write_report(rid.load("out/identification"), "later.html")
    assert "Unfinished: What stands here holds" in first_screen(folder / "later.html")[0]


def test_a_search_for_a_contradiction_has_a_share_of_the_time_and_says_that_it_is_over(folder, monkeypatch):
    limits = []

    def late(problem, time_limit=None, progress=None):
        limits.append(time_limit)
        time.sleep(time_limit)

    monkeypatch.setattr(sequence, "contradiction", late)
    result = rid.run(ask(folder, DATA, STATED, {"time_limit": 1.0}, QUICK), "out")
    assert 0 < limits[0] < 0.25
    assert "looking for samples that no system explains" in result.unfinished.steps
    assert "looking for samples that no system explains" in result.summary()


@pytest.mark.slow
@pytest.mark.usefixtures("unreduced")
def test_ctrl_c_while_a_band_is_narrowed_keeps_what_is_proved_on_a_page(folder):
    """The verdict, the band and polygons that were found by then; nothing is searched between them any more."""
    stop = ctrl_c_when(lambda text, done, count: "narrowing" in text and done == 1)
    stated = {"worst_case": {"directions": 4}}
    result = rid.run(ask(folder, DATA, {"prior": STATED["prior"]}, stated), "out", progress=stop)
    assert result.unfinished.interrupted
    assert result.band.certified
    assert result.band.polygons is not None
    assert all(one.sides.first_node == one.sides.half for one in result.band.directed)
    assert "Interrupted: Ctrl-C ended it" in first_screen(folder / "out" / "report.html")[0]
    assert rid.load("out/band").polygons.omega.size == result.band.polygons.omega.size


@pytest.mark.usefixtures("unreduced", "unsharpened")
def test_a_run_in_its_time_leaves_nothing_out(folder):
    result = rid.run(ask(folder, DATA, STATED, {"worst_case": {"compute": False}}), "out")
    assert result.unfinished is None
    assert "Unfinished" not in "".join(first_screen(folder / "out" / "report.html"))
    assert "unfinished" not in rid.load("out/identification").choices


@pytest.mark.slow
@pytest.mark.parametrize("kept", [True, False])
def test_an_interrupted_run_is_gone_on_with_where_something_keeps_it(folder, kept):
    stop = ctrl_c_when(lambda text, done, count: count and "smallest order" in text)
    path = ask(folder, DATA, STATED, {"worst_case": {"compute": False}})
    if kept:
        result = rid.run(path, "out", progress=stop)
    else:
        stated = {"modes": [(9.0, 0.1), (17.67, 0.004)], "prior": rid.Prior(gain_bound=0.2, decay_rate=1.1)}
        result = rid.identify_reduced([rid.load("frf.csv"), rid.load("step.csv")], progress=stop, **stated)
    assert result.unfinished.interrupted
    assert result.unfinished.resumable is kept
    if kept:
        said = first_screen(folder / "out" / "report.html")[0]
        assert "Interrupted: Ctrl-C ended it before its end: what stands here was found by then" in said
        rid.write_report(rid.load("out/identification"), "later.html")
        assert "Interrupted: Ctrl-C ended the run before its end" in first_screen(folder / "later.html")[0]
        assert rid.run(path, "out", resume=True).unfinished is None
        assert "unfinished" not in rid.load("out/identification").choices


@pytest.mark.usefixtures("unreduced", "unpaged")
def test_an_interrupted_search_for_a_class_is_gone_on_with(folder, monkeypatch):
    sought, rest = [], []

    def search(data, rate, *others):
        sought.append(rate)
        if len(sought) == 3:
            raise KeyboardInterrupt
        return smallest_gain(data, rate, *others)

    monkeypatch.setattr(kept_gains, "smallest_gain", search)
    path = ask(folder, DATA, {"modes": STATED["modes"], "worst_case": {"compute": False}})
    first = rid.run(path, "out")
    assert first.unfinished.interrupted
    assert first.run_file.prior.source == "stopped"
    monkeypatch.setattr(kept_gains, "smallest_gain", lambda *asked: rest.append(asked[1]) or smallest_gain(*asked))
    second = rid.run(path, "out", resume=True)
    assert {*sought[:2]}.isdisjoint(rest)
    whole = rid.run(path, "whole")
    assert {*sought} <= {*rest}
    assert second.unfinished is None
    assert second.run_file.prior == whole.run_file.prior
    assert second.run_file.prior.source == "data"
    assert not (folder / "out" / "unfinished").exists()


def test_only_searches_that_came_to_their_end_are_kept(tmp_path, monkeypatch):
    frf = rid.FrequencyResponse([1.0, 2.0], [1.0, 0.5], bound=0.1, dt=0.1)
    problem = rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=1.0, decay_rate=1.1))
    found = iter([3.0, 2.0, 1.0])
    monkeypatch.setattr(kept_gains, "smallest_gain", lambda *_: next(found))
    over, path = Budget(1e-9), tmp_path / "gains.json"
    asked = problem, 1.1, problem, (8.0,)
    assert kept_gains.KeptGains(path).gain(*asked, over) == 3.0
    assert not path.exists()
    assert kept_gains.KeptGains(path).gain(*asked, Budget()) == 2.0
    assert kept_gains.KeptGains(path).gain(*asked, over) == 2.0
    path.write_text("{", encoding="utf-8")
    assert kept_gains.KeptGains(path).gain(*asked, Budget()) == 1.0


def test_where_nothing_is_decided_half_of_the_time_is_for_the_small_model(consistent, monkeypatch):
    """Neither a band nor causes come after it, which a decision has."""
    limits = []
    small = rid.balanced_truncation(consistent.model, order=4)
    monkeypatch.setattr(
        sequence, "reduce_within_bounds", lambda found, **how: limits.append(how["time_limit"]) or small
    )
    claim = dataclasses.replace(
        consistent.claim, margin=1.1, certificate=dataclasses.replace(consistent.claim.certificate, value=0.9)
    )
    for found in (consistent, dataclasses.replace(consistent, claim=claim)):
        around = Surroundings(budget=Budget(100.0))
        sequence.reduced(Work(run=RunFile(), identification=found, around=around))
    assert limits == pytest.approx([30.0, 50.0], rel=0.02)
