"""Page and figures of a family, and of withheld data."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.report import Verdict
from robustid.report.document import Heading, Table
from robustid.report.family_page import (
    driver_table,
    family_charts,
    family_page,
    member_table,
    paired_modes,
    schedule_chart,
)
from robustid.report.withheld_data import CONTRADICTED, withheld_chart, withheld_verdict
from robustid.report.words import HZ
from support.families import DT, identified, measured

OMEGA = np.array([0.0, 2.0, 8.0, np.pi / DT])


@pytest.fixture(scope="module")
def two():
    pair = rid.kautz(12.0, 0.05, dt=DT, delay=1)
    members = [rid.guarantee.Member(identified(g, seed=k, parametric=pair), load=g) for k, g in enumerate((0.8, 1.3))]
    return rid.family(members, omega=OMEGA, directions=4, interval=(0.5, 1.3))


@pytest.fixture(scope="module")
def outside(two):
    return rid.coverage(two, [measured(g, seed=7) for g in (1.0, 3.0)])


def layer(chart, panel, name):
    return next(one for one in chart.panels[panel].layers if one.name == name)


def test_the_page_says_what_is_guaranteed_who_drives_it_and_what_is_not_known(two, tmp_path):
    rid.write_report(two, tmp_path / "page.html", title="Two loads", findings=["A finding."])
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    for words in (
        "Two loads",
        "A finding.",
        "One class",
        "Proved",
        "Who drives the band where",
        "load 0.8",
        *two.not_known,
    ):
        assert words in page


def test_tables_are_those_of_the_family(two):
    assert [row[0] for row in member_table(two).rows] == list(two.names)
    assert [row[2] for row in driver_table(two).rows] == [row.member for row in two.drivers()]


def test_band_and_errors_are_drawn_as_they_are_proved(two):
    (chart,) = family_charts(two)
    for k, name in enumerate(two.names):
        drawn = layer(chart, 1, f"{name}: error")
        assert drawn.x == pytest.approx(two.omega[1:] / HZ)
        assert drawn.y == pytest.approx(two.uppers[k, 1:, 0, 0])
    band = layer(chart, 0, "band of the family (3 frequencies)")
    at = np.searchsorted(band.x, two.omega[2] / HZ - 1e-12)
    assert band.high[at] == pytest.approx(abs(two.nominal[2]) + two.upper[2, 0, 0])
    assert [a.get_xlabel() for a in two.plot().axes][-1].startswith("frequency [Hz]")


def test_band_and_poles_over_the_condition(two):
    chart = schedule_chart(two)
    assert [panel.title for panel in chart.panels] == [
        "Range of the magnitude where the band is widest",
        "Natural frequency, from that of the first member",
        "Damping ratio",
    ]
    mode = layer(chart, 1, "mode 1, 1.91 Hz")
    assert mode.x.tolist() == [0.8, 1.3]
    assert mode.y == pytest.approx([0.0, 0.0])
    assert layer(chart, 2, "mode 1, 1.91 Hz").y == pytest.approx(0.05)
    assert chart.panels[0].x.range[0] < 0.5
    with pytest.raises(rid.InputError, match="a family without a schedule"):
        schedule_chart(dataclasses.replace(two, schedule=None))


def test_modes_are_paired_with_their_nearest():
    def poles(*hz):
        return np.repeat(np.array([[f, 0.01] for f in hz])[:, :, None], 3, axis=2)

    found = paired_modes([poles(10, 20, 30), poles(10.2, 20.3), poles(10.1, 25, 20.4)])
    assert [one[:, 0, 0].tolist() for one in found[:2]] == [[10, 10.2, 10.1], [20, 20.3, 20.4]]
    assert [np.isfinite(one[:, 0, 0]).tolist() for one in found[2:]] == [[False, False, True], [True, False, False]]


def test_contradiction_stands_first_on_the_page(two, outside):
    document = family_page(two, None, {"withheld": outside})
    verdicts = [block for block in document.head if isinstance(block, Verdict)]
    assert [one.key for one in verdicts] == ["inconsistent", "consistent"]
    assert "no guarantee for the machine" in verdicts[0].sentence
    headings = [b.text for b in document.body if isinstance(b, Heading)]
    assert CONTRADICTED in headings
    assert "What is guaranteed" not in headings
    table = next(b for b in document.body if isinstance(b, Table) and b.columns[0].head == "withheld")
    assert [row[0] for row in table.rows] == ["record 1", "record 2"]
    inside = rid.coverage(two, measured(0.8, seed=0), kind="lines")
    assert withheld_verdict(inside).word == "Supported by withheld data"


def test_withheld_samples_outside_are_told_apart(outside):
    chart = withheld_chart(outside)
    names = [one.name for one in chart.panels[0].layers]
    assert names == ["record 1", "record 2, outside", "edge of the band"]
    assert layer(chart, 0, "record 2, outside").y == pytest.approx(outside.error[1, :, 0, 0])
