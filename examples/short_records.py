"""Measured data: a hair dryer and the arm of a CD player from half of one short record each, judged on the other half.

Neither experiment was made for a frequency response: one record, 500 and 1024 samples of it, transient included, the arm within its
control loop. The bounds are wide, and the smallest model inside them says little; the model worth having is inside them too and
fits about as well as the best fit of the same data. What was not used tests all of it: the stated bounds, the band of all
consistent systems, and the simulation of the small model beside that of the best of the fits of order 1 to 12.
Data: DaISy collection (De Moor), hairdryer.dat and cdplayer.dat, downloaded once, or from the folder that ROBUSTID_DATA names.
Run: python short_records.py --out folder [--machine cdplayer --bounded 3] (40 s; the band of a matrix half a minute a frequency)
"""

import argparse
import tempfile
from pathlib import Path
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np

import robustid as rid
from robustid.advice import content
from robustid.errors import DatasetNotFoundError
from robustid.reduction import model_worth_having

ORDERS, DIRECTIONS = range(1, 13), 4


class Machine(NamedTuple):
    """A record, and how much of it is asked."""

    name: str
    dataset: str
    rates: tuple[float, ...] | None  # decay rates that are tried; None: those of the default
    bounded: int  # frequencies of the band; of a matrix each takes 20 s and more


MACHINES = (Machine("hair dryer", "hairdryer", None, 8), Machine("arm of a CD player", "cdplayer", (1.1, 1.2), 0))


def halves(record):
    """The first and the second half, each about its own mean: two experiments from unknown states."""
    half = len(record.u) // 2
    names = {"dt": record.dt, "inputs": record.inputs, "outputs": record.outputs, "initial": "free"}
    parts = (rid.TimeRecord(record.u[k : k + half], record.y[k : k + half], **names) for k in (0, half))
    return [rid.prepare.detrend(part) for part in parts]


def identified(machine, frf):
    """The class that the data suggest, and the decision about it."""
    modes = rid.suggest_kautz(frf)
    anything = rid.Prior(gain_bound=float(np.abs(frf.values).max()), decay_rate=1.1)
    problem = rid.MixedProblem(frequency=frf, parametric=modes.basis, prior=anything)
    suggestion = rid.suggest_prior(problem, decay_rates=machine.rates)
    K, rho = suggestion.prior.gain_bound, suggestion.prior.decay_rate
    result = rid.identify(problem.with_prior(gain_bound=K, decay_rate=rho))
    print(f"2. {modes.omega.size} modes, K = {K:.3g}, rho = {rho:.4g}:", end=" ")
    print(f"{result.status.value}; margin {result.margin:.3g}.")
    print(f"   {content(result).summary()}")
    return result


def simulated(models, record):
    """Fit in per cent of every output, (models, outputs), from the best initial state."""
    return np.array([100 * rid.validate(model, record).fit for model in models])


def draw(machine, record, models, fits, path):
    """The withheld half, and what the small model and the best fit make of its input."""
    figure, axes = plt.subplots(
        len(record.outputs), 1, sharex=True, squeeze=False, figsize=(9, 3 * len(record.outputs))
    )
    for k, axis in enumerate(axes[:, 0]):
        axis.plot(record.time, record.y[:, k], color="0.6", label="measured, not used")
        for (name, model), fit in zip(models.items(), fits, strict=True):
            error = rid.validate(model, record).residuals[:, k]
            axis.plot(record.time, record.y[:, k] - error, lw=0.9, label=f"{name}: {fit[k]:.1f} %")
        axis.set_ylabel(str(record.outputs[k]))
        axis.legend(loc="upper right", fontsize=8)
    axes[-1, 0].set_xlabel("time [s]")
    axes[0, 0].set_title(f"{machine.name}: the half of the record that was not used")
    figure.tight_layout()
    figure.savefig(path, dpi=110)
    plt.close(figure)


def judged(machine, out, bounded=None):
    """From half of the record to a small model; what the other half says of it."""
    used, kept = halves(rid.datasets.load(machine.dataset))
    frf, later = (rid.estimate_frf(part, method="local") for part in (used, kept))
    wide = np.median(frf.bound / np.abs(frf.values))
    print(f"\n{machine.name}\n1. {len(used.u)} samples: {frf.omega.size} frequency points,", end=" ")
    print(f"bound {100 * wide:.0f} % of the response in the median. {frf.bound.about}")

    result = identified(machine, frf)
    smallest = rid.reduce_within_bounds(result)
    worth = model_worth_having(result, smallest, frf, records=[used])
    small = worth.reduction
    print(f"3. {worth.summary()}")

    held = rid.coverage(frf, [later], kind="records")
    print(f"4. Of the samples of the other half {100 * held.share:.1f} % lie within the stated bounds.")
    if count := machine.bounded if bounded is None else bounded:
        omega = later.omega[np.linspace(0.05 * later.omega.size, 0.9 * later.omega.size, count).astype(int)]
        error = rid.worst_case_error(result, omega=omega, directions=DIRECTIONS, rtol=0.3)
        band = rid.coverage(error.with_model(small.model), [later], kind="records")
        print(f"   At {count} frequencies {100 * band.share:.1f} % are in the band around the small model.")

    fits = {order: rid.fit_mfd(frf, order=order, domain="z").model for order in ORDERS}
    quality = simulated(fits.values(), kept)
    best = fits[list(fits)[int(np.argmax(quality.mean(axis=1)))]]
    models = {f"small model, order {small.order}": small.model, f"best fit, order {best.nstates}": best}
    ours = simulated(models.values(), kept)
    print("5. Simulated from the input of the other half, fit of every output:")
    for name, row in zip(models, ours, strict=True):
        print(f"   {name:24}" + "".join(f"{one:8.1f} %" for one in row))
    print(f"   {'best of any order':24}" + "".join(f"{one:8.1f} %" for one in quality.max(axis=0)))
    draw(machine, kept, models, ours, out / f"{machine.dataset}.png")
    return held.share, ours[0], quality.max(axis=0)


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="folder for the pictures (default: a temporary one)")
    parser.add_argument("--machine", choices=[machine.dataset for machine in MACHINES], help="default: both")
    parser.add_argument("--bounded", type=int, help="frequencies at which the band is computed")
    arguments = parser.parse_args(argv)
    out = arguments.out or Path(tempfile.mkdtemp(prefix="robustid-"))
    found = {}
    for machine in MACHINES:
        if arguments.machine in (None, machine.dataset):
            try:
                rid.datasets.load(machine.dataset)
            except DatasetNotFoundError as missing:
                print(f"This example needs measured data. {missing}")
                return found
            out.mkdir(parents=True, exist_ok=True)
            found[machine.dataset] = judged(machine, out, arguments.bounded)
    print(f"\nPictures: {out}")
    return found


if __name__ == "__main__":
    main()
