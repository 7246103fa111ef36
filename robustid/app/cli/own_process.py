"""The program as two processes: one carries the command out; the other hears Ctrl-C at any time, and counts the seconds."""

from __future__ import annotations

import contextlib
import json
import os
import select
import signal
import sys
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from robustid.app.cli.steps import BEFORE_RESULTS, INTERRUPTED, SILENCE, Step, send, something_is_kept, tell

if TYPE_CHECKING:
    from types import FrameType

    from robustid.core import Record

_PATIENCE = (
    0.35  # seconds, and of processor time, after Ctrl-C in which a command answers; one compiled call may take minutes
)
_WORD = 0.25  # seconds after which it is said that a command is ending, on a busy machine too
_AT_MOST = 2.0  # seconds, where it gets no processor
_NOT_YET = "Ctrl-C: ending{}; Ctrl-C again ends at once"
_KEPT = ", with what was found so far"
_HEARD = signal.SIGUSR1 if hasattr(signal, "SIGUSR1") else signal.SIGINT
_IN_A_STEP = (
    0.15  # the same in an import, which seldom takes longer; before the first step there is nothing to wait for
)
_SHORTLY = 0.01
_IMPORTING = {
    f"{name}{outside}" for name in ("importlib._bootstrap", "_frozen_importlib") for outside in ("", "_external")
}
_CLEAR = "\r\x1b[K"


def start() -> None:
    """Entry point: the command in a process of its own, where the system has them; with its exit code."""
    if not hasattr(os, "fork"):
        _carry_out()
        return
    (of_steps, steps), (life, ours) = os.pipe(), os.pipe()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, _HEARD})  # until both know what they do with it
    child = os.fork()  # before anything has threads
    if child:
        os.close(steps)
        os.close(life)
        watch = _Watch(child, of_steps)
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        watch.until_it_ends()
    os.close(of_steps)
    os.close(ours)
    os.set_blocking(steps, False)
    Step.to = steps
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # of a terminal: the process that watches passes it on, once
    for number in (_HEARD, signal.SIGALRM):
        signal.signal(number, _interrupt)
    sys.unraisablehook = _unraisable
    signal.pthread_sigmask(signal.SIG_SETMASK, before)
    threading.Thread(target=_end_with, args=(life,), daemon=True).start()
    try:
        _carry_out()
    except KeyboardInterrupt:  # before the command's own first line, or after its last
        _stopped()
    except SystemExit as stop:
        if stop.code == INTERRUPTED:  # at once, without the farewells of libraries
            sys.stdout.flush()
            os._exit(INTERRUPTED)
        raise
    finally:  # what follows is no step: results have been said
        Step.usual = ""
        tell("")


def _carry_out() -> None:
    from robustid.app.cli.main import main

    main()


def _stopped() -> NoReturn:
    """End with what is said where nothing was written: at once, but for an answer that is asked for."""
    if "--json" in sys.argv[1:]:
        from robustid.app.cli.main import end

        end(BEFORE_RESULTS, INTERRUPTED, "stopped")
    sys.stdout.flush()
    os.write(2, f"{BEFORE_RESULTS}\n".encode())
    os._exit(INTERRUPTED)


def _interrupt(_: int, frame: FrameType | None) -> None:
    """Raise Ctrl-C, but in an import: broken off, it leaves half a module, or ends as an error of another kind."""
    while frame is not None:
        if frame.f_globals.get("__name__") in _IMPORTING:
            if not something_is_kept():
                send({"patience": 0.0 if Step.text == Step.usual else _IN_A_STEP})
            _again()
            return
        frame = frame.f_back
    send({"heard": True, "kept": something_is_kept()})
    raise KeyboardInterrupt


def _again() -> None:
    """Hear Ctrl-C once more, shortly; the process that watches ends what doesn't hear it until then."""
    signal.setitimer(signal.ITIMER_REAL, _SHORTLY)


def _unraisable(what: sys.UnraisableHookArgs) -> None:
    """Hear a Ctrl-C again that came where nothing can be raised, as in the end of an object."""
    if isinstance(what.exc_value, KeyboardInterrupt):
        _again()
    else:
        sys.__unraisablehook__(what)


def _taken(*_: object) -> None:
    """Leave a signal to the loop that reads its number."""


def _end_with(life: int) -> None:
    """End when the process that watches has ended."""
    os.read(life, 1)
    os._exit(INTERRUPTED)


class _Watch:
    """The process that watches the one of the command."""

    def __init__(self, child: int, of_steps: int) -> None:
        self._child, self._of_steps, self._rest = child, of_steps, b""
        self._step: Record = {"text": "", "kept": False, "stderr": False}
        self._began = self._shown = time.monotonic()
        self._asked: float | None = None  # when Ctrl-C came that nobody has been told of yet
        self._spent, self._patience = 0.0, _PATIENCE  # processor time then; seconds in which it has to answer
        self._heard = self._said = False  # Ctrl-C by the command; that it is ending
        self._signals, wake = os.pipe()
        os.set_blocking(wake, False)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGCHLD):
            if signal.getsignal(number) is not signal.SIG_IGN:  # as in the background of a shell
                signal.signal(number, _taken)
        signal.set_wakeup_fd(wake, warn_on_full_buffer=False)

    def until_it_ends(self) -> NoReturn:
        """Wait, and end in the same way."""
        interrupted = 0
        sources = [self._of_steps, self._signals]
        while not os.waitid(os.P_PID, self._child, os.WEXITED | os.WNOHANG | os.WNOWAIT):
            ready, _, _ = select.select(sources, [], [], 0.05 if self._asked is not None else 0.25)
            if self._of_steps in ready and not self._read():
                sources.remove(self._of_steps)
            for number in os.read(self._signals, 64) if self._signals in ready else b"":
                if number == signal.SIGINT:
                    interrupted += 1
                    self._pass_on(interrupted)
                elif number != signal.SIGCHLD:
                    os.kill(self._child, number)
            self._look()
        code = os.waitstatus_to_exitcode(os.waitpid(self._child, 0)[1])
        if code == -_HEARD:  # before it could hear anything
            _stopped()
        if code < 0:
            with contextlib.suppress(OSError):  # of a kill, as where memory is short, nothing can be set
                signal.signal(-code, signal.SIG_DFL)
            os.kill(os.getpid(), -code)
        os._exit(code if code >= 0 else 128 - code)

    def _read(self) -> bool:
        """Take the messages; False at their end."""
        got = os.read(self._of_steps, 1 << 16)
        *lines, self._rest = (self._rest + got).split(b"\n")
        for message in map(json.loads, lines):
            if (patience := message.get("patience")) is not None:
                self._patience = patience
                continue
            if message.get("heard"):
                self._heard, self._step["kept"] = True, message["kept"]
                continue
            if message["text"] != self._step["text"]:
                self._began = time.monotonic()
            self._step = message
            if message["shown"]:
                self._shown = time.monotonic()
        return bool(got)

    def _pass_on(self, time_of: int) -> None:
        if time_of > 1:
            self._end()
        self._asked, self._spent = time.monotonic(), self._processor()
        with contextlib.suppress(ProcessLookupError):
            os.kill(self._child, _HEARD)

    def _look(self) -> None:
        """Say that a step goes on; end a command that doesn't hear Ctrl-C and has nothing to keep."""
        now = time.monotonic()
        if self._asked is not None:
            passed, ending = now - self._asked, self._heard or self._step["kept"]
            late = passed > self._patience and self._processor() - self._spent >= self._patience
            if not ending and (late or passed > _AT_MOST):
                self._end()
            if passed > _WORD and not self._said:
                self._said = True
                self._say(_NOT_YET.format(_KEPT * self._step["kept"]), "\n", to=2)
            if self._said and ending:
                self._asked = None
        if self._step["text"] and now - self._shown > SILENCE:
            self._shown = now
            step, passed = self._step, now - self._began
            share = f": {step['done']} of {step['count']}" if step["count"] else ""
            self._say(f"{step['text']}{share}, {passed:.0f} s so far", to=2 if step["stderr"] else 1)

    def _processor(self) -> float:
        """Processor time of the command so far; where the system doesn't say it, seconds."""
        try:
            fields = Path(f"/proc/{self._child}/stat").read_text().rpartition(")")[2].split()
        except OSError:
            return time.monotonic()
        return sum(map(int, fields[11:13])) / os.sysconf("SC_CLK_TCK")

    def _say(self, words: str, ending: str = "", *, to: int) -> None:
        """Write a line, over the one of the step at a terminal."""
        with contextlib.suppress(OSError):
            if os.isatty(to):
                words = _CLEAR + words[: os.get_terminal_size(to).columns - 1] + ending
            else:
                words += "\n"
            os.write(to, words.encode(errors="replace"))

    def _end(self) -> NoReturn:
        os.kill(self._child, signal.SIGKILL)
        os.waitpid(self._child, 0)
        if os.isatty(2):
            os.write(2, f"{_CLEAR}\x1b[?25h".encode())  # the cursor is hidden while a step is shown
        _stopped()
