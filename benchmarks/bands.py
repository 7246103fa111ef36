"""Bands from linear certificates: their time, their widths beside the sweep, measured data that were withheld, truths at the edge.

Run: OPENBLAS_NUM_THREADS=1 ROBUSTID_DATA=... python benchmarks/bands.py times | sweep | measured | edges 10000 | arcs | meetings
times and sweep take names of cases; all seconds are of the processor, of one process.
"""

import argparse
import dataclasses
import sys
import tempfile
import time
from pathlib import Path

import control
import numpy as np

import robustid as rid
from robustid.core import one_thread
from robustid.guarantees.linear.amplitudes import extract
from robustid.guarantees.linear.certificate import centres, choose, radii, targets_at
from robustid.guarantees.linear.functions import fixed_functions, functions_over
from robustid.guarantees.linear.samples import samples_of
from robustid.guarantees.linear.search import search

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent / "examples"), str(HERE.parent / "tests")]

TWO_PI = 2 * np.pi


def clocked(work, *arguments, **options):
    """What it returns, and processor seconds."""
    start = time.process_time()
    return work(*arguments, **options), time.process_time() - start


def part_of(frf, rows, columns):
    """Some entries of a response with its bound."""
    chosen = np.ix_(np.arange(frf.omega.size), rows, columns)
    return rid.FrequencyResponse(frf.omega, frf.values[chosen], bound=frf.bound.outer_radius[chosen], dt=frf.dt)


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


# Times


def around(hz, damping, part=0.1):
    """The box: so much of the damping, and so much of the half-width."""
    omega = TWO_PI * np.asarray(hz, float)[:, None]
    damping = np.asarray(damping, float)[:, None]
    ends = np.array([-part, part])
    return omega * (1 + damping * ends), damping * (1 + ends)


def one_entry(lines, hz, damping, top=247.0):
    """Lines from 11 Hz on of some modes and a rest, with bounds of 1 %."""
    omega, dt, rho, gain = TWO_PI * np.linspace(11, top, lines), 0.4e-3, 1.031, 1.9e-4
    basis = rid.kautz(TWO_PI * np.array(hz), damping, dt=dt, delay=1)
    amplitudes = np.tile([2e-3, 1e-3], len(hz))
    values = basis.response(omega * dt) @ amplitudes + 0.7 * gain * np.exp(-1j * omega * dt) / rho
    frf = rid.FrequencyResponse(omega, values, bound=0.01 * np.abs(values), dt=dt)
    prior = rid.Prior(gain_bound=gain, decay_rate=rho)
    return rid.MixedProblem(frequency=frf, prior=prior, parametric=basis), around(hz, damping)


def many_entries(p=28, q=2, lines=1000):
    """A response of 28 outputs and two inputs with four modes of rank one."""
    rng, dt, rho, gain = np.random.default_rng(0), 1e-3, 1.05, 0.05
    hz, damping = [31.0, 74.0, 122.0, 205.0], [0.01, 0.012, 0.008, 0.015]
    basis = rid.kautz(TWO_PI * np.array(hz), damping, dt=dt, delay=1)
    residues = np.repeat(rng.standard_normal((4, p, 1)) * rng.standard_normal((4, 1, q)), 2, axis=0)
    residues = residues * np.tile([1.0, 0.5], 4)[:, None, None]
    omega = TWO_PI * np.linspace(5, 300, lines)
    values = np.tensordot(basis.response(omega * dt), residues, 1)
    values = values + 0.7 * gain * np.exp(-1j * omega * dt)[:, None, None] / rho / np.sqrt(p * q)
    bound = 0.01 * np.abs(values) + 1e-3 * np.median(np.abs(values), axis=0)
    frf = rid.FrequencyResponse(omega, values, bound=bound, dt=dt)
    return rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=gain, decay_rate=rho), parametric=basis), around(
        hz, damping
    )


def measured_matrix(frf):
    """A measured matrix with the modes that it suggests and the box of their poles."""
    modes = rid.suggest_kautz(frf)
    prior = rid.Prior(gain_bound=1.0, decay_rate=1.05, scaling=np.median(np.abs(frf.values), axis=0))
    return rid.MixedProblem(frequency=frf, prior=prior, parametric=modes.basis), modes


def mirror_response(name="fsm/train", part=None):
    frf = rid.estimate_frf(rid.datasets.load(name), period=8192).band(500, 1700)
    return frf if part is None else part_of(frf, *part)


def beam_problem():
    """The statement of examples/beam_ring.toml."""
    from matrix_guarantees import beam

    return beam().problem


TIMES = {
    "60 lines": (lambda: one_entry(60, [77.0], [0.017]), 3),
    "2879 lines": (lambda: one_entry(2879, [77.0, 205.0, 480.0], [0.017, 0.01, 0.012], 800.0), 10),
    "beam 2x2": (lambda: measured_matrix(beam_problem().frequency[0]), 15),
    "mirror 3x3": (lambda: measured_matrix(mirror_response()), 30),
    "28x2": (many_entries, 180),
}


STEP = 0.5  # CPU s of a step of explore


def session_of(problem, box, folder):
    """The page of one entry: its lines, its modes with the box of their poles, its class."""
    from robustid.app.explore.session import Session
    from robustid.app.run.class_settings import PriorChoice
    from robustid.app.run.run_file import RunFile
    from robustid.app.run.settings import Modes, Withheld
    from robustid.app.run.sources import ResponseSource

    rid.save(Path(folder) / "frf.npz", problem.frequency[0])
    poles = np.log(problem.parametric.poles) / problem.dt
    poles = poles[poles.imag > 0]
    poles = poles[np.argsort(abs(poles))]
    modes = Modes(
        hz=tuple((abs(poles) / TWO_PI).tolist()),
        damping=tuple((-poles.real / abs(poles)).tolist()),
        delay=1,
        hz_interval=tuple(map(tuple, (box[0] / TWO_PI).tolist())),
        damping_interval=tuple(map(tuple, box[1].tolist())),
    )
    prior = PriorChoice(gain_bound=problem.prior.gain_bound, decay_rate=problem.prior.decay_rate)
    run = RunFile(frequency=(ResponseSource(file="frf.npz"),), modes=modes, prior=prior, withheld=Withheld(every=0))
    return Session.of(run, Path(folder), lambda *_: None)


def measured_entry(name, lines):
    """Lines of a measured entry, the modes that they suggest, and a box of a tenth around these."""
    frf = MEASURED[name]()[0]
    frf = frf.select(np.unique(np.linspace(0, frf.omega.size - 1, lines).astype(int)))
    problem = class_of(frf)[0]
    poles = np.log(problem.parametric.poles) / problem.dt
    poles = poles[poles.imag > 0]
    poles = poles[np.argsort(abs(poles))]
    return problem, around(abs(poles) / TWO_PI, -poles.real / abs(poles))


EXPLORED = {
    "60 lines": lambda: one_entry(60, [77.0], [0.017]),
    "400 lines": lambda: one_entry(400, [77.0, 205.0, 480.0], [0.017, 0.01, 0.012], 800.0),
    "motor, 240 lines": lambda: measured_entry("motor torsion", 240),
    "beam, 60 lines": lambda: measured_entry("beam (1, 1)", 60),
    "beam, 155 lines": lambda: measured_entry("beam (1, 1)", 155),
    "mirror, 60 lines": lambda: measured_entry("mirror (1, 1)", 60),
    "mirror, 400 lines": lambda: measured_entry("mirror (1, 1)", 400),
}


def explore_steps():
    """A step of explore: problem, samples against the others, band, picture; the first mode a little aside, and far away."""
    from robustid.app.explore.worker import look
    from robustid.report import look_figure

    def step(session, choice):
        found = look(session, choice)
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


# The sweep


def random_problem(seed):
    """One to three modes and a Blaschke product times K, errors inside of bounds of 1 to 3 %."""
    rng = np.random.default_rng(seed)
    lines, modes, rho = rng.integers(12, 44), rng.integers(1, 4), rng.uniform(1.05, 1.3)
    gain, part = 10 ** rng.uniform(-1, 0.5), rng.choice([0.01, 0.02, 0.03])
    turns, damping = np.sort(rng.uniform(0.2, 2.2, modes)), 10 ** rng.uniform(-2.3, -1.3, modes)
    basis = rid.kautz(turns, damping, dt=1.0, delay=1)
    near = (turns[:, None] * (1 + damping[:, None] * np.array([-1.0, 0.0, 1.0]))).ravel()
    omega = np.sort(np.concatenate([near, rng.uniform(0.05, 2.9, max(lines - near.size, 3))]))
    rest = blaschke(np.exp(-1j * omega) / rho, random_zeros(rng), gain)
    values = basis.response(omega) @ (gain * rng.standard_normal(2 * modes)) + rest
    bound = part * np.abs(values) + 0.01 * gain
    values = values + 0.7 * bound * np.sqrt(rng.random(omega.size)) * np.exp(1j * TWO_PI * rng.random(omega.size))
    frf = rid.FrequencyResponse(omega, values, bound=bound, dt=1.0)
    prior = rid.Prior(gain_bound=1.2 * gain, decay_rate=rho)
    return rid.identify(rid.MixedProblem(frequency=frf, prior=prior, parametric=basis))


def random_zeros(rng):
    zeros = rng.uniform(0.1, 0.97, rng.integers(0, 5))
    return zeros * np.exp(1j * rng.uniform(0, np.pi, len(zeros)))


def blaschke(z, zeros, gain):
    found = gain * np.ones_like(z)
    for a in zeros:
        found = found * (z - a) / (1 - np.conj(a) * z) * (z - np.conj(a)) / (1 - a * z)
    return found


def motor():
    """The 19 lines and the class of examples/torsion_margin.py."""
    from motor_torsion import PERIOD, torsion_record
    from torsion_margin import consistent_class, few_lines

    frf = rid.estimate_frf(torsion_record(), period=PERIOD)
    modes = rid.suggest_kautz(frf)
    return rid.identify(consistent_class(few_lines(frf, modes.omega[0]), modes))


def entry_of(result, scale=1.1):
    """Entry (1, 1) alone, of the class that it suggests."""
    frf = part_of(result.problem.frequency[0], [0], [0])
    problem = rid.MixedProblem(
        frequency=frf, prior=rid.Prior(gain_bound=1.0, decay_rate=1.1), parametric=result.problem.parametric
    )
    found = rid.suggest_prior(problem).prior
    return rid.identify(problem.with_prior(gain_bound=scale * found.gain_bound, decay_rate=found.decay_rate))


def of_matrices(name):
    import matrix_guarantees

    return getattr(matrix_guarantees, name)()


def chosen(frf, lines=60):
    """So many lines of a response, of the class that the program suggests, with a tenth more gain."""
    frf = frf.select(np.unique(np.linspace(0, frf.omega.size - 1, lines).astype(int)))
    problem = class_of(frf)[0]
    return rid.identify(problem.with_prior(gain_bound=1.1 * problem.prior.gain_bound))


SWEEPS = {
    **{f"typical {k}": (lambda k=k: chosen(random_problem(k).problem.frequency[0])) for k in range(10)},
    **{f"random {k}": (lambda k=k: random_problem(k)) for k in range(10)},
    "motor": motor,
    "beam entry": lambda: entry_of(of_matrices("beam")),
    "mirror entry": lambda: entry_of(of_matrices("mirror")),
    "beam 2x2": lambda: of_matrices("beam"),
    "beam (1, 2)": lambda: chosen(beam_halves(([0], [1]))[0]),
    "beam (2, 2)": lambda: chosen(beam_halves(([1], [1]))[0]),
    "mirror (1, 2)": lambda: chosen(mirror_response(name="fsm_200mV/train", part=([0], [1]))),
    "mirror (3, 3)": lambda: chosen(mirror_response(part=([2], [2]))),
    "hair dryer": lambda: chosen(record_halves("hairdryer")[0]),
    "CD player": lambda: chosen(part_of(record_halves("cdplayer")[0], [0], [0])),
}


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


# Measured data that were withheld


def periods_of(record, period, which):
    """Every second period of a record in steady state."""
    u, y = (s.reshape(-1, period, s.shape[1])[which].reshape(-1, s.shape[1]) for s in (record.u, record.y))
    reference = record.reference
    if reference is not None:
        reference = reference.reshape(-1, period, reference.shape[1])[which].reshape(-1, reference.shape[1])
    return dataclasses.replace(record, u=u, y=y, reference=reference)


def motor_halves():
    from motor_torsion import PERIOD, torsion_record

    record = torsion_record()
    return tuple(rid.estimate_frf(periods_of(record, PERIOD, slice(start, None, 2)), period=PERIOD) for start in (0, 1))


def mirror_halves(name, entry=None):
    """Three realisations of the excitation, and three others; `about` the next record, which is what judges."""
    records = rid.datasets.load(name)
    found = [rid.estimate_frf(three, period=8192).band(500, 1700) for three in (records[:3], records[3:])]
    return tuple(one if entry is None else part_of(one, *entry) for one in found)


def every_second_line(frf):
    return frf.select(slice(0, None, 2)), frf.select(slice(1, None, 2))


def beam_halves(entry=None):
    """There is one record of either sweep: every second line."""
    frf = rid.estimate_frf([rid.prepare.decimate(record, 5) for record in rid.datasets.load("beam_ring")])
    frf = frf.band(8, 70).select(slice(None, None, 8))
    return every_second_line(frf if entry is None else part_of(frf, *entry))


def record_halves(name):
    """First and second half of a short record, each with its transient."""
    record = rid.datasets.load(name)
    half = len(record.u) // 2
    parts = [
        dataclasses.replace(record, u=record.u[part], y=record.y[part] - record.y.mean(axis=0))
        for part in (slice(0, half), slice(half, 2 * half))
    ]
    return tuple(rid.estimate_frf(part, method="local") for part in parts)


FIRST = ([0], [0])
MEASURED = {
    "motor torsion": motor_halves,
    "mirror (1, 1)": lambda: mirror_halves("fsm/train", FIRST),
    "mirror 3x3": lambda: mirror_halves("fsm/train"),
    "mirror 200 mV": lambda: mirror_halves("fsm_200mV/train"),
    "beam (1, 1)": lambda: beam_halves(FIRST),
    "beam 2x2": beam_halves,
    "CD player": lambda: record_halves("cdplayer"),
    "hair dryer": lambda: record_halves("hairdryer"),
}


def class_of(frf):
    """Statement, box and whether a gain bound fits, all from these lines."""
    modes = rid.suggest_kautz(frf)
    box = (modes.omega_interval, modes.damping_interval) if modes.omega.size else None
    scaling = None if frf.values[0].size == 1 else np.median(np.abs(frf.values), axis=0)
    prior = rid.Prior(gain_bound=1.0, decay_rate=1.1, scaling=scaling)
    problem = rid.MixedProblem(frequency=frf, prior=prior, parametric=modes.basis)
    suggested = rid.suggest_prior(problem, time_limit=60.0).prior
    if suggested is None:
        typical = 1.0 if scaling is not None else float(np.median(np.abs(frf.values)))
        prior = rid.Prior(gain_bound=typical, decay_rate=1.05, scaling=scaling)
    return dataclasses.replace(problem, prior=suggested or prior), box, suggested is not None


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


# Truths at the edge of the class

KINDS = ("disc", "cont", "record", "roll", "free", "periodic", "mimo_record", "sym", "matrix")


def edge(seed):
    """(kind, problem, box or None, truth, 100 frequencies): a system of the largest gain, its mode in a corner of the box."""
    rng = np.random.default_rng(seed)
    kind, dt, rho = KINDS[seed % len(KINDS)], 0.01, rng.choice([1.02, 1.1, 1.3])
    gain, lines, zeros = 10 ** rng.uniform(-2, 1), rng.integers(8, 30), random_zeros(rng)
    hz, damping, part = rng.uniform(5, 25), 10 ** rng.uniform(-2.5, -1.3), rng.choice([0, 0.02, 0.1, 0.3])
    signs = rng.choice([-1, 1], 2)
    omega, true_damping = TWO_PI * hz * (1 + signs[0] * part * damping), damping * (1 + signs[1] * part)
    residues = gain * rng.standard_normal(2) * 10 ** rng.uniform(0, 1)
    box = around([hz], [damping], part) if part else None
    w = np.sort(TWO_PI * np.r_[rng.uniform(0.5, 45, lines), hz * np.array([0.99, 1.01])])
    if kind in ("cont", "roll"):
        truth, prior = continuous(rng, kind, gain, zeros, residues, omega, true_damping)
        basis, dt, top = rid.kautz([TWO_PI * hz], [damping], dt=0), None, 100
    else:
        true = rid.kautz([omega], [true_damping], dt=dt, delay=1)
        truth = sampled(rng, kind, gain, zeros, residues, true, dt, rho)
        basis, top = rid.kautz([TWO_PI * hz], [damping], dt=dt, delay=1), 49.9
        prior = rid.Prior(gain_bound=gain, decay_rate=rho)
    values = truth(w)
    bound = rng.choice([0.01, 0.03]) * np.abs(values) + 0.01 * gain
    values = values + bound * np.exp(1j * TWO_PI * rng.random(values.shape)) * (1 - 1e-9)
    data = {"frequency": rid.FrequencyResponse(w, values, bound=bound, dt=dt)}
    if kind in ("record", "free", "periodic", "mimo_record"):
        data["time"] = record_of(rng, kind, truth, gain, dt)
    problem = rid.MixedProblem(prior=prior, parametric=basis, symmetric=kind == "sym", **data)
    return kind, problem, box, truth, TWO_PI * rng.uniform(0.1, top, 100)


def continuous(rng, kind, gain, zeros, residues, omega, damping):
    """A truth of modulus K on Re s = -alpha beside a mode, with or without a roll-off."""
    alpha = 10 ** rng.uniform(0, 1.3)
    pole = (-damping + 1j * np.sqrt(1 - damping**2)) * omega
    size, above = abs(pole.real), residues[0] + 1j * residues[1]

    def truth(w):
        s = 1j * w
        weight = (1 + (s + alpha) / 300) ** -2 if kind == "roll" else 1
        rest = weight * blaschke((50 - alpha - s) / (50 + alpha + s), zeros, gain)
        return (size * (above / (s - pole) + np.conj(above) / (s - np.conj(pole))) + rest)[:, None, None]

    rolls = {"roll_off": 2, "corner": 300.0} if kind == "roll" else {}
    return truth, rid.Prior(gain_bound=gain, decay=alpha, **rolls)


def sampled(rng, kind, gain, zeros, residues, true, dt, rho):
    """A truth of modulus K on |z| = 1/rho (its largest singular value) beside a mode: one entry, two inputs, or symmetric 2x2."""
    if kind == "sym":
        free = [gain * rng.standard_normal((2, 2)) for _ in range(2)]
        free = np.stack([one + one.T for one in free])
        left, real = np.linalg.qr(rng.standard_normal((2, 2)))[0], rng.uniform(-0.9, 0.9, 2)

        def truth(w):
            z = np.exp(-1j * w * dt) / rho
            factors = np.stack([(z - a) / (1 - a * z) for a in real], axis=1)
            return gain * np.einsum("ik,fk,jk->fij", left, factors, left) + np.tensordot(true.response(w * dt), free, 1)

        return truth
    if kind == "matrix":
        free, turns = gain * rng.standard_normal((2, 2, 2)), rng.standard_normal((4, 2))
        turns, real = turns / np.linalg.norm(turns, axis=1, keepdims=True), rng.uniform(-0.9, 0.9, 4)

        def of_matrix(w):
            """Blaschke and Potapov: a product of factors I + (b(z) - 1) v v', whose directions differ."""
            z = np.exp(-1j * w * dt)[:, None, None] / rho
            rest = gain * np.eye(2)
            for v, a in zip(turns, real, strict=True):
                rest = rest @ (np.eye(2) + ((z - a) / (1 - a * z) - 1) * np.outer(v, v))
            return rest + np.tensordot(true.response(w * dt), free, 1)

        return of_matrix
    free, row = residues[:, None, None], np.ones((1, 1))
    if kind == "mimo_record":
        free, row = gain * rng.standard_normal((2, 1, 2)), np.linalg.qr(rng.standard_normal((2, 2)))[0][:1]
    return lambda w: (
        row[None] * blaschke(np.exp(-1j * w * dt) / rho, zeros, gain)[:, None, None]
        + np.tensordot(true.response(w * dt), free, 1)
    )


def record_of(rng, kind, truth, gain, dt):
    """Samples of the truth with errors at the ends of their bounds: from rest, after an unknown past, or periodic."""
    inputs, count, long = (2 if kind == "mimo_record" else 1), (32 if kind == "periodic" else 20), 4 * 4096
    taps = np.fft.irfft(truth(TWO_PI * np.arange(long // 2 + 1) / long / dt), long, axis=0)[:, 0]
    if kind == "periodic":
        u = rng.standard_normal((count, inputs))
        lines = truth(TWO_PI * np.arange(count // 2 + 1) / count / dt)[:, 0]
        y, initial = np.fft.irfft((lines * np.fft.rfft(u, axis=0)).sum(axis=1), count), {"initial": "periodic"}
    else:
        past = 200 if kind == "free" else 0
        u = rng.uniform(-1, 1, (past + count, inputs)) if past else rng.standard_normal((count, inputs))
        y = np.array([np.sum(taps[: t + 1] * u[t::-1]) for t in range(past, past + count)])
        u, initial = u[past:], ({"initial": "free", "past_input_bound": 1.0} if past else {})
    bound = 0.02 * np.abs(y).max() + 1e-6 * gain
    y = y + bound * rng.choice([-1, 1], count) * (1 - 1e-9)
    return rid.TimeRecord(u, y, dt=dt, bound=np.full(count, bound), **initial)


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
        found[0][:, i, j] = centres(samples, chosen, targets, d, known)
        found[1][:, i, j] = radii(samples, chosen, targets, d, known)
    return found


def edges(arguments):
    found, unbounded = [], []
    with one_thread():
        for seed in range(arguments.first, arguments.first + arguments.count):
            kind, problem, box, truth, omega = edge(seed)
            ways = {"search": lambda p=problem, b=box, w=omega: at_once(p, b, w)}
            if seed // len(KINDS) % arguments.every == 0:
                ways["band"] = lambda p=problem, b=box, w=omega: rid.band(p, box=b).at(w)
            for way, work in ways.items():
                (centre, radius), seconds = clocked(work)
                true = truth(omega)
                ratio = np.abs(centre - true) / radius
                width = float(np.median(radius / np.abs(true)))
                found.append((way, kind, ratio.max(), int((ratio > 1).sum()), ratio.size, width, seconds, radius))
                if ratio.max() > 1:
                    print(f"seed {seed}, {kind}, {way}: ratio {ratio.max():.6f}", flush=True)
                elif not np.all(np.isfinite(radius)) and len(unbounded) < 12:
                    unbounded.append(f"{seed} {kind} {way}")
    print("unbounded, the first of them:", "; ".join(unbounded) or "none")
    print("way     kind          truths  values  outside  unbounded  largest error/radius  median width  CPU s")
    for way in ("search", "band"):
        for kind in (*KINDS, None):
            own = [one for one in found if one[0] == way and kind in (None, one[1])]
            if own:
                print(
                    f"{way:8}{kind or 'all':14}{len(own):6d}{sum(o[4] for o in own):8d}{sum(o[3] for o in own):9d}"
                    f"{sum(not np.all(np.isfinite(o[7])) for o in own):11d}{max(o[2] for o in own):22.4f}{100 * np.median([o[5] for o in own]):13.1f} %"  # noqa: E501
                    f"{np.mean([o[6] for o in own]):7.2f}"
                )


def arcs(arguments):
    """Between knots: the radius over that of a search there, and bounds of whole arcs over the bound of the error in them."""
    mixed, whole, below = [], [], 0
    for seed in range(arguments.count // 100):
        _, problem, box, _, omega = edge(seed)
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
