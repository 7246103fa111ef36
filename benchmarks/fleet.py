"""Two hundred small run files as one fleet: time of a machine, memory of the driver, and what many workers make of it.

Run: OPENBLAS_NUM_THREADS=1 python benchmarks/fleet.py [--machines 200] [--workers 2]

The driver runs three times over more and more of the run files, each time in a process of its own; what is finished is not run
again. Then list scheduling of the measured seconds for 10^4 machines on 256 workers, and table and page of 10^4 rows.
"""

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent / "tests")]

import numpy as np  # noqa: E402
from sweep_scaling import makespan  # noqa: E402

from robustid.app.run.fleet import PAGE, TABLE, Rows, items_of, run_fleet  # noqa: E402
from robustid.app.run.fleet_item import Item, Kept  # noqa: E402
from robustid.app.run.fleet_table import write_table  # noqa: E402
from robustid.guarantees import fleet_of  # noqa: E402
from robustid.report import write_report  # noqa: E402
from support.fleets import machines, written  # noqa: E402

MANY, WORKERS = 10_000, 256


def driver(place, count, workers):
    """The driver alone: run the first machines, and print the seconds and the most memory that this process had."""
    items = items_of(sorted((place / "runs").glob("*.toml"))[:count], place / "out")
    start = time.monotonic()
    run_fleet(items, place / "out", workers, place / "out" / TABLE)
    print(time.monotonic() - start, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)


def gathered(place, count):
    """The last steps of the driver alone: table and page of the rows of so many machines."""
    items, start = (
        [Item(f"m{k:05d}", "", str(place / f"m{k:05d}"), False, False) for k in range(count)],
        time.monotonic(),
    )
    write_table(place / TABLE, Rows(items))
    write_report(fleet_of(Rows(items), count), place / PAGE)
    print(time.monotonic() - start, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)


def alone(*arguments):
    """Numbers that this script prints with other arguments, in a process of its own."""
    found = subprocess.run([sys.executable, __file__, *map(str, arguments)], check=True, capture_output=True, text=True)
    return [float(one) for one in found.stdout.split()]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--machines", type=int, default=200)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--driver", nargs=2, help=argparse.SUPPRESS)
    parser.add_argument("--gathered", nargs=2, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.driver:
        return driver(Path(arguments.driver[0]), int(arguments.driver[1]), arguments.workers)
    if arguments.gathered:
        return gathered(Path(arguments.gathered[0]), int(arguments.gathered[1]))
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        machines(place / "runs", arguments.machines)
        ran = 0
        for count in sorted({min(one, arguments.machines) for one in (10, 100, arguments.machines)}):
            seconds, memory = alone("--driver", place, count, "--workers", arguments.workers)
            print(
                f"{count:5d} machines, {count - ran} of them run now: {seconds:6.1f} s, the driver {memory:.0f} MB at most"
            )
            ran = count
        seconds, memory = alone("--driver", place, ran, "--workers", arguments.workers)
        print(f"{ran:5d} machines, none of them run now: {seconds:6.1f} s, the driver {memory:.0f} MB at most")
        rows = [Kept.read(place / "out" / name) for name in written(place / "out")]
        times = np.array([one.row.seconds for one in rows])
        print(f"a machine: {np.median(times):.2f} s in the median, {times.max():.2f} at most, {times.sum():.0f} in all")
        sizes = [
            sum(file.stat().st_size for file in (place / "out" / name).rglob("*")) for name in written(place / "out")
        ]
        print(f"on disk: {np.median(sizes) / 1e6:.2f} MB a machine")
        many = np.random.default_rng(0).choice(times, MANY)
        for workers in (2, 16, WORKERS):
            span = makespan(many, workers, 0.0)
            print(
                f"simulated: {MANY} machines on {workers:3d} workers: {span:8.1f} s, {many.sum() / span:5.1f} times as fast as one"
            )
        for k in range(MANY):
            Kept(rows[k % len(rows)].row._replace(name=f"m{k:05d}"), "").write(place / "many" / f"m{k:05d}")
        for count in (100, MANY):
            seconds, memory = alone("--gathered", place / "many", count)
            print(f"table and page of {count} rows: {seconds:.1f} s, {memory:.0f} MB at most")
    return 0


if __name__ == "__main__":
    sys.exit(main())
