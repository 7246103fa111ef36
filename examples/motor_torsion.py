"""Measured data: current to torsion angle of a motor bench with a flexible coupling, from records to a bound one can state.

Data: two_mass/MultisineTypeA.mat of github HoriFujimotoLab/FdiTools (MIT). Set ROBUSTID_DATA to the folder that holds two_mass/.
Run: python motor_torsion.py --out folder
"""

import argparse
import dataclasses
import tempfile
from pathlib import Path

import numpy as np
from scipy.special import stdtrit

import robustid as rid
from robustid.advice import diagnose, suggest_kautz, suggest_prior
from robustid.errors import DatasetNotFoundError
from robustid.identification.residuals import model_residuals

NAME = "two_mass/MultisineTypeA.mat"
PERIOD = 2500
KNOWN_PAST, STRETCH = 30, 20  # samples of the mean period: input used only, input and output used
NOISE = 3.5  # standard deviations: 95 % jointly
EVERY, NEAR_HZ = 12, 8  # frequency points used: every 12th, and all this near to the mode
SPARE = 1.1  # beyond the smallest inflation of the bounds


def torsion_record():
    """Current [A] to torsion [rad]; the load encoder counts with the opposite sign, so torsion is the sum of both angles."""
    bench = rid.load(rid.datasets.find(NAME), **rid.datasets.DATASETS[NAME].options)
    settled = slice(PERIOD, None)  # the first period still holds the start of the motion, 28 times the noise
    return rid.TimeRecord(
        bench.u[settled],
        bench.y[settled].sum(axis=1),
        dt=bench.dt,
        reference=bench.reference[settled],
        initial="periodic",
        inputs=["current"],  # the file gives no unit
        outputs=["torsion [rad]"],
    )


def opened(argv, description):
    """The record, and the folder for what is written; two None, and a sentence, where there are no data."""
    parser = argparse.ArgumentParser(description=description.splitlines()[0])
    parser.add_argument("--out", type=Path, help="folder for pictures and report (default: a temporary one)")
    arguments = parser.parse_args(argv)
    try:
        record = torsion_record()
    except DatasetNotFoundError as missing:
        print(f"This example needs measured data. {missing}")
        return None, None
    out = arguments.out or Path(tempfile.mkdtemp(prefix="robustid-"))
    out.mkdir(parents=True, exist_ok=True)
    return record, out


def stretch_of_mean_period(record):
    """A short stretch of the mean period: past input known for 30 samples, unknown before, state of the modes free.

    The whole period would have 2500 samples, and 240 excited lines: too many for the exact form. Encoder offsets are no
    response: the means over a period are removed from both signals, which a linear plant in steady state allows.
    """
    u, y = (s.reshape(-1, PERIOD) - s.reshape(-1, PERIOD).mean(axis=1, keepdims=True) for s in (record.u, record.y))
    periods = len(y)
    # Joint 95 % over the samples used, Student's t with one degree of freedom less than periods.
    radius = stdtrit(periods - 1, 1 - 0.05 / (2 * STRETCH)) * y.std(axis=0, ddof=1) / np.sqrt(periods)
    start = int(np.argmax(np.abs(y.mean(axis=0)))) - KNOWN_PAST - STRETCH // 2
    index = (start + np.arange(KNOWN_PAST + STRETCH)) % PERIOD
    bound = radius[index]
    bound[:KNOWN_PAST] = np.inf
    return rid.TimeRecord(
        u.mean(axis=0)[index],
        y.mean(axis=0)[index],
        dt=record.dt,
        bound=rid.Bound(bound, kind="confidence", probability=0.95, dof=periods - 1),
        initial="free",
        past_input_bound=float(np.abs(u).max()),
        inputs=record.inputs,
        outputs=record.outputs,
        note=f"over {STRETCH} samples, scatter over {periods} periods",
    )


def say_what_it_is_worth(result, out):
    """The small model, pictures and report, and errors in units of the bench."""
    lines, stretch = result.problem.frequency[0], result.problem.time[0]
    reduced = rid.reduce_within_bounds(result)
    models = {f"reduced, order {reduced.order}": reduced.model}
    rid.plot.bode(result, models=models).savefig(out / "response.png", dpi=110)
    rid.plot.time_response(result, models=models).savefig(out / "time.png", dpi=110)
    rid.plot.residuals(result, models=models).savefig(out / "residuals.png", dpi=110)
    rid.write_report(result, out / "report.html", reduction=reduced, title="Motor bench: current to torsion")

    residuals = model_residuals(result.problem, reduced.model)
    peak = int(np.argmax(np.abs(lines.values)))
    error, size = np.abs(residuals[0].error), np.abs(lines.values[:, 0, 0])
    print(
        f"\n7. What can be said: a model of order {reduced.order} keeps every sample within {reduced.margin:.2f} of its"
        " bound.\n"
        f"   At {lines.freq_hz[peak]:g} Hz, where the response is largest: {1e3 * error[peak]:.2g} mrad off, bound"
        f" {1e3 * residuals[0].bound[peak]:.2g} mrad, of {1e3 * size[peak]:.3g} mrad per unit of current.\n"
        f"   Median over the frequency points: {100 * np.median(error / size):.2g} % off, bound"
        f" {100 * np.median(residuals[0].bound / size):.2g} %. In time: {1e3 * np.abs(residuals[1].error).max():.2g} mrad off,\n"
        f"   bound {1e3 * residuals[1].bound.max():.2g} mrad, of {1e3 * np.abs(stretch.y).max():.3g} mrad at most.\n"
        "   This holds at the samples, at this amplitude, with these poles: K, rho and the poles are assumptions."
        f"\n\nPictures and report: {out}"
    )


def main(argv=None):
    record, out = opened(argv, __doc__)
    if record is None:
        return

    frf = rid.estimate_frf(record, period=PERIOD)
    hz = frf.freq_hz
    print(f"1. {frf.omega.size} excited lines from {hz[0]:g} to {hz[-1]:g} Hz; {frf.bound.words(frf.note)},")
    print(f"   median {100 * np.median(frf.bound / np.abs(frf.values)):.1f} % of the response")

    print("\n2. The mode, from all frequency points:")
    modes = suggest_kautz(frf)
    print(modes.summary())

    near = np.abs(frf.omega - modes.omega[0]) < 2 * np.pi * NEAR_HZ
    chosen = np.union1d(np.arange(0, hz.size, EVERY), np.flatnonzero(near))
    lines = frf.select(chosen)
    static = float(np.abs(frf.values[0, 0, 0]))
    guess = rid.Prior(gain_bound=static, decay_rate=1.2)
    print(
        f"\n3. {chosen.size} frequency points, one pair, G as large as the response at {hz[0]:g} Hz ({static:.2g} rad per unit)."
    )
    quiet = lines.with_bound(NOISE * lines.noise, f"noise of the mean alone, times {NOISE:g}")
    alone = rid.identify(rid.MixedProblem(frequency=quiet, prior=guess, parametric=modes.basis))
    print(f"   Noise alone as the bound: {alone.status.value}; margin {alone.margin:.4g}")
    print(diagnose(alone).summary())

    print("\n4. Could a larger non-parametric part explain it? The smallest gain bound that noise alone allows:")
    print(suggest_prior(alone.problem, decay_rates=[1.005, 1.01, 1.02]).summary())
    print(
        "   That is a class of anything at all. The noise of the averaged data is small; what is left is the bench itself,\n"
        "   which isn't linear down to its noise. Unexcited lines show by how much: the bound of the estimate knows it."
    )

    problem = rid.MixedProblem(frequency=lines, prior=guess, parametric=modes.basis)
    first = rid.identify(problem)
    print(f"\n5. With the bound as it was estimated: {first.status.value}; margin {first.margin:.4g}.")
    print(f"   {lines.bound.about}")
    factor = max(1.0, SPARE * first.margin)
    if factor > 1:
        lines = lines.with_bound(lines.bound.inflated(factor), f"{lines.bound.words()}, times {factor:.3g}")
    # What a period repeats, distortion too, is in the samples as it is in the lines.
    wider = factor * float(np.median(lines.bound / quiet.bound))
    stretch = stretch_of_mean_period(record)
    stretch = stretch.with_bound(stretch.bound.inflated(wider), f"{stretch.note}, times {wider:.3g} as for the points")
    print(
        f"   The time samples, whose scatter is noise alone: bounds times {wider:.3g}. The prior that the points suggest:"
    )
    suggestion = suggest_prior(dataclasses.replace(problem, frequency=lines))
    print(suggestion.summary())

    print(f"\n6. Mixed identification: {chosen.size} frequency points and {STRETCH} time samples:")
    problem = rid.MixedProblem(frequency=lines, time=stretch, prior=suggestion.prior, parametric=modes.basis)
    result = rid.identify(problem)
    print(result.summary())

    say_what_it_is_worth(result, out)


if __name__ == "__main__":
    main()
