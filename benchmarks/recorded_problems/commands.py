"""The command line in this process: exit codes and what is printed."""

from __future__ import annotations

import contextlib
import io
import os
import re
import sys

import numpy as np

import robustid as rid
from robustid.app.cli import main as cli

from .data import PERIOD, periodic_records
from .plants import HZ, mobility_response, modal_system, noisy, structure
from .registry import problem
from .runs import CLASS, DATA, SHORT, measured

GIVEN = ["--frequency", "frf.csv", "--time", "step.csv", "--mode", "9:0.1", "--mode", "17.67:0.004"]
GIVEN += ["--gain", "0.2", "--decay-rate", "1.1", "--no-reduce"]


_SLOW = re.compile(r"(?m)^[^:\n]+(?:: [^:\n]+)?: \d+ of \d+.*\n")  # progress, said where there is time for it


def called(folder, *commands):
    """Exit code and text of each command, one after the other in the folder."""
    kept, found = (sys.argv, os.environ.get("COLUMNS")), {}
    os.environ["COLUMNS"] = "160"
    try:
        with contextlib.chdir(folder):
            for command in commands:
                sys.argv, out, err = ["robustid", *command], io.StringIO(), io.StringIO()
                with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
                    try:
                        cli.main()
                        code = 0
                    except SystemExit as stop:
                        code = stop.code or 0
                found[f"{len(found)} " + " ".join(command)] = {
                    "code": code,
                    "out": _SLOW.sub("", out.getvalue()),
                    "err": err.getvalue(),
                }
    finally:
        sys.argv = kept[0]
        os.environ.pop("COLUMNS") if kept[1] is None else os.environ.update(COLUMNS=kept[1])
    return found


@problem()
def command_identify(folder):
    measured(folder)
    wrong = [part.replace("17.67", "17.2") for part in GIVEN]
    return called(
        folder,
        ["identify", *GIVEN, "-o", "good"],
        ["identify", *wrong, "-o", "wrong", "-v"],
        ["identify", *GIVEN, "-o", "good"],
        ["bounds", "good", "--omega", "60", "--omega", "110", "--directions", "4", "-o", "sweep", "-v"],
        ["verify", "sweep"],
        ["verify", "good"],
        ["reduce", "good", "-o", "small.npz"],
    )


@problem(quick=True)
def command_misuse(folder):
    (folder / "text.csv").write_text("a,b\n1,x\n")
    return called(
        folder,
        ["identify", "--frequency", "missing.csv"],
        ["identify", "--frequency", "text.csv", "--dt", "-1"],
        ["frf", "text.csv"],
        ["verify", "nothing"],
        ["reduce", "nothing.npz", "--order", "2"],
        ["explode"],
    )


@problem(quick=True)
def command_help(folder):
    return called(folder, ["--version"], ["--help"], *([name, "--help"] for name in cli.COMMANDS), ["run", "--keys"])


@problem()
def command_run(folder):
    measured(folder)
    (folder / "ask.toml").write_text(DATA + CLASS + SHORT)
    return called(folder, ["run", "ask.toml", "-o", "out"], ["run", "ask.toml", "-o", "out"], ["verify", "out/band"])


@problem(loose=("5 fit",))
def command_data(folder):
    play, records = periodic_records()
    for k, record in enumerate(records[:2]):
        rid.save(folder / f"run{k + 1}.csv", record)
    rid.save(folder / "model.npz", modal_system(modes=3).sample(1 / 4000))
    rid.save(
        folder / "frf.csv", noisy(modal_system(seed=5, outputs=1, inputs=1, modes=2), HZ * np.geomspace(4, 1200, 80))
    )
    return {"lines": play.lines} | called(
        folder,
        ["excite", "--band", "1:20", "--dt", "0.01", "--period", "100", "--inputs", "2", "--no-minimise-crest"],
        ["frf", "run1.csv", "run2.csv", "--period", str(PERIOD), "-o", "made.npz"],
        ["look", "run1.csv", "frf.csv"],
        ["look", "run1.csv", "-v"],
        ["new", "run1.csv", "-o", "run.toml"],
        ["fit", "frf.csv", "--order", "4", "-o", "fit", "-v"],
        ["reduce", "model.npz", "--order", "4", "-o", "small.npz"],
        ["export", "small.npz", "-o", "small.m"],
    )


@problem(quick=True)
def command_report(folder):
    found = rid.identify(structure(lines=4, samples=4))
    found.save(folder / "mine")
    return called(folder, ["report", "mine", "--no-reduce", "-o", "page.html"], ["report", "none"])


@problem(loose=("0 identify",))
def command_passive(folder):
    rid.save(folder / "mobility.csv", mobility_response(lines=12))
    given = [
        "identify",
        "--frequency",
        "mobility.csv",
        "--passive",
        "positive real",
        "--decay",
        "5",
        "--mode",
        "31:0.06",
    ]
    return called(
        folder,
        [*given, "--no-reduce", "-o", "mine"],
        ["demo", "-o", "demo"],
        ["export", "demo/result", "-o", "model.m"],
        ["verify", "mine", "--exact"],
    )
