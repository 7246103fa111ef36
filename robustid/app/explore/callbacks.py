"""The reactions of the page: fields that are changed, modes that are added, choices that are kept, a computation that goes on."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from robustid.app.explore.history import History, connect_history
from robustid.app.explore.layout import table
from robustid.app.explore.quantities import LIGHT, choice_of, mode_names, quantities
from robustid.app.explore.session import ByHand, Session, toggled
from robustid.app.explore.worker import BAND, Computed, Worker
from robustid.core import atomic_write, counted
from robustid.errors import InputError, RobustIdError
from robustid.identification import Identification
from robustid.report import live_figure, live_numbers, live_words, look_figure, look_words

if TYPE_CHECKING:
    from dash.development.base_component import Component

# An `app` is a Dash, whose callbacks have no types.
_WAITING = "This choice is being looked at; what is drawn is of the one before."
_MODE = {"color": "#a8447d", "width": 4, "dash": "dot"}
_DIGITS = 6  # of a field


def connect(app: Any, session: Session, worker: Worker, history: History) -> None:
    """Make the page of a Dash application react; `history` begins with what its fields state."""
    _connect_fields(app, session)
    connect_modes(app, session, worker)
    connect_kept(app, worker)
    _connect_computation(app, session, worker, history)
    _connect_state(app, session, worker)


def _connect_fields(app: Any, session: Session) -> None:
    """Fields and sliders follow each other, in the browser; points that are brushed are left out or taken back."""
    from dash import ClientsideFunction, Input, Output, State
    from dash.exceptions import PreventUpdate

    for one in quantities(session):
        slider = f"{one.name}-slider"
        app.clientside_callback(
            ClientsideFunction("explore", "together"),
            *(Output(one.name, "value"), Output(slider, "value")),
            *(Input(one.name, "value"), Input(slider, "value")),
            State(one.name, "id"),
        )

    @app.callback(
        *(Output("left-out", "value"), Output("picture", "selectedData")),
        Input("picture", "selectedData"),
        State("left-out", "value"),
        prevent_initial_call=True,
    )
    def brushed(selected: dict[str, list[dict[str, float]]] | None, words: str | None) -> tuple[str, None]:
        points = [point for point in (selected or {}).get("points", []) if "customdata" in point]
        if not points:
            raise PreventUpdate
        every_hz = session.points_hz
        over = [float(every_hz[abs(every_hz - float(point["customdata"])).argmin()]) for point in points]
        try:
            before = session.points(words or "")
        except RobustIdError:
            raise PreventUpdate from None  # said beside the field already
        return session.words(toggled(before, over)), None


def _connect_computation(app: Any, session: Session, worker: Worker, history: History) -> None:
    """The fields start a computation, a button stops it, another one writes the run file."""
    from dash import Input, Output, State
    from dash.exceptions import PreventUpdate

    every = quantities(session)
    fields = [("modes", "data"), *((one.name, "value") for one in every), ("left-out", "value")]
    connect_history(app, history, fields)

    @app.callback(Output("trouble", "children"), *[Input(*field) for field in fields])
    def chosen(*values: float | str | None) -> str:
        history.note(values)
        try:
            choice = choice_of(session, every, values)
            session.note(choice)
            worker.ask(choice)
        except RobustIdError as error:
            return error.said({}, unknown=str)
        return ""

    @app.callback(Output("cancel", "title"), Input("cancel", "n_clicks"), prevent_initial_call=True)
    def cancelled(_: object) -> None:
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
        *[State(*field) for field in fields],
        prevent_initial_call=True,
    )
    def written(_: object, name: str | None, *values: float | str | None) -> str:
        try:
            path = write_run_file(session, choice_of(session, every, values), name or "")
        except RobustIdError as error:
            return error.said({}, unknown=str)
        same = "It gives the same again" if session.shared is None else "All members, and one class that holds theirs"
        return f"Written: {path}. {same}: robustid run {path}"


def _connect_state(app: Any, session: Session, worker: Worker) -> None:
    """The page shows the state of the computation as soon as it changes."""
    from dash import Input, Output, State, no_update
    from dash.exceptions import PreventUpdate

    @app.callback(
        *(Output("picture", "figure"), Output("verdict", "children"), Output("verdict", "className")),
        *(Output("guarantee", "children"), Output("numbers", "children"), Output("kept", "children")),
        *(Output("doing", "children"), Output("progress", "value"), Output("work", "className")),
        *(Output("cancel", "children"), Output("stopped", "children"), Output("shown", "data")),
        Input("tick", "n_intervals"),
        State("shown", "data"),
        prevent_initial_call=True,
        running=[
            (Output("tick", "disabled"), True, False)
        ],  # an answer that comes after the next question would be lost
    )
    def looked(_: object, shown: list[int]) -> tuple[object, ...]:
        found = worker.found
        state = [found.number, found.done, 0 if found.look is None else found.look.number]
        if shown == state:
            raise PreventUpdate
        kept = worker.kept
        seen = [no_update] * 6
        if found.number != shown[0]:
            seen = [*_seen(session, found, kept, shown[2]), compared(session, kept, found)]
        share = found.done / found.count if found.count else 0
        work = "" if found.doing or found.cancelled else "idle"
        button = "Cancel" if found.doing else "Compute again"
        return *seen, _doing(found), str(share), work, button, found.trouble.replace("`", ""), state


def _seen(session: Session, found: Computed, kept: Computed | None, looked: int) -> list[object]:
    """Picture, verdict, its key, guarantee and numbers; the picture before it stays until there is another one.

    `looked` is the number of the look that is drawn already.
    """
    from dash import no_update

    look, identification = found.look, found.identification
    if look is None or (identification is None and look.number == looked):
        return [no_update, _WAITING if found.doing else "", "", "", no_update]
    left_out, other = session.left_out(look.choice), None if kept is None else kept.band
    if identification is None:
        figure = look_figure(look.check, look.band, left_out, look.withheld, other)
        key, verdict, guarantee = look_words(look.check, look.band)
        numbers = no_update
    else:
        figure = live_figure(identification, found.error, found.band, left_out, look.withheld, other)
        key, verdict, guarantee = live_words(identification, found.error, found.band)
        numbers = identification.summary()
    figure["layout"] |= {
        "uirevision": "kept",  # zoom
        "selectionrevision": found.number,
        "dragmode": "select",
        "selectdirection": "h",
        "autosize": True,
        "shapes": [_line(hz, k) for k, hz in enumerate(look.choice.hz, start=1)],
    }
    return [figure, verdict, key, guarantee, numbers]


def _line(hz: float, number: int) -> dict[str, object]:
    """The vertical line of a mode, which can be dragged."""
    label: dict[str, object] = {"text": f"{number} ", "font": {"color": _MODE["color"]}}
    label |= {"textposition": "start", "textangle": 0, "xanchor": "right", "yanchor": "bottom"}
    return {"type": "line", "x0": hz, "x1": hz, "y0": 0, "y1": 1, "yref": "y domain", "line": _MODE, "label": label}


def _doing(found: Computed) -> str:
    if found.cancelled:
        return "Cancelled."
    if found.doing == BAND and found.error is not None:
        return f"Computing the {found.doing}: bounded at {counted(found.error.omega.size, 'frequency')}"
    return f"Computing the {found.doing}" if found.doing else ""


def write_run_file(session: Session, choice: ByHand, name: str) -> Path:
    """Write a run file that gives the same identification again; its name is seen from where the program was started."""
    path = Path(name.strip())
    if path.suffix != ".toml":
        raise InputError(f"The run file needs a name that ends in .toml; got {name!r}")
    if path.exists():
        raise InputError(f"{path} exists; choose another name")
    if not path.parent.is_dir():
        raise InputError(f"The folder {path.parent} does not exist; choose another one")
    text = session.written(choice).moved(session.folder, path.parent).text()
    with atomic_write(path) as file:
        file.write(text)
    return path


def choice_rows(session: Session, found: Computed) -> list[tuple[str, str]]:
    """Names and values of a choice, and of what follows from it; these are empty until they are known."""
    choice, identification = found.choice, found.identification
    if choice is None:
        return []
    modes = ", ".join(f"{hz:.6g} ({damping:.3g})" for hz, damping in zip(choice.hz, choice.damping, strict=True))
    return [
        ("modes [Hz] (damping)", modes or "none"),
        ("gain bound K", f"{choice.gain_bound:.6g}"),
        ("decay α [1/s]" if session.continuous else "decay rate ρ", f"{choice.rate:.6g}"),
        ("lines left out [Hz]", session.words(choice.left_out_hz) or "none"),
        *([] if identification is None else live_numbers(identification, found.band)),
    ]


def compared(session: Session, kept: Computed | None, found: Computed) -> list[Component]:
    """The table of the choice that is kept and of the newest one; nothing where none is kept."""
    if kept is None:
        return []
    now = dict(choice_rows(session, found))
    rows = [((name, was, now.get(name, "")), "") for name, was in choice_rows(session, kept)]
    return [table(("", "kept", "now"), rows)]


def connect_kept(app: Any, worker: Worker) -> None:
    """Make the buttons of a Dash application react that keep the present choice, and forget it."""
    from dash import Input, Output, ctx

    @app.callback(
        Output("trouble", "children", allow_duplicate=True),
        *(Input("keep", "n_clicks"), Input("forget", "n_clicks")),
        prevent_initial_call=True,
    )
    def pressed(*_: object) -> str:
        try:
            worker.keep() if str(ctx.triggered_id) == "keep" else worker.forget()  # type: ignore[reportUnknownMemberType]
        except RobustIdError as error:
            return error.said({}, unknown=str)
        return ""


def most_missed_hz(identification: Identification) -> float:
    """Frequency in Hz of the frequency point where the residual of the nominal model, against its bound, is largest."""
    found = [one for one in identification.residuals if one.kind == "frequency"]
    worst = max(found, key=lambda one: float(one.ratio.max()))
    return float(f"{worst.axis[int(np.argmax(worst.ratio))] / (2 * np.pi):.{_DIGITS}g}")


def added(identification: Identification | None, count: int, fields: Sequence[object]) -> list[object]:
    """The number of modes and their fields, with another mode where the nominal model misses the data most.

    InputError: the nominal model is not there yet.
    """
    if identification is None:
        raise InputError("A mode is added where the nominal model misses the data most: wait for the margin")
    pair = [most_missed_hz(identification), LIGHT]
    return [count + 1, *fields[: 2 * count], *pair, *fields[2 * count + 2 :]]


def removed(place: int, count: int, fields: Sequence[object]) -> list[object]:
    """The number of modes and their fields, without one of them; later ones move up."""
    at = 2 * place
    return [count - 1, *fields[:at], *fields[at + 2 :], *fields[at : at + 2]]


def connect_modes(app: Any, session: Session, worker: Worker) -> None:
    """Make the buttons of a Dash application that add and remove modes react, and hide fields of modes that are not there."""
    from dash import Input, Output, State, ctx, no_update

    names = mode_names(session)
    room = len(names) // 2

    @app.callback(
        *[Output(f"mode-{k}", "hidden") for k in range(room)], Output("add", "disabled"), Input("modes", "data")
    )
    def counted(count: int) -> list[bool]:
        return [*(k >= count for k in range(room)), count == room]

    @app.callback(
        *(Output("modes", "data", allow_duplicate=True), Output("trouble", "children", allow_duplicate=True)),
        *[Output(name, "value", allow_duplicate=True) for name in names],
        *(Input("add", "n_clicks"), *[Input(f"remove-{k}", "n_clicks") for k in range(room)]),
        *(State("modes", "data"), *[State(name, "value") for name in names]),
        prevent_initial_call=True,
    )
    def changed(*values: Any) -> list[object]:
        count, *fields = values[room + 1 :]
        pressed = str(ctx.triggered_id)  # type: ignore[reportUnknownMemberType]
        try:
            if pressed == "add":
                count, *fields = added(worker.found.identification, count, fields)
            else:
                count, *fields = removed(int(pressed.rpartition("-")[2]), count, fields)
        except RobustIdError as error:
            return [no_update, error.said({}, unknown=str), *[no_update] * len(names)]
        return [count, "", *fields]
