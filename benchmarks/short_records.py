"""Short noisy records of lightly damped plants: how often each link of the default holds, from the response to the band.

Run: OPENBLAS_NUM_THREADS=1 python benchmarks/short_records.py [half | 2 | 5 | 20 ...] [--seeds 40] [--no-ratio]
"""

import argparse
import sys
import time
import traceback
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

from support.short_records import judged, record_of


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("lengths", nargs="*", default=["half"])
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--no-ratio", action="store_true")
    asked = parser.parse_args()
    for length in asked.lengths:
        report(length, range(asked.first, asked.first + asked.seeds), not asked.no_ratio)


def report(length, seeds, compare):
    constants = None if length == "half" else float(length)
    print("half a second" if constants is None else f"{length} time constants of the lightest mode")
    every = []
    for seed in seeds:
        start = time.process_time()
        plant, record, words = record_of(seed, constants)
        try:
            found = judged(plant, record, compare=compare)
        except Exception as error:
            traceback.print_exc(limit=-2)
            print(f"{seed:3d} {words}: {type(error).__name__}: {error}", flush=True)
            continue
        every.append(found)
        said = (
            f"lines {found.lines:5.2f} ({100 * found.lines_outside:4.1f} % outside), boxes {found.held}/{found.found}"
        )
        if found.band is not None:
            said += (
                f", band {found.band:5.2f} ({100 * found.band_outside:4.1f} % outside), width {100 * found.width:.3g} %"
            )
            said += "" if found.ratio is None else f", {found.ratio:.2f} times that of the true poles"
        print(
            f"{seed:3d} {words}: {found.said}, {said}; {time.process_time() - start:.1f} s  [{found.note}]", flush=True
        )
    there = [v for v in every if v.band is not None]
    ratios = [v.ratio for v in there if v.ratio is not None]
    count = len(every)
    print(f"  bound of the response holds: {sum(v.lines <= 1 for v in every)} of {count}")
    print(f"  boxes that hold a mode: {sum(v.held for v in every)} of {sum(v.found for v in every)}")
    print(f"  all boxes hold: {sum(v.held == v.found for v in every)} of {count}")
    print(f"  three modes: {sum(v.found == 3 for v in every)}; none: {sum(v.found == 0 for v in every)}")
    finite = [v for v in there if np.isfinite(v.width)]
    print(f"  a band: {len(there)}, finite: {len(finite)}; that holds: {sum(v.band <= 1 for v in finite)}")
    if ratios:
        most = sum(r <= 2 for r in ratios)
        print(
            f"  width over that of the true poles: median {np.median(ratios):.2f}, at most 2: {most} of {len(ratios)}"
        )


if __name__ == "__main__":
    main()
