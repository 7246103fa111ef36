"""Run files to their results, results saved and loaded, exports."""

from __future__ import annotations

import contextlib

import numpy as np

import robustid as rid

from .data import PERIOD, periodic_records
from .guarantees import close_box, member
from .identification import facts
from .pages import page
from .plants import HZ, compliance_problem, modal_system, noisy, structure
from .registry import of, problem

CLASS = """
[modes]
hz = [9.0, 17.67]
damping = [0.1, 0.004]
[prior]
gain_bound = 0.2
decay_rate = 1.1
"""
DATA = """
[[frequency]]
file = "frf.csv"
[[record]]
file = "step.csv"
use = "samples"
"""
SHORT = """
[worst_case]
at_hz = [5.0, 17.0]
directions = 4
"""


def measured(folder):
    """A response and a step of the structure in files."""
    data = rid.datasets.flexible_structure(seed=0, lines=5, samples=4, extra_hz=[17.4, 17.5, 17.6, 17.7, 17.8])
    rid.save(folder / "frf.csv", data.frequency)
    rid.save(folder / "step.csv", data.time)


def made(folder, text):
    """What a run file gives."""
    (folder / "ask.toml").write_text(text)
    return rid.run(folder / "ask.toml", folder / "out")


def run_facts(found, folder):
    error = found.error
    return {
        "identification": of(found.identification, "status margin margin_lower parameters model notes"),
        "order": found.reduction.order,
        "model": found.model,
        "error": None if error is None else of(error, "omega upper lower certified"),
        "band": None if found.band is None else of(found.band, "centre radius certified summary"),
        "withheld": None if found.withheld is None else found.withheld.summary(),
        "content": None if found.content is None else found.content.summary(),
        "findings": found.findings,
        "choices": found.choices,
        "run file": (folder / "out" / "run.toml").read_text(),
        "files": sorted(path.name for path in (folder / "out").iterdir()),
    }


@problem()
def run_stated(folder):
    """Everything is stated; the results are loaded again, and the page is read."""
    measured(folder)
    found = made(folder, DATA + CLASS + SHORT)
    again = {name: rid.load(folder / "out" / name) for name in ("identification", "worst_case", "band")}
    return run_facts(found, folder) | {
        "loaded margin": again["identification"].margin,
        "loaded upper": again["worst_case"].upper,
        "loaded band": again["band"].radius,
        "page": page(folder / "out" / "report.html"),
    }


@problem()
def run_chosen(folder):
    """Modes, class and bounds are left to the program; half the lines are kept out."""
    measured(folder)
    text = DATA.split("[[record]]")[0] + "[frequency_points]\nevery = 2\nnear_hz = 1.0\n[identify]\ninflate = 'auto'\n"
    return run_facts(made(folder, text + SHORT), folder)


@problem()
def run_inconsistent(folder):
    measured(folder)
    found = made(folder, DATA + CLASS.replace("17.67", "17.2") + SHORT)
    return run_facts(found, folder) | {"page": page(folder / "out" / "report.html")}


@problem(quick=True)
def run_members(folder):
    lines = []
    for k, (name, gain) in enumerate({"weak": 0.8, "strong": 1.3}.items()):
        rid.save(folder / f"{name}.csv", member(gain, k).problem.frequency[0])
        lines += [f'[[members]]\nname = "{name}"\namplitude = {gain}\n[[frequency]]\nfile = "{name}.csv"']
        lines += [f'member = "{name}"\ndt = 0.1']
    lines += [
        "[modes]\nhz = []\n[prior]\ngain_bound = 3.0\ndecay_rate = 2.0",
        "[worst_case]\nat_hz = [0.3, 1.2]\ndirections = 4",
    ]
    found = made(folder, "\n".join(lines))
    return {
        "family": of(found.family, "upper uppers model names summary"),
        "findings": found.findings,
        "summary": found.summary(),
        "run file": (folder / "out" / "run.toml").read_text(),
        "page": page(folder / "out" / "report.html"),
    }


@problem()
def saved_and_loaded(folder):
    """Every kind of result, from its files."""
    found = rid.identify(structure(lines=4, samples=4))
    error = rid.worst_case_error(found, omega=HZ * np.array([5.0]), directions=4)
    band = rid.band(found)
    fit = rid.fit_mfd(noisy(modal_system(), HZ * np.geomspace(4, 1200, 60)), order=6)
    wrong = rid.guarantee.contradiction(structure(hz=17.0))
    for name, thing in {"found": found, "error": error, "band": band, "fit": fit, "wrong": wrong}.items():
        thing.save(folder / name)
    again = {name: rid.load(folder / name) for name in ("found", "error", "band", "fit", "wrong")}
    with contextlib.chdir(folder):
        texts = {name: (folder / f"{name}.json").read_text() for name in again}
    return {
        "found": facts(again["found"]),
        "error": of(again["error"], "upper lower certified"),
        "band": of(again["band"], "centre radius certified"),
        "fit": of(again["fit"], "cost model poles"),
        "wrong": of(again["wrong"], "bound excess verify"),
        "texts": texts,
    }


@problem(quick=True)
def exports(folder):
    """Models and results as other programs read them, as text."""
    model = rid.datasets.flexible_structure().truth
    weight = rid.guarantee.uncertainty_weight(model, [1.0, 30.0, 100.0, np.pi / 0.01], [0.01, 0.04, 0.5], order=2)
    files = {
        "model.m": model,
        "model.json": model,
        "model.h": model,
        "model.sos": model,
        "model.csv": model,
        "continuous.zpk": modal_system(seed=5, outputs=1, inputs=1, modes=2),
        "plant.m": weight,
        "verdict.csv": rid.identify(structure(lines=4, samples=4)),
        "network.s2p": rid.FrequencyResponse([1.0, 2.0], 0.5 * np.ones((2, 2, 2))),
    }
    for name, thing in files.items():
        rid.save(folder / name, thing)
    return {name: (folder / name).read_text() for name in files}


@problem()
def run_records(folder):
    """Periodic records to a response with its bounds, whose class is chosen, one period kept out."""
    for k, record in enumerate(periodic_records(periods=6)[1][:2]):
        rid.save(folder / f"run{k}.csv", record)
    names = "".join(f'[[record]]\nfile = "run{k}.csv"\n' for k in range(2))
    text = f"{names}[estimate]\nperiod = {PERIOD}\n[frequency_points]\nevery = 4\n[worst_case]\ncompute = false\n"
    return run_facts(made(folder, text), folder)


@problem()
def run_over_poles(folder):
    """The sweep over the box of poles, and the bound on the whole axis."""
    measured(folder)
    box = (
        "hz_interval = [[8.999, 9.001], [17.669, 17.671]]\ndamping_interval = [[0.0999, 0.1001], [0.00399, 0.00401]]\n"
    )
    found = made(folder, DATA + CLASS.replace("[prior]", box + "[prior]") + SHORT + "over_poles = true\n")
    return run_facts(found, folder) | {"over poles": of(found.over_poles, "upper covered summary")}


@problem()
def run_continuous(folder):
    rid.save(folder / "frf.csv", compliance_problem(lines=20).frequency[0])
    text = '[[frequency]]\nfile = "frf.csv"\n[worst_case]\nat_hz = [5.0]\ndirections = 4\n'
    return run_facts(made(folder, text), folder)


@problem()
def identify_reduced(_):
    """Without files."""
    found = rid.identify_reduced(structure(lines=8, time=False).frequency[0], worst_case=False)
    return of(found, "findings choices model") | {"run file": found.run_file.text()}


@problem()
def over_poles_saved(folder):
    asked = structure(lines=4, samples=4)
    found = rid.guarantee.worst_case_over_poles(
        rid.identify(asked), *close_box(), omega=HZ * np.array([5.0]), directions=4, cells=2
    )
    found.save(folder / "box")
    again = rid.load(folder / "box")
    return of(again, "upper covered verify summary") | {"moved": again.with_model(rid.identify(asked).model).upper}
