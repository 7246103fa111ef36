"""Everything that stands on the page."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from robustid.app.explore.quantities import STEPS, Quantity, quantities
from robustid.app.explore.session import Session
from robustid.core import Record

if TYPE_CHECKING:
    from dash.development.base_component import Component

POLL = 100  # milliseconds
_BUTTONS = ["select2d", "zoom2d", "pan2d", "resetScale2d", "toImage"]
_HEIGHT = "760px"
_PICTURE = (
    "Magnitude, phase and error over frequency: the data with their bounds, the proved band, the nominal model and its error, and"
    " the modes as vertical lines. All that can be done in the picture can be done in the fields too."
)
_BRUSH = (
    "Drag over points of the magnitude to leave them out, or to take them back; drag a vertical line to move its mode. Lines"
    " left out are frequencies in Hz with commas between them, and LOW:HIGH for all points between two frequencies."
)
_ADD = "Where the nominal model misses the data most, measured by their bounds"
_KEEP = "Its band, error and numbers stay beside those of the choices that follow"
_PROVED = (
    "Proved: the verdict, the margin, and the band at every frequency, which follows while a mode is dragged. It holds for poles"
    " anywhere in the box that the data left where modes are not moved by hand, and for poles taken as exact where they are: the"
    " legend says which. At the marked frequencies the range for poles taken as exact is proved another way (polygons of four"
    " sides, coarser than those of robustid run): a mark and the band both hold, and the narrower one says more. Everything holds"
    " for the modes, K and decay that are stated here."
)


def layout(session: Session, title: str, fields: Sequence[Any], views: Sequence[str] = (), place: int = 0) -> Component:
    """Return the parts of the page: verdict, picture and numbers; fields with what they state, in the order of `fields_of`.

    `views` are the names of the pages that stand beside this one, which is the one at `place`.
    """
    from dash import dcc, html

    return html.Div(
        [
            html.Header([html.H1(title), *_views(views, place)]),
            html.Main(
                [
                    html.Div([_verdict(), html.Div(id="kept"), _picture(), _numbers()], id="seen"),
                    _fields(session, fields, f"explored-{place + 1}.toml" if place else "explored.toml"),
                ]
            ),
            dcc.Interval(id="tick", interval=POLL),
            dcc.Store(id="shown", data=[-1, 0, 0]),
            dcc.Store(id="modes", data=fields[0]),
        ]
    )


def _views(names: Sequence[str], place: int) -> list[Component]:
    """The list from which another page is chosen; nothing where there is one page."""
    from dash import html

    if len(names) < 2:
        return []
    options = [html.Option(name, value=f"/{k}/" if k else "/", selected=k == place) for k, name in enumerate(names)]
    return [html.Div([html.Label("Shown", htmlFor="views"), html.Select(options, id="views")], className="views")]


def _verdict() -> Component:
    from dash import html

    work = [
        html.Label(id="doing", htmlFor="progress"),
        html.Progress(id="progress", max="1", value="0"),
        html.Button("Cancel", id="cancel", type="button"),
    ]
    parts = [
        html.P(id="verdict", role="status"),
        html.P(id="guarantee"),
        html.P(id="trouble", className="trouble", role="alert"),
        html.P(id="stopped", className="trouble", role="alert"),
        html.Div(work, id="work"),
    ]
    return html.Section(parts, **named("Verdict"))


def _picture() -> Component:
    from dash import dcc, html

    graph = dcc.Graph(
        id="picture",
        responsive=True,
        style={"height": _HEIGHT},
        config={"displaylogo": False, "edits": {"shapePosition": True}, "modeBarButtons": [_BUTTONS]},
        figure={"layout": {"xaxis": {"visible": False}, "yaxis": {"visible": False}}},
    )
    words = [html.P(text, className="soft") for text in (_BRUSH, _PROVED)]
    return html.Figure([html.Div(graph, role="img", **named(_PICTURE)), html.Figcaption(words)])


def _numbers() -> Component:
    from dash import html

    return html.Details([html.Summary("The result in numbers"), html.Pre(id="numbers")])


def _fields(session: Session, fields: Sequence[Any], name: str) -> Component:
    from dash import dcc, html

    count, *numbers, words = fields
    rows = [(one.group, row(one, number)) for one, number in zip(quantities(session), numbers, strict=True)]
    groups = {name: [one for _, one in ones] for name, ones in itertools.groupby(rows, key=lambda pair: pair[0])}
    *modes, rest = groups.items()
    points = [
        html.Label("Lines left out [Hz]", htmlFor="left-out"),
        dcc.Input(id="left-out", type="text", debounce=True, value=words),
    ]
    file = [
        html.Label("Name of the file", htmlFor="file"),
        dcc.Input(id="file", type="text", value=name),
        html.Button("Write it", id="write", type="button"),
        html.P(id="written", role="status"),
    ]
    parts = [rest, ("Frequency points", points), ("Run file", file)]
    sets = [html.Fieldset([html.Legend(name), *inside]) for name, inside in parts]
    keep = [
        html.Button("Keep", id="keep", type="button", title=_KEEP),
        html.Button("Forget", id="forget", type="button", title="Take what was kept away"),
    ]
    sets = [
        html.Div([*undo_redo(), *keep], className="buttons"),
        *(_mode(k, name, ones, hidden=k >= count) for k, (name, ones) in enumerate(modes)),
        html.Div(html.Button("Add a mode", id="add", type="button", title=_ADD), className="buttons"),
        *sets,
    ]
    return html.Section(sets, id="fields", **named("Choices"))


def _mode(place: int, name: str, rows: list[Component], hidden: bool) -> Component:
    """Fields of a mode, with a cross that removes it."""
    from dash import html

    words = f"Remove {name.lower()}"
    cross = html.Button("×", id=f"remove-{place}", type="button", title=words, className="cross", **named(words))
    parts = [html.Legend(name), cross, *rows]
    return html.Fieldset(parts, id=f"mode-{place}", hidden=hidden)


def undo_redo() -> list[Component]:
    """The buttons that go back and forth between what the fields stated."""
    from dash import html

    return [html.Button(name, id=name.lower(), type="button") for name in ("Undo", "Redo")]


def table(heads: Sequence[str], rows: Sequence[tuple[Sequence[str], str]]) -> Component:
    """A table; each row is its cells and its class."""
    from dash import html

    head = html.Thead(html.Tr([html.Th(one, scope="col") for one in heads]))
    body = [html.Tr([html.Td(cell) for cell in cells], className=key) for cells, key in rows]
    return html.Table([head, html.Tbody(body)])


def row(one: Quantity, number: object = None) -> Component:
    """A number with its field and its slider; `number` is in the field where it is not that of the start."""
    from dash import dcc, html

    if isinstance(number, int | float) and number != one.shown:
        one = dataclasses.replace(one, value=float(number))
    slider = f"{one.name}-slider"
    parts = [
        html.Label(one.label, htmlFor=one.name),
        dcc.Input(id=one.name, type="number", step="any", value=one.shown, debounce=0.15),
        html.Label(f"{one.label}, slider", htmlFor=slider, className="unseen"),
        dcc.Input(id=slider, type="range", min=0, max=STEPS, step=1, value=one.position),
    ]
    return html.Div(parts, className="row")


def named(words: str) -> Record:
    """The name of a part for those who don't see it."""
    return {"aria-label": words}
