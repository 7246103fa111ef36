"""The report in a real browser: every plot drawn, no error in the console, nothing fetched."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import robustid as rid
from robustid.report import write_report

CHROMIUM = shutil.which("chromium")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs the browser `chromium` on the path")

_FLAGS = (
    "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking"
    " --disable-component-update --disable-sync --enable-logging=stderr --v=0 --virtual-time-budget=20000 --dump-dom"
)


def opened(page: Path, profile: Path) -> tuple[str, list[str]]:
    """The document after its scripts ran, and what they wrote to the console."""
    command = [str(CHROMIUM), *_FLAGS.split(), f"--user-data-dir={profile}", page.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    return done.stdout, [line for line in done.stderr.splitlines() if "CONSOLE" in line]


def plots(dom: str) -> dict[str, str]:
    """The markup of each plot by its id."""
    parts = re.split(r'<figure class="plot[^"]*" id="([^"]+)"', dom)
    return {name: part.split("</figure>")[0] for name, part in zip(parts[1::2], parts[2::2], strict=True)}


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
