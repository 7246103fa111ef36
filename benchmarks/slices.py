"""Default runs on random slices of the measured sets: does every one end with a page within its budget, and with which exit code.

Run: OPENBLAS_NUM_THREADS=1 ROBUSTID_DATA=... python benchmarks/slices.py [100] [--seed 0] [--time-limit 30]
A slice is a part of a record: its length (300 samples to all), its start, one channel of each side, fewer samples (decimation 1 to
8), as a file; `robustid frf` and `robustid identify`, or `robustid identify` of the response, as a user would. Limits and seconds
are of the processor: how long a page takes beside other programs says nothing of it.
"""

import argparse
import resource
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np

import robustid as rid

SETS = ("two_mass", "beam_ring", "fsm", "fsm_200mV/test", "cdplayer", "hairdryer")
PROGRAM = "import time; time.monotonic = time.process_time; from robustid.app.cli.main import main; main()"
FEWEST = 300
OVER = 10.0  # seconds beyond the limit that a page may take: it is written after the last step


def cut(records, rng):
    """One channel of each side of a part of the first records, decimated."""
    one = records[0]
    samples = len(one.u)
    length = int(np.exp(rng.uniform(np.log(min(FEWEST, samples)), np.log(samples))))
    start = int(rng.integers(0, samples - length + 1))
    output, column = int(rng.integers(one.y.shape[1])), int(rng.integers(one.u.shape[1]))
    factor = int(rng.choice([1, 1, 2, 4, 8]))
    part = rid.TimeRecord(
        one.u[start : start + length, column], one.y[start : start + length, output], dt=one.dt, initial="free"
    )
    if length // factor < FEWEST // 2:
        factor = 1
    made = part if factor == 1 else rid.prepare.decimate(part, factor)
    return made, f"samples {start} to {start + length}, output {output + 1}, input {column + 1}, every {factor}."


def commands(record, folder, limit):
    """Two commands of a user, with their exit codes, words and seconds."""
    rid.save(folder / "record.csv", record)
    yield ["frf", str(folder / "record.csv"), "-o", str(folder / "frf.npz"), "--force"], limit
    if (folder / "frf.npz").exists():
        page = str(folder / "page.html")
        yield ["identify", "--frequency", str(folder / "frf.npz"), "--report", page, "--time-limit", str(limit)], limit


def used():
    """Seconds of the processor that the commands took so far."""
    own = resource.getrusage(resource.RUSAGE_CHILDREN)
    return own.ru_utime + own.ru_stime


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("count", type=int, nargs="?", default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="number of the first slice")
    parser.add_argument("--time-limit", type=float, default=30.0)
    arguments = parser.parse_args()
    outcomes = Counter()
    for k in range(arguments.first, arguments.first + arguments.count):
        rng = np.random.default_rng([arguments.seed, k])
        name = str(rng.choice(SETS))
        data = rid.datasets.load(name)
        record, words = cut([data] if isinstance(data, rid.TimeRecord) else data, rng)
        with tempfile.TemporaryDirectory() as place:
            for command, limit in commands(record, Path(place), arguments.time_limit):
                start = used()
                done = subprocess.run(
                    [sys.executable, "-c", PROGRAM, *command], capture_output=True, text=True, check=False, cwd=place
                )
                code, said, seconds = done.returncode, done.stdout + done.stderr, used() - start
                paged = command[0] != "identify" or (Path(place) / "page.html").exists()
                outcome = (
                    f"{command[0]} {code}"
                    + ("" if paged else ", no page")
                    + (", late" if seconds > limit + OVER else "")
                )
                outcomes[outcome] += 1
                last = [line for line in said.splitlines() if line.strip()]
                if code not in (0, 1) or not paged or seconds > limit + OVER:
                    print(
                        f"slice {k}, {name}: {words} {outcome} after {seconds:.0f} s: {' / '.join(last[-2:])[:300]}",
                        flush=True,
                    )
    print("; ".join(f"{count} {outcome}" for outcome, count in sorted(outcomes.items())))


if __name__ == "__main__":
    main()
