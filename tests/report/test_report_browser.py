"""The report in a real browser: every plot drawn, no error in the console, nothing fetched."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import robustid as rid
from robustid.mfd import suggest_order
from robustid.report import write_report
from support.browser import CHROMIUM, opened, plots, widths
from support.mfd_systems import noisy, random_modal_system

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs the browser `chromium` on the path")


def identified(**names: Any) -> rid.Identification:
    experiment = rid.flexible_structure(extra_hz=(17.5, 17.67, 17.8))
    frf, record = experiment.frequency, experiment.time
    frf = rid.FrequencyResponse(frf.omega, frf.values, bound=frf.bound, dt=frf.dt, **names)
    record = rid.TimeRecord(record.u, record.y, bound=record.bound, dt=record.dt, **names)
    pair = rid.kautz(2 * np.pi * 17.3, 0.004, dt=0.01, delay=1)
    prior = rid.Prior(gain_bound=20.0, decay_rate=1.04)
    return rid.identify(rid.MixedProblem(frequency=frf, time=record, prior=prior, parametric=pair))


def test_the_page_draws_every_plot_without_an_error(tmp_path: Path) -> None:
    from robustid.reduction import balanced_truncation

    result = identified(inputs=["force [N]"], outputs=["displacement [mm]"])
    write_report(result, tmp_path / "report.html", reduction=balanced_truncation(result.model, tol=0.01))
    dom, console = opened(tmp_path / "report.html", tmp_path / "profile")
    assert console == []
    found = plots(dom)
    assert set(found) == {
        *("frequency-0", "time-0", "time-1", "time-2", "residuals-0", "residuals-1", "hankel-0", "poles-0", "poles-1")
    }
    for name, markup in found.items():
        assert 'class="main-svg"' in markup, name
        assert re.search(r'<g class="trace scatter[^>]*>.*?<path[^>]* d="M[^"]{8,}', markup, re.S), name
        assert "sendChartToCloud" not in markup, name
        assert "Share chart" not in markup, name
    assert "errorbar" in found["frequency-0"]
    assert "displacement [mm] / force [N]" in found["frequency-0"]


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of a 2 x 2 fit with one rigid-body mode, of a sweep over the order, on noisy data."""
    omega = 2 * np.pi * np.geomspace(4, 1200, 120)
    s = 1j * omega
    flexible = noisy(np.random.default_rng(0), random_modal_system(3, 2, 2, 2).response(s))
    rigid = np.array([[1.0], [-0.3]]) @ np.array([[2.0, 1.0]]) * 1e4 / (s**2)[:, None, None]
    names = {"inputs": ["force [N]", "torque [Nm]"], "outputs": ["displacement [mm]", "rotation [mrad]"]}
    data = rid.FrequencyResponse(omega, flexible + rigid, **names)
    sweep = suggest_order(data, orders=range(5, 9), rigid_body=rid.RigidBody(1))
    path = tmp_path_factory.mktemp("fit") / "fit.html"
    write_report(rid.fit_mfd(data, order=6, rigid_body=rid.RigidBody(1)), path, data=data, order_sweep=sweep)
    return path


def test_the_page_of_a_fit_draws_every_plot_without_an_error(fitted: Path, tmp_path: Path) -> None:
    dom, console = opened(fitted, tmp_path / "profile")
    assert console == []
    found = plots(dom)
    assert len(found) == len(re.findall('<figure class="plot', fitted.read_text(encoding="utf-8")))
    for name, markup in found.items():
        assert 'class="main-svg"' in markup, name
        assert re.search(r'<g class="trace scatter[^>]*>.*?<path[^>]* d="M[^"]{8,}', markup, re.S), name
        assert "sendChartToCloud" not in markup, name
    assert any("rotation [mrad] / torque [Nm]" in markup for markup in found.values())


@pytest.mark.parametrize("width", [390, 1280])
def test_the_page_of_a_fit_needs_no_sideways_scroll(fitted: Path, tmp_path: Path, width: int) -> None:
    client, scroll = widths(fitted, width, tmp_path)
    assert width - 20 <= client <= width
    assert scroll <= client


def test_text_of_strangers_runs_nothing_and_is_shown_as_it_stands(tmp_path: Path) -> None:
    nasty = "<script>alert('owned')</script>"
    label = "</script><img src=x onerror=alert('owned')><b>y</b>"
    result = identified(inputs=[(nasty, "N")], outputs=[(label, "</script>")])
    write_report(result, tmp_path / "report.html", title='"Title" & </title>')
    dom, console = opened(tmp_path / "report.html", tmp_path / "profile")
    assert console == []
    assert '<title>"Title" &amp; &lt;/title&gt;</title>' in dom
    assert "owned'</script>" not in dom.replace("&lt;/script&gt;", "")
    assert not re.search(r"<img|<b>y", dom)
    title = plots(dom)["time-0"]
    shown = re.search(r'<text class="ytitle"[^>]*>(.*?)</text>', title, re.S)
    assert shown is not None
    assert shown.group(1).startswith("&lt;/script&gt;&lt;img src=x")


def test_the_page_of_a_response_draws_every_plot_and_fits_narrow_windows(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    u = rng.standard_normal((2, 1500, 2))
    names = {"inputs": ["force [N]", "torque [Nm]"], "outputs": ["displacement of the table [mm]", "<b>angle</b>"]}
    records = [rid.TimeRecord(x, x @ [[1, 2], [1, -1]] + rng.standard_normal(x.shape), dt=0.01, **names) for x in u]
    write_report(rid.estimate_frf(records), tmp_path / "frf.html", records=records)
    dom, console = opened(tmp_path / "frf.html", tmp_path / "profile")
    assert console == []
    found = plots(dom)
    entries = {f"entry-{i}-{j}-0" for i in (0, 1) for j in (0, 1)}
    assert set(found) == entries | {"singular-0", "coherence-0", "input-0-0", "input-1-0", "output-0-0", "output-1-0"}
    for name, markup in found.items():
        assert re.search(r'<g class="trace scatter[^>]*>.*?<path[^>]* d="M[^"]{8,}', markup, re.S), name
    window, page = widths(tmp_path / "frf.html", 360, tmp_path)
    assert page <= window
