"""Passive models nearest to data: programs over C and D, then steps over all four matrices."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.linalg
import scipy.sparse

from robustid.core import Complex, Real, StateMatrices, input_states
from robustid.data import FrequencyResponse
from robustid.errors import InputError
from robustid.fitting import fit_mfd
from robustid.passivity.least_change import least_change, slopes_of
from robustid.passivity.passive_cuts import changed, cut, linearised, step, triangle
from robustid.passivity.passivity_certificate import BOUNDED
from robustid.passivity.passivity_search import Popov
from robustid.reduction import Parts, gramian_factors

if TYPE_CHECKING:
    import control

STRICT = 1e-9  # relative distance from the limit of what is made passive
Expression = Any  # of cvxpy, which states no types

_INSIDE = 1e-3  # the same of where the refinement starts: at the limit itself it could not move
_HEATS, _STEPS = 10, 100  # steps of every start, and further ones of the best
_MOST = 24  # states of which A and B are moved too: the steps take their square as unknowns
_LITTLE = 1e-4  # relative: inputs that every state gets for its coordinates
_SOLVED = 1e-4  # relative violation that a solver may leave
_FAR = 3.0  # times the largest frequency: poles beyond are tried there too, as fits place them anywhere
_PROGRESS = 1e-3  # relative decrease of a step below which the next one is shorter
_EXACT = 1e-8  # of the data: a fit that is off by less needs no other start
_SAME = 1e-6  # relative distance of poles that ports share
_CUT_STEPS, _PARTS = 5, (1.0, 0.25, 0.06)  # of all matrices by cutting planes, and how far
_REACH, _LEAST_REACH = 0.1, 1e-6  # of a step, relative to the matrices


def like(model: control.StateSpace, A: Real, B: Real, C: Real, D: Real) -> control.StateSpace:
    """A continuous model with the ports of another."""
    import control

    return control.StateSpace(A, B, C, D, 0, inputs=model.input_labels, outputs=model.output_labels)


def response_of(model: control.StateSpace, omega: Real) -> Complex:
    """The response of a continuous model, (F, m, m)."""
    A, B, C, D = StateMatrices.of(model)
    return D + C @ input_states(A, B, 1j * omega)


def radius_of(data: FrequencyResponse) -> Real:
    """The bounds of the entries of data, 1 where there are none; infinite where an entry was not measured."""
    return np.ones(data.values.shape) if data.bound is None else np.asarray(data.bound.outer_radius, dtype=float)


def nearest(model: control.StateSpace, kind: str, data: FrequencyResponse | None) -> list[control.StateSpace]:
    """Passive models with least squares of residuals over bounds, but for what a solver leaves: one of them is the best. They
    are of the same A and B where there are no data, else with all matrices refined.
    """
    if data is None:
        fit = _Fit(model, kind, data)
        found = fit.of_gains(fit.squares)
        return [model if found is None else found]
    fit = _Fit(model, kind, data)
    touched = fit.touched()
    if touched is not None and fit.cost(touched) <= _EXACT * np.linalg.norm(fit.values / fit.radius):
        return [touched]
    top, low = float(np.max(data.omega)), float(np.min(data.omega))
    others = [model, *_nearer(model, _FAR * top), _evenly(model, low, top)]
    starts = [(model, STRICT), *((start, _INSIDE) for start in others)]
    if (fewer := _of_fewer_poles(model, data, top)) is not None:
        found = _raced(fewer, kind, data, [(fewer, STRICT), (fewer, _INSIDE)])
        starts.append((_with_further(found, model.nstates - fewer.nstates, low, top), STRICT))
    found = _raced(model, kind, data, starts)
    return [found] if touched is None else [found, touched]


def _raced(
    model: control.StateSpace, kind: str, data: FrequencyResponse, starts: list[tuple[control.StateSpace, float]]
) -> control.StateSpace:
    """The best of what is refined from several starts, each so far inside; the model itself where nothing passive was found."""
    race: list[tuple[float, _Fit, control.StateSpace]] = []
    for start, inside in starts:
        fit = _Fit(start, kind, data)
        fit.strict = inside
        if (found := fit.of_gains(fit.squares)) is not None and fit.holds(found):
            fit.strict = STRICT
            found = fit.refined(found, _HEATS)
            race.append((fit.cost(found), fit, found))
    if not race:
        return model
    _, fit, found = min(race, key=lambda each: each[0])
    return fit.refined(found, _STEPS)


def _evenly(model: control.StateSpace, low: float, high: float) -> control.StateSpace:
    """A model of the same order with its pole pairs evenly over the band, port after port: where vector fitting starts."""
    n, m = model.nstates, model.ninputs
    pairs = n // 2
    low = max(low, high / 100)
    A, B = np.zeros((n, n)), np.zeros((n, m))
    frequencies = np.linspace(low, high, pairs // m + 1 + (pairs % m > 0))
    damping = (high - low) / max(pairs // m, 1) / 2
    for k in range(pairs):
        w, rows = (frequencies[k // m] + frequencies[k // m + 1]) / 2, slice(2 * k, 2 * k + 2)
        A[rows, rows] = [[-damping, w], [-w, -damping]]
        B[2 * k, k % m] = np.sqrt(damping)
    if n % 2:
        A[-1, -1], B[-1] = -high, np.sqrt(high)
    return like(model, A, B, np.zeros((m, n)), model.D)


def _nearer(model: control.StateSpace, reach: float) -> list[control.StateSpace]:
    """The model with poles beyond `reach`, in rad/s, at that distance instead; none where there are none."""
    A, B, C, D = StateMatrices.of(model)
    poles, vectors = np.linalg.eig(A) if len(A) else (np.zeros(0), A)
    far = np.abs(poles) > reach
    if not np.any(far):
        return []
    poles = np.where(far, poles * reach / np.maximum(np.abs(poles), reach), poles)
    try:
        moved = np.asarray(np.real(vectors * poles @ np.linalg.inv(vectors)), dtype=float)
    except np.linalg.LinAlgError:
        return []
    return [like(model, moved, B, C, D)] if np.all(np.linalg.eigvals(moved).real < 0) else []


def _of_fewer_poles(model: control.StateSpace, data: FrequencyResponse, top: float) -> control.StateSpace | None:
    """A fit of two poles fewer (of every port, where all have them), where the model has poles beyond the band; else None.
    Poles that a fit puts there for little may stand in the way of passivity; those in the band don't.
    """
    poles, ports = np.asarray(model.poles()), model.ninputs
    apart = np.abs(poles[:, None] - poles) <= _SAME * np.abs(poles)
    shared = ports > 1 and bool(np.all(apart.sum(axis=1) >= ports))
    order = len(poles) // ports - 2 if shared else len(poles) - 2
    if order < 1 or np.abs(poles).max() <= top:
        return None
    radius = radius_of(data)
    weight, form = np.where(np.isfinite(radius), 1 / radius, 0.0), "shared" if shared else None
    try:
        fit = fit_mfd(data, order=order, form=form, feedthrough=True, weight=weight)
    except (InputError, np.linalg.LinAlgError):
        return None
    found = fit.model
    return like(model, found.A, found.B, found.C, found.D)


def _with_further(model: control.StateSpace, count: int, low: float, high: float) -> control.StateSpace:
    """The model with further states, broad pairs of poles in the middle of the band, which nothing sees yet."""
    A, B, C, D = StateMatrices.of(model)
    w, m = (low + high) / 2, B.shape[1]
    drive, poles = np.zeros((count, m)), -w * np.eye(count)
    for k in range(0, count - 1, 2):
        poles[k : k + 2, k : k + 2] = [[-(high - low) / 2, w], [-w, -(high - low) / 2]]
    for k in range(count):
        drive[k, (k // 2) % m] = np.sqrt(w)
    return like(
        model,
        np.asarray(scipy.linalg.block_diag(A, poles), dtype=float),
        np.vstack([B, drive]),
        np.hstack([C, np.zeros((len(C), count))]),
        D,
    )


def smallest_ratio(model: control.StateSpace, kind: str, data: FrequencyResponse) -> control.StateSpace:
    """The passive model of the same A and B with the smallest largest ratio of residual to bound."""
    fit = _Fit(model, kind, data)
    found = fit.of_gains(fit.largest)
    return model if found is None else found


class _Fit:
    """Programs over passive models: the inequality in its three-block form, linear in the matrices of the model or in P."""

    def __init__(self, model: control.StateSpace, kind: str, data: FrequencyResponse | None) -> None:
        self.model, self.data, self.bounded = model, data, kind == BOUNDED
        self.kind, self.popov = kind, Popov(kind, StateMatrices.of(model))
        self.omega = self._between() if data is None else data.omega
        self.values = response_of(model, self.omega) if data is None else data.values
        self.radius = np.ones(self.values.shape) if data is None else radius_of(data)
        self.values: Complex = np.where(np.isfinite(self.radius), self.values, 0)
        self.size = 1.0 if self.bounded else float(np.max(np.abs(self.values))) or 1.0
        self.ports, self.strict = self.values.shape[1], STRICT
        self._slopes: scipy.sparse.csc_matrix | None = None

    def _between(self) -> Real:
        marks = self.popov.marks
        return np.unique(np.concatenate([marks, (marks[1:] + marks[:-1]) / 2, 10 * marks[-1:], 100 * marks[-1:]]))

    def of_gains(self, cost: Callable[[Expression, Complex], Expression]) -> control.StateSpace | None:
        """The passive model of least cost with the A and B of the model; None where the solver fails."""
        cp = solver()
        A, B, *_ = self._input_normal()
        n, m = B.shape
        gains = cp.Variable((m, n + m))
        P = cp.Variable((n, n), symmetric=True) if n else np.zeros((0, 0))
        block = self._inequality(cp.bmat, A.T @ P + P @ A, P @ B, gains[:, :n], gains[:, n:])
        try:
            with warnings.catch_warnings():  # its word is not taken anyway
                warnings.simplefilter("ignore", UserWarning)
                cp.Problem(cp.Minimize(cost(gains, self._basis(A, B))), [block << 0]).solve(solver=cp.CLARABEL)
        except cp.error.SolverError:
            return None
        if gains.value is None or not np.all(np.isfinite(gains.value)):
            return None
        found = np.asarray(gains.value, dtype=float)
        return self._model(StateMatrices(A, B, found[:, :n], found[:, n:]))

    def touched(self) -> control.StateSpace | None:
        """The nearest passive model, where the model is passive but for little: of C and D, then of all matrices; else None."""
        model = self.of_cuts()
        if model is None or model.nstates > _MOST:
            return model
        cost = self.cost(model)
        for _ in range(_CUT_STEPS):
            found = next((trial for trial in self._stepped(model) if self.cost(trial) < cost), None)
            if found is None:
                break
            model, before, cost = found, cost, self.cost(found)
            if cost > before * (1 - _PROGRESS):
                break
        return model

    def of_cuts(self) -> control.StateSpace | None:
        """The model with the nearest passive C and D, where it is passive but for little; else None."""
        A, B, *_ = self._input_normal()
        found = cut(self.model, self.kind, self.omega, self._triangles(self._basis(A, B)), (A, B)) if len(A) else None
        return None if found is None else self._model(found)

    def _stepped(self, model: control.StateSpace) -> Iterator[control.StateSpace]:
        """Passive models after shorter and shorter steps of all matrices; what is then beyond the limit is taken from C and D."""
        fit = _Fit(model, self.kind, self.data)
        system = fit._input_normal()
        change = step(system, fit.popov, fit.omega, fit.values - response_of(model, fit.omega), 1 / fit.radius)
        if change is None:
            return
        for part in _PARTS:
            trial = fit._model(changed(system, change, part))
            other = _Fit(trial, self.kind, self.data)
            if other.popov.peak()[0] > other.popov.limit:
                trial = other.of_cuts()
            if trial is not None:
                yield trial

    def _basis(self, A: Real, B: Real) -> Complex:
        """Responses that C and D multiply, (F, n + m, m)."""
        m = B.shape[1]
        ones = np.broadcast_to(np.eye(m, dtype=complex), (self.omega.size, m, m))
        return np.concatenate([self._states(A, B), ones], axis=1)

    def _triangles(self, basis: Complex) -> list[Real]:
        """Small problems of the squares of every row of C and D."""
        triangles: list[Real] = []
        for i in range(self.ports):
            weight = 1 / self.radius[:, i]
            regressors = (basis * weight[:, None]).transpose(0, 2, 1).reshape(-1, basis.shape[1])
            triangles.append(triangle(regressors, np.asarray(self.values[:, i] * weight, dtype=complex).ravel()))
        return triangles

    def _input_normal(self) -> StateMatrices:
        """The model in coordinates with a controllability Gramian of about the identity: bounded real P are at most that."""
        A, B, C, D = self.popov.system
        if not len(A):
            return self.popov.system
        wide = np.hstack([B, _LITTLE * np.linalg.norm(B) * np.eye(len(A))])
        root = gramian_factors(Parts(A, wide, C), discrete=False)[1]
        a, b = (np.asarray(np.linalg.solve(root, part), dtype=float) for part in (A @ root, B))
        return StateMatrices(a, b, C @ root, D)

    def holds(self, model: control.StateSpace) -> bool:
        """Say whether a model is passive, but for what a solver leaves."""
        popov = Popov(self.kind, StateMatrices.of(model))
        return popov.peak()[0] <= popov.limit + _SOLVED * self.size

    def squares(self, gains: Expression, basis: Complex) -> Expression:
        """Root of the sum of squared residuals over bounds, relative to that of the best gains without a limit."""
        cp = solver()
        triangles = self._triangles(basis)
        scale = _scale(triangles)
        return cp.norm(cp.hstack([(t[:, :-1] @ gains[i] - t[:, -1]) / scale for i, t in enumerate(triangles)]))

    def largest(self, gains: Expression, basis: Complex) -> Expression:
        """The largest ratio of residual to bound."""
        cp = solver()
        worst: list[Expression] = []
        for i in range(self.ports):
            for j in range(self.ports):
                weight = 1 / self.radius[:, i, j]
                regressors, wanted = basis[:, :, j] * weight[:, None], self.values[:, i, j] * weight
                parts = [part(regressors) @ gains[i] - part(wanted) for part in (np.real, np.imag)]
                worst.append(cp.max(cp.norm(cp.vstack(parts), axis=0)))
        return cp.max(cp.hstack(worst))

    def refined(self, model: control.StateSpace, steps: int) -> control.StateSpace:
        """The model after steps over all matrices: each a program in coordinates where P = I proves it, so that it stays
        passive, and where the inequality is linear in A, B, C and D. The residuals are linearised, within a reach that follows
        from how well the last steps did.
        """
        if not 0 < model.nstates <= _MOST:
            return model
        cost, system, reach = self.cost(model), self._dissipative(model), _REACH
        for _ in range(steps):
            if system is None or reach < _LEAST_REACH:
                break
            change = self._step(system, reach)
            if change is None:
                reach /= 4
                continue
            trial = self._model(changed(system, change))
            found = self.cost(trial)
            if found < cost:
                reach *= 2 if found < cost * (1 - _PROGRESS) else 0.5
                model, cost, system = trial, found, self._dissipative(trial)
            else:
                reach /= 4
        return model

    def cost(self, model: control.StateSpace) -> float:
        """Root of the sum of squared residuals over bounds."""
        return float(np.linalg.norm((self.values - response_of(model, self.omega)) / self.radius))

    def _dissipative(self, model: control.StateSpace) -> StateMatrices | None:
        """The model in time units of `popov` and in coordinates where P = I, between the extreme ones; None where it has none."""
        popov = Popov(self.kind, StateMatrices.of(model))
        root = np.sqrt(popov.unit / self.popov.unit)
        for lift in (0.0, STRICT, 1e-7, 1e-5):
            both = popov.gramians(popov.limit + lift * popov.size)
            if both is None or np.linalg.eigvalsh(both[1])[0] <= 0:
                continue
            P = (both[0] + np.linalg.inv(both[1])) / 2
            if np.linalg.eigvalsh(P)[0] <= 0:
                continue
            L = np.linalg.cholesky((P + P.T) / 2).T
            A, B, C, D = popov.system
            inverse: Real = np.asarray(np.linalg.inv(L), dtype=float)
            return StateMatrices(root**2 * L @ A @ inverse, root * L @ B, root * C @ inverse, D)
        return None

    def _step(self, system: StateMatrices, reach: float) -> StateMatrices | None:
        """The change to the minimum of the linearised residuals among the models that P = I proves passive."""
        n, m = system.B.shape
        residual = self.values - system.D - system.C @ self._states(system.A, system.B)
        rows = linearised(system, self.omega / self.popov.unit, residual, 1 / self.radius)
        whole = np.block([[system.A, system.B], [system.C, system.D]])
        if self._slopes is None:
            self._slopes = slopes_of(lambda unit: self._proved(unit, n), n + m)
        reach *= float(np.linalg.norm(whole))
        found = least_change(rows / _scale([rows]), self._proved(whole, n), self._slopes, reach)
        if found is None:
            return None
        change = found.reshape(n + m, n + m)
        return StateMatrices(change[:n, :n], change[:n, n:], change[n:, :n], change[n:, n:])

    def _states(self, A: Real, B: Real) -> Complex:
        return input_states(A, B, 1j * self.omega / self.popov.unit)

    def _proved(self, whole: Real, n: int) -> Real:
        """The block that is to be negative semidefinite for P = I, of [A, B; C, D]."""
        A, B, C, D = whole[:n, :n], whole[:n, n:], whole[n:, :n], whole[n:, n:]
        return np.asarray(self._inequality(np.block, A + A.T, B, C, D), dtype=float)

    def _inequality(self, stack: Callable[[Any], Any], *parts: Expression) -> Expression:
        """The block that is to be negative semidefinite."""
        (corner, side, C, D), eye = parts, np.eye(self.ports)
        if self.bounded:
            end = -(1 - self.strict) * eye
            rows = [[corner, side, C.T], [side.T, end, D.T], [C, D, end]]
        else:
            rows = [[corner, side - C.T], [side.T - C, 2 * self.strict * self.size * eye - D - D.T]]
        block = stack(rows if side.shape[0] else [row[1:] for row in rows[1:]])
        return (block + block.T) / 2

    def _model(self, system: StateMatrices) -> control.StateSpace:
        root = np.sqrt(self.popov.unit)
        return like(self.model, system.A * root**2, system.B * root, system.C * root, system.D)


def solver() -> ModuleType:
    """Return the module that poses semidefinite programs, imported where it is needed."""
    import cvxpy

    return cvxpy


def _scale(triangles: list[Real]) -> float:
    """The residual that is left without a limit, or what is negligible."""
    least = np.linalg.norm([t[-1, -1] if len(t) == t.shape[1] else 0.0 for t in triangles])
    size = np.linalg.norm([np.linalg.norm(t[:, -1]) for t in triangles])
    return float(max(least, 1e-3 * size)) or 1.0
