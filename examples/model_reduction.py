"""Model reduction: error against order for plain, limited and weighted balanced truncation, the bound beside the error.

Four benchmark models of lightly damped structures: a building (48 states), a compact disc player (120, 2x2), a module of the
space station (270, 3x3) and a beam (348). For each a band, and a time, that are to count: what a model of the same order gains
there when it is made for them, and what that costs elsewhere. Limited to a band or a time the smaller model is often unstable:
hollow markers.
Data: SLICOT benchmark collection (Chahlaoui and Van Dooren), downloaded once, or from the folder that ROBUSTID_DATA names.
Run: python model_reduction.py --out folder (--full: every model at three times as many orders)
"""

import argparse
import tempfile
from pathlib import Path
from typing import NamedTuple

import control
import numpy as np
import scipy.linalg as sla
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

import robustid as rid
from robustid.errors import DatasetNotFoundError
from robustid.reduction import ReductionStatus, hinf_error


class Case(NamedTuple):
    band_hz: tuple
    horizon: float
    orders: tuple


# Bands above the modes that dominate, times of a few periods of these.
CASES = {
    "build": Case((4.0, 10.0), 1.0, (2, 6, 10, 16, 24, 32)),
    "CDplayer": Case((300.0, 3000.0), 0.02, (2, 6, 12, 20, 30)),
    "iss1R": Case((3.0, 8.0), 5.0, (4, 10, 20, 30)),
    "beam": Case((1.0, 6.0), 5.0, (4, 10, 20)),
}
STYLES = {
    "plain": ("C0", "o", "plain"),
    "static gain": ("C1", "s", "static gain kept"),
    "band": ("C2", "^", "limited to the band"),
    "horizon": ("C4", "v", "limited to the first seconds"),
    "weight": ("C3", "D", "weighted with a band-pass"),
}
LINES = 200
SAMPLES = 400


class Judge:
    """How far a smaller model is from one model: everywhere, in the band, and in the first seconds of the step response."""

    def __init__(self, model, case):
        self.model, self.case = model, case
        low, high = (2 * np.pi * edge for edge in case.band_hz)
        poles = np.abs(model.poles())
        omega = np.concatenate([np.geomspace(low, high, LINES), poles[(poles >= low) & (poles <= high)]])
        self.lines, self.response = omega, self._response(model, omega)
        self.steps = self._steps(model)
        nothing = control.StateSpace([], [], [], np.zeros((model.noutputs, model.ninputs)))
        self.peak = hinf_error(model, nothing).value

    def errors(self, reduction):
        """Relative to the largest response of the model everywhere, in the band, in the time."""
        stable, reduced = reduction.status is not ReductionStatus.UNSTABLE, reduction.model
        everywhere = hinf_error(self.model, reduced).value / self.peak if stable else np.nan
        in_band = self._largest(self.response - self._response(reduced, self.lines)) / self._largest(self.response)
        left = np.linalg.norm(self.steps - self._steps(reduced)) / np.linalg.norm(self.steps)
        return everywhere, in_band, left

    @staticmethod
    def _largest(values):
        return np.max(np.linalg.norm(values, 2, axis=(1, 2)))

    @staticmethod
    def _response(model, omega):
        """In Schur form: a triangular solve a line."""
        triangular, basis = sla.schur(model.A, output="complex") if model.nstates else (model.A, model.A)
        b, c, eye = basis.conj().T @ model.B, model.C @ basis, np.eye(model.nstates)
        return np.array([c @ sla.solve_triangular(1j * w * eye - triangular, b) + model.D for w in omega])

    def _steps(self, model):
        """Responses to a step at each input."""
        n, nu = model.B.shape
        whole = sla.expm(np.block([[model.A, model.B], [np.zeros((nu, n + nu))]]) * self.case.horizon / SAMPLES)
        state, values = np.zeros((n, nu)), []
        for _ in range(SAMPLES):
            values.append(model.C @ state + model.D)
            state = whole[:n, :n] @ state + whole[:n, n:]
        return np.array(values)


def band_pass(band_hz):
    """One in the band, a hundredth far from it."""
    low, high = (2 * np.pi * edge for edge in band_hz)
    return control.ss([[0, 1], [-low * high, low - high]], [[0], [1]], [[0, high - low]], 0.01)


def reductions(model, case, order):
    """The five models of one order."""
    options = {
        "plain": {},
        "static gain": {"match": "static gain"},
        "band": {"band_hz": case.band_hz},
        "horizon": {"horizon": case.horizon},
        "weight": {"weight": band_pass(case.band_hz)},
    }
    return {name: rid.balanced_truncation(model, order=order, **chosen) for name, chosen in options.items()}


def measure(name, model, case, orders):
    """Rows (method, order, bound, everywhere, in the band, in the time, stable), the first four relative to the peak."""
    judge = Judge(model, case)
    print(f"\n{name}: {model.nstates} states, {model.ninputs} inputs, {model.noutputs} outputs; peak {judge.peak:.4g}")
    print(f"{'':14}{'order':>6}{'bound':>11}{'error':>11}{'in band':>11}{'in time':>11}")
    rows = []
    for order in orders:
        for method, reduction in reductions(model, case, order).items():
            stable = reduction.status is not ReductionStatus.UNSTABLE
            bound = reduction.bound / judge.peak
            errors = judge.errors(reduction)
            rows.append((method, order, bound, *errors, stable))
            numbers = "".join(f"{value:11.2e}" for value in (bound, *errors))
            print(f"{method:14}{order:6d}{numbers}{'' if stable else '  unstable'}", flush=True)
    return rows


def plot(results):
    """Error against order: a row a model; the whole axis with the bound, the band, the first seconds."""
    figure = Figure(figsize=(12, 2.9 * len(results)), layout="constrained")
    axes = figure.subplots(len(results), 3, squeeze=False)
    for line, (name, rows) in zip(axes, results.items(), strict=True):
        case = CASES[name]
        low, high = case.band_hz
        titles = ("all frequencies", f"{low:g} to {high:g} Hz", f"step response, first {case.horizon:g} s")
        for column, (ax, title) in enumerate(zip(line, titles, strict=True)):
            for method, (color, marker, label) in STYLES.items():
                mine = [row for row in rows if row[0] == method]
                x, y = [row[1] for row in mine], [row[3 + column] for row in mine]
                ax.semilogy(x, y, color=color, marker=marker, ms=4, lw=1, label=label)
                unstable = [k for k, row in enumerate(mine) if not row[6]]
                ax.semilogy(
                    [x[k] for k in unstable], [y[k] for k in unstable], ls="", marker=marker, ms=4, mec=color, mfc="w"
                )
            if column == 0:
                mine = [row for row in rows if row[0] == "plain"]
                ax.semilogy(
                    [r[1] for r in mine], [r[2] for r in mine], color="k", lw=1, ls="--", label="a-priori bound"
                )
                ax.set_ylabel(f"{name}\nrelative error")
            ax.set_title(title, fontsize=10)
            ax.set_ylim(top=min(10.0, ax.get_ylim()[1]))  # what unstable models do in time goes far beyond
            ax.xaxis.set_major_locator(MaxNLocator(integer=True))
            ax.grid(color="0.9")
        line[0].set_xlim(left=0)
    for ax in axes[-1]:
        ax.set_xlabel("order")
    figure.legend(
        *axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=6, frameon=False, fontsize=9
    )
    return figure


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="folder for pictures (default: a temporary one)")
    parser.add_argument("--models", nargs="+", choices=CASES, default=list(CASES), help="models to reduce")
    parser.add_argument("--full", action="store_true", help="every fourth order up to 80; minutes")
    arguments = parser.parse_args(argv)
    try:
        models = {name: rid.datasets.load(name) for name in arguments.models}
    except DatasetNotFoundError as missing:
        print(f"This example needs published models. {missing}")
        return
    out = arguments.out or Path(tempfile.mkdtemp(prefix="robustid-"))
    out.mkdir(parents=True, exist_ok=True)
    print(
        "Bound and error over all frequencies, relative to the peak; in the band, to the largest response there; in time, norms."
    )
    results = {}
    for name, model in models.items():
        orders = range(4, min(80, model.nstates - 1), 4) if arguments.full else CASES[name].orders
        results[name] = measure(name, model, CASES[name], orders)
    plot(results).savefig(out / "model_reduction.png", dpi=110)
    plain = [row for rows in results.values() for row in rows if row[0] in ("plain", "static gain")]
    held = sum(row[3] <= row[2] * (1 + 1e-9) + 1e-9 for row in plain)
    limited = [row for rows in results.values() for row in rows if row[0] in ("band", "horizon")]
    unstable = sum(not row[6] for row in limited)
    others = sum(not row[6] for rows in results.values() for row in rows) - unstable
    print(f"\nLimited to a band or a time {unstable} of {len(limited)} are unstable, of all others {others}.")
    print(f"The bound holds in {held} of {len(plain)} truncations that have one. Pictures: {out}")


if __name__ == "__main__":
    main()
