"""The engineer's model of an interpolant joined with the parametric part."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.linalg

from robustid.interpolation import MixedProblem, Rows


def join_model(
    problem: MixedProblem,
    rows: Rows,
    scaled: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
    p: np.ndarray,
) -> Any:
    """State space of F = p'P + G, G(z) = K phi(z/rho), phi = (alpha, beta, gamma, delta) in the scaled variable.

    Engineer's convention: A = alpha/rho, B = beta, C = K gamma/rho, D = K delta; the parametric states follow those of G.
    """
    import control

    alpha, beta, gamma, delta = scaled
    K, rho = problem.prior.gain_bound, problem.prior.decay_rate
    # Half of K on either side keeps the realisation balanced.
    root = np.sqrt(K)
    A, B, C, D = alpha / rho, root * beta, root * gamma / rho, K * delta
    basis = problem.parametric
    if basis is not None:
        weights = physical_parameters(rows, p)[None, :]
        A, B = scipy.linalg.block_diag(A, basis.A), np.vstack([B, basis.B])
        C, D = np.hstack([C, weights @ basis.C]), D + weights @ basis.D
    output, input_ = problem.channel
    names = {"inputs": [_label(input_.name, "u")], "outputs": [_label(output.name, "y")], "name": "identified"}
    return control.ss(A, B, C, D, problem.dt, **names)


def _label(name: str, default: str) -> str:
    """A signal name as `control` takes it: not empty, and without dots."""
    return name.replace(".", "_") or default


def physical_parameters(rows: Rows, p: np.ndarray) -> np.ndarray:
    """The parameters in the user's units, transients left out."""
    return (p / rows.column_scale)[: rows.parameters] if rows.parameters else np.zeros(0)
