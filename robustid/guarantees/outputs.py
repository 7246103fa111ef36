"""Output samples over a horizon as linear functionals of the consistent systems, what follows it, and known inputs, checked."""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robustid.core import Frozen, Real, as_array, as_count, freeze, simulate, threads_for
from robustid.data import signal_index
from robustid.errors import InputError
from robustid.guarantees.consistent_set import ConsistentSet, Extreme, consistent_set
from robustid.guarantees.value_set import SupportClaim
from robustid.identification import Functional, Identification, MixedProblem, SupportCertificate
from robustid.identification.formulation import formulate_over
from robustid.identification.solver import analytic_center

if TYPE_CHECKING:
    import control

_ACCURACY = 1e-2  # of a Taylor form: its tails are a tenth of this part of every bound
_BLOCKS = 60  # of at least half the size of the one before: what follows them is below rounding
_LONGEST = 2**17  # samples in which a state must halve; slower ones are as good as undamped
_ALLOWED = 1e-9  # for the rounding of the powers
SIGNALS = ("impulse", "step")
_MOST = 60  # samples of a default tube
_FADED = 1e-2  # of the gain bound: where the class lets the non-parametric part end, for a default horizon
_LONGEST_HORIZON = 500


@dataclasses.dataclass(frozen=True, eq=False)
class Outputs(Frozen):
    """Response to a known input with zero initial conditions: y_k = sum_j f_j u_(k-j) over a consistent set."""

    consistent: ConsistentSet
    u: Real  # (T,); several inputs (T, nu)

    def __post_init__(self) -> None:
        self._set(u=freeze(self.u))

    @functools.cached_property
    def _impulses(self) -> tuple[Real, Real]:
        """Weights of the coefficients in g_j, and of the parameters in the parametric f_j, of one entry: (T, n) and (T, m).

        But for the weight of the class, which filters the input (`_inside`).
        """
        posed, count = self.consistent.posed, len(self.u)
        basis = posed.problem.parametric
        return posed.impulses(count), np.zeros((count, 0)) if basis is None else basis.impulse(count)

    @functools.cached_property
    def _inside(self) -> Real:
        """The input as functions of the ball see it: filtered by the weight of the class."""
        return self.consistent.posed.problem.weighting.filtered(self.u)

    def functional(self, sample: int, sign: float = 1.0, output: int = 0) -> Functional:
        """+-y_k of an output.

        A row of a function of the unit ball has norm 1 at most in H2: what the basis misses of the functional's representative
        sum_j K u_(k-j) rho^-j zeta^j is the most that the other coefficients can do.
        """
        posed, rows = self.consistent.posed, self.consistent.data.rows
        prior, entries = posed.problem.prior, posed.problem.entries
        delayed, inside = (u.reshape(len(u), entries.inputs)[sample::-1] for u in (self.u, self._inside))
        g, impulse = (weights[: sample + 1] for weights in self._impulses)
        x, p = np.zeros((entries.count, g.shape[1])), np.zeros(rows.P.shape[1])
        scales = prior.scales(entries.outputs, entries.inputs)[output]
        energy = seen = 0.0
        for one, seen_by_g, scale, input in zip(
            delayed.T, inside.T, scales.tolist(), range(entries.inputs), strict=True
        ):
            number, part = entries.place(output, input)
            w = scale * (seen_by_g @ g)
            x[number] += part * w
            own = slice(number * impulse.shape[1], (number + 1) * impulse.shape[1])
            p[own] += part * (one @ (impulse / rows.column_scale[own]))
            whole = scale * prior.gain_bound * np.abs(seen_by_g) * prior.decay_rate ** -np.arange(sample + 1.0)
            energy, seen = energy + float(whole @ whole), seen + float(w @ w)
        tail = 0.0
        if sample >= self.determined:
            tail = float(np.sqrt(max(0.0, energy - seen) + 8 * (sample + 8) * np.finfo(float).eps * energy))
        return Functional(sign * x.ravel(), sign * p, tail)

    @property
    def determined(self) -> int:
        """Number of Taylor coefficients that the basis determines: its zeros at the origin."""
        return self.consistent.posed.determined

    def extreme(self, sample: int, sign: float, gap: float, output: int = 0) -> Extreme:
        """The largest value of +-y_k of an output over the set."""
        with threads_for(self.consistent.data.sarason.pair.order):
            return self.consistent.extreme(self.functional(sample, sign, output), gap)

    def supports(
        self, sample: int, sign: float, value: float, certificate: SupportCertificate, output: int = 0
    ) -> bool:
        """Return whether a certificate, evaluated anew, proves that +-y_k of an output is at most `value`."""
        data = self.consistent.data
        functional = self.functional(sample, sign, output)
        return SupportClaim(f"sample {sample}", functional, value, certificate, data.rows, data.sarason).verify()


def consistent_outputs(identification: Identification, u: Real) -> Outputs:
    """The responses to u of all consistent systems; raises for data that are not consistent.

    Posed so that the coefficients determine the first T Taylor coefficients, T the length of u: the exact form with T delays, or T
    Taylor coefficients at least. Where both are too large the form of the identification bounds the remainder by a tail.
    """
    own = consistent_set(identification)
    if len(u) <= Outputs(own, u).determined:
        return Outputs(own, u)
    posed = formulate_over(identification.problem, len(u), _ACCURACY)
    if posed is None:
        return Outputs(own, u)
    with threads_for(posed.data.sarason.pair.order):
        # Tails take from the bounds: a set that is thinner has an outer neighbour in its place, whose bounds hold all the more.
        level = max(own.level, identification.margin + 3 * float(posed.data.rows.tail.max()))
        return Outputs(ConsistentSet(posed, analytic_center(posed.data, level), level), u)


def output_errors(
    identification: Identification, u: Real, model: control.StateSpace, samples: Sequence[int], gap: float
) -> tuple[Real, Real]:
    """Largest |y_k - that of a model| of every output at some samples under a known input (T, nu): attained and proved, (k, ny)."""
    outputs, nominal = consistent_outputs(identification, u), simulate(model, u)[0][list(samples)]
    lower, upper = np.zeros(nominal.shape), np.zeros(nominal.shape)
    for row, output, sign in itertools.product(range(len(samples)), range(nominal.shape[1]), (-1.0, 1.0)):
        found, own = outputs.extreme(samples[row], sign, gap, output), sign * nominal[row, output]
        lower[row, output] = max(lower[row, output], found.attained - own)
        upper[row, output] = max(upper[row, output], found.upper - own)
    return lower, upper


def tail_bounds(A: Real, B: Real, C: Real, start: int) -> tuple[Real, Real]:
    """Sum and maximum of |C A^(k-1) B| over k >= start (start >= 1), for every row of C; inf where the states do not decay.

    Blocks of N samples, ||A^N|| <= 1/2, are summed as they are; what follows the last one, with the state x, is at most
    sum_(j<N) ||C A^j|| ||x|| (1 + 1/2 + 1/4 + ...).
    """
    count, n = len(C), C.shape[1]
    if not n or not count:
        return np.zeros(count), np.zeros(count)
    rows: Real = C[None]
    power = A
    while np.linalg.norm(power, 2) > 0.5:
        if rows.shape[0] >= _LONGEST:
            return np.full(count, np.inf), np.full(count, np.inf)
        rows, power = np.concatenate([rows, rows @ power]), power @ power
    x = np.linalg.matrix_power(A, start - 1) @ B[:, 0]
    total, largest = np.zeros(count), np.zeros(count)
    for _ in range(_BLOCKS):
        block = np.abs(rows @ x)
        total, largest = total + block.sum(axis=0), np.maximum(largest, block.max(axis=0))
        x = power @ x
    sizes = np.linalg.norm(rows, axis=2)
    left = float(np.linalg.norm(x))
    spread = float(np.linalg.norm(B)) * sizes
    total = total + 2 * left * sizes.sum(axis=0) + _ALLOWED * spread.sum(axis=0)
    return total, np.maximum(largest, left * sizes.max(axis=0)) + _ALLOWED * spread.max(axis=0)


def as_entry(entry: Sequence[int | str] | None, problem: MixedProblem) -> tuple[int, int]:
    """The output and input of a tube, checked."""
    if entry is None:
        if problem.entries.single:
            return 0, 0
        raise InputError(
            "`entry` is missing: a tube is about one output and one input, the others being 0; give entry=(output, input),"
            f" by number or name, of {[s.name for s in problem.outputs]} and {[s.name for s in problem.inputs]}"
        )
    if not isinstance(entry, tuple | list) or len(entry) != 2:
        raise InputError(f"`entry` must be (output, input), by number or name; got {entry!r}")
    output, input = entry
    return signal_index("output", output, problem.outputs), signal_index("input", input, problem.inputs)


def driven(u: Real, entry: tuple[int, int], identification: Identification) -> Real:
    """The input of an entry, and zeros for the others, (H, nu)."""
    out = np.zeros((u.size, identification.problem.entries.inputs))
    out[:, entry[1]] = u
    return out


def as_signal(value: str | ArrayLike, horizon: int | None, identification: Identification) -> tuple[str, Real]:
    """Kind of the input and its samples over the horizon, checked."""
    problem = identification.problem
    count = None if horizon is None else as_count("horizon", horizon, least=1)
    if isinstance(value, str):
        if value not in SIGNALS:
            raise InputError(f"`input` must be one of {SIGNALS} or an array of samples; got {value!r}")
        faded = int(np.ceil(np.log(1 / _FADED) / np.log(problem.prior.decay_rate)))
        count = count or max(problem.taylor, min(faded, _LONGEST_HORIZON))
        return value, np.eye(1, count)[0] if value == "impulse" else np.ones(count)
    u = as_array("input", value)
    if u.ndim != 1 or u.size == 0:
        raise InputError(f"`input` must have shape (H,), one input over the horizon; got {u.shape}")
    if count is not None and count > u.size:
        raise InputError(f"`horizon` must not exceed the {u.size} samples of `input`; got {count}")
    return "given", u[:count]


def as_samples(times: ArrayLike | None, horizon: int, dt: float) -> NDArray[np.intp]:
    """Numbers of the samples, checked and sorted."""
    if times is None:
        return np.unique(np.round(np.linspace(0, horizon - 1, min(horizon, _MOST))).astype(int))
    wanted = np.unique(np.atleast_1d(as_array("times", times)))
    if wanted.ndim != 1 or wanted.size == 0:
        raise InputError("`times` is empty; give at least one sample instant in s")
    samples = np.round(wanted / dt).astype(int)
    bad = (np.abs(wanted / dt - samples) > 1e-6 * np.maximum(1, samples)) | (samples < 0) | (samples >= horizon)
    if np.any(bad):
        raise InputError(
            f"`times` must be sample instants of the horizon, 0 to {(horizon - 1) * dt:g} s in steps of dt = {dt:g} s;"
            f" got {wanted[bad][0]:g}"
        )
    return np.unique(samples)
