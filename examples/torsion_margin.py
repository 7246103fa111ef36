"""Measured data: a controller that provably stabilises every plant that agrees with the measured torsion resonance.

The data and their bounds are those of motor_torsion.py, which explains why noise alone would not do. From 19
points: a model of low order, how far every consistent plant can be from it on the whole unit circle, and the margin of integral
controllers against all of them.

Data: two_mass/MultisineTypeA.mat of github HoriFujimotoLab/FdiTools (MIT). Set ROBUSTID_DATA to the folder that holds two_mass/.
Run: python torsion_margin.py --out folder (less than a minute)
"""

import dataclasses

import control
import numpy as np
from motor_torsion import PERIOD, SPARE, opened

import robustid as rid
from robustid.advice import diagnose, suggest_kautz, suggest_prior

CROSSOVERS_HZ = (0.5, 1.0, 2.0, 3.0, 4.0)  # of the integral controllers, by the static gain
DIRECTIONS = 8  # sides of each polygon: upper bounds at most 8 % above the truth
CIRCLE = 0.05  # by which the bound of the whole circle may exceed the largest error
ORDER = 8  # of the truncated central model
BETWEEN_HZ = np.arange(0, 73, 6)  # besides the measured points: where the controllers act


def few_lines(frf, resonance):
    """Every spectral line within 3.5 Hz of the resonance, every third one within 8 Hz, every 24th elsewhere."""
    number, away = np.arange(frf.omega.size), np.abs(frf.omega - resonance) / (2 * np.pi)
    return frf.select(np.flatnonzero((away < 3.5) | ((away < 8) & (number % 3 == 0)) | (number % 24 == 0)))


def consistent_class(lines, modes):
    """Lines with stated bounds, and the class that they are consistent with: diagnosed and suggested, not tuned."""
    guess = rid.Prior(gain_bound=float(np.abs(lines.values[0, 0, 0])), decay_rate=1.2)
    first = rid.identify(rid.MixedProblem(frequency=lines, prior=guess, parametric=modes.basis))
    better = diagnose(first).best()
    factor = max(1.0, SPARE * better.margin)
    if factor > 1:
        note = f"{lines.bound.words()}, times {factor:.3g}: what the best linear class tried needs, plus 10 %"
        lines = lines.with_bound(lines.bound.inflated(factor), note)
    wide = dataclasses.replace(better.problem, frequency=lines)
    prior = suggest_prior(wide).prior
    print(
        f"   As measured: {first.status.name.lower()}, the bounds that just do are {first.margin:.3g} times as large."
    )
    print(f"   Taken: {better.name};")
    print(
        f"   all bounds times {factor:.3g}, stated in the report; |G| <= {prior.gain_bound:.3g} in |z| < {prior.decay_rate:.4g}."
    )
    return wide.with_prior(gain_bound=prior.gain_bound, decay_rate=prior.decay_rate)


def integrator(crossover_hz, model):
    """The controller k/(z - 1) whose loop crosses 1 near `crossover_hz`, where the model is still its static gain."""
    gain = 2 * np.pi * crossover_hz * model.dt / float(np.real(model(1)))
    return control.ss(1.0, 1.0, gain, 0.0, model.dt)


def main(argv=None):
    record, out = opened(argv, __doc__)
    if record is None:
        return

    frf = rid.estimate_frf(record, period=PERIOD)
    modes = suggest_kautz(frf)
    lines = few_lines(frf, modes.omega[0])
    print(
        f"1. {lines.omega.size} of {frf.omega.size} measured frequency points, {lines.freq_hz[0]:g} to {lines.freq_hz[-1]:g} Hz."
    )
    result = rid.identify(consistent_class(lines, modes)).require()
    # Not reduce_within_bounds: the smallest model touches the bounds, and guarantees around it are the widest.
    reduced = rid.balanced_truncation(result.model, order=ORDER)
    model = reduced.model
    print(f"   {result.status.name.capitalize()}, margin {result.margin:.3f}; model of order {reduced.order}.")

    omega = np.union1d(lines.omega, 2 * np.pi * BETWEEN_HZ)
    error = rid.worst_case_error(result, model=model, omega=omega, directions=DIRECTIONS)
    circle = error.on_circle(CIRCLE)  # adds frequencies where it needs them
    print("\n2. How far every consistent plant can be from this model:")
    print(error.summary())
    print("certificates, evaluated again without a solver:", "all hold" if error.certified else "NOT ALL HOLD")
    print(
        f"On the whole circle, by {circle.bound.size} arcs: at most {error.hinf:.4g} rad per unit of current,"
        f" near {circle.peak / (2 * np.pi):.4g} Hz (reached: {circle.lower:.4g})"
    )

    print("\n3. Integral controllers, against every plant within these bounds:")
    for crossover in CROSSOVERS_HZ:
        found = rid.guarantee.robust_stability_margin(model, integrator(crossover, model), circle.edges, circle.bound)
        where = f", least at {found.frequency / (2 * np.pi):.4g} Hz" if found.margin else ""
        print(f"   crossover {crossover:3g} Hz: margin {found.margin:6.3f}{where}; {found.status.value.split(':')[0]}")
    print(
        "   Margin: the factor by which all these errors could grow before stability is no longer guaranteed.\n"
        "   Guaranteed for every plant of the assumed class whose response lies within the stated bounds at the measured lines.\n"
        "   Assumed, not proved: linearity at this amplitude, the poles of the pairs (estimated from these data), |G| <= K in\n"
        "   |z| < rho, and the bounds. The data were tested against these assumptions, and don't contradict them; no data can\n"
        "   prove them. Not guaranteed says that this condition fails, not that a consistent plant is unstable."
    )

    rid.plot.bode(error).savefig(out / "guaranteed.png", dpi=110)
    rid.plot.nyquist(error).savefig(out / "nyquist.png", dpi=110)
    title = "Motor bench: what is guaranteed"
    rid.write_report(result, out / "report.html", reduction=reduced, worst_case=error, title=title)
    print(f"\nPictures and report: {out}")


if __name__ == "__main__":
    main()
