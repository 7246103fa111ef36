"""What is asked of a guarantee that is there: `hinf`, `weight()` and `response_tube`, processor seconds of each.

Run: OPENBLAS_NUM_THREADS=1 ROBUSTID_DATA=... python benchmarks/conclusions.py [CASE ...] [--kept FOLDER]
Cases are the examples as they stand (all that they bound is asked) and the matrices of `bands.py`; the bar is 5 s each.
With a folder, what examples have bounded is kept there, and taken from there the next time.
"""

import argparse
import contextlib
import dataclasses
import io
import runpy
import sys
import tempfile
import time
from pathlib import Path

import matplotlib as mpl
import numpy as np
from band_problems import TIMES

import robustid as rid
from robustid.core import one_thread
from robustid.guarantees import response_tube

BAR = 5.0  # CPU s
EXAMPLES_FOLDER = Path(__file__).parent.parent / "examples"
EXAMPLES = {
    "worst_case": [],
    "proved_band": [],
    "passive_beam": [],
    "continuous_time": [],
    "inanc2001": [],
    "torsion_margin": [],
    "beam_damping": [],
    "beam_mimo": ["--guarantee"],
    "short_records": ["--machine", "hairdryer"],
    "mirror_family": [],
    "torsion.toml": [],
    "beam_ring.toml": [],
}
MATRICES = ("2879 lines", "beam 2x2", "mirror 3x3", "28x2")


def of_example(name):
    """All that an example bounds."""
    if name.endswith(".toml"):
        run = rid.run(EXAMPLES_FOLDER / name, tempfile.mkdtemp())
        return [one for one in (run.worst_case, run.band) if one is not None]
    found, kept = [], {}
    for call in ("worst_case_error", "band", "family"):
        kept[call] = getattr(rid, call)
        setattr(rid, call, lambda *args, _call=kept[call], **named: found.append(_call(*args, **named)) or found[-1])
    before, sys.argv = sys.argv, [name, *EXAMPLES[name], "--out", tempfile.mkdtemp()]
    try:
        runpy.run_path(str(EXAMPLES_FOLDER / f"{name}.py"), run_name="__main__")
    finally:
        sys.argv = before
        for call, own in kept.items():
            setattr(rid, call, own)
    return found


def of_matrix(name):
    """The band of a matrix, poles in their box, about a modal model."""
    from bands import modal_model

    problem, box = TIMES[name][0]()
    if not isinstance(box, tuple):
        box = box.omega_interval, box.damping_interval
    return [rid.band(problem, box=box, model=modal_model(problem))]


def results_of(name, kept):
    """What a case bounds; of examples from the folder where it is."""
    if name in MATRICES:
        return of_matrix(name)
    if kept is not None and (files := sorted(kept.glob(f"{name}-*.npz"))):
        return [rid.load(one.with_suffix("")) for one in files]
    with contextlib.redirect_stdout(io.StringIO()):
        found = of_example(name)
    for number, one in enumerate(found if kept is not None else []):
        rid.save(kept / f"{name}-{number}", one)
    return found


def asked(work):
    """Seconds and what came out, in words."""
    start = time.process_time()
    try:
        value = work()
    except Exception as error:
        value = f"{type(error).__name__}: {error}"
    return time.process_time() - start, value


def measured(name, result):
    """A row: every question to a result that has not answered anything yet."""
    anew = dataclasses.replace(result)
    with one_thread():
        if getattr(anew, "model", None) is None:
            return
        cells = [f"{name:18}{type(result).__name__:20}{anew.model.nstates:7d}{anew.model.D.shape!s:>9}"]
        seconds, circle = asked(lambda: anew.circle)
        words = circle if isinstance(circle, str) else f"{circle.largest:.4g} ({circle.bound.size} arcs)"
        cells.append(f"{seconds:7.2f} s {words:24}")
        every = [seconds]
        if not isinstance(circle, str) and np.isfinite(circle.largest):
            seconds, weight = asked(anew.weight)
            cells.append(f"{seconds:7.2f} s {weight if isinstance(weight, str) else f'order {weight.order}':9}")
            every.append(seconds)
        identification = getattr(result, "identification", None)
        if identification is not None and identification.problem.dt and not identification.problem.prior.positive_real:
            entry = None if identification.problem.entries.single else (0, 0)
            seconds, tube = asked(lambda: response_tube(identification, input="step", entry=entry))
            words = tube if isinstance(tube, str) else f"{tube.samples.size} samples"
            cells.append(f"{seconds:7.2f} s {words}")
            every.append(seconds)
    print("  ".join(cells), "" if max(every) <= BAR else "MISSED", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("cases", nargs="*", metavar="CASE", help=", ".join([*EXAMPLES, *MATRICES]))
    parser.add_argument("--kept", type=Path, help="folder of what examples have bounded")
    arguments = parser.parse_args()
    mpl.use("Agg")
    if arguments.kept is not None:
        arguments.kept.mkdir(parents=True, exist_ok=True)
    print(f"{'case':20}{'result':22}{'order':>5}{'shape':>9}  hinf, largest (arcs)                weight()   step tube")
    for name in arguments.cases or [*EXAMPLES, *MATRICES]:
        for result in results_of(name, arguments.kept):
            measured(name, result)


if __name__ == "__main__":
    main()
