"""The step that a command is in: its words, since when, how much of how much; the process that watches is told."""

from __future__ import annotations

import contextlib
import json
import os
import sys
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robustid.core import Record


INTERRUPTED = 130  # exit code
BEFORE_RESULTS = "interrupted before its end; nothing more is written"
SILENCE = 2.0  # seconds without a line after which one says that the step goes on
_OFTEN = 0.1  # seconds between two messages on one step


class Step:
    """The step of this process, which the other one is told."""

    to: int | None = None  # pipe to the process that watches
    usual, stderr = "", False  # between two steps the command; where lines on it go
    text, began, told = "", 0.0, 0.0


def tell(text: str, done: int = 0, count: int = 0, *, shown: bool = True) -> None:
    """Tell how far a step is, and whether a line was shown for it; no text: it has ended."""
    now, text = time.monotonic(), text or Step.usual
    if text == Step.text and not shown and now - Step.told < _OFTEN:
        return
    Step.told = now
    if text != Step.text:
        Step.text, Step.began = text, now
    if Step.to is not None:
        kept = something_is_kept()
        send({"text": text, "done": done, "count": count, "shown": shown, "stderr": Step.stderr, "kept": kept})


def something_is_kept() -> bool:
    """Return whether a Ctrl-C now would be kept back by a loop that has something to return."""
    progress = sys.modules.get("robustid.core.progress")  # nothing is kept before it is there
    return progress is not None and progress.something_is_kept()


def seconds() -> int:
    """Seconds of the step so far, once they are worth saying; else 0."""
    passed = time.monotonic() - Step.began
    return int(passed) if passed > SILENCE else 0


def lasting(text: str) -> str:
    """The words of a step with its seconds."""
    return f"{text}, {seconds()} s so far" if seconds() else text


def send(message: Record) -> None:
    """Send a message to the process that watches, where there is one."""
    if Step.to is not None:
        with contextlib.suppress(BlockingIOError, BrokenPipeError):  # nobody reads
            os.write(Step.to, json.dumps(message).encode() + b"\n")
