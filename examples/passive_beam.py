"""A gap in the data of a driving-point mobility: the band that passivity leaves, beside that of a guessed gain bound.

Force and velocity are measured at the same point of a beam: power only flows in, the mobility is positive real. Between 40 and
44 Hz nothing was measured, because of the mains hum of a pump, say. There a class with a gain bound says as much as its K does, and
nobody knows K: even the smallest one that holds, which takes the plant to know, leaves several times the response; a positive-real
class needs none, and the data alone bound it. Data with the wrong sign are refuted, and told what they are.
Simulated: modes at 31 and 52 Hz, damping 6 and 5 %; errors of 1 % of the median response.
Run: python passive_beam.py --out folder (about 15 s)
"""

import argparse
import dataclasses
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import robustid as rid

OMEGA, DAMPING, SIZE = 2 * np.pi * np.array([31.0, 52.0]), np.array([0.06, 0.05]), np.array([0.8, 0.6])
DECAY = 0.66 * float((DAMPING * OMEGA).min())  # below the decay of every mode
LINES = 2 * np.pi * np.concatenate([np.arange(20, 40.1), np.arange(44, 62.1)])
JUDGED = 2 * np.pi * np.array([30.5, 41.0, 42.0, 43.0, 50.5])


def mobility(s):
    """The sum of c s/(s^2 + 2 d w s + w^2), m/s per N."""
    s = np.asarray(s)[..., None]
    return (SIZE * s / (s**2 + 2 * DAMPING * OMEGA * s + OMEGA**2)).sum(-1)


def classes():
    """A class for every assumption, by its name."""
    # The real part of a mode is a little negative left of the axis: at s = -decay.
    slack = float((SIZE * DECAY / (OMEGA**2 - 2 * DAMPING * OMEGA * DECAY + DECAY**2)).sum())
    least = float(np.abs(mobility(-DECAY + 1j * np.linspace(0, 1000, 20001))).max())
    return {
        "positive real": rid.PositiveReal(decay=DECAY, slack=slack),
        "smallest K that holds": rid.Prior(gain_bound=least, decay=DECAY),
        "twice that K": rid.Prior(gain_bound=2 * least, decay=DECAY),
    }


def main():
    """Bound the mobility in the gap under each assumption, print and draw it."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--out", type=Path, default=None)
    folder = parser.parse_args().out or Path(tempfile.mkdtemp(prefix="robustid-"))
    folder.mkdir(parents=True, exist_ok=True)

    rng, truth = np.random.default_rng(1), mobility(1j * JUDGED)
    bound = 0.01 * float(np.median(np.abs(mobility(1j * LINES))))
    values = mobility(1j * LINES) + bound * np.exp(2j * np.pi * rng.random(LINES.size))
    frf = rid.FrequencyResponse(LINES, values, bound=1.0001 * bound)
    figure, panel = plt.subplots(figsize=(7, 4), layout="constrained")
    print("Guaranteed error, in % of the mobility, at", ", ".join(f"{f:g}" for f in JUDGED / (2 * np.pi)), "Hz:")
    for name, prior in classes().items():
        result = rid.identify(rid.MixedProblem(frequency=frf, prior=prior)).require()
        error = rid.worst_case_error(result, omega=JUDGED, directions=6, rtol=0.1)
        upper, away = error.upper[:, 0, 0], np.abs(result.model(1j * JUDGED) - truth)
        print(
            f"  {name:22s}", *(f"{100 * u:8.1f}" for u in upper / np.abs(truth)), f"  inside: {np.all(away <= upper)}"
        )
        panel.semilogy(JUDGED / (2 * np.pi), upper, "o-", label=name)
    panel.semilogy(LINES / (2 * np.pi), np.abs(values), ".", color="0.6", label="measured mobility")
    panel.set(xlabel="Hz", ylabel="guaranteed error, and size, m/s per N")
    panel.legend()
    figure.savefig(folder / "gap.png", dpi=120)

    found = rid.identify(
        rid.MixedProblem(frequency=dataclasses.replace(frf, values=-values), prior=classes()["positive real"])
    )
    print(f"\nWith the sensor turned round (margin {found.margin:.3g}):\n{rid.diagnose(found).summary()}")
    print(f"\nfigure in {folder}")


if __name__ == "__main__":
    main()
