"""A choice that is kept, beside the newest one: its numbers in a table, and the buttons that keep and forget it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from robustid.app.explore.layout import table
from robustid.app.explore.session import Session
from robustid.app.explore.worker import Computed, Worker
from robustid.errors import RobustIdError
from robustid.report import live_numbers

if TYPE_CHECKING:
    from dash.development.base_component import Component


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
