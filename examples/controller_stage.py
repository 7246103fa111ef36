"""A simulated wafer stage, measured under a slow controller at several positions: one faster controller for all of them, proved.

A rigid body, 1/(m s^2), with flexible modes whose frequencies and shapes depend on where the stage stands; sampled, with a sample
of delay, noise at the sensor. It floats, so that it is measured in the loop of a slow lead controller. At every position the loop
shows a stable system R, from which all plants follow that agree with the record. One PID with two notches and a low-pass is then
designed for all plants of all positions, as fast as the peak of the sensitivity allows. Of positions between these nothing is
proved: the true plants there are only looked at.

Run: python controller_stage.py --out folder (one minute)
"""

import argparse
import tempfile
from pathlib import Path

import control
import numpy as np
from matplotlib.figure import Figure

import robustid as rid
from robustid.core import response
from robustid.design import PID, Limits, LowPass, Notch

TWO_PI = 2 * np.pi
DT, PERIOD, PERIODS = 1 / 2000, 2000, 6
GAIN = 1e6 / 12.0  # µm/N of a stage of 12 kg, times s^2
MODES = ((140.0, 0.03, 0.5), (230.0, 0.03, -0.6))  # Hz, damping, gain over that of the rigid body, in the middle
MOVED = ((0.03, 0.4), (-0.02, 0.3))  # of frequency and gain, from the middle to the end
POSITIONS = (-1.0, 1.0)  # that are measured
BETWEEN = (-0.5, 0.0, 0.5)
SLOW_HZ, FORCE, NOISE = 8.0, 20.0, 0.05  # crossover of the controller that ran, N, µm
LINES = np.unique(np.append(np.arange(1, 30), np.geomspace(30, 950, 120).astype(int)))  # of the period, Hz
PEAK = 2.0
LEAST_INTEGRAL = 1.0  # N/(µm s): a steady force leaves no error, after a second or two
QUIET = 0.1, 5.0, 0.2  # Hz, and |S| at most: without it the loop may ring slowly, which no peak forbids
STRUCTURE = (PID(filter=TWO_PI * 150), Notch(TWO_PI * 140, 0.5), Notch(TWO_PI * 230, 0.5), LowPass(TWO_PI * 500, 2))


def stage(position):
    """The plant at a position between -1 and 1, from force to position of the sensor in µm."""
    plant = control.ss(control.tf([GAIN], [1, 0, 0]))
    for (hz, damping, gain), (softer, other) in zip(MODES, MOVED, strict=True):
        omega = TWO_PI * hz * (1 + softer * position)
        part = gain * (1 + other * position) * GAIN
        plant += control.ss(control.tf([part], [1, 2 * damping * omega, omega**2]))
    return control.c2d(plant, DT) * control.ss(control.tf([1], [1, 0], DT))


def slow():
    """The controller that runs: a lead, and a low-pass."""
    omega = TWO_PI * SLOW_HZ
    lead = omega**2 / GAIN / 3 * control.tf([3 / omega, 1], [1 / (3 * omega), 1])
    return control.ss(control.c2d(lead * control.tf([1], [1 / (TWO_PI * 60), 1]), DT, "tustin"))


def measured(position, seed):
    """Record of the loop in steady state: a multisine of 20 N at the input, noise at the sensor."""
    rng = np.random.default_rng([7, seed])
    spectrum = np.zeros(PERIOD // 2 + 1, complex)
    spectrum[1 : PERIOD // 2 - 40] = np.exp(2j * np.pi * rng.random(PERIOD // 2 - 41))
    r = np.fft.irfft(spectrum)
    r = np.tile(FORCE * r / r.std(), PERIODS + 1)
    plant, law = stage(position), slow()
    noise = NOISE * rng.standard_normal(r.size)
    y = control.forced_response(control.feedback(plant, law), inputs=r).outputs
    y = y + control.forced_response(control.feedback(1, plant * law), inputs=noise).outputs
    u = r - control.forced_response(law, inputs=y).outputs
    settled = slice(PERIOD, None)
    return rid.TimeRecord(
        u[settled],
        y[settled],
        dt=DT,
        reference=r[settled],
        initial="periodic",
        inputs=["force [N]"],
        outputs=["position [µm]"],
    )


def bounded(record):
    """Worst cases of the loop that ran, over every plant that agrees with the record."""
    closed = rid.TimeRecord(record.reference, record.y, dt=DT, initial="periodic")
    loop = rid.prepare.loop_from_data(rid.estimate_frf(closed, period=PERIOD, lines=LINES), slow())
    frf = rid.prepare.loop_response(record, loop, period=PERIOD, lines=LINES)
    guess = rid.Prior(gain_bound=float(np.abs(frf.values).max()), decay_rate=1.2)
    prior = rid.suggest_prior(rid.MixedProblem(frequency=frf, prior=guess)).prior
    result = rid.identify(rid.MixedProblem(frequency=frf, prior=prior)).require()
    return rid.loop_bounds(rid.band(result), loop)


def figure_of(loops, design):
    """Plants of all positions with what is known of them; |S| of the worst of all, and of the true ones."""
    figure = Figure(figsize=(8.5, 7.5), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    omega = np.geomspace(TWO_PI, np.pi / DT, 3000)
    hz, worst = omega / TWO_PI, np.zeros(omega.size)
    for k, (position, ran) in enumerate(loops.items()):
        centre, radius = ran.plant_at(omega)
        size = np.abs(centre[:, 0, 0])
        above.fill_between(
            hz,
            np.maximum(size - radius, 1e-6),
            size + radius,
            color=f"C{k}",
            alpha=0.5,
            lw=0,
            label=f"position {position:g}",
        )
        above.plot(hz, size, color=f"C{k}", lw=0.8)
        S, reach = design.proofs[k].at(omega)["sensitivity"]
        worst = np.maximum(worst, np.abs(S[:, 0, 0]) + reach)
    above.set(xscale="log", yscale="log", ylim=(1e-5, 1e4), ylabel="|position/force| [µm/N]")
    for k, position in enumerate((*POSITIONS, *BETWEEN)):
        label = "true plants at these positions" * (k == 0) + "true plants between them" * (k == len(POSITIONS))
        S = 1 / np.abs(1 + response(stage(position), omega * DT) * response(design.controller, omega * DT))
        below.loglog(hz, S, lw=0.8, color="k" if position in POSITIONS else "C2", label=label or None)
    below.loglog(hz, worst, color="C3", lw=1.4, label="worst consistent plant of all positions, proved")
    below.axhline(PEAK, color="0.5", ls="--", lw=1)
    below.set(xlabel="frequency [Hz]", ylabel="sensitivity |S|", xlim=hz[[0, -1]])
    for axes in (above, below):
        axes.grid(color="0.93", which="both")
        axes.legend(frameon=False, loc="lower left" if axes is above else "lower right")
    return figure


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=None, help="folder for the picture; default: a temporary one")
    out = parser.parse_args(argv).out or Path(tempfile.mkdtemp())
    out.mkdir(parents=True, exist_ok=True)

    print("1. The loop that ran, with every plant that agrees with the record of a position:")
    loops = {position: bounded(measured(position, seed)) for seed, position in enumerate(POSITIONS)}
    for position, ran in loops.items():
        print(f"   position {position:5g}: |S| at most {ran.peaks['sensitivity'].value:.3f}")

    print("\n2. One controller for all of them:")
    low, high, left = QUIET
    quiet = [(TWO_PI * low, TWO_PI * high, left)]
    limits = Limits(sensitivity_peak=PEAK, integral_gain=LEAST_INTEGRAL, attenuation=quiet)
    design = rid.design_controller(list(loops.values()), STRUCTURE, limits=limits)
    print(design.summary())
    if design.controller is None:
        return design

    print("\n3. The true plants:  largest pole   peak of |S|   |L| is 1 at")
    grid = np.geomspace(1.0, np.pi / DT, 20_000)
    for position in sorted((*POSITIONS, *BETWEEN)):
        plant = stage(position)
        size = np.abs(control.feedback(plant, design.controller).poles()).max()
        L = response(plant, grid * DT) * response(design.controller, grid * DT)
        crossing = grid[np.argmax(np.abs(L) < 1)] / TWO_PI
        known = "measured" if position in POSITIONS else "not measured"
        print(
            f"   position {position:5g}: {size:12.4f} {np.abs(1 / (1 + L)).max():13.3f} {crossing:10.1f} Hz   {known}"
        )
    figure_of(loops, design).savefig(out / "controller.png", dpi=110)
    rid.write_report(design, out / "controller.html")
    print(f"\nPicture and page: {out}")
    return design


if __name__ == "__main__":
    main()
