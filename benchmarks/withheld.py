"""Verdicts of withheld data on true bands and on bands that are three times too narrow, whole cases from records to the verdict.

Run: OPENBLAS_NUM_THREADS=1 python benchmarks/withheld.py [100] [--only records/scaled ...]

Three times too narrow, see tests/support/withheld_cases.py: the largest error of the band over the frequencies of the withheld data
is three times the radius claimed there: all radii are smaller by one factor (scaled), or the plant is another one (moved).
"""

import argparse
import sys
from collections import Counter
from pathlib import Path

import numpy as np

import robustid as rid
from robustid.core import one_thread

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

from support.withheld_cases import KINDS, case

CASES = [f"{kind}/{how}" for how in ("scaled", "moved") for kind in KINDS if (kind, how) != ("lines", "moved")]
MOST = 0.05  # of the bands that are too narrow may be called supported
POWERS = ((0, 0.05), (0.05, 0.5), (0.5, 0.95), (0.95, 1.001))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("count", type=int, nargs="?", default=100)
    parser.add_argument("--only", nargs="*", default=CASES, choices=CASES)
    arguments = parser.parse_args()
    shown = []
    for name in arguments.only:
        kind, how = name.split("/")
        said, narrow, allowed, outside, inside = Counter(), Counter(), 0.0, 0, []
        for seed in range(arguments.count):
            with one_thread():
                one = case(kind, seed, how)
                true = rid.coverage(one.band, one.withheld, kind=kind)
                wrong = rid.coverage(one.narrow, one.of_narrow, kind=kind)
            said[true.judgement.value] += 1
            narrow[wrong.judgement.value] += 1
            allowed, outside = allowed + true.false_alarm, outside + (not one.holds)
            shown.append((wrong.power, wrong.contradicted))
            inside.append(true.power)
        held = narrow["supported"] <= MOST * arguments.count and said["contradicted"] <= allowed
        print(
            f"{name:16} true bands: {words(said)} (stated: at most {allowed:.1f} contradicted; truth outside {outside});"
            f" power quartiles {' '.join(f'{q:.2f}' for q in np.quantile(inside, [0, 0.25, 0.5, 0.75, 1]))}\n"
            f"{'':16} three times too narrow: {words(narrow)}; {'held' if held else 'MISSED'}",
            flush=True,
        )
    print("\nthree times too narrow, by the power that was computed: how often it was contradicted")
    for low, high in POWERS:
        hits = [hit for power, hit in shown if low <= power < high]
        if hits:
            print(
                f"  power {low:4.2f} to {min(high, 1):4.2f}: {sum(hits)} of {len(hits)} ({100 * np.mean(hits):.0f} %)"
            )


def words(said):
    return ", ".join(f"{name} {said[name]}" for name in ("supported", "not tested", "contradicted"))


if __name__ == "__main__":
    main()
