"""The section of a run file about the controller that ran while the records were made."""

from __future__ import annotations

import dataclasses

from robustid.app.run.checks import key, number, several, text
from robustid.errors import InputError


@dataclasses.dataclass(frozen=True, kw_only=True)
class LoopChoice:
    """The controller that ran, where the plant was measured in a loop: u = r - C y, with negative feedback."""

    controller: str | None = key(
        text(),
        help="File with the controller that ran, a model, seen from the folder of the run file. What is identified then is the"
        " stable system R of the loop, and the plant from it.",
        flag="--loop",
        metavar="FILE",
    )
    numerator: tuple[float, ...] | None = key(
        several(number()),
        help="The controller by its coefficients, in place of a file, highest power first: of z where the data are sampled,"
        " else of s.",
    )
    denominator: tuple[float, ...] | None = key(several(number()), help="Its denominator.")
    excitation: str | None = key(
        text(("input", "reference", "output")),
        help="Where r is added: input, u = r - C y (default), reference, u = C (r - y), or output, u = -C (y + r).",
        flag="--excitation",
    )
    auxiliary: str | None = key(
        text(),
        help="File with a model of the plant that the controller stabilises, if only a rough one; default: a fit of the data.",
        flag="--auxiliary",
        metavar="FILE",
    )

    candidates: tuple[str, ...] | None = key(
        several(text()),
        help="Files with other controllers, models or their responses, that are tried in the loop of every consistent plant.",
    )

    @property
    def is_stated(self) -> bool:
        """Return whether there is a loop."""
        return self.controller is not None or self.numerator is not None

    @property
    def place(self) -> str:
        """Place of the excitation, as `Loop` takes it."""
        return self.excitation or "input"

    def check(self, place: str) -> None:
        """Refuse what is half stated."""
        if (self.numerator is None) != (self.denominator is None):
            raise InputError(f"{place} numerator and denominator make one controller; give both or neither")
        if self.controller is not None and self.numerator is not None:
            raise InputError(f"{place} controller is a file, numerator the same controller again; give one of them")
        if not self.is_stated and self != LoopChoice():
            raise InputError(f"{place} needs the controller that ran: controller = FILE, or numerator and denominator")
