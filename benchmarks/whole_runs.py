"""Whole runs by default, from a response to all that its page says: seconds at which every step begins, and what is proved.

Run: OPENBLAS_NUM_THREADS=1 ROBUSTID_DATA=... python benchmarks/whole_runs.py [entry motor beam mirror beam_2x2 mirror_3x3]
Processor seconds of one process; nothing is stated but the response.
"""

import argparse
import time

from band_problems import beam_problem, mirror_response, motor_halves, one_entry, part_of

import robustid as rid

CASES = {
    "entry": lambda: one_entry(60, [77.0], [0.017])[0].frequency[0],
    "motor": lambda: motor_halves()[0],
    "beam": lambda: part_of(beam_problem().frequency[0], [0], [0]),
    "mirror": lambda: mirror_response(part=([0], [0])),
    "beam_2x2": lambda: beam_problem().frequency[0],
    "mirror_3x3": mirror_response,
}


def run(name):
    frf = CASES[name]()
    start, last = time.process_time(), None
    print(f"{name}: {frf.omega.size} lines, {frf.values.shape[1]}x{frf.values.shape[2]}")

    def told(text, done, count):
        nonlocal last
        if text != last:
            print(f"  {time.process_time() - start:7.1f} {text}", flush=True)
            last = text

    found = rid.identify_reduced(frf, progress=told)
    print(f"  {time.process_time() - start:7.1f} end: {found!r}")
    if found.unfinished is not None:
        print(f"  {found.unfinished.word}: {found.unfinished.sentence}")
    if found.wider is not None:
        print(f"  with every bound {found.wider.factor:.4g} times as large: {found.wider.band.summary()}")
    if found.band is not None:
        print(f"  {found.band.summary()}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("cases", nargs="*", metavar="CASE")
    for case in parser.parse_args().cases or CASES:
        run(case)
