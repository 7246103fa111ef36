"""The experiment of R. Voorhoeve et al. (IFAC 2016, section V) on a simulated wafer stage, and where a fit should start.

The plant is that of wafer_stage.py with a fourth force: the rigid body is decoupled from no input, but from one output,
the strain gauge. So the fraction is a left one (D^{-1} N), or the right one of the transposed data.

Figure 4: the fit of all 16 entries. The rigid body: six poles at 0 exactly, three Jordan blocks of two. Figure 5: condition
numbers of the normal matrix over SK steps from D = I (order 24, 300 points, 10 steps; --full: order 82, 5000 points, 75 steps):

    monomial                      1e57 to 4e62     7e167 to 5e185
    scaled monomial               2e6 to 3e9       2e12 to 1e16
    data-dependent orthonormal    1 + 4e-15        1 + 6e-15

The paper's costs part after 20 steps. Ours part after 50, the lowest are the same to four digits: each basis is solved by QR,
which squares no condition number and doesn't see the scale of columns. No basis mends the start: the lowest of these costs is
41 times that of the fit at order 24, 23 times at order 82.

Handing over, 20 noise seeds of one channel (order 20, one rigid-body mode, nine flexible ones), constrained SK, then LM:

    start                         64 points, errors to 20 %       100 points, errors to 10 %
                                  best optimum  steps (median)    best optimum  steps (median)
    cold, D = I (the paper's)       11 of 20       39               20 of 20       30
    subspace (fit_mfd's default)    18 of 20        8               20 of 20        5
    central model as it is           3 of 20       10               20 of 20        4
    central model, truncated        20 of 20        4               20 of 20        4
    poles of suggest_kautz          20 of 20        4               20 of 20        3

The central model of the convex identification is a start beside the optimum (cost of the start 1.00 to 1.01 of the best)
if balanced truncation brings it to the order first: fit_mfd's own way there, SK steps on the response of a richer model,
can lose a mode (that at 400 Hz, beside 415 Hz). But the poles that `suggest_kautz` proposed for its parametric part do as
well without any convex model: they are what helps, and still when moved by 1 %, where the convex problem is inconsistent (both 6 of
6 seeds). With enough points every start ends at the same optimum.

Run: python voorhoeve2016.py --out folder (--full: the paper's order 82 and 5000 points, 75 SK steps, 20 seeds: an hour and a half)
"""

import argparse
import dataclasses
import tempfile
from pathlib import Path
from typing import NamedTuple

import control
import numpy as np
import scipy.linalg
from matplotlib.figure import Figure
from shared.polynomial_bases import sk_in_basis
from wafer_stage import errors, experiment, modal

import robustid as rid
from robustid.advice import suggest_kautz
from robustid.fitting import FractionProblem, fit_fraction

BASES = {"monomial": "monomial", "scaled monomial": "scaled", "data-dependent orthonormal": "orthonormal"}
SENSED = np.eye(4, 3)  # shapes of the rigid body at the outputs, up to a change of coordinates: the gauge has none
SAMPLE = 0.5e-3  # s, of the single channel
CASES = (100, 0.1), (64, 0.2)  # points of the single channel up to 800 Hz, radius of the errors relative to |P|
SIZE = 9, 300, 10, 2  # flexible modes, frequency points, SK steps of figure 5, seeds
SAME = 1e-3  # relative difference of cost that counts as the same optimum


def rigid_factored(frf, order, weight):
    """The paper's problem: P_o transposed, right-multiplied by diag(s^2, s^2, s^2, 1), the weight by its inverse."""
    problem = FractionProblem(frf.omega, frf.values, order - 6, weight, feedthrough=True).transposed()
    factor = np.column_stack([-(frf.omega**2)] * 3 + [np.ones(frf.omega.size)])[:, None, :]
    weight = problem.weight.scaled(np.broadcast_to(1 / np.abs(factor), problem.values.shape))
    return dataclasses.replace(problem, values=problem.values * factor, weight=weight)


def iterate(problem, denominators, basis, steps):
    """SK steps in a basis: condition numbers, costs (of the true criterion), and the fraction of the lowest cost."""
    conditions, costs, best = [], [], None
    for _ in range(steps):
        try:
            fraction, condition = sk_in_basis(problem, denominators, basis)
            cost = problem.cost(fraction)
        except np.linalg.LinAlgError:
            break
        denominators = fraction.denominators
        if not np.isfinite(cost):
            break
        best = fraction if cost < min(costs, default=np.inf) else best
        conditions.append(condition)
        costs.append(cost)
    return np.array(conditions), np.array(costs), best


def zero_blocks(A):
    """Jordan blocks of the pole 0 of A (n, n), size to number, from the ranks of its powers: {2: 3} are three double ones."""
    A = scipy.linalg.matrix_balance(A, permute=False)[0]
    lost, power = [0], np.eye(len(A))
    for _ in range(4):
        power = power @ A / np.linalg.norm(A, 2)
        singular = np.linalg.svd(power, compute_uv=False)
        lost.append(int(np.sum(singular <= 1e-13 * singular[0])))
    longer = np.diff(lost)  # blocks of size 1 at least, 2 at least, ...
    return {size: int(n) for size, n in enumerate(longer - np.append(longer[1:], 0), start=1) if n}


def plot_conditions(runs, floor):
    """The paper's figure 5, and the cost beside it."""
    figure = Figure(figsize=(10, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    styles = ("-.", 5), ("-", 2.5), ("--", 1.2)  # the costs may be the same
    for (name, (conditions, costs, _)), (style, width) in zip(runs.items(), styles, strict=True):
        steps = np.arange(1, len(costs) + 1)
        left.semilogy(steps, conditions, style, lw=width, label=name)
        right.semilogy(steps, costs, style, lw=width, label=name)
    right.axhline(floor, color="0.5", lw=1, label="the fit of figure 4")
    left.set(xlabel="SK step", ylabel="condition number of the normal matrix")
    right.set(xlabel="SK step", ylabel="cost")
    for axes in (left, right):
        axes.grid(alpha=0.3)
    figure.legend(*right.get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return figure


def single_channel():
    """Force 1 to position 1 behind a zero-order hold: a rigid body and nine flexible modes."""
    frequency, damping, drive, look = modal(9)
    gains = drive[0] * look[0]
    frequency, damping, gains = frequency[2:], damping[2:], np.append(gains[:3].sum(), gains[3:])  # one rigid mode
    blocks = [[[0, 1], [-(w**2), -2 * d * w]] for w, d in zip(frequency, damping, strict=True)]
    B, C = np.tile([[0.0], [1.0]], (len(gains), 1)), np.kron(gains, [1.0, 0.0])[None]
    return control.c2d(control.ss(scipy.linalg.block_diag(*blocks), B, C, 0), SAMPLE)


class End(NamedTuple):
    """Where a fit began and ended."""

    start: float  # cost
    cost: float
    steps: int


def hand_over(truth, lines, level, seed):
    """One experiment, fitted from every start: name to End; and whether the convex identification was consistent."""
    omega = 2 * np.pi * np.linspace(800 / lines, 800, lines)
    z = np.exp(1j * omega * SAMPLE)
    rng = np.random.default_rng(seed)
    response = truth(z)
    bound = level * np.abs(response)
    disc = np.sqrt(rng.uniform(size=lines)) * np.exp(2j * np.pi * rng.uniform(size=lines))
    frf = rid.FrequencyResponse(omega, response + bound * disc, bound=bound, dt=SAMPLE)

    # The second difference of the position has no rigid body: modes are sought there, as the paper fits P_o I_RB.
    twice = (1 - 1 / z) ** 2
    difference = rid.FrequencyResponse(omega, frf.values[:, 0, 0] * twice, bound=bound * np.abs(twice), dt=SAMPLE)
    modes = suggest_kautz(difference)
    rigid = control.ss([[1, SAMPLE], [0, 1]], [[SAMPLE**2 / 2], [SAMPLE]], np.eye(2), 0, SAMPLE)
    prior = rid.Prior(gain_bound=0.01 * np.abs(difference.values).max(), decay_rate=1.05)
    central = rid.identify(rid.MixedProblem(frequency=frf, parametric=[rigid, modes.basis], prior=prior))

    order, weight = truth.nstates, 1 / bound[:, None, None]
    small = rid.balanced_truncation(central.model, order=order, unstable="keep").model
    options = {"order": order, "weight": weight, "rigid_body": rid.RigidBody(1), "stable": False, "restart": False}
    starts = {"subspace (default)": None, "central model, whole": central.model, "central model, truncated": small}
    fits = {name: rid.fit_mfd(frf, method="sk+lm", start=start, **options) for name, start in starts.items()}
    ends = {name: End(fit.start_cost, fit.cost, len(fit.history)) for name, fit in fits.items()}
    # What those begin with: D = I_RB as in the paper, and the proposed poles without the convex model.
    problem = fits["subspace (default)"].problem
    pairs = np.exp((-modes.damping + 1j * np.sqrt(1 - modes.damping**2)) * modes.omega * SAMPLE)
    poles = np.prod(z[:, None] ** 2 - 2 * pairs.real * z[:, None] + np.abs(pairs) ** 2, axis=1)
    for name, denominators in (("cold, D = I", (z - 1) ** 2), ("poles of suggest_kautz", (z - 1) ** 2 * poles)):
        _, costs, best = iterate(problem, denominators[:, None, None], "orthonormal", 75)
        fit = fit_fraction(problem, start=best, method="lm", steps=150)
        ends[name] = End(costs[0], fit.cost, int(np.argmin(costs)) + 1 + len(fit.history))
    return ends, central.consistent


def compare_starts(truth, lines, level, seeds):
    """Print how every start does over the seeds."""
    runs = [hand_over(truth, lines, level, seed) for seed in range(seeds)]
    best = np.array([min(end.cost for end in ends.values()) for ends, _ in runs])
    consistent = sum(consistent for _, consistent in runs)
    print(f"\n{lines} frequency points, errors up to {level:.0%}, {seeds} seeds ({consistent} consistent)")
    print(f"{'start':<26}{'cost of start/best':>20}{'end/best, worst':>17}{'steps':>7}{'best optimum':>14}")
    for name in runs[0][0]:
        start, cost, steps = np.array([ends[name] for ends, _ in runs]).T
        reached = int(np.sum(cost <= (1 + SAME) * best))
        print(
            f"{name:<26}{np.median(start / best):20.3g}{np.max(cost / best):17.3f}{np.median(steps):7.0f}"
            f"{f'{reached} of {seeds}':>14}"
        )


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="folder for pictures (default: a temporary one)")
    parser.add_argument("--full", action="store_true", help="order 82, 5000 frequency points, 75 SK steps, 20 seeds")
    arguments = parser.parse_args(argv)
    out = arguments.out or Path(tempfile.mkdtemp(prefix="robustid-"))
    out.mkdir(parents=True, exist_ok=True)

    modes, lines, steps, seeds = (38, 5000, 75, 20) if arguments.full else SIZE
    order = 2 * modes + 6
    frf, weight, truth, _, bands = experiment(modes, lines, piezo=False)
    print(f"1. Figure 4: 4x4, {lines} frequency points, order {order} with three rigid-body modes, left fraction")
    body = rid.RigidBody(3, side="output", directions=SENSED)
    fit = rid.fit_mfd(frf, order=order, weight=weight, rigid_body=body)
    rid.plot.bode(fit, data=frf).savefig(out / "figure_4.png", dpi=110)
    print(
        f"   {fit.status.value}; {len(fit.history)} steps, condition - 1 at most {fit.condition_numbers.max() - 1:.0e}"
    )
    rms = errors(fit.fraction.response(frf.omega), truth, frf.omega, bands)
    hertz = [f"{a:g}-{b:g} Hz" for a, b in bands / (2 * np.pi)]
    print("   relative rms error: " + ", ".join(f"{e:.1e} ({b})" for e, b in zip(rms, hertz, strict=True)))
    slowest = np.sort(np.abs(fit.fraction.poles))[:7]
    print(f"   slowest |pole|: {', '.join(f'{pole:.5g}' for pole in slowest)} rad/s")
    print(f"   Jordan blocks of the pole 0, size and number: {zero_blocks(np.asarray(fit.model.A))}")

    print(
        f"\n2. Figure 5: {steps} SK steps from D = I on the transposed data, right-multiplied by diag(s^2, s^2, s^2, 1)"
    )
    problem = rigid_factored(frf, order, weight)
    identity = np.broadcast_to(np.eye(4), (lines, 4, 4))
    runs = {name: iterate(problem, identity, basis, steps) for name, basis in BASES.items()}
    plot_conditions(runs, fit.cost).savefig(out / "figure_5.png", dpi=110)
    print(f"{'basis':<28}{'condition - 1: least':>22}{'most':>10}{'lowest cost/figure 4':>22}")
    for name, (conditions, costs, _) in runs.items():
        print(f"{name:<28}{conditions.min() - 1:22.1e}{conditions.max() - 1:10.1e}{costs.min() / fit.cost:22.4g}")

    print("\n3. Handing over: where the constrained fit of a single channel starts, order 20, one rigid-body mode")
    channel = single_channel()
    for count, level in CASES:
        compare_starts(channel, count, level, seeds)
    print("   (cost of the start: after one SK step where there is no model; best: the lowest cost of all starts)")
    print(f"\nPictures: {out}")


if __name__ == "__main__":
    main()
