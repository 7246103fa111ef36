"""Problems of `bands.py`: simulated ones, published sets and their halves, and the classes that the program suggests for them."""

import dataclasses
import sys
from pathlib import Path

import numpy as np

import robustid as rid

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent / "examples"), str(HERE.parent / "tests")]

TWO_PI = 2 * np.pi


def part_of(frf, rows, columns):
    """Some entries of a response with its bound."""
    chosen = np.ix_(np.arange(frf.omega.size), rows, columns)
    return rid.FrequencyResponse(frf.omega, frf.values[chosen], bound=frf.bound.outer_radius[chosen], dt=frf.dt)


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


def session_of(problem, box, folder):
    """The page of one entry: its lines, its modes with the box of their poles, its class."""
    from robustid.app.explore.views import views
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
    return views(run, Path(folder), lambda *_: None)[0].open(lambda *_: None)


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
