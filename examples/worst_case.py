"""What can every plant do that agrees with the data? Guaranteed bands around a model, and around a model of order 4.

Step and frequency data of a simulated mass-beam structure with modes at 9 Hz (well damped) and 17.67 Hz (damping ratio 0.004),
after T. Inanc et al., IEEE Transactions on Control Systems Technology 9(4), 2001. Its modes are known beforehand here.

Run: python worst_case.py --out folder (about half a minute; with --circle some seconds more)
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

import robustid as rid
from robustid.core import response
from robustid.guarantees import response_tube

# Between the samples, where nothing was measured: from 0 Hz to the Nyquist frequency, and around the light mode.
FREQUENCIES_HZ = np.array(
    [0, 2, 4, 6, 8, 9, 10, 12, 14, 16, 17.05, 17.45, 17.65, 17.67, 17.75, 18.05, 19.5, 24, 32, 50]
)
DIRECTIONS = 10  # sides of each polygon: upper bounds at most 5 % above the truth
TUBE = 40  # samples of the step response


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="folder for pictures and report (default: a temporary one)")
    parser.add_argument("--circle", action="store_true", help="bound every frequency, and find a weight")
    arguments = parser.parse_args(argv)
    out = arguments.out or Path(tempfile.mkdtemp(prefix="robustid-"))
    out.mkdir(parents=True, exist_ok=True)

    data = rid.datasets.flexible_structure(extra_hz=np.linspace(17.2, 18.1, 10))
    problem = rid.MixedProblem(
        frequency=data.frequency,
        time=data.time,
        prior=rid.Prior(gain_bound=0.2, decay_rate=1.1),
        parametric=rid.kautz(data.modes[:, 0], data.modes[:, 1], dt=data.frequency.dt, delay=1),
    )
    result = rid.identify(problem).require()
    print(f"1. {problem.samples} samples, both modes known, K = 0.2, rho = 1.1: {result.status.value}")
    print(f"   (margin {result.margin:.3f}); nominal model of order {result.order}")

    error = rid.worst_case_error(result, omega=2 * np.pi * FREQUENCIES_HZ, directions=DIRECTIONS)
    print(f"\n2. What every consistent plant can do, at {error.omega.size} frequencies:")
    print(error.summary())
    print("certificates, evaluated again without a solver:", "all hold" if error.certified else "NOT ALL HOLD")

    reduced = rid.reduce_within_bounds(result)
    small = error.with_model(reduced.model)
    print(f"\n3. The same guarantees around a model of order {reduced.order}; nothing is solved anew:")
    print(f"{'':>32}{'guaranteed':>12}{'reached':>10}{'the truth is off by':>21}   (largest, in mm/N)")
    truth = response(data.truth, error.omega * problem.dt)
    band = error.omega <= 2 * np.pi * 21
    for name, one in ((f"nominal, order {result.order}", error), (f"reduced, order {reduced.order}", small)):
        off, upper, lower = np.abs(truth - one.nominal), one.upper.ravel(), one.lower.ravel()
        for where, at in (("up to 21 Hz", band), ("above", ~band)):
            print(
                f"{name + ', ' + where:>32}{upper[at].max():12.4f}{lower[at].max():10.4f}{off[at].max():21.4f}"
                f"   {'inside' if np.all(off[at] <= upper[at]) else 'OUTSIDE'}"
            )
    print(
        "   Above the last line, at 21 Hz, the prior says most: G may reach almost K there. The truth is inside, as it\n"
        "   must be, since the modes, K and rho are true here. Of a measured plant these are assumptions."
    )

    if arguments.circle:
        weight = small.weight()
        print(
            f"\n4. Between the frequencies too: {weight.bound.size} arcs of the circle, error below {weight.bound.max():.4g} mm/N"
            f" everywhere;\n   a weight of order {weight.order} stays above the bound, by a factor {weight.ratio:.3g} at most"
            f" ({'proved' if weight.certified else 'NOT PROVED'})."
        )

    rid.plot.bode(error).savefig(out / "guaranteed.png", dpi=110)
    rid.plot.bode(small).savefig(out / "guaranteed_reduced.png", dpi=110)
    rid.plot.nyquist(error).savefig(out / "nyquist.png", dpi=110)
    tube = response_tube(result, input="step", horizon=TUBE)
    print(f"\nThe step response, over {TUBE} samples:\n{tube.summary()}")
    rid.plot.time_response(tube).savefig(out / "step.png", dpi=110)
    title = "Flexible structure: what is guaranteed"
    rid.write_report(result, out / "report.html", reduction=reduced, worst_case=error, tube=tube, title=title)
    print(f"\nPictures and report: {out}")


if __name__ == "__main__":
    main()
