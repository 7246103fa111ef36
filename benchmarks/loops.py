"""Plants in a loop at full size: truths at the edge of the class of R from their records, and controllers around the limit.

Run: OPENBLAS_NUM_THREADS=1 python benchmarks/loops.py truths 100, and: controllers 200 100 (ten of a machine; consistent plants of
each machine), and: bounds 800 (machines). Processor time; a line a machine as it is done. `truths` judges the bands of P, S, T, PS
and CS at 10^4 frequencies, and beside them what the same record says without the controller (the response from u to y, in a class
of stable plants). `bounds` counts how often bounds of lines fail that come from periods. `controllers` tries every verdict on the
true plant, on consistent plants and on the plant that is shown.
"""

import dataclasses
import logging
import sys
import time
from collections import Counter, defaultdict
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
import robustid as rid
from support.line_variances import PLACES, chance, of_loop
from support.loop_truths import judged, outside, recorded, response_of, unstable_poles

FREQUENCIES = 10_001
EACH = 10  # controllers of a machine
PERIODS = (2, 4, 10)  # of the records whose bounds are counted
KINDS = {0: "periodic, little noise", 1: "random, much noise"}


def truths(count):
    """Verdict on every machine, by the kind of its record."""
    found, spent = [], time.process_time()
    for seed in range(count):
        start = time.process_time()
        one = judged(seed, FREQUENCIES)
        found.append(one)
        print(
            f"{seed:4d}  poles {unstable_poles(recorded(seed).case)}  lines missed {one.missed:2d}"
            f"  farthest {max(one.far.values()):.4f}  peaks {one.over:.3f}  |  u to y: lines missed {one.open_missed:2d}"
            f"  outside {one.open_outside:6.1%}  gap {one.gap:.3f}  {time.process_time() - start:5.1f} s",
            flush=True,
        )
    for kind, name in KINDS.items():
        told(name, found[kind::2])
    told("all", found)
    print(f"{(time.process_time() - spent) / 60:.1f} minutes of processor time")


def told(name, found):
    kept = [one for one in found if not one.missed]
    lost = [one for one in found if one.missed]
    print(f"{name}: {len(found)} machines")
    print(
        f"    samples inside their bounds {len(kept)} ({len(kept) / max(len(found), 1):.0%}); of these P, S, T, PS, CS inside"
        f" at every frequency, and peaks, {sum(one.inside for one in kept)}, farthest"
        f" {max((max(one.far.values()) for one in kept), default=np.nan):.4f}"
    )
    print(
        f"    samples outside (at most {max((one.missed for one in lost), default=0)} lines) {len(lost)}; of these inside all"
        f" the same {sum(one.inside for one in lost)}, refuted {sum(not one.consistent for one in lost)}"
    )
    lines, refuted = [one.open_missed for one in found], [one.open_refuted for one in found]
    outside = [one.open_missed > 0 or one.open_refuted or one.open_outside > 0 for one in found]
    print(
        f"    from u to y: a line outside in {sum(n > 0 for n in lines)} ({sum(lines) / len(lines):.1f} lines each), class"
        f" refuted in {sum(refuted)}, P outside the band in {sum(one.open_outside > 0 for one in found)} (median"
        f" {np.median([one.open_outside for one in found]):.1%} of the frequencies), any of these in {sum(outside)};"
        f" gap of the model at least .98 in {sum(one.gap > 0.98 for one in found)}"
    )


def controllers(count, plants):
    """Verdicts on ten controllers of every machine."""
    from support.loop_candidates import tried

    found, spent = [], time.process_time()
    for seed in range(count // EACH):
        start = time.process_time()
        these = tried(seed, plants, EACH)
        found += these
        said = Counter(one.said for one in these)
        print(
            f"{seed:4d}  {dict(said)}  wrong {sum(one.wrong for one in these)}  plants {these[0].plants}"
            f"  {time.process_time() - start:5.1f} s",
            flush=True,
        )
    said = Counter(one.said for one in found)
    print(f"{len(found)} controllers: " + ", ".join(f"{name} {count}" for name, count in said.items()))
    print(f"    wrong {sum(one.wrong for one in found)}, undecided {said['undecided'] / len(found):.1%}")
    for name in said:
        these = [one for one in found if one.said == name]
        print(
            f"    {name}: the true loop is stable in {sum(one.truth for one in these)}, consistent plants destabilised by"
            f" {sum(one.unstable > 0 for one in these)} of the controllers ({sum(one.unstable for one in these)} of"
            f" {sum(one.plants for one in these)} loops)"
        )
    print(f"{(time.process_time() - spent) / 60:.1f} minutes of processor time")


def bounds(count):
    """How often bounds of the lines of periodic records fail, of R and of the response from u to y, by the number of periods.

    In simulated records, and exactly, given drawn scatter of lines whose variances are known.
    """
    from scipy.stats import beta

    failed, chances, spent = Counter(), defaultdict(list), time.process_time()
    for seed in range(600, 600 + count):
        case, record, how = recorded(seed, periodic=True)
        for periods in PERIODS:
            kept = slice(-periods * how["period"], None)
            one = dataclasses.replace(record, u=record.u[kept], y=record.y[kept], reference=record.reference[kept])
            responses = rid.prepare.loop_response(one, case.loop, **how), rid.estimate_frf(one, **how)
            for (name, lines), frf, true in zip(
                of_loop(seed).items(), responses, (case.residual, case.plant), strict=True
            ):
                failed[name, periods] += outside(frf, response_of(true, frf.omega)) > 0
                rng = np.random.default_rng([seed, periods])
                chances[name, periods] += [chance(*lines, PLACES, periods, rng) for _ in range(5)]
    for (name, periods), times in sorted(failed.items()):
        low, high = beta.ppf([0.025, 0.975], [times or 1e-9, times + 1], [count - times + 1, count - times])
        exact = np.reshape(chances[name, periods], (count, -1)).mean(axis=1)
        print(
            f"{name:6s} {periods:2d} periods: a line outside in {times} of {count}, {times / count:.1%} ({low:.1%} to {high:.1%});"
            f" of drawn scatter {exact.mean():.2%} +- {1.96 * exact.std() / np.sqrt(count):.2%}"
        )
    print(f"{(time.process_time() - spent) / 60:.1f} minutes of processor time")


def main():
    logging.disable(logging.WARNING)
    what, *counts = sys.argv[1:]
    {"truths": truths, "controllers": controllers, "bounds": bounds}[what](*map(int, counts))


if __name__ == "__main__":
    main()
