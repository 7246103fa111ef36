"""Records and responses of a plant in a loop, opened: those of its stable system R."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from robustid.app.load_save import load
from robustid.app.run.controllers import controller_in
from robustid.app.run.loop_settings import LoopChoice
from robustid.data import Fault, FrequencyResponse, TimeRecord
from robustid.errors import InputError
from robustid.estimation import response_alone
from robustid.identification import Loop, measured_faults
from robustid.reduction import any_loop, with_auxiliary

if TYPE_CHECKING:
    import control

Estimated = Callable[[list[TimeRecord]], FrequencyResponse]


def loop_of(
    choice: LoopChoice,
    folder: Path,
    records: Sequence[TimeRecord],
    responses: Sequence[FrequencyResponse],
    how: dict[str, object],
) -> Loop:
    """The loop of the controller that ran, about the auxiliary plant that is stated, or one that these data show.

    `how`: arguments of the estimate.
    """
    data = list(records) if records else responses[0]
    dt = float((records[0].dt if records else responses[0].dt) or 0.0)
    controller = _controller(choice, folder, dt)
    if choice.auxiliary is not None:
        auxiliary = _model(choice.auxiliary, folder, "[loop] auxiliary")
        return Loop(controller, auxiliary, excitation=choice.place)
    first = any_loop(controller, data, choice.place)
    if records:
        opened = response_alone([first.opened(one) for one in records], **how)  # type: ignore[arg-type]
    else:
        opened = first.opened_response(responses[0])
    return with_auxiliary(first, opened)


def _controller(choice: LoopChoice, folder: Path, dt: float) -> control.StateSpace:
    if choice.controller is not None:
        place = "[loop] controller"
        return controller_in(_found(choice.controller, folder, place), dt, place)
    import control

    return control.ss(control.tf(list(choice.numerator or ()), list(choice.denominator or ()), dt))


def _model(name: str, folder: Path, place: str) -> control.StateSpace:
    return load(_found(name, folder, place), kind="model")


def _found(name: str, folder: Path, place: str) -> Path:
    path = folder / name
    if not path.is_file():
        raise InputError(f"{place}: there is no file {path}; names are seen from the folder of the run file")
    return path


def faults_of(loop: Loop, records: Sequence[TimeRecord], period: int | None) -> tuple[Fault, ...]:
    """Faults of the records as they were measured, with mistakes about the controller that ran; that the loop is closed is none."""
    found = list(measured_faults(records, period))
    for k, record in enumerate(records, start=1):
        if record.reference is not None:
            found += [one._replace(record=k if len(records) > 1 else 0) for one in loop.faults(record)]
    return tuple(found)


def with_faults(frf: FrequencyResponse, faults: tuple[Fault, ...]) -> FrequencyResponse:
    """The response with the faults of the records that it was estimated from."""
    return dataclasses.replace(frf, faults=faults)


def auxiliary_words(loop: Loop, choice: LoopChoice) -> str:
    """Words on the auxiliary plant, and where it comes from."""
    source = "as stated" if choice.auxiliary is not None else "from the data"
    if loop.auxiliary is None:
        return f"loop: u = {loop.law}; no auxiliary plant: R is the response of the closed loop"
    unstable = "" if loop.auxiliary_is_stable else ", not stable"
    order = f"auxiliary plant of order {loop.auxiliary.nstates}{unstable}, {source}"
    return f"loop: u = {loop.law}; {order}; what follows is R, which is what it leaves"
