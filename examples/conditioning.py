"""How fast the paper's form of the consistency condition loses its digits, and that the orthonormal form keeps them.

Theorem 1 of T. Inanc et al. (IEEE Transactions on Control Systems Technology 9(4), 2001) inverts the Gram matrix
M0 of its basis. For N nodes at the N-th roots of unity, the best layout there is, cond(M0) = rho^(2(N-1)) (Lemma 1).
In the orthonormal basis M0 = I.
Run: python conditioning.py --out folder
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from robustid.bases import input_normal_pair, solve_stein
from robustid.identification.formulation.classical import classical_form

COUNTS = (4, 8, 12, 16, 24, 32, 40, 60, 80)
DT = 0.01


def conditions(angles, rho):
    """Condition number of the Gram matrix in the paper's basis and in the orthonormal one."""
    pair = input_normal_pair(angles, 1 / rho, 0)
    gram = solve_stein(pair.A.T, pair.A, pair.c.T @ pair.c)  # M0 - A'M0A = c'c, solved, not assumed to be I
    return classical_form(pair, np.exp(-1j * angles) / rho, 1 / rho, 0).condition, np.linalg.cond(gram)


def roots_of_unity(count):
    """Angles of the upper half of the N-th roots of unity; conjugates are implied."""
    return np.linspace(0, np.pi, count // 2 + 1)


def measured_band(count):
    """As many nodes, conjugates counted, at equally spaced frequency points from 1 to 21 Hz."""
    return 2 * np.pi * DT * np.linspace(1, 21, count // 2)


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="folder for the picture (default: a temporary one)")
    out = parser.parse_args(argv).out or Path(tempfile.mkdtemp(prefix="robustid-"))
    out.mkdir(parents=True, exist_ok=True)

    figure = Figure(figsize=(10, 4.2), layout="constrained")
    for axes, rho in zip(figure.subplots(1, 2, sharey=True), (1.02, 1.1), strict=True):
        print(f"\nrho = {rho}, T = {1000 * DT:g} ms        condition number of M0")
        print(f"{'nodes N':>8}{'Lemma 1':>12}{'roots of unity':>17}{'points 1-21 Hz':>16}{'orthonormal - 1':>18}")
        lemma = [rho ** (2 * (N - 1)) for N in COUNTS]
        even = [conditions(roots_of_unity(N), rho) for N in COUNTS]
        band = [conditions(measured_band(N), rho) for N in COUNTS]
        for N, formula, best, real in zip(COUNTS, lemma, even, band, strict=True):
            print(f"{N:8d}{formula:12.4g}{best[0]:17.4g}{real[0]:16.4g}{max(best[1], real[1]) - 1:18.1e}")
        axes.semilogy(COUNTS, [c[0] for c in band], "s-", color="tab:red", label="paper's form, points 1-21 Hz")
        axes.semilogy(COUNTS, [c[0] for c in even], "o", color="tab:blue", label="paper's form, roots of unity")
        axes.semilogy(COUNTS, lemma, "--", color="tab:blue", label=r"Lemma 1: $\rho^{2(N-1)}$")
        axes.semilogy(COUNTS, [c[1] for c in band], "d-", color="tab:green", label="orthonormal form, points 1-21 Hz")
        axes.axhline(1 / np.finfo(float).eps, color="0.6", lw=1, ls=":")
        axes.annotate(
            "no digit left", (COUNTS[0], 1 / np.finfo(float).eps), (0, -13), textcoords="offset points", color="0.4"
        )
        axes.set(title=rf"$\rho$ = {rho}", xlabel="nodes N, conjugates counted")
        axes.grid(alpha=0.3)
    figure.axes[0].set_ylabel("condition number of the Gram matrix")
    figure.axes[0].legend(fontsize="small")
    figure.savefig(out / "conditioning.png", dpi=120)
    print(
        "\nAt the roots of unity Lemma 1 is exact. Lines as they are measured, in one part of the circle, are far worse, and a\n"
        "larger decay rate moves nodes together for both. The orthonormal form is built from reflections and needs no inverse.\n"
        f"\nPicture: {out / 'conditioning.png'}"
    )


if __name__ == "__main__":
    main()
