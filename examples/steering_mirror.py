"""Measured data: a fine steering mirror, three piezo voltages to three displacements, from records to a validated model.

Random-phase multisine from 0.8 Hz to 3 kHz. The piezos aren't linear: what no linear model can explain is measured first.
Data: github merijnfloren/fsm-benchmark-data (CC BY 4.0; Floren et al., ISMA-USD 2024), downloaded once, or from the folder
that ROBUSTID_DATA names.
Run: python steering_mirror.py --out folder (--orders 34: that one only)
"""

import argparse
import dataclasses
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import robustid as rid
from robustid.errors import DatasetNotFoundError
from robustid.fitting import mode_table, suggest_order

DT = 1 / 6400
PERIOD = 8192
# Order 36 wants a pole beyond z = -1, where no line is: kept stable it ends at the boundary, an undamped mode at 3.2 kHz.
ORDERS = (20, 28, 34)
# Every 8th line, 6 Hz apart: 8 times faster, and enough for modes 14 Hz wide. From order 40 on the fit spends states on
# modes too narrow to show at these points, and the test gets worse: then take every line.
THINNED = 8


def mirror_records(name):
    """Every realisation of the excitation: voltages to displacements [m], mean of its two steady periods."""
    means = []
    for record in rid.datasets.load(f"fsm/{name}"):
        u, y = (signal.reshape(-1, PERIOD, 3).mean(axis=0) for signal in (record.u, record.y))
        # Offsets of the sensors are no response.
        means.append(dataclasses.replace(record, u=u - u.mean(axis=0), y=y - y.mean(axis=0)))
    return means


def nrms(residuals, records):
    """Root mean square of the residuals in per cent of the measured displacement, per sensor."""
    return (
        100 * np.linalg.norm(np.vstack(residuals), axis=0) / np.linalg.norm(np.vstack([r.y for r in records]), axis=0)
    )


def left_by_lines(frf, records):
    """What remains when the lines of the response themselves are the model: one free number per line."""
    line = np.rint(frf.omega * DT * len(records[0].y) / (2 * np.pi)).astype(int)
    left = []
    for record in records:
        spectrum = np.fft.rfft(record.y, axis=0)
        spectrum[line] -= np.einsum("fij,fj->fi", frf.values, np.fft.rfft(record.u, axis=0)[line])
        left.append(np.fft.irfft(spectrum, len(record.y), axis=0))
    return left


def row(name, values):
    print(f"{name:<48}" + "".join(f"{value:9.2f}" for value in values))


def plot_time(record, validation, samples=120):
    """A stretch of one validation record with what the model leaves."""
    figure = Figure(figsize=(9, 7), layout="constrained")
    part = slice(1000, 1000 + samples)
    for k, ax in enumerate(figure.subplots(3, 1, sharex=True)):
        time = 1e3 * record.time[part]
        ax.plot(time, 1e6 * record.y[part, k], color="0.6", lw=3, label="measured")
        ax.plot(time, 1e6 * validation.predicted[part, k], color="C0", lw=1, label="model")
        ax.plot(time, 1e6 * validation.residuals[part, k], color="C3", lw=1, label="difference")
        ax.set_ylabel(f"{record.outputs[k].name} [µm]")
        ax.grid(color="0.9")
    ax.set_xlabel("time [ms]")
    figure.legend(*ax.get_legend_handles_labels(), loc="outside upper left", ncols=3, frameon=False)
    return figure


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="folder for pictures (default: a temporary one)")
    parser.add_argument("--orders", type=int, nargs="+", default=ORDERS, help="orders to try")
    arguments = parser.parse_args(argv)
    try:
        training, test = mirror_records("train"), mirror_records("test")
    except DatasetNotFoundError as missing:
        print(f"This example needs measured data. {missing}")
        return
    out = arguments.out or Path(tempfile.mkdtemp(prefix="robustid-"))
    out.mkdir(parents=True, exist_ok=True)

    # Three records with orthogonal inputs make a block; the two blocks differ by what isn't linear.
    frf = rid.estimate_frf(training)
    print(f"{frf.omega.size} lines from {frf.freq_hz[0]:.2g} to {frf.freq_hz[-1]:.4g} Hz, {len(training)} realisations")
    print(f"\n{'left of the displacement, NRMS in %':<48}" + "".join(f"{c.name:>9}" for c in frf.outputs))
    # 3 of 6 equations a line are spent on its 3 unknowns: what is left counts twice.
    row("not linear: training, lines, freedom corrected", np.sqrt(2) * nrms(left_by_lines(frf, training), training))
    row("test, lines of the measured response", nrms(left_by_lines(frf, test), test))

    # The input is as large at every line, so that the sum of squares over the lines is the one over time. Other weights
    # spend states on antiresonances: at order 28, 5 to 7 % are left with the smoothed scatter of the blocks, 8 to 9 % with
    # errors relative to the response of the sensor.
    lines = frf.select(slice(None, None, THINNED))
    weight = np.ones(lines.values.shape)
    sweep = suggest_order(lines, orders=arguments.orders, weight=weight, domain="z", feedthrough=True)
    validations = {}
    for order, fit in sweep.fits.items():
        validations[order] = [rid.validate(fit.model, record) for record in test]
        row(f"test, order {order}: {fit.status.name.lower()}", nrms([v.residuals for v in validations[order]], test))
    best = sweep.fits[sweep.suggested]
    print(
        f"\nThe order with the smallest description length on the training data: {sweep.suggested}. {best.status.value}"
    )
    if best.reflected:
        print(
            f"Unstable poles reflected: {best.reflected}; cost {best.unstable_cost:.3g} before, {best.cost:.3g} after."
        )

    print("\nIts lightly damped modes:\n      Hz  damping in %   share  largest in")
    for mode in mode_table(best.model):
        if mode.damping < 0.05:
            print(
                f"{mode.hz:8.1f}{100 * mode.damping:14.2f}{mode.participation:8.2f}  "
                f"{frf.inputs[mode.input].name} to {frf.outputs[mode.output].name}"
            )
    rid.plot.bode(best, data=lines).savefig(out / "response.png", dpi=110)
    rid.plot.stabilisation(sweep).savefig(out / "stabilisation.png", dpi=110)
    plot_time(test[0], validations[sweep.suggested][0]).savefig(out / "time.png", dpi=110)
    print(f"\nPictures: {out}")


if __name__ == "__main__":
    main()
