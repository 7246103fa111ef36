"""Measured data: decentralised damping of a beam, 2x2, that provably stabilises every plant that agrees with the measurement.

Two piezo patches, two accelerometers, one loop from each accelerometer to the patch of its number: positive position feedback, a
low-pass filter at the first mode, whose phase makes the feedback a damper there. Identified from a few frequency points of two
swept sines, bounded on the whole circle; then, for every gain: is every consistent plant stabilised, by how much, and which
frequency and which entry of the matrix limits it.

Data: beam_ring/symexc_1.mat and asymexc_1.mat of github flavioluiz/MIMO-FRF (BSD-2), downloaded once, or from the folder that
ROBUSTID_DATA names.
Run: python beam_damping.py --out folder (40 s of computation)
"""

import argparse
import dataclasses
import tempfile
from pathlib import Path

import control
import numpy as np
from matplotlib.figure import Figure

import robustid as rid
from robustid.errors import DatasetNotFoundError

DECIMATED = 10  # to 100 Hz: modes above 45 Hz are left to the filter
BAND_HZ = (9.0, 45.0)
MODES_HZ, DAMPING = (11.222, 22.563, 28.102, 33.208), (0.00147, 0.00195, 0.00468, 0.00504)  # found in beam_mimo.py
WIDE = 10  # frequency points over the band, besides three at each mode
PRIOR = rid.Prior(gain_bound=0.03, decay_rate=1.5)
SPARE = 1.1  # on the factor that the bounds need
CIRCLE = 1.0  # by which the bound of an arc may exceed those at its ends
ORDER = 16  # of the truncated model whose damping is shown
FILTER_DAMPING = 0.3
GAINS = (4.0, 16.0, 40.0)
WEIGHT_ORDER = 2  # of every weight, at most
SHOWN = 1  # the gain that is drawn and weighted


def measured():
    """The response between 9 and 45 Hz, and the points of it that are used."""
    records = [rid.prepare.decimate(record, DECIMATED) for record in rid.datasets.load("beam_ring")]
    length = records[0].u.shape[0] * records[0].dt
    frf = rid.estimate_frf(records, lines=np.arange(*(int(hz * length) for hz in BAND_HZ)))
    near = np.outer(MODES_HZ, np.ones(3)) + np.outer(np.multiply(MODES_HZ, DAMPING), [-4, 0, 4])
    wanted = np.concatenate([near.ravel(), np.linspace(*frf.freq_hz[[0, -1]], WIDE)])
    return frf, frf.select(np.unique(np.argmin(np.abs(frf.freq_hz[:, None] - wanted), axis=0)))


def identified(used):
    """A class that the points are consistent with: where it is refuted all bounds as much wider as it needs, and said so."""
    basis = rid.kautz(2 * np.pi * np.array(MODES_HZ), DAMPING, dt=used.dt, delay=1)
    problem = rid.MixedProblem(frequency=used, prior=PRIOR, parametric=basis)
    result, bounds = rid.identify(problem, accuracy=1e-2), "bounds as estimated"
    if not result.consistent:  # the beam is not linear down to its noise
        factor = SPARE * result.margin
        wider = used.with_bound(factor * used.bound, f"{used.bound.words()}, times {factor:.3g}: what this class needs")
        result = rid.identify(dataclasses.replace(problem, frequency=wider), accuracy=1e-2).require()
        bounds = f"bounds times {factor:.3g}, what this class needs"
    print(
        f"1. {used.omega.size} frequency points of two sweeps, {len(MODES_HZ)} modes; {bounds}:\n"
        f"   {result.status.name.lower()}, margin {result.margin:.3g}."
    )
    return result


def damper(gain, dt):
    """Positive position feedback, one loop for each pair: u = -K y with K = -gain w^2/(s^2 + 2 zeta w s + w^2)."""
    w = 2 * np.pi * MODES_HZ[0]
    filter_ = control.tf([-gain * w**2], [1, 2 * FILTER_DAMPING * w, w**2])
    one = control.ss(control.sample_system(filter_, dt, "bilinear", prewarp_frequency=w))
    return control.append(one, one)


def first_mode(loop):
    """Damping ratio of the least damped pole of a loop within 5 % of the first mode."""
    s = np.log(loop.poles().astype(complex)) / loop.dt
    near = s[np.abs(np.abs(s) - 2 * np.pi * MODES_HZ[0]) < 0.1 * np.pi * MODES_HZ[0]]
    return float(np.min(-near.real / np.abs(near)))


def plot(error, damped, result):
    """Largest singular values of the model, undamped and damped, with the bound of the error; and the margin on every cell."""
    figure = Figure(figsize=(8, 6.4), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    hz = np.unique(np.concatenate([np.linspace(5, 48, 2000), *(f * np.linspace(0.98, 1.02, 200) for f in MODES_HZ)]))
    for model, name, colour in ((error.model, "undamped", "0.6"), (damped, "damped", "C0")):
        values = np.moveaxis(model(np.exp(2j * np.pi * hz * error.model.dt)), 2, 0)
        above.semilogy(hz, np.linalg.norm(values, 2, axis=(1, 2)), colour, lw=1, label=f"model, {name}")
    circle = error.known_circle
    above.stairs(
        circle.bound, circle.edges / (2 * np.pi), color="C3", lw=1, label="guaranteed error of the model", baseline=None
    )
    above.set_ylabel("largest singular value [output per V]")
    above.legend(loc="upper right", frameon=False)
    below.stairs(result.margins, result.edges / (2 * np.pi), color="C2", baseline=None)
    below.axhline(1, color="C3", lw=1)
    below.set(yscale="log", ylim=(0.5, 200), xlim=(5, 48), xlabel="frequency [Hz]", ylabel="robust stability margin")
    for axes in (above, below):
        axes.grid(color="0.93")
    return figure


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="folder for picture and page (default: a temporary one)")
    arguments = parser.parse_args(argv)
    try:
        frf, used = measured()
    except DatasetNotFoundError as missing:
        print(f"This example needs measured data. {missing}")
        return
    out = arguments.out or Path(tempfile.mkdtemp(prefix="robustid-"))
    out.mkdir(parents=True, exist_ok=True)

    result = identified(used)
    omega = 2 * np.pi * np.array(MODES_HZ)
    error = rid.worst_case_error(result, omega=omega, directions=6, rtol=0.3)
    circle = error.on_circle(CIRCLE, everywhere=True)
    print(
        f"\n2. Every consistent plant is within {circle.largest:.3g} of the model of order {error.model.nstates} at every\n"
        f"   frequency (near {circle.peak / (2 * np.pi):.4g} Hz; reached: {circle.lower:.3g}); the model itself reaches"
        f" {np.linalg.norm(error.nominal, 2, axis=(1, 2)).max():.3g}. {circle.bound.size} arcs."
    )

    print("\n3. One damper for each pair of patch and accelerometer:")
    print("   gain  damping in %  margin  small gain  limited at      by entry (its share)")
    small, shown = rid.balanced_truncation(result.model, order=ORDER).model, None  # without states that cancel
    margins = {}
    for gain in GAINS:
        controller = damper(gain, frf.dt)
        found = margins[f"gain {gain:g}"] = error.robust_stability_margin(controller)
        plain = rid.guarantee.robust_stability_margin(error.model, controller, circle.edges, circle.bound)
        damped = control.feedback(small, controller)
        damping = f"{100 * first_mode(damped):9.2f}" if found.margin else "        -"
        i, j = found.entry
        entry = f"{frf.inputs[j].name} to {frf.outputs[i].name} ({100 * found.shares[i, j]:.0f} %)"
        where = f"{found.frequency / (2 * np.pi):8.2f} Hz     {entry}"
        print(f"{gain:7g}{damping}{found.margin:12.3g}{plain.margin:12.3g}{where}; {found.status.value.split(':')[0]}")
        if gain == GAINS[SHOWN]:
            shown = controller, found, damped
    controller, found, damped = shown
    print(
        f"   Undamped: {100 * DAMPING[0]:.2f} %. Margin: the factor by which all errors could grow before stability is no longer\n"
        "   guaranteed; small gain: what the bound of the largest singular value alone says. Assumed, not proved: linearity, the\n"
        "   poles, |G| <= K in |z| < rho, and the bounds; vibration above 45 Hz was filtered away and is not in these data."
    )

    print(f"\n4. Weights for a synthesis, by what they cost at gain {GAINS[SHOWN]:g}:")
    bounds = circle.bound, circle.entries
    weights = rid.guarantee.structured_weights(
        error.model, circle.edges, bounds, controller=controller, order=WEIGHT_ORDER
    )
    for weight in weights:
        count, proved = len(weight.weights), "certified" if weight.certified else "NOT CERTIFIED"
        print(
            f"   {weight.structure:7s} {count} weights, {weight.order:2d} states: margin {weight.margin.margin:6.3g},"
            f" mean radius {weight.radius:.3g}; {proved}"
        )

    plot(error, damped, found).savefig(out / "damping.png", dpi=110)
    rid.write_report(result, out / "damping.html", worst_case=error, stability=margins, weights=weights)
    print(f"\nPicture and page: {out}")


if __name__ == "__main__":
    main()
