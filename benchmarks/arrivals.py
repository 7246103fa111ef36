"""Fits of orders that are not right: error at withheld points, cost and processor time beside the subspace estimate.

Run: OPENBLAS_NUM_THREADS=1 ROBUSTID_DATA=folder python benchmarks/arrivals.py [--sets fsm ...] [--orders 12 24] [--seeds 5].
Even frequency points are fitted with relative weights, odd ones judge: the truth of a stand-in (4x2, 40 modes of damping 0.3 to
3 %, 5 % noise), the measured response of a machine.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
sys.path.insert(0, str(Path(__file__).parent.parent / "examples"))
import robustid as rid
from robustid.mfd import Weight, subspace_estimate

ORDERS = (12, 24, 36, 48, 60)


def stand_in(seed, modes=40, lines=1000, noise=0.05):
    """Many light modes at 1 kHz: no order below 2*modes is right. The response to fit, the one to judge by."""
    rng = np.random.default_rng(seed)
    hz, damping = np.sort(rng.uniform(8, 480, modes)), rng.uniform(0.003, 0.03, modes)
    omega = 2 * np.pi * np.linspace(2, 495, 2 * lines)
    z, values = np.exp(1e-3j * omega), np.zeros((2 * lines, 4, 2), dtype=complex)
    for w, zeta in zip(2 * np.pi * hz, damping, strict=True):
        pole = np.exp((-zeta + 1j * np.sqrt(1 - zeta**2)) * w * 1e-3)
        residue = np.outer(rng.standard_normal(4), rng.standard_normal(2)) * (1 - abs(pole))
        residue = residue * np.exp(1j * rng.uniform(-0.1, 0.1))
        values += residue / (z - pole)[:, None, None] + residue.conj() / (z - pole.conj())[:, None, None]
    e = rng.standard_normal((2, *values.shape)) / np.sqrt(2)
    measured = values + noise * np.abs(values) * (e[0] + 1j * e[1])
    return rid.FrequencyResponse(omega[::2], measured[::2], dt=1e-3), rid.FrequencyResponse(
        omega[1::2], values[1::2], dt=1e-3
    )


def halves(frf):
    return frf.select(slice(0, None, 2)), frf.select(slice(1, None, 2))


def load(name, seeds):
    """Pairs of a response to fit and one to judge by."""
    if name == "stand-in":
        for seed in range(seeds):
            yield f"{name} {seed}", *stand_in(seed)
    elif name == "fsm":
        mirror = rid.estimate_frf(rid.datasets.load("fsm/train"), period=8192)
        yield name, *halves(mirror.select(slice(1, None, 4)))
    elif name == "beam_ring":
        import beam_mimo

        yield name, *halves(beam_mimo.beam()[0].select(slice(None, None, 4)))
    else:
        yield name, *halves(rid.estimate_frf(rid.datasets.load("cdplayer"), method="local"))


def row(train, test, order):
    """Costs of the fit and of the subspace estimate, errors of both at the withheld points, processor time."""
    begin = time.process_time()
    fit = rid.fit_mfd(train, order=order, weight=Weight.relative(train.values))
    seconds = time.process_time() - begin
    z = [np.exp(1j * frf.omega * frf.dt) for frf in (train, test)]
    peer = subspace_estimate(train.values, z[0], order, weight=1 / np.abs(train.values), domain="z")
    scale = np.abs(test.values)
    responses = (fit.fraction.response(test.omega), peer.response(z[1]))
    errors = [float(np.linalg.norm((H - test.values) / scale) / np.sqrt(scale.size)) for H in responses]
    residual = (peer.response(z[0]) - train.values) / np.abs(train.values)
    return fit, float(np.linalg.norm(residual) ** 2), *errors, seconds


def main():
    names = ("stand-in", "fsm", "beam_ring", "cdplayer")
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sets", nargs="+", choices=names, default=names)
    parser.add_argument("--orders", nargs="+", type=int, default=ORDERS)
    parser.add_argument("--seeds", type=int, default=5)
    arguments = parser.parse_args()
    ratios, slowest, rises = [], 0.0, 0
    for name in arguments.sets:
        for label, train, test in load(name, arguments.seeds):
            ny, nu = train.values.shape[1:]
            print(f"{label}: {ny}x{nu}, {train.omega.size} frequency points fitted, {test.omega.size} withheld")
            previous = np.inf
            for order in arguments.orders:
                fit, cost, error, other, seconds = row(train, test, order)
                ratios.append(error / other)
                slowest, rises, previous = max(slowest, seconds), rises + (fit.cost > previous), fit.cost
                print(
                    f"  order {order}: cost {fit.cost:.5g} (subspace {cost:.5g}), withheld {100 * error:.3g} %"
                    f" (subspace {100 * other:.3g} %, ratio {error / other:.3f}), {seconds:.1f} s CPU, {fit.status.name}"
                    f"{'' if fit.stable else ', UNSTABLE'}",
                    flush=True,
                )
    print(
        f"withheld error over that of the subspace estimate: {min(ratios):.3f} to {max(ratios):.3f}, median {np.median(ratios):.3f}"
    )
    print(f"slowest {slowest:.1f} s of processor time; the cost rose with the order {rises} times")


if __name__ == "__main__":
    main()
