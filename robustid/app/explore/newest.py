"""One thread that computes the newest choice, and the state of it that a page shows."""

from __future__ import annotations

import dataclasses
import logging
import threading
from typing import Any, Generic, TypeVar

from robustid.core import one_thread
from robustid.errors import RobustIdError

_log = logging.getLogger("robustid")


class Superseded(BaseException):
    """Raised in a computation that nobody waits for any more; no error of it, which others might catch."""


@dataclasses.dataclass(frozen=True, eq=False)
class State:
    """State of a computation, as far as it is known."""

    number: int = 0  # rises with every change of what is drawn
    doing: str = ""  # the step at hand; empty where there is none
    trouble: str = ""  # the sentence of an error


Known = TypeVar("Known", bound=State)
Choice = TypeVar("Choice")


class Newest(Generic[Known, Choice]):
    """Computes the newest choice; an older one ends at its next step."""

    _STEPS = frozenset[str]()  # fields that change without another number

    def __init__(self, found: Known) -> None:
        self.found = found  # the present state
        self._asked = threading.Condition()
        self._wanted: Choice | None = None
        self._ticket, self._closed = 0, False
        self._thread = threading.Thread(target=self._work, name="explore", daemon=True)
        self._thread.start()

    def close(self, seconds: float = 1.0) -> None:
        """End the thread, and wait at most so long for it."""
        self._closed = True
        self._replace(None, self.found)
        self._thread.join(timeout=seconds)

    def _compute(self, ticket: int, choice: Choice) -> None:
        """Compute a choice, saying what is found."""
        raise NotImplementedError

    def _replace(self, choice: Choice | None, found: Known) -> None:
        with self._asked:
            self._ticket += 1
            self._wanted = choice
            self.found = dataclasses.replace(self._begun(found), number=self.found.number + 1)
            self._asked.notify()

    def _begun(self, found: Known) -> Known:
        """The state that a new choice begins with."""
        return found

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

    def _say(self, ticket: int, **new: Any) -> None:
        with self._asked:
            if ticket != self._ticket:
                raise Superseded
            number = self.found.number + (not new.keys() <= self._STEPS)
            self.found = dataclasses.replace(self.found, **new, number=number)
