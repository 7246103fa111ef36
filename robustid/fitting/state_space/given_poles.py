"""Linear least squares with given poles: inputs or outputs of a state-space model, reflection into the stable region."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import scipy.linalg

from robustid.core import lengths, real_rows, response_at
from robustid.fitting.fraction.householder import triangle

# How far inside the stability boundary a reflected pole ends at least, relative to the lowest frequency (or to 1).
_BOUNDARY = 1e-9


class Samples(NamedTuple):
    """A response on its grid, with a weight per entry; `noise` is the inverse standard deviation, where it is known."""

    values: np.ndarray  # (F, ny, nu)
    points: np.ndarray  # (F,)
    weight: np.ndarray  # (F, ny, nu)
    domain: str
    noise: np.ndarray | None = None  # (F, ny, nu)

    def transposed(self) -> Samples:
        """Samples of the transposed response."""
        values, weight = self.values.transpose(0, 2, 1), self.weight.transpose(0, 2, 1)
        noise = None if self.noise is None else self.noise.transpose(0, 2, 1)
        return self._replace(values=values, weight=weight, noise=noise)


def diagonal_blocks(*blocks: np.ndarray) -> np.ndarray:
    """Block-diagonal matrix."""
    return np.asarray(scipy.linalg.block_diag(*blocks))


def fit_inputs(data: Samples, A: np.ndarray, C: np.ndarray, feedthrough: bool) -> tuple[np.ndarray, np.ndarray, float]:
    """B, D by weighted linear least squares, one problem per input, and the weighted rms residual."""
    values, points, weight = data[:3]
    lines, ny, nu = values.shape
    order = len(A)
    rows = output_rows(A, C, points)
    if feedthrough:
        rows = np.concatenate([rows, np.broadcast_to(np.eye(ny), (lines, ny, ny))], axis=2)
    if not np.all(np.isfinite(rows)):
        return np.zeros((order, nu)), np.zeros((ny, nu)), math.inf
    gain = np.empty((rows.shape[2], nu))
    for j in range(nu):
        system = np.concatenate([rows, values[:, :, j, None]], axis=2)
        equations = real_rows((weight[:, :, j, None] * system).reshape(lines * ny, -1))
        gain[:, j] = solution_in_units(triangle(equations))
    residual = np.linalg.norm(weight * (values - rows @ gain)) / math.sqrt(np.count_nonzero(weight))
    return gain[:order], gain[order:] if feedthrough else np.zeros((ny, nu)), float(residual)


def fit_outputs(data: Samples, A: np.ndarray, B: np.ndarray, feedthrough: bool) -> tuple[np.ndarray, np.ndarray]:
    """C, D by weighted linear least squares, one problem per output."""
    C, D, _ = fit_inputs(data.transposed(), A.T, B.T, feedthrough)
    return C.T, D.T


def output_rows(A: np.ndarray, C: np.ndarray, points: np.ndarray) -> np.ndarray:
    """C (xi I - A)^{-1} at all points, (F, ny, n), inf or nan at a pole: the states of the dual system in reversed order, so
    that a Schur form of A is one of the dual, too.
    """
    dual = (A.T[::-1, ::-1], C.T[::-1], np.eye(len(A))[::-1], np.zeros((len(A), len(C))))
    return response_at(dual, points).transpose(0, 2, 1)


def reflected(A: np.ndarray, points: np.ndarray, domain: str) -> np.ndarray:
    """A in real Schur form with its unstable eigenvalues reflected: -conj(s), 1/conj(z)."""
    boundary = _BOUNDARY * (np.min(band(points, "s")) if domain == "s" else 1.0)
    out = A.copy()
    j, n = 0, len(out)
    while j < n:
        size = 2 if j + 1 < n and out[j + 1, j] != 0 else 1
        block = out[j : j + size, j : j + size]  # LAPACK's standard form: equal diagonal entries, the real part
        if domain == "s":
            np.fill_diagonal(block, -max(abs(block[0, 0]), boundary))
        else:
            radius = math.sqrt(abs(np.linalg.det(block))) if size == 2 else abs(block[0, 0])
            if radius > 1 - boundary:
                block *= min(1 / radius, 1 - boundary) / radius
        j += size
    return out


def band(points: np.ndarray, domain: str) -> np.ndarray:
    """The frequencies of the points, rad/s or rad/sample, without zero and Nyquist."""
    frequency = np.abs(np.imag(points)) if domain == "s" else np.abs(np.angle(points))
    return frequency[(frequency > 0) & ((domain == "s") | (frequency < np.pi * (1 - 1e-9)))]


def solution(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """The shortest least-squares solution of ``matrix x = right``."""
    return np.asarray(np.linalg.lstsq(matrix, right, rcond=None)[0], dtype=float)


def solution_in_units(equations: np.ndarray) -> np.ndarray:
    """The least-squares solution x of ``A x = b``, from [A b], every unknown in the unit that gives its column length one."""
    size = lengths(equations[:, :-1])
    return solution(equations[:, :-1] / size, equations[:, -1]) / size
