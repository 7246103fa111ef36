"""A response without a sample time: the guarantee of a continuous class beside that of the same plant, sampled.

A spectrum analyser gives the compliance of a structure at 26 frequencies and no sample time: modes, class, model and bounds are
those of a continuous-time system, up to infinity. The same structure behind a zero-order hold at 200 Hz, measured at the same
frequencies with the same relative errors, is one of discrete time, with as fast a decay. The bounds agree about as far as the two
responses do; above half the sampling rate only the first one says anything, and there it is that of the class.
Simulated: modes at 3, 9 and 17.67 Hz, damping 2, 5 and 1 %, a static remainder; errors of at most 1.5 % of the response.
Run: python continuous_time.py --out folder (about 15 s)
"""

import argparse
import tempfile
from pathlib import Path

import control
import matplotlib.pyplot as plt
import numpy as np

import robustid as rid

MODES = ((3.0, 0.02, 1.0), (9.0, 0.05, 0.4), (17.67, 0.01, 0.2))  # Hz, damping, static compliance
LINES = np.unique(np.concatenate([np.linspace(1.0, 25.0, 17), [2.9, 3.0, 3.1, 8.6, 9.4, 17.4, 17.6, 17.8, 18.0]]))
DT, RELATIVE = 1 / 200, 0.015
JUDGED = np.array([1.5, 3.05, 5.0, 9.0, 13.0, 17.7, 24.0])


def structure():
    """The compliance, with a static remainder of modes that are far above."""
    model = control.ss([], [], [], [[0.03]])
    for hz, damping, static in MODES:
        w = 2 * np.pi * hz
        model = model + control.ss(control.tf([static * w**2], [1, 2 * damping * w, w**2]))
    return model


def measured(values, seed, **time):
    """A frequency response with errors inside discs of a known radius."""
    rng = np.random.default_rng(seed)
    bound = RELATIVE * np.abs(values)
    error = bound * np.sqrt(rng.random(values.size)) * np.exp(2j * np.pi * rng.random(values.size))
    return rid.FrequencyResponse(2 * np.pi * LINES, values + error, bound=bound, **time)


def bounded(frf, decay):
    """Modes and gain bound from the data, for a decay in 1/s; the model, and its guaranteed error."""
    found = rid.suggest_kautz(frf, modes=len(MODES))
    problem = rid.MixedProblem(frequency=frf, parametric=found.basis, prior=rid.Prior(gain_bound=1.0, decay=decay))
    prior = rid.suggest_prior(problem, decay_rates=[problem.prior.rate]).prior
    result = rid.identify(problem.with_prior(gain_bound=prior.gain_bound)).require()
    return result, rid.worst_case_error(result, omega=2 * np.pi * JUDGED, directions=8, rtol=0.1)


def main():
    """Identify both, print the bounds beside the errors, draw them."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--out", type=Path, default=None)
    folder = parser.parse_args().out or Path(tempfile.mkdtemp(prefix="robustid-"))
    folder.mkdir(parents=True, exist_ok=True)

    plant, s = structure(), 2j * np.pi * LINES
    sampled = control.sample_system(plant, DT)
    cases = {
        "continuous": (plant, measured(plant(s), 1), lambda w: 1j * w),
        "sampled at 200 Hz": (sampled, measured(sampled(np.exp(s * DT)), 1, dt=DT), lambda w: np.exp(1j * w * DT)),
    }
    figure, panel = plt.subplots(figsize=(7, 4), layout="constrained")
    print(f"{'':>20}{'K':>8}{'margin':>8}{'order':>7}   largest error / bound, and bound / response, median")
    for (name, (truth, frf, points)), colour in zip(cases.items(), ("C0", "C1"), strict=True):
        result, error = bounded(frf, decay=60.0)
        at = 2 * np.pi * JUDGED
        size, away = np.abs(truth(points(at))), np.abs(truth(points(at)) - result.model(points(at)))
        ratio, width = (away / error.sigma_upper).max(), np.median(error.sigma_upper / size)
        K, order = result.prior.gain_bound, result.order
        print(f"{name:>20}{K:8.3g}{result.margin:8.3g}{order:7d}   {ratio:.2f}, {100 * width:.2g} %")
        panel.loglog(JUDGED, error.sigma_upper, "o-", color=colour, label=f"guaranteed, {name}")
        panel.loglog(JUDGED, away, "x", color=colour, label=f"true error, {name}")
        if not truth.dt:
            result.save(folder / "continuous")
            rid.write_report(result, folder / "report.html", worst_case=error)
    panel.set(xlabel="frequency [Hz]", ylabel="error of the model")
    panel.legend(fontsize="small")
    figure.savefig(folder / "continuous_time.png", dpi=150)
    print(f"\nWritten to {folder}: the report of the continuous one, its result, the picture.")


if __name__ == "__main__":
    main()
