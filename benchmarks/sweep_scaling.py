"""A worst-case sweep of a matrix on several processes, and what 64 workers would make of it.

Run: OPENBLAS_NUM_THREADS=1 python benchmarks/sweep_scaling.py [--plant 2x2] [--frequencies 24] [--workers 64]

The same frequencies one after the other, on two processes of our own, and on a `distributed` cluster of two of which one is
killed after the first result. Then list scheduling of the recorded times on more workers, with what each of them unpacks.
"""

import argparse
import heapq
import logging
import os
import pickle
import signal
import time

import numpy as np
from matrix_guarantees import DIRECTIONS, PLANTS, RTOL

import robustid as rid
from robustid.guarantees.consistent_set import consistent_set
from robustid.guarantees.polygons import value_sets_at


def bounded(result, omega, executor=None, progress=None):
    """Wall-clock seconds and the bounds."""
    start = time.monotonic()
    options = {"rtol": RTOL, "directions": DIRECTIONS, "executor": executor, "progress": progress}
    error = rid.worst_case_error(result, omega=omega, **options)
    return time.monotonic() - start, error


def on_cluster(result, omega):
    """The same on a cluster that loses one of its two workers after the first result."""
    import distributed

    lost = []
    options = {"dashboard_address": None, "silence_logs": logging.CRITICAL}
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, **options) as cluster,
        distributed.Client(cluster) as client,
    ):

        def kill_one(text, done, count):
            if not lost and done < count:
                lost.append(next(iter(cluster.workers.values())).pid)
                os.kill(lost[0], signal.SIGKILL)

        found = bounded(result, omega, client.get_executor(), kill_one)
    return *found, bool(lost)


def makespan(times, workers, first):
    """Seconds until the last of the tasks ends, taken in their order by whoever is free; each worker begins with `first`."""
    free = [first] * workers
    for one in times:
        heapq.heappush(free, heapq.heappop(free) + one)
    return max(free)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plant", default="2x2", choices=list(PLANTS))
    parser.add_argument("--frequencies", type=int, default=24)
    parser.add_argument("--workers", type=int, default=64)
    arguments = parser.parse_args()
    result = PLANTS[arguments.plant]()
    lines = np.concatenate([f.omega for f in result.problem.frequency])
    omega = np.linspace(lines.min(), lines.max(), arguments.frequencies + 2)[1:-1]

    consistent = consistent_set(result)
    start = time.process_time()
    packed = pickle.dumps(consistent)
    copy = pickle.loads(packed)
    value_sets_at(copy, float(omega[0]), 3, 0.5)
    first, times, returned = time.process_time() - start, [], []
    for w in omega:
        start = time.process_time()
        found = value_sets_at(consistent, float(w), DIRECTIONS, RTOL / 5)
        times.append(time.process_time() - start)
        returned.append(len(pickle.dumps(found)))
    print(
        f"{arguments.plant}, {omega.size} frequencies: {np.median(times):.2f} s each in the median, {max(times):.2f} at most"
    )
    print(f"bytes of a task: {len(packed)} there, {int(np.median(returned))} back")

    alone, expected = bounded(result, omega)
    two, both = bounded(result, omega, 2)
    wall, error, lost = on_cluster(result, omega)
    same = all(np.array_equal(one.upper, expected.upper) for one in (both, error))
    print(f"wall-clock: one process {alone:.1f} s, two {two:.1f} s ({alone / two:.2f} times as fast)")
    print(
        f"cluster of two that {'lost one' if lost else 'LOST NONE'}: {wall:.1f} s; bounds {'equal' if same else 'DIFFER'}"
    )

    rng = np.random.default_rng(0)
    for count in (60, 250, 1000):
        many = rng.choice(times, count)
        whole = makespan(many, 1, first)
        for workers in (2, 8, arguments.workers):
            span = makespan(many, workers, first)
            sent = count * (len(packed) + np.median(returned)) / span / 1e6
            print(
                f"simulated: {count:5d} frequencies on {workers:3d} workers: {span:7.1f} s, {whole / span:5.1f} times as fast,"
                f" {sent:.1f} MB/s through the scheduler"
            )


if __name__ == "__main__":
    main()
