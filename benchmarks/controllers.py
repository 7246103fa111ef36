"""Controllers for every consistent plant: against weights and nominal models, on withheld records, on consistent plants; time.

Run: OPENBLAS_NUM_THREADS=1 ROBUSTID_DATA=... python benchmarks/controllers.py weight | sets | nominal | withheld | members | time
A line is printed as it is done; all seconds are of the processor, of one process. `nominal` and `members` take a number of random
problems, `members --all` fifty; `members --refined` takes bands with polygons.
"""

import argparse
import dataclasses
import logging
import time
from itertools import islice

import control
import numpy as np
from control_problems import TWO_PI, beams, lags, mirrors, motor_benches, of_nominal, of_weight, with_arcs, with_corners

import robustid as rid
from robustid.controllers.plants import Plants
from robustid.design import PID, Limits, LowPass, Notch
from robustid.guarantees import loop_bounds
from support.design_cases import STRUCTURES, band_of, sizes_of, values_of
from support.loop_candidates import consistent_members, is_stable

PEAK = 2.0
LIMITS = Limits(sensitivity_peak=PEAK)
ORDERS = (2, 4, None)  # of weights, at most; None: the smallest that follows the bound
MEMBERS = 20  # consistent plants of a problem
VALUES, FREQUENCIES, AT_ONCE = 10_000, 10_000, 100
ROUNDING = 1e-9
SOLVED, REFINED = 14, 1200.0  # frequencies of polygons, and seconds at most: all of them, on a busy machine too
MIRRORS = [(volts, entry) for volts in (0.3, 0.2) for entry in range(3)]


def designed(band, structure, goal="bandwidth"):
    return rid.design_controller(band, structure, limits=LIMITS, maximise=goal)


def told(design):
    return design.goal.told(design.level) if design.controller is not None else "none"


def clock(start):
    print(f"{(time.process_time() - start) / 60:.1f} minutes of processor time")


# ------------------------------------------------------------------------------------------------------------------ weight


def weight(arguments):
    """The level of the goal within the band over that within a weight above it, about the same model."""
    start, ratios = time.process_time(), {order: [] for order in ORDERS}
    print(
        "level that is proved with |S| <= 2: in the discs of the band, within weights W about the same model (ours/weight)"
    )
    for make in (motor_benches, beams, mirrors):
        for machine in make():
            wide = {order: of_weight(machine.band, order) for order in ORDERS}
            excess = [np.median(one.circle.bound / np.repeat(machine.band.circle.bound, 4)) for one, _ in wide.values()]
            orders = ", ".join(f"{w.order} ({part:.2f})" for (_, w), part in zip(wide.values(), excess, strict=True))
            print(f"{machine.name}: orders of W (|W|/bound in the median): {orders}")
            for name, (structure, goal) in machine.structures.items():
                ours, cells = designed(machine.band, structure, goal), []
                for order in ORDERS:
                    theirs = designed(wide[order][0], structure, goal)
                    ratio = ours.level / theirs.level if theirs.level else np.inf
                    ratios[order].append(ratio)
                    cells.append(f"{told(theirs):>12s} ({ratio:.3f}, {theirs.status.name.lower()})")
                print(f"    {name:26s} {told(ours):>12s} {ours.status.name.lower()} | {'  '.join(cells)}", flush=True)
    for order in ORDERS:
        found = np.array(ratios[order])
        words = "the smallest that follows the bound" if order is None else f"at most {order}"
        print(
            f"W of order {words}: median {np.median(found):.3f}, {found.min():.3f} to {found.max():.3f} ({found.size} designs)"
        )
    clock(start)


# -------------------------------------------------------------------------------------------------------------------- sets


def sets(arguments):
    """The level of the goal with the same proved peak, for sets that are ever narrower: weights, discs, polygons."""
    start, ratios, wide = time.process_time(), {"discs": [], "polygons": []}, []
    print(
        "level that is proved with |S| <= 2: within the smallest weight that follows the bound, in discs about the model, about\n"
        "the centres of the band, in polygons (each over that of the weight); polygons: half of their widths over radii of discs"
    )
    for make in (lags, lambda: islice(motor_benches(), 1), mirrors, beams):
        for machine in make():
            began = time.process_time()
            band = machine.band
            fine = band.refine(
                machine.result, omega=TWO_PI * np.geomspace(*machine.refined, SOLVED), time_limit=REFINED
            )
            bands = [of_weight(band)[0], with_arcs(band, band.circle.edges, band.circle.bound), band, fine]
            print(f"{machine.name}: {narrowness(fine)}; {time.process_time() - began:.0f} s", flush=True)
            for name, (structure, goal) in machine.structures.items():
                found = [designed(one, structure, goal) for one in bands]
                over = [one.level / found[0].level if found[0].level else np.inf for one in found[1:]]
                ratios["discs"].append(over[1])
                ratios["polygons"].append(over[2])
                wide.append(found[3].level / found[2].level)
                cells = [f"{told(one):>12s} ({part:.3f})" for one, part in zip(found[1:], over, strict=True)]
                proved = " ".join(sorted({one.status.name.lower() for one in found}))
                print(f"    {name:26s} {told(found[0]):>12s} | {'  '.join(cells)}  {proved}", flush=True)
    for name, found in ratios.items():
        print(
            f"{name} over weights: median {np.median(found):.3f}, {min(found):.3f} to {max(found):.3f} ({len(found)} designs)"
        )
    print(
        f"polygons over discs about the same centres: median {np.median(wide):.3f}, {min(wide):.3f} to {max(wide):.3f}"
    )
    clock(start)


def narrowness(band):
    """The narrow and the wide half of the sets on the arcs of solved frequencies, over the radii of discs of the samples alone."""
    omega = band.polygons.omega
    corners = band.circle.sets_at(omega).corners
    if not corners.shape[1]:
        return "no polygons that are smaller than the discs"
    turned = np.real(corners[:, None] * np.exp(-1j * np.linspace(0, np.pi, 16, endpoint=False))[:, None])
    widths = np.ptp(turned, axis=2) / 2
    _, radius = dataclasses.replace(band, polygons=None, directed=()).at(omega)
    parts = [np.median(size / radius[:, 0, 0]) for size in (widths.min(axis=1), widths.max(axis=1))]
    return f"polygons at {omega.size} frequencies, {parts[0]:.2f} times {parts[1]:.2f} of the discs in the median"


# ----------------------------------------------------------------------------------------------------------------- nominal


def judged_by(frf, controller, peak=PEAK):
    """Lines at which |S| with a response exceeds a peak: by its values, by every value within its bounds."""
    C = values_of(controller, frf.omega)
    X, size = np.abs(1 + frf.values[:, 0, 0] * C), frf.bound.outer_radius[:, 0, 0] * np.abs(C)
    limit = 1 / peak
    return limit > X, limit > X + size


def judged_on(plants, controller, peak=PEAK):
    """Of plants how many are not stabilised, and how many others exceed a peak of S; the largest peak of these."""
    omega = np.linspace(0.0, np.pi / controller.dt, 4001)[1:]
    C, unstable, largest = values_of(controller, omega), 0, [0.0]
    for plant in plants:
        if is_stable(plant, controller):
            largest.append(float(np.abs(1 / (1 + values_of(plant, omega) * C)).max()))
        else:
            unstable += 1
    return unstable, int(np.sum(np.array(largest) > peak * (1 + ROUNDING))), max(largest)


def near_limits(design):
    """Frequencies at which plants are tried: those of the limits."""
    return [omega for _, omega in design.shares.values() if np.isfinite(omega) and omega > 0]


def nominal(arguments):
    """Designs on the model alone for the same limits, on withheld records and consistent plants."""
    start, total = time.process_time(), np.zeros(5, int)
    print(
        "designs for the model alone: level over ours; withheld lines above the peak by values (for sure, in all bounds);\n"
        f"of {MEMBERS} consistent plants: not stable, above the peak, largest peak; for the design on the model and for ours"
    )
    for make in (motor_benches, beams, mirrors):
        for machine in make():
            alone = of_nominal(machine.band)
            for name, (structure, goal) in machine.structures.items():
                ours, theirs = (designed(one, structure, goal) for one in (machine.band, alone))
                near = near_limits(theirs) + near_limits(ours)
                plants = consistent_members(rid.identify(machine.band.problem), MEMBERS, np.random.default_rng(0), near)
                record = machine.withheld[next(iter(machine.withheld))]
                cells = []
                for design in (theirs, ours):
                    above, surely = judged_by(record, design.controller)
                    unstable, over, largest = judged_on(plants, design.controller)
                    cells.append(
                        f"{above.sum():4d} ({surely.sum()}) of {above.size}  {unstable:2d} {over:2d} {largest:6.2f}"
                    )
                    if design is theirs:
                        total += [1, above.any(), surely.any(), unstable > 0, unstable + over > 0]
                print(
                    f"{machine.name:26s} {name:26s} {theirs.level / ours.level:6.2f} | {' | '.join(cells)}", flush=True
                )
    count, *others = total
    print(
        f"measured: {count} designs on a model; above the peak on the withheld record {others[0]}, for sure {others[1]}; with a"
        f" consistent plant not stable {others[2]}, or above the peak {others[3]}"
    )
    random_problems(arguments.count)
    clock(start)


def random_problems(count):
    """The same on random problems, with their true plants."""
    rows = []
    for seed in range(count):
        plant, band = band_of(seed)
        structure = STRUCTURES[seed % len(STRUCTURES)]
        ours, theirs = (designed(one, structure) for one in (band, of_nominal(band)))
        near = near_limits(theirs) + near_limits(ours)
        plants = consistent_members(rid.identify(band.problem), MEMBERS, np.random.default_rng(seed), near)
        row = [theirs.level / ours.level]
        for design in (theirs, ours):
            unstable, over, _ = judged_on(plants, design.controller)
            true_unstable, true_over, _ = judged_on([plant], design.controller)
            row += [true_unstable + true_over, unstable > 0, unstable + over > 0]
        rows.append(row)
    ratio, *columns = np.array(rows, float).T
    for name, (true, unstable, any_) in (("on the model", columns[:3]), ("ours", columns[3:])):
        print(
            f"random: {count} designs {name}: the true plant above the peak or not stable {true.sum():.0f}; a consistent plant not"
            f" stable {unstable.sum():.0f}, or above the peak {any_.sum():.0f}"
        )
    print(
        f"random: level on the model over ours: median {np.median(ratio):.2f}, {ratio.min():.2f} to {ratio.max():.2f}"
    )


# ---------------------------------------------------------------------------------------------------------------- withheld


def withheld(arguments):
    """The peak of S that is proved, with responses of withheld records: at all lines, and the discs of S line by line."""
    start = time.process_time()
    counts = {"kept surely": 0, "kept by the value": 0, "above by the value": 0, "above surely": 0, "outside": 0}
    lines, records, clean = 0, 0, 0
    print(
        "lines of withheld records: |S| within the proved peak with every value of their own bounds (surely), by their value\n"
        "alone; above it by their value, with every value; outside: the response more than its own bound beside the proved disc"
    )
    for make in (motor_benches, lambda: mirrors(MIRRORS)):
        for machine in make():
            for name, (structure, goal) in machine.structures.items():
                design = designed(machine.band, structure, goal)
                if not design.proofs:
                    print(f"{machine.name:26s} {name:26s} {design.status.value}", flush=True)
                    continue
                proof, C_of = design.proofs[0], design.controller
                peak = proof.peaks["sensitivity"].value
                for label, frf in machine.withheld.items():
                    C = values_of(C_of, frf.omega)
                    F, own = frf.values[:, 0, 0], frf.bound.outer_radius[:, 0, 0]
                    X, size = np.abs(1 + F * C), own * np.abs(C)
                    above, surely = judged_by(frf, C_of, peak)
                    centre, radius = proof.plant_at(frf.omega)
                    outside = np.abs(F - centre[:, 0, 0]) > own + radius
                    kept = X - size >= 1 / peak
                    row = [kept, ~kept & ~above, above & ~surely, surely, outside]
                    for key, one in zip(counts, row, strict=True):
                        counts[key] += int(one.sum())
                    lines, records = lines + frf.omega.size, records + 1
                    clean += not surely.any() and not outside.any()
                    said = ", ".join(f"{key} {one.mean():.2%}" for key, one in zip(counts, row, strict=True))
                    chance = frf.bound.probability
                    print(
                        f"{machine.name:26s} {name:26s} {label:14s} peak {peak:.3f}, largest |S| {1 / X.min():.3f}: {said}"
                        f" ({frf.omega.size} lines, bounds of {chance if chance else 1:.0%})",
                        flush=True,
                    )
    said = ", ".join(f"{key} {count / lines:.3%} ({count})" for key, count in counts.items())
    print(f"{lines} lines, {records} designs and records: {said}")
    print(f"without a line above surely, or outside: {clean} of {records}")
    clock(start)


# ----------------------------------------------------------------------------------------------------------------- members


def edges_of(band, omega):
    """A source of values of the polygons at frequencies, (AT_ONCE, F): on their borders, those within the discs too."""
    known, model = band.circle.sets_at(omega), band.problem.plane.values_at(band.model, omega)[:, 0, 0]
    rows, middle = np.arange(omega.size), known.corners.mean(axis=1)
    count = known.corners.shape[1]

    def drawn(rng):
        first, part = rng.integers(0, count, (AT_ONCE, omega.size)), rng.random((AT_ONCE, omega.size))
        E = known.corners[rows, first] * part + known.corners[rows, (first + 1) % count] * (1 - part)
        inside = (np.abs(E) <= known.bound[:, 0, 0]) & (np.abs(E - known.centre[:, 0, 0]) <= known.radius[:, 0, 0])
        return model + np.where(inside, E, middle)

    return drawn


def members(arguments):
    """Contradictions of what is proved: by values of the discs, and by systems that the data allow."""
    start, wrong, tried = time.process_time(), 0, 0
    for seed in range(arguments.count):
        began = time.process_time()
        _, band = band_of(seed)
        if arguments.refined:
            band = band.refine(omega=np.geomspace(1.0, 300.0, SOLVED))
        design = designed(band, STRUCTURES[seed % len(STRUCTURES)])
        (proof,) = design.proofs
        omega = np.linspace(0.0, np.pi / band.problem.dt, FREQUENCIES + 1)[1:]
        C, low = values_of(design.controller, omega), omega <= design.level
        centre, radius = proof.plant_at(omega)
        edge = edges_of(band, omega) if arguments.refined else None
        rng, reached = np.random.default_rng(seed), dict.fromkeys(proof.peaks, 0.0)
        least, values = np.inf, 0
        for _ in range(VALUES // AT_ONCE):
            F = centre[:, 0, 0] + radius * np.exp(2j * np.pi * rng.random((AT_ONCE, omega.size)))
            if edge is not None:
                F = edge(rng)
            for name, size in sizes_of(F, C).items():
                reached[name] = max(reached[name], float(size.max()) / proof.peaks[name].value)
            least = min(least, float(np.abs(F * C)[:, low].min()))
            values += F.size
        systems = consistent_members(rid.identify(band.problem), MEMBERS, rng, near_limits(design))
        far, unstable = 0.0, 0
        for one in systems:
            unstable += not is_stable(one, design.controller)
            F = values_of(one, omega)
            far = max(far, *(float(size.max()) / proof.peaks[name].value for name, size in sizes_of(F, C).items()))
            least_here = float(np.abs(F * C)[low].min())
            wrong += least_here < 1 - ROUNDING or far > 1 + ROUNDING or not is_stable(one, design.controller)
        contradicted = sum(part > 1 + ROUNDING for part in reached.values()) + (least < 1 - ROUNDING)
        wrong, tried = wrong + contradicted, tried + values
        print(
            f"{seed:4d}  {told(design):>10s} {design.status.name.lower()}  peaks over those proved, values:"
            f" {' '.join(f'{part:.4f}' for part in reached.values())}, least |L| below the bandwidth {least:.4f}; {len(systems)}"
            f" systems: {far:.4f}, not stable {unstable}  {time.process_time() - began:.1f} s",
            flush=True,
        )
    print(f"{arguments.count} designs, {tried:.3g} values, {MEMBERS * arguments.count} systems: contradictions {wrong}")
    clock(start)


# -------------------------------------------------------------------------------------------------------------------- time


def seconds(arguments):
    """PID with two notches and 200 frequencies, notches as given and searched, in discs and in polygons of 12 corners."""
    dt, omega = 1e-3, TWO_PI * np.linspace(2.0, 450.0, 200)
    modes = rid.kautz(TWO_PI * np.array([60.0, 140.0]), [0.02, 0.015], dt=dt, delay=1)
    rigid = control.ss(control.zpk([], [0.97, 0.9], 0.003, dt))
    values = values_of(rigid, omega) + modes.response(omega * dt) @ np.array([0.03, 0.02, -0.02, 0.015])
    frf = rid.FrequencyResponse(omega, values, bound=0.03 * np.abs(values) + 1e-3, dt=dt)
    problem = rid.MixedProblem(
        frequency=frf, prior=rid.Prior(gain_bound=4 * np.abs(values).max(), decay_rate=1.02), parametric=modes
    )
    start = time.process_time()
    result = rid.identify(problem)
    band = rid.band(problem).with_model(rid.balanced_truncation(result.model, order=12).model)
    arcs, grid = band.circle.bound.size, Plants.of(band).grid().size
    print(
        f"200 lines, class and two modes: {result.status.name.lower()}, band of {arcs} arcs {time.process_time() - start:.1f} s;"
        f" designed at {grid} frequencies to begin with"
    )
    for kind, one in (("discs", band), ("polygons of 12 corners", with_corners(band))):
        for name, low, high in (("notches as given", 1.0, 1.0), ("notches and filters searched", 0.8, 1.25)):
            print(f"{kind}: PID, two notches, low-pass, {name}: {timed(one, low, high)}", flush=True)


def timed(band, low, high):
    """A design of PID, two notches and a low-pass with numbers between parts of their places, and its time, in words."""

    def free(hz):
        return TWO_PI * hz if low == high else (TWO_PI * hz * low, TWO_PI * hz * high)

    structure = [PID(filter=free(200.0)), Notch(free(60.0), 0.5), Notch(free(140.0), 0.5), LowPass(free(300.0))]
    start = time.process_time()
    found = designed(band, structure)
    spent, again = time.process_time() - start, time.process_time()
    verdict = "held" if spent <= 10 and found.status.name == "PROVED" else "MISSED"
    loop_bounds(band, controller=found.controller)
    alone = time.process_time() - again
    return (
        f"{told(found)}, {found.status.name.lower()}, {spent:.1f} s, bar 10 s {verdict}; its proof alone {alone:.2f} s"
    )


def main():
    logging.disable(logging.WARNING)
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = {
        "weight": weight,
        "sets": sets,
        "nominal": nominal,
        "withheld": withheld,
        "members": members,
        "time": seconds,
    }
    parser.add_argument("what", choices=commands)
    parser.add_argument("count", type=int, nargs="?", default=10, help="random problems of `members` and `nominal`")
    parser.add_argument("--refined", action="store_true", help="`members` of bands with polygons")
    parser.add_argument("--all", action="store_const", const=50, dest="count", help="50 of them")
    arguments = parser.parse_args()
    commands[arguments.what](arguments)


if __name__ == "__main__":
    main()
