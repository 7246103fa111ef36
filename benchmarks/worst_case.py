"""Worst-case errors: seconds for n = 44 coefficients, 100 frequencies, 16 directions; one support problem against Clarabel.

Run: OPENBLAS_NUM_THREADS=1 python benchmarks/worst_case.py [--workers 2 | --entries]
With --entries: processor seconds a frequency, 16 directions, of one entry with 25, 50 and 68 lines and of measured ones.
"""

import argparse
import time

import cvxpy as cp
import numpy as np
from band_problems import SWEEPS, one_entry

import robustid as rid
from robustid.guarantees.consistent_set import consistent_set
from robustid.identification.certificate import Functional


def problem(light=(17.67, 0.004)):
    """The size of the paper: 20 step samples and 12 lines, one Kautz pair for the light mode and one for the other."""
    data = rid.datasets.flexible_structure(lines=12)
    basis = rid.kautz(*data.modes.T, dt=0.01, delay=1)
    prior = rid.Prior(gain_bound=0.2, decay_rate=1.1)
    return rid.MixedProblem(frequency=data.frequency, time=data.time, prior=prior, parametric=basis)


def clarabel(consistent, functional):
    """The same support problem as one would write it down, on the two n x n blocks."""
    rows, sarason = consistent.data.rows, consistent.data.sarason
    n = sarason.pair.order
    x, p = cp.Variable(n), cp.Variable(rows.P.shape[1])
    E, P, y = rows.real(rows.E.dense()), rows.real(rows.P), rows.real(rows.y)
    e, count, discs = y - E @ x - P @ p, rows.y.size, rows.discs
    H = cp.reshape(sarason.symmetric_basis.reshape(n, -1).T @ x, (n, n), order="C")
    H = (H + H.T) / 2
    limits = [np.eye(n) - H >> 0, np.eye(n) + H >> 0, cp.abs(e[discs:count]) <= 1]
    limits.append(cp.norm(cp.vstack([e[:discs], e[count:]]), 2, axis=0) <= 1)
    program = cp.Problem(cp.Maximize(functional.x @ x + functional.p @ p), limits)
    start = time.perf_counter()
    program.solve(solver="CLARABEL")
    return float(program.value), time.perf_counter() - start


def entries():
    """Print processor seconds a frequency of one entry, the intervals of its parameters included."""
    found = {f"{lines} lines": rid.identify(one_entry(lines, [77.0], [0.017])[0]) for lines in (25, 50, 68)}
    found |= {name: SWEEPS[name]() for name in ("motor", "hair dryer", "beam entry", "mirror entry")}
    rid.worst_case_error(found["25 lines"], omega=found["25 lines"].problem.frequency[0].omega[:1])  # what it imports
    for name, result in found.items():
        lines = result.problem.frequency[0].omega
        omega = np.linspace(lines.min(), lines.max(), 10)[1:-1]
        start = time.process_time()
        error = rid.worst_case_error(result, omega=omega)
        seconds = (time.process_time() - start) / omega.size
        gap = float(np.max(1 - error.lower / error.upper))
        print(
            f"{name}: n = {result.problem.coefficients}, {seconds:.3f} s a frequency, gap at most {100 * gap:.2g} %",
            flush=True,
        )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--entries", action="store_true", help="seconds a frequency of one entry")
    arguments = parser.parse_args()
    if arguments.entries:
        entries()
        return
    stated = problem()
    result = rid.identify(stated)
    omega = np.linspace(0, np.pi / stated.dt, 102)[1:-1]
    start = time.perf_counter()
    error = rid.worst_case_error(result, omega=omega, directions=16, executor=arguments.workers)
    seconds = time.perf_counter() - start
    start = time.perf_counter()
    certified = error.certified
    checked = time.perf_counter() - start
    gap = float(np.max(1 - error.lower / error.upper))
    print(
        f"n = {stated.coefficients}, {omega.size} frequencies, 16 directions, {arguments.workers} processes: {seconds:.1f} s"
    )
    print(f"gap at most {100 * gap:.2g} %; 1600 certificates verified in {checked:.1f} s: {certified}")

    consistent = consistent_set(result).with_node(float(omega[20]))
    x, p, _ = consistent.value_weights(float(omega[20]))
    functional = Functional(np.real(x), np.real(p))
    start = time.perf_counter()
    found = consistent.extreme(functional, 1e-4)
    ours = time.perf_counter() - start
    value, theirs = clarabel(consistent, functional)
    print(f"one direction to 1e-4: ours {ours:.3f} s, Clarabel {theirs:.2f} s, ratio {theirs / ours:.0f};", end=" ")
    print(f"values {found.attained:.6f} to {found.upper:.6f}, Clarabel {value:.6f}")


if __name__ == "__main__":
    main()
