"""Measured MIMO plants: from records to a model with matrix residues, its worst-case error, and what it depends on.

A beam with two piezo patches and two accelerometers, two sweeps (equal signs, opposite signs); with --fsm a steering mirror,
three piezos and three displacements, random-phase multisine. Modes are sought in all entries at once: one pole pair for all,
with a free residue matrix. A single mode of a structure has a residue of rank one; nothing here forces it to.
Data: github flavioluiz/MIMO-FRF (BSD-2), merijnfloren/fsm-benchmark-data (CC BY 4.0; Floren et al., ISMA-USD 2024), downloaded
once, or from the folder that ROBUSTID_DATA names.
Run: python beam_mimo.py --out folder [--fsm] [--guarantee] (the worst-case error takes some minutes)
"""

import argparse
import dataclasses
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

import robustid as rid
from robustid.errors import DatasetNotFoundError

THINNED = 8  # every so manieth line shows the modes
SPARE = 1.1  # on the factor that the bounds need


class Case(NamedTuple):
    """What is particular about a plant."""

    title: str
    band: tuple[float, float]  # Hz, of the frequency points
    modes: int | None  # all that `suggest_kautz` finds; None: without those that it leaves to the gain bound
    prior: rid.Prior
    unit: str


BEAM = Case(
    "Beam: two patches to two accelerometers",
    (9.0, 68.0),
    None,
    rid.Prior(gain_bound=0.05, decay_rate=1.3),
    "output per V",
)
MIRROR = Case(
    "Steering mirror: three voltages to three displacements",
    (100.0, 2900.0),
    14,
    rid.Prior(gain_bound=1e-5, decay_rate=1.15),
    "m per V",
)


def beam():
    """Response between 9 and 70 Hz without the mains, and 100 samples of either sweep where it passes 30 Hz."""
    records = rid.datasets.load("beam_ring")
    frf = rid.estimate_frf(records, lines=np.arange(9 * 120, 70 * 120))
    parts = []
    for record in records:
        part = slice(72_800, 72_900)
        quiet = record.y[:2000] - record.y[:2000].mean(axis=0)  # the first two seconds: below 0.3 Hz, noise alone
        parts.append(
            dataclasses.replace(
                record,
                u=record.u[part],
                y=record.y[part] - record.y.mean(axis=0),
                bound=np.tile(5 * quiet.std(axis=0), (100, 1)),
                initial="free",
                past_input_bound=float(np.linalg.norm(record.u, axis=1).max()),
                note="five standard deviations of the noise",
            )
        )
    return frf.select(np.abs(frf.freq_hz - 50) > 0.7), parts


def mirror():
    """Response from six realisations, two steady periods each."""
    return rid.estimate_frf(rid.datasets.load("fsm/train"), period=8192), None


def modes_of(case, frf):
    """Natural frequencies [Hz] and damping ratios of the modes that all entries together show."""
    found = rid.suggest_kautz(frf.band(*case.band).select(slice(None, None, THINNED)), modes=case.modes)
    print(f"Modes of all entries:\n{found.summary()}")
    return found.omega / (2 * np.pi), found.damping


def thinned(case, frf, hz, damping):
    """Nine frequency points within four half-widths of every mode, and thirty over the band: (used, the others)."""
    inside = frf.band(*case.band)
    near = hz[:, None] * (1 + damping[:, None] * np.linspace(-4, 4, 9))
    wanted = np.concatenate([near.ravel(), np.linspace(*inside.freq_hz[[0, -1]], 30)])
    used = np.unique(np.argmin(np.abs(inside.freq_hz[:, None] - wanted), axis=0))
    unused = np.setdiff1d(np.arange(inside.omega.size), used)
    return inside.select(used), inside.select(unused)


def widened(data, factor, note):
    return data.with_bound(factor * data.bound, note)


def plot_entries(frf, result, error, unit):
    """Magnitude of every entry: measured, model, and how far any consistent plant can be from the model."""
    _, p, q = frf.values.shape
    figure = Figure(figsize=(4.2 * q, 2.9 * p), layout="constrained")
    hz = np.linspace(frf.freq_hz[0], frf.freq_hz[-1], 4000)
    model = np.moveaxis(result.model(np.exp(2j * np.pi * hz * frf.dt)), 2, 0)
    axes = figure.subplots(p, q, sharex=True, sharey=True, squeeze=False)
    for (i, j), ax in np.ndenumerate(axes):
        size = np.abs(frf.values[:, i, j])
        ax.semilogy(frf.freq_hz, size, ".", color="0.6", ms=2, label="measured")
        ax.semilogy(hz, np.abs(model[:, i, j]), "C0", lw=0.9, label="model")
        ax.semilogy(frf.freq_hz, frf.bound[:, i, j], "0.8", lw=0.6, zorder=0, label="bound")
        if error is not None:
            ax.semilogy(error.omega / (2 * np.pi), error.upper[:, i, j], "C3v", ms=4, label="worst-case error")
        ax.set_title(f"{frf.inputs[j].name} to {frf.outputs[i].name}", fontsize=9)
        ax.grid(color="0.93")
    for ax in axes[-1]:
        ax.set_xlabel("frequency [Hz]")
    for ax in axes[:, 0]:
        ax.set_ylabel(unit)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=4, frameon=False)
    return figure


def print_modes(result):
    print("\nModes of the model: size of the residue matrix, and how far it is from rank one")
    print("      Hz  damping in %   ||R||  second/first singular value   shape of the outputs")
    for mode in result.modes:
        left, singular, _ = np.linalg.svd(mode.residue)
        shape = left[:, 0] / left[np.argmax(np.abs(left[:, 0])), 0]
        print(
            f"{mode.omega / (2 * np.pi):8.2f}{100 * mode.damping:14.2f}{singular[0]:9.2g}{mode.rank_ratio:19.3f}"
            + " " * 14
            + "  ".join(f"{value.real:+.2f}{value.imag:+.2f}j" for value in shape)
        )


def guaranteed(result, hz):
    """Worst-case error at the modes and between them, printed."""
    between = np.sqrt(hz[1:] * hz[:-1])
    error = rid.worst_case_error(result, omega=2 * np.pi * np.concatenate([hz, between]), directions=6, rtol=0.3)
    print("\nWorst-case error of any consistent plant, in % of the largest singular value of the model:")
    sizes = np.linalg.norm(error.nominal, 2, axis=(1, 2))
    for at, size, upper in zip(error.omega, sizes, error.upper, strict=True):
        print(f"  {at / (2 * np.pi):8.2f} Hz: {100 * np.linalg.norm(upper, 2) / size:6.1f}")
    return error


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="folder for pictures and report (default: a temporary one)")
    parser.add_argument("--fsm", action="store_true", help="the steering mirror, 3x3")
    parser.add_argument("--guarantee", action="store_true", help="worst-case error over all consistent plants")
    arguments = parser.parse_args(argv)
    case = MIRROR if arguments.fsm else BEAM
    try:
        frf, records = mirror() if arguments.fsm else beam()
    except DatasetNotFoundError as missing:
        print(f"This example needs measured data. {missing}")
        return
    out = arguments.out or Path(tempfile.mkdtemp(prefix="robustid-"))
    out.mkdir(parents=True, exist_ok=True)
    print(f"{case.title}: {frf.bound.words(frf.note)}")

    hz, damping = modes_of(case, frf)
    used, unused = thinned(case, frf, hz, damping)
    basis = rid.kautz(2 * np.pi * hz, damping, dt=frf.dt, delay=1)
    problem = rid.MixedProblem(frequency=used, prior=case.prior, parametric=basis)
    print(
        f"\n{used.omega.size} frequency points, {hz.size} modes, a non-parametric part below {case.prior.gain_bound:g} {case.unit}:"
    )
    first = rid.identify(problem, accuracy=1e-2)
    print(f"{first.status.value}; margin {first.margin:.3g}. What carries the proof:")
    for _, _, at, share in first.conflicting_samples(0.1):
        print(f"  {at / (2 * np.pi):8.2f} Hz: {100 * share:.0f} %")
    doubled = dataclasses.replace(problem, parametric=rid.kautz(2 * np.pi * hz, damping, dt=frf.dt, delay=1, repeat=2))
    print(
        f"With every pair doubled (poles that differ a little): margin {rid.identify(doubled, accuracy=1e-2).margin:.3g}"
    )

    factor, note = 1.0, frf.note
    if not first.consistent:
        factor = SPARE * first.margin
        note = f"{frf.note}; times {factor:.2f}: what this class needs, plus 10 %"
        print(
            "No linear plant with these poles keeps to bounds of noise alone. All bounds of the points are taken times"
            f" {factor:.2f}, and the report says so."
        )
    problem = dataclasses.replace(problem, frequency=widened(used, factor, note), time=records)
    result = rid.identify(problem, accuracy=1e-2)
    print("\n" + result.summary())
    print_modes(result)

    checked = rid.validate(result.model, widened(unused, factor, note))
    print(f"\n{unused.omega.size} frequency points that were not used:\n{checked.summary()}")

    error = guaranteed(result, hz) if arguments.guarantee else None
    plot_entries(widened(frf.band(*case.band), factor, note), result, error, case.unit).savefig(
        out / "response.png", dpi=110
    )
    rid.plot.residuals(result).savefig(out / "residuals.png", dpi=110)
    rid.write_report(result, out / "report.html", title=case.title, worst_case=error)
    print(f"\nPictures and report: {out}")


if __name__ == "__main__":
    main()
