"""One thread that computes the newest choice: a look at once, the margin, then the guaranteed error frequency by frequency."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np

from robustid.app.explore.newest import Newest, State, Superseded
from robustid.app.explore.session import ByHand, Session
from robustid.app.run.modes import Box, held_box
from robustid.core import Real
from robustid.data import FrequencyResponse
from robustid.errors import InputError
from robustid.guarantees import Band, SampleCheck, WorstCaseError, band, check_samples, default_grid, growing_error
from robustid.identification import Identification, MixedProblem, identify

_DIRECTIONS, _GAP = 4, 0.1  # coarse: what a person sees
_KNOTS, _KNOTS_OF_BOX = 400, 300
_THIN = 3  # of so many frequencies of the usual grid one is bounded, and those of the modes
MARGIN = "margin and model"
BAND = "guaranteed error"


@dataclasses.dataclass(frozen=True, eq=False)
class Glance:
    """The first look at a choice, in a fraction of a second, before its margin is known."""

    choice: ByHand
    check: SampleCheck  # of samples against what the others prove
    band: Band | None  # None where the check finds a contradiction, so that it would say nothing
    withheld: tuple[FrequencyResponse, ...] = ()
    number: int = 0  # of the state that it came with


def glance(session: Session, choice: ByHand) -> Glance:
    """Look at a choice: over the pole-uncertainty box where the data gave the modes, at the poles where they are moved."""
    problem, withheld = session.problem(choice)
    check = check_samples(problem)
    found = None if check.contradicts else _band_at_once(problem, session.box(choice))
    return Glance(choice, check, found, tuple(withheld))


def _band_at_once(problem: MixedProblem, box: Box | None) -> Band:
    """The band around its centres with few knots, for whoever waits for it; over a box fewer: each takes longer there."""
    held = held_box(box, problem)
    return band(problem, box=held, knots=_KNOTS if held is None else _KNOTS_OF_BOX)


@dataclasses.dataclass(frozen=True, eq=False)
class Computed(State):
    """The state of a computation, as a page shows it; results as far as they are known."""

    choice: ByHand | None = None
    done: int = 0
    count: int = 0
    look: Glance | None = None  # the newest one, of this choice or of one before
    identification: Identification | None = None
    band: Band | None = None  # around the nominal model
    error: WorstCaseError | None = None
    cancelled: bool = False


class Worker(Newest[Computed, ByHand]):
    """Computes the newest choice; an older one ends at its next step."""

    _STEPS = frozenset({"done", "count"})

    def __init__(self, session: Session) -> None:
        self._session = session
        self.kept: Computed | None = None  # the choice that the newest one is compared with
        super().__init__(Computed())

    def ask(self, choice: ByHand) -> None:
        """Compute a choice, in place of the one at hand; nothing where it is that one."""
        if choice == self.found.choice and not self.found.cancelled:
            return
        self._replace(choice, Computed(choice=choice, doing=MARGIN))

    def cancel(self) -> None:
        """Stop; what is known stays."""
        if self.found.doing:
            self._replace(None, dataclasses.replace(self.found, doing="", cancelled=True))

    def keep(self) -> None:
        """Remember the present choice, to be compared with those that follow.

        InputError: its margin is not there yet.
        """
        with self._asked:
            if self.found.identification is None:
                raise InputError("A choice is kept with its margin: wait for it")
            self._show(self.found)

    def forget(self) -> None:
        """Forget the choice that was kept."""
        with self._asked:
            self._show(None)

    def _show(self, kept: Computed | None) -> None:
        self.kept = kept
        self.found = dataclasses.replace(self.found, number=self.found.number + 1)

    def _begun(self, found: Computed) -> Computed:
        """The look stays until there is another one."""
        return dataclasses.replace(found, look=self.found.look)

    def _look(self, ticket: int, choice: ByHand) -> Glance:
        """Look at a choice; while it goes on changing, every look that was begun is shown."""
        found = glance(self._session, choice)
        with self._asked:
            number = self.found.number + 1
            self.found = dataclasses.replace(self.found, number=number, look=dataclasses.replace(found, number=number))
            if ticket != self._ticket:
                raise Superseded
        return found

    def _compute(self, ticket: int, choice: ByHand) -> None:
        say = functools.partial(self._say, ticket)

        def told(_: str, done: int, count: int) -> None:
            say(done=done, count=count)

        seen = self._look(ticket, choice)
        how = self._session.run.identify.arguments
        result = identify(seen.check.problem, **how, progress=told)
        if not result.consistent:
            say(identification=result, done=0, count=0, doing="")
            return
        band = None if seen.band is None else seen.band.with_model(result.model)
        say(identification=result, band=band, done=0, count=0, doing=BAND)
        omega = band_frequencies(result)
        for error in growing_error(result, omega, directions=_DIRECTIONS, gap=_GAP, progress=told):
            say(error=error)
        say(doing="")


def band_frequencies(identification: Identification) -> Real:
    """Some thirty frequencies, those of the modes among them, rad/s."""
    grid = default_grid(identification.problem)
    basis, plane = identification.problem.parametric, identification.problem.plane
    chosen = [grid[::_THIN], grid[-1:]]
    if basis is not None:
        light = basis.poles[np.imag(basis.poles) > 0]
        chosen.append(plane.omega(np.angle(light)) if plane.dt else np.abs(light.imag))
    return np.unique(np.concatenate(chosen))
