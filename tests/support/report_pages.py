"""What the tests of reports share: identifications worth a page, and a page read back."""

import base64
import dataclasses
import functools
import html.parser
import io
import json
import re
import zlib

import numpy as np
import rich.console

import robustid as rid
from robustid.guarantees import CircleBound
from robustid.report import render_summary
from support.bounds import rebound

NASTY = "<script>alert(1)</script>"
NASTY_NAMES = {"inputs": [(NASTY, "</script>")], "outputs": [("y\"'&", "<img src=x onerror=alert(2)>")]}


def problem(*, hz=17.67, time=True, frequency=True, **names):
    experiment = rid.datasets.flexible_structure(extra_hz=(17.5, 17.67, 17.8))
    frf, record = (dataclasses.replace(data, **names) for data in (experiment.frequency, experiment.time))
    return rid.MixedProblem(
        frequency=frf if frequency else None,
        time=record if time else None,
        prior=rid.Prior(gain_bound=20.0, decay_rate=1.04),
        parametric=rid.kautz(2 * np.pi * hz, 0.004, dt=0.01, delay=1),
    )


def consistent_result():
    return rid.identify(problem(inputs=["current [A]"], outputs=["torsion [rad]"]))


def inconsistent_result():
    return rid.identify(problem(hz=17.3))


def simple_result():
    """Four samples, no parametric part: margin known to be limited by the first."""
    record = rid.TimeRecord(np.eye(1, 4)[0], [1.5, 0.2, 0.1, 0.05], dt=0.1, bound=0.2)
    return rid.identify(rid.MixedProblem(time=record, prior=rid.Prior(gain_bound=1.0, decay_rate=1.1)))


def identified(tilt=None, **names):
    """A structure with a light mode whose poles are known, seven lines."""
    return _structure() if tilt is None and not names else _structure_of(tilt, names)


@functools.cache
def _structure():
    """The one that several files are about."""
    return _structure_of(None, {})


def _structure_of(tilt, names):
    data = rid.datasets.flexible_structure(lines=5, extra_hz=(17.5, 17.7))
    frf = dataclasses.replace(rebound(data.frequency, tilt=tilt), **names)
    modes = rid.kautz(data.modes[:, 0], data.modes[:, 1], dt=frf.dt, delay=1)
    prior = rid.Prior(gain_bound=0.3, decay_rate=1.2)
    return rid.identify(rid.MixedProblem(frequency=frf, prior=prior, parametric=modes))


def named(panel, name):
    return next(layer for layer in panel.layers if layer.name == name)


def layers(chart, panel=0):
    return {layer.name: layer for layer in chart.panels[panel].layers}


def with_circle(error):
    """A copy whose bound on the whole circle is there already; three arcs, not computed."""
    edges = np.array([0.0, 10.0, 100.0, np.pi / error.identification.problem.dt])
    return error.with_circle(CircleBound(edges, np.array([0.4, 0.9, 0.123456]), 0.3, True, ()))


def printed(result, reduction=None, *, width=160, **options):
    console = rich.console.Console(file=io.StringIO(), width=width)
    console.print(render_summary(result, reduction, **options))
    return console.file.getvalue()


class Page(html.parser.HTMLParser):
    """The text that a reader sees, the tags, and the scripts, as a browser's parser would find them."""

    def __init__(self, source):
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text, self.scripts, self._inside = "", [], ""
        self.feed(source)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        self._inside = tag
        if tag == "script":
            self.scripts.append("")

    def handle_endtag(self, tag):
        self._inside = ""

    def handle_data(self, data):
        if self._inside == "script":
            self.scripts[-1] += data
        elif self._inside != "style":
            self.text += data

    @property
    def figures(self):
        """Those below the first screen."""
        return {name: figure for name, figure in self.every.items() if name != "first-0"}

    @property
    def every(self):
        """Figures by their names, that of the first screen among them."""
        return json.loads(zlib.decompress(base64.b64decode(self.scripts[-2])))


def check_escaped(page):
    """No script, picture or label of the user's own: three scripts of ours, and no tag but a line break in a label of plotly's."""
    assert len(page.scripts) == 3
    assert not any("alert(1)" in script for script in (page.scripts[0], page.scripts[2]))
    assert not any(tag == "img" for tag, _ in page.tags)
    for label in labels_of(page.figures):
        assert not re.search(r"<(?!br>)", label), label


def labels_of(figure):
    """Every text in a description of figures."""
    if isinstance(figure, dict):
        return [text for part in figure.values() for text in labels_of(part)]
    if isinstance(figure, list):
        return [text for part in figure for text in labels_of(part)]
    return [figure] if isinstance(figure, str) else []
