"""Distances of plants in a loop: the nu-gap and the coprime factor margin, against a grid of frequencies.

Run: OPENBLAS_NUM_THREADS=1 python benchmarks/distances.py. Random plants with unstable poles; processor time, median of many calls
(best of three of 2000-point grids of the formula, which is the obvious way and knows no winding number and nothing between
its points). `short`: what the grid's maximum lacks.

distances.py gains 480: pairs whose gain is 1e-8 or 1e8, against the formula by singular values on 3000 frequencies, the best of
them refined, and the winding number by the phase of a determinant.
"""

import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
import robustid as rid
from robustid.core import StateMatrices
from robustid.errors import InputError
from support.loop_distances import chordal, margin_gain
from support.loop_extremes import extreme, gap_by_svd
from support.loops import as_model, controller_of, plant_of

SIZES = ((1, 4), (5, 20), (3, 40))
CALLS, GRIDS = 101, 3


def milliseconds(call, count):
    """Median processor time, after a first call."""
    result, spent = call(), []
    for _ in range(count):
        start = time.process_time()
        call()
        spent.append(time.process_time() - start)
    return result, 1e3 * float(np.median(spent))


def points(dt):
    return np.exp(1j * np.linspace(0, np.pi, 2000)) if dt else 1j * np.geomspace(1e-3, 1e3, 2000)


def rows(dt):
    """Name of the distance, size, order, milliseconds, those of the grid, what the grid lacks."""
    for size, order in SIZES:
        rng = np.random.default_rng([order, size])
        first = plant_of(rng, order, size, size, dt)
        second = StateMatrices(*(part * (1 + 1e-2 * rng.standard_normal(part.shape)) for part in first))
        controller = controller_of(first, dt)
        one, two, three = (as_model(system, dt) for system in (first, second, controller))
        calls = {
            "nu-gap": (lambda p=one, q=two: rid.guarantee.nu_gap(p, q).value, chordal, second),
            "margin": (lambda p=one, c=three: 1 / rid.guarantee.ncf_margin(p, c).value, margin_gain, controller),
        }
        for name, (call, formula, other) in calls.items():
            value, own = milliseconds(call, CALLS)
            grid, its = milliseconds(lambda f=formula, p=first, o=other: f(p, o, points(dt)).max(), GRIDS)
            yield name, f"{size}x{size}", order, own, its, 1 - grid / value
        _, own = milliseconds(lambda p=one: rid.guarantee.coprime(p), CALLS)
        yield "coprime", f"{size}x{size}", order, own, np.nan, np.nan


def gains(count, start=0):
    """Every answer beside the brute force."""
    apart, refused = [], []
    for seed in range(start, count):
        first, second, dt = extreme(seed)
        try:
            found = rid.guarantee.nu_gap(as_model(first, dt), as_model(second, dt)).value
        except InputError:
            refused.append(seed)
            continue
        true = gap_by_svd(first, second, dt)
        apart.append((abs(found - true) / true, seed, found, true))
        print(f"{seed:6d} {apart[-1][0]:.1e}  {found:.12g} for {true:.12g}", flush=True)
    apart.sort(reverse=True)
    print(f"{count} pairs, {len(refused)} refused {refused[:20]}; farthest from brute force, relative:")
    for far, seed, found, true in apart[:8]:
        print(f"{seed:6d} {far:.1e}  {found:.12g} for {true:.12g}")


def main():
    if sys.argv[1:2] == ["gains"]:
        gains(*map(int, sys.argv[2:]))
        return
    for dt in (0.0, 0.1):
        print("discrete time" if dt else "continuous time")
        print(f"{'':10}{'size':>5}{'order':>7}{'ms':>8}{'grid ms':>10}{'ratio':>8}{'short':>10}")
        for name, size, order, own, grid, short in rows(dt):
            print(f"{name:10}{size:>5}{order:7}{own:8.2f}{grid:10.1f}{grid / own:8.1f}{short:10.1e}", flush=True)


if __name__ == "__main__":
    main()
