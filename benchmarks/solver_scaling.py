"""The margin problem at every size: our structured solver against general semidefinite solvers, seconds and memory.

Run: OPENBLAS_NUM_THREADS=2 python benchmarks/solver_scaling.py [--full] [--plot FILE]. Every figure is of a process of its own.
Peers, where cvxpy finds them (Clarabel always; SCS, CVXOPT, SDPA): one block [I X; X' I] of size 2n with X the triangular Toeplitz
matrix of n Taylor coefficients, and the same samples. Ratios of one run are what to quote; "wrong": off by more than 0.1 %.
--full adds sizes at which peers take minutes, and 10^5 lines.
"""

import argparse
import json
import math
import pathlib
import resource
import subprocess
import sys
import time

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).parent.parent / "tests"))

PEERS = ("CLARABEL", "SCS", "CVXOPT", "SDPA")
# Above, a peer would take more than about ten minutes (left: as quick runs go).
LARGEST = {"CLARABEL": (60, 80), "SCS": (60, 80), "CVXOPT": (100, 160), "SDPA": (100, 200)}
ACCURACY = 1e-4
FORMS = ("taylor", "sections")


def measurements(length, lines, samples, kautz=False, seed=0):
    """A simulated problem that takes `length` Taylor coefficients at the default accuracy."""
    import robustid as rid

    rng, dt, bound = np.random.default_rng(seed), 0.01, 0.05
    omega = np.sort(rng.uniform(0.2, 3.1 / dt, lines))
    g = 0.02 * rng.standard_normal(200) * 1.03 ** -np.arange(200.0)
    impulse = np.zeros(max(samples, 200))
    impulse[:200] = g
    values = np.polynomial.polynomial.polyval(np.exp(-1j * omega * dt), g)
    basis = rid.kautz(2 * np.pi * 10.0, 0.01, dt=dt) if kautz else None
    if basis is not None:
        values = values + basis.response(omega * dt) @ [1.0, 0.5]
        impulse = impulse + basis.impulse(impulse.size) @ [1.0, 0.5]
    values = values + 1.5 * bound * np.sqrt(rng.random(lines)) * np.exp(2j * np.pi * rng.random(lines))
    data = {"frequency": rid.FrequencyResponse(omega, values, dt=dt, bound=bound), "parametric": basis}
    if samples:
        u = rng.standard_normal(samples)
        y = np.convolve(u, impulse[:samples])[:samples] + 1.5 * bound * rng.uniform(-1, 1, samples)
        data["time"] = rid.TimeRecord(u, y, dt=dt, bound=bound)

    return of_length(length, data)


def of_length(length, data):
    """The problem of these data whose decay rate takes `length` Taylor coefficients."""
    import robustid as rid
    from robustid.identification.formulation.taylor import taylor_length

    def problem(log_rate):
        return rid.MixedProblem(prior=rid.Prior(gain_bound=1.0, decay_rate=1 + math.exp(log_rate)), **data)

    slow, fast = -8.0, 5.0
    for _ in range(40):
        middle = (slow + fast) / 2
        slow, fast = (middle, fast) if taylor_length(problem(middle), ACCURACY) > length else (slow, middle)
    return problem(fast)


def ours(length, lines, samples, what):
    """Margin (or all of identify) by the structured solver: (value, Newton systems)."""
    import robustid as rid
    from robustid.core.threads import threads_for
    from robustid.identification.formulation import TaylorFormulation
    from robustid.identification.margin import prove_margin
    from robustid.identification.solver import newton

    problem, systems = measurements(length, lines, samples, kautz=what == "identify"), counted(newton)
    start = time.perf_counter()
    if what == "identify":
        result = rid.identify(problem, form="taylor")
        value = result.require().margin if result.consistent else result.margin
    else:
        with threads_for(length):
            value = prove_margin(TaylorFormulation(problem, length).data, "structured", ACCURACY)[0].margin
    return value, time.perf_counter() - start, len(systems)


def counted(newton):
    """A list that grows by one with every Newton system."""
    systems, factorise = [], newton.State.factorise
    newton.State.factorise = lambda state: (systems.append(1), factorise(state))[1]
    return systems


def banded(rho, lines, form):
    """All of identify(): (coefficients, margin, width), seconds, Newton systems."""
    import robustid as rid
    from robustid.identification.solver import newton
    from support.sections_of_lines import oversampled

    problem, systems = oversampled(lines, rho, top=0.05, noise=1.5), counted(newton)
    start = time.perf_counter()
    result = rid.identify(problem, form=form)
    seconds = time.perf_counter() - start
    if not result.verification.passed:
        raise RuntimeError(result.summary())
    return (result.formulation.count, result.margin, result.margin - result.margin_lower), seconds, len(systems)


def theirs(length, lines, samples, solver):
    """Margin from the semidefinite program that one would write down."""
    import cvxpy as cp
    import scipy.linalg

    from robustid.identification.formulation import TaylorFormulation

    rows = TaylorFormulation(measurements(length, lines, samples), length).data.rows
    E, y = rows.real(rows.E.dense()), rows.real(rows.y)
    x, s = cp.Variable(length), cp.Variable()
    basis = np.stack([scipy.linalg.toeplitz(row, np.zeros(length)) for row in np.eye(length)])
    X = cp.reshape(basis.reshape(length, -1).T @ x, (length, length), order="C")
    e, one = y - E @ x, np.eye(length)
    cone = cp.SOC(s * np.ones(lines), cp.vstack([e[:lines], e[lines + samples :]]), axis=0)
    limits = [cp.bmat([[one, X], [X.T, one]]) >> 0, cone, cp.abs(e[lines : lines + samples]) <= s]
    program = cp.Problem(cp.Minimize(s), limits if samples else limits[:2])
    start = time.perf_counter()
    program.solve(solver=solver)
    return float(s.value), time.perf_counter() - start, 0


def one(arguments):
    """In a process of its own: value, seconds, gigabytes, Newton systems as a line of JSON."""
    length, lines, samples, name = arguments
    work = theirs if name in PEERS else ours
    if name in FORMS:
        banded(1.3, 60, name)
        value, seconds, systems = banded(float(length), int(lines), name)
    else:
        work(8, 12, 0, name)  # imports and first calls
        value, seconds, systems = work(int(length), int(lines), int(samples), name)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    sys.stdout.write(json.dumps([value, seconds, memory, systems]) + "\n")


def run(length, lines, samples, name):
    """The numbers of `one`; None where the peer fails."""
    command = [sys.executable, __file__, "--one", *map(str, (length, lines, samples, name))]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return json.loads(done.stdout.splitlines()[-1]) if done.returncode == 0 else None


def exponent(sizes, seconds):
    """Slope of log(seconds) against log(size)."""
    return float(np.polyfit(np.log(sizes), np.log(seconds), 1)[0])


def against_peers(full):
    """Table with one row per size; returns name -> [(n, seconds)]."""
    from robustid.identification.solver.cvxpy_backend import available_solvers

    names = [name for name in PEERS if name in available_solvers()]
    print("margin of n Taylor coefficients, n lines and n/2 time samples; ratios to ours")
    print(f"{'n':>5}{'ours s':>9}{'GB':>6}{'systems':>9}" + "".join(f"{name:>12}" for name in names) + "  difference")
    times = {name: [] for name in ("ours", *names)}
    for n in (20, 40, 60, 80, 100, 160, 200) if full else (20, 40, 60):
        value, seconds, memory, systems = run(n, n, n // 2, "margin")
        times["ours"].append((n, seconds))
        cells, worst = "", 0.0
        for name in names:
            found = run(n, n, n // 2, name) if n <= LARGEST[name][full] else None
            if not found:
                cells += f"{'-':>12}"
            elif abs(found[0] - value) > 1e-3 * max(1, value):
                cells += f"{'wrong':>12}"
            else:
                cells += f"{found[1] / seconds:12.1f}"
                times[name].append((n, found[1]))
                worst = max(worst, abs(found[0] - value) / max(1, value))
        print(f"{n:5d}{seconds:9.3f}{memory:6.2f}{systems:9d}{cells}{worst:12.0e}", flush=True)
    return times


def growth(full):
    """Our times against the number of coefficients and of lines."""
    lengths = (125, 250, 500, 1000, 1500) if full else (125, 250, 500)
    rows = [(n, 1000, *run(n, 1000, 200, "margin")) for n in lengths]
    counts = (1000, 10_000, 100_000) if full else (1000, 10_000)
    rows += [(300, N, *run(300, N, 200, "margin")) for N in counts]
    print("\nours: margin with 200 time samples")
    print(f"{'L':>5}{'lines':>8}{'s':>9}{'GB':>6}{'systems':>9}")
    for n, lines, _, seconds, memory, systems in rows:
        print(f"{n:5d}{lines:8d}{seconds:9.2f}{memory:6.2f}{systems:9d}", flush=True)
    cut = len(lengths)
    print(f"seconds grow as L^{exponent(lengths, [row[3] for row in rows[:cut]]):.2f}", end="")
    print(f" and as N^{exponent(counts, [row[3] for row in rows[cut:]]):.2f}")
    return rows[:cut]


def large(full):
    """All of identify(), with proof, centre, model and verification."""
    print("\nidentify(), one Kautz pair: margin, centre, model, verification")
    print(f"{'L':>5}{'lines':>8}{'samples':>9}{'s':>9}{'GB':>6}{'systems':>9}{'margin':>9}")
    for n, lines, samples in ((600, 1000, 200), (1000, 100_000, 1000))[: 1 + full]:
        value, seconds, memory, systems = run(n, lines, samples, "identify")
        print(f"{n:5d}{lines:8d}{samples:9d}{seconds:9.1f}{memory:6.2f}{systems:9d}{value:9.4f}", flush=True)


def bands(full):
    """Lines up to 5 % of the sampling rate: Taylor coefficients against a repeated section."""
    print("\nidentify(), lines up to 5 % of the sampling rate: Taylor coefficients, and a repeated section")
    print(
        f"{'rho':>7}{'lines':>7}{'L':>6}{'s':>8}{'width':>9}{'n':>6}{'s':>8}{'GB':>6}{'width':>9}{'L/n':>6}{'ratio s':>9}"
    )
    cases = [(1.05, 1000), (1.02, 1000), (1.005, 1000), (1.005, 10_000), (1.003, 1000)]
    for rho, lines in cases if full else cases[:2]:
        (n, margin, width), seconds, memory, _ = run(rho, lines, 0, "sections")
        other = run(rho, lines, 0, "taylor")
        if other:
            (L, wide, slack), slow, _, _ = other
            if max(margin - width, wide - slack) > min(margin, wide):
                raise RuntimeError(f"the proven intervals contradict each other at rho = {rho}")
            left, ratio = f"{L:6d}{slow:8.1f}{slack:9.0e}", f"{L / n:6.1f}{slow / seconds:9.1f}"
        else:
            left, ratio = f"{'refused':>23}", ""
        print(f"{rho:7g}{lines:7d}{left}{n:6d}{seconds:8.1f}{memory:6.2f}{width:9.0e}{ratio}", flush=True)


def draw(path, times, rows):
    """Seconds against the number of coefficients, all solvers."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 5), layout="constrained")
    ax = figure.subplots()
    for name, pairs in times.items():
        if pairs:
            ax.loglog(*zip(*pairs, strict=True), "o-", label="robustid" if name == "ours" else name)
    ax.loglog([r[0] for r in rows], [r[3] for r in rows], "o--", color="C0", label="robustid, 1000 lines")
    ax.set(xlabel="Taylor coefficients", ylabel="seconds", title="Smallest margin, by solver")
    ax.grid(which="both", color="0.9")
    ax.legend()
    figure.savefig(path, dpi=120)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--full", action="store_true")
    parser.add_argument("--plot", type=pathlib.Path)
    parser.add_argument("--one", nargs=4, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.one:
        one(arguments.one)
        return
    times = against_peers(arguments.full)
    rows = growth(arguments.full)
    large(arguments.full)
    bands(arguments.full)
    if arguments.plot:
        draw(arguments.plot, times, rows)


if __name__ == "__main__":
    main()
