"""Catalogue of faults: which are named, with which correction, and what clean data are told; a table for the documentation.

Run: OPENBLAS_NUM_THREADS=1 ROBUSTID_DATA=... python benchmarks/faults.py [--plants stage arm ...] [--only "spike (random)" ...]
     [--clean 200] [--csv docs/recorded/faults.csv]
"""

import argparse
import csv
import sys
import time
from collections import Counter
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent / "tests")]

from support.fault_judge import STRENGTHS, catalogue, found_faults, judged  # noqa: E402
from support.fault_plants import MEASURED, SIMULATED, measured, simulated  # noqa: E402


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plants", nargs="*", default=[*SIMULATED, *MEASURED])
    parser.add_argument("--only", nargs="*")
    parser.add_argument("--clean", type=int, default=5, help="seeds of clean data")
    parser.add_argument("--csv", type=Path, help="the table as the documentation shows it")
    parser.add_argument("-v", action="store_true", help="what was found of every case")
    arguments = parser.parse_args()
    plants = {name: simulated(name) if name in SIMULATED else measured(name) for name in arguments.plants}
    known = catalogue()
    said, table = {strength: Counter() for strength in STRENGTHS}, [["Fault", *STRENGTHS]]
    for name in arguments.only or known:
        row = []
        for strength in STRENGTHS:
            outcomes = []
            for plant, clean in plants.items():
                start = time.process_time()
                found = judged(known[name], clean, strength)
                if found is None:
                    continue
                outcomes.append(found.outcome)
                said[strength][found.outcome] += 1
                if arguments.v:
                    print(f"    {name}, {strength}, {plant}: {found.outcome} ({time.process_time() - start:.1f} s)")
                    for words in found.said:
                        print(f"        {words}")
            row.append(" ".join(f"{count} {outcome}" for outcome, count in Counter(outcomes).items()))
        table.append([name, *(cell.replace("other", "otherwise") or "–" for cell in row)])
        print(f"{name:42} " + " | ".join(f"{cell:34}" for cell in row), flush=True)
    for strength, counts in said.items():
        total = sum(counts.values())
        print(f"{strength}: {total} cases, " + ", ".join(f"{count} {outcome}" for outcome, count in counts.items()))
    if arguments.csv is not None:
        with arguments.csv.open("w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows(table)
    told = Counter()
    for seed in range(arguments.clean):
        for plant in (p for p in arguments.plants if p in SIMULATED):
            found = found_faults(simulated(plant, 1000 + seed))
            told["clean"] += 1
            told["told"] += bool(found)
            for one in found:
                print(f"    clean {plant}, seed {1000 + seed}: {one}")
    for plant in (p for p in arguments.plants if p in MEASURED):
        for one in found_faults(plants[plant]):
            print(f"    measured {plant}: {one}")
    print(f"clean: {told['told']} of {told['clean']} sets told of a fault")


if __name__ == "__main__":
    main()
