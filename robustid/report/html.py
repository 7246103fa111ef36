"""A document as one HTML file that needs nothing else: no network, no server, no other file."""

from __future__ import annotations

import base64
import datetime
import functools
import importlib.metadata
import io
import json
import platform
import zlib
from collections.abc import Sequence
from typing import TYPE_CHECKING

from robustid._version import __version__
from robustid.core import Budget, Progress, in_short
from robustid.report.charts import Chart, Layer
from robustid.report.document import MOST_WARNINGS, Block, Document, Drawing, Grid, Text
from robustid.report.with_matplotlib import draw
from robustid.report.with_plotly import Figure, figures

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup
    from matplotlib.figure import Figure as Picture

_SIGNS = {
    "circle": "M10.6 5a3.4 3.4 0 1 0 6.8 0a3.4 3.4 0 1 0-6.8 0z",
    "diamond": "M14 .9l4.1 4.1l-4.1 4.1l-4.1-4.1z",
    "square": "M11 2h6v6h-6z",
    "triangle-up": "M14 1.2l4 7.2h-8z",
    "x": "M11 2l6 6M17 2l-6 6",
    "line-ew": "M10.5 5h7",
}  # of markers in legends, in a field of 28 x 10
_COLUMNS = 4  # of small figures on a wide screen
_COLOURS = {"consistent": "0,158,115", "inconsistent": "213,94,0", "failed": "120,120,120"}  # of heads
_OTHER = "230,159,0"
_PACKAGES = ("numpy", "scipy", "cvxpy", "clarabel", "control")
MOST_BYTES = 360_000  # of all pictures of a page, as base64
_PALETTE = 96  # of a picture: those of its curves, and steps between
_FIRST = 110  # dots per inch of the picture of the first screen
_FINENESS = (110, 96, 84, 72, 60, 50, 40, 32)  # of the others, tried one after another
_SMALL = 0.6  # fineness of one of many pictures beside each other


def render(document: Document, *, static: bool = False, progress: Progress | None = None) -> str:
    """Render a document as the text of a page; a static one has pictures in place of scripts."""
    drawn = _figures(document)
    every = [figure for parts in drawn.values() for figure in parts]
    return (
        _environment()
        .get_template("document.html.j2")
        .render(
            document=document,
            warnings=[in_short(words) for words in document.warnings],
            most_warnings=MOST_WARNINGS,
            figures=drawn,
            pictures=pictures(every, progress) if static else {},
            static=static,
            versions=_versions(),
            date=datetime.datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z"),
            plotly="" if static else _plotly(),
            data=""
            if static
            else packed(
                json.dumps({figure.id: figure.spec for figure in every}, allow_nan=False, separators=(",", ":"))
            ),
        )
    )


def render_head(document: Document) -> str:
    """Render the first screen of a document, without its plot, for notebooks; of one without a verdict its title and text.

    Text has the colour of the notebook, behind it a veil, so that it can be read in light and dark ones.
    """
    colour = _COLOURS.get(document.verdict.key, _OTHER) if document.verdict else ""
    return _environment().get_template("notebook.html.j2").render(document=document, colour=colour)


def _figures(document: Document) -> dict[str, list[Figure]]:
    """Figures of every chart by its name."""
    drawn: dict[str, list[Figure]] = {}
    for block in document.blocks():
        if isinstance(block, Drawing):
            drawn[block.chart.name] = figures(block.chart)
        elif isinstance(block, Grid):
            drawn |= {chart.name: figures(chart, small=block.small) for chart in block.charts}
    return drawn


@functools.cache  # it keeps the compiled template, which takes longer than a page
def _environment() -> Environment:
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("robustid.report", "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    for function in (kind_of, words, legend_of, layers_of, columns_of, sign_of):
        environment.globals[function.__name__] = function  # pyright: ignore[reportUnknownMemberType] - values of any kind
    return environment


def kind_of(block: Block) -> str:
    """Name of a kind of block, by which the template renders it."""
    return type(block).__name__


def legend_of(grid: Grid) -> list[Layer]:
    """One layer of each name, for the legend that stands before all figures of a grid."""
    found: dict[str, Layer] = {}
    for layer in (layer for chart in grid.charts for panel in chart.panels for layer in panel.layers):
        found.setdefault(layer.name, layer)
    return list(found.values())


def layers_of(chart: Chart) -> list[Layer]:
    """One layer of each name of a chart."""
    return legend_of(Grid([chart], 1))


def sign_of(marker: str) -> str:
    """The marker of a legend as the path of a drawing."""
    return _SIGNS.get(marker.removesuffix("-open"), _SIGNS["circle"])


def columns_of(grid: Grid) -> int:
    """Number of columns of a grid on a wide screen."""
    return min(grid.columns, _COLUMNS)


def words(text: Text) -> Markup:
    """The text, escaped, with the words of programs marked as such."""
    import markupsafe

    out = markupsafe.escape(f"{text.head}: {text.text}" if text.head else text.text)
    for said in text.code:
        unbroken = markupsafe.Markup(" ").join(markupsafe.Markup("<span>{}</span>").format(one) for one in said.split())
        marked = unbroken if " --" in said else said  # no line breaks inside of an option
        out = out.replace(markupsafe.escape(said), markupsafe.Markup("<code>{}</code>").format(marked))
    return out


@functools.cache
def _versions() -> list[tuple[str, str]]:
    """Programs that computed this, with their versions."""
    first = [("robustid", __version__), ("Python", platform.python_version())]
    return first + [(name, importlib.metadata.version(name)) for name in _PACKAGES]


def packed(text: str) -> str:
    """Pack text for a script element: deflated, as letters that can't end the element; a browser unpacks it."""
    return base64.b64encode(zlib.compress(text.encode(), 6)).decode()


@functools.cache
def _plotly() -> str:
    """Source of the library that draws the figures."""
    from plotly.offline import get_plotlyjs  # type: ignore[reportMissingTypeStubs]

    return packed(get_plotlyjs())


def pictures(figures: Sequence[Figure], progress: Progress | None = None) -> dict[str, str]:
    """Draw figures as PNG data addresses by their id, as fine as fits into `MOST_BYTES`; the first is always fine."""
    drawn = [draw(Chart(one.id, one.panels, linked=True, grid=one.small)) for one in figures]
    found: dict[str, str] = {}
    for dpi in _FINENESS:
        budget = Budget(None, progress, f"drawing pictures of {dpi} dots per inch")
        for k, (figure, picture) in enumerate(zip(figures, drawn, strict=True)):
            budget.tell(k, len(figures))
            fine = _FIRST if figure is figures[0] else dpi * (_SMALL if figure.small else 1.0)
            found[figure.id] = _address(picture, fine)
        if sum(map(len, found.values())) <= MOST_BYTES:
            break
    return found


def _address(figure: Picture, dpi: float) -> str:
    from PIL import Image

    raw, small = io.BytesIO(), io.BytesIO()
    figure.savefig(raw, format="png", dpi=dpi)  # pyright: ignore[reportUnknownMemberType] - keywords without types
    # Every colour counts, those of few points too: not only the frequent ones.
    few = Image.open(raw).convert("RGB").quantize(_PALETTE, method=Image.Quantize.MAXCOVERAGE)
    few.save(small, format="png", optimize=True)
    return f"data:image/png;base64,{base64.b64encode(small.getvalue()).decode()}"
