"""A simulated wafer stage: rigid-body modes that are exact, fitted from the inputs' number alone.

A plate that floats, seen out of plane: three forces and a bending piezo, three position sensors and a strain gauge. Three
rigid-body modes (z, Rx, Ry), flexible modes from 100 Hz on. Measured in closed loop: the controller takes away what one
wants to see at low frequency, so that the noise is worst there. After R. Voorhoeve et al., IFAC 2016, section V.
Run: python wafer_stage.py --out folder (--full: 38 flexible modes, order 82, 5000 lines from 0.5 Hz to 4 kHz: minutes)
"""

import argparse
import itertools
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import robustid as rid
from robustid.mfd import Weight

MASS, SIDES = 12.0, np.array([0.62, 0.5])  # kg, m: a plate, evenly filled
FORCES = np.array([[-0.19, -0.21], [0.23, -0.17], [0.02, 0.2]])  # where the actuators act, m from the centre
SENSORS = np.array([[-0.27, 0.11], [0.24, 0.19], [0.05, -0.23]])  # where the position sensors look
PIEZO, GAUGE = np.array([0.06, 0.04]), np.array([-0.08, 0.05])  # the pair on the plate that sees bending only
CHANNELS = ("force 1", "force 2", "force 3", "piezo"), ("position 1", "position 2", "position 3", "strain")


def bending(points, numbers):
    """Deflection (points, modes) of the flexible modes, (p, q) half waves along the sides, and their curvature."""
    waves = np.pi * numbers / SIDES
    deflection = 2 * np.prod(np.cos(waves * (np.atleast_2d(points)[:, None] + SIDES / 2)), axis=2)
    return deflection, deflection * np.sum(waves**2, axis=1)


def stage(modes):
    """The plant as a function of omega (F,) to (F, 4, 4), micrometres and microstrain per newton and volt."""
    pairs = np.array([(p, q) for p in range(12) for q in range(12) if p + q > 1 or p * q], dtype=float)
    stiffness = np.sum((pairs / SIDES) ** 2, axis=1)
    chosen = np.argsort(stiffness)[:modes]
    frequency = 2 * np.pi * 100 * stiffness[chosen] / stiffness[chosen[0]]
    damping = np.random.default_rng(0).uniform(0.005, 0.01, modes)
    drive = np.vstack([bending(FORCES, pairs[chosen])[0], 2e-3 * bending(PIEZO, pairs[chosen])[1]])
    look = np.vstack([bending(SENSORS, pairs[chosen])[0], 2e-3 * bending(GAUGE, pairs[chosen])[1]])
    arms = [np.column_stack([np.ones(3), points / (SIDES / np.sqrt(12))]) for points in (FORCES, SENSORS)]
    rigid_drive, rigid_look = (np.vstack([each, np.zeros(3)]) for each in arms)  # radii of gyration make masses equal

    def plant(omega):
        s = 1j * omega[:, None]
        modal = 1 / (s**2 + 2 * damping * frequency * s + frequency**2)
        rigid = rigid_look @ rigid_drive.T / s[:, :, None] ** 2
        return 1e6 / MASS * ((look * modal[:, None]) @ drive.T + rigid)

    return plant, frequency


def noise_level(omega, corner_hz=5.0):
    """Relative standard deviation: 1 %, and more where the loop suppresses the excitation (inverse sensitivity)."""
    return 0.01 * np.sqrt(1 + (2 * np.pi * corner_hz / omega) ** 4)


def measure(truth, sigma, seed):
    """The response with circular noise of standard deviation sigma per entry."""
    rng = np.random.default_rng(seed)
    return truth + sigma * (rng.standard_normal(truth.shape) + 1j * rng.standard_normal(truth.shape)) / np.sqrt(2)


def errors(response, truth, omega, bands):
    """Root mean square over each band of the error's largest singular value, relative to that of the truth."""
    ratio = np.linalg.norm(response - truth, 2, axis=(1, 2)) / np.linalg.norm(truth, 2, axis=(1, 2))
    return [np.sqrt(np.mean(ratio[(omega >= low) & (omega <= high)] ** 2)) for low, high in bands]


def matrix(path, omega, curves, data, label):
    """4x4 pictures: dots for the data, a line for each of the curves (name to values and format)."""
    figure = Figure(figsize=(11, 8.5), layout="constrained")
    grid = figure.subplots(4, 4, sharex=True, sharey=True)
    for (i, j), axes in np.ndenumerate(grid):
        axes.semilogx(omega / (2 * np.pi), data[:, i, j], ".", ms=2.5, color="0.65", label="data")
        for name, (values, style) in curves.items():
            axes.semilogx(omega / (2 * np.pi), values[:, i, j], style, lw=1.1, label=name)
        axes.set_title(f"{CHANNELS[0][j]} to {CHANNELS[1][i]}", fontsize=9)
        axes.grid(alpha=0.3)
    grid[0, 0].set(**label)
    figure.supxlabel("frequency in Hz")
    figure.supylabel("magnitude, µm or 10⁻⁶ per N or V" if "yscale" in label else "magnitude over that of the truth")
    figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
    figure.savefig(path, dpi=110)


def convergence(path, fits):
    """Cost over the lowest of the fit, and condition number, at every iteration."""
    figure = Figure(figsize=(10, 3.6), layout="constrained")
    cost, condition = figure.subplots(1, 2)
    for (name, fit), style in zip(fits.items(), ("o-", "s--", "d:"), strict=True):
        costs = np.array([fit.start_cost] + [step.cost for step in fit.history])
        cost.semilogy(costs / fit.cost, style, label=name)
        condition.plot(np.arange(1, len(costs)), (fit.condition_numbers - 1) * 1e15, style)
    cost.set(xlabel="iteration", ylabel="cost over the lowest")
    condition.set(xlabel="iteration", ylabel="(condition number - 1) / 10⁻¹⁵", ylim=(0, 10))
    for axes in (cost, condition):
        axes.xaxis.get_major_locator().set_params(integer=True)
        axes.grid(alpha=0.3)
    cost.legend()
    figure.savefig(path, dpi=110)


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="folder for pictures (default: a temporary one)")
    parser.add_argument("--full", action="store_true", help="38 flexible modes, order 82, 5000 lines")
    arguments = parser.parse_args(argv)
    out = arguments.out or Path(tempfile.mkdtemp(prefix="robustid-"))
    out.mkdir(parents=True, exist_ok=True)
    modes, lines, top = (38, 5000, 4000.0) if arguments.full else (9, 600, 1500.0)
    realisations = 1 if arguments.full else 4

    plant, frequency = stage(modes)
    omega, order = 2 * np.pi * np.geomspace(0.5, top, lines), 2 * modes + 6
    truth = plant(omega)
    sigma = noise_level(omega)[:, None, None] * np.abs(truth)  # repeated periods tell it
    # The paper's bands: ten times the weight from 15 to 160 Hz, a hundredth in the upper half (of 4 kHz).
    weight = Weight(1 / sigma).banded(omega, [(2 * np.pi * 15, 2 * np.pi * 160, 10), (np.pi * top, omega[-1], 0.01)])
    edges = [0.5, 5, 15, 160, top / 2, top]
    bands = [(2 * np.pi * a, 2 * np.pi * b) for a, b in itertools.pairwise(edges)]

    low, high = frequency[[0, -1]] / (2 * np.pi)
    print(
        f"{modes} flexible modes from {low:.0f} to {high:.0f} Hz and 3 rigid-body modes: order {order}, {lines} lines"
    )
    found = {"rigid body": [], "unconstrained": []}
    for seed in range(realisations):
        data = measure(truth, sigma, seed)
        frf = rid.FrequencyResponse(omega, data)
        # The noise's own weight first: in bands of very different weight the subspace start sees one band only.
        body = rid.RigidBody(3)
        likely = rid.fit_mfd(frf, order=order, rigid_body=body, weight=Weight(1 / sigma))
        rigid = rid.fit_mfd(frf, order=order, rigid_body=body, weight=weight, start=likely.model)
        # Started from the constrained model, which it can only improve on these data; unstable poles are left.
        free = rid.fit_mfd(frf, order=order, weight=weight, start=rigid.model, stable=False)
        fits = dict(zip(found, (rigid, free), strict=True))
        for name, fit in fits.items():
            found[name].append(errors(fit.fraction.response(omega), truth, omega, bands))

    print(f"\nRelative rms error over {realisations} noise realisation(s), by band in Hz; cost and poles of the last:")
    print(
        f"{'':14}"
        + "".join(f"{f'{a:.4g}-{b:.4g}':>10}" for a, b in itertools.pairwise(edges))
        + "      cost  slowest |pole|, rad/s"
    )
    for name, fit in fits.items():
        rms = np.sqrt(np.mean(np.square(found[name]), axis=0))
        slow = np.sort(np.abs(fit.fraction.poles))[:6]
        print(f"{name:14}" + "".join(f"{each:10.1e}" for each in rms) + f"{fit.cost:10.4g}  {np.round(slow, 2)}")
    unstable = int(np.sum(free.fraction.poles.real > 0))
    print(
        f"\nThe unconstrained fit has the lower cost and {unstable} unstable pole(s). What it gains, it gains on noise.\n"
        "How the inputs drive the rigid body, found from the data (row space; truth: the piezo doesn't):"
    )
    print(np.array2string(rigid.rigid_directions, precision=3, suppress_small=True))
    print(f"Condition number of every normal matrix - 1: at most {rigid.condition_numbers.max() - 1:.0e}")

    curves = {"truth": (np.abs(truth), "k-")}
    for (name, fit), style in zip(fits.items(), ("C0--", "C1:"), strict=True):
        curves[name] = (np.abs(fit.fraction.response(omega)), style)
    matrix(out / "wafer_stage.png", omega, curves, np.abs(data), {"yscale": "log"})
    k = omega <= 2 * np.pi * 15
    ratios = {name: (values[k] / np.abs(truth[k]), style) for name, (values, style) in curves.items()}
    matrix(out / "wafer_stage_low.png", omega[k], ratios, np.abs(data[k] / truth[k]), {"ylim": (0.8, 1.2)})
    convergence(out / "wafer_stage_steps.png", {"rigid body, weight of the noise": likely, **fits})
    print(f"\nPictures: {out}")


if __name__ == "__main__":
    main()
