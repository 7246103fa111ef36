"""What is said of a measured frequency response, against numbers known independently."""

from __future__ import annotations

import dataclasses
import io

import numpy as np
import pytest
import rich.console

import robustid as rid
from robustid.data import FrequencyResponse, TimeRecord, estimate_frf
from robustid.report import facts, frf_facts, render_summary
from robustid.report.frf_view import FrfView
from support.frf_records import DT, NASTY, PERIOD, measured


@pytest.fixture(scope="module")
def frf():
    play, records = measured()
    return estimate_frf(records, period=PERIOD, lines=play.lines)


def printed(frf, width=140):
    console = rich.console.Console(file=io.StringIO(), width=width)
    console.print(render_summary(frf))
    return " ".join(console.file.getvalue().split())


def test_the_kind_of_bound_is_said_in_words():
    base = FrequencyResponse([1.0, 2.0], [1.0, 2.0])
    said = {}
    for kind, probability in (("hard", None), ("rest", None), ("statistical", None), ("statistical", 0.99)):
        frf = dataclasses.replace(base, bound=0.1, bound_kind=kind, probability=probability)
        said[kind, probability] = frf_facts.verdict(FrfView(frf))
    assert [verdict.word for verdict in said.values()] == [
        "Hard bound",
        "Bound from rest",
        "Statistical bound",
        "Statistical bound, 99 %",
    ]
    assert "isn't stated" in said["statistical", None].sentence
    assert "With a probability of 99 %" in said["statistical", 0.99].sentence
    assert all(verdict.key == "consistent" for verdict in said.values())
    assert frf_facts.verdict(FrfView(base)).word == "No bound"


def test_the_identification_report_states_the_kind_of_bound():
    base = FrequencyResponse([1.0, 2.0], [1.0, 2.0], bound=0.1)
    for changes, words in (
        ({}, "hard: source not stated"),
        ({"note": "data sheet"}, "hard: data sheet"),
        ({"bound_kind": "rest", "note": "largest of 500 samples"}, "from rest: largest of 500 samples"),
        (
            {"bound_kind": "statistical", "probability": 0.95, "note": "3 periods"},
            "statistical, 95 % jointly: 3 periods",
        ),
        ({"bound_kind": "statistical", "probability": 0.95, "note": "statistical: joint"}, "statistical: joint"),
    ):
        assert facts.bound_source(dataclasses.replace(base, **changes)) == words
    record = TimeRecord(np.ones(4), [0.5, 0.75, 0.875, 0.94], dt=0.01, bound=0.01, bound_kind="rest", note="a pause")
    result = rid.identify(rid.MixedProblem(time=record, prior=rid.Prior(gain_bound=2.0, decay_rate=1.2)))
    assert facts.experiments(result)[0].source == "from rest: a pause"


def test_levels_are_medians_relative_to_the_response(frf):
    rows = frf_facts.level_rows(FrfView(frf))
    heads = frf_facts.level_columns(FrfView(frf))
    assert heads == ("Response", ">|G|", ">Bound", ">σ, noise", ">σ, distortion", ">Lines below\ntheir bound")
    bound = np.median(frf.bound[:, 0, 1] / np.abs(frf.values[:, 0, 1]))
    assert float(rows[1][2].removesuffix(" %")) == pytest.approx(100 * bound, rel=0.05)
    assert rows[1][0] == "x [mm] / torque [Nm]"
    silent = np.sum(frf.bound[:, 1, 0] >= np.abs(frf.values[:, 1, 0]))
    assert rows[2][-1] == f"{silent} of {frf.omega.size}"
    assert len(frf_facts.level_rows(FrfView(FrequencyResponse([1.0], [0.0], bound=1.0)))) == 1


def test_lines_resolution_coherence_and_degrees_of_freedom(frf):
    rows = dict(frf_facts.summary_rows(FrfView(frf)))
    assert rows["Lines"] == "79 lines, 1 to 40 Hz, 0.5 Hz apart"
    worst = frf.freq_hz[np.argmin(frf.coherence[:, 0])]
    assert f"{worst:.5g} Hz" in rows["Coherence"].split(";")[0]
    assert rows["Degrees of freedom"].startswith("10" if frf.dof == 10 else f"{frf.dof:.4g}")
    assert rows["Bound"] == frf.note
    gaps = frf.select([0, 1, 5])
    assert "at least 0.5 Hz apart" in dict(frf_facts.summary_rows(FrfView(gaps)))["Lines"]
    assert dict(frf_facts.summary_rows(FrfView(frf.select([3]))))["Lines"] == f"{frf.freq_hz[3]:.5g} Hz"


def test_warnings_name_what_is_wrong(frf):
    assert any(
        "bound exceeds the response" in w and f"of {NASTY} / force [N]" in w for w in frf_facts.warnings(FrfView(frf))
    )
    clean = dataclasses.replace(frf, bound=0.001 * np.abs(frf.values), dof=100.0, coherence=np.ones((79, 2)))
    assert frf_facts.warnings(FrfView(clean)) == []
    coherence = np.ones((79, 2))
    coherence[:8, 1] = 0.3
    (low,) = frf_facts.warnings(FrfView(dataclasses.replace(clean, coherence=coherence)))
    assert f"below 0.8: {NASTY} at 8 of 79 lines" in low
    (few,) = frf_facts.warnings(FrfView(dataclasses.replace(clean, dof=1.0)))
    # sqrt(1/alpha - 1) against sqrt(-log alpha), alpha = 0.05/316
    alpha = 0.05 / frf.values.size
    assert f"only 1 degree of freedom: the bound is {np.sqrt((1 / alpha - 1) / -np.log(alpha)):.2g} times" in few


def test_what_the_estimate_itself_admits_is_a_warning():
    rng = np.random.default_rng(0)
    u = rng.standard_normal(4000)
    smeared = estimate_frf(TimeRecord(u, u + 0.1 * rng.standard_normal(4000), dt=DT), method="welch")
    assert any("smeared" in w for w in frf_facts.warnings(FrfView(smeared)))
    verdict = frf_facts.verdict(FrfView(smeared))
    assert verdict.key == "weak"
    assert verdict.sentence.endswith("The warnings say what this leaves out.")
    u = np.tile(rng.standard_normal(100), 8) + 1e-9 * rng.standard_normal(800)
    drift = np.exp(-1.5 * np.arange(800) / 100) * np.cos(np.arange(800))
    moving = estimate_frf(TimeRecord(u, u + drift, dt=DT), period=100)
    assert any("steady state" in w for w in frf_facts.warnings(FrfView(moving)))


def test_the_terminal_shows_the_same(frf):
    text = printed(frf)
    for words in ("Statistical bound, 95 %", "79 lines", "x [mm] / torque [Nm]", NASTY, "Warning: At"):
        assert words in text
