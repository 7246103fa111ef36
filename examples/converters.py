"""Measured impedances of two converters: is their connection stable, whatever the sweeps leave open?

A voltage source inverter (source) and an active front end (its load) in a 400 Hz system. Each impedance was measured in the
rotating frame, d and q, by one sweep of 100 lines from 40 Hz to 10 kHz without bounds, so that these come from the scatter. The
connection is the loop of the source impedance and the load admittance: its poles are the zeros of det(I + Z_s Y_l). The admittance
is the inverse of the measured impedance, line by line; a bound of the impedance would go through it with its proof. Between the
lines, below the first and beyond the last the class decides: a slow mode of each side, as a smooth fit has it, and a rest that is
smooth and no larger than that of the fit with a third to spare.

Data: Wen et al., IEEE Transactions on Power Electronics 30(10), 2015; github wenboklose/TPEL_GNC (MIT), folder VSI_AFE/GNC, files
Zout_VSI_G1_c1_exp.mat and Zin_AFE_G1_exp.mat (averaged ZDQ). Set ROBUSTID_DATA to the folder that holds converter_dq/ with
source_impedance.npz and load_impedance.npz: arrays `omega` (100,) in rad/s and `values` (100, 2, 2) in ohm.
Run: python converters.py --out folder (about a minute)
"""

import argparse
import os
import tempfile
from pathlib import Path

import control
import numpy as np

import robustid as rid

HZ = 2 * np.pi
ORDERS = {"source": 8, "load": 10}  # of the smooth fits
DECAYS = {"source": 800.0, "load": 1200.0}  # 1/s, of all but the slow mode
SPARE = 1.3  # on the size of what the fit has beside the slow mode
KNOTS = 400  # of the bands
SEARCH = 60.0  # seconds for a pair that is not stable


def impedance(folder, name):
    with np.load(folder / f"{name}_impedance.npz") as file:
        omega, values = file["omega"], file["values"]
    return rid.FrequencyResponse(omega, values, inputs=["i_d [A]", "i_q [A]"], outputs=["v_d [V]", "v_q [V]"])


def smooth_fit(frf, order):
    """A strictly proper model that follows every line to the same part of its size."""
    sizes = np.abs(frf.values).max(axis=(1, 2))
    weight = np.broadcast_to(1 / sizes[:, None, None], frf.values.shape)
    fit = rid.fit_mfd(frf, order=order, domain="s", weight=weight).model
    return control.ss(fit.A, fit.B, fit.C, np.zeros((2, 2)))


def class_of(model, decay):
    """The slow mode of a fit, and the class of the rest: its size beyond the axis, with some to spare."""
    poles, right = np.linalg.eig(model.A)
    left = np.linalg.inv(right)
    slow = -poles.real < decay
    omega = np.geomspace(30.0, 6e5, 120)
    terms = (model.C @ right)[None, :, ~slow] / (-decay + 1j * omega[:, None, None] - poles[~slow])
    sizes = np.linalg.norm(terms @ (left @ model.B)[~slow], 2, axis=(1, 2))
    near = np.abs(np.log(omega[:, None] / omega)) < 0.25
    level = SPARE * np.where(near, sizes, 0.0).max(axis=1)
    weight = rid.advise.prior_weight(omega, np.maximum(level / level.max(), 1e-3))
    first = poles[slow][0]
    if first.imag:
        basis = rid.kautz([abs(first)], [-first.real / abs(first)], dt=0)
    else:
        basis = control.ss(first.real, -first.real, 1.0, 0.0)
    words = (
        f"{abs(first) / HZ:.4g} Hz, damping {-first.real / abs(first):.2g}" if first.imag else f"{first.real:.4g} 1/s"
    )
    print(f"   slow mode at {words}; the rest decays with {decay:g}/s and is at most {level.max():.3g} there")
    return basis, rid.Prior(gain_bound=float(level.max()), decay=decay, weight=weight)


def proved_band(name, frf):
    """The band of one side about its smooth fit."""
    print(f"{name}: bound of the samples {frf.note.split(':')[0]}")
    model = smooth_fit(frf, ORDERS[name])
    basis, prior = class_of(model, DECAYS[name])
    problem = rid.MixedProblem(frequency=frf, prior=prior, parametric=basis)
    band = rid.band(problem, model=model, omega=frf.omega, knots=KNOTS)
    print(f"   known at the lines to {band.relative.words}")
    return band


def judged(folder):
    """The bands of both sides and what follows for their connection."""
    source = rid.estimate_bound(impedance(folder, "source"))
    load = rid.estimate_bound(rid.prepare.inverse_response(impedance(folder, "load")))
    bands = [proved_band(name, frf) for name, frf in (("source", source), ("load", load))]
    return rid.interconnection(*bands, time_limit=SEARCH)


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="folder for the picture (default: a temporary one)")
    arguments = parser.parse_args(argv)
    folder = Path(os.environ.get("ROBUSTID_DATA", "")) / "converter_dq"
    if not os.environ.get("ROBUSTID_DATA") or not (folder / "source_impedance.npz").exists():
        print(
            "This example needs measured data: github wenboklose/TPEL_GNC (MIT). Set ROBUSTID_DATA to the folder that holds"
            " converter_dq/source_impedance.npz and load_impedance.npz"
        )
        return
    out = arguments.out or Path(tempfile.mkdtemp(prefix="robustid-"))
    out.mkdir(parents=True, exist_ok=True)

    found = judged(folder)
    print("\nThe connection, for every source and load that agree with the sweeps:")
    print(found.summary())
    open_arcs = np.flatnonzero(found.margins <= 1)
    if open_arcs.size:
        low, high = found.edges[open_arcs[0]] / HZ, found.edges[open_arcs[-1] + 1] / HZ
        print(
            f"\nEverywhere but between {low:.4g} and {high:.4g} Hz the determinant is kept away from zero for all pairs, from 0 to"
            " infinity.\nThat is where more lines, and quieter ones, decide."
        )
    print(
        "\nAssumed, not proved: linearity, the slow modes as fitted, the class of the rest, and bounds from the scatter of one"
        "\nsweep, which is noise and what a smooth model does not describe."
    )
    found.plot().savefig(out / "loci.png", dpi=110)
    rid.write_report(found, out / "connection.html")
    print(f"\nPicture and page: {out}")


if __name__ == "__main__":
    main()
