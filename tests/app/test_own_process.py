"""Ctrl-C ends the program in whatever it is, also in one call of a compiled library; what has something to keep keeps it."""

import os
import re
import signal
import subprocess
import sys
import time

import pytest

from support.cases import slow

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="the program is one process here")

HEAD = """
import contextlib, itertools, sys, time
from robustid.app.cli import main, own_process, screen, steps
own_process.SILENCE = steps.SILENCE = 0.2
def endless():  # one call that neither hears signals nor lets another thread run
    print("begun", flush=True)
    sum(itertools.repeat(1, 10**13))
def command():
{command}
main.main = command
own_process.start()
"""
LONG = """
    with screen.telling(screen.console()) as progress:
        progress("truncating", 0, 0)
        endless()
"""
COUNTED = """
    with screen.telling(screen.console()) as progress:
        progress("bounding", 3, 7)
        endless()
"""
KEEPING = """
    from robustid.core import Interruptible
    with Interruptible() as loop:
        print("begun", flush=True)
        time.sleep(60)
    time.sleep(1)
    print("kept", loop.interrupted, flush=True)
    sys.exit(130)
"""
KEEPS = """
    from robustid.core import Interruptible
    with Interruptible(), screen.telling(screen.console()) as progress:
        progress("searching", 1, 7)
        endless()
"""

HALF = """
import time
try:
    print("begun", flush=True)
    time.sleep(0.3)
except KeyboardInterrupt:
    raise ImportError("half a module")
print("whole", flush=True)
"""
IMPORTING = """
    with screen.telling(screen.console()) as progress:
        progress("drawing", 0, 0)
        import half
        time.sleep(60)
"""
DELETING = """
    class Deleted:
        def __del__(self):
            print("begun", flush=True)
            time.sleep(60)
    Deleted()
    time.sleep(60)
"""


@pytest.fixture
def program(tmp_path):
    """Start a program with this command, as a terminal does: a group of processes of its own."""
    started = []

    def start(command, *arguments):
        text = HEAD.format(command=command)
        begun = subprocess.Popen(
            [sys.executable, "-c", text, *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
            cwd=tmp_path,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        )
        started.append(begun)
        return begun

    yield start
    for one in started:
        if one.poll() is None:
            os.killpg(one.pid, signal.SIGKILL)
        one.communicate()


def until(program, words):
    """Read its lines until one holds these words."""
    seen = []
    for line in program.stdout:
        seen.append(line)
        if words in line:
            return
    raise AssertionError(f"ended with {program.wait()}: {''.join(seen)}")


def ended(program):
    out, _ = program.communicate(timeout=30)
    return program.returncode, out


@pytest.mark.parametrize(("command", "line"), [slow(LONG, "truncating, "), (COUNTED, "bounding: 3 of 7, ")])
def test_a_call_that_hears_nothing_is_told_of_with_its_count_and_its_seconds_and_ended_by_ctrl_c(
    program, command, line
):
    running = program(command)
    until(running, "begun")
    until(running, f"{line}0 s so far")
    until(running, f"{line}1 s so far")
    os.killpg(running.pid, signal.SIGINT)
    code, out = ended(running)
    assert (code, out.splitlines()[-1]) == (130, "interrupted before its end; nothing more is written")


def test_what_keeps_ctrl_c_back_writes_what_it_has_and_is_told_of(program):
    running = program(KEEPING)
    until(running, "begun")
    os.killpg(running.pid, signal.SIGINT)
    assert ended(running) == (130, "Ctrl-C: ending, with what was found so far; Ctrl-C again ends at once\nkept True\n")


def test_a_second_ctrl_c_ends_at_once_what_has_something_to_keep(program):
    running = program(KEEPS)
    until(running, "begun")
    until(running, "searching: 1 of 7, ")
    os.killpg(running.pid, signal.SIGINT)
    until(running, "Ctrl-C again ends at once")
    os.killpg(running.pid, signal.SIGINT)
    assert ended(running)[0] == 130


def test_an_answer_is_written_for_a_call_that_was_ended(program):
    running = program(LONG, "reduce", "--json")
    until(running, "begun")
    until(running, " s so far")
    os.killpg(running.pid, signal.SIGINT)
    code, out = ended(running)
    assert (code, '"status": "stopped"' in out) == (130, True)


@pytest.mark.parametrize(
    ("command", "before"),
    [("    import half", ""), (IMPORTING, "whole\n"), (DELETING, "")],
    ids=["first import", "import", "del"],
)
def test_ctrl_c_is_heard_after_an_import_and_where_nothing_can_be_raised(program, tmp_path, command, before):
    (tmp_path / "half.py").write_text(HALF)
    running = program(command)
    until(running, "begun")
    os.killpg(running.pid, signal.SIGINT)
    code, out = ended(running)
    said = "".join(line for line in out.splitlines(keepends=True) if not re.search("Ctrl-C again|so far", line))
    assert (code, said) == (130, f"{before}interrupted before its end; nothing more is written\n")


def test_ctrl_c_before_the_command_s_first_line_ends_as_in_it(program):
    assert ended(program("    raise KeyboardInterrupt")) == (
        130,
        "interrupted before its end; nothing more is written\n",
    )


def test_the_exit_code_is_that_of_the_command(program):
    assert ended(program("    sys.exit(3)")) == (3, "")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_nothing_is_left_where_the_program_is_killed(program, number):
    running = program("    print('begun', flush=True)\n    time.sleep(60)")
    until(running, "begun")
    running.send_signal(number)
    assert ended(running)[0] == -number  # its output ends only with the last process


def test_a_command_that_is_killed_ends_the_program_in_the_same_way(program):
    """As the system does where memory is short."""
    assert ended(program("    import os\n    os.kill(os.getpid(), 9)")) == (-signal.SIGKILL, "")


def test_workers_end_with_the_process_that_was_killed(program):
    text = (
        "    from robustid.core import worker_pool\n    pool = worker_pool(2)\n    pool.submit(abs, 1).result()\n"
        "    print('begun', flush=True)\n    time.sleep(60)"
    )
    running = program(text)
    until(running, "begun")
    running.kill()
    began = time.monotonic()
    assert ended(running)[0] == -signal.SIGKILL
    assert time.monotonic() - began < 25
