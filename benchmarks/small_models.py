"""Smallest models of matrices inside the bounds: orders, margins, processor seconds; beside another checkout of the library.

Run: OPENBLAS_NUM_THREADS=1 ROBUSTID_DATA=... python benchmarks/small_models.py [--kept folder] [--beside checkout] [plant ...]
Plants: beam, mirror, 2x2, 4x4 (those of `matrix_guarantees.py`), beam-dense (every 8th line from 5 to 90 Hz), mirror-wide (its
eleven modes from 400 to 2700 Hz). Identifications are kept in the folder for the next run: the dense beam's takes four minutes.
Every search runs in a process of its own. What it returns is judged from the numbers: every sample, the poles, the guard.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import robustid as rid


def dense_beam():
    """The example's run with twice the lines and a wider band."""
    text = (Path(__file__).parent.parent / "examples" / "beam_ring.toml").read_text().split("[worst_case]")[0]
    text = text.replace("every = 16", "every = 8").replace("[8.0, 70.0]", "[5.0, 90.0]")
    folder = Path(tempfile.mkdtemp())
    (folder / "ask.toml").write_text(text + "[worst_case]\ncompute = false\n[small_model]\ntime_limit = 1.0\n")
    return rid.run(folder / "ask.toml", folder / "beam").identification


def wide_mirror():
    """All modes that `suggest_kautz` finds, bounds widened to what the class needs and a tenth more."""
    from matrix_guarantees import with_room

    frf = rid.estimate_frf(rid.datasets.load("fsm/train"), period=8192)
    inside = frf.band(400, 2700)
    found = rid.suggest_kautz(inside)
    hz = found.omega / (2 * np.pi)
    near = hz[:, None] * (1 + found.damping[:, None] * np.linspace(-2, 2, 5))
    wanted = np.concatenate([near.ravel(), np.linspace(400, 2700, 40)])
    used = inside.select(np.unique(np.argmin(np.abs(inside.freq_hz[:, None] - wanted), axis=0)))
    basis = rid.kautz(found.omega, found.damping, dt=frf.dt, delay=1)
    return with_room(used, rid.Prior(gain_bound=1e-5, decay_rate=1.1), basis)


def identified(name, folder):
    """Path of the identification of a plant, which is made where it isn't kept."""
    from matrix_guarantees import PLANTS as SMALL

    path = folder / name
    if not path.with_suffix(".json").exists():
        (SMALL | {"beam-dense": dense_beam, "mirror-wide": wide_mirror})[name]().save(path)
    return path


def search(path, limit):
    """One search, timed; its model judged from the numbers."""
    from robustid.identification import model_residuals
    from robustid.reduction.between_points import Guard

    result = rid.load(path)
    start = time.process_time()
    small = rid.reduce_within_bounds(result, time_limit=limit)
    seconds = time.process_time() - start
    ratio = max(float(r.ratio.max()) for r in model_residuals(result.problem, small.model))
    between = Guard(result, 0).check(small.model, 1.0)[0]
    radius = float(np.abs(small.model.poles()).max(initial=0.0))
    inside = max(ratio, between) <= 1 and radius < 1 and abs(ratio - small.margin) < 1e-9
    samples = sum(np.isfinite(f.bound).sum() for f in result.problem.frequency)
    shape = "x".join(map(str, result.problem.entries.shape))
    return {
        "plant": f"{shape:>5}{samples:9d}{result.order:12d}",
        "found": f"{small.order:8d}{ratio:9.4f}{seconds:9.1f}  {small.stopped[:25] or ('inside' if inside else 'OUTSIDE')}",
        "seconds": seconds,
    }


def elsewhere(path, limit, checkout):
    """The search by the library of a checkout, in a process of its own."""
    command = [sys.executable, __file__, "--search", str(path), "--limit", str(limit)]
    environment = os.environ | {"PYTHONPATH": str(Path(checkout).resolve())}
    return json.loads(subprocess.run(command, env=environment, capture_output=True, check=True, text=True).stdout)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("plants", nargs="*", default=["beam", "mirror", "2x2", "4x4"])
    parser.add_argument("--kept", type=Path, help="folder of the identifications (default: a temporary one)")
    parser.add_argument("--beside", type=Path, help="checkout of another version")
    parser.add_argument("--limit", type=float, default=600.0, help="seconds of a search")
    parser.add_argument("--search", type=Path, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.search:
        print(json.dumps(search(arguments.search, arguments.limit)))
        return
    folder = arguments.kept or Path(tempfile.mkdtemp())
    folder.mkdir(parents=True, exist_ok=True)
    here = Path(__file__).parent.parent
    print(f"{'plant':12}{'size':>5}{'samples':>9}{'identified':>12}{'order':>8}{'margin':>9}{'CPU s':>9}  judged")
    for name in arguments.plants:
        path = identified(name, folder)
        ours = elsewhere(path, arguments.limit, here)
        print(f"{name:12}{ours['plant']}{ours['found']}", flush=True)
        if arguments.beside:
            other = elsewhere(path, arguments.limit, arguments.beside)
            ratio = other["seconds"] / ours["seconds"]
            print(f"{'':38}{other['found']}, the other version: {ratio:.1f} times the time", flush=True)


if __name__ == "__main__":
    main()
