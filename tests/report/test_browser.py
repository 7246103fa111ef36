"""Pages in a real browser: every plot drawn, no error in the console, nothing fetched, no sideways scroll."""

import re

import numpy as np
import pytest

import robustid as rid
from robustid.fitting import suggest_order
from robustid.report import write_report
from support import matrix_pages
from support.browser import CHROMIUM, framed, opened, plots
from support.mfd_systems import noisy, random_modal_system
from support.report_pages import identified, with_circle

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs the browser `chromium` on the path")
DRAWN = re.compile(r'<g class="trace scatter[^>]*>.*?<path[^>]* d="M[^"]{8,}', re.S)


def drawn(page, shown, width):
    """The markup of each plot: all were drawn, and nothing stands out sideways."""
    assert width - 20 <= shown.client <= width
    assert shown.scroll <= shown.client
    found = plots(shown.dom)
    assert len(found) == len(re.findall('<figure class="plot', page.read_text(encoding="utf-8")))
    for name, markup in found.items():
        assert 'class="main-svg"' in markup, name
        assert DRAWN.search(markup), name
        assert "sendChartToCloud" not in markup, name
        assert "Share chart" not in markup, name
    return found


def all_drawn(folder, *kinds):
    """Plots of pages of some kinds at a width each, drawn without an error."""
    pages = {folder / f"{write.__name__}.html": (write, width) for write, width in kinds}
    for page, (write, _) in pages.items():
        write(page)
    every, console = framed({page: width for page, (_, width) in pages.items()}, folder)
    assert console == []
    return [drawn(page, shown, width) for (page, (_, width)), shown in zip(pages.items(), every, strict=True)]


@pytest.mark.parametrize("kind", ["identification", pytest.param("fit", marks=pytest.mark.slow)])
def test_pages_on_narrow_screens(tmp_path, kind):
    """Drawn without an error, with the plots that the page should have."""
    (found,) = all_drawn(tmp_path, ({"identification": identification, "fit": fit}[kind], 390))
    if kind == "identification":
        check_identification(found)
    else:
        assert any("rotation [mrad] / torque [Nm]" in markup for markup in found.values())


@pytest.mark.slow
def test_pages_of_matrices_on_narrow_screens(tmp_path):
    """As above; their charts are also drawn by the tests of each section."""
    found = all_drawn(tmp_path, (mimo_identification, 360), (response, 360))
    assert len(found[0]) == 1 + 4 + 1 + 2 + 4 + 6 + 3
    entries = {f"entry-{i}-{j}-0" for i in (0, 1) for j in (0, 1)}
    further = {"first-0", "singular-0", "coherence-0", "input-0-0", "input-1-0", "output-0-0", "output-1-0"}
    assert set(found[1]) == entries | further


def check_identification(found):
    names = [
        "first-0",
        "frequency-0",
        "time-0",
        "time-1",
        "residuals-0",
        "hankel-0",
        "poles-0",
        "poles-1",
        "guarantee-0",
    ]
    names += ["nyquist-0", "nyquist-1", "over_poles-0", "tube-0", "sensitivity-0", "sensitivity-1"]
    assert set(found) == set(names)
    assert "errorbar" in found["frequency-0"]
    assert "displacement [mm] / force [N]" in found["frequency-0"]


def identification(page):
    """With every section."""
    result = identified()
    modes = rid.datasets.flexible_structure().modes
    box = modes[:, :1] * [0.999, 1.001], modes[:, 1:] * [0.95, 1.05]
    sections = {
        "worst_case": with_circle(rid.worst_case_error(result, omega=[60.0, 100.0], directions=3)),
        "over_poles": rid.guarantee.worst_case_over_poles(result, *box, omega=[60.0, 100.0], directions=3, cells=1),
        "tube": rid.guarantee.response_tube(result, input="step", horizon=3),
        "sensitivity": rid.advise.sensitivity(result.problem, omega=[30.0]),
        "reduction": rid.balanced_truncation(result.model, order=4),
    }
    write_report(result, page, **sections)


def mimo_identification(page):
    names = [f"acceleration of the measuring beam at its position {k} [mm/s²]" for k in range(2)]
    data = matrix_pages.measured(lines=6, outputs=names), matrix_pages.record()
    write_report(rid.identify(matrix_pages.problem(*data)), page)


def fit(page):
    """A 2 x 2 fit with one rigid-body mode, and a sweep over the order, on noisy data."""
    s = 2j * np.pi * np.geomspace(4, 1200, 60)
    flexible = noisy(np.random.default_rng(0), random_modal_system(3, 2, 2, 2).response(s))
    rigid = np.array([[1.0], [-0.3]]) @ np.array([[2.0, 1.0]]) * 1e4 / (s**2)[:, None, None]
    names = {"inputs": ["force [N]", "torque [Nm]"], "outputs": ["displacement [mm]", "rotation [mrad]"]}
    data = rid.FrequencyResponse(np.abs(s), flexible + rigid, **names)
    sweep = suggest_order(data, orders=range(5, 8), rigid_body=rid.RigidBody(1))
    write_report(sweep.fits[6], page, data=data, order_sweep=sweep)


def response(page):
    rng = np.random.default_rng(0)
    u = rng.standard_normal((2, 1500, 2))
    names = {"inputs": ["force [N]", "torque [Nm]"], "outputs": ["displacement of the table [mm]", "<b>angle</b>"]}
    records = [rid.TimeRecord(x, x @ [[1, 2], [1, -1]] + rng.standard_normal(x.shape), dt=0.01, **names) for x in u]
    write_report(rid.estimate_frf(records), page, records=records)


def test_text_of_strangers_runs_nothing_and_is_shown_as_it_stands(tmp_path):
    nasty = "<script>alert('owned')</script>"
    label = "</script><img src=x onerror=alert('owned')><b>y</b>"
    result = identified(inputs=[(nasty, "N")], outputs=[(label, "</script>")])
    write_report(result, tmp_path / "report.html", title='"Title" & </title>')
    dom, console = opened(tmp_path / "report.html", tmp_path / "profile")
    assert console == []
    assert '<title>"Title" &amp; &lt;/title&gt;</title>' in dom
    assert "owned'</script>" not in dom.replace("&lt;/script&gt;", "")
    assert not re.search(r"<img|<b>y", dom)
    title = plots(dom)["first-0"]
    shown = re.search(r'<text class="ytitle"[^>]*>(.*?)</text>', title, re.S)
    assert shown is not None
    assert shown.group(1).startswith("&lt;/script&gt;&lt;img src=x")
