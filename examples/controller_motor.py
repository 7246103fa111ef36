"""Measured data: the fastest controller of a motor bench that keeps its margins with every plant that agrees with the measurement.

Current to torsion of the coupling, as in motor_torsion.py, which explains the bounds. Two stretches of the record are a family: a
band each, with the poles anywhere in the box that the data leave; one controller is designed for all plants of both: PID with a
filter, a notch at the torsion resonance and a low-pass. A third stretch, which nothing was designed from, judges it.

Data: two_mass/MultisineTypeA.mat of github HoriFujimotoLab/FdiTools (MIT). Set ROBUSTID_DATA to the folder that holds two_mass/.
Run: python controller_motor.py --out folder (half a minute)
"""

import dataclasses

import numpy as np
from matplotlib.figure import Figure
from motor_torsion import PERIOD, opened

import robustid as rid
from robustid.design import PID, Limits, LowPass, Notch

TWO_PI = 2 * np.pi
STRETCHES = 3  # periods 1, 4, ..; 2, 5, ..: the family; 3, 6, ..: withheld
EVERY = 2  # frequency points used: every second
PEAK, GAIN_MARGIN = 2.0, 2.0
STRUCTURE = (PID(filter=TWO_PI * 300), Notch(TWO_PI * 77, 0.3), LowPass(TWO_PI * 300, 2))


def stretches(record):
    """The response of every third period of the record, three times."""
    for start in range(STRETCHES):
        u, y, r = (
            s.reshape(-1, PERIOD, s.shape[1])[start::STRETCHES].reshape(-1, s.shape[1])
            for s in (record.u, record.y, record.reference)
        )
        yield rid.estimate_frf(dataclasses.replace(record, u=u, y=y, reference=r), period=PERIOD)


def banded(frf):
    """A class that the points are consistent with, and the band of all its plants about the central one."""
    frf = frf.select(slice(None, None, EVERY))
    modes = rid.suggest_kautz(frf)
    guess = rid.Prior(gain_bound=float(np.abs(frf.values[0, 0, 0])), decay_rate=1.2)
    problem = rid.MixedProblem(frequency=frf, prior=guess, parametric=modes.basis)
    problem = dataclasses.replace(problem, prior=rid.suggest_prior(problem).prior)
    result = rid.identify(problem).require()
    return rid.band(result, box=modes)


def value(controller, omega):
    return controller(np.exp(1j * omega * controller.dt))


def figure_of(design, withheld):
    """Discs of the plants with the withheld response; the proved bound of |S| with its values for that response."""
    figure = Figure(figsize=(8.5, 7), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    dt = design.controller.dt
    omega = np.geomspace(TWO_PI * 2, np.pi / dt, 3000)
    hz, largest = omega / TWO_PI, np.zeros(omega.size)
    for k, proof in enumerate(design.proofs):
        centre, radius = proof.plant_at(omega)
        size = np.abs(centre[:, 0, 0])
        above.fill_between(
            hz, np.maximum(size - radius, 1e-7), size + radius, color=f"C{k}", alpha=0.3, lw=0, label=f"stretch {k + 1}"
        )
        above.plot(hz, size + radius, color=f"C{k}", lw=0.8)
        S, reach = proof.at(omega)["sensitivity"]
        largest = np.maximum(largest, np.abs(S[:, 0, 0]) + reach)
    above.loglog(withheld.freq_hz, np.abs(withheld.values[:, 0, 0]), ".", ms=3, color="k", label="stretch 3, withheld")
    above.set(ylabel="|torsion/current| [rad per unit]", ylim=(1e-6, 0.3))
    L = withheld.values[:, 0, 0] * value(design.controller, withheld.omega)
    below.semilogx(hz, largest, color="C3", lw=1.2, label="|S| of the worst consistent plant, proved")
    below.plot(withheld.freq_hz, 1 / np.abs(1 + L), ".", ms=3, color="k", label="|S| with the withheld response")
    below.axhline(PEAK, color="0.5", lw=1, ls="--", label="limit")
    below.axvline(design.level / TWO_PI, color="C2", lw=1, label="bandwidth of the worst plant")
    below.set(xlabel="frequency [Hz]", ylabel="sensitivity |S|", ylim=(0, 1.15 * PEAK), xlim=(hz[0], hz[-1]))
    for axes in (above, below):
        axes.grid(color="0.93")
        axes.legend(frameon=False, loc="lower left" if axes is above else "lower right", fontsize=9)
    return figure


def main(argv=None):
    record, out = opened(argv, __doc__)
    if record is None:
        return None

    *family, withheld = stretches(record)
    print(
        f"1. {withheld.omega.size} excited lines of each of {STRETCHES} stretches; every {EVERY}. of two is used.\n"
        f"   {withheld.bound.about}"
    )
    bands = [banded(frf) for frf in family]
    for band in bands:
        print(band.summary())

    print("\n2. One controller for all plants of both:")
    limits = Limits(sensitivity_peak=PEAK, gain_margin=GAIN_MARGIN)
    design = rid.design_controller(bands, STRUCTURE, limits=limits)
    print(design.summary())
    if design.controller is None:
        return design

    peak = max(proof.peaks["sensitivity"].value for proof in design.proofs)
    C = np.abs(value(design.controller, withheld.omega))
    X = np.abs(1 + withheld.values[:, 0, 0] * value(design.controller, withheld.omega))
    size = withheld.bound.outer_radius[:, 0, 0] * C
    print(
        f"\n3. With the response of the third stretch: |S| at most {1 / X.min():.3f} at its lines; within its own bounds"
        f" ({withheld.bound.probability:.0%} jointly)\n   it is certainly below the proved peak, {peak:.3f}, at"
        f" {np.mean(X - size >= 1 / peak):.1%} of the lines and certainly above it at {np.mean(X + size < 1 / peak):.1%}."
    )
    figure_of(design, withheld).savefig(out / "controller.png", dpi=110)
    rid.write_report(design, out / "controller.html")
    rid.save(out / "design_controller.npz", design.controller)
    print(f"\nPicture, page and controller: {out}")
    return design


if __name__ == "__main__":
    main()
