"""The page: its fields, its picture, and what happens when they are changed."""

from __future__ import annotations

import dataclasses
import itertools
import math
from pathlib import Path
from typing import Any

from robustid.app.explore.session import Choice, Session, toggled
from robustid.app.explore.worker import BAND, Found, Worker
from robustid.core import atomic_write
from robustid.errors import InputError, RobustIdError
from robustid.report import live_figure, live_words

_REST = "Non-parametric part"
_STEPS = 1000  # of a slider
_POLL = 100  # milliseconds
_BUTTONS = ["select2d", "zoom2d", "pan2d", "resetScale2d", "toImage"]
_NEAR, _WIDE = 1.2, 100.0  # factors from the start of a frequency, and of all else, to the ends of its slider
_LEAST, _MOST = 1e-5, 1.0  # damping ratios
_PROVED = (
    "Proved: the verdict, the margin, and the range of the response at the marked frequencies, coarser than robustid run gives it"
    " (polygons of four sides). Between these the picture is interpolated for the eye. The dotted estimate is not proved; it is"
    " gone when all frequencies are bounded. Everything holds for the modes, K and decay that are stated here."
)
_BRUSH = (
    "Drag over points of the magnitude to leave them out, or to take them back; drag a vertical line to move its mode. In the"
    " field: frequencies in Hz, with commas between them, and LOW:HIGH for all points between two frequencies."
)


@dataclasses.dataclass(frozen=True)
class Quantity:
    """A number with a field and a slider, whose positions are equal factors of `value - offset`."""

    name: str
    group: str
    label: str
    value: float
    low: float
    high: float
    offset: float = 0.0

    @property
    def position(self) -> float:
        """Place of the value on its slider."""
        share = math.log((self.value - self.offset) / self.low) / math.log(self.high / self.low)
        return round(_STEPS * min(max(share, 0.0), 1.0))


def quantities(session: Session) -> list[Quantity]:
    """Everything with a slider: frequency and damping of every mode, K, and the decay."""
    start, found = session.start, []
    for k, (hz, damping) in enumerate(zip(start.hz, start.damping, strict=True)):
        mode = f"Mode {k + 1}"
        found.append(Quantity(f"hz-{k}", mode, "frequency [Hz]", hz, hz / _NEAR, hz * _NEAR))
        found.append(Quantity(f"damping-{k}", mode, "damping ratio", damping, _LEAST, _MOST))
    gain, rate = start.gain_bound, start.rate
    found.append(Quantity("gain", _REST, "gain bound K", gain, gain / _WIDE, gain * _WIDE))
    if session.continuous:
        return [*found, Quantity("rate", _REST, "decay α [1/s]", rate, rate / _WIDE, rate * _WIDE)]
    return [*found, Quantity("rate", _REST, "decay rate ρ", rate, (rate - 1) / _WIDE, (rate - 1) * _WIDE, 1.0)]


def layout(session: Session, title: str) -> Any:
    """Everything that stands on the page."""
    from dash import dcc, html

    groups = itertools.groupby(quantities(session), key=lambda one: one.group)
    picture = dcc.Graph(
        id="picture",
        responsive=True,
        style={"height": "760px"},
        config={"displaylogo": False, "edits": {"shapePosition": True}, "modeBarButtons": [_BUTTONS]},
        figure={"layout": {"xaxis": {"visible": False}, "yaxis": {"visible": False}}},
    )
    verdict = html.Section(
        [
            html.P(id="verdict", role="status"),
            html.P(id="guarantee"),
            html.P(id="trouble", className="trouble", role="alert"),
            html.P(id="stopped", className="trouble", role="alert"),
            html.Div(
                [
                    html.Label(id="doing", htmlFor="progress"),
                    html.Progress(id="progress", max="1", value="0"),
                    html.Button("Cancel", id="cancel", type="button"),
                ],
                id="work",
            ),
        ],
        **{"aria-label": "Verdict"},
    )
    fields = html.Section(
        [
            *[html.Fieldset([html.Legend(name), *[_row(one) for one in group]]) for name, group in groups],
            html.Fieldset(
                [
                    html.Legend("Frequency points"),
                    html.Label("Lines left out [Hz]", htmlFor="left-out"),
                    dcc.Input(
                        id="left-out", type="text", debounce=True, value=session.words(session.start.left_out_hz)
                    ),
                    html.P(_BRUSH, className="soft"),
                ]
            ),
            html.Fieldset(
                [
                    html.Legend("Run file"),
                    html.Label("Name of the file", htmlFor="file"),
                    dcc.Input(id="file", type="text", value="explored.toml"),
                    html.Button("Write it", id="write", type="button"),
                    html.P(id="written", role="status"),
                ]
            ),
        ],
        id="fields",
        **{"aria-label": "Choices"},
    )
    figure = html.Figure([picture, html.Figcaption(_PROVED, className="soft")], **{"aria-labelledby": "verdict"})
    numbers = html.Details([html.Summary("The result in numbers"), html.Pre(id="numbers")])
    ticks = dcc.Interval(id="tick", interval=_POLL)
    return html.Div(
        [
            html.Header(html.H1(title)),
            html.Main([html.Div([verdict, figure, numbers], id="seen"), fields]),
            ticks,
            dcc.Store(id="shown", data=[-1, 0]),
        ]
    )


def _row(one: Quantity) -> Any:
    """A number with its field and its slider."""
    from dash import dcc, html

    slider = f"{one.name}-slider"
    return html.Div(
        [
            html.Label(one.label, htmlFor=one.name),
            dcc.Input(id=one.name, type="number", step="any", value=_short(one.value), debounce=0.15),
            html.Label(f"{one.label}, slider", htmlFor=slider, className="unseen"),
            dcc.Input(id=slider, type="range", min=0, max=_STEPS, step=1, value=one.position),
        ],
        className="row",
    )


def _short(value: float) -> float:
    return float(f"{value:.6g}")


def connect(app: Any, session: Session, worker: Worker) -> None:
    """Make the page do something."""
    from dash import ClientsideFunction, Input, Output, State, no_update
    from dash.exceptions import PreventUpdate

    every = quantities(session)
    hertz = [one.name for one in every if one.name.startswith("hz")]
    for one in every:
        slider = f"{one.name}-slider"
        app.clientside_callback(
            ClientsideFunction("explore", "together"),
            Output(one.name, "value"),
            Output(slider, "value"),
            Input(one.name, "value"),
            Input(slider, "value"),
            State(one.name, "id"),
            prevent_initial_call=True,
        )
    app.clientside_callback(
        ClientsideFunction("explore", "moved"),
        *[Output(name, "value", allow_duplicate=True) for name in hertz],
        Input("picture", "relayoutData"),
        *[State(name, "value") for name in hertz],
        prevent_initial_call=True,
    ) if hertz else None
    numbers = [Input(one.name, "value") for one in every]

    @app.callback(
        Output("left-out", "value"),
        Output("picture", "selectedData"),
        Input("picture", "selectedData"),
        State("left-out", "value"),
        prevent_initial_call=True,
    )
    def brushed(selected: Any, words: str | None) -> Any:
        points = (selected or {}).get("points", [])
        hz = [float(point["customdata"]) for point in points if "customdata" in point]
        if not hz:
            raise PreventUpdate
        try:
            before = session.points(words or "")
            brushed_hz = [float(session.points_hz[abs(session.points_hz - one).argmin()]) for one in hz]
        except RobustIdError:
            raise PreventUpdate from None  # the field says so already
        return session.words(toggled(before, brushed_hz)), None

    @app.callback(
        Output("trouble", "children"),
        *numbers,
        Input("left-out", "value"),
    )
    def chosen(*values: Any) -> str:
        try:
            worker.ask(_choice(session, every, values))
        except RobustIdError as error:
            return _spoken(error)
        return ""

    @app.callback(
        Output("picture", "figure"),
        Output("verdict", "children"),
        Output("verdict", "className"),
        Output("guarantee", "children"),
        Output("numbers", "children"),
        Output("doing", "children"),
        Output("progress", "value"),
        Output("work", "className"),
        Output("cancel", "children"),
        Output("stopped", "children"),
        Output("shown", "data"),
        Input("tick", "n_intervals"),
        State("shown", "data"),
        prevent_initial_call=True,
    )
    def looked(_: Any, shown: list[int]) -> Any:
        found = worker.found
        if shown == [found.number, found.done]:
            raise PreventUpdate
        return (
            *(_seen(session, found) if found.number != shown[0] else [no_update] * 5),
            _doing(found),
            str(found.done / found.count if found.count else 0),
            "" if found.doing or found.cancelled else "idle",
            "Cancel" if found.doing else "Compute again",
            found.trouble,
            [found.number, found.done],
        )

    @app.callback(Output("cancel", "title"), Input("cancel", "n_clicks"), prevent_initial_call=True)
    def cancelled(_: Any) -> Any:
        choice = worker.found.choice
        if worker.found.doing:
            worker.cancel()
        elif choice is not None:
            worker.ask(choice)
        raise PreventUpdate

    @app.callback(
        Output("written", "children"),
        Input("write", "n_clicks"),
        State("file", "value"),
        *[State(one.name, "value") for one in every],
        State("left-out", "value"),
        prevent_initial_call=True,
    )
    def written(_: Any, name: str | None, *values: Any) -> Any:
        try:
            path = write_run_file(session, _choice(session, every, values), name or "")
        except RobustIdError as error:
            return _spoken(error)
        return f"Written: {path}. It gives the same again: robustid run {path}"


def _choice(session: Session, every: list[Quantity], values: Any) -> Choice:
    """The choice that the fields state.

    Raises
    ------
    InputError
        A field without a number, or with one that makes no class.
    """
    *numbers, words = values
    found: dict[str, float] = {}
    for one, value in zip(every, numbers, strict=True):
        number = _number(one, value)
        # A field shows six digits; the number that it began with has more.
        found[one.name] = one.value if number == _short(one.value) else number
    count = len(session.start.hz)
    return Choice(
        tuple(found[f"hz-{k}"] for k in range(count)),
        tuple(found[f"damping-{k}"] for k in range(count)),
        found["gain"],
        found["rate"],
        session.points(words or ""),
    )


def _number(one: Quantity, value: Any) -> float:
    """A number of a field, checked."""
    dt = one.name.startswith("damping")
    if not isinstance(value, int | float) or not value > one.offset or not math.isfinite(value) or (dt and value > 1):
        wanted = "between 0 and 1" if dt else f"above {one.offset:g}"
        raise InputError(
            f"{one.group}, {one.label}: give a number {wanted}" + ("" if value is None else f"; got {value}")
        )
    return float(value)


def _seen(session: Session, found: Found) -> list[Any]:
    """Picture, verdict, its key, guarantee and numbers of a state; the picture before it stays until there is another one."""
    from dash import no_update

    if found.identification is None or found.choice is None:
        words = "The margin of this choice is being computed; the picture is of the one before." if found.doing else ""
        return [no_update, words, "", "", no_update]
    figure = live_figure(
        found.identification, found.error, found.estimate, session.left_out(found.choice), found.withheld
    )
    figure["layout"] |= {
        "uirevision": "kept",
        "selectionrevision": found.number,
        "dragmode": "select",
        "autosize": True,
        "shapes": [_line(hz, k) for k, hz in enumerate(found.choice.hz, start=1)],
    }
    key, verdict, guarantee = live_words(found.identification, found.error)
    if found.identification.consistent and found.error is None:
        guarantee = "The guaranteed range of the response is being computed."
    return [figure, verdict, key, guarantee, found.identification.summary()]


def _line(hz: float, number: int) -> dict[str, Any]:
    """The vertical line of a mode, which can be dragged."""
    look = {"color": "#CC79A7", "width": 4, "dash": "dot"}
    label = {"text": f"mode {number}", "textposition": "start", "font": {"color": "#8f2f66"}}
    return {"type": "line", "x0": hz, "x1": hz, "y0": 0, "y1": 1, "yref": "y domain", "line": look, "label": label}


def _doing(found: Found) -> str:
    if found.cancelled:
        return "Cancelled."
    if not found.doing:
        return ""
    if found.doing == BAND and found.error is not None:
        return f"Computing the {found.doing}: {found.error.omega.size} frequencies are bounded"
    return f"Computing the {found.doing}"


def write_run_file(session: Session, choice: Choice, name: str) -> Path:
    """Write a run file that gives the same identification again; its name is seen from where the program was started.

    Raises
    ------
    InputError
        No name, another ending, a file that exists, a folder that can't be written to.
    """
    path = Path(name.strip())
    if path.suffix != ".toml":
        raise InputError(f"The run file needs a name that ends in .toml; got {name!r}")
    if path.exists():
        raise InputError(f"{path} exists; choose another name")
    if not path.parent.is_dir():
        raise InputError(f"The folder {path.parent} does not exist; choose another one")
    text = session.stated(choice).moved(session.folder, path.parent).text()
    with atomic_write(path) as file:
        file.write(text)
    return path


def _spoken(error: Exception) -> str:
    """A sentence of the library without the marks of Python."""
    return str(error).replace("`", "")
