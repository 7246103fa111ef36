"""Scores of a watch over measured records: the steering mirror at two voltages, three experiments of it a record, or one.

Run: ROBUSTID_DATA=FOLDER python benchmarks/watch_measured.py   # about six minutes

Every third line of the excitation from 400 to 2500 Hz would do; one in eight is taken. A band of three experiments holds its own
noise alone; a band of two such records, for the next one, holds what the piezo adds from one random phase to the next. By the local
method a single experiment, all inputs at the same time, is a record: nine of each voltage, and neighbouring lines show what the
piezo adds. Its false alarms are counted in random orders of the nine: rearrangements of one data set, not new records.
"""

from __future__ import annotations

import dataclasses
import itertools
import os
from pathlib import Path

import numpy as np

import robustid as rid
from robustid.guarantees.drift import drift

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


def experiments(voltage: int) -> list[rid.FrequencyResponse]:
    """The responses of the nine experiments of a voltage, each alone, by the local method."""
    alone = [dataclasses.replace(one, initial="free") for group in records(voltage).values() for one in group]
    return [rid.estimate_frf(one, method="local", lines=2 * LINES) for one in alone]


def by_experiments(orders: int = 200) -> None:
    """Print scores of every experiment under the band of one, and alarms of a drift in random orders of the same voltage."""
    own, rng = {voltage: experiments(voltage) for voltage in (200, 300)}, np.random.default_rng(0)
    alarms = {rate: [0, 0, 0] for rate in (0.002, 0.01, 0.05, 0.2)}
    for voltage, other in ((200, 300), (300, 200)):
        for k, band in enumerate(own[voltage]):
            watched = rid.watch(band)
            for one in [*own[voltage][:k], *own[voltage][k + 1 :], *own[other]]:
                watched = watched.update(one)
            scores, refuted = np.array([one.score for one in watched.history]), len(watched.refuted)
            same, away = scores[:8], scores[8:]
            said = f"same {same.min():.2f} to {same.max():.2f}, other {away.min():.2f} to {away.max():.2f}"
            wrong = sum(one.refuted is not None for one in watched.history[:8])
            print(
                f"band of experiment {k + 1} at {voltage} mV: {said}; refuted {refuted}, {wrong} of the same",
                flush=True,
            )
            for _ in range(orders):
                mixed, next_ones = rng.permutation(same), rng.permutation(away)
                for rate, count in alarms.items():
                    count[0] += int(drift(mixed[:2], mixed[2:], rate).alarms.sum())
                    count[1] += 6
                    count[2] += bool(drift(mixed, next_ones, rate).alarms.any())
    for rate, (false, seen, found) in alarms.items():
        print(
            f"rate {rate}: {false} alarms in {seen} records of the same voltage; of the other one found in {found} orders"
        )


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
    by_experiments()
    main()
