"""The measurements as linear equations in the unknowns, in units of their bounds."""

from __future__ import annotations

import dataclasses

import numpy as np
import scipy.linalg

from robustid._arrays import Frozen, freeze
from robustid.bases import InputNormalPair
from robustid.data import FrequencyResponse, TimeRecord
from robustid.errors import InputError
from robustid.interpolation.problem import MixedProblem, excited_lines


@dataclasses.dataclass(frozen=True, eq=False)
class Rows(Frozen):
    """Residuals e = y - E x - P p of all samples, each divided by its bound: sample k is kept if |e_k| <= 1.

    Complex samples come first. Imaginary parts of real samples are zero throughout, so that one formula serves both.

    Attributes
    ----------
    y : (N,) complex array
    E : (N, n) complex array
        Of the coefficients x of G/K in the orthonormal basis.
    P : (N, m) complex array
        Of the parameters, then of the free transients; columns scaled by powers of two (`column_scale`).
    fixed : (N,) array
        Part of each (unit) bound that does not grow with K; below 1 only where an unknown past input widens it.
    discs : int
        Number of complex samples.
    """

    y: np.ndarray
    E: np.ndarray
    P: np.ndarray
    fixed: np.ndarray
    discs: int
    column_scale: np.ndarray
    parameters: int

    def __post_init__(self) -> None:
        self._set(**{n: freeze(getattr(self, n)) for n in ("y", "E", "P", "fixed", "column_scale")})

    @property
    def real(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(y, E, P) as real rows: real parts of all samples, then imaginary parts of the discs."""
        return tuple(np.concatenate([a.real, a[: self.discs].imag]) for a in (self.y, self.E, self.P))  # type: ignore[return-value]

    def ratio(self, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        """|residual|/bound of every sample at coefficients x and scaled parameters p."""
        return np.abs(self.y - self.E @ x - self.P @ p)


@dataclasses.dataclass
class _Block:
    """Rows of one experiment before scaling; `widen` is what an unknown past input adds to the bound."""

    y: np.ndarray
    E: np.ndarray
    P: np.ndarray
    bound: np.ndarray
    widen: np.ndarray
    free: np.ndarray


def measurement_rows(problem: MixedProblem, pair: InputNormalPair) -> Rows:
    """All samples of the problem as `Rows` in the basis of `pair`."""
    K, rho = problem.prior.gain_bound, problem.prior.decay_rate
    values = K * pair.evaluate(np.exp(-1j * problem.angles) / rho) if problem.angles.size else np.zeros((0, pair.order))
    taylor = K * rho ** -np.arange(problem.taylor)[:, None] * pair.taylor(problem.taylor)
    blocks = [_frequency_block(problem, f, values) for f in problem.frequency]
    for record in problem.time:
        if record.initial == "periodic":
            blocks.append(_periodic_block(problem, record, values))
        else:
            blocks.append(_time_block(problem, record, taylor))
    return _assemble(problem, blocks)


def _frequency_block(problem: MixedProblem, frf: FrequencyResponse, values: np.ndarray) -> _Block:
    angles = frf.omega * problem.dt
    none = np.zeros((angles.size, 0))
    P = none if problem.parametric is None else problem.parametric.response(angles)
    bound = frf.bound[:, 0, 0]
    return _Block(frf.values[:, 0, 0], values[problem.node_index(angles)], P, bound, np.zeros(angles.size), none)


def _time_block(problem: MixedProblem, record: TimeRecord, taylor: np.ndarray) -> _Block:
    used = np.flatnonzero(np.isfinite(record.bound[:, 0]))
    count = used[-1] + 1
    U = scipy.linalg.toeplitz(record.u[:count, 0], np.zeros(count))[used]
    basis = problem.parametric
    P = U @ basis.impulse(count) if basis is not None else np.zeros((used.size, 0))
    free, widen = initial_state(problem, record, used)
    return _Block(record.y[used, 0], U @ taylor[:count], P, record.bound[used, 0], widen, free)


def initial_state(problem: MixedProblem, record: TimeRecord, used: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What an unknown state before the record can do to the samples `used`.

    Columns that span the free responses of the parametric part; and, for the non-parametric part, how much the past
    input can add: sum_{j>k} |g_j| u_max <= u_max K rho^-k / (rho - 1).
    """
    if record.initial != "free":
        return np.zeros((used.size, 0)), np.zeros(used.size)
    K, rho = problem.prior.gain_bound, problem.prior.decay_rate
    past = np.abs(record.u).max() if record.past_input_bound is None else record.past_input_bound
    widen = past * K * rho ** -used.astype(float) / (rho - 1)
    if problem.parametric is None:
        return np.zeros((used.size, 0)), widen
    return problem.parametric.transients(used[-1] + 1)[used], widen


def _periodic_block(problem: MixedProblem, record: TimeRecord, values: np.ndarray) -> _Block:
    samples = record.u.shape[0]
    used = np.flatnonzero(np.isfinite(record.bound[:, 0]))
    lines = excited_lines(record)
    angles = 2 * np.pi * lines / samples
    weight = np.where((lines == 0) | (2 * lines == samples), 1.0, 2.0) * np.fft.rfft(record.u[:, 0])[lines] / samples
    wave = weight * np.exp(1j * (2 * np.pi / samples) * (np.outer(used, lines) % samples))
    E = (wave @ values[problem.node_index(angles)]).real
    none = np.zeros((used.size, 0))
    P = none if problem.parametric is None else (wave @ problem.parametric.response(angles)).real
    return _Block(record.y[used, 0], E, P, record.bound[used, 0], np.zeros(used.size), none)


def _assemble(problem: MixedProblem, blocks: list[_Block]) -> Rows:
    total = np.concatenate([b.bound + b.widen for b in blocks])
    free = np.asarray(scipy.linalg.block_diag(*(b.free for b in blocks)))
    P = np.hstack([np.vstack([b.P for b in blocks]), free]) / total[:, None]
    E = np.vstack([b.E for b in blocks]) / total[:, None]
    y = np.concatenate([b.y for b in blocks]) / total
    sizes = [float(np.abs(a).max(initial=0.0)) for a in (P, E, y)]
    if not max(sizes) < 1e100:
        raise InputError(
            "`bound` is too small against the data (or a basis function is infinite at a sample): their ratio is"
            f" {max(sizes):.3g}; give bounds that the measurement deserves"
        )
    norms = np.linalg.norm(P, axis=0)
    if np.any(norms == 0):
        raise InputError(f"`parametric`: function number {int(np.argmin(norms))} does not act on any sample; remove it")
    scale = 2.0 ** np.round(np.log2(norms)) if norms.size else norms
    P = P / scale
    parameters = 0 if problem.parametric is None else problem.parametric.size
    _check_independent(problem, P, parameters)
    fixed = np.concatenate([b.bound for b in blocks]) / total
    discs = sum(f.omega.size for f in problem.frequency)
    return Rows(y, E, P, fixed, discs, scale, parameters)


def _check_independent(problem: MixedProblem, P: np.ndarray, parameters: int) -> None:
    if not P.shape[1]:
        return
    stacked = np.vstack([np.real(P), np.imag(P)])
    _, singular, directions = np.linalg.svd(stacked / np.linalg.norm(stacked, axis=0), full_matrices=False)
    rank = int(np.sum(singular > 1e-10 * singular[0])) if singular.size else 0
    if rank < P.shape[1]:
        involved = np.flatnonzero(np.abs(directions[-1][:parameters]) > 0.1)
        names = ", ".join(problem.parametric.labels[i] for i in involved)
        raise InputError(
            f"`parametric`: the data cannot tell its {P.shape[1]} functions (transients included) apart: their rank on the"
            f" samples is {rank}. Linearly dependent: {names}. Remove one of them, or add samples"
        )
