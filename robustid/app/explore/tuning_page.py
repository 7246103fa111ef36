"""The page of a controller that is tuned by hand: its fields, its pictures, and how it reacts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from robustid.app.explore.history import History, connect_history
from robustid.app.explore.layout import POLL, named, row, table, undo_redo
from robustid.app.explore.quantities import Quantity
from robustid.app.explore.tuning import Tuned, Tuner, Tuning
from robustid.controllers import Corner, Gains, Kept, OneRoot, Section, TwoRoots
from robustid.errors import RobustIdError
from robustid.report import tuning_bode, tuning_limits, tuning_numbers, tuning_nyquist, tuning_words

if TYPE_CHECKING:
    from dash.development.base_component import Component

_NEAR, _WIDE = 3.0, 100.0  # factors from the start of a frequency, and of a gain, to the ends of its slider
_LEAST, _MOST = 1e-4, 3.0  # damping ratios
_KINDS = {Gains: "PID", TwoRoots: "Notch", OneRoot: "Lead or lag", Corner: "Low-pass", Kept: "Kept"}
_LABELS = {
    "gain": "overall gain",
    "kp": "kp",
    "ki": "ki [1/s]",
    "kd": "kd [s]",
    "filter_hz": "end of the derivative [Hz]",
    "zero_hz": "zeros [Hz]",
    "zero_damping": "zeros, damping",
    "pole_hz": "poles [Hz]",
    "pole_damping": "poles, damping",
    "corner_hz": "corner [Hz]",
}
_ONE = {"zero_hz": "zero [Hz]", "pole_hz": "pole [Hz]"}
_WHOLE = "Controller"
_SIGNED = ("gain", "kp", "ki", "kd", "zero_damping", "zero_hz")
_BODE = (
    "Magnitude over frequency of the open loop in the range of every consistent plant, and the largest sensitivity S,"
    " complementary sensitivity T, process sensitivity P S and control sensitivity C S, each with its limits and as it was with the"
    " controller of the design. All numbers of it are in the tables beside it."
)
_NYQUIST = (
    "Open loops near -1: each disc holds those of every consistent plant at a frequency; limits keep them out of what is"
    " dashed."
)
_WORDS = (
    "Worst cases over all consistent plants, exact at the frequencies of the curves; the proof holds between them too. Zeros of"
    " negative damping or frequency are unstable ones."
)


def tuning_quantities(tuning: Tuning) -> list[Quantity]:
    """Numbers of the sections, each with a field and a slider; their names are `names_of` of those of the sections."""
    found: list[Quantity] = []
    groups = _groups(tuning.start.parts)
    for name, value in tuning.start.numbers.items():
        place, _, own = name.rpartition("-")
        group = groups[int(place)] if place else _WHOLE
        one = isinstance(tuning.start.parts[int(place)], OneRoot) if place else False
        label = _ONE[own] if one else _LABELS[own]
        low, high = _ends(own, value)
        found.append(Quantity(f"tune-{name}", group, label, value, low, high, signed=own in _SIGNED))
    return found


def _ends(own: str, value: float) -> tuple[float, float]:
    """Ends of a slider, of the sign of the value."""
    if own.endswith("damping"):
        return math.copysign(_LEAST, value), math.copysign(max(_MOST, 2 * abs(value)), value)
    wide = _NEAR if own.endswith("hz") else _WIDE
    size = value or 1.0
    return size / wide, size * wide


def _groups(parts: Sequence[Section]) -> list[str]:
    """Names of the sections: numbers where there are several of a kind."""
    kinds = [_KINDS[type(one)] for one in parts]
    found: list[str] = []
    for k, (kind, part) in enumerate(zip(kinds, parts, strict=True)):
        several = kinds.count(kind) > 1
        name = f"{kind} {kinds[: k + 1].count(kind)}" if several else kind
        found.append(f"{name}: {part.name}" if isinstance(part, Kept) else name)
    return found


def tuning_layout(tuning: Tuning, title: str) -> Component:
    """Return the parts of the page: verdict, pictures and tables; fields."""
    from dash import dcc, html

    work = [html.Span(id="doing"), html.Button("Prove on the whole axis", id="prove", type="button")]
    verdict = [
        html.P(id="verdict", role="status"),
        html.P(id="trouble", className="trouble", role="alert"),
        html.P(id="stopped", className="trouble", role="alert"),
        html.Div(work, id="proving"),
    ]
    seen = [
        html.Section(verdict, **named("Verdict")),
        html.Div(
            [_graph("picture", "1080px", _BODE), html.Div([_graph("plane", "400px", _NYQUIST), html.Div(id="tables")])],
            id="both",
        ),
        html.P(_WORDS, className="soft"),
    ]
    return html.Div(
        [
            html.Header(html.H1(title)),
            html.Main([html.Div(seen, id="seen"), _fields(tuning)], className="tuning"),
            dcc.Interval(id="tick", interval=POLL),
            dcc.Store(id="shown", data=0),
        ]
    )


def _graph(name: str, height: str, words: str) -> Component:
    from dash import dcc, html

    graph = dcc.Graph(
        id=name,
        responsive=True,
        style={"height": height},
        config={"displaylogo": False, "modeBarButtons": [["zoom2d", "pan2d", "resetScale2d", "toImage"]]},
        figure={"layout": {"xaxis": {"visible": False}, "yaxis": {"visible": False}}},
    )
    return html.Div(graph, role="img", **named(words))


def _fields(tuning: Tuning) -> Component:
    from dash import dcc, html

    every = tuning_quantities(tuning)
    names = dict.fromkeys([*(one.group for one in every if one.group != _WHOLE), *_groups(tuning.start.parts)])
    sets: list[Component] = []
    for name in (_WHOLE, *names):
        inside = [row(one) for one in every if one.group == name]
        sets.append(
            html.Fieldset([html.Legend(name), *(inside or [html.P("stays as it was found", className="soft")])])
        )
    buttons = [*undo_redo(), html.Button("Back to the design", id="back", type="button")]
    file = [
        html.Label("Name of the file", htmlFor="file"),
        dcc.Input(id="file", type="text", value="tuned.npz"),
        html.Button("Write it", id="write", type="button"),
        html.P(id="written", role="status"),
    ]
    sets = [html.Div(buttons, className="buttons"), *sets, html.Fieldset([html.Legend("File"), *file])]
    return html.Section(sets, id="fields", **named("Numbers of the controller"))


def stated(every: Sequence[Quantity], values: Sequence[object]) -> dict[str, float]:
    """Numbers that fields state, by the names of the sections."""
    return {one.name.removeprefix("tune-"): one.checked(value) for one, value in zip(every, values, strict=True)}


def said(every: Sequence[Quantity], error: RobustIdError) -> str:
    """The sentence of an error, with the names of the fields."""
    names = {one.name.removeprefix("tune-"): f"{one.group}, {one.label}" for one in every}
    return error.said(names, unknown=str)


def connect_tuning(app: Any, tuner: Tuner) -> None:
    """Make the page of a Dash application react."""
    _connect_numbers(app, tuner)
    _connect_buttons(app, tuner)
    _connect_state(app, tuner)


def _connect_numbers(app: Any, tuner: Tuner) -> None:
    """Fields and sliders follow each other, and the worst cases follow them; earlier numbers come back."""
    from dash import ClientsideFunction, Input, Output, State

    every = tuning_quantities(tuner.tuning)
    start = [one.shown for one in every]
    history = History(start)
    for one in every:
        slider = f"{one.name}-slider"
        app.clientside_callback(
            ClientsideFunction("explore", "together"),
            *(Output(one.name, "value"), Output(slider, "value")),
            *(Input(one.name, "value"), Input(slider, "value")),
            State(one.name, "id"),
        )

    @app.callback(Output("trouble", "children"), *[Input(one.name, "value") for one in every])
    def turned(*values: object) -> str:
        history.note(values)
        try:
            tuner.turn(stated(every, values))
        except RobustIdError as error:
            return said(every, error)
        return ""

    connect_history(app, history, [(one.name, "value") for one in every])

    @app.callback(
        *[Output(one.name, "value", allow_duplicate=True) for one in every],
        Input("back", "n_clicks"),
        prevent_initial_call=True,
    )
    def returned(_: object) -> list[float]:
        return start


def _connect_buttons(app: Any, tuner: Tuner) -> None:
    """Buttons that prove and write."""
    from dash import Input, Output, State
    from dash.exceptions import PreventUpdate

    every = tuning_quantities(tuner.tuning)

    @app.callback(Output("prove", "title"), Input("prove", "n_clicks"), prevent_initial_call=True)
    def proved(_: object) -> str:
        tuner.prove()
        raise PreventUpdate

    @app.callback(
        Output("written", "children"),
        Input("write", "n_clicks"),
        State("file", "value"),
        *[State(one.name, "value") for one in every],
        prevent_initial_call=True,
    )
    def written(_: object, name: str | None, *values: object) -> str:
        try:
            sections = tuner.tuning.start.turned(stated(every, values))
            path = tuner.tuning.write(sections, name or "")
        except RobustIdError as error:
            return said(every, error)
        return f"Written: {path}, the controller C of u = −C y."


def _connect_state(app: Any, tuner: Tuner) -> None:
    """The page shows the newest look, and the proof as soon as it is there."""
    from dash import Input, Output, State
    from dash.exceptions import PreventUpdate

    @app.callback(
        *(Output("picture", "figure"), Output("plane", "figure"), Output("tables", "children")),
        *(Output("verdict", "children"), Output("verdict", "className"), Output("doing", "children")),
        *(Output("prove", "disabled"), Output("stopped", "children"), Output("shown", "data")),
        Input("tick", "n_intervals"),
        State("shown", "data"),
        prevent_initial_call=True,
        running=[(Output("tick", "disabled"), True, False)],
    )
    def looked(_: object, shown: int) -> tuple[object, ...]:
        found = tuner.found
        if shown == found.number:
            raise PreventUpdate
        return (*_seen(tuner, found), found.number)


def _seen(tuner: Tuner, found: Tuned) -> list[object]:
    look, limits = found.look or tuner.before, tuner.tuning.limits
    figures = [tuning_bode(look.found, tuner.before.found, limits), tuning_nyquist(look.found, limits)]
    for one in figures:
        one["layout"] |= {"uirevision": "kept", "autosize": True}
    key, verdict = tuning_words(look.found, look.shares, found.proof)
    doing = f"Computing the {found.doing}" if found.doing else ""
    return [
        *figures,
        _tables(tuner, look.shares),
        verdict,
        key,
        doing,
        bool(found.doing),
        found.trouble.replace("`", ""),
    ]


def _tables(tuner: Tuner, shares: Mapping[str, tuple[float, float]]) -> list[Component]:
    """Limits with the share that is taken, and worst-case numbers, beside those of the design."""
    now, design = tuning_numbers(tuner.look.found), tuning_numbers(tuner.before.found)
    numbers = [((name, value, was), "") for (name, value), (_, was) in zip(now, design, strict=True)]
    rows = [
        ((f"{name}: {asked}", share, hz), "" if kept else "over")
        for name, asked, share, hz, kept in tuning_limits(shares, tuner.tuning.limits)
    ]
    found = [table(("worst case", "now", "design"), numbers)]
    return [*found, table(("limit", "share taken", "near [Hz]"), rows)] if rows else found
