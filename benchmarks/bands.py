"""Bands from linear certificates: their time, their widths beside the sweep, measured data that were withheld, truths at the edge.

Run: OPENBLAS_NUM_THREADS=1 ROBUSTID_DATA=... python benchmarks/bands.py times | sweep | measured | edges 10000 | arcs | meetings
times and sweep take names of cases; all seconds are of the processor, of one process.
"""

import argparse
import dataclasses
import tempfile
import time

import control
import numpy as np
from band_problems import EXPLORED, MEASURED, SWEEPS, TIMES, class_of, one_entry, random_problem, session_of

import robustid as rid
from robustid.core import one_thread
from robustid.guarantees.linear.amplitudes import extract
from robustid.guarantees.linear.certificate import choose, discs, targets_at
from robustid.guarantees.linear.functions import fixed_functions, functions_over
from robustid.guarantees.linear.samples import samples_of
from robustid.guarantees.linear.search import search
from support.edge_bands import KINDS, edge_plant


def clocked(work, *arguments, **options):
    """What it returns, and processor seconds."""
    start = time.process_time()
    return work(*arguments, **options), time.process_time() - start


def modal_model(problem):
    """The parametric part with its amplitudes by least squares in units of the bounds, and a constant; not timed."""
    frf, basis = problem.frequency[0], problem.parametric
    _, p, q = frf.values.shape
    known = np.column_stack([basis.response(problem.plane.angles(frf.omega)), np.ones(frf.omega.size)])
    found = np.empty((known.shape[1], p, q))
    for i, j in np.ndindex(p, q):
        weight = 1 / frf.bound.outer_radius[:, i, j]
        rows, y = known * weight[:, None], frf.values[:, i, j] * weight
        rows, y = np.concatenate([rows.real, rows.imag]), np.concatenate([y.real, y.imag])
        found[:, i, j] = np.linalg.lstsq(rows, y)[0]
    A, B, C, D = basis.matrices
    C = sum(np.kron(C[k : k + 1], found[k]) for k in range(len(C)))
    D = np.tensordot(np.append(D, 1.0), found, 1)
    return control.ss(np.kron(A, np.eye(q)), np.kron(B, np.eye(q)), C, D, problem.dt)


STEP = 0.5  # CPU s of a step of explore


def explore_steps():
    """A step of explore: problem, samples against the others, band, picture; the first mode a little aside, and far away."""
    from robustid.app.explore.worker import glance
    from robustid.report import look_figure

    def step(session, choice):
        found = glance(session, choice)
        look_figure(found.check, found.band)
        return found

    print("\nexplore: a step with its band, CPU s (margin: at least, by samples against the others)")
    for name, make in EXPLORED.items():
        with tempfile.TemporaryDirectory() as folder, one_thread():
            session = session_of(*make(), folder)
            start, parts = session.start, []
            for words, factor in (("box", 1.0), ("moved", 1.0001), ("far", 1.05)):
                choice = dataclasses.replace(start, hz=(start.hz[0] * factor, *start.hz[1:]))
                found, seconds = min((clocked(step, session, choice) for _ in range(3)), key=lambda one: one[1])
                knots = "no band" if found.band is None else f"{found.band.bands[0].angles.size} knots"
                missed = "" if seconds < STEP else " MISSED"
                parts.append(f"{words} {seconds:.2f} ({knots}, {found.check.margin:.2g}){missed}")
            lines = found.check.problem.frequency[0].omega.size
            print(f"{name:18}{lines:5d} lines, {len(start.hz)} modes: {', '.join(parts)}; bar {STEP} s", flush=True)


def times(arguments):
    if "explore" in arguments.cases:
        arguments.cases.remove("explore")
        explore_steps()
        if not arguments.cases:
            return
    print(
        "poles anywhere in their box, the whole axis; CPU s\n"
        + " " * 12
        + "lines  knots   band  circle  all  1000 knots"
    )
    for name in arguments.cases or TIMES:
        make, bar = TIMES[name]
        problem, box = make()
        model = modal_model(problem)
        band, searched = clocked(rid.band, problem, box=box, model=model)
        circle, bounded = clocked(lambda band=band: band.circle)
        knots = sum(one.angles.size for one in band.bands)
        seconds, finite = searched + bounded, np.isfinite(circle.bound).all() and np.isfinite(band.radius).all()
        print(
            f"{name:12}{problem.frequency[0].omega.size:5d}{knots:7d}{searched:7.2f}{bounded:8.2f}{seconds:7.2f}"
            f"{1000 * searched / knots:8.2f}  arcs {circle.bound.size}, largest {circle.largest:.4g}"
            f" (radius up to {band.radius.max():.4g}), bar {bar} s {'held' if seconds <= bar else 'MISSED'}"
            f"{'' if finite else '; NOT FINITE'}",
            flush=True,
        )
    problem, _ = one_entry(60, [77.0], [0.017])
    omega = np.sort(np.random.default_rng(0).uniform(0, np.pi / problem.dt, 1000))
    band, searched = clocked(rid.band, problem)
    knots = band.bands[0].angles.size
    _, read = clocked(band.at, omega)
    print(
        f"\nfixed poles, 60 lines: {1000 * searched / knots:.2f} ms a knot ({knots} of them, {searched:.2f} s);"
        f" {1000 * read / omega.size:.3f} ms a frequency between them; bar 5 ms"
        f" {'held' if 1000 * searched / knots <= 5 else 'MISSED'}"
    )
    exact, seconds = clocked(band.verify, exact=True)
    print(f"verified in ball arithmetic: {exact}, {seconds:.1f} s")
    if not arguments.cases:
        explore_steps()


def distance(value, corners):
    """From a value to a convex polygon (or an interval) with these corners, 0 inside."""
    a, b = corners, np.roll(corners, -1)
    edge = b - a
    across = np.imag(np.conj(edge) * (value - a))
    if corners.size > 2 and (np.all(across >= 0) or np.all(across <= 0)):
        return 0.0
    length = np.maximum(np.abs(edge) ** 2, 1e-300)
    return float(np.abs(a + np.clip(np.real(np.conj(edge) * (value - a)) / length, 0, 1) * edge - value).min())


def compared(result, count, limit):
    """Ratios of the bounds, discs that miss a polygon, discs, and seconds of both."""
    lines = np.concatenate([f.omega for f in result.problem.frequency])
    basis = result.problem.parametric
    poles = np.zeros(0) if basis is None else np.abs(np.angle(basis.poles)) / (result.problem.dt or 1.0)
    omega = np.linspace(lines.min(), lines.max(), count)
    inside = np.unique(poles[(poles >= lines.min()) & (poles <= lines.max())])
    for pole in inside[:3]:
        omega[np.argmin(np.abs(omega - pole))] = pole
    omega = np.unique(omega)
    before = rid.reduce_within_bounds(result, time_limit=60.0).model
    error, slow = clocked(rid.worst_case_error, result, model=before, omega=omega, time_limit=limit)
    band, quick = clocked(rid.band, result, omega=error.omega)
    band = band.with_model(rid.reduce_within_bounds(result, band=rid.band(result), time_limit=60.0).model)
    centre, radius = band.at(error.omega)
    missed = 0
    for i, j in np.ndindex(*radius.shape[1:]):
        for k, polygon in enumerate(error.of_entry(i, j)):
            apart = distance(complex(centre[k, i, j]), polygon.vertices)
            missed += apart > radius[k, i, j] * (1 + 1e-9)
    ratio = band.upper / np.asarray(error.upper).reshape(radius.shape)
    return ratio.ravel(), missed, radius.size, quick, slow, error.omega.size


def sweep(arguments):
    print(
        "guaranteed error, fixed poles in both: of the model that follows the band, by the band, over that of the smallest"
        " model without a band, by the sweep"
    )
    print(
        f"{'':14}{'lines':>6}{'frequencies':>13}{'median':>8}{'max':>7}{'min':>7}{'missed':>9}{'band s':>8}{'sweep s':>9}"
    )
    every, missed, discs = [], 0, 0
    for name in arguments.cases or SWEEPS:
        result = SWEEPS[name]()
        if not result.consistent:
            print(f"{name:14} {result.status.value}")
            continue
        ratio, apart, count, quick, slow, done = compared(result, 12, arguments.time_limit)
        lines = sum(f.omega.size for f in result.problem.frequency)
        every, missed, discs = [*every, *ratio], missed + apart, discs + count
        print(
            f"{name:14}{lines:6d}{done:13d}{np.median(ratio):8.3f}{ratio.max():7.3f}{ratio.min():7.3f}"
            f"{f'{apart}/{count}':>9}{quick:8.2f}{slow:9.1f}",
            flush=True,
        )
    print(
        f"all: median {np.median(every):.3f}, max {np.max(every):.3f}, min {np.min(every):.3f};"
        f" {missed} of {discs} discs don't meet their polygon"
    )


def judged(band, judge):
    """Share of the judging lines outside, largest excess, median width relative to the response."""
    last = band.problem.plane.omega(band.bands[0].angles[[0, -1]])
    judge = judge.select((judge.omega >= last[0]) & (judge.omega <= last[1]))
    centre, radius = band.at(judge.omega)
    away = np.abs(judge.values - centre) - judge.bound.outer_radius
    return np.mean(away > radius), float((away / radius).max()), float(np.median(radius / np.abs(judge.values)))


def swept(problem, band, judge, limit):
    """Median radius of the sweep about its model over that of the band, at some judging lines: fixed poles."""
    result = rid.identify(problem)
    if not result.consistent:
        return f"{result.status.value}, margin {result.margin:.3g}"
    omega = judge.omega[np.unique(np.linspace(0, judge.omega.size - 1, 12).astype(int))]
    error, seconds = clocked(rid.worst_case_error, result, omega=omega, time_limit=limit)
    size = np.abs(np.stack([judge.values[np.argmin(np.abs(judge.omega - w))] for w in error.omega]))
    upper = np.asarray(error.upper).reshape(size.shape)
    ratio = np.median(band.at(error.omega)[1] / upper)
    return (
        f"sweep {100 * np.median(upper / size):.3g} % at {error.omega.size} frequencies, radius of the band over it"
        f" {ratio:.3f}, {seconds:.0f} s"
    )


def measured(arguments):
    print(
        "share of the judging lines outside (of those used, which refute the class), largest (error - own bound)/radius,"
    )
    print("median radius relative to the response")
    for name in arguments.cases or MEASURED:
        train, judge = MEASURED[name]()
        own = 100 * np.median(train.bound.outer_radius / np.abs(train.values))
        print(f"{name}: {train.omega.size} lines to identify, {judge.omega.size} to judge, bounds {own:.3g} %")
        problem, box, fits = class_of(train)
        fixed = said(problem, box, fits, train, judge)
        if train.values[0].size == 1 and train.omega.size <= 300:
            print(f"    {swept(problem, fixed, judge, arguments.time_limit)}", flush=True)


def said(problem, box, fits, train, judge):
    """Print what the bands of a statement are worth; the one at fixed poles."""
    count = 0 if box is None else len(box[0])
    print(
        f"    {count} modes, K {problem.prior.gain_bound:.3g}, rho {problem.prior.decay_rate:.4g}"
        f"{'' if fits else '; no K fits these poles: K is the median response'}"
    )
    fixed = None
    for name, poles in (("fixed", None), ("box", box)):
        if name == "box" and box is None:
            continue
        band, seconds = clocked(rid.band, problem, box=poles)
        fixed = fixed or band
        (outside, largest, width), (refuted, _, _) = judged(band, judge), judged(band, train)
        print(
            f"    {name:6} outside {100 * outside:6.3f} % ({100 * refuted:.3f} %)  largest {largest:6.3f}"
            f"  width {100 * width:5.3g} %  {seconds:.1f} s"
            f"{'' if np.isfinite(band.radius).all() else '; NOT FINITE'}",
            flush=True,
        )
    return fixed


def edge(seed):
    """A plant at the edge of its class, its kind, and 100 frequencies."""
    kind = KINDS[seed % len(KINDS)]
    plant = edge_plant(kind, seed // len(KINDS))
    return kind, plant, plant.frequencies(np.random.default_rng(seed), 100)


def at_once(problem, box, omega):
    """Centres and radii from a search at these frequencies themselves."""
    functions = fixed_functions(problem.parametric)
    if box is not None:
        functions = functions_over(problem.parametric, problem.plane, *box, np.array([100.0]))
    found = np.empty((omega.size, *problem.entries.shape), complex), np.empty((omega.size, *problem.entries.shape))
    for i, j in np.ndindex(*problem.entries.shape):
        samples = samples_of(problem, functions, (i, j))
        known, targets = extract(samples).known, targets_at(samples, problem.plane.angles(omega))
        points, d = search(samples, targets, known)
        chosen = choose(samples, targets, points)
        found[0][:, i, j], found[1][:, i, j] = discs(samples, chosen, targets, d, known)
    return found


def edges(arguments):
    found, unbounded = [], []
    with one_thread():
        for seed in range(arguments.first, arguments.first + arguments.count):
            kind, plant, omega = edge(seed)
            ways = {"search": lambda p=plant, w=omega: at_once(p.problem, p.box, w)}
            if seed // len(KINDS) % arguments.every == 0:
                ways["band"] = lambda p=plant, w=omega: rid.band(p.problem, box=p.box).at(w)
            for way, work in ways.items():
                (centre, radius), seconds = clocked(work)
                true = plant.truth(omega)
                ratio = np.abs(centre - true) / radius
                width = float(np.median(radius / np.abs(true)))
                found.append((way, kind, ratio.max(), int((ratio > 1).sum()), ratio.size, width, seconds, radius))
                if ratio.max() > 1:
                    print(f"seed {seed}, {kind}, {way}: ratio {ratio.max():.6f}", flush=True)
                elif not np.all(np.isfinite(radius)) and len(unbounded) < 12:
                    unbounded.append(f"{seed} {kind} {way}")
    print("unbounded, the first of them:", "; ".join(unbounded) or "none")
    print("way     kind                  truths  values  outside  unbounded  largest error/radius  median width  CPU s")
    for way in ("search", "band"):
        for kind in (*KINDS, None):
            own = [one for one in found if one[0] == way and kind in (None, one[1])]
            if own:
                print(
                    f"{way:8}{kind or 'all':22}{len(own):6d}{sum(o[4] for o in own):8d}{sum(o[3] for o in own):9d}"
                    f"{sum(not np.all(np.isfinite(o[7])) for o in own):11d}{max(o[2] for o in own):22.4f}{100 * np.median([o[5] for o in own]):13.1f} %"  # noqa: E501
                    f"{np.mean([o[6] for o in own]):7.2f}"
                )


def arcs(arguments):
    """Between knots: the radius over that of a search there, and bounds of whole arcs over the bound of the error in them."""
    mixed, whole, below = [], [], 0
    for seed in range(arguments.count // 100):
        _, plant, omega = edge(seed)
        problem, box = plant.problem, plant.box
        band = rid.band(problem, box=box)
        omega = np.sort(omega[(band.range[0] < omega) & (omega < band.range[1])])
        _, radius = band.at(omega)
        with one_thread():
            _, direct = at_once(problem, box, omega)
        known = np.isfinite(radius) & np.isfinite(direct)
        mixed += (radius / direct)[known].tolist()
        if not known.all():
            continue
        model = control.ss([], [], [], np.mean(problem.frequency[0].values, axis=0).real, problem.dt or 0)
        circle = band.with_model(model).circle
        arc = np.clip(np.searchsorted(circle.edges, omega, side="right") - 1, 0, circle.bound.size - 1)
        ratio = (circle.entries[arc] / band.error_at(omega, model)).ravel()
        below += int((ratio < 1 - 1e-12).sum())
        whole += ratio.tolist()
    print(
        f"{len(mixed)} radii between knots over those of a search there: median {np.median(mixed):.4f}, 95 % below",
        end=" ",
    )
    print(f"{np.percentile(mixed, 95):.3f}, largest {max(mixed):.3f}")
    print(f"{len(whole)} bounds of arcs over the error in them: {below} below, median {np.median(whole):.4f}", end=", ")
    print(f"largest {max(whole):.3f}")


def meetings(arguments):
    """Discs and polygons of the sweep at the same frequencies: each pair has a common point."""
    missed = discs = undecided = 0
    for seed in range(arguments.count):
        result = random_problem(seed)
        if not result.consistent:
            undecided += 1
            continue
        omega = np.random.default_rng(seed).uniform(0.02, 3.1, 2)
        error = rid.worst_case_error(result, omega=omega, directions=8, rtol=0.2)
        centre, radius = rid.band(result, omega=error.omega).at(error.omega)
        for k, polygon in enumerate(error.of_entry(0, 0)):
            discs += 1
            missed += distance(complex(centre[k, 0, 0]), polygon.vertices) > radius[k, 0, 0] * (1 + 1e-9)
    print(
        f"{missed} of {discs} discs don't meet their polygon, {arguments.count} problems, {undecided} of them inconsistent"
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(required=True)
    for name, work, cases in (
        ("times", times, [*TIMES, "explore"]),
        ("sweep", sweep, SWEEPS),
        ("measured", measured, MEASURED),
    ):
        one = commands.add_parser(name)
        one.add_argument("cases", nargs="*", help=", ".join(cases))
        one.add_argument("--time-limit", type=float, default=120.0, help="seconds of one sweep")
        one.set_defaults(work=work)
    one = commands.add_parser("edges")
    one.add_argument("count", type=int, nargs="?", default=80)
    one.add_argument("--first", type=int, default=0, help="seed")
    one.add_argument("--every", type=int, default=10, help="of so many rounds of the kinds one by band() too")
    one.set_defaults(work=edges)
    for name, work, count in (("arcs", arcs, 10_000), ("meetings", meetings, 500)):
        one = commands.add_parser(name)
        one.add_argument("count", type=int, nargs="?", default=count)
        one.set_defaults(work=work)
    arguments = parser.parse_args()
    arguments.work(arguments)


if __name__ == "__main__":
    main()
