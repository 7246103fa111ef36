"""One thread that computes the newest choice: margin first, then the guaranteed error at more and more frequencies."""

from __future__ import annotations

import dataclasses
import logging
import threading
from collections.abc import Callable
from typing import Any

import numpy as np

from robustid.app.explore.session import Choice, Session
from robustid.core import Real, one_thread
from robustid.data import FrequencyResponse
from robustid.errors import RobustIdError
from robustid.guarantees import WorstCaseError, consistent_set, default_grid, growing_error
from robustid.identification import Identification, identify

_log = logging.getLogger("robustid")

_DIRECTIONS, _GAP = 4, 0.1  # coarse: what a person sees
_THIN = 3  # of so many frequencies of the usual grid one is bounded, and those of the modes
_ESTIMATED, _SMALL = (
    12,
    130,
)  # frequencies of the estimate, and coefficients up to which it takes no longer than a blink
MARGIN = "margin and model"
BAND = "guaranteed error"


class Superseded(BaseException):
    """Raised in a computation that nobody waits for any more; no error of it, which others might catch."""


@dataclasses.dataclass(frozen=True, eq=False)
class Found:
    """The state of a computation, as a page shows it.

    Attributes
    ----------
    number : int
        Rises with every change of what is drawn.
    choice : Choice, optional
        The one that this is about.
    doing : str
        The step at hand; empty where there is none.
    done, count : int
        Of it.
    identification, error, withheld
        As far as they are known.
    spread : (omega, half-widths), optional
        Of an ellipsoid inside of the set of consistent systems, at some frequencies of the band.
    scale : (omega, logarithms), optional
        The guaranteed errors in units of those half-widths, for this choice or the one before.
    trouble : str
        The sentence of an error.
    cancelled : bool
    """

    number: int = 0
    choice: Choice | None = None
    doing: str = ""
    done: int = 0
    count: int = 0
    identification: Identification | None = None
    error: WorstCaseError | None = None
    spread: tuple[Real, Real] | None = None
    scale: tuple[Real, Real] | None = None
    withheld: tuple[FrequencyResponse, ...] = ()
    trouble: str = ""
    cancelled: bool = False

    @property
    def complete(self) -> bool:
        """Say whether all frequencies of the band are bounded."""
        return self.error is not None and not self.doing and not self.cancelled and not self.trouble

    @property
    def estimate(self) -> tuple[Real, Real] | None:
        """Estimated errors, while some aren't bounded yet: the ellipsoid, scaled to those that are."""
        if self.spread is None or self.scale is None or self.complete:
            return None
        omega, width = self.spread
        return omega, width * np.exp(np.interp(omega, *self.scale))


class Worker:
    """Computes the newest choice; an older one ends at its next step.

    Attributes
    ----------
    found : Found
        The present state.
    """

    def __init__(self, session: Session) -> None:
        self.found = Found()
        self._session, self._asked = session, threading.Condition()
        self._wanted: Choice | None = None
        self._ticket, self._closed = 0, False
        self._thread = threading.Thread(target=self._work, name="explore", daemon=True)
        self._thread.start()

    def ask(self, choice: Choice) -> None:
        """Compute a choice, in place of the one at hand; nothing where it is that one."""
        if choice == self.found.choice and not self.found.cancelled:
            return
        self._replace(choice, Found(choice=choice, doing=MARGIN, scale=self.found.scale))

    def cancel(self) -> None:
        """Stop; what is known stays."""
        if self.found.doing:
            self._replace(None, dataclasses.replace(self.found, doing="", cancelled=True))

    def close(self) -> None:
        """End the thread."""
        self._closed = True
        self._replace(None, self.found)
        self._thread.join(timeout=1)

    def _replace(self, choice: Choice | None, found: Found) -> None:
        with self._asked:
            self._ticket += 1
            self._wanted = choice
            self.found = dataclasses.replace(found, number=self.found.number + 1)
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
                    self._compute(choice, lambda ticket=ticket, **new: self._say(ticket, **new))
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

    def _say(self, ticket: int, **new: Any) -> None:
        with self._asked:
            if ticket != self._ticket:
                raise Superseded
            number = self.found.number + (not new.keys() <= {"done", "count"})
            self.found = dataclasses.replace(self.found, number=number, **new)

    def _compute(self, choice: Any, say: Callable[..., None]) -> None:
        problem, withheld = self._session.problem(choice)
        say(withheld=tuple(withheld))
        how = self._session.run.identify.arguments
        result = identify(problem, **how, progress=lambda done, count: say(done=done, count=count))
        say(identification=result, done=0, count=0, doing=BAND if result.consistent else "")
        if not result.consistent:
            return
        omega = band_frequencies(result)
        spread = _spread(result, omega)
        say(spread=spread)
        sides = growing_error(
            result, omega, directions=_DIRECTIONS, gap=_GAP, progress=lambda done, count: say(done=done, count=count)
        )
        for error in sides:
            say(error=error, scale=_scale(spread, error) or self.found.scale)
        say(doing="")


def _spread(result: Identification, omega: Real) -> tuple[Real, Real] | None:
    """Half-widths of an ellipsoid inside of the set at some of the frequencies, where that takes no longer than a blink."""
    consistent = consistent_set(result)
    if consistent.posed_at(float(omega[0])) is not consistent.posed:  # every frequency is a further node
        if result.problem.coefficients > _SMALL:
            return None
        omega = omega[:: max(1, omega.size // _ESTIMATED)]
    return omega, consistent.spreads(omega)[:, 0, 0]


def _scale(spread: tuple[Real, Real] | None, error: WorstCaseError) -> tuple[Real, Real] | None:
    """The logarithms of guaranteed errors in units of these half-widths, where both are known."""
    if spread is None:
        return None
    omega, at, width = np.intersect1d(error.omega, spread[0], return_indices=True)
    return (omega, np.log(error.upper[at, 0, 0] / spread[1][width])) if omega.size else None


def band_frequencies(identification: Identification) -> Real:
    """Some thirty frequencies, those of the modes among them, rad/s."""
    grid = default_grid(identification.problem)
    basis, plane = identification.problem.parametric, identification.problem.plane
    chosen = [grid[::_THIN], grid[-1:]]
    if basis is not None:
        light = basis.poles[np.imag(basis.poles) > 0]
        chosen.append(plane.omega(np.angle(light)) if plane.dt else np.abs(np.imag(light)))
    return np.unique(np.concatenate(chosen))
