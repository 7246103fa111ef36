"""Three classes for one lightly damped structure: which one deserves its model?

Step and frequency data of a mass-beam structure with modes at 9 Hz (well damped) and 17.67 Hz (damping ratio 0.004),
simulated after T. Inanc et al., IEEE Transactions on Control Systems Technology 9(4), 2001.

Run: python flexible_structure.py --out folder
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

import robustid as rid
from robustid.advice import suggest_kautz, suggest_prior
from robustid.core import response

# A class has to be named before its prior is asked for; suggest_prior uses neither of these numbers.
PLACEHOLDER = rid.Prior(gain_bound=1.0, decay_rate=1.1)


def error_in_band(model, truth, dt):
    """Largest error between 1 and 21 Hz, between the samples too; only a simulation can know it."""
    angles = 2 * np.pi * np.linspace(1, 21, 4001) * dt
    return np.abs(response(model, angles) - response(truth, angles)).max()


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="folder for pictures and report (default: a temporary one)")
    out = parser.parse_args(argv).out or Path(tempfile.mkdtemp(prefix="robustid-"))
    out.mkdir(parents=True, exist_ok=True)

    data = rid.datasets.flexible_structure()
    dt = data.frequency.dt
    print("1. Which modes do 11 frequency points, 2 Hz apart, show?")
    print(suggest_kautz(data.frequency).summary())
    print("\n2. And with ten more from 17.2 to 18.1 Hz?")
    closer = rid.datasets.flexible_structure(extra_hz=np.linspace(17.2, 18.1, 10))
    modes = suggest_kautz(closer.frequency)
    print(modes.summary())

    light = int(np.argmin(modes.damping))
    one = rid.kautz(modes.omega[light], modes.damping[light], dt=dt, delay=modes.delay)
    classes = {"no mode (nonparametric)": None, "the light mode": one, "both modes": modes.basis}
    print(
        "\n3. The data of step 1 (11 frequency points, 20 step samples, bound 0.03), three classes, each with its suggested prior:"
    )
    print(
        f"{'parametric part':<24}{'K':>7}{'rho':>7}{'margin':>9}{'order':>7}{'reduced':>9}{'error against the truth':>27}"
    )
    results = {}
    for name, basis in classes.items():
        problem = rid.MixedProblem(frequency=data.frequency, time=data.time, prior=PLACEHOLDER, parametric=basis)
        prior = suggest_prior(problem).prior
        problem = problem.with_prior(gain_bound=prior.gain_bound, decay_rate=prior.decay_rate)
        result = rid.identify(problem).require()
        reduced = rid.reduce_within_bounds(result)
        results[name] = result, reduced
        print(
            f"{name:<24}{prior.gain_bound:7.3g}{prior.decay_rate:7.3f}{result.margin:9.3f}{result.order:7d}{reduced.order:9d}"
            f"{error_in_band(result.model, data.truth, dt):14.3f} full{error_in_band(reduced.model, data.truth, dt):8.3f}"
        )
    best, smaller = results["both modes"]
    print(
        "\nAll three are consistent: margin < 1 says that a class isn't refuted, not that it is right. What tells them\n"
        "apart is K: a part G that may be larger than the data can do anything between the samples, and does. With both\n"
        "modes in the parametric part G has nothing left to do, and the central model is close to the truth between the\n"
        "samples too. The truth has order 4, and so has the smallest model that keeps every sample, whatever the class. It\n"
        f"keeps the poles of the class where they suffice, as those of both modes do (order {smaller.order}) and that of the\n"
        "light mode; poles that are moved to fit the samples say little of a peak between points 2 Hz apart."
    )

    for name, (result, reduced) in results.items():
        models = {f"reduced, order {reduced.order}": reduced.model, "truth (simulated)": data.truth}
        stem = name.split(" (")[0].replace(" ", "_")
        rid.plot.bode(result, models=models).savefig(out / f"response_{stem}.png", dpi=110)
        rid.plot.residuals(result, models={f"reduced, order {reduced.order}": reduced.model}).savefig(
            out / f"residuals_{stem}.png", dpi=110
        )
    rid.write_report(best, out / "report.html", reduction=smaller, title="Flexible structure: both modes parametric")
    print(f"\nPictures and report: {out}")


if __name__ == "__main__":
    main()
