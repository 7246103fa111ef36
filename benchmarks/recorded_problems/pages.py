"""Pages and their figures, pictures, and the summaries of a terminal."""

from __future__ import annotations

import base64
import html.parser
import io
import json
import zlib

import control
import numpy as np

import robustid as rid
from robustid.guarantees import check_samples
from robustid.report import live_figure, live_words, look_figure, look_words, render_summary

from .guarantees import close_box
from .plants import DT, HZ, matrix_problem, matrix_response, modal_system, noisy, structure
from .registry import problem

FEW = 12  # numbers of a line of a figure that are kept


class Visible(html.parser.HTMLParser):
    """The text of a page without its scripts and styles, and its scripts."""

    def __init__(self, source):
        super().__init__()
        self.text, self.scripts, self._hidden = [], [], False
        self.feed(source)

    def handle_starttag(self, tag, attrs):
        self._hidden = self._hidden or tag in ("script", "style")

    def handle_endtag(self, tag):
        self._hidden = self._hidden and tag not in ("script", "style")

    def handle_data(self, data):
        if self._hidden:
            self.scripts.append(data)
        elif data.strip():
            self.text.append(" ".join(data.split()))


def page(path):
    return "\n".join(Visible(path.read_text(encoding="utf-8")).text)


def figures(path):
    """The lines of every figure of a page below its first screen, by their names."""
    packed = Visible(path.read_text(encoding="utf-8")).scripts[-2]
    every = json.loads(zlib.decompress(base64.b64decode(packed)))
    return {name: lines_of(figure) for name, figure in every.items()}


def lines_of(figure):
    """Name, number of points, and some of the ordinates of every line of a figure of plotly."""
    return [
        {"name": str(line.get("name")), "points": len(_numbers(line.get("y"))), "y": some(_numbers(line.get("y")))}
        for line in figure["data"]
    ]


def _numbers(values):
    if isinstance(values, dict):  # packed by plotly
        return np.frombuffer(base64.b64decode(values["bdata"]), values["dtype"]).astype(float)
    return np.array(
        [np.nan if one is None else one for one in values if not isinstance(one, str)] if values is not None else [],
        float,
    )


def some(values):
    values = np.asarray(values, float).ravel()
    return values[np.linspace(0, values.size - 1, min(FEW, values.size)).astype(int)]


def printed(result, reduction=None):
    """The summary for a terminal, 160 columns wide."""
    import rich.console

    console = rich.console.Console(file=io.StringIO(), width=160)
    console.print(render_summary(result, reduction))
    return console.file.getvalue()


@problem()
def summaries(_):
    found = rid.identify(structure())
    small = rid.reduce_within_bounds(found)
    fit = rid.fit_mfd(noisy(modal_system(), HZ * np.geomspace(4, 1200, 80)), order=6)
    matrix = rid.identify(matrix_problem(matrix_response()))
    return {
        "identified": printed(found, small),
        "inconsistent": printed(rid.identify(structure(hz=17.0))),
        "matrix": printed(matrix),
        "fit": printed(fit),
        "response": printed(matrix_response()),
        "repr": [repr(found), repr(rid.band(found)), repr(structure()), repr(fit)],
    }


@problem()
def page_of_identification(folder):
    found = rid.identify(structure())
    small = rid.reduce_within_bounds(found)
    error = rid.worst_case_error(found, omega=HZ * np.array([5.0, 17.4]), directions=4)
    rid.write_report(found, folder / "page.html", reduction=small, worst_case=error, band=rid.band(found))
    return {"page": page(folder / "page.html")}


@problem(loose=("fit",))
def page_of_fit_and_response(folder):
    frf = noisy(modal_system(), HZ * np.geomspace(4, 1200, 80))
    rid.write_report(rid.fit_mfd(frf, order=6), folder / "fit.html")
    rid.write_report(matrix_response(), folder / "frf.html")
    return {name: page(folder / f"{name}.html") for name in ("fit", "frf")}


@problem(loose=("figures/frequency-0",))
def page_of_everything(folder):
    """Every section that a page can have, and its figures."""
    asked = structure(lines=4, samples=4)
    found, at = rid.identify(asked), HZ * np.array([5.0, 17.4])
    error = rid.worst_case_error(found, omega=at, directions=4)
    controller = control.ss(control.tf([0.2, -0.15], [1, -0.5], DT))
    rid.write_report(
        found,
        folder / "page.html",
        title="Everything",
        reduction=rid.reduce_within_bounds(found),
        worst_case=error,
        band=rid.band(found),
        tube=rid.guarantee.response_tube(found, input="step", times=[0.0, 0.01, 0.03]),
        over_poles=rid.guarantee.worst_case_over_poles(found, *close_box(), omega=at, directions=4, cells=2),
        stability=rid.band(found).robust_stability_margin(controller),
        sensitivity=rid.advise.sensitivity(asked, omega=at[:1]),
        findings=["one", "two"],
    )
    return {"page": page(folder / "page.html"), "figures": figures(folder / "page.html")}


@problem(loose=("page", "figures/orders-0"))
def page_of_orders(folder):
    model = modal_system(seed=5, outputs=1, inputs=1, modes=2, band_hz=(10.0, 150.0))
    frf = noisy(model, HZ * np.linspace(4, 230, 60))
    sweep = rid.fits.suggest_order(frf, orders=range(2, 6), time_limit=None)
    rid.write_report(sweep.fits[4], folder / "page.html", data=frf, order_sweep=sweep)
    return {"page": page(folder / "page.html"), "figures": figures(folder / "page.html")}


def drawn(figure):
    """Labels and lines of every panel of a picture."""
    return [
        {
            "labels": [axes.get_title(), axes.get_xlabel(), axes.get_ylabel()],
            "lines": [some(line.get_ydata()) for line in axes.lines],
        }
        for axes in figure.axes
    ]


@problem()
def pictures(_):
    import matplotlib.pyplot as plt

    found = rid.identify(structure())
    error = rid.worst_case_error(found, omega=HZ * np.array([5.0, 17.4]), directions=4)
    model = modal_system(seed=5, outputs=1, inputs=1, modes=2, band_hz=(10.0, 150.0))
    frf = noisy(model, HZ * np.linspace(4, 230, 60))
    things = {
        "identification": found,
        "error": error,
        "reduction": rid.reduce_within_bounds(found),
        "truncation": rid.balanced_truncation(model, order=2).model,
        "fit": rid.fit_mfd(frf, order=4),
        "response": frf,
    }
    table = {name: drawn(rid.plot.of(one)) for name, one in things.items()}
    table["nyquist"] = drawn(rid.plot.nyquist(error))
    for kind in ("residuals", "poles", "time_response"):
        table[kind] = drawn(getattr(rid.plot, kind)(found))
    plt.close("all")
    return table


@problem()
def live(_):
    """What is drawn and said while poles are moved."""
    asked, wrong = structure(time=False), structure(time=False, hz=17.0)
    found, table = rid.identify(asked), {}
    band = rid.band(found)
    for name, one in {"before": asked, "wrong": wrong}.items():
        check = check_samples(one)
        table[name] = {"words": look_words(check), "lines": lines_of(look_figure(check))}
    table["found"] = {"words": live_words(found, None, band), "lines": lines_of(live_figure(found, None, band))}
    table["contradicted"] = live_words(rid.identify(wrong))
    return table
