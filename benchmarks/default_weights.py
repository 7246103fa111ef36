"""The default weight of fit_mfd against unit, relative, covariance and variance weights, at withheld points of measured data.

Run: OPENBLAS_NUM_THREADS=1 ROBUSTID_DATA=folder python benchmarks/default_weights.py [--sets mirror-300 ...] [--orders 6 10]
[--folds 3]. Of every data set each of the folds withholds every third frequency point in turn; the error is the root mean square
over the withheld points, each entry relative to its own root mean square, over all folds. The data's own noise is part of it.
"less one" is the ratio to the best without the one frequency point that speaks most against the default.
"""

import argparse
import os
import pathlib
import time

import numpy as np
import scipy.io

import robustid as rid
from robustid.fitting import Weight

FOLDER = pathlib.Path(os.environ.get("ROBUSTID_DATA", "."))
# Orders below that of the plant, as a designer takes them.
SETS = {
    "mirror-300": (6, 10),
    "mirror-300, 1 block": (6, 10),
    "mirror-200": (6, 10),
    "mirror-200, 1 block": (6, 10),
    "beam": (8, 14),
    "two masses": (4, 6),
    "CD player": (8, 12),
    "hair dryer": (4, 6),
}


def mirror(volts, blocks, every=16):
    """3 x 3, of one or two blocks of three realisations, every 16th spectral line; variances of 10 degrees of freedom."""
    u, y = (np.load(FOLDER / f"fsm_cubespec/{signal}_{volts}mV_train.npy") for signal in "uy")
    records = [
        rid.TimeRecord(*(s[:, :, r].transpose(2, 0, 1).reshape(-1, 3) for s in (u, y)), dt=1 / 6400, initial="periodic")
        for r in range(3 * blocks)
    ]
    return rid.estimate_frf(records, period=8192).select(slice(None, None, every))


def short_record(name, dt):
    """A record with its transient, by the local rational method; columns are inputs, then outputs."""
    (table,) = (v for k, v in scipy.io.loadmat(FOLDER / f"daisy/{name}.mat").items() if not k.startswith("_"))
    half = table.shape[1] // 2
    frf = rid.estimate_frf(rid.TimeRecord(table[:, :half], table[:, half:], dt=dt, initial="free"))
    return frf.select(slice(None, None, -(-frf.omega.size // 300)))


def load(name):
    """A frequency response with its estimated covariance, and whether models of it have a feed-through."""
    if name.startswith("mirror"):
        return mirror(name[7:10], 1 if name.endswith("block") else 2), True
    if name == "beam":
        return rid.estimate_frf(rid.datasets.load("beam_ring"), lines=np.arange(100, 8000, 24)), True
    if name == "two masses":
        return rid.estimate_frf(rid.datasets.load("two_mass"), period=2500), False
    return (short_record("cdplayer", 1.0) if name == "CD player" else short_record("hairdryer", 0.08)), False


def weights(frf):
    shape = frf.values.shape
    variance = np.einsum("fii->fi", frf.covariance).real.reshape(shape[0], shape[2], shape[1]).transpose(0, 2, 1)
    return {
        "default": None,
        "unit": Weight(np.ones(shape)),
        "relative": Weight.relative(frf.values),
        "covariance": Weight.from_covariance(frf.covariance, *shape[1:]),
        "variances": Weight(1 / np.sqrt(variance)),
    }


def withheld_squares(frf, feedthrough, order, folds=3):
    """Squared errors (F,) at the withheld points of every weight, mean over entries; their sum over folds is that of the table."""
    squares = {}
    for fold in range(folds):
        hold = np.arange(frf.omega.size) % folds == fold
        train, test = frf.select(~hold), frf.select(hold)
        for name, weight in weights(train).items():
            fit = rid.fit_mfd(train, order=order, weight=weight, feedthrough=feedthrough, restart=False)
            error = np.abs(fit.fraction.response(test.omega) - test.values) ** 2
            share = error / np.sum(np.abs(test.values) ** 2, axis=0)
            squares.setdefault(name, np.zeros(frf.omega.size))[hold] = np.mean(share, axis=(1, 2)) / folds
    return squares


def over_best(squares):
    """Error of the default over that of the best of unit, relative and covariance weights."""
    total = {name: np.sqrt(np.sum(found)) for name, found in squares.items()}
    return float(total["default"] / min(total[other] for other in ("unit", "relative", "covariance")))


def without_one(squares):
    """The same without the one point whose loss brings the default nearest to the best: what hangs on a single measured value."""
    points = range(squares["default"].size)
    return min(over_best({name: np.delete(found, k) for name, found in squares.items()}) for k in points)


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sets", nargs="+", choices=SETS, default=list(SETS))
    parser.add_argument("--orders", type=int, nargs="+")
    parser.add_argument("--folds", type=int, default=3)
    arguments = parser.parse_args(argv)
    names, ratios = ("default", "unit", "relative", "covariance", "variances"), []
    print(
        f"{'error at withheld points':<22}{'dof':>5}{'order':>6}"
        + "".join(f"{n:>12}" for n in names)
        + "  / best  less one  CPU s"
    )
    for name in arguments.sets:
        try:
            frf, feedthrough = load(name)
        except (rid.errors.DatasetNotFoundError, FileNotFoundError) as missing:
            print(f"{name:<22} skipped: {missing}")
            continue
        for order in arguments.orders or SETS[name]:
            start = time.process_time()
            found = withheld_squares(frf, feedthrough, order, arguments.folds)
            ratios.append(over_best(found))
            cells = "".join(f"{np.sqrt(found[other].sum()):12.4f}" for other in names)
            seconds = time.process_time() - start
            print(
                f"{name:<22}{frf.dof:5.0f}{order:6}{cells}{ratios[-1]:8.2f}{without_one(found):10.2f}{seconds:7.1f}",
                flush=True,
            )
    if ratios:
        print(
            f"default over the best of unit, relative and covariance: median {np.median(ratios):.2f}, largest {max(ratios):.2f}"
        )


if __name__ == "__main__":
    main()
