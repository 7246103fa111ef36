"""Bands with polygons: between solved frequencies beside polygons that are solved there, and truths at the edge between them.

Run: OPENBLAS_NUM_THREADS=1 python benchmarks/solved_bands.py chords [SEED ...] | edges 1000 | box [60 motor beam]
All seconds are of the processor, of one process.
"""

import argparse
import time

import numpy as np
from band_problems import FIRST, beam_halves, class_of, motor_halves, one_entry, random_problem

import robustid as rid
from robustid.guarantees.common_nominal import smallest_disc
from support.edge_bands import KINDS, edge_plant


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


def edges(arguments):
    """Plants at the edge of the class between a few solved frequencies: gain exactly K, noise at its ends, poles in corners."""
    outside, values, gains, skipped, largest, boxes = 0, 0, [], 0, 0.0, 0
    kinds = [kind for kind in KINDS if kind != "matrix"]
    seed = arguments.first
    while len(gains) < arguments.count:
        kind, own = kinds[seed % len(kinds)], seed // len(kinds)
        seed += 1
        plant = edge_plant(kind, own)
        rng = np.random.default_rng(seed)
        result = rid.identify(plant.problem)
        if not result.consistent:  # the statement has the poles in the middle
            skipped += 1
            continue
        lines = plant.problem.frequency[0].omega
        plain = rid.band(result, box=plant.box, knots=150)
        try:
            if plant.box is None:
                polygons = rid.worst_case_error(
                    result, omega=np.sort(rng.uniform(lines.min(), lines.max(), 3)), directions=6, rtol=0.2
                )
            else:
                polygons = rid.guarantee.worst_case_over_poles(
                    result, *plant.box, omega=np.sort(rng.uniform(lines.min(), lines.max(), 3)), directions=6, rtol=0.2,
                    cells=1, delay=delay_of(plant),
                )  # fmt: skip
        except rid.InputError:
            skipped += 1
            continue
        found = plain.with_polygons(polygons)
        beside = (polygons.omega[:, None] + np.linspace(-1, 1, 21) * np.ptp(lines) / 40).ravel()
        omega = np.concatenate([plant.frequencies(rng, 60), rng.uniform(lines.min(), lines.max(), 60), beside])
        omega = omega[(omega >= found.range[0]) & (omega <= found.range[1])]
        centre, radius = found.at(omega)
        ratio = np.abs(plant.truth(omega) - centre) / radius
        outside, values, largest = (
            outside + int((ratio > 1).sum()),
            values + ratio.size,
            max(largest, float(ratio.max())),
        )
        gains.append(float(np.median(radius / plain.at(omega)[1])))
        boxes += plant.box is not None
        if ratio.max() > 1:
            print(f"seed {seed - 1}, {kind}: ratio {ratio.max():.6f}", flush=True)
    print(
        f"{len(gains)} truths at the edge ({boxes} over a box; {skipped} passed over), {values} values: {outside} outside,"
        f" largest error/radius {largest:.4f}; radius over that of samples alone, median {np.median(gains):.3f}"
    )


def delay_of(plant):
    """Delay of the pair."""
    from robustid.guarantees.linear.functions import pairs_of

    return max(max(delay for _, delay in pairs_of(plant.problem.parametric).values()), 0)


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
    one.add_argument("--first", type=int, default=0, help="seed")
    one.set_defaults(work=edges)
    one = commands.add_parser("box")
    one.add_argument("cases", nargs="*", help=", ".join(BOXES))
    one.add_argument("--time-limit", type=float, default=60.0)
    one.set_defaults(work=box)
    arguments = parser.parse_args()
    arguments.work(arguments)


if __name__ == "__main__":
    main()
