"""A levitated mass gets a better controller: integral action for every plant that agrees with the record, with the margins it had.

The machine and its record are those of levitation.py: it runs only under its controller, which leaves an error under load. From the
worst cases of its loop a PID is designed that has the largest integral gain while no consistent plant has a larger peak of the
sensitivity, nor a larger response from noise of the sensor to the current, than the controller that ran may have.

Run: python controller_levitation.py --out folder (ten seconds)
"""

import argparse
import math
import tempfile
from pathlib import Path

import control
import numpy as np
from levitation import DT, POLE, controller, machine, measured
from shared.worst_loops import TWO_PI, axes_over, largest

import robustid as rid
from robustid.design import PID, Limits

LINES = np.arange(2, 1980, 10)
FILTER = -math.log(POLE) / DT  # the pole of the controller that ran
SHOWN_HZ = (0.1, 1.0, 5.0, 20.0)


def bounded(record):
    """Worst cases of the loop that ran, over every consistent plant."""
    loop = rid.prepare.loop_from_data(record, controller())
    frf = rid.prepare.loop_response(record, loop, lines=LINES)
    guess = rid.Prior(gain_bound=float(np.abs(frf.values).max()), decay_rate=1.2)
    prior = rid.suggest_prior(rid.MixedProblem(frequency=frf, prior=guess)).prior
    result = rid.identify(rid.MixedProblem(frequency=frf, prior=prior)).require()
    return rid.loop_bounds(rid.band(result), loop)


def sensitivity(plant, law, omega):
    z = np.exp(1j * omega * DT)
    return np.abs(1 / (1 + plant(z) * law(z)))


def figure_of(plant, loops):
    """Bounds of |S| of both controllers, and those of the true plant."""
    omega = np.geomspace(TWO_PI * 0.05, np.pi / DT, 2000)
    axes = axes_over(omega, "sensitivity |S|")
    for k, (name, bounds) in enumerate(loops.items()):
        worst, true = largest(bounds, omega), sensitivity(plant, bounds.controller, omega)
        axes.plot(omega / TWO_PI, worst, color=f"C{k}", lw=1.4, label=f"{name}: worst consistent plant")
        axes.plot(omega / TWO_PI, true, color=f"C{k}", lw=1, ls="--", label=f"{name}: true plant")
    axes.legend(frameon=False, loc="lower right")
    return axes.figure


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=None, help="folder for the picture; default: a temporary one")
    out = parser.parse_args(argv).out or Path(tempfile.mkdtemp())
    out.mkdir(parents=True, exist_ok=True)
    plant = machine()
    ran = bounded(measured(plant))
    print("1. The controller that ran, with every plant that agrees with the record:")
    print(ran.summary())

    print("\n2. PID with the same filter, the same peaks allowed, the largest integral gain:")
    limits = Limits(
        sensitivity_peak=ran.peaks["sensitivity"].value, control_peak=ran.peaks["control_sensitivity"].value
    )
    design = rid.design_controller(ran, PID(filter=FILTER), limits=limits, maximise="integral gain")
    print(design.summary())
    if design.controller is None:
        return design

    loops = {"ran": ran, "designed": design.proofs[0]}
    omega = TWO_PI * np.array(SHOWN_HZ)
    print("\n3. |S|, what is left of a disturbance at the output: worst consistent plant (true plant)")
    print(" " * 12 + "".join(f"{hz:>10g} Hz     " for hz in SHOWN_HZ) + "peak")
    grid = np.linspace(0, np.pi / DT, 20_001)[1:]
    for name, bounds in loops.items():
        true = sensitivity(plant, bounds.controller, omega)
        cells = "".join(f"{one:9.3f} ({own:.3f})" for one, own in zip(largest(bounds, omega), true, strict=True))
        peak = bounds.peaks["sensitivity"].value
        print(f"{name:12s}{cells}{peak:9.3f} ({sensitivity(plant, bounds.controller, grid).max():.3f})")
    size = np.abs(control.feedback(plant, design.controller).poles()).max()
    print(f"The largest pole of the true loop is {size:.4f} in size. Zero is what is left of a steady load now.")
    figure_of(plant, loops).savefig(out / "controller.png", dpi=110)
    rid.write_report(design, out / "controller.html")
    print(f"Picture and page: {out}")
    return design


if __name__ == "__main__":
    main()
