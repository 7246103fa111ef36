"""The exact margin problem: our solver against general semidefinite solvers, and the rest of the pipeline beside them.

Run: python benchmarks/margin_solvers.py [--largest 40] [--seeds 3]. All figures of one row come from one process; ratios are
what to quote. Peers: Clarabel (on the paper's 2n x 2n inequality in orthonormal coordinates, and on the two n x n blocks that
the symmetric form allows), CVXOPT where it is installed.
"""

import argparse
import pathlib
import sys
import time

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).parent.parent / "tests"))
import robustid as rid
from robustid.identification.formulation import ExactFormulation
from robustid.identification.solver.cvxpy_backend import available_solvers
from support.problems import random_problem


def full_lmi(problem):
    """The margin from [I X; X' I] >= 0, one block of size 2n, through cvxpy and Clarabel."""
    import cvxpy as cp

    data = ExactFormulation(problem).data
    rows, Q = data.rows, data.rows.real(data.orthonormal[0])
    y, E = rows.real(rows.y), rows.real(rows.E.dense())
    n, samples, discs = data.sarason.pair.order, rows.y.size, rows.discs
    x, q, s = cp.Variable(n), cp.Variable(Q.shape[1]), cp.Variable()
    e = y - E @ x - (Q @ q if Q.shape[1] else 0)
    X = cp.reshape(data.sarason.basis.reshape(n, -1).T @ x, (n, n), order="C")
    limits = [cp.bmat([[np.eye(n), X], [X.T, np.eye(n)]]) >> 0]
    if discs:
        limits.append(cp.SOC(s * np.ones(discs), cp.vstack([e[:discs], e[samples:]]), axis=0))
    if samples > discs:
        limits.append(cp.abs(e[discs:samples]) <= s)
    cp.Problem(cp.Minimize(s), limits).solve(solver="CLARABEL", accept_unknown=True)
    return float(s.value)


def clock(work):
    start = time.perf_counter()
    return work(), time.perf_counter() - start


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--largest", type=int, default=40)
    parser.add_argument("--seeds", type=int, default=3)
    arguments = parser.parse_args(argv)
    rid.identify(random_problem(0, "mixed", 8), solver="cvxpy")  # imports and first calls
    peers = [name for name in ("CLARABEL", "CVXOPT") if name in available_solvers()]
    heads = ["path s", "rest s", *[f"{p.lower()} / path" for p in peers], "2n LMI / path", "largest difference"]
    print(f"{'n':>4}" + "".join(f"{head:>20}" for head in heads))
    for n in [n for n in (20, 40, 60, 80, 100, 160, 200) if n <= arguments.largest]:
        path, rest, difference = [], [], 0.0
        others = {name: [] for name in [*peers, "2n"]}
        for seed in range(arguments.seeds):
            problem = random_problem(200 + seed, "parametric", n, spread=0.2, noise=3.0)
            ours, seconds = clock(
                lambda problem=problem: rid.identify(problem, solver="structured", form="orthonormal")
            )
            path.append(ours.timing["margin"])
            rest.append(seconds - ours.timing["margin"])
            if n > 60:
                continue
            for name in peers:
                other = rid.identify(problem, solver=name, form="orthonormal")
                others[name].append(other.timing["margin"] / path[-1])
                difference = max(difference, abs(other.margin - ours.margin) / max(1, ours.margin))
            value, seconds = clock(lambda problem=problem: full_lmi(problem))
            others["2n"].append(seconds / path[-1])
            difference = max(difference, abs(value - ours.margin) / max(1, ours.margin))
        row = [f"{np.median(path):.3f}", f"{np.median(rest):.3f}"]
        row += [f"{np.median(ratios):.1f}" if ratios else "-" for ratios in others.values()]
        row += [f"{difference:.1e}" if n <= 60 else "-"]
        print(f"{n:4d}" + "".join(f"{cell:>20}" for cell in row), flush=True)


if __name__ == "__main__":
    main()
