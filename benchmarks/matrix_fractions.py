"""Matrix fractions: fit_mfd against vector fitting and Loewner interpolation, cost of a step, other bases.

Run: OPENBLAS_NUM_THREADS=1 python benchmarks/matrix_fractions.py [--seeds 5] [--large] [--plot PATH]. Every seed is a
random structure with rank-one modes (tests/support/mfd_systems.py) on 1000 logarithmic lines from 4 to 1200 Hz. Peers where
they are installed: scikit-rf and pyMOR, each at those of its settings that have the lowest median error to the truth.
"""

import argparse
import itertools
import pathlib
import sys
import time
import warnings
from typing import NamedTuple

import numpy as np
import scipy.linalg

sys.path.insert(0, str(pathlib.Path(__file__).parent.parent / "tests"))
sys.path.insert(0, str(pathlib.Path(__file__).parent.parent / "examples"))
from shared.polynomial_bases import BASES, conditioning, sk_in_basis

import robustid as rid
from robustid.fitting import FractionProblem, Weight, fit_fraction, fit_mfd
from support.mfd_systems import noisy, random_modal_system, relative_error

try:
    import skrf
    from skrf.vectorFitting import VectorFitting
except ImportError:
    skrf = None
try:
    from pymor.core.logger import set_log_levels
    from pymor.reductors.loewner import LoewnerReductor

    set_log_levels({"pymor": "ERROR"})
except ImportError:
    LoewnerReductor = None

STEPS = 10


class Run(NamedTuple):
    """One fit: how it was set, its order, its error against the truth, its time."""

    settings: str
    states: int
    error: float
    seconds: float


def lines(count=1000):
    return 2 * np.pi * np.geomspace(4, 1200, count)


def case(seed, channels, modes, level, count=1000):
    omega = lines(count)
    truth = random_modal_system(seed, channels, channels, modes).response(1j * omega)
    return omega, truth, noisy(np.random.default_rng([seed, 1]), truth, level) if level else truth


def clock(work):
    """Result and processor time: what others do on the machine doesn't count."""
    start = time.process_time()
    return work(), time.process_time() - start


def ours(omega, values, truth, order):
    fit, seconds = clock(lambda: fit_mfd(rid.FrequencyResponse(omega, values), order=order))
    response = np.moveaxis(fit.model(1j * omega, squeeze=False), -1, 0)
    yield Run("default weight", fit.model.nstates, relative_error(response, truth), seconds)


def vector_fitting(omega, values, truth, order):
    """Common poles with residues of any rank (pairs x 2 x channels states), and cut to rank one (pairs x 2)."""
    channels = values.shape[1]
    for pairs, spacing, terms in itertools.product((order // 2, order, 2 * order), ("log", "lin"), range(3)):
        if pairs == 2 * order and channels > 1 and (spacing, terms) != ("log", 0):
            continue  # slow, and never the best
        fit = VectorFitting(skrf.Network(f=omega / (2 * np.pi), s=values, z0=50, f_unit="hz"))
        fit.max_iterations = 20
        settings = {"fit_constant": terms > 0, "fit_proportional": terms > 1}
        _, seconds = clock(lambda f=fit, p=pairs, w=spacing, s=settings: f.vector_fit(0, p, init_pole_spacing=w, **s))
        name = f"{pairs} pairs {spacing}{' +d' * (terms > 0)}{' +e' * (terms > 1)}"
        residues = fit.residues.reshape(channels, channels, -1).transpose(2, 0, 1)
        first = np.linalg.svd(residues)[0][:, :, :1]
        for cut, R in ((False, residues), (True, first @ (first.conj().transpose(0, 2, 1) @ residues))):
            response = fit.constant_coeff + 1j * omega[:, None] * fit.proportional_coeff
            response = response.reshape(-1, channels, channels).astype(complex)
            for pole, residue in zip(fit.poles, R, strict=True):
                response += residue / (1j * omega - pole)[:, None, None]
                if pole.imag:
                    response += residue.conj() / (1j * omega - pole.conj())[:, None, None]
            states = int(np.sum(1 + (fit.poles.imag != 0))) * (1 if cut else channels)
            if channels > 1 or not cut:
                yield Run(name + " rank one" * cut, states, relative_error(response, truth), seconds)


def loewner(omega, values, truth, order):
    """All entries on part of the lines (an SVD of size channels*lines), or along unit vectors in turn on all."""
    channels, s = values.shape[1], 1j * omega / omega[-1]
    ways = [("even-odd", 1), ("half-half", 1)] if channels == 1 else [("half-half", 4)]
    ways += [("even-odd", thin) for thin in (2, 4, 8)] + [("tangential", 1)] * (channels > 1)
    for split, thin in ways:
        points, data, settings = s[::thin], values[::thin] if channels > 1 else values[::thin, 0, 0], {}
        if split == "tangential":
            points, data, settings = along_unit_vectors(points, data)
        else:
            settings["partitioning"] = split
        reductor, shared = clock(lambda p=points, d=data, k=settings: loewner_svd(p, d, k))
        for states in (round(order * factor) for factor in (1, 1.1, 1.25, 1.5, 1.75, 2, 3, 4)):
            rom, seconds = clock(lambda r=reductor, n=states: r.reduce(r=n, tol=1e-13))
            A, B, C, _, E = rom.to_matrices()
            response = C @ np.linalg.solve(s[:, None, None] * E - A, np.broadcast_to(B + 0j, (s.size, *B.shape)))
            name = split + (f", 1 line of {thin}" if thin > 1 else "")
            yield Run(name, rom.order, relative_error(response, truth), shared + seconds)


def loewner_svd(points, data, settings):
    """The reductor after its first reduction: the decompositions are kept, the orders then cost little."""
    reductor = LoewnerReductor(points, data, **settings)
    reductor.reduce(r=1)
    return reductor


def along_unit_vectors(points, data):
    """Even lines from the left, odd ones from the right; the conjugates get the same direction: the model is real."""
    count, channels = data.shape[:2]
    sides = [np.arange(0, count, 2), np.arange(1, count, 2)]
    directions = [np.tile(np.eye(channels)[np.arange(k.size) % channels], (2, 1)) for k in sides]
    both = tuple(np.concatenate([k, count + k]) for k in sides)
    settings = {"partitioning": both, "mimo_handling": (directions[0], directions[1].T)}
    return np.concatenate([points, points.conj()]), np.concatenate([data, data.conj()]), settings


PEERS = {
    "robustid fit_mfd": (ours, rid),
    "scikit-rf VectorFitting": (vector_fitting, skrf),
    "pyMOR Loewner": (loewner, LoewnerReductor),
}


def accuracy(title, seeds, channels, modes, level):
    """One table: every method at the order of the truth, and at the best of all its orders."""
    order = 2 * modes
    print(f"\n{title}, seeds {seeds}: medians")
    print(f"{'':26}{'states':>7}{'rms error':>11}{'/ ours':>9}{'CPU s':>9}  settings")
    found = {name: [] for name, (_, peer) in PEERS.items() if peer is not None}
    for seed, name in itertools.product(range(seeds), found):
        omega, truth, values = case(seed, channels, modes, level)
        found[name].append(list(PEERS[name][0](omega, values, truth, order)))
    reference = None
    for name, (_, peer) in PEERS.items():
        if peer is None:
            print(f"{name:26} not installed, skipped")
            continue
        ways = [
            Run(runs[0].settings, *np.median([run[1:] for run in runs], axis=0))
            for runs in zip(*found[name], strict=True)
        ]
        for limit in (order, np.inf)[: 1 if peer is rid else 2]:
            best = min((way for way in ways if way.states <= limit), key=lambda way: way.error)
            reference = best.error if reference is None else reference
            ratio = f"{best.error / reference:9.2g}"
            print(
                f"{name:26}{best.states:7.0f}{best.error:11.1e}{ratio}{best.seconds:9.2f}  {best.settings}", flush=True
            )


def problem_of(channels, order, count):
    omega, _, values = case(0, channels, order // 2, 0.01, count)
    start = np.broadcast_to(np.eye(channels), (count, channels, channels))
    return FractionProblem(omega, values, order, Weight.relative(values)), start


def step_seconds(problem, start, repeats=3):
    return min(clock(lambda: sk_in_basis(problem, start, "orthonormal"))[1] for _ in range(repeats))


def speed(large):
    print("\none SK step (with its condition number) against scipy.linalg.qr(mode='economic') of an equal matrix, 4x4")
    print(f"{'rows x columns':>18}{'order':>7}{'lines':>7}{'step s':>9}{'qr s':>9}{'qr / step':>11}")
    for order, count in ((40, 1000), (82, 5000))[: 1 + large]:
        repeats = 3 if count == 1000 else 1
        problem, start = problem_of(4, order, count)
        step = step_seconds(problem, start, repeats)
        rows, columns = 2 * problem.values.size, order * 8
        matrix = np.asfortranarray(np.random.default_rng(0).standard_normal((columns, rows)).T)
        qr = min(
            clock(lambda m=matrix: scipy.linalg.qr(m, mode="economic", check_finite=False))[1] for _ in range(repeats)
        )
        print(f"{f'{rows} x {columns}':>18}{order:7}{count:7}{step:9.2f}{qr:9.2f}{qr / step:11.2f}", flush=True)
    print("\none SK step by number of lines, 4x4, order 40")
    print(f"{'lines':>7}{'step s':>9}{'ms per line':>13}")
    for count in (500, 1000, 2000, 4000):
        seconds = step_seconds(*problem_of(4, 40, count))
        print(f"{count:7}{seconds:9.2f}{1e3 * seconds / count:13.2f}", flush=True)


def bases(channels, plot=None):
    """Condition of the normal matrix: SK from a cold start, and one step from the fit with the response it gives."""
    problem, start = problem_of(channels, 40, 1000)
    good = fit_mfd(rid.FrequencyResponse(problem.omega, problem.values), order=40).nodes.denominators
    exact = sk_in_basis(problem, good, "orthonormal")[0].response
    curves = {}
    print(
        f"\ncondition of the normal matrix, noisy {channels}x{channels}, order 40: SK from D = I; one step from the fit"
    )
    print(f"{'basis':>13}{'step 1':>11}{f'step {STEPS}':>11}{'at the fit':>12}{'its response differs':>22}")
    for basis in BASES:
        curves[basis] = conditioning(problem, start, steps=STEPS, basis=basis)
        fraction, condition = sk_in_basis(problem, good, basis)
        away = relative_error(fraction.response, exact) if np.all(np.isfinite(fraction.denominators)) else np.nan
        cells = f"{curves[basis][0]:11.1e}{curves[basis][-1]:11.1e}{condition:12.1e}{away:22.1e}"
        print(f"{basis:>13}{cells}", flush=True)
    print(f"largest condition - 1 of the orthonormal basis: {np.max(curves['orthonormal'] - 1):.1e}")
    if plot:
        draw(curves, plot)


def every_step(large):
    """Condition along whole iterations: SK from D = I, Levenberg-Marquardt as by default, then IV from its end."""
    print("\nlargest condition - 1 of the normal matrix over all steps, noisy 4x4, 1000 lines")
    print(f"{'order':>7}{'method':>8}{'steps':>7}{'condition - 1':>15}")
    for order in (40, 82)[: 1 + large]:
        problem, start = problem_of(4, order, 1000)
        history = fit_fraction(problem, denominators=start, method="sk").history
        history += fit_mfd(rid.FrequencyResponse(problem.omega, problem.values), order=order, method="lm+iv").history
        for method in ("sk", "lm", "iv"):
            conditions = [step.condition for step in history if step.method == method]
            print(f"{order:7}{method:>8}{len(conditions):7}{max(conditions) - 1:15.1e}", flush=True)


def draw(curves, path):
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(7.0, 3.8), layout="constrained")
    for (basis, values), marker in zip(curves.items(), "osd^", strict=True):
        axes.semilogy(np.arange(1, values.size + 1), values, marker=marker, label=basis)
    axes.set(xlabel="iteration", ylabel="condition number of the normal matrix")
    axes.set_title("Sanathanan-Koerner, noisy 4×4 data, order 40")
    axes.grid(alpha=0.3)
    figure.legend(loc="outside right center")
    figure.savefig(path, dpi=150)


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--large", action="store_true", help="also at order 82; a step with 5000 lines (3 GB)")
    parser.add_argument("--plot", help="draw the condition numbers to this file")
    arguments = parser.parse_args(argv)
    warnings.simplefilter("ignore")  # vector fitting says so when it stops at its iteration limit
    bases(4, arguments.plot)
    bases(1)
    every_step(arguments.large)
    accuracy("4x4, 40 states, 1 % noise", arguments.seeds, 4, 20, 0.01)
    accuracy("single channel, 20 states, 1 % noise", arguments.seeds, 1, 10, 0.01)
    accuracy("4x4, 40 states, no noise", 1, 4, 20, 0.0)
    speed(arguments.large)


if __name__ == "__main__":
    main()
