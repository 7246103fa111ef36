"""Which order: suggest_order on simulated plants with stated bounds, on the demo and on measured machines.

Run: OPENBLAS_NUM_THREADS=1 ROBUSTID_DATA=... python benchmarks/orders.py [--seeds 20]. Simulated: random structures of one to
five modes (tests/support/mfd_systems.py), errors anywhere in discs of one to three per cent that are stated as bounds.
"""

import argparse
import os
import pathlib
import sys
import time

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).parent.parent / "tests"))
import robustid as rid
from robustid.fitting import mode_table, suggest_order
from support.mfd_systems import random_modal_system

SHAPES = ((1, 1), (2, 1), (2, 2), (1, 1), (3, 2))


def simulated(seed):
    """A plant and its data: true order, response with bounds."""
    rng = np.random.default_rng([seed, 9])
    ny, nu = SHAPES[seed % len(SHAPES)]
    modes, level, lines = int(rng.integers(1, 6)), rng.uniform(0.01, 0.03), int(rng.integers(80, 300))
    omega = 2 * np.pi * np.geomspace(4, 1200, lines)
    truth = random_modal_system(seed, ny, nu, modes, band_hz=(8, 800)).response(1j * omega)
    radius = level * np.abs(truth)
    disc = np.sqrt(rng.uniform(size=truth.shape)) * np.exp(2j * np.pi * rng.uniform(size=truth.shape))
    return 2 * modes, rid.FrequencyResponse(omega, truth + radius * disc, bound=radius)


def measured():
    """Measured responses by name."""
    sys.path.insert(0, str(pathlib.Path(__file__).parent.parent / "examples"))
    import beam_mimo

    yield "beam_ring 2x2", beam_mimo.beam()[0].select(slice(None, None, 4))
    mirror = rid.estimate_frf(rid.datasets.load("fsm/train"), period=8192)
    yield "fsm 3x3", mirror.select(slice(1, None, 8))
    motor = rid.estimate_frf(rid.datasets.load("two_mass"), period=2500)
    yield "two_mass", motor


def told(name, frf, sweep, seconds):
    """One line and the modes of the order suggested."""
    fit = sweep.fits[sweep.suggested]
    low, high = frf.omega[frf.omega > 0].min() / (2 * np.pi), frf.omega.max() / (2 * np.pi)
    rows = [row for row in mode_table(fit.model) if not row.rigid and low <= row.hz <= high and 0 < row.damping < 0.1]
    least = min((row.damping for row in mode_table(fit.model) if not row.rigid), default=np.nan)
    print(f"{name}: order {sweep.suggested} {sweep.reason}; {len(rows)} light modes in the band,", end=" ")
    print(f"smallest damping {least:.2g}, orders {list(map(int, sweep.orders))}, {seconds:.1f} s CPU", flush=True)
    print("   " + ", ".join(f"{row.hz:.4g} Hz {100 * row.damping:.3g} %" for row in rows))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20)
    arguments = parser.parse_args()
    hits, worst = 0, 0.0
    for seed in range(arguments.seeds):
        order, frf = simulated(seed)
        begin = time.process_time()
        sweep = suggest_order(frf)
        hits += sweep.suggested == order
        worst = max(worst, sweep.suggested / order)
        shape, seconds = frf.values.shape, time.process_time() - begin
        print(
            f"seed {seed:2d} {shape[1]}x{shape[2]} {shape[0]:3d} points: true {order}, suggested {sweep.suggested}",
            end="",
        )
        print(f" ({sweep.reason}), {seconds:.1f} s CPU", flush=True)
    print(f"true order in {hits} of {arguments.seeds}; largest ratio {worst:.2f}")
    if os.environ.get("ROBUSTID_DATA"):
        for name, frf in measured():
            begin = time.process_time()
            told(name, frf, suggest_order(frf), time.process_time() - begin)


if __name__ == "__main__":
    main()
