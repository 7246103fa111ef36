"""Modes that are added and removed by hand: fields of those that stand come first, room for others after them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from robustid.app.explore.quantities import LIGHT, mode_names
from robustid.app.explore.session import Session
from robustid.app.explore.worker import Worker
from robustid.errors import InputError, RobustIdError
from robustid.identification import Identification

_DIGITS = 6  # of a field


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
