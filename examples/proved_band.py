"""A band that is proved at every frequency, in milliseconds each: with the pole as it was fitted, and wherever the data leave it.

Simulated: a resonance at 77 Hz with a damping ratio of 0.008 beside a heavily damped mode, and 60 frequency points with bounds
of 2 % of the response. The pole is fitted to these points, and so are the intervals that they leave to it, the pole-uncertainty
box. One band takes the fitted pole as exact, which it is not; the other holds for all poles in the box.

Run: python proved_band.py --out folder (some seconds)
"""

import argparse
import dataclasses
import importlib.util
import tempfile
import time
from pathlib import Path

import control
import numpy as np
from matplotlib.figure import Figure

import robustid as rid
from robustid.core import response

DT = 1e-3  # s
HZ, DAMPING = np.array([77.0, 130.0]), np.array([0.008, 0.4])  # the second one is the rest, in no list of modes
GAINS = np.array([1.0, 4.0])  # static, of each
BOUND = 0.02  # of the response
LINES_HZ = np.unique(np.concatenate([np.linspace(8, 492, 52), np.linspace(73, 81, 8)]))
SHOWN_HZ = np.unique(np.concatenate([np.linspace(0, 500, 501), np.linspace(75.5, 78.5, 121)]))
CLASS = rid.Prior(gain_bound=12.0, decay_rate=1.15)  # of the rest; true here, an assumption of a plant


def truth():
    """The plant behind a zero-order hold."""
    s, omega = control.tf("s"), 2 * np.pi * HZ
    modes = [g * w**2 / (s**2 + 2 * d * w * s + w**2) for g, w, d in zip(GAINS, omega, DAMPING, strict=True)]
    return control.ss(control.sample_system(sum(modes), DT))


def measured(plant):
    """Frequency points with errors anywhere in their discs."""
    omega, rng = 2 * np.pi * LINES_HZ, np.random.default_rng(0)
    exact = response(plant, omega * DT)
    bound = BOUND * np.abs(exact)
    error = bound * np.sqrt(rng.random(bound.shape)) * np.exp(2j * np.pi * rng.random(bound.shape))
    return rid.FrequencyResponse(omega, exact + error, bound=bound, dt=DT)


def draw(bands, plant, frf):
    """Response and bands above, half-widths in per cent of the response below; the resonance once more on the right."""
    exact = np.abs(response(plant, 2 * np.pi * SHOWN_HZ * DT))
    figure = Figure(figsize=(11, 6.4), layout="constrained")
    axes = figure.subplots(2, 2, sharex="col")
    for (above, below), (low, high) in zip(axes.T, ((0, 500), (75.5, 78.5)), strict=True):
        shown = (low <= SHOWN_HZ) & (high >= SHOWN_HZ)
        hz = SHOWN_HZ[shown]
        for (name, band), color in zip(reversed(bands.items()), ("tab:orange", "tab:blue"), strict=True):
            centre, radius = np.abs(band.centre[shown, 0, 0]), band.radius[shown, 0, 0]
            lower = np.maximum(centre - radius, 1e-3 * exact.min())
            above.fill_between(hz, lower, centre + radius, color=color, alpha=0.45, lw=0, label=f"proved, {name}")
            below.plot(hz, 100 * radius / exact[shown], color=color, lw=1, label=name)
        above.plot(hz, exact[shown], "k", lw=0.8, label="the plant")
        inside = (low <= LINES_HZ) & (high >= LINES_HZ)
        above.plot(LINES_HZ[inside], np.abs(frf.values[inside, 0, 0]), "k.", ms=3, label="frequency points")
        if high > 100:
            above.set_yscale("log")
        above.set_xlim(low, high)
        below.set(xlabel="frequency (Hz)", ylim=(0, None))
        for ax in (above, below):
            ax.grid(alpha=0.3, which="both")
    axes[0, 0].set(ylabel="magnitude", title="discs of all consistent systems")
    axes[0, 1].set_title("around the resonance")
    axes[1, 0].set_ylabel("radius of the disc (% of the response)")
    axes[0, 0].legend(fontsize="small", loc="upper right")
    axes[1, 0].legend(fontsize="small", loc="lower left")
    return figure


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="folder for the picture (default: a temporary one)")
    out = parser.parse_args(argv).out or Path(tempfile.mkdtemp(prefix="robustid-"))
    out.mkdir(parents=True, exist_ok=True)

    plant = truth()
    frf = measured(plant)
    found = rid.suggest_kautz(frf, delay=1)
    light = found.damping < 0.1  # the other decays fast enough to be a part of the rest
    box = found.omega_interval[light], found.damping_interval[light]
    basis = rid.kautz(found.omega[light], found.damping[light], dt=DT, delay=1)
    problem = rid.MixedProblem(frequency=frf, prior=CLASS, parametric=basis)
    result = rid.identify(problem).require()
    small = rid.reduce_within_bounds(result)
    print(
        f"1. {problem.samples} samples, one mode: consistent, margin {result.margin:.3f}; a model of order {small.order}"
    )
    hz, (low, high) = found.omega[light][0] / (2 * np.pi), box[0][0] / (2 * np.pi)
    print(f"   natural frequency: fitted {hz:.3f} Hz, the data leave {low:.3f} to {high:.3f} Hz; true {HZ[0]:g} Hz")
    damping, (low, high) = found.damping[light][0], box[1][0]
    print(f"   damping ratio: fitted {damping:.5f}, the data leave {low:.5f} to {high:.5f}; true {DAMPING[0]:g}")

    other = dataclasses.replace(problem, prior=rid.Prior(gain_bound=0.3, decay_rate=1.15))
    print(f"   with a gain bound of 0.3: {rid.guarantee.contradiction(other).summary()}")

    omega, exact = 2 * np.pi * SHOWN_HZ, response(plant, 2 * np.pi * SHOWN_HZ * DT)
    peak = int(np.argmax(np.abs(exact)))
    bands = {}
    print(f"\n2. Bands around that model, at {omega.size} frequencies and all between them:")
    for name, poles in (("the fitted pole as exact", None), ("any pole of the box", box)):
        start = time.perf_counter()
        band = rid.band(result, omega=omega, box=poles, model=small.model)
        took = time.perf_counter() - start
        bands[name] = band
        centre, radius = band.at(omega)
        off = np.abs(exact - centre[:, 0, 0]) / radius[:, 0, 0]
        print(
            f"   {name}: {took:.1f} s, {1e3 * took / band.bands[0].angles.size:.1f} ms a frequency searched\n"
            f"      the model at the resonance: within {100 * band.upper[peak, 0, 0] / np.abs(exact[peak]):.2f} % of"
            f" every consistent system; H-infinity bound {band.hinf:.3g}\n"
            f"      the plant is {'inside' if off.max() <= 1 else 'OUTSIDE'}: {off.max():.2f} radii from the centre at most;"
            f" evaluated again: {'all discs hold' if band.certified else 'NOT ALL DISCS HOLD'}"
        )
    wide = bands["any pole of the box"]
    gain, peak_step = (float(one.item()) for one in (wide.static_gain[0], wide.peak_step()))
    print(
        f"   static gain {gain:.3f} ± {wide.static_gain[1].item():.3f}; no step response exceeds {peak_step:.3f}, ever"
    )
    if importlib.util.find_spec("flint"):
        exactly = wide.verify(exact=True)
        print(
            f"\n3. In ball arithmetic, all rounding enclosed: {'all discs hold' if exactly else 'NOT ALL DISCS HOLD'}"
        )
    else:
        print("\n3. For ball arithmetic install robustid[exact].")
    draw(bands, plant, frf).savefig(out / "proved_band.png", dpi=110)
    print(f"\nPicture: {out / 'proved_band.png'}")
    return bands


if __name__ == "__main__":
    main()
