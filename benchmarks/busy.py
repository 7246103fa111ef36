"""Calls of the library on a busy machine: with a process spinning on every core, over the same with one thread on an idle one.

Run: python benchmarks/busy.py [--calls fit order ...] on an otherwise quiet machine. Every call runs in a process of its own:
first with one BLAS thread, then as a user starts it, with the library's own choice of threads, beside the spinning processes.
Half of the wall time is the machine's share: on two cores and two spinning processes a ratio of 2 is the best that can be had.
The processor time, of all threads, should be that of one thread: threads that share a core spend it waiting for each other.
"""

import argparse
import os
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent
CALLS = {
    "fit": "rid.fit_mfd(arrivals.stand_in(0, 20, 500)[0], order=24)",
    "order": "rid.fits.suggest_order(rid.datasets.flexible_structure(lines=60).frequency)",
    "identify": "rid.identify(problem())",
    "bands": "rid.worst_case_error(rid.identify(problem()), omega=[50.0, 111.0, 120.0])",
    "reduce": "rid.reduce_within_bounds(rid.identify(problem()))",
    "prior": "rid.suggest_prior(problem())",
    "class": "data = rid.datasets.flexible_structure(); rid.advise.suggest_class(frequency=data.frequency, modes=data.modes)",
    "tube": "rid.guarantee.response_tube(rid.identify(problem()), times=[0.03])",
    "truncate": "rid.balanced_truncation(plant(), order=60)",
    "large": "rid.identify(question, form='taylor')",
    "large_truncate": "rid.balanced_truncation(plant(400), order=60)",
}
BEFORE = {"large": "question = solver_scaling.measurements(730, 1000, 0, kautz=True)"}  # not counted
SETUP = f"""
import sys, time, warnings
warnings.simplefilter("ignore")
sys.path[:0] = [{str(HERE)!r}]
import control, cvxpy, numpy as np, scipy.linalg
import arrivals, solver_scaling
import robustid as rid

def problem():
    experiment, prior = rid.datasets.flexible_structure(), rid.Prior(gain_bound=0.2, decay_rate=1.1)
    kautz = rid.kautz(*experiment.modes.T, dt=0.01, delay=1)
    return rid.MixedProblem(frequency=experiment.frequency, time=experiment.time, prior=prior, parametric=kautz)

def plant(modes=100):
    rng = np.random.default_rng(0)
    w = 2 * np.pi * np.geomspace(1, 1000, modes)
    A = scipy.linalg.block_diag(*[[[-0.01 * v, v], [-v, -0.01 * v]] for v in w])
    return control.ss(A, rng.standard_normal((len(A), 2)), rng.standard_normal((2, len(A))), np.zeros((2, 2)))

"""
CLOCKS = "(time.perf_counter(), time.process_time())"


def seconds(call, **environment):
    """Wall and processor seconds of a call, its imports not counted."""
    begin, end = f"begin = {CLOCKS}", f"print(*(b - a for a, b in zip(begin, {CLOCKS})))"
    code = SETUP + "\n".join([BEFORE.get(call, ""), begin, CALLS[call], end])
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env={**os.environ, **environment}
    )
    if done.returncode:
        sys.exit(done.stderr)
    return tuple(map(float, done.stdout.split()[-2:]))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--calls", nargs="+", choices=CALLS, default=list(CALLS))
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--spinning", type=int, default=os.cpu_count() or 1, help="processes beside the call")
    arguments = parser.parse_args()
    idle = {
        call: min(seconds(call, OPENBLAS_NUM_THREADS="1") for _ in range(arguments.runs)) for call in arguments.calls
    }
    spinning = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(arguments.spinning)]
    try:
        for call in arguments.calls:
            busy, alone = max(seconds(call) for _ in range(arguments.runs)), idle[call]
            wall, used = (b / a for a, b in zip(alone, busy, strict=True))
            print(
                f"{call}: idle, one thread {alone[0]:.2f} s (processor {alone[1]:.2f} s); busy {busy[0]:.2f} s"
                f" ({busy[1]:.2f} s); ratio {wall:.2f} ({used:.2f})",
                flush=True,
            )
    finally:
        for process in spinning:
            process.kill()


if __name__ == "__main__":
    main()
