"""Short noisy records of lightly damped plants of three modes, and a judge, who knows the plant, of what comes out by default."""

import dataclasses
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg
import scipy.signal

import robustid as rid
from robustid.app.run.measurements import Measured
from robustid.app.run.modes import box_of_modes, held_box
from robustid.app.run.posing import posed
from robustid.app.run.run_file import read_run_file
from robustid.app.run.run_folder import Surroundings
from robustid.app.run.sequence import decided
from robustid.errors import InconsistentDataError

RANGES_HZ = ((8, 15), (25, 60), (90, 180))  # of a robot arm
DAMPINGS = (0.002, 0.01)
EXCITATIONS = ("noise", "chirp", "multisine")
JUDGED = 1000  # frequencies


@dataclasses.dataclass(frozen=True)
class Plant:
    """Modes r w^2/(s^2 + 2 d w s + w^2) and a small rest g/(1 + s/c), behind a zero-order hold."""

    omega: np.ndarray
    damping: np.ndarray
    residue: np.ndarray
    rest: tuple[float, float]
    dt: float

    def _matrices(self) -> tuple[np.ndarray, ...]:
        n = 2 * len(self.omega) + 1
        A, B, C = np.zeros((n, n)), np.zeros((n, 1)), np.zeros((1, n))
        for k, (w, d, r) in enumerate(zip(self.omega, self.damping, self.residue, strict=True)):
            A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[0, w], [-w, -2 * d * w]]
            B[2 * k + 1], C[0, 2 * k] = w, r
        g, c = self.rest
        A[-1, -1], B[-1], C[0, -1] = -c, c, g
        big = scipy.linalg.expm(np.block([[A, B], [np.zeros((1, n + 1))]]) * self.dt)
        return big[:n, :n], big[:n, n:], C

    def response(self, omega: np.ndarray) -> np.ndarray:
        A, B, C = self._matrices()
        z = np.exp(1j * np.asarray(omega) * self.dt)
        return (C @ np.linalg.solve(z[:, None, None] * np.eye(len(A)) - A, B[None]))[:, 0, 0]

    def output(self, u: np.ndarray) -> np.ndarray:
        A, B, C = self._matrices()
        poles, V = np.linalg.eig(A)
        parts = (C @ V)[0] * np.linalg.solve(V, B)[:, 0]
        pairs = zip(poles, parts, strict=True)
        return np.sum([(c * scipy.signal.lfilter([0, 1], [1, -p], u.astype(complex))).real for p, c in pairs], axis=0)


def plant_of(rng: np.random.Generator, dt: float) -> Plant:
    """A random plant: signs of the residues either way, sizes within a factor of three."""
    hz = np.array([rng.uniform(*ends) for ends in RANGES_HZ])
    damping = np.exp(rng.uniform(*np.log(DAMPINGS), 3))
    residue = np.exp(rng.uniform(np.log(0.3), 0, 3)) * rng.choice([-1, 1], 3)
    rest = 0.1 * rng.uniform(-1, 1), 2 * np.pi * rng.uniform(50, 150)
    return Plant(2 * np.pi * hz, damping, residue, rest, dt)


def record_of(seed: int, constants: float | None = None) -> tuple[Plant, rid.TimeRecord, str]:
    """A record of half a second, or of so many time constants of the lightest mode: from rest, or cut out of a longer one."""
    rng = np.random.default_rng([seed, 71])
    dt = 1 / rng.choice([500.0, 1000.0, 2000.0])
    plant = plant_of(rng, dt)
    lightest = np.argmin(plant.damping)
    seconds = 0.5 if constants is None else constants / (plant.damping * plant.omega)[lightest]
    count = round(seconds / dt)
    kind, resting = EXCITATIONS[seed % 3], rng.random() < 0.5
    before = 0 if resting else round(2.0 / dt)
    top = min(0.4 / dt, 250.0)
    t = np.arange(count + before) * dt
    if kind == "noise":
        u = rng.standard_normal(t.size)
    elif kind == "chirp":
        u = np.tile(scipy.signal.chirp(t[:count], 2.0, t[count - 1], top), 1 + -(-before // count))[-t.size :]
    else:
        spectrum = np.zeros(count // 2 + 1, complex)
        used = (np.fft.rfftfreq(count, dt) > 0) & (np.fft.rfftfreq(count, dt) <= top)
        spectrum[used] = np.exp(2j * np.pi * rng.random(used.sum()))
        u = np.fft.irfft(spectrum, count)
        u = np.tile(u / u.std(), 1 + -(-before // count))[-t.size :]
    y = plant.output(u)
    u, y = u[before:], y[before:]
    noise = np.exp(rng.uniform(np.log(0.01), np.log(0.05)))
    y = y + noise * y.std() * rng.standard_normal(count)
    record = rid.TimeRecord(u, y, dt=dt, initial="rest" if resting else "free")
    return plant, record, f"{kind}, {'rest' if resting else 'free'}, {count} x {dt:g} s, noise {100 * noise:.1f} %"


class Verdict(NamedTuple):
    """Ratios of errors to what was claimed (at most 1: it holds), boxes that hold their modes, widths; None: not reached."""

    said: str
    lines: float  # largest |estimate - truth|/bound at the lines
    lines_outside: float  # part of the lines
    found: int  # modes
    held: int  # of them within their box
    band: float | None = None  # largest |centre - truth|/radius, in the range of the data
    band_outside: float | None = None
    width: float | None = None  # median radius over |truth|
    ratio: float | None = None  # median radius over that with the true poles
    note: str = ""


def judged(plant: Plant, record: rid.TimeRecord, *, compare: bool = True, **options: Any) -> Verdict:
    """What a user gets by default from a record, against the plant."""
    frf = rid.estimate_frf(record, **options)
    return judged_response(plant, frf, compare=compare)


def judged_response(plant: Plant, frf: rid.FrequencyResponse, *, compare: bool = True) -> Verdict:
    error = np.abs(frf.values[:, 0, 0] - plant.response(frf.omega)) / frf.bound.outer_radius[:, 0, 0]
    found = _posed(frf, {})
    lines = float(error.max()), float(np.mean(error > 1))
    box = box_of_modes(found.run.modes)
    modes, held, missed = _held(plant, box)
    missed += f" inside {frf.omega.size} lines"
    if found.band is None:
        return Verdict("inconsistent", *lines, modes, held, note=missed)
    omega = np.linspace(frf.omega[0], frf.omega[-1], JUDGED)
    truth = plant.response(omega)
    centre, radius = (part[:, 0, 0] for part in found.band.at(omega))
    miss = np.abs(centre - truth) / radius
    band = float(miss.max()), float(np.mean(miss > 1)), float(np.median(radius / np.abs(truth)))
    ratio = None
    if compare:
        known = {"modes": {"hz": (plant.omega / 2 / np.pi).tolist(), "damping": plant.damping.tolist()}}
        fixed = _posed(frf, known)
        if fixed.band is not None:
            ratio = float(np.median(radius / fixed.band.at(omega)[1][:, 0, 0]))
    return Verdict("band", *lines, modes, held, *band, ratio, note=missed)


class _Found(NamedTuple):
    run: Any
    band: Any


def _posed(frf: rid.FrequencyResponse, asked: dict[str, Any]) -> _Found:
    """The band of a run by default, without the small model and the semidefinite programs."""
    run, around = read_run_file(asked, "short_records", sources=False), Surroundings(None)
    run, problem, left = posed(run, Measured((frf,), ()), around)
    work = decided(run, problem, left, around)
    if not work.identification.consistent:
        return _Found(work.run, None)
    box = held_box(work.box, work.identification.problem)
    try:
        return _Found(work.run, rid.band(work.identification, box=box))
    except InconsistentDataError:
        return _Found(work.run, None)


def _held(plant: Plant, box: Any) -> tuple[int, int, str]:
    """Modes found, and how many of the boxes hold a true mode; and words on those that do not."""
    if box is None:
        return 0, 0, ""
    held, words = 0, []
    for (low, high), (light, heavy) in zip(*box, strict=True):
        inside = (low <= plant.omega) & (plant.omega <= high) & (light <= plant.damping) & (plant.damping <= heavy)
        held += bool(inside.any())
        near = np.argmin(np.abs(np.log(plant.omega / np.sqrt(low * high))))
        hz, name = 2 * np.pi, "" if inside.any() else "!"
        words.append(
            f"{name}{plant.omega[near] / hz:.4g}:{low / hz:.4g}..{high / hz:.4g} {plant.damping[near]:.2g}:{light:.2g}..{heavy:.2g}"
        )
    return len(box[0]), held, "; ".join(words)
