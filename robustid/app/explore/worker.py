"""One thread that computes the newest choice: a look at once, the margin, then the guaranteed error frequency by frequency."""

from __future__ import annotations

import dataclasses
import functools
import logging
import threading
from typing import TypedDict, Unpack

import numpy as np

from robustid.app.explore.session import ByHand, Session
from robustid.app.run.modes import Box, held_box
from robustid.core import Real, one_thread
from robustid.data import FrequencyResponse
from robustid.errors import RobustIdError
from robustid.guarantees import Band, SampleCheck, WorstCaseError, band, check_samples, default_grid, growing_error
from robustid.identification import Identification, MixedProblem, identify

_log = logging.getLogger("robustid")

_DIRECTIONS, _GAP = 4, 0.1  # coarse: what a person sees
_KNOTS, _KNOTS_OF_BOX = 400, 300
_THIN = 3  # of so many frequencies of the usual grid one is bounded, and those of the modes
MARGIN = "margin and model"
BAND = "guaranteed error"


class Superseded(BaseException):
    """Raised in a computation that nobody waits for any more; no error of it, which others might catch."""


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
class Computed:
    """The state of a computation, as a page shows it; results as far as they are known."""

    number: int = 0  # rises with every change of what is drawn
    choice: ByHand | None = None
    doing: str = ""  # the step at hand; empty where there is none
    done: int = 0
    count: int = 0
    look: Glance | None = None  # the newest one, of this choice or of one before
    identification: Identification | None = None
    band: Band | None = None  # around the nominal model
    error: WorstCaseError | None = None
    trouble: str = ""  # the sentence of an error
    cancelled: bool = False


class News(TypedDict, total=False):
    """Fields of a state that change."""

    doing: str
    done: int
    count: int
    identification: Identification | None
    band: Band | None
    error: WorstCaseError
    trouble: str


class Worker:
    """Computes the newest choice; an older one ends at its next step."""

    def __init__(self, session: Session) -> None:
        self.found = Computed()  # the present state
        self._session, self._asked = session, threading.Condition()
        self._wanted: ByHand | None = None
        self._ticket, self._closed = 0, False
        self._thread = threading.Thread(target=self._work, name="explore", daemon=True)
        self._thread.start()

    def ask(self, choice: ByHand) -> None:
        """Compute a choice, in place of the one at hand; nothing where it is that one."""
        if choice == self.found.choice and not self.found.cancelled:
            return
        self._replace(choice, Computed(choice=choice, doing=MARGIN))

    def cancel(self) -> None:
        """Stop; what is known stays."""
        if self.found.doing:
            self._replace(None, dataclasses.replace(self.found, doing="", cancelled=True))

    def close(self) -> None:
        """End the thread."""
        self._closed = True
        self._replace(None, self.found)
        self._thread.join(timeout=1)

    def _replace(self, choice: ByHand | None, found: Computed) -> None:
        with self._asked:
            self._ticket += 1
            self._wanted = choice
            self.found = dataclasses.replace(found, number=self.found.number + 1, look=self.found.look)
            self._asked.notify()

    def _work(self) -> None:
        with one_thread():
            while True:
                with self._asked:
                    self._asked.wait_for(lambda: self._closed or self._wanted is not None)
                    if self._closed:
                        return
                    choice, ticket, self._wanted = self._wanted, self._ticket, None
                try:
                    if choice is not None:
                        self._compute(ticket, choice)
                except Superseded:
                    continue
                except RobustIdError as error:
                    self._end(ticket, str(error))
                except Exception as error:  # the page must say that nothing more will come
                    _log.exception("explore")
                    self._end(ticket, f"internal error, please report: {error!r}")

    def _end(self, ticket: int, trouble: str) -> None:
        try:
            self._say(ticket, doing="", trouble=trouble)
        except Superseded:
            return

    def _say(self, ticket: int, **new: Unpack[News]) -> None:
        with self._asked:
            if ticket != self._ticket:
                raise Superseded
            number = self.found.number + (not new.keys() <= {"done", "count"})
            self.found = dataclasses.replace(self.found, number=number, **new)

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
