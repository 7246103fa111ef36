"""Refinement of a state space: Levenberg-Marquardt in local coordinates, with the outputs projected out."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robustid.core import StateMatrices
from robustid.mfd.block_model import RESOLVED, BlockModel
from robustid.mfd.iteration import FitStatus, FitStep
from robustid.mfd.problem import FractionProblem

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

_RANK = 1e-12  # columns of the outputs' problem that are this dependent count as one
_RTOL = 1e-10
_TINY = 1e-2  # length of a step in standard deviations of the parameters, all together: slope^2 = length^2/equations
_WINDOW = 6  # so many steps must together lower the criterion by what counts:
_WORTH = 0.3  # by so many standard deviations, or all is within the noise,
_SLOW = 1e-3  # and by this part of it, or a model of another order or start is worth more than further steps
_GOOD, _POOR, _LEAST_GAIN = 0.75, 0.25, 1e-4  # of what the linear model promised
_LONGER, _SHORTER, _FAR_SHORTER = 2.5, 0.5, 0.25
_SHORTEST = 1e-6  # in reaches (`BlockModel.reach`): no step so short lowers the criterion by what counts
_BISECTIONS = 40
_ROUNDS = 4  # of poles that a step would take too near to the stability boundary
_SEEN = 1e-13  # directions that the response sees less than this are not moved along
_CHUNK = 1000  # rows of a QR factorisation that stay in the cache


class Budget(NamedTuple):
    """What a refinement may use, and whom it tells."""

    deadline: float = math.inf  # of `time.monotonic`
    report: Callable[[FitStep], None] | None = None

    @property
    def spent(self) -> bool:
        """True when the time is over."""
        return time.monotonic() > self.deadline


UNLIMITED = Budget()


class Fitted(NamedTuple):
    """A model with its best outputs."""

    model: BlockModel
    states: Complex  # (F, n, nu)
    C: Real
    D: Real
    basis: Real  # (G, rows, columns): orthonormal, what C and D reach
    residual: Real  # (G, rows)
    cost: float

    @property
    def condition(self) -> float:
        """Condition number of the normal matrix of C and D in the basis that they were solved in, measured."""
        used = [Q[:, np.any(Q != 0, axis=0)] for Q in self.basis]
        values = np.concatenate([np.linalg.eigvalsh(Q.T @ Q) for Q in used])
        return float(values.max() / values.min()) if values.size else 1.0

    @property
    def response(self) -> Complex:
        """At the frequency points, (F, ny, nu)."""
        return self.C @ self.states + self.D

    def state_space(self, scale: float) -> StateMatrices:
        """In s or z, from the unit of the nodes."""
        A, B = self.model.matrices()
        return StateMatrices(scale * A, scale * B, self.C, self.D)


class Refined(NamedTuple):
    """End of a refinement."""

    fitted: Fitted
    status: FitStatus
    history: tuple[FitStep, ...]
    bound: bool = False  # poles were held inside by the stability boundary at the end


class Outputs:
    """The best C and D for given states, and the projection that takes them out of a Jacobian.

    Where the weight is one number an entry, every output has a least-squares problem of its own (G = ny); else they
    share one (G = 1).
    """

    def __init__(self, problem: FractionProblem) -> None:
        self.problem = problem
        self.lines, self.ny, self.nu = problem.values.shape
        self.apart = problem.weight.entries_only
        self.alike = self.apart and bool(np.all(problem.weight.entries == problem.weight.entries[:, :1]))
        self.target = self.rows(problem.values[..., None])[..., 0]

    def rows(self, changes: Complex) -> Real:
        """Weighted changes (F, ny, nu, T) of the response, real parts over imaginary ones: (G, rows, T)."""
        if self.apart:
            out = (self.problem.weight.entries[..., None] * changes).transpose(1, 0, 2, 3)
        else:
            out = self.problem.weight.apply_all(changes)[None]
        out = out.reshape(len(out), -1, changes.shape[3])
        return np.concatenate([np.real(out), np.imag(out)], axis=1)

    def design(self, states: Complex) -> Real:
        """Weighted response (G, rows, columns) of every coefficient of [C D], row by row or column by column."""
        rows = states.transpose(0, 2, 1)
        if self.problem.feedthrough:
            rows = np.concatenate([rows, np.broadcast_to(np.eye(self.nu), (self.lines, self.nu, self.nu))], axis=2)
        if self.apart:
            entries = self.problem.weight.entries[:, : 1 if self.alike else self.ny]
            out = entries.transpose(1, 0, 2)[..., None] * rows
        else:
            one = np.broadcast_to(np.eye(self.ny), (self.lines, self.ny, self.ny))
            out = self.problem.weight.linearised(rows, one)[None]
        out = out.reshape(len(out), -1, out.shape[-1])
        return np.concatenate([np.real(out), np.imag(out)], axis=1)

    def fitted(self, model: BlockModel) -> Fitted:
        """The model with its best outputs; of infinite cost where a pole lies on a frequency point."""
        with np.errstate(all="ignore"):
            states = model.states(self.problem.xi)
        C, D = np.zeros((self.ny, model.order)), np.zeros((self.ny, self.nu))
        if not np.all(np.isfinite(states)):
            return Fitted(model, states, C, D, np.zeros((1, 0, 0)), self.target, math.inf)
        design = self.design(states)
        size = np.linalg.norm(design, axis=1)
        size[size == 0] = 1.0
        Q, R = np.linalg.qr(design)
        U, sizes, Vt = np.linalg.svd(R / size[:, None])
        kept = sizes > _RANK * sizes[:, :1]
        seen = Q.transpose(0, 2, 1) @ self.target[..., None]
        inverse = np.where(kept, 1 / np.where(kept, sizes, 1.0), 0.0)
        coefficients = Vt.transpose(0, 2, 1) @ (inverse[..., None] * (U.transpose(0, 2, 1) @ seen))
        coefficients = coefficients[..., 0] / size
        if not np.all(kept):
            Q = Q @ (U * kept[:, None])
            seen = Q.transpose(0, 2, 1) @ self.target[..., None]
        residual = self.target - (Q @ seen)[..., 0]
        matrix = coefficients if self.apart else coefficients.reshape(-1, self.ny).T
        if self.problem.feedthrough:
            D = matrix[:, model.order :]
        return Fitted(model, states, matrix[:, : model.order], D, Q, residual, float(np.sum(residual**2)))

    def directions(self, fitted: Fitted) -> Real:
        """Weighted derivatives of the response in the coordinates of the model, outputs taken out: (rows, T)."""
        changes = self.rows(fitted.model.tangent(self.problem.xi, fitted.states, fitted.C))
        Q = fitted.basis
        changes -= Q @ (Q.transpose(0, 2, 1) @ changes)
        return changes.reshape(-1, changes.shape[2])

    def importance(self, fitted: Fitted) -> Real:
        """How much the criterion rises when a block of two poles is taken away and the outputs are fitted anew, (m,)."""
        inverse = np.linalg.pinv(np.linalg.qr(self.design(fitted.states), mode="r"), rcond=_RANK)
        coefficients = fitted.C if self.apart else fitted.C.T.reshape(1, -1)
        width = 2 if self.apart else 2 * self.ny
        out = np.zeros(fitted.model.centre.size)
        for block in range(out.size):
            here = slice(block * width, (block + 1) * width)
            gram = inverse[:, here] @ inverse[:, here].transpose(0, 2, 1)
            c = coefficients[:, here, None]
            out[block] = float(np.sum(c * np.linalg.solve(gram, c)))
        return out


def refine(
    problem: FractionProblem,
    start: BlockModel,
    *,
    stable: bool,
    limit: int,
    resolved: float = RESOLVED,
    patient: bool = False,
    budget: Budget = UNLIMITED,
) -> Refined:
    """Levenberg-Marquardt from a realisation; every accepted step is the best so far.

    C and D are fitted anew at every trial (variable projection), and the tangent space of what is left is made orthonormal:
    in those coordinates ``J = Q R`` every step is an orthogonal projection. The length of a step is measured in what
    changes the response noticeably, the distance of a pole from the nearest frequency point.

    Parameters
    ----------
    problem : FractionProblem
        Data, weight and feed-through.
    start : BlockModel
    stable : bool
        Keep the poles inside the stability region; those that a step would take out, or nearer to the boundary than the
        data resolve, end on their way (`BlockModel.least_distances`).
    limit : int
        Largest number of steps.
    resolved : float
        Part of the spacing of the frequency points that the damping of a mode has at least, if it began with more.
    patient : bool
        Go on when the last steps together lowered the criterion by less than 0.1 %.
    budget : Budget

    Notes
    -----
    Source: `mckelvey2004` (local coordinates by data), `golub1973` (variable projection), `more1978` (radius of trust).
    """
    descent = _Descent(problem, start, resolved if stable else None, 0.0 if patient else _SLOW, budget)
    status = FitStatus.LIMIT
    try:
        while len(descent.history) < limit:
            ended = descent.advance()
            if ended is not None:
                status = ended
                break
    except KeyboardInterrupt:
        status = FitStatus.INTERRUPTED
    if descent.bound and status in (FitStatus.FLAT, FitStatus.STALLED):
        status = FitStatus.BOUNDARY
    return Refined(descent.best, status, tuple(descent.history), descent.bound)


class _Descent:
    """State of a refinement: the best so far, how far the linear model is trusted, and the history."""

    def __init__(
        self, problem: FractionProblem, start: BlockModel, resolved: float | None, slow: float, budget: Budget
    ) -> None:
        self.problem, self.resolved, self.slow, self.budget = problem, resolved, slow, budget
        self.outputs = Outputs(problem)
        self.best = self.outputs.fitted(start)
        self.radius, self.bound = math.sqrt(problem.order), False
        self.history: list[FitStep] = []
        self.tiny = max(_RTOL, _TINY**2 / problem.equations)
        self.worth = max(_RTOL, _WORTH**2 / problem.equations)

    def advance(self) -> FitStatus | None:
        """One step that lowers the criterion; the status where there is none, or none is worth it."""
        problem, best = self.problem, self.best
        if best.cost <= problem.rounding:
            return FitStatus.EXACT
        R, gradient = _orthonormal(np.column_stack([self.outputs.directions(best), best.residual.ravel()]))
        slope = float(np.linalg.norm(gradient)) / math.sqrt(best.cost)
        if slope**2 <= self.tiny:
            return FitStatus.STATIONARY
        reach = best.model.reach(problem.xi)
        least = None if self.resolved is None else best.model.least_distances(problem.xi, self.resolved)
        promised = math.inf
        while self.radius >= _SHORTEST:
            step, self.bound = _step(R * reach, gradient, self.radius, best.model, reach, least)
            length = float(np.linalg.norm(step))
            promised = float(np.sum(gradient**2) - np.sum((gradient - R @ (reach * step)) ** 2))
            if promised <= self.tiny * best.cost and length < self.radius:
                return FitStatus.FLAT
            trial = self.outputs.fitted(best.model.moved(reach * step, least))
            if self._trusted(trial, promised, length):
                return self._record(trial, min(1.0, length), slope)
            if self.budget.spent:
                return FitStatus.TIME
        return FitStatus.FLAT if promised <= self.worth * best.cost else FitStatus.STALLED

    def _trusted(self, trial: Fitted, promised: float, length: float) -> bool:
        """Tell whether a trial keeps enough of what was promised; the radius follows what it kept."""
        fall = self.best.cost - trial.cost
        gain = fall / max(promised, 1e-300) if math.isfinite(trial.cost) else -1.0
        if gain > _GOOD:
            self.radius = max(self.radius, _LONGER * length)
        elif gain < _POOR:
            self.radius = (_SHORTER if gain > 0 else _FAR_SHORTER) * length
        return gain > _LEAST_GAIN and fall > 0

    def _record(self, trial: Fitted, step: float, slope: float) -> FitStatus | None:
        """Take the trial; the status where the last steps together, or the time, say that it is the last."""
        self.best = trial
        self.history.append(FitStep("lm", trial.cost, trial.condition, step, slope))
        if self.budget.report is not None:
            self.budget.report(self.history[-1])
        fall = self.history[-1 - _WINDOW].cost / trial.cost - 1 if len(self.history) > _WINDOW else math.inf
        if fall <= self.worth:
            return FitStatus.FLAT
        if fall <= self.slow:
            return FitStatus.SLOW
        return FitStatus.TIME if self.budget.spent else None


def _orthonormal(columns: Real) -> tuple[Real, Real]:
    """R (T, T) and Q' r of the columns [J r], by chunks of rows that stay in the cache."""
    T = columns.shape[1]
    while len(columns) > 2 * max(_CHUNK, 2 * T):
        size = max(_CHUNK, 2 * T)
        whole = len(columns) // size * size
        parts = np.asarray(np.linalg.qr(columns[:whole].reshape(-1, size, T), mode="r"))
        columns = np.concatenate([parts.reshape(-1, T), columns[whole:]])
    R = np.asarray(np.linalg.qr(columns, mode="r"))
    R = np.pad(R, ((0, max(T - len(R), 0)), (0, 0)))
    return R[: T - 1, : T - 1], R[: T - 1, T - 1]


def _step(
    R: Real, gradient: Real, radius: float, model: BlockModel, reach: Real, least: Real | None
) -> tuple[Real, bool]:
    """Minimise ``|gradient - R step|`` within the radius; poles that would pass their least distance end on it."""
    step = _bounded(R, gradient, radius)
    if least is None or not least.size:
        return step, False
    normals = model.normals() * reach[: least.size + model.centre.size]
    size = np.linalg.norm(normals, axis=1)
    normals = np.pad(normals / size[:, None], ((0, 0), (0, len(reach) - normals.shape[1])))
    room = np.minimum((model.distances - least) / size, radius)
    held = np.zeros(len(normals), dtype=bool)
    for _ in range(_ROUNDS):
        beyond = ~held & (normals @ step < -room * (1 + 1e-9))
        if not np.any(beyond):
            break
        held |= beyond
        N = normals[held]
        fixed = -room[held] @ N
        step = fixed + _bounded(R - (R @ N.T) @ N, gradient - R @ fixed, radius)
    return step, bool(np.any(held))


def _bounded(R: Real, gradient: Real, radius: float) -> Real:
    """The shortest minimum of ``|gradient - R step|``, or the best step on the radius where that is longer."""
    U, sizes, Vt = np.linalg.svd(R)
    kept = sizes > _SEEN * sizes[:1]
    U, sizes, Vt = U[:, kept], sizes[kept], Vt[kept]
    g = U.T @ gradient
    return Vt.T @ (sizes * g / (sizes**2 + _damping(sizes, g, radius)))


def _damping(sizes: Real, g: Real, radius: float) -> float:
    """The smallest damping with which the step is no longer than the radius."""

    def length(damping: float) -> float:
        return float(np.linalg.norm(sizes * g / (sizes**2 + damping)))

    if length(0.0) <= radius:
        return 0.0
    low, high = 1e-30 * sizes[0] ** 2, float(np.linalg.norm(sizes * g)) / radius
    for _ in range(_BISECTIONS):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if length(middle) > radius else (low, middle)
    return high
