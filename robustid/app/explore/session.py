"""The data of a page that is explored, and the choices that can be made about them, each of which is a run file."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from robustid.app.run.measurements import Measured, part_of, without_points
from robustid.app.run.modes import Box, box_of_modes
from robustid.app.run.posing import posed
from robustid.app.run.run_file import RunFile
from robustid.app.run.run_folder import Surroundings
from robustid.app.run.settings import Fit
from robustid.core import Frozen, Progress
from robustid.data import Fault, FrequencyResponse
from robustid.errors import InputError
from robustid.identification import MixedProblem

_BY_HAND = "Chosen by hand, in robustid explore."
_DIGITS = 6  # of a frequency in words, where these tell the points apart
_RUN = 3  # neighbours that are written as an interval


class Shared(NamedTuple):
    """A run file that several pages write: what is told of the choice of one, and what makes all of it from the run file of one."""

    note: Callable[[RunFile], None]
    whole: Callable[[RunFile], RunFile]


@dataclasses.dataclass(frozen=True)
class ByHand:
    """Everything that is changed by hand; `rate` is the decay rate per sample, or the decay in 1/s, as the session says."""

    hz: tuple[float, ...]
    damping: tuple[float, ...]
    gain_bound: float
    rate: float
    left_out_hz: tuple[float, ...] = ()


@dataclasses.dataclass(frozen=True, eq=False)
class Session(Frozen):
    """Measured data with the frequency points that are left out, a run file with every choice made, and the folder of its files.

    The faults are those of experiments that contradict the others. `shared` is the run file of a family.
    """

    run: RunFile
    data: Measured
    folder: Path
    faults: tuple[Fault, ...] = ()
    shared: Shared | None = None

    @classmethod
    def of(cls, run: RunFile, data: Measured, folder: Path, progress: Progress) -> Session:
        """Make the choices that a run file leaves open about data that were read; of one entry of one plant with a gain bound."""
        if run.prior.passive is not None:
            raise InputError("explore moves modes and a gain bound, which a passive class has not: leave passive out")
        around, left_out = Surroundings(progress), run.frequency_points.leave_out_hz
        run, data = part_of(run.changed("frequency_points", leave_out_hz=None), data)
        run = run.changed("frequency_points", leave_out_hz=left_out)
        run, problem, _ = posed(run, without_points(data, left_out or ()), around)
        return cls(run, data, folder, problem.faults)

    @property
    def continuous(self) -> bool:
        """Say whether the decay is one in 1/s."""
        return self.run.prior.decay_rate is None

    @property
    def points_hz(self) -> np.ndarray:
        """Frequencies of all frequency points in Hz, rising, as they are named."""
        every = np.unique(np.concatenate([frf.freq_hz for frf in self.data.responses]))
        named = np.array([float(f"{hz:.{_DIGITS}g}") for hz in every])
        return named if np.all(np.diff(named) > 0) else every

    @property
    def start(self) -> ByHand:
        """The choice that the run file states."""
        modes, prior = self.run.modes, self.run.prior
        rate = prior.decay if prior.decay_rate is None else prior.decay_rate
        given = self.run.frequency_points.leave_out_hz or ()
        return ByHand(modes.hz or (), modes.damping or (), float(prior.gain_bound or 0), float(rate or 0), given)

    def stated(self, choice: ByHand) -> RunFile:
        """The run file of a choice, its names seen from the folder of the session."""
        run, start = self.run, self.start
        if (choice.hz, choice.damping) != (start.hz, start.damping):
            given: dict[str, object] = {"hz": choice.hz, "damping": choice.damping, "source": None, "note": _BY_HAND}
            modes = dataclasses.replace(run.modes, **given, hz_interval=None, damping_interval=None)
            # Modes are stated or those of a fit, and the pole-uncertainty box was that of others.
            worst_case = dataclasses.replace(run.worst_case, over_poles=False)
            run = dataclasses.replace(run, modes=modes, fit=Fit(), worst_case=worst_case)
        if (choice.gain_bound, choice.rate) != (start.gain_bound, start.rate):
            name = "decay" if self.continuous else "decay_rate"
            given = {"gain_bound": choice.gain_bound, name: choice.rate}
            given |= {"source": None, "note": _BY_HAND, "curve": None}
            run = dataclasses.replace(run, prior=dataclasses.replace(run.prior, **given))
        return run.changed("frequency_points", leave_out_hz=choice.left_out_hz or None)

    def note(self, choice: ByHand) -> None:
        """Note the choice for the run file of a family."""
        if self.shared is not None:
            self.shared.note(self.stated(choice))

    def written(self, choice: ByHand) -> RunFile:
        """The run file that is written of a choice: of a family that of all members."""
        stated = self.stated(choice)
        return stated if self.shared is None else self.shared.whole(stated)

    def problem(self, choice: ByHand) -> tuple[MixedProblem, list[FrequencyResponse]]:
        """The problem that a choice poses, and what is kept out of it to test the result."""
        data = without_points(self.data, choice.left_out_hz)
        stated = self.stated(choice).changed("prior", without=None)  # they are known
        _, problem, left = posed(stated, data, Surroundings())
        problem = dataclasses.replace(problem, faults=self.faults) if self.faults else problem
        return problem, [*left.points, *(left.withheld if left.kind == "lines" and not left.points else [])]

    def box(self, choice: ByHand) -> Box | None:
        """The pole-uncertainty box of the modes, where they are those that the data gave; None where they are moved by hand."""
        return box_of_modes(self.stated(choice).modes)

    def left_out(self, choice: ByHand) -> list[FrequencyResponse]:
        """The frequency points that a choice leaves out."""
        if not choice.left_out_hz:
            return []
        rest = without_points(self.data, choice.left_out_hz).responses
        pairs = zip(self.data.responses, rest, strict=True)
        away = [(every, ~np.isin(every.omega, kept.omega)) for every, kept in pairs]
        return [every.select(gone) for every, gone in away if gone.any()]

    def words(self, left_out_hz: Sequence[float]) -> str:
        """Frequency points in words: numbers, and LOW:HIGH for neighbours."""
        every = self.points_hz
        gone = np.array([int(np.argmin(np.abs(every - hz))) for hz in left_out_hz], dtype=int)
        parts: list[str] = []
        for group in np.split(np.unique(gone), np.flatnonzero(np.diff(np.unique(gone)) > 1) + 1):
            if group.size >= _RUN:
                parts.append(f"{every[group[0]]:.15g}:{every[group[-1]]:.15g}")
            else:
                parts += [f"{every[k]:.15g}" for k in group]
        return ", ".join(parts)

    def points(self, words: str) -> tuple[float, ...]:
        """Frequency points from words, as `words` writes them."""
        every, found = self.points_hz, set[float]()
        for part in filter(None, re.split(r"[,;\s]+", words)):
            try:
                low, high = (float(one) for one in (part.split(":") * 2)[:2])
            except ValueError:
                raise InputError(
                    f"Lines left out: give frequencies in Hz with commas between them, and LOW:HIGH; got {part!r}"
                ) from None
            at = every[(every >= low) & (every <= high)] if ":" in part else every[[np.argmin(np.abs(every - low))]]
            if not at.size:
                raise InputError(f"Lines left out: there are no frequency points from {low:g} to {high:g} Hz")
            if ":" not in part:
                without_points(self.data, (low,))  # says that there is none
            found |= set(at.tolist())
        return tuple(sorted(found))


def toggled(left_out_hz: Sequence[float], brushed_hz: Sequence[float]) -> tuple[float, ...]:
    """Points left out after a brush: it leaves out what is used, or takes back where all of it was left out.

    Examples
    --------
    >>> toggled((3.0,), (2.0, 3.0)), toggled((2.0, 3.0), (3.0,))
    ((2.0, 3.0), (2.0,))
    """
    before, brushed = set(left_out_hz), set(brushed_hz)
    return tuple(sorted(before - brushed if brushed <= before else before | brushed))
