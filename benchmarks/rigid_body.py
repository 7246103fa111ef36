"""Rigid-body modes at size: seconds, memory, conditioning and error, with the rigid body kept exact and without.

Run: OPENBLAS_NUM_THREADS=2 python benchmarks/rigid_body.py --modes 38 --lines 5000 (order 82, the wafer stage of
examples/wafer_stage.py from 0.5 Hz to a third above its highest mode, 1 % noise at every line). The unconstrained fit
starts from the constrained model.
"""

import argparse
import resource
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "examples"))
from wafer_stage import errors, measure, stage

import robustid as rid


def clock(work):
    """Result, seconds on the wall, processor seconds."""
    wall, processor = time.perf_counter(), time.process_time()
    return work(), time.perf_counter() - wall, time.process_time() - processor


def peak_gigabytes():
    """Of the whole run up to now: it never falls."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


def row(name, fit, wall, processor, truth, omega, bands):
    """One line of the table."""
    kappa = max(fit.condition_numbers, default=1.0) - 1
    values = "".join(f"{error:10.1e}" for error in errors(fit.fraction.response(omega), truth, omega, bands))
    slow = ", ".join(f"{pole:.2f}" for pole in np.sort(np.abs(fit.fraction.poles))[:7])
    unstable = int(np.sum(fit.fraction.poles.real > 0))
    print(
        f"{name:20}{wall:8.1f}{processor:8.1f}{peak_gigabytes():7.2f}{len(fit.history):6d}{kappa:9.0e}{fit.cost:12.6g}"
        f"{fit.fraction.error:9.0e}{unstable:9d}{values}\n{'':20}{fit.status.value}; slowest |pole| {slow} rad/s",
        flush=True,
    )


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--modes", type=int, default=9, help="flexible modes; order = 2 (modes + 3)")
    parser.add_argument("--lines", type=int, default=600)
    arguments = parser.parse_args(argv)
    plant, frequency = stage(arguments.modes)
    top = frequency[-1] / (2 * np.pi) * 4 / 3
    omega, order = 2 * np.pi * np.geomspace(0.5, top, arguments.lines), 2 * arguments.modes + 6
    truth = plant(omega)
    sigma = 0.01 * np.abs(truth)
    frf, weight = rid.FrequencyResponse(omega, measure(truth, sigma, seed=0)), rid.fits.Weight(1 / sigma)
    bands = [(2 * np.pi * a, 2 * np.pi * b) for a, b in ((0.5, 5), (5, 50), (50, top))]

    print(
        f"4x4, order {order}, {arguments.lines} lines from 0.5 to {top:.0f} Hz, 1 % noise; 16 terms of cost 1 per line"
    )
    print(
        f"{'':20}{'wall s':>8}{'CPU s':>8}{'GB':>7}{'steps':>6}{'kappa-1':>9}{'cost':>12}{'realised':>9}{'unstable':>9}"
        f"{'0.5-5 Hz':>10}{'5-50 Hz':>10}{'above':>10}"
    )
    rigid, *times = clock(lambda: rid.fit_mfd(frf, order=order, weight=weight, rigid_body=rid.RigidBody(3)))
    row("rigid body", rigid, *times, truth, omega, bands)
    print(f"{'':20}piezo in the directions found: {np.abs(rigid.rigid_directions[:, 3]).max():.1e} (truth: 0)")
    free, *times = clock(lambda: rid.fit_mfd(frf, order=order, weight=weight, start=rigid.model, stable=False))
    row("unconstrained, warm", free, *times, truth, omega, bands)


if __name__ == "__main__":
    main()
