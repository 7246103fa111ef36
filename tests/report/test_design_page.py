"""The page of a designed controller: curves against the proof, discs against the limits, steps against python-control."""

import dataclasses

import control
import numpy as np
import pytest

import robustid as rid
from robustid.controllers.controller_design import DesignStatus
from robustid.controllers.controller_storage import design_again
from robustid.controllers.plants import Plants
from robustid.core import StateMatrices, Unfinished, points_of, response_at
from robustid.design import FIR, PID, Bandwidth, Fixed, Improvement, LeadLag, Limits, LowPass, Matrix, Notch
from robustid.errors import InputError, InputTypeError
from robustid.report import write_report
from robustid.report.design_charts import _along, design_chart, nyquist_charts, open_loop_bode
from robustid.report.design_page import _at, design_head, design_verdict, shares_table
from robustid.report.design_steps import entry_charts, step_chart, step_tubes
from robustid.report.design_structure import factor_words, structure_rows
from support.design_cases import DT, band_of, matrix_band_of
from support.forging import kept
from support.one_design import LIMITS, PI, small_band, small_design

HZ = 2 * np.pi


@pytest.fixture(autouse=True)
def few_points(monkeypatch):
    """Curves of fewer points than a page has: a band at many frequencies takes a while."""
    monkeypatch.setattr("robustid.report.design_charts._POINTS", 120)
    monkeypatch.setattr("robustid.report.design_charts._DISCS", 60)


def layer(panel, name):
    return next(one for one in panel.layers if one.name.startswith(name))


def test_the_curves_hold_the_plant_itself_and_keep_the_limits_that_are_drawn():
    design, plant = small_design(), band_of(1)[0]
    panels = {panel.title: panel for panel in design_chart(design).panels}
    x = layer(panels["S"], "largest").x
    C, P = (response_at(one, points_of(HZ * x, DT))[:, 0, 0] for one in (PI, StateMatrices.of(plant)))
    S = 1 / (1 + P * C)
    for name, true in (("S", S), ("T", 1 - S), ("P S", P * S), ("C S", C * S)):
        assert np.all(np.abs(true) <= layer(panels[name], "largest").y), name
    limit = layer(panels["S"], "limit")
    assert limit.y[np.isfinite(limit.y)].tolist() == [2.0, 2.0, 0.5, 0.5]
    assert np.allclose(limit.x[3:5] * HZ, [0.5, 3.0])
    largest = layer(panels["S"], "largest").y
    assert largest.max() <= 2.0
    assert largest[(x * HZ >= 0.5) & (x * HZ <= 3.0)].max() <= 0.5
    assert layer(panels["T"], "limit").y[0] == 0.9
    assert [one.name for one in panels["P S"].layers] == ["largest with any consistent plant"]


def test_a_gain_that_is_only_rounding_is_zero():
    """A low-pass after Tustin ends at 0, which the sum over its states misses by a few digits; one that is small does not."""
    low, lead = control.tf([1], [1 / 700.0**2, 1.2 / 700.0, 1]), control.tf([1 / 90.0, 1], [1 / 900.0, 1])
    system = control.ss(control.sample_system(7.0 * low * lead, 4e-4, method="tustin"))
    parts = StateMatrices.of(system)
    assert response_at(parts, [-1.0])[0, 0, 0] != 0
    assert _at(parts, -1.0) == 0
    small = parts._replace(D=parts.D + 1e-9)
    assert _at(small, -1.0) == pytest.approx(1e-9, rel=1e-3)


ROWS = (
    Improvement("bounds", 0.5, 0.0, np.inf, 15.4, 1.4),
    Improvement("bounds", 0.5, HZ * 1.0, HZ * 2.0, 13.2, 1.2, HZ * 1.5),
    Improvement("bounds", 0.5, HZ * 4.0, HZ * 8.0, 12.1, 1.1),
    Improvement("sensitivity_peak", 1.1, np.nan, np.nan, 11.0, 1.0),
)


def test_the_page_says_what_would_help_and_where_to_measure(tmp_path):
    write_report(small_design(), tmp_path / "page.html", sensitivity=ROWS)
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    omega = small_band().problem.frequency[0].omega
    count = int(np.sum((omega >= HZ) & (omega <= 2 * HZ)))
    points = f"{count} frequency point{'s' * (count != 1)}"
    most = "above all the one at 1.5 Hz"
    first = f"Measure better from 1 to 2 Hz first, {points}, {most}: bounds times 0.5 there bring +20 % bandwidth."
    assert text.count(first) == 1
    assert "What would help" in text
    assert "sensitivity peak wider by 10 %" in text
    write_report(small_design(), tmp_path / "page.html", sensitivity=ROWS[-1:])
    assert "Measure better" not in (tmp_path / "page.html").read_text(encoding="utf-8")
    for wrong in ("high", (1.0, 2.0), small_design()):
        with pytest.raises(InputTypeError, match="`sensitivity` of a design must be what its improvements"):
            write_report(small_design(), tmp_path / "page.html", sensitivity=wrong)


def test_templates_of_every_map_are_drawn_and_listed():
    limits = Limits(tracking=((0.5, 4.0, 0.5),), disturbance=((2.0, 9.0, 1.0),), action=((40.0, 200.0, 0.6),))
    loop = Plants.of(small_band()).loop
    design = design_again((small_band(),), (loop,), PI, (PID(),), limits, Bandwidth(), 11.0, ())
    panels = {panel.title: panel for panel in design_chart(design).panels}
    for name, value in (("P S", 1.0), ("C S", 0.6)):
        assert layer(panels[name], "limit").y[0] == value
    assert layer(panels["T"], "limit, at least").y[0] == 0.5
    smallest, largest = layer(panels["T"], "smallest"), layer(panels["T"], "largest")
    assert np.nanmin(smallest.y[(smallest.x * HZ >= 0.5) & (smallest.x * HZ <= 4)]) >= 0.5
    assert np.all((smallest.y <= largest.y) | np.isnan(smallest.y))
    asked = {row[0]: row[1].replace("\u00a0", " ") for row in shares_table(design).rows}
    assert asked["tracking"] == "|T| ≥ 0.5, 0.0796 to 0.637 Hz"
    assert asked["disturbance"].startswith("|P S| ≤ 1,")
    assert asked["action"].startswith("|C S| ≤ 0.6,")


def test_no_two_discs_of_the_open_loop_are_far_apart_on_the_axis_or_in_the_plane():
    """At most twice the mean distance on both: a light mode, a few hundredths of the axis, is the circle that it is."""
    (proof,) = small_design().proofs
    dense = np.geomspace(0.1, 300.0, 20_000)
    omega = _along(proof, dense[0], dense[-1])
    plant = StateMatrices.of(small_band().model)
    loops = (
        np.prod([response_at(one, points_of(at, DT))[:, 0, 0] for one in (plant, PI)], axis=0) for at in (omega, dense)
    )
    chosen, every = (one / (1 + np.abs(one)) for one in loops)
    mean = np.abs(np.diff(every)).sum() / (len(omega) - 1)
    assert np.abs(np.diff(chosen)).max() <= 2.02 * mean
    assert np.diff(np.log(omega)).max() <= 2.02 * np.log(3000.0) / (len(omega) - 1)
    assert omega[[0, -1]] == pytest.approx([0.1, 300.0])


P = PID(integral=False)


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ([[PID()]], "|P C|"),
        ([[PID(), P]], "|C P|"),
        ([[PID()], [P]], "|P C|"),
        ([[PID(), None], [None, PID()]], "σmin(P C)"),
        ([[PID(), None, None], [None, PID(), None]], "σmin(C P)"),
        ([[PID(), None], [None, PID()], [P, None]], "σmin(P C)"),
    ],
)
def test_the_bandwidth_is_that_of_the_loop_at_the_inputs_where_these_are_fewer(rows, words):
    table = shares_table(dataclasses.replace(small_design(), structure=Matrix(rows)))
    asked = {row[0]: row[1].replace("\u00a0", " ") for row in table.rows}
    assert asked["bandwidth"] == f"{words} ≥ 1 up to 1.751 Hz"


def test_the_open_loop_of_the_plant_is_in_the_range_and_discs_keep_out_of_the_peak():
    design, plant = small_design(), band_of(1)[0]
    magnitude, phase = open_loop_bode(design).panels
    area, turn = (layer(one, "range of every") for one in (magnitude, phase))
    points = points_of(HZ * area.x, DT)
    L = response_at(StateMatrices.of(plant), points)[:, 0, 0] * response_at(PI, points)[:, 0, 0]
    assert np.all(np.abs(L) <= area.high * (1 + 1e-9))
    off = (np.degrees(np.angle(L)) - turn.y + 180) % 360 - 180
    inside = (turn.low - turn.y <= off + 1e-6) & (off <= turn.high - turn.y + 1e-6)
    assert inside[area.x < 10].all()  # beyond, a phase can be anything, and the axis ends
    end = layer(magnitude, "bandwidth").x[-1]
    assert end == pytest.approx(11.0 / HZ)
    assert area.low[area.x <= end].min() >= 1
    (chart,) = nyquist_charts(design)
    discs = layer(chart.panels[0], "holds that")
    away = np.abs(discs.x + 1j * discs.y + 1)
    assert np.nanmin(away) >= 0.5


def test_steps_are_those_of_the_loop_with_the_model():
    design = small_design()
    panels = step_chart(design).panels
    set_point, given, disturbed = (panel.layers[-1] for panel in panels)
    for panel in panels[::2]:
        area = panel.layers[0]
        assert np.all((area.low < area.y) & (area.y < area.high))
    plant, C = design.proofs[0].band.model, control.ss(design.controller)
    for drawn, loop in (
        (set_point, control.feedback(plant * C, 1)),
        (given, control.feedback(C, plant)),
        (disturbed, control.feedback(plant, C)),
    ):
        wanted = control.step_response(loop, drawn.x).outputs
        assert np.abs(drawn.y - wanted).max() < 1e-9
    assert set_point.y[-1] == pytest.approx(1, abs=0.02)


@pytest.fixture(scope="module")
def matrix_design():
    """Two loops of PI with a band of two inputs and two outputs, and its plant."""
    plant, band = matrix_band_of(1)
    one = StateMatrices.of(control.append(*[control.ss(1.0, 1.0, 0.02, 0.3, DT)] * 2))
    structure = Matrix([[PID(), None], [None, PID()]])
    limits = Limits(sensitivity_peak=4.0)
    return plant, design_again((band,), (Plants.of(band).loop,), one, structure, limits, Bandwidth(), 0.5, ())


@pytest.mark.slow
def test_steps_of_a_matrix_are_those_of_control_in_ranges_that_hold_the_plant(matrix_design):
    truth, design = matrix_design
    model, C = design.proofs[0].band.model, control.ss(design.controller)
    tubes = [step_tubes(one)[0] for one in design.proofs]
    for of, loop_of in (
        ("set point", lambda plant: control.feedback(plant * C, np.eye(2))),
        ("load", lambda plant: control.feedback(plant, C)),
    ):
        charts = entry_charts(design, tubes, of)
        area, drawn = charts[0].panels[0].layers
        steps = [control.step_response(loop_of(plant), drawn.x).outputs for plant in (model, truth)]
        for (i, j), chart in zip(np.ndindex(2, 2), charts, strict=True):
            area, drawn = chart.panels[0].layers
            assert np.abs(drawn.y - steps[0][i, j]).max() < 1e-9
            assert np.all((area.low <= steps[1][i, j]) & (steps[1][i, j] <= area.high))
            size = tubes[0][of, i, j].overshoot
            far = steps[1][i, j].max() - 1 if of == "set point" and i == j else np.abs(steps[1][i, j]).max()
            assert far <= size
    assert step_chart(design, tubes).columns == 4


def test_the_page_says_what_is_proved_and_what_limits(tmp_path):
    design = small_design()
    write_report(design, tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    for words in (
        "Every consistent plant keeps all limits",
        "sensitivity peak, near 4.764 Hz",
        "Steps of the loop",
        "% of the set point, with every consistent plant",
        "zero",
    ):
        assert words in page, words
    table = shares_table(design)
    assert [row[0] for row in table.rows] == list(design.shares)
    assert all(row[1] for row in table.rows)
    found = dataclasses.replace(design, status=DesignStatus.FOUND, shares={"roll-off": (1.2, 100.0)})
    assert "may exceed the limit: roll-off" in design_verdict(found).sentence


@pytest.mark.slow
def test_the_figure_of_a_design():
    assert small_design().plot().axes[0].get_ylabel() == "largest |S| [–]"
    assert rid.plot.bode(small_design()).axes[1].get_ylabel() == "phase of P C [°]"


def test_the_page_of_none_says_that_it_is_a_search(tmp_path):
    none = dataclasses.replace(
        small_design(), status=DesignStatus.NONE, controller=None, proofs=(), shares={}, level=0.0
    )
    write_report(none, tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "None found" in page
    assert "at least 2" in page
    with pytest.raises(InputError, match="nothing to draw"):
        none.plot()


def test_factors_in_words():
    assert factor_words(PID(), []) == "PI"
    assert factor_words(PID(filter=HZ * 80), [HZ * 80]) == "PID, the derivative up to 80 Hz"
    notch = Notch((HZ * 30, HZ * 40), 0.5)
    assert factor_words(notch, [HZ * 35]) == "Notch with its poles at 35 Hz (searched from 30 to 40 Hz), damping 0.5"
    assert factor_words(notch, []) == "Notch with its poles at 30 to 40 Hz, searched, damping 0.5"
    assert factor_words(LowPass(HZ * 90, 2), [HZ * 90]) == "Low-pass of order 2 at 90 Hz"
    assert factor_words(FIR(3), []) == "3 past samples"
    assert factor_words(Fixed(control.ss(0.5, 1, 1, 0, DT)), []) == "A known model of order 1"
    assert factor_words(LeadLag(HZ * 5), [HZ * 5]) == "Lead or lag with its pole at 5 Hz"


def test_the_closest_controller_of_none_is_kept_and_shown(tmp_path):
    """A claim that none was found is recorded, and what the closest one exceeds is evaluated anew."""
    limits = dataclasses.replace(LIMITS, sensitivity_peak=1.2)
    loop = Plants.of(small_band()).loop
    how = {"found": DesignStatus.NONE, "bounds_factor": 0.5}
    design = design_again((small_band(),), (loop,), PI, (PID(),), limits, Bandwidth(), 11.0, (), **how)
    again = kept(design, tmp_path / "none")
    assert (again.status.name, again.bounds) == ("NONE", 0.5)
    assert again.shares["sensitivity peak"][0] > 1.5
    assert design_verdict(again).word == "None found"
    kept_in_time = design_again(
        (), (), PI, (PID(),), LIMITS, Bandwidth(), 11.0, (), DT, unfinished=Unfinished(("search",), False)
    )
    again = kept(kept_in_time, tmp_path / "early")
    assert (again.status.name, again.finished, again.controller.dt) == ("FOUND", False, DT)
    write_report(again, tmp_path / "page.html")
    assert "before it could be proved" in (tmp_path / "page.html").read_text(encoding="utf-8")
    stopped = dataclasses.replace(design, unfinished=Unfinished((), True, run="the search"))
    assert design_head(stopped, None, {}).notice.head == "Interrupted"


def test_a_structure_is_said_with_the_signals_or_axes_that_it_stands_between():
    rows, half = [[PID(), None], [LowPass(HZ * 9), PID()]], np.array([[0.5, 0.0], [1.0, 2.0]])
    for around, first, last in (
        ({}, "Structure, output 1 to input 1", ("Structure, output 2 to input 2", "PI")),
        ({"actuators": half}, "Structure, output 1 to axis 1", ("From the axes to the inputs", "0.5, 0; 1, 2")),
        ({"sensors": half}, "Structure, axis 1 to input 1", ("From the outputs to the axes", "0.5, 0; 1, 2")),
    ):
        none = design_again((), (), None, Matrix(rows, **around), Limits(), Bandwidth(), 0.0, ())
        words = structure_rows(none)
        assert words[0] == (first, "PI")
        assert words[-1] == last
        assert words[1][1] == "Low-pass of order 1 at 9 Hz"


@pytest.mark.slow
def test_a_matrix_of_controllers_is_kept_and_shown(matrix_design, tmp_path):
    design = matrix_design[1]
    assert design.proofs[0].guaranteed
    again = kept(design, tmp_path / "matrix")
    assert again.shares == design.shares
    assert again.structure.rows == design.structure.rows
    write_report(again, tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "From y2 to u2" in page
    assert "Overshoot of y2" in page
    assert "y1, set point of y2" in page
    assert "From y1 to u2" not in page


def test_the_first_screen_of_a_run_names_the_controller_that_was_designed(tmp_path):
    result = rid.identify(small_band().problem)
    asked, designed = "Check a controller K", "A controller is proved for every consistent plant, bandwidth 1.7507 Hz"
    for design, said, unsaid in ((small_design(), designed, asked), (None, asked, designed)):
        write_report(result, tmp_path / "page.html", band=small_band(), design=design)
        page = (tmp_path / "page.html").read_text(encoding="utf-8")
        assert said in page
        assert unsaid not in page
