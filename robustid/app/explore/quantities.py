"""The numbers that are changed by hand: where their sliders begin and end, and the choice that their fields state."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

from robustid.app.explore.session import ByHand, Session
from robustid.errors import InputError

STEPS = 1000  # of a slider
LIGHT = 0.01  # damping ratio of a mode that is added
_ROOM, _ABOVE = 6, 10.0  # modes that can be added; their frequencies before that, over those of the data
_REST = "Non-parametric part"
_NEAR, _WIDE = 1.2, 100.0  # factors from the start of a frequency, and of all else, to the ends of its slider
_LEAST, _MOST = 1e-5, 1.0  # damping ratios
_DIGITS = 6  # that a field shows


@dataclasses.dataclass(frozen=True)
class Quantity:
    """A number with a field and a slider, whose steps are equal factors of `value - offset`."""

    name: str  # of its field in the page; its slider is NAME-slider
    group: str
    label: str
    value: float  # at the start
    low: float  # ends of the slider, less the offset
    high: float
    offset: float = 0.0
    most: float = math.inf  # largest value that makes sense
    signed: bool = False  # any number makes sense, and its slider keeps the sign of its ends

    @property
    def position(self) -> int:
        """Place of the value on its slider."""
        part = (self.value - self.offset) / self.low
        share = math.log(part) / math.log(self.high / self.low) if part > 0 else 0.0
        return round(STEPS * min(max(share, 0.0), 1.0))

    @property
    def shown(self) -> float:
        """The value in the digits of the field."""
        return float(f"{self.value:.{_DIGITS}g}")

    def checked(self, value: object) -> float:
        """The number that a field states; InputError of none, or of one that makes no class."""
        known = isinstance(value, int | float) and math.isfinite(value)
        if self.signed and not known:
            raise InputError(f"{self.group}, {self.label}: give a number")
        if not isinstance(value, int | float) or not known or not (self.signed or self.offset < value <= self.most):
            wanted = f"above {self.offset:g}" + (f" and at most {self.most:g}" if math.isfinite(self.most) else "")
            got = "" if value is None else f"; got {value}"
            raise InputError(f"{self.group}, {self.label}: give a number {wanted}{got}")
        # The number that the field began with has more digits than it shows.
        return self.value if value == self.shown else float(value)


def quantities(session: Session) -> list[Quantity]:
    """Return all of them: frequency and damping of every mode and of those that can be added, K, and the decay."""
    start = session.start
    found: list[Quantity] = []
    # Above all data: the page moves a slider to where its mode is added.
    room = [(_ABOVE * float(session.points_hz.max()), LIGHT)] * _ROOM
    for k, (hz, damping) in enumerate([*zip(start.hz, start.damping, strict=True), *room]):
        mode = f"Mode {k + 1}"
        found.append(Quantity(f"hz-{k}", mode, "frequency [Hz]", hz, hz / _NEAR, hz * _NEAR))
        found.append(Quantity(f"damping-{k}", mode, "damping ratio", damping, _LEAST, _MOST, most=_MOST))
    gain, rate = start.gain_bound, start.rate
    found.append(Quantity("gain", _REST, "gain bound K", gain, gain / _WIDE, gain * _WIDE))
    if session.continuous:
        return [*found, Quantity("rate", _REST, "decay α [1/s]", rate, rate / _WIDE, rate * _WIDE)]
    return [*found, Quantity("rate", _REST, "decay rate ρ", rate, (rate - 1) / _WIDE, (rate - 1) * _WIDE, 1.0)]


def mode_names(session: Session) -> list[str]:
    """Names of the fields of modes, as they stand in `quantities`: frequency and damping of each."""
    return [f"{own}-{k}" for k in range(len(session.start.hz) + _ROOM) for own in ("hz", "damping")]


def fields_of(session: Session, every: Sequence[Quantity]) -> list[float | str]:
    """The fields as they stand at the start: the number of modes, the quantities, and the lines left out in words."""
    return [len(session.start.hz), *(one.shown for one in every), session.words(session.start.left_out_hz)]


def choice_of(session: Session, every: Sequence[Quantity], values: Sequence[float | str | None]) -> ByHand:
    """The choice that the fields state, in the order of `fields_of`."""
    count, *numbers, words = values
    modes = range(int(count or 0))
    room = mode_names(session)[2 * len(modes) :]
    stated = zip(every, numbers, strict=True)
    found = {one.name: one.checked(value) for one, value in stated if one.name not in room}
    return ByHand(
        tuple(found[f"hz-{k}"] for k in modes),
        tuple(found[f"damping-{k}"] for k in modes),
        found["gain"],
        found["rate"],
        session.points(str(words or "")),
    )
