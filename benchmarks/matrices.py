"""Problems of several channels: all of identify(), stage by stage, and the margin against Clarabel.

Run: OPENBLAS_NUM_THREADS=2 python benchmarks/matrices.py [--full]. A plant of two modes with residues of rank one and a random
smooth rest, a bound on every entry of every line. Every figure is of a process of its own. --full adds the sizes that take minutes.
"""

import argparse
import json
import resource
import subprocess
import sys
import time

import numpy as np
from solver_scaling import ACCURACY, counted, of_length

QUICK = (2, 2, 60, 500), (4, 4, 20, 200)
FULL = (2, 2, 200, 500), (4, 4, 60, 500)
PEER = (2, 2, 6, 30), (2, 2, 10, 30), (3, 3, 10, 30), (2, 2, 20, 30), (3, 3, 20, 30)  # blocks of size L (p + q)


def measurements(p, q, length, lines, seed=0):
    """Simulated lines of a p x q plant that take `length` Taylor coefficients at the default accuracy."""
    import robustid as rid

    rng, bound = np.random.default_rng(seed), 0.05
    omega = np.sort(rng.uniform(0.05, 3.1, lines))
    basis = rid.kautz([0.4, 1.1], [0.005, 0.01], dt=1.0, delay=1)
    residues = rng.standard_normal((2, p, 1)) * rng.standard_normal((2, 1, q))
    values = np.tensordot(basis.response(omega), np.repeat(residues, 2, axis=0), 1)
    size = np.sqrt(min(p, q))
    taps = 0.05 / size * rng.standard_normal((40, p, q)) * 1.2 ** -np.arange(40.0)[:, None, None]
    values = values + np.tensordot(np.exp(-1j * np.outer(omega, np.arange(40))), taps, 1)
    values = values + 1.5 * bound * np.sqrt(rng.random(values.shape)) * np.exp(2j * np.pi * rng.random(values.shape))
    frf = rid.FrequencyResponse(omega, values, bound=bound, dt=1.0)
    return of_length(length, {"frequency": frf, "parametric": basis})


def ours(p, q, length, lines):
    """All of identify(): what to print, with seconds per stage."""
    import robustid as rid
    from robustid.identification.solver import newton

    problem, systems = measurements(p, q, length, lines), counted(newton)
    start, worked = time.perf_counter(), time.process_time()
    result = rid.identify(problem, form="taylor", solver="structured")
    return {
        "seconds": time.perf_counter() - start,
        "cpu": time.process_time() - worked,
        "stages": dict(result.timing),
        "systems": len(systems),
        "margin": result.margin,
        "width": result.margin - result.margin_lower,
        "passed": result.verification.passed,
        "order": result.order,
    }


def margins(p, q, length, lines):
    """The margin alone, by the structured solver and from the semidefinite program that one would write down."""
    import cvxpy as cp

    from robustid.identification.formulation import TaylorFormulation
    from robustid.identification.margin import prove_margin

    prove_margin(
        TaylorFormulation(measurements(p, q, 4, 12), 4).data, "structured", ACCURACY
    )  # imports and first calls
    posed = TaylorFormulation(measurements(p, q, length, lines), length)
    start = time.process_time()
    margin = prove_margin(posed.data, "structured", ACCURACY)[0].margin
    seconds = time.process_time() - start
    rows, sarason = posed.data.rows, posed.data.sarason
    x, parameters, s = cp.Variable(sarason.size), cp.Variable(rows.P.shape[1]), cp.Variable()
    e = [part(rows.y) - part(rows.E.dense()) @ x - part(rows.P) @ parameters for part in (np.real, np.imag)]
    X = cp.reshape(sarason.unit_matrices.reshape(sarason.size, -1).T @ x, sarason.shape, order="C")
    limits = [cp.norm(cp.vstack(e), 2, axis=0) + rows.tail <= s, cp.sigma_max(X) <= 1]
    program = cp.Problem(cp.Minimize(s), limits)
    start = time.process_time()
    program.solve(solver="CLARABEL")
    return {"ours": margin, "seconds": seconds, "theirs": float(s.value), "peer": time.process_time() - start}


def run(kind, sizes):
    """In a process of its own, with its memory in gigabytes."""
    command = [sys.executable, __file__, "--one", kind, *map(str, sizes)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(done.stderr[-2000:])
    return json.loads(done.stdout.splitlines()[-1])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--full", action="store_true")
    parser.add_argument("--one", nargs=5, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.one:
        kind, *sizes = arguments.one
        work = ours if kind == "ours" else margins
        found = work(*map(int, sizes))
        found["memory"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
        sys.stdout.write(json.dumps(found) + "\n")
        return
    print(
        "identify(), two modes, L Taylor coefficients an entry, bounds on all entries of all lines; seconds of the stages"
    )
    stages = ("margin", "centre", "model", "verification")
    print(f"{'plant':>6}{'L':>5}{'lines':>7}{'s':>8}{'CPU s':>8}" + "".join(f"{name:>14}" for name in stages), end="")
    print(f"{'GB':>6}{'systems':>9}{'margin':>9}{'width':>8}{'order':>7}")
    for p, q, length, lines in QUICK + (FULL if arguments.full else ()):
        found = run("ours", (p, q, length, lines))
        print(f"{p}x{q}".rjust(6) + f"{length:5d}{lines:7d}{found['seconds']:8.1f}{found['cpu']:8.1f}", end="")
        print("".join(f"{found['stages'][name]:14.1f}" for name in stages), end="")
        print(f"{found['memory']:6.2f}{found['systems']:9d}{found['margin']:9.4f}{found['width']:8.0e}", end="")
        print(f"{found['order']:7d}  {'verified' if found['passed'] else 'FAILED'}", flush=True)
    print("\nthe margin alone against Clarabel, one block of size L (p + q); seconds of processor time")
    print(f"{'plant':>6}{'L':>5}{'block':>7}{'CPU s':>9}{'Clarabel s':>12}{'ratio':>8}  difference")
    for p, q, length, lines in PEER if arguments.full else PEER[:2]:
        found = run("margins", (p, q, length, lines))
        print(f"{p}x{q}".rjust(6) + f"{length:5d}{length * (p + q):7d}{found['seconds']:9.3f}", end="")
        print(
            f"{found['peer']:12.3f}{found['peer'] / found['seconds']:8.0f}  {abs(found['ours'] - found['theirs']):.0e}"
        )


if __name__ == "__main__":
    main()
