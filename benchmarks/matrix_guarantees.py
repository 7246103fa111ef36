"""Worst-case errors of matrices: processor seconds a frequency, beside every direction of every entry from the whole problem.

Run: OPENBLAS_NUM_THREADS=1 ROBUSTID_DATA=... python benchmarks/matrix_guarantees.py [--frequencies 60] [plant ...]
Plants: beam (measured, 2x2, the class of examples/beam_ring.toml), mirror (measured, 3x3, 62 lines, six modes), 2x2 and 4x4
(simulated, 60 Taylor coefficients, 60 lines). The slow way is timed at one frequency; its bounds are compared there.
"""

import argparse
import dataclasses
import tempfile
import time
from pathlib import Path

import numpy as np
from matrices import measurements

import robustid as rid
from robustid.guarantees.consistent_set import consistent_set, independent_entries
from robustid.guarantees.value_set import along, corners, directions_at

RTOL, DIRECTIONS = 0.1, 16


def beam():
    """The identification of the example's run file, which bounds its error itself."""
    text = (Path(__file__).parent.parent / "examples" / "beam_ring.toml").read_text()
    folder = Path(tempfile.mkdtemp())
    (folder / "ask.toml").write_text(text.split("[worst_case]")[0] + "[worst_case]\ncompute = false\n")
    return rid.run(folder / "ask.toml", folder / "beam").identification


def mirror():
    """Six modes of the steering mirror from 600 to 1345 Hz, bounds widened to what this class needs and a tenth more."""
    frf = rid.estimate_frf(rid.datasets.load("fsm/train"), period=8192)
    inside = frf.band(600, 1345)
    hz = np.array([636.44, 806.42, 921.46, 991.23, 1312.81, 1381.44])
    damping = np.array([1.05, 1.19, 1.22, 1.99, 1.03, 0.71]) / 100
    near = hz[:5, None] * (1 + damping[:5, None] * np.linspace(-3, 3, 7))
    wanted = np.concatenate([near.ravel(), np.linspace(600, 1345, 28)])
    used = inside.select(np.unique(np.argmin(np.abs(inside.freq_hz[:, None] - wanted), axis=0)))
    basis = rid.kautz(2 * np.pi * hz, damping, dt=frf.dt, delay=1)
    return with_room(used, rid.Prior(gain_bound=1e-5, decay_rate=1.15), basis)


def with_room(used, prior, basis):
    """The identification with bounds widened to what the class needs and a tenth more."""
    problem = rid.MixedProblem(frequency=used, prior=prior, parametric=basis)
    first = rid.identify(problem, accuracy=1e-2)
    wide = used.with_bound(used.bound.inflated(1.1 * max(first.margin, 1.0)))
    return rid.identify(dataclasses.replace(problem, frequency=wide), accuracy=1e-2)


def simulated(p, q):
    """A plant of two modes and a random smooth rest, with twice the bound that its noise needs."""
    problem = measurements(p, q, 60, 60)
    frf = problem.frequency[0]
    wide = dataclasses.replace(problem, frequency=frf.with_bound(frf.bound.inflated(2)))
    return rid.identify(wide, form="taylor")


PLANTS = {"beam": beam, "mirror": mirror, "2x2": lambda: simulated(2, 2), "4x4": lambda: simulated(4, 4)}


def slowly(result, omega, gap):
    """Seconds at one frequency for all directions of all entries from the whole problem; distances of the farthest corners."""
    here = consistent_set(result).with_node(omega)
    start, radii = time.process_time(), {}
    angles = directions_at(omega, result.problem.dt, DIRECTIONS)
    for entry in independent_entries(result.problem.entries):
        x, p, tail = here.value_weights(omega, entry)
        support = [here.extreme_of_all(along(angle, x, p, tail), gap).upper for angle in angles]
        centre = complex(x @ here.center.x + p @ here.center.p)
        radii[entry] = float(np.abs(corners(angles, np.array(support)) - centre).max())
    return time.process_time() - start, radii


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("plants", nargs="*", default=list(PLANTS), help=", ".join(PLANTS))
    parser.add_argument("--frequencies", type=int, default=60)
    arguments = parser.parse_args()
    print(
        f"{'plant':8}{'block':>7}{'samples':>9}{'sides':>7}{'CPU s':>8}{'intervals':>11}{'a frequency':>13}{'slowly':>8}"
        f"{'ratio':>7}{'gap':>7}{'gap sigma: median, largest':>29}{'corners':>15}"
    )
    for name in arguments.plants:
        result = PLANTS[name]()
        lines = np.concatenate([f.omega for f in result.problem.frequency])
        omega = np.linspace(lines.min(), lines.max(), arguments.frequencies + 2)[1:-1]
        start = time.process_time()
        error = rid.worst_case_error(result, omega=omega[:1], rtol=RTOL, directions=DIRECTIONS)
        one = time.process_time() - start
        start = time.process_time()
        error = rid.worst_case_error(result, omega=omega, rtol=RTOL, directions=DIRECTIONS)
        seconds = time.process_time() - start
        each = (seconds - one) / max(omega.size - 1, 1)
        slow, radii = slowly(result, float(omega[omega.size // 2]), RTOL / 5)
        here = consistent_set(result).with_node(float(omega[omega.size // 2]))
        ratios = []
        for entry, radius in radii.items():
            x, p, _ = here.value_weights(float(omega[omega.size // 2]), entry)
            centre = complex(x @ here.center.x + p @ here.center.p)
            ratios.append(error.of_entry(*entry)[omega.size // 2].farthest(centre)[0] / radius)
        gap, sigma = 1 - error.lower / error.upper, 1 - error.sigma_lower / error.sigma_upper
        data = consistent_set(result).data
        sides = np.mean([v.directions.size for v in error.values])
        certified = "certified" if error.certified else "NOT CERTIFIED"
        print(
            f"{name:8}{sum(data.sarason.shape):7}{data.rows.y.size:9}{sides:7.1f}{seconds:8.1f}{one - each:11.1f}{each:13.2f}"
            f"{slow:8.1f}{slow / each:7.1f}{100 * gap.max():6.1f}%{100 * np.median(sigma):21.1f}%{100 * sigma.max():6.1f}%"
            f"{min(ratios):9.3f} to {max(ratios):.3f}  {certified}",
            flush=True,
        )


if __name__ == "__main__":
    main()
