"""Catalogue of faults: which are named, with which correction, and what clean data are told; a table for the documentation.

Run: OPENBLAS_NUM_THREADS=1 ROBUSTID_DATA=... python benchmarks/faults.py [--plants stage arm ...] [--only "spike (random)" ...]
     [--clean 200] [--short 1000] [--csv docs/recorded/faults.csv]
     OPENBLAS_NUM_THREADS=1 ROBUSTID_DATA=... python benchmarks/faults.py --runs [--told 20]
"""

import argparse
import csv
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent / "tests")]

from support.fault_judge import STRENGTHS, catalogue, faulty_of, found_faults, judged  # noqa: E402
from support.fault_plants import MEASURED, SIMULATED, measured, short, simulated  # noqa: E402
from support.fault_runs import of_clean, ran  # noqa: E402


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plants", nargs="*", default=[*SIMULATED, *MEASURED])
    parser.add_argument("--only", nargs="*")
    parser.add_argument("--strengths", nargs="*", default=STRENGTHS)
    parser.add_argument("--clean", type=int, default=5, help="seeds of clean data")
    parser.add_argument("--short", type=int, default=20, help="clean short records")
    parser.add_argument("--csv", type=Path, help="the table as the documentation shows it")
    parser.add_argument("--runs", action="store_true", help="whole runs of what nothing is told, and of clean data")
    parser.add_argument("--told", type=int, default=0, help="whole runs of so many that are told of a fault, too")
    parser.add_argument("-v", action="store_true", help="what was found of every case")
    arguments = parser.parse_args()
    plants = {name: simulated(name) if name in SIMULATED else measured(name) for name in arguments.plants}
    if arguments.runs:
        whole_runs(arguments, plants)
    else:
        table(arguments, plants)
        clean_data(arguments, plants)


def cases(names, strengths, plants):
    """Name, strength, plant and judgement of every case, and the seconds that it took."""
    for name in names:
        for strength in strengths:
            for plant, clean in plants.items():
                start = time.process_time()
                found = judged(catalogue()[name], clean, strength)
                if found is not None:
                    yield name, strength, plant, found, time.process_time() - start


def table(arguments, plants):
    """What is named, fault by fault."""
    said, rows = {strength: Counter() for strength in STRENGTHS}, [["Fault", *STRENGTHS]]
    for name in arguments.only or catalogue():
        row = {strength: Counter() for strength in STRENGTHS}
        for _, strength, plant, found, seconds in cases([name], arguments.strengths, plants):
            row[strength][found.outcome] += 1
            said[strength][found.outcome] += 1
            if arguments.v:
                print(
                    f"    {name}, {strength}, {plant}: {found.outcome} ({seconds:.1f} s)", *found.said, sep="\n        "
                )
        cells = [" ".join(f"{count} {outcome}" for outcome, count in counts.items()) for counts in row.values()]
        rows.append([name, *(cell.replace("other", "otherwise") or "–" for cell in cells)])
        print(f"{name:42} " + " | ".join(f"{cell:34}" for cell in cells), flush=True)
    for strength, counts in said.items():
        total = sum(counts.values())
        print(f"{strength}: {total} cases, " + ", ".join(f"{count} {outcome}" for outcome, count in counts.items()))
    if arguments.csv is not None:
        with arguments.csv.open("w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows(rows)


def clean_data(arguments, plants):
    """What clean measurements are told."""
    told = Counter()
    for seed in range(arguments.clean):
        for plant in (p for p in arguments.plants if p in SIMULATED):
            found = found_faults(simulated(plant, 1000 + seed))
            told["clean"] += 1
            told["told"] += bool(found)
            for one in found:
                print(f"    clean {plant}, seed {1000 + seed}: {one}", flush=True)
    for plant in (p for p in arguments.plants if p in MEASURED):
        for one in found_faults(plants[plant]):
            print(f"    measured {plant}: {one}")
    print(f"clean: {told['told']} of {told['clean']} sets told of a fault")
    short_records(arguments.short)


def short_records(count):
    """What clean short records are told."""
    drawn, told = Counter(), Counter()
    for seed in range(count):
        clean = short(seed)
        found = found_faults(clean)
        drawn[clean.name] += 1
        told[clean.name] += bool(found)
        for one in found:
            print(f"    {clean.name}, seed {seed}: {one}", flush=True)
    for name, number in drawn.items():
        print(f"{name}: {told[name]} of {number} records told of a fault")


def whole_runs(arguments, plants):
    """Verdicts of whole runs of what nothing is told (at the limit where the plant is known), of a part of the rest, and of clean
    measurements.
    """
    outcomes, told, rest = {}, [], []
    for name, strength, plant, found, _ in cases(arguments.only or catalogue(), arguments.strengths, plants):
        if strength == "clear" or (strength == "limit" and plants[plant].plant is not None):
            (rest if found.outcome == "silent" else told).append((name, strength, plant, found.outcome))
    rng = np.random.default_rng(0)
    sample = [told[k] for k in sorted(rng.choice(len(told), min(arguments.told, len(told)), replace=False))]
    for name, strength, plant, outcome in sorted(rest, key=lambda case: STRENGTHS.index(case[1])) + sample:
        faulty = faulty_of(catalogue()[name], plants[plant], strength)
        kind = f"{strength}, {'silent' if outcome == 'silent' else 'told'}"
        _run(outcomes, kind, f"{name}, {strength}, {plant} ({outcome})", faulty, plants[plant])
    for plant, clean in plants.items():
        for what, faulty in of_clean(clean).items() if arguments.clean else ():
            _run(outcomes, "clean", f"{what}, {plant}", faulty, clean)
    for kind, counts in outcomes.items():
        print(f"{kind}: {counts.total()} runs, " + ", ".join(f"{n} {outcome}" for outcome, n in counts.items()))


def _run(outcomes, kind, words, faulty, clean):
    start = time.process_time()
    found = ran(faulty, clean)
    outcomes.setdefault(kind, Counter())[found.outcome] += 1
    far = (
        ""
        if found.distance is None
        else f", {found.distance:.3g} of the band at {found.hz:.5g} Hz, {found.beyond:.3g} beyond"
    )
    print(f"{words}: {found.outcome}{far} ({time.process_time() - start:.0f} s)\n    {found.verdict}", flush=True)


if __name__ == "__main__":
    main()
