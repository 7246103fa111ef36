"""Whole runs by default, from a response to all that its page says: seconds at which every step begins, and what is proved.

Run: OPENBLAS_NUM_THREADS=1 ROBUSTID_DATA=... python benchmarks/whole_runs.py [CASE ...] [--gap]
Processor seconds of one process; nothing is stated but the response. With --gap (one entry; minutes more): how far the proved error
is above that of systems that are consistent, poles in their box, which are sought by semidefinite programs at several poles.
"""

import argparse
import dataclasses
import itertools
import time

import numpy as np
from band_problems import beam_halves, beam_problem, mirror_halves, mirror_response, motor_halves, one_entry, part_of

import robustid as rid
from robustid.guarantees.refinement import in_order

BETWEEN = 9  # frequency points at which the gap is taken, besides that of the largest error
PERIOD = 8192  # samples of the excitation of the mirror
QUIET = 2000  # samples of a sweep before it begins
PARTS = (1.0, 0.6, 0.3)  # of the way from the middle of the box to its border: the first whose poles are consistent
NEAREST, STEPS = 3, (0.5, 0.25, 0.12, 0.06)  # modes that are moved, and the parts of the way by which they are

CASES = {
    "entry": lambda: one_entry(60, [77.0], [0.017])[0].frequency[0],
    "motor": lambda: motor_halves()[0],
    "beam": lambda: part_of(beam_problem().frequency[0], [0], [0]),
    "mirror": lambda: mirror_response(part=([0], [0])),
    "beam_2x2": lambda: beam_problem().frequency[0],
    "mirror_3x3": mirror_response,
    "beam_2x2_half": lambda: beam_halves()[0],
    "beam_2x2_other": lambda: beam_halves()[1],
    "beam_2x2_noise": lambda: noisier_beam(3.0),
    "mirror_3x3_noise": lambda: noisier_mirror(3.0),
    "mirror_3x3_half": lambda: mirror_halves("fsm/train")[0],
    "mirror_3x3_other": lambda: mirror_halves("fsm/train")[1],
}


def noisier_beam(times):
    """The response of the beam from its sweeps with so many times the noise that is there before they begin."""
    rng, records = np.random.default_rng(0), []
    for record in rid.datasets.load("beam_ring"):
        noise = record.y[:QUIET].std(axis=0) * np.sqrt(times**2 - 1)
        y = record.y + noise * rng.standard_normal(record.y.shape)
        records.append(rid.prepare.decimate(dataclasses.replace(record, y=y), 5))
    return rid.estimate_frf(records).band(8, 70).select(slice(None, None, 8))


def noisier_mirror(times):
    """The response of the mirror from its records with so many times the noise that both periods of each differ by.

    What is added has its spectrum, another one for each period, and its correlation between the outputs.
    """
    rng, records = np.random.default_rng(0), []
    for record in rid.datasets.load("fsm/train"):
        first, second = record.y.reshape(2, PERIOD, -1)
        noise = np.fft.rfft((first - second) / np.sqrt(2), axis=0) * np.sqrt(times**2 - 1)
        turned = [noise * np.exp(2j * np.pi * rng.random((len(noise), 1))) for _ in range(2)]
        added = np.concatenate([np.fft.irfft(one, PERIOD, axis=0) for one in turned])
        records.append(dataclasses.replace(record, y=record.y + added))
    return rid.estimate_frf(records, period=PERIOD).band(500, 1700)


def run(name, gap=False):
    frf = CASES[name]()
    start, last = time.process_time(), None
    print(f"{name}: {frf.omega.size} lines, {frf.values.shape[1]}x{frf.values.shape[2]}")

    def told(text, done, count):
        nonlocal last
        if text != last:
            print(f"  {time.process_time() - start:7.1f} {text}", flush=True)
            last = text

    found = rid.identify_reduced(frf, progress=told)
    print(f"  {time.process_time() - start:7.1f} end: {found!r}")
    if found.unfinished is not None:
        print(f"  {found.unfinished.word}: {found.unfinished.sentence}")
    if found.wider is not None:
        print(f"  with every bound {found.wider.factor:.4g} times as large: {found.wider.band.summary()}")
    if found.band is not None:
        print(f"  {found.band.summary()}")
        if gap and found.band.problem.entries.single:
            told_gap(found.band)


def at_poles(band, omega, damping, frequencies):
    """Largest errors at frequencies of systems with these poles that are consistent; None where none is."""
    problem = band.problem
    if band.box is not None:
        delay = in_order(problem, band.box)[2]
        problem = dataclasses.replace(problem, parametric=rid.kautz(omega, damping, dt=problem.dt, delay=delay))
    result = rid.identify(problem)
    if not result.consistent:
        return None
    return rid.worst_case_error(result, model=band.model, omega=frequencies, directions=8, rtol=0.05).lower[:, 0, 0]


def reached(band, frequencies):
    """Largest errors of consistent systems that were found: poles of the nearest mode on a grid of its box, then moved further.

    From the best of the grid one side of the box after the other, of the modes nearest in frequency, in steps that become smaller.
    """
    if band.box is None:
        return at_poles(band, None, None, frequencies)
    ends = np.stack(band.box)  # (2, M, 2)
    middle, half = ends.mean(axis=2), np.diff(ends, axis=2)[:, :, 0] / 2

    def error(place, at):
        lower = at_poles(band, *(middle + place * half), at)
        return np.full(at.size, -1.0) if lower is None else lower

    nearest = np.argmin(np.abs(np.log(frequencies[:, None] / middle[0])), axis=1)
    best, places = np.full(frequencies.size, -1.0), np.zeros((frequencies.size, *middle.shape))
    for mode in np.unique(nearest).tolist():
        mine = np.flatnonzero(nearest == mode)
        for way in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)):
            for part in PARTS if any(way) else (0.0,):
                place = np.zeros(middle.shape)
                place[:, mode] = part * np.array(way)
                lower = error(place, frequencies[mine])
                more = mine[lower > best[mine]]
                best[more], places[more] = lower[lower > best[mine]], place
                if np.all(lower >= 0):
                    break
    for k, w in enumerate(frequencies.tolist()):
        modes = np.argsort(np.abs(np.log(w / middle[0])))[:NEAREST]
        for step in STEPS:
            for mode, side, sign in itertools.product(modes.tolist(), (0, 1), (1, -1)):
                place = places[k].copy()
                place[side, mode] = np.clip(place[side, mode] + sign * step, -1, 1)
                if not np.array_equal(place, places[k]) and (found := error(place, np.array([w]))[0]) > best[k]:
                    best[k], places[k] = found, place
    return np.maximum(best, 0)


def told_gap(band):
    """Print how far the proved errors are above those of consistent systems: where the proved one is largest, and elsewhere."""
    start, lines = time.process_time(), band.problem.frequency[0].omega
    largest = band.omega[int(np.argmax(np.where(band.bounded, band.sigma_upper, -1.0)))]
    others = lines[np.unique(np.linspace(0, lines.size - 1, BETWEEN).astype(int))]
    frequencies = np.union1d(others, largest)
    upper, lower = band.error_at(frequencies)[:, 0, 0], reached(band, frequencies)
    missing = 100 * (1 - lower / upper)
    at = frequencies == largest
    print(
        f"  gap        {missing[at].item():.1f} % where it is largest, {largest / (2 * np.pi):.5g} Hz: proved"
        f" {upper[at].item():.4g}, a consistent system reaches {lower[at].item():.4g}; in the median of {others.size} points"
        f" {np.median(missing):.1f} % ({missing.min():.1f} to {missing.max():.1f} %); {time.process_time() - start:.0f} s",
        flush=True,
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("cases", nargs="*", metavar="CASE")
    parser.add_argument(
        "--gap", action="store_true", help="how far the proved error is above that of consistent systems"
    )
    asked = parser.parse_args()
    for case in asked.cases or CASES:
        run(case, asked.gap)
