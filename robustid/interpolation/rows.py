"""The measurements as linear equations in the unknowns, in units of their bounds."""

from __future__ import annotations

import dataclasses

import numpy as np
import scipy.linalg

from robustid._arrays import Frozen, freeze
from robustid.bases import InputNormalPair, Sections
from robustid.data import FrequencyResponse, TimeRecord
from robustid.data.ellipses import tilted
from robustid.errors import InputError, SizeError
from robustid.interpolation.columns import DenseColumns, ShiftColumns
from robustid.interpolation.prior import Prior
from robustid.interpolation.problem import MixedProblem, excited_lines


@dataclasses.dataclass(frozen=True, eq=False)
class Rows(Frozen):
    """Residuals e = y - E x - P p of all samples, each divided by its bound: sample k is kept if |e_k| <= 1.

    Where a bound is an ellipse, e stands for e + kappa conj(e), in its y, E and P alike: linear in the real unknowns.
    Complex samples come first. Imaginary parts of real samples are zero throughout, so that one formula serves both. A system
    with the coefficients x has the residuals e - d with |d_k| <= tail_k: what its other coefficients can do.

    Attributes
    ----------
    y : (N,) complex array
    E : columns (N, n)
        Of the coefficients x of G/K in the orthonormal basis.
    P : (N, m) complex array
        Of the parameters, then of the free transients; columns scaled by powers of two (`column_scale`).
    fixed : (N,) array
        Part of each (unit) bound that does not grow with K; below 1 only where an unknown past input widens it.
    tail : (N,) array
        Zero where n coefficients determine the samples (the exact form).
    discs : int
        Number of complex samples.
    ends : (m, 2) array
        Lower and upper end of every scaled parameter, known beforehand; -inf and inf where it is free.
    """

    y: np.ndarray
    E: DenseColumns | ShiftColumns
    P: np.ndarray
    fixed: np.ndarray
    tail: np.ndarray
    discs: int
    column_scale: np.ndarray
    parameters: int
    ends: np.ndarray

    def __post_init__(self) -> None:
        self._set(**{n: freeze(getattr(self, n)) for n in ("y", "P", "fixed", "tail", "column_scale", "ends")})

    @property
    def held(self) -> np.ndarray:
        """Which parameters have an interval, (m,) bool."""
        return np.isfinite(self.ends[:, 0])

    def within(self, p: np.ndarray) -> bool:
        """Whether every scaled parameter is in its interval."""
        return bool(np.all((self.ends[:, 0] <= p) & (p <= self.ends[:, 1])))

    def real(self, a: np.ndarray) -> np.ndarray:
        """Real rows of an array of complex ones: real parts of all samples, then imaginary parts of the discs."""
        return np.concatenate([np.real(a), np.imag(a[: self.discs])])

    def ratio(self, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Upper bound of |residual|/bound of every sample, for every system with coefficients x and scaled parameters p."""
        return np.abs(self.y - self.E @ x - self.P @ p) + self.tail


@dataclasses.dataclass
class _Block:
    """Rows of one experiment before scaling; `widen` is what an unknown past input adds to the bound.

    E is left empty for lines whose columns are generated.
    """

    y: np.ndarray
    E: np.ndarray
    P: np.ndarray
    bound: np.ndarray
    widen: np.ndarray
    free: np.ndarray
    tail: np.ndarray


@dataclasses.dataclass(frozen=True)
class _Exact:
    """The functions of an input-normal pair whose nodes are those of the data: no tails."""

    problem: MixedProblem
    pair: InputNormalPair

    def lines(self, angles: np.ndarray) -> np.ndarray:
        """Values at exp(j angle), (F, n)."""
        problem = self.problem
        prior, at = problem.prior, problem.node_index(angles)
        return prior.gain_bound * self.pair.evaluate(np.exp(-1j * problem.angles[at]) / prior.decay_rate)

    def filtered(self, u: np.ndarray) -> np.ndarray:
        """Responses to the input, (T, n)."""
        prior, times = self.problem.prior, np.arange(u.size)[:, None]
        return _filtered(u, prior.gain_bound * prior.decay_rate**-times * self.pair.taylor(u.size))

    def line_tail(self, angles: np.ndarray) -> np.ndarray:
        return np.zeros(angles.size)

    def time_tail(self, u: np.ndarray) -> np.ndarray:
        return np.zeros(u.size)


@dataclasses.dataclass(frozen=True)
class _Taylor:
    """The first L delays; the coefficients beyond do what is bounded by the tails."""

    problem: MixedProblem
    length: int

    @property
    def decay(self) -> np.ndarray:
        """rho^-j, (L,)."""
        return self.problem.prior.decay_rate ** -np.arange(self.length, dtype=float)

    def lines(self, angles: np.ndarray) -> np.ndarray:
        """Values at exp(j angle), (F, L)."""
        return self.problem.prior.gain_bound * self.decay * np.exp(-1j * np.outer(angles, np.arange(self.length)))

    def filtered(self, u: np.ndarray) -> np.ndarray:
        """Responses to the input, (T, L): the input, delayed."""
        delayed = scipy.linalg.toeplitz(u, np.zeros(min(self.length, u.size)))
        padded = np.zeros((u.size, self.length))
        padded[:, : delayed.shape[1]] = delayed
        return self.problem.prior.gain_bound * self.decay * padded

    def line_tail(self, angles: np.ndarray) -> np.ndarray:
        """Largest value of the rest on the unit circle: K rho^-L (2/pi) K(1/rho), K the complete elliptic integral."""
        return np.full(angles.size, taylor_tail(self.problem.prior, self.length))

    def time_tail(self, u: np.ndarray) -> np.ndarray:
        """K (sum_{j >= L} u_{n-j}^2 rho^-2j)^(1/2), since the scaled coefficients have norm 1, (count,)."""
        prior, L = self.problem.prior, self.length
        energy = np.zeros(u.size)
        if u.size > L:
            weights = prior.decay_rate ** (-2.0 * np.arange(L, u.size))
            energy[L:] = np.convolve(u**2, weights)[: u.size - L]
        return prior.gain_bound * np.sqrt(energy)


@dataclasses.dataclass(frozen=True)
class _Repeated:
    """The functions of a repeated section; the rest is theta times a function that is bounded by the tails."""

    problem: MixedProblem
    sections: Sections

    def lines(self, angles: np.ndarray) -> np.ndarray:
        """Values at exp(j angle), (F, n)."""
        prior = self.problem.prior
        if angles.size * self.sections.order > MOST_STORED:
            raise SizeError(
                f"`problem` has {self.sections.order} coefficients in the form of sections and {angles.size} frequency lines; their"
                f' product may be up to {MOST_STORED:.2g}. Use form="taylor", or thin the data: frf.select(slice(None, None, step))'
            )
        return prior.gain_bound * self.sections.evaluate(np.exp(-1j * angles) / prior.decay_rate)

    def line_tail(self, angles: np.ndarray) -> np.ndarray:
        """K |theta(zeta)| (2/pi) K(1/rho) at zeta = exp(-j angle)/rho, by Cauchy's formula on the circle, (F,).

        With what rounding can do to theta, and to the values of a function of norm 1 (||phi|| <= (1 - |zeta|^2)^(-1/2)).
        """
        prior, sections, eps = self.problem.prior, self.sections, np.finfo(float).eps
        inside = (1 - 1 / prior.decay_rate) * (1 + 1 / prior.decay_rate)  # 1 - |zeta|^2
        size = np.abs(sections.all_pass(np.exp(-1j * angles) / prior.decay_rate)) + 8 * sections.degree * eps / inside
        rounding = 8 * (sections.order + 1 / inside) * eps / np.sqrt(inside)
        return taylor_tail(prior, 0) * size**sections.repeats + prior.gain_bound * rounding

    def filtered(self, u: np.ndarray) -> np.ndarray:
        """Responses to the input, (T, n)."""
        return self._states(u)[0] @ (self.problem.prior.gain_bound * self.sections.pair.symmetry())

    def time_tail(self, u: np.ndarray) -> np.ndarray:
        """K (sum_j v_(n-j)^2 rho^-2j)^(1/2), v the response of theta(z/rho) to u, (T,).

        Sample n is an inner product with h_n = sum_j u_(n-j) rho^-j zeta^j; P_+(conj(theta) h_n) has the coefficients
        v_(n-j) rho^-j. No digits cancel: [A B; c d] is orthogonal, and what its rounding adds is bounded along the way.
        """
        import scipy.signal

        prior, n = self.problem.prior, self.sections.order
        _, v = self._states(u)
        slow, fast = [1.0, -1 / prior.decay_rate], [1.0, -(prior.decay_rate**-2.0)]
        energy, size = (np.sqrt(scipy.signal.lfilter([1.0], fast, a**2)) for a in (v, u))
        rounding = 2 * (n + 3) ** 1.5 * np.finfo(float).eps * scipy.signal.lfilter([1.0], slow, size)
        return prior.gain_bound * (energy + rounding)

    def _states(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of theta(z/rho) driven by u: states (T, n) after, and outputs (T,) at, every sample."""
        pair, rho = self.sections.pair, self.problem.prior.decay_rate
        states, outputs, state = np.empty((u.size, pair.order)), np.empty(u.size), np.zeros(pair.order)
        for k, push in enumerate(u):
            outputs[k] = pair.c[0] @ state / rho + pair.d[0, 0] * push
            states[k] = state = pair.A @ state / rho + pair.B[:, 0] * push
        return states, outputs


_Functions = _Exact | _Taylor | _Repeated

MOST_STORED = 4e7  # complex entries of the columns of all lines: 0.6 GB, of which the solver holds a few copies


def taylor_tail(prior: Prior, length: int) -> float:
    """Largest value on the unit circle of what a member of the ball has beyond its first L Taylor coefficients.

    tau_L = K rho^-L (2/pi) K(1/rho), K(k) the complete elliptic integral of modulus k: Cauchy's formula on |z| = rho.
    """
    import scipy.special

    rho = prior.decay_rate
    return prior.gain_bound * rho ** -float(length) * 2 / np.pi * float(scipy.special.ellipk(rho**-2))


def measurement_rows(problem: MixedProblem, basis: InputNormalPair | Sections) -> Rows:
    """All samples of the problem as `Rows`: in the basis of a pair (the exact form), or of a repeated section."""
    functions = _functions(problem, basis)
    blocks = [_in_discs(_frequency_block(problem, f, functions), f) for f in problem.frequency]
    for record in problem.time:
        block = _periodic_block if record.initial == "periodic" else _time_block
        blocks.append(block(problem, record, functions))
    return _assemble(problem, blocks, functions)


def line_tails(problem: MixedProblem, sections: Sections, angles: np.ndarray) -> np.ndarray:
    """Largest value at exp(j angle) of what a member of the ball has beyond the coefficients of a repeated section, (F,)."""
    return _functions(problem, sections).line_tail(angles)


def _functions(problem: MixedProblem, basis: InputNormalPair | Sections) -> _Functions:
    if isinstance(basis, InputNormalPair):
        return _Exact(problem, basis)
    return _Taylor(problem, basis.repeats) if basis.is_shift else _Repeated(problem, basis)


def _frequency_block(problem: MixedProblem, frf: FrequencyResponse, functions: _Functions) -> _Block:
    angles = frf.omega * problem.dt
    none = np.zeros((angles.size, 0))
    P = none if problem.parametric is None else problem.parametric.response(angles)
    bound, zero = frf.bound[:, 0, 0], np.zeros(angles.size)
    E = none if isinstance(functions, _Taylor) else functions.lines(angles)
    return _Block(frf.values[:, 0, 0], E, P, bound, zero, none, functions.line_tail(angles))


def _in_discs(block: _Block, frf: FrequencyResponse) -> _Block:
    """The lines with their ellipses turned into discs; columns that are generated follow in `_columns`."""
    if frf.tilt is None:
        return block
    tilt = frf.tilt[:, 0, 0]
    y, E, P = (tilted(a, tilt) for a in (block.y, block.E, block.P))
    return dataclasses.replace(block, y=y, E=E, P=P, tail=block.tail * (1 + np.abs(tilt)))


def _time_block(problem: MixedProblem, record: TimeRecord, functions: _Functions) -> _Block:
    used = np.flatnonzero(np.isfinite(record.bound[:, 0]))
    count = int(used[-1]) + 1
    u, basis = record.u[:count, 0], problem.parametric
    P = _filtered(u, basis.impulse(count))[used] if basis is not None else np.zeros((used.size, 0))
    free, widen = initial_state(problem, record, used)
    E, tail = functions.filtered(u)[used], functions.time_tail(u)[used]
    return _Block(record.y[used, 0], E, P, record.bound[used, 0], widen, free, tail)


def _filtered(u: np.ndarray, impulse: np.ndarray) -> np.ndarray:
    """Responses to u of systems with these impulse responses (T, m), from rest."""
    if u.size <= _SHORT:
        return scipy.linalg.toeplitz(u, np.zeros(u.size)) @ impulse
    return scipy.linalg.matmul_toeplitz((u, np.zeros(u.size)), impulse)


_SHORT = 1000  # above, by FFT: a matrix of all delays takes too much memory


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


def _periodic_block(problem: MixedProblem, record: TimeRecord, functions: _Functions) -> _Block:
    samples = record.u.shape[0]
    used = np.flatnonzero(np.isfinite(record.bound[:, 0]))
    lines = excited_lines(record)
    angles = 2 * np.pi * lines / samples
    weight = np.where((lines == 0) | (2 * lines == samples), 1.0, 2.0) * np.fft.rfft(record.u[:, 0])[lines] / samples
    wave = weight * np.exp(1j * (2 * np.pi / samples) * (np.outer(used, lines) % samples))
    E, tail = (wave @ functions.lines(angles)).real, np.abs(wave) @ functions.line_tail(angles)
    none = np.zeros((used.size, 0))
    P = none if problem.parametric is None else (wave @ problem.parametric.response(angles)).real
    return _Block(record.y[used, 0], E, P, record.bound[used, 0], np.zeros(used.size), none, tail)


def _assemble(problem: MixedProblem, blocks: list[_Block], functions: _Functions) -> Rows:
    total = np.concatenate([b.bound + b.widen for b in blocks])
    free = np.asarray(scipy.linalg.block_diag(*(b.free for b in blocks)))
    P = np.hstack([np.vstack([b.P for b in blocks]), free]) / total[:, None]
    discs = sum(f.omega.size for f in problem.frequency)
    E = _columns(problem, blocks, functions, total, discs)
    y = np.concatenate([b.y for b in blocks]) / total
    sizes = [float(np.abs(a).max(initial=0.0)) for a in (P, y)] + [E.norm]
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
    fixed, tail = (np.concatenate(parts) / total for parts in zip(*((b.bound, b.tail) for b in blocks), strict=True))
    ends = np.tile([-np.inf, np.inf], (P.shape[1], 1))
    if problem.parameter_bounds is not None:
        ends[:parameters] = problem.parameter_bounds * scale[:parameters, None]
    _check_independent(problem, P, np.flatnonzero(np.isinf(ends).any(axis=1)))
    return Rows(y, E, P, fixed, tail, discs, scale, parameters, ends)


def _columns(
    problem: MixedProblem, blocks: list[_Block], functions: _Functions, total: np.ndarray, discs: int
) -> DenseColumns | ShiftColumns:
    if not isinstance(functions, _Taylor):
        return DenseColumns(np.vstack([b.E for b in blocks]) / total[:, None])
    angles = np.concatenate([np.zeros(0), *(f.omega * problem.dt for f in problem.frequency)])
    real = [b.E for b in blocks[len(problem.frequency) :]]
    stacked = np.vstack([np.zeros((0, functions.length)), *real]) / total[discs:, None]
    return ShiftColumns(angles, problem.prior.gain_bound / total[:discs], functions.decay, stacked, line_tilts(problem))


def line_tilts(problem: MixedProblem) -> np.ndarray | None:
    """The kappa of all frequency lines, 0 where the bound is a disc; None where all are."""
    if all(f.tilt is None for f in problem.frequency):
        return None
    return np.concatenate([np.zeros(f.omega.size) if f.tilt is None else f.tilt[:, 0, 0] for f in problem.frequency])


def _check_independent(problem: MixedProblem, P: np.ndarray, free: np.ndarray) -> None:
    """Coefficients without an interval must be told apart by the data: else they, and the sets, are unbounded."""
    P = P[:, free]
    if not P.shape[1]:
        return
    stacked = np.vstack([np.real(P), np.imag(P)])
    _, singular, directions = np.linalg.svd(stacked / np.linalg.norm(stacked, axis=0), full_matrices=False)
    rank = int(np.sum(singular > 1e-10 * singular[0])) if singular.size else 0
    if rank < P.shape[1]:
        labels: list[str] = [] if problem.parametric is None else list(problem.parametric.labels)
        involved = free[np.abs(directions[-1]) > 0.1]
        names = ", ".join(labels[i] for i in involved if i < len(labels))
        raise InputError(
            f"`parametric`: the data cannot tell its {P.shape[1]} functions (transients included) apart: their rank on the"
            f" samples is {rank}. Linearly dependent: {names}. Remove one of them, or add samples"
        )
