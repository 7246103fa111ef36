"""A levitated mass that runs only under its controller: its plant, margins of all consistent plants, a gain that would crash it.

The machine is simulated as it runs: sampled at 1 kHz, an output that is known one sample late, a sensor of 16 bits, an amplifier
that saturates, coloured noise from the floor. Noise is added at the input and recorded. A response from u to y, which is what users
take, is wrong by the loop: the input answers the noise too. The loop shows a stable system R, without that error; every plant that
agrees with the record follows from it. Another controller is then tried: proved for every consistent plant, or refused with one
that it does not stabilise.

Run: python levitation.py --out folder (about half a minute)
"""

import argparse
import tempfile
from pathlib import Path

import control
import numpy as np

import robustid as rid

DT, SAMPLES = 0.001, 4000
STEP, LIMIT = 2.0 / 2**16, 8.0  # of the sensor, of the amplifier
GAIN, POLE = 6.0, 0.5
SETS = (
    (1.0, 0.965),
    (1.6, 0.965),
    (0.45, 0.965),
    (0.9, 0.985),
    (0.6, 0.985),
)  # parts of the gain that ran, and the zero


def machine():
    """The mass with its magnet and a mode of the frame, sampled; one sample of delay."""
    mass = control.tf([2e4], [1, 10, -2.5e3])
    frame = control.tf([4e2], [1, 2 * 0.02 * 900, 900**2])
    sampled = control.c2d(control.ss(mass) + control.ss(frame), DT)
    return sampled * control.ss(control.tf([1], [1, 0], DT))


def controller(part=1.0, zero=0.965):
    return control.ss(part * GAIN * control.tf([1, -zero], [1, -POLE], DT))


def measured(plant, seed=0):
    """Record of the loop, sample by sample: quantised output, saturated input, u = r - C y."""
    rng = np.random.default_rng(seed)
    r = 0.4 * rng.standard_normal(SAMPLES)
    floor = control.forced_response(control.tf([0.05], [1, -0.95], DT), inputs=0.4 * rng.standard_normal(SAMPLES))
    A, B, C, _ = (np.asarray(part) for part in (plant.A, plant.B, plant.C, plant.D))
    law = controller()
    E, F, G, H = (np.asarray(part) for part in (law.A, law.B, law.C, law.D))
    x, s = np.zeros(len(A)), np.zeros(len(E))
    u, y = np.zeros(SAMPLES), np.zeros(SAMPLES)
    for k in range(SAMPLES):
        y[k] = STEP * np.round((C @ x + floor.outputs[k]).item() / STEP)
        u[k] = np.clip(r[k] - (G @ s + H[:, 0] * y[k]).item(), -LIMIT, LIMIT)
        x, s = A @ x + B[:, 0] * u[k], E @ s + F[:, 0] * y[k]
    return rid.TimeRecord(u, y, dt=DT, reference=r, inputs=["current [A]"], outputs=["gap [mm]"])


def phase_margin(response, omega, law):
    """As it is read from a Bode plot: at the last crossing of 1 of the open loop."""
    L = response * law(np.exp(1j * omega * DT))
    crossings = np.flatnonzero((np.abs(L[:-1]) > 1) & (np.abs(L[1:]) <= 1))
    return float(np.degrees(np.angle(-L[crossings[-1]]))) if crossings.size else np.inf


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=None, help="folder for picture and page; default: a temporary one")
    out = parser.parse_args(argv).out or Path(tempfile.mkdtemp())
    out.mkdir(parents=True, exist_ok=True)
    plant = machine()
    record = measured(plant)
    loop = rid.prepare.loop_from_data(record, controller())
    print(
        f"{loop}: auxiliary plant of order {loop.auxiliary.nstates}, poles up to {abs(loop.auxiliary.poles()).max():.4f}"
    )
    print(f"residual of the controller: {np.abs(loop.residual(record)).max():.2g}")

    lines = np.arange(2, 1980, 10)
    naive = rid.estimate_frf(record, lines=lines)
    frf = rid.prepare.loop_response(record, loop, lines=lines)
    true = plant(np.exp(1j * frf.omega * DT))
    wrong = np.abs(naive.values[:, 0, 0] - true) > naive.bound.outer_radius[:, 0, 0]
    R = loop.response_of(loop.residual_of(plant), frf.omega)
    outside = np.abs(frf.values - R) > frf.bound.outer_radius
    print(f"from u to y: outside its bound at {wrong.mean():.0%} of the lines; R: at {outside.mean():.0%}")

    result = rid.identify_reduced(frf, modes=[], time_limit=20.0)
    small = rid.reduce_plant(result.identification, loop, residual=result.model)
    print(
        f"plant: order {small.order} ({plant.nstates}), nu-gap to the true one {rid.guarantee.nu_gap(plant, small.model).value:.2g}"
    )
    bounds = rid.loop_bounds(result.band, loop)
    print(bounds.summary())

    print("\ngain   zero   phase margin of u to y   verdict on every consistent plant")
    for part, zero in SETS:
        law = controller(part, zero)
        found = rid.loop_bounds(result.band, loop, law)
        shown = found.unstable_plant(result.identification)
        said = "stable, proved" if found.guaranteed else "undecided"
        if shown is not None:
            said = f"refused: a consistent plant has a closed-loop pole of size {abs(shown.loop_poles).max():.4f}"
        stable = abs(control.feedback(plant, law).poles()).max() < 1
        margin = phase_margin(naive.values[:, 0, 0], naive.omega, law)
        print(
            f"{part:4.2f} {zero:6.3f} {margin:20.0f} deg   {said} (the true loop is {'stable' if stable else 'unstable'})"
        )
    rid.write_report(
        result.identification,
        out / "levitation.html",
        title="Levitated mass",
        band=result.band,
        loop=bounds,
        plant=small,
    )
    bounds.plot().savefig(out / "loop.png", dpi=110)
    print(f"Picture and page: {out}")


if __name__ == "__main__":
    main()
