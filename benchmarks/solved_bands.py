"""Bands with polygons: between solved frequencies beside polygons that are solved there, and truths at the edge between them.

Run: OPENBLAS_NUM_THREADS=1 python benchmarks/solved_bands.py chords [SEED ...] | edges 1000 | box [60 motor beam] | programs
All seconds are of the processor, of one process.
"""

import argparse
import dataclasses
import json
import pathlib
import time

import numpy as np
from band_problems import FIRST, beam_halves, class_of, motor_halves, one_entry, random_problem

import robustid as rid
from robustid.core import Budget
from robustid.guarantees.common_nominal import smallest_disc
from support.edge_bands import KINDS, MATRICES, edge_plant
from support.edge_truths import edge_truths

TRUTHS = 8  # plants that keep the same bounds
POINTS = 10_000  # values at which every plant is judged, besides those close to solved frequencies
MANY = ("record of two inputs", *MATRICES, "two ports")
ONE = (*(kind for kind in KINDS if kind not in MANY), "one port")
ORDER = ONE + ONE + MANY


def clocked(work, *arguments, **options):
    """What it returns, and processor seconds."""
    start = time.process_time()
    return work(*arguments, **options), time.process_time() - start


def chords(arguments):
    """Radii between solved frequencies over those of polygons there; so the errors about the identified model."""
    print(
        f"{'seed':>4}{'solved':>8}{'s':>7}{'samples alone':>15}{'with solved':>13}{'largest':>9}{'about the model':>17}"
    )
    every = []
    for seed in arguments.seeds:
        result = random_problem(seed)
        if not result.consistent:
            continue
        lines = result.problem.frequency[0].omega
        plain = rid.band(result)
        found, seconds = clocked(plain.refine, result, time_limit=arguments.time_limit)
        if found.polygons is None:
            continue
        rng = np.random.default_rng(seed)
        omega = np.sort(rng.uniform(lines.min(), lines.max(), arguments.count))
        brute = rid.worst_case_error(result, omega=omega)
        least = np.array([smallest_disc(one.vertices).radius for one in brute.values])
        alone, joined = (one.at(omega)[1][:, 0, 0] / least for one in (plain, found))
        about = found.error_at(omega)[:, 0, 0] / brute.upper[:, 0, 0]
        every += joined.tolist()
        print(
            f"{seed:4d}{found.polygons.omega.size:8d}{seconds:7.1f}{np.median(alone):15.3f}{np.median(joined):13.3f}"
            f"{joined.max():9.3f}{np.median(about):17.3f}",
            flush=True,
        )
    print(f"all: median {np.median(every):.3f}, largest {max(every):.3f} of {len(every)}")


def posed(problem):
    """The identification, and the factor of all bounds at which the solver can tell that the edge is inside."""
    result, factor = rid.identify(problem), 1.0
    while not result.consistent and factor < 1.001:
        factor = max(factor, result.margin) * (1 + 1e-6)
        points, records = (
            [one.with_bound(one.bound.inflated(factor)) for one in every] for every in (problem.frequency, problem.time)
        )
        result = rid.identify(dataclasses.replace(problem, frequency=points, time=records or None))
    return result, factor


def judged(kind, seed):
    """Plants at the edge of one class, between three solved frequencies and beside them: what is written of them."""
    start = time.process_time()
    edge, rng = edge_truths(kind, seed, TRUTHS), np.random.default_rng([seed, 5])
    result, factor = posed(edge.problem)
    lines = result.problem.frequency[0].omega
    plain, between = rid.band(result, box=edge.box, knots=150), np.sort(rng.uniform(lines.min(), lines.max(), 3))
    least = {"omega": between, "directions": 6, "rtol": 0.2}
    directed = seed % 2 == 0  # certificates of one direction each; of all directions else
    before = plain.by_directions(Budget()) if seed % 4 == 0 else plain  # from those of the lines on
    if edge.box is not None and directed:  # polygons of sums over cells; of programs else
        found = plain.refine(result, omega=between)
    elif edge.box is not None:
        cells = {"cells": 1, "delay": delay_of(edge)}
        found = before.between(rid.guarantee.worst_case_over_poles(result, *edge.box, **least, **cells), None)
    else:
        found = before.between(rid.worst_case_error(result, **least), Budget() if directed else None)
    low, high = found.range
    count = POINTS // (2 * result.problem.entries.count)
    omega = np.concatenate([rng.uniform(lines.min(), lines.max(), count), rng.uniform(0, edge.top, count)])
    beside = (between[:, None] + np.linspace(-1, 1, 101) * np.ptp(lines) / 40).ravel()
    omega = np.concatenate([omega, beside[beside > 0]])
    omega = omega[(omega >= low) & (omega <= high)]
    centre, radius = found.at(omega)
    values = np.stack([one(omega) for one in edge.truths])
    ratio = np.abs(values - centre) / radius
    return {
        "kind": kind, "seed": seed, "box": edge.box is not None, "directed": directed, "factor": factor,
        "truths": len(edge.truths), "values": ratio.size, "outside": int((~(ratio <= 1)).sum()),
        "outside_truths": int((~(ratio <= 1)).any(axis=tuple(range(1, ratio.ndim))).sum()), "largest": float(ratio.max()),
        "apart": float((np.abs(values - values[0]) / radius).max()),
        "gain": float(np.median(radius / plain.at(omega)[1])), "seconds": time.process_time() - start,
    }  # fmt: skip


def edges(arguments):
    """Plants at the edge of the class: gain exactly K, noise at its ends, poles in corners. What is kept is not done again."""
    kept, every = pathlib.Path(arguments.kept), []
    if kept.exists():
        every = [json.loads(line) for line in kept.read_text().splitlines()]
    there = {(one["kind"], one["seed"]) for one in every}
    for number in range(-(-arguments.count // TRUTHS)):
        turn, place = divmod(number, len(ORDER))
        kind = ORDER[place]
        seed = turn * ORDER.count(kind) + ORDER[:place].count(kind)
        if (kind, seed) in there:
            continue
        one = judged(kind, seed)
        every.append(one)
        with kept.open("a") as file:
            file.write(json.dumps(one) + "\n")
        print(f"{len(every):4d} {one}", flush=True)
    told_edges(every)


def told_edges(every):
    """A line a kind, and of all."""
    print(
        f"{'kind':<21}{'truths':>7}{'box':>5}{'values':>11}{'outside':>8}{'largest':>9}{'apart':>7}"
        f"{'of samples alone':>18}{'CPU s':>7}"
    )
    for kind in (*dict.fromkeys(ORDER), "all"):
        own = [one for one in every if kind in ("all", one["kind"])]
        if own:
            of = {name: np.array([one[name] for one in own]) for name in own[0] if name != "kind"}
            count = of["truths"]
            print(
                f"{kind:<21}{count.sum():7d}{(of['box'] * count).sum():5d}{of['values'].sum():11d}{of['outside'].sum():8d}"
                f"{of['largest'].max():9.5f}{np.median(of['apart']):7.2f}{np.median(of['gain']):18.3f}"
                f"{of['seconds'].sum() / count.sum():7.2f}"
            )
    print(
        f"{sum(one['truths'] for one in every if one['directed'])} with certificates of one direction each, the others with"
        f" those of all; bounds up to {max(one['factor'] for one in every) - 1:.1e} larger, for the solver"
    )


def delay_of(edge):
    """Delay of the pair."""
    from robustid.guarantees.linear.functions import pairs_of

    return max(max(delay for _, delay in pairs_of(edge.problem.parametric).values()), 0)


def of_lines(halves):
    """60 lines, the modes with the box of their poles, a tenth more gain than the class needs."""
    frf = halves[0].select(np.unique(np.linspace(0, halves[0].omega.size - 1, 60).astype(int)))
    problem, box, _ = class_of(frf)
    return problem.with_prior(gain_bound=1.1 * problem.prior.gain_bound), box


BOXES = {
    "60": lambda: one_entry(60, [77.0], [0.017]),
    "motor": lambda: of_lines(motor_halves()),
    "beam": lambda: of_lines(beam_halves(FIRST)),
}


def box(arguments):
    """Polygons over the box of the poles: what they gain, and their time."""
    for name in arguments.cases or BOXES:
        problem, box = BOXES[name]()
        result = rid.identify(problem)
        plain, first = clocked(rid.band, result, box=box)
        try:
            found, seconds = clocked(plain.refine, result, time_limit=arguments.time_limit)
        except rid.InputError as error:
            print(f"{name}: {error}", flush=True)
            continue
        lines = problem.frequency[0].omega
        omega = np.random.default_rng(0).uniform(lines.min(), lines.max(), 400)
        ratio = (found.at(omega)[1] / plain.at(omega)[1]).ravel()
        solved = 0 if found.polygons is None else found.polygons.omega.size
        print(
            f"{name}: sums {first:.1f} s, polygons at {solved} frequencies {seconds:.1f} s; radius between them over that"
            f" of sums: median {np.median(ratio):.3f}, least {ratio.min():.3f}; largest error {plain.sigma_upper.max():.4g},"
            f" then {found.sigma_upper.max():.4g}",
            flush=True,
        )


def programs(arguments):
    """Errors by semidefinite programs over those by sums over cells, of classes whose gain bound is that of a plant."""
    print(f"{'kind':<21}{'problems':>9}{'median':>8}{'least':>8}{'largest':>9}{'CPU s':>7}{'of sums':>9}")
    every = []
    for kind in ("discrete", "continuous", "roll-off", "record", "record of two inputs", *MATRICES):
        own, spent = [], np.zeros(2)
        for plant in (edge_plant(kind, seed) for seed in range(40)):
            if len(own) == arguments.count:
                break
            result = rid.identify(plant.problem)
            if plant.box is None or not result.consistent:
                continue
            lines = plant.problem.frequency[0].omega
            omega = np.sort(np.random.default_rng(0).uniform(lines.min(), lines.max(), 3))
            cells = {"cells": 16, "delay": delay_of(plant)}
            found, seconds = clocked(rid.guarantee.worst_case_over_poles, result, *plant.box, omega=omega, **cells)
            sums, others = clocked(rid.band(result, box=plant.box).refine, result, omega=omega)
            if sums.polygons is None or not np.array_equal(sums.polygons.omega, found.omega):
                continue
            own.append((found.upper / sums.polygons.upper).ravel())
            spent += seconds, others
        every += own
        told_programs(kind, own, spent)
    told_programs("all", every, np.full(2, np.nan))


def told_programs(kind, ratios, spent):
    """A line of ratios, by problem."""
    if ratios:
        of = np.concatenate(ratios)
        print(
            f"{kind:<21}{len(ratios):9d}{np.median(of):8.3f}{of.min():8.3f}{of.max():9.3f}{spent[0]:7.1f}{spent[1]:9.1f}",
            flush=True,
        )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(required=True)
    one = commands.add_parser("chords")
    one.add_argument("seeds", nargs="*", type=int, default=list(range(10)))
    one.add_argument("--count", type=int, default=12, help="frequencies between")
    one.add_argument("--time-limit", type=float, default=None)
    one.set_defaults(work=chords)
    one = commands.add_parser("edges")
    one.add_argument("count", type=int, nargs="?", default=1000)
    one.add_argument("--kept", default="edges.jsonl", help="file of the truths that are done")
    one.set_defaults(work=edges)
    one = commands.add_parser("box")
    one.add_argument("cases", nargs="*", help=", ".join(BOXES))
    one.add_argument("--time-limit", type=float, default=60.0)
    one.set_defaults(work=box)
    one = commands.add_parser("programs")
    one.add_argument("--count", type=int, default=4, help="problems a kind")
    one.set_defaults(work=programs)
    arguments = parser.parse_args()
    arguments.work(arguments)


if __name__ == "__main__":
    main()
