"""A designed controller that is tuned by hand: its sections, worst cases at frequencies as they are turned, and the proof."""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from robustid.app.explore.newest import Newest, State
from robustid.app.load_save import save
from robustid.controllers import (
    ControllerDesign,
    Limits,
    Matrix,
    Plants,
    Proof,
    Sections,
    WorstAt,
    proof_of,
    shares_of,
    split,
    worst_at,
)
from robustid.core import Frozen, Real
from robustid.errors import InputError

_POINTS = 200  # frequencies, beside those where the plant or the controller changes fast
_INSIDE = 1e-9  # of the end of a limit: where two cells of a band meet the larger bound of both is taken
PROOF = "proof on the whole axis"


@dataclasses.dataclass(frozen=True, eq=False)
class TuningLook:
    """Worst cases of one controller at frequencies, of the plants of every band, and the shares of the limits that they take."""

    sections: Sections
    found: tuple[WorstAt, ...]
    shares: dict[str, tuple[float, float]]

    @property
    def kept(self) -> bool:
        """True if every loop is stable and keeps all limits, at these frequencies."""
        return all(one.clear for one in self.found) and all(share <= 1 for share, _ in self.shares.values())


@dataclasses.dataclass(frozen=True, eq=False)
class Tuning(Frozen):
    """A design that is tuned: its plants, the limits that were stated, and its sections to begin with."""

    design: ControllerDesign
    start: Sections
    plants: tuple[Plants, ...]
    grids: tuple[Real, ...]

    @classmethod
    def of(cls, design: ControllerDesign) -> Tuning:
        """The design with its controller in sections.

        InputError: no controller was found, or one of several inputs or outputs.
        """
        if design.controller is None:
            raise InputError(
                "the design has no controller: none was found that keeps the limits, and there is nothing to tune"
            )
        if isinstance(design.structure, Matrix) or design.proofs[0].loop.shape != (1, 1):
            raise InputError(
                "explore tunes a controller of one input and one output, and this one is a matrix: tune one entry"
            )
        plants = tuple(Plants(one.band, one.loop) for one in design.proofs)
        start = split(design.controller, design.structure, design.searched, plants[0].dt)
        return cls(design, start, plants, tuple(_grid(one, design.limits) for one in plants))

    @property
    def limits(self) -> Limits:
        """Limits that were stated; what the design made as large as possible is none of them."""
        return self.design.limits

    def look(self, sections: Sections) -> TuningLook:
        """Worst cases at frequencies: in some hundredths of a second."""
        turning = sections.frequencies()
        found = [
            worst_at(plants, sections.system, np.union1d(grid, turning[(turning > grid[0]) & (turning < grid[-1])]))
            for plants, grid in zip(self.plants, self.grids, strict=True)
        ]
        taken = [one.taken(self.limits) for one in found]
        return TuningLook(sections, tuple(found), shares_of(self.limits, taken, sections.system, sections.dt))

    def prove(self, sections: Sections) -> Proof:
        """Proof of the sections on the whole axis, in seconds."""
        return proof_of(self.plants, sections.controller(), self.limits)

    def write(self, sections: Sections, name: str) -> Path:
        """Write the controller as a model in any format that models have, or as C; seen from where the program was started."""
        path = Path(name.strip())
        if not path.suffix:
            raise InputError(f"The file needs a name that ends in .npz, or as another format of models; got {name!r}")
        if path.exists():
            raise InputError(f"{path} exists; choose another name")
        if not path.parent.is_dir():
            raise InputError(f"The folder {path.parent} does not exist; choose another one")
        save(path, sections.controller())
        return path


def _grid(plants: Plants, limits: Limits) -> Real:
    """Frequencies of the curves: some equally apart, more where the plant changes fast, and the ends of the limits."""
    grid = plants.grid()
    given = np.array(limits.frequencies, dtype=float)
    around = np.concatenate([given * (1 - _INSIDE), given * (1 + _INSIDE)])
    ends = around[(around > grid[0]) & (around < grid[-1])]
    spread: Real = np.geomspace(float(grid[0]), float(grid[-1]), _POINTS)
    return np.unique(np.concatenate([grid, spread, ends]))


@dataclasses.dataclass(frozen=True, eq=False)
class Tuned(State):
    """The state of a controller that is tuned, as a page shows it."""

    look: TuningLook | None = None
    proof: Proof | None = None  # of the sections of the look


class Tuner(Newest[Tuned, Sections]):
    """Looks at sections at once, and proves them in its thread."""

    def __init__(self, tuning: Tuning) -> None:
        self.tuning, self._one = tuning, threading.Lock()
        self.before = tuning.look(tuning.start)
        super().__init__(Tuned(number=1, look=self.before))

    @property
    def look(self) -> TuningLook:
        """The newest one."""
        return self.found.look or self.before

    def turn(self, numbers: Mapping[str, float]) -> None:
        """Look at other numbers; a proof was of those before."""
        with self._one:
            sections = self.tuning.start.turned(numbers)
            if self.look.sections.numbers != sections.numbers:
                self._replace(None, Tuned(look=self.tuning.look(sections)))

    def prove(self) -> None:
        """Prove the present sections on the whole axis."""
        with self._one:
            self._replace(self.look.sections, Tuned(look=self.look, doing=PROOF))

    def _compute(self, ticket: int, choice: Sections) -> None:
        self._say(ticket, proof=self.tuning.prove(choice), doing="")
