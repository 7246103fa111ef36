"""A simulated wafer stage: rigid-body modes that are exact, fitted from the inputs' number alone.

A plate that floats, seen out of plane: three forces and a bending piezo, three position sensors and a strain gauge.
Three rigid-body modes (z, Rx, Ry), flexible modes from 100 Hz on. Measured in closed loop: the controller takes away
what one wants to see at low frequency: the noise is worst there. After R. Voorhoeve et al., IFAC 2016, section V.
Run: python wafer_stage.py --out folder (--full: 38 flexible modes, order 82, 5000 frequency points to 4 kHz: 10 minutes)
"""

import argparse
import itertools
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

import robustid as rid

MASS, SIDES = 12.0, np.array([0.62, 0.5])  # kg, m: a plate, evenly filled
FORCES = np.array([[-0.19, -0.21], [0.23, -0.17], [0.02, 0.2]])  # where the actuators act, m from the centre
SENSORS = np.array([[-0.27, 0.11], [0.24, 0.19], [0.05, -0.23]])  # where the position sensors look
PIEZO, GAUGE = np.array([0.06, 0.04]), np.array([-0.08, 0.05])  # the pair on the plate that sees bending only
INPUTS = ["force 1 [N]", "force 2 [N]", "force 3 [N]", "piezo [V]"]
OUTPUTS = ["position 1 [µm]", "position 2 [µm]", "position 3 [µm]", "strain [1e-6]"]
SIZE = 9, 600  # flexible modes, frequency points
EDGES = 0.5, 5, 15, 160, 2000, 4000  # Hz: the bands of the paper, the lowest one cut in three


def bending(points, numbers):
    """Deflection (points, modes) of the flexible modes, (p, q) half waves along the sides, and their curvature."""
    waves = np.pi * numbers / SIDES
    deflection = 2 * np.prod(np.cos(waves * (np.atleast_2d(points)[:, None] + SIDES / 2)), axis=2)
    return deflection, deflection * np.sum(waves**2, axis=1)


def modal(modes, piezo=True):
    """Modes of the plant, the rigid ones first: frequency (rad/s) and damping (m,), inputs and outputs (4, m), divided by kg.

    The gauge sees bending only. So does the piezo; without it the fourth input is one more force in its place.
    """
    pairs = np.array([(p, q) for p in range(12) for q in range(12) if p + q > 1 or p * q], dtype=float)
    stiffness = np.sum((pairs / SIDES) ** 2, axis=1)
    pairs = pairs[np.argsort(stiffness)[:modes]]
    stiffness = np.sort(stiffness)[:modes]
    frequency = 2 * np.pi * 100 * stiffness / stiffness[0]
    damping = np.random.default_rng(0).uniform(0.005, 0.01, modes)

    def rigid(points):  # radii of gyration make masses equal
        return np.column_stack([np.ones(len(points)), points / (SIDES / np.sqrt(12))])

    forces = FORCES if piezo else np.vstack([FORCES, PIEZO])
    drive = np.hstack([rigid(forces), bending(forces, pairs)[0]])
    look = np.hstack([rigid(SENSORS), bending(SENSORS, pairs)[0]])
    if piezo:
        drive = np.vstack([drive, np.hstack([np.zeros((1, 3)), 2e-3 * bending(PIEZO, pairs)[1]])])
    look = np.vstack([look, np.hstack([np.zeros((1, 3)), 2e-3 * bending(GAUGE, pairs)[1]])])
    return np.append(np.zeros(3), frequency), np.append(np.zeros(3), damping), drive, 1e6 / MASS * look


def stage(modes, piezo=True):
    """The plant as a function of omega (F,) to (F, 4, 4), micrometres and microstrain per newton and volt."""
    frequency, damping, drive, look = modal(modes, piezo)

    def plant(omega):
        s = 1j * omega[:, None]
        return (look * (1 / (s**2 + 2 * damping * frequency * s + frequency**2))[:, None]) @ drive.T

    return plant, frequency[3:]


def measure(truth, sigma, seed):
    """The response with circular noise of standard deviation sigma per entry."""
    rng = np.random.default_rng(seed)
    return truth + sigma * (rng.standard_normal(truth.shape) + 1j * rng.standard_normal(truth.shape)) / np.sqrt(2)


class Experiment(NamedTuple):
    """What a fit is given, and the truth."""

    frf: rid.FrequencyResponse
    weight: rid.fits.Weight
    truth: np.ndarray
    frequency: np.ndarray
    bands: np.ndarray


def experiment(modes, lines, piezo=True):
    """Measured frequency points from 0.5 Hz to 4 kHz with the weight of the paper."""
    plant, frequency = stage(modes, piezo)
    omega = 2 * np.pi * np.geomspace(EDGES[0], EDGES[-1], lines)
    truth = plant(omega)
    # 1 %, and more where the loop suppresses the excitation (inverse sensitivity); repeated periods tell it.
    sigma = 0.01 * np.sqrt(1 + (2 * np.pi * 5 / omega[:, None, None]) ** 4) * np.abs(truth)
    variance = sigma.transpose(0, 2, 1).reshape(lines, 16)[:, :, None] ** 2 * np.eye(16)  # of vec: columns stacked
    inputs = [*INPUTS[:3], INPUTS[3] if piezo else "force 4 [N]"]
    frf = rid.FrequencyResponse(
        omega, measure(truth, sigma, seed=0), covariance=variance, inputs=inputs, outputs=OUTPUTS
    )
    bands = 2 * np.pi * np.array(list(itertools.pairwise(EDGES)))
    weight = rid.fits.Weight(1 / sigma).banded(omega, [(*bands[2], 10), (*bands[-1], 0.01)])
    return Experiment(frf, weight, truth, frequency, bands)


def errors(response, truth, omega, bands):
    """Root mean square over each band of the error's largest singular value, relative to that of the truth."""
    ratio = np.linalg.norm(response - truth, 2, axis=(1, 2)) / np.linalg.norm(truth, 2, axis=(1, 2))
    return [np.sqrt(np.mean(ratio[(omega >= low) & (omega <= high)] ** 2)) for low, high in bands]


def plot_low(frf, truth, fits):
    """Magnitude of data and models over that of the truth, up to 15 Hz."""
    k = frf.freq_hz <= 15
    curves = {name: np.abs(fit.fraction.response(frf.omega[k]) / truth[k]) for name, fit in fits.items()}
    figure = Figure(figsize=(11, 8.5), layout="constrained")
    grid = figure.subplots(4, 4, sharex=True, sharey=True)
    for (i, j), axes in np.ndenumerate(grid):
        measured = np.abs(frf.values[k, i, j] / truth[k, i, j])
        axes.semilogx(frf.freq_hz[k], measured, ".", ms=2.5, color="0.65", label="data")
        for name, values in curves.items():
            axes.plot(frf.freq_hz[k], values[:, i, j], lw=1.1, label=name)
        axes.set_title(f"{frf.inputs[j].name} to {frf.outputs[i].name}", fontsize=9)
        axes.grid(alpha=0.3)
    grid[0, 0].set(ylim=(0.8, 1.2))
    figure.supxlabel("frequency in Hz")
    figure.supylabel("magnitude over that of the truth")
    figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return figure


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="folder for pictures (default: a temporary one)")
    parser.add_argument("--full", action="store_true", help="38 flexible modes, order 82, 5000 frequency points")
    arguments = parser.parse_args(argv)
    out = arguments.out or Path(tempfile.mkdtemp(prefix="robustid-"))
    out.mkdir(parents=True, exist_ok=True)

    modes, lines = (38, 5000) if arguments.full else SIZE
    order = 2 * modes + 6
    frf, weight, truth, frequency, bands = experiment(modes, lines)
    omega = frf.omega
    low, high = frequency[[0, -1]] / (2 * np.pi)
    print(
        f"{modes} flexible modes from {low:.0f} to {high:.0f} Hz and 3 rigid-body modes: order {order}, {lines} frequency points"
    )

    rigid = rid.fit_mfd(frf, order=order, rigid_body=rid.RigidBody(3), weight=weight)
    # Started from the constrained model, which it can only improve on these data; unstable poles are left.
    free = rid.fit_mfd(frf, order=order, weight=weight, start=rigid.model, stable=False)

    print("\nRelative rms error by band in Hz, cost, slowest |pole| in rad/s:")
    print(f"{'':14}" + "".join(f"{f'{a:g}-{b:g}':>10}" for a, b in itertools.pairwise(EDGES)))
    fits = {"rigid body": rigid, "unconstrained": free}
    for name, fit in fits.items():
        rms = "".join(f"{each:10.1e}" for each in errors(fit.fraction.response(omega), truth, omega, bands))
        print(f"{name:14}{rms}{fit.cost:12.5g}  {np.sort(np.abs(fit.fraction.poles))[:6].round(2)}")
    unstable = int(np.sum(free.fraction.poles.real > 0))
    print(
        f"\nThe unconstrained fit has the lower cost and {unstable} unstable pole(s): it gains on noise.\n"
        "How the inputs drive the rigid body, found from the data (row space; truth: the piezo doesn't):"
    )
    print(np.array2string(rigid.rigid_directions, precision=3, suppress_small=True))
    print(f"Condition number of every normal matrix - 1: at most {rigid.condition_numbers.max() - 1:.0e}")

    rid.plot.bode(rigid, data=frf).savefig(out / "wafer_stage.png", dpi=110)
    rid.plot.convergence(rigid).savefig(out / "wafer_stage_steps.png", dpi=110)
    plot_low(frf, truth, fits).savefig(out / "wafer_stage_low.png", dpi=110)
    print(f"\nPictures: {out}")


if __name__ == "__main__":
    main()
