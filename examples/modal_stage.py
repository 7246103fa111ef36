"""A simulated 13x4 stage of order 40 by its modes: rank one, real shapes, three rigid-body modes that are exact.

Thirteen position sensors (µm), four voice coils (A); 17 flexible modes with proportional damping, three of them within 7 Hz.
Noise: 1 % of every entry and 0.02 µm/A. The same response is fitted with rigid-body modes alone and with modes of real shape; the
truth between the measured frequencies says which is nearer, and standard deviations how sure each shape is.
Run: python modal_stage.py --out folder
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from shared.modal_stage import COILS, SENSORS, SIDES, between, measured, relative_error, stage

import robustid as rid

SHOWN = 0, 2, 10  # modes in the picture


def table(rows, truth):
    """Lines of text: every mode beside the true one of the nearest shape."""
    head = f"{'Hz':>9}{'±':>8}{'true':>9}{'damping %':>11}{'±':>8}{'true':>8}{'shape: error':>15}{'± there':>9}"
    lines = [head + "   at sensor"]
    shapes, hz = truth.shapes[:, 3:].real, truth.frequency[3:] / (2 * np.pi)
    for row in rows:
        alike = (row.shape @ shapes) ** 2 / (np.sum(row.shape**2) * np.sum(shapes**2, axis=0))  # assurance criterion
        k = int(np.argmax(alike))
        error = np.abs(row.shape - shapes[:, k] / shapes[np.argmax(np.abs(row.shape)), k])
        worst = int(np.argmax(error))
        lines.append(
            f"{row.hz:9.3f}{row.hz_std:8.3f}{hz[k]:9.3f}{100 * row.damping:11.3f}{100 * row.damping_std:8.4f}"
            f"{100 * truth.damping[3 + k]:8.3f}{error[worst]:15.4f}{row.shape_std[worst]:9.4f}{worst + 1:8d}"
        )
    return "\n".join(lines)


def plot_shapes(rows):
    """Mode shapes over the plate, as bubbles at the sensors."""
    figure = Figure(figsize=(11, 3.6), layout="constrained")
    for axes, row in zip(figure.subplots(1, len(SHOWN)), [rows[k] for k in SHOWN], strict=True):
        color = np.where(row.shape > 0, "tab:blue", "tab:red")
        axes.scatter(*SENSORS.T, s=900 * np.abs(row.shape), c=color, alpha=0.7, linewidths=0)
        axes.plot(*COILS.T, "k+", ms=9)
        axes.set(xlim=0.62 * SIDES[0] * np.array([-1, 1]), ylim=0.66 * SIDES[1] * np.array([-1, 1]), aspect="equal")
        axes.set_title(f"{row.hz:.1f} Hz, damping {100 * row.damping:.2f} %", fontsize=10)
        axes.set_xlabel("m")
    figure.suptitle(
        "Mode shapes at the sensors (area: how far they move; blue up, red down) and the coils (+)", fontsize=10
    )
    return figure


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="folder for pictures (default: a temporary one)")
    out = parser.parse_args(argv).out or Path(tempfile.mkdtemp(prefix="robustid-"))
    out.mkdir(parents=True, exist_ok=True)

    truth = stage()
    frf, weight = measured(truth, seed=0)
    print(f"{len(SENSORS)}x{len(COILS)} stage of order {truth.order}, {frf.omega.size} frequency points, 5 to 1100 Hz")
    asked = {"order": truth.order, "weight": weight, "rigid_body": 3}
    plain = rid.fit_mfd(frf, **asked)
    fit = rid.fit_mfd(frf, **asked, modal=rid.fits.Modal("proportional"), start=plain.model)

    omega = between(frf.omega)
    wanted = truth.response(omega)
    print(f"\n{'fit':24}{'parameters':>11}{'cost':>9}{'error between the points':>27}")
    for name, one in {"rigid body": plain, "and modes of real shape": fit}.items():
        covariance = rid.fits.fit_covariance(one, noise=1.0)  # the last one is used below
        error = relative_error(one.fraction.response(omega), wanted)
        print(f"{name:24}{covariance.parameters:11d}{one.cost:9.0f}{error:27.2e}")
    print(f"{'noise alone':35}{frf.values.size:9d}\n{fit.status.value}")
    print(f"Poles of the rigid body: {fit.poles[-6:].real}\n")
    rows = rid.fits.mode_table(fit, covariance)[1:]
    print(table(rows, truth))

    plot_shapes(rows).savefig(out / "modal_stage_shapes.png", dpi=110)
    print(f"\nPicture: {out}")


if __name__ == "__main__":
    main()
