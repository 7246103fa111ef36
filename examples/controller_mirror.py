"""Measured data: three integral controllers for a steering mirror, three inputs and three outputs, proved for every plant.

Voltages of three piezos to three displacements: every input moves every output, and the first mode stands at 636 Hz with a
damping of 1 %. The inverse of the static gain makes three axes of them; each gets a PI controller behind a low-pass, or with two
notches, and together they are proved with every plant that agrees with the bounds and the class, its poles anywhere in their box.
Records that nothing was designed from judge the loop.

Data: github merijnfloren/fsm-benchmark-data (CC BY 4.0; Floren et al., ISMA-USD 2024), downloaded once, or from the folder that
ROBUSTID_DATA names.
Run: python controller_mirror.py --out folder (three minutes; --notches: three and a half)
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np
from shared.worst_loops import TWO_PI, axes_over, largest
from steering_mirror import PERIOD, mirror_records

import robustid as rid
from robustid.design import PID, Limits, LowPass, Matrix, Notch
from robustid.errors import DatasetNotFoundError

PEAK = 2.0
CORNER_HZ = 100  # of the low-pass of every axis
NOTCHES_HZ, DAMPING = (636, 1050), 0.5  # poles of the notches in its place
GAIN_BOUND, DECAY_RATE = 2e-5, 1.1  # metres per volt: what the modes leave
ROOM = 1.3  # of the bounds: at the estimated poles single entries need 1.25
WIDE = 10  # from the least to the largest damping: such a mode is left to the class, for its box would leave its range open
BELOW_HZ, EVERY = (20, 2995), 6  # frequency points used


def banded():
    """The band of all plants that agree with the records, over the box of their poles."""
    records = rid.datasets.load("fsm/train")
    lines = rid.estimate_frf(records, period=PERIOD).select(slice(1, None, 8))
    modes = rid.suggest_kautz(lines)
    low, high = modes.damping_interval.T
    inside = (modes.omega < TWO_PI * 2900) & (high < WIDE * low)  # the data end at 3 kHz
    box = modes.omega_interval[inside], modes.damping_interval[inside]
    smooth = rid.estimate_frf(mirror_records("train"), method="local").band(*BELOW_HZ).select(slice(None, None, EVERY))
    problem = rid.MixedProblem(
        frequency=smooth.with_bound(smooth.bound.inflated(ROOM)),
        prior=rid.Prior(gain_bound=GAIN_BOUND, decay_rate=DECAY_RATE),
        parametric=rid.kautz(modes.omega[inside], modes.damping[inside], dt=smooth.dt, delay=1),
    )
    model = rid.fit_mfd(lines, order=28).model
    return rid.band(problem, box=box, knots=400, model=model)


def structure_of(band, notches):
    """A PI controller behind a low-pass, or with notches, on each of the axes that the inverse of the static gain makes."""
    smooth = [Notch(TWO_PI * hz, DAMPING) for hz in NOTCHES_HZ] if notches else [LowPass(TWO_PI * CORNER_HZ, 2)]
    axis = [PID(), *smooth]
    rows = [[axis if i == j else None for j in range(3)] for i in range(3)]
    return Matrix(rows, actuators=np.linalg.inv(np.real(band.model(1.0))))


def peaks(controller):
    """Frequencies and largest singular values of S with the response of records that were withheld."""
    frf = rid.estimate_frf(rid.datasets.load("fsm/test"), period=PERIOD)
    K = np.moveaxis(controller(np.exp(1j * frf.omega * frf.dt)), -1, 0)
    return frf.freq_hz, np.linalg.norm(np.linalg.inv(np.eye(3) + frf.values @ K), 2, axis=(1, 2))


def figure_of(design, hz, measured):
    """Proved bounds of S and T, and S of the withheld records."""
    omega = np.geomspace(TWO_PI * 0.2, np.pi / design.controller.dt, 1500)
    axes = axes_over(omega, "largest singular value")
    for name, color in (("sensitivity", "C3"), ("complementary_sensitivity", "C0")):
        worst = largest(design.proofs[0], omega, name)
        axes.plot(omega / TWO_PI, worst, color=color, lw=1.4, label=f"{name.replace('_', ' ')}, at most")
    axes.plot(hz, measured, ".", ms=1.5, color="0.4", label="sensitivity, withheld records")
    axes.axhline(PEAK, color="0.5", ls="--", lw=1)
    axes.set_ylim(1e-3, 4)
    axes.legend(frameon=False, loc="lower center")
    return axes.figure


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=None, help="folder for the picture; default: a temporary one")
    parser.add_argument("--notches", action="store_true", help="notches in place of the low-pass: a larger bandwidth")
    arguments = parser.parse_args(argv)
    out = arguments.out or Path(tempfile.mkdtemp())
    out.mkdir(parents=True, exist_ok=True)
    try:
        band = banded()
    except DatasetNotFoundError as error:
        print(error)
        return None
    print("1. The band:", band)
    structure = structure_of(band, arguments.notches)
    design = rid.design_controller(band, structure, limits=Limits(sensitivity_peak=PEAK))
    print("\n2. The controller:")
    print(design.summary())
    if design.controller is None:
        return design
    hz, measured = peaks(design.controller)
    print(f"\n3. Withheld records: largest |S| {measured.max():.3f} at {hz.size} lines, proved at most {PEAK:g}")
    figure_of(design, hz, measured).savefig(out / "controller.png", dpi=110)
    rid.write_report(design, out / "controller.html")
    print(f"\nPicture and page: {out}")
    return design


if __name__ == "__main__":
    main()
