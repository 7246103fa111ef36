"""Progress in one line, at terminals, in notebooks, and in files; Ctrl-C that is kept back."""

import contextlib
import sys

import numpy as np
import pytest

import robustid as rid
from robustid.core import Interruptible, pass_on
from robustid.core.progress import ShowProgress
from support.structure import about_structure


class Notebook:
    """What notebooks put in the place of stdout."""

    def __init__(self):
        self.text = ""

    def isatty(self):
        return False

    def write(self, text):
        self.text += text

    def flush(self):
        pass


Notebook.__module__ = "ipykernel.iostream"


def test_a_notebook_gets_one_line_that_is_rewritten(monkeypatch):
    monkeypatch.setattr(sys, "stdout", Notebook())
    show = ShowProgress()
    for k in range(5001):
        show("", k, 5000)
    show("next")
    assert sys.stdout.text.count("\n") == 1
    assert "5000 of 5000\n" in sys.stdout.text
    assert sys.stdout.text.count("\r") < 20


def test_a_file_gets_at_most_eleven_lines(capsys):
    show = ShowProgress()
    for k in range(1001):
        show("counting", k, 1000)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 11
    assert lines[-1] == "counting: 1000 of 1000"


def test_functions_of_all_kinds_take_it(capsys):
    data = rid.datasets.flexible_structure(seed=0)
    rid.fit_mfd(data.frequency, order=2, progress=rid.show_progress)
    result = rid.identify(about_structure(data, 0.2, 1.1), progress=rid.show_progress)
    rid.worst_case_error(result, omega=np.array([60.0]), directions=4, progress=rid.show_progress)
    out = capsys.readouterr().out
    assert "cost" in out
    assert "bounding the error at every frequency: 1 of 1" in out
    assert "1 of 1" in out


@pytest.mark.parametrize("there", [True, False])
def test_ctrl_c_is_kept_back_where_there_is_something_to_return(there):
    with contextlib.nullcontext() if there else pytest.raises(KeyboardInterrupt):
        with Interruptible(lambda: there) as loop:
            pass_on(True)
        assert loop.interrupted
    with Interruptible() as loop:
        pass_on(False)
    assert not loop.interrupted
    with pytest.raises(ValueError, match="another"), Interruptible():
        raise ValueError("another")
