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
from robustid.fitting import Weight, subspace_estimate
from support.mfd_systems import stand_in

ORDERS = (12, 24, 36, 48, 60)


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
