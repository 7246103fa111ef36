"""Scores of a watch over measured records: the steering mirror at two voltages, three experiments of it a record.

Run: ROBUSTID_DATA=FOLDER python benchmarks/watch_measured.py   # about four minutes

Every third line of the excitation from 400 to 2500 Hz would do; one in eight is taken. A band of one record holds its own noise
alone; a band of two, for the next record, holds what the piezo adds from one random phase to the next.
"""

from __future__ import annotations

import itertools
import os
from pathlib import Path

import numpy as np

import robustid as rid

LINES = np.arange(512, 3201, 8)
PERIOD = 8192


def records(voltage: int) -> dict[str, list[rid.TimeRecord]]:
    """Three groups of three experiments of a voltage, by name."""
    folder, found = Path(os.environ["ROBUSTID_DATA"]) / "fsm_cubespec", {}
    for part in ("train", "test"):
        u, y = (np.load(folder / f"{side}_{voltage}mV_{part}.npy") for side in "uy")
        for first in range(0, u.shape[2], 3):
            found[f"{voltage} mV {part} {first // 3 + 1}"] = [
                rid.TimeRecord(*(one[:, :, k].transpose(2, 0, 1).reshape(-1, 3) for one in (u, y)), dt=1 / 6400,
                               initial="periodic")
                for k in range(first, first + 3)
            ]  # fmt: skip
    return found


def response(groups: list[list[rid.TimeRecord]], about: str) -> rid.FrequencyResponse:
    """The response of some groups, with a bound of the mean or of the next record."""
    return rid.estimate_frf([one for group in groups for one in group], period=PERIOD, lines=LINES, about=about)


def main() -> None:
    """Print the scores of every record under bands of one, and of two, of its own voltage and of the other."""
    own = {voltage: records(voltage) for voltage in (200, 300)}
    single = {name: response([group], "mean") for groups in own.values() for name, group in groups.items()}
    for groups in own.values():
        for name in groups:
            watched = rid.watch(single[name])
            for other, one in single.items():
                watched = watched.update(one, other) if other != name else watched
            said = ", ".join(f"{one.name}: {one.score:.1f}" for one in watched.history)
            print(f"band of {name}: {said}; refuted by {len(watched.refuted)} of {len(watched.history)}", flush=True)
        for kept in itertools.combinations(groups, 2):
            watched = rid.watch(response([groups[name] for name in kept], "next record"))
            for other, one in single.items():
                watched = watched.update(one, other) if other not in kept else watched
            said = ", ".join(f"{one.name}: {one.score:.2f}" for one in watched.history)
            refuted = ", ".join(one.name for one in watched.refuted) or "none"
            print(f"band of {' and '.join(kept)}, next record: {said}; refuted by: {refuted}", flush=True)


if __name__ == "__main__":
    main()
