"""Starts of a fit: a subspace estimate, a model that was given, poles, or the strongest modes of a richer fit."""

from __future__ import annotations

from typing import Any

import numpy as np

from robustid.core import Budget, StateMatrices, as_array, as_state_space, counted, real_rows, response_at
from robustid.errors import InputError, InputTypeError
from robustid.fitting.fraction.fraction_forms import fitted, states_of_poles
from robustid.fitting.fraction.fraction_iteration import fit_fraction
from robustid.fitting.fraction.fraction_model import FractionModel, realise
from robustid.fitting.fraction.fraction_problem import FractionProblem
from robustid.fitting.fraction.rigid_body import RigidBody
from robustid.fitting.state_space.given_poles import Samples, diagonal_blocks, fit_inputs, fit_outputs
from robustid.fitting.state_space.subspace import subspace_estimate

_SAME_WEIGHT = 30.0  # weights times |P| that differ by less are relative weights but for the antiresonances
_POINTS_PER_OUTPUT = 4  # frequency points for every output that an estimate takes at least
EXTRA = 2  # states that the richer fit has more


def _estimates(problem: FractionProblem, data: Samples, stable: bool, budget: Budget) -> list[StateMatrices]:
    """Subspace estimates with the entries' weights, with those of the noise, and relative, where they are something else: the
    estimate wants the inverse noise, and factors for bands of interest that differ by 1000 ruin it.
    """
    size = np.abs(data.values)
    used = data.weight > 0
    relative = used / np.where(size > 0, size, 1.0)
    weights = [data.weight]
    if data.noise is not None and data.noise is not data.weight:
        weights.append(data.noise)
    ratio = data.weight[used & (size > 0)] * size[used & (size > 0)]
    if np.all(size[used] > 0) and ratio.size and ratio.max() > _SAME_WEIGHT * ratio.min():
        weights.append(relative)
    found: list[StateMatrices] = []
    for weight in weights:
        if not found or not budget.over:
            values, reduced = _few_outputs(data.values, weight)
            one = subspace_estimate(
                values,
                data.points,
                problem.order,
                weight=reduced,
                feedthrough=problem.feedthrough,
                domain=data.domain,
                stable=stable,
                budget=budget,
            )
            outputs = one.C, one.D
            if values is not data.values:
                outputs = fit_outputs(data._replace(weight=weight), one.A, one.B, problem.feedthrough)
            found.append(StateMatrices(one.A, one.B, *outputs))
    return found


def _few_outputs(values: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The strongest combinations of the outputs of one input, where they are too many for the frequency points: an estimate of
    i block rows needs i equations for every output and for the input, and has two for every frequency point; with a quarter as
    many outputs as points there are seven.
    """
    lines, ny, nu = values.shape
    most = max(lines // _POINTS_PER_OUTPUT, 1)
    if nu > 1 or ny <= most:
        return values, weight
    size = np.sqrt(np.mean(weight[:, :, 0] ** 2, axis=0))
    turn = size[:, None] * np.linalg.svd(real_rows(size * values[:, :, 0]), full_matrices=False)[2][:most].T
    with np.errstate(divide="ignore"):  # a combination of which one output has no weight has none
        variance = (1 / weight[:, :, 0]) ** 2 @ turn**2
    return (values[:, :, 0] @ turn)[:, :, None], 1 / np.sqrt(variance)[:, :, None]


def _start_cost(problem: FractionProblem, data: Samples, model: StateMatrices) -> float:
    cost = float(np.linalg.norm(problem.residual(response_at(model, data.points))))
    return cost if np.isfinite(cost) else np.inf


def _check_poles(problem: FractionProblem, poles: np.ndarray) -> None:
    if not poles.size:
        raise InputError("`start` must hold at least one pole")
    if np.any(problem.xi[:, None] == poles / problem.scale):
        raise InputError("`start` has a pole at a frequency point of `frf`, where no response is finite; move it")


def _column(problem: FractionProblem, data: Samples, poles: np.ndarray) -> StateMatrices:
    """The best residues of poles that all entries share, as a state space of one input."""
    _check_poles(problem, poles)
    A, B = states_of_poles(poles)
    return StateMatrices(A, B, *fit_outputs(data, A, B, problem.feedthrough))


def _from_poles(problem: FractionProblem, poles: np.ndarray) -> StateMatrices:
    """The best fraction of a few SK steps from ``D_old = prod (xi - pole) I``, as a state space."""
    _check_poles(problem, poles)
    logarithm = np.sum(np.log(problem.xi[:, None] - poles / problem.scale), axis=1)
    scalar = np.exp(logarithm - logarithm.real.max())  # relative to the largest: a product of 80 poles would underflow
    fit = fit_fraction(problem, denominators=scalar[:, None, None] * np.eye(problem.values.shape[2]), method="sk")
    return realise(problem, fit.fraction).matrices


def first_model(
    problem: FractionProblem,
    data: Samples,
    start: Any,  # a model or poles, not checked yet
    form: str,
    body: RigidBody | None,
    stable: bool,
    budget: Budget,
) -> StateMatrices:
    """The subspace estimate, the model that was given, or what SK makes of poles."""
    if start is None:
        return min(_estimates(problem, data, stable, budget), key=lambda model: _start_cost(problem, data, model))
    import control

    start = as_state_space("start", start)
    if not isinstance(start, control.StateSpace):
        if not isinstance(start, np.ndarray | list | tuple):
            raise InputTypeError(
                f"`start` must be a control.StateSpace or an array of poles; got {type(start).__name__}"
            )
        if body is not None:
            raise InputError("`start` must be a model where a rigid body is asked for; poles don't say what moves it")
        poles = as_array("start", start, dtype=complex, ndim=1)
        return _from_poles(problem, poles) if form != "shared" else _column(problem, data, poles)
    model = StateMatrices.of(start)
    ny, nu = model.D.shape
    if form == "left":
        model = model.transposed()
    if fitted(model.D[None], form).shape[1:] != problem.values.shape[1:]:
        raise InputError(
            f"`start` must have the inputs and outputs of `frf`; got {counted(ny, 'output')} and {counted(nu, 'input')}"
        )
    least = 1 if body is None else 2 * body.count
    order = len(model.A)
    if order < least:
        raise InputError(f"`start` must have at least {least} state{'s' * (least > 1)} for this fit; got {order}")
    if start.isdtime(strict=True) != (problem.dt is not None):
        raise InputError('`start` must be continuous for domain "s" and discrete for domain "z"')
    if form == "shared":
        return _column(problem, data, np.linalg.eigvals(model.A))
    return model


def strongest(found: FractionModel, data: Samples, feedthrough: bool) -> StateMatrices | None:
    """A model with the poles of a fit but the EXTRA weakest, by what each adds to the weighted response; None where those can't
    be taken away without splitting a pair.
    """
    A, B, C, _ = found.matrices
    flexible = len(A) - 2 * found.rigid_count
    poles, V = np.linalg.eig(A[:flexible, :flexible])
    left, right = C[:, :flexible] @ V, np.linalg.solve(V, B[:flexible].astype(complex))
    lines = np.abs(data.points[:, None] - poles) ** -2
    strength = np.sqrt(
        np.einsum("kij,km,im,mj->m", data.weight**2, lines, np.abs(left) ** 2, np.abs(right) ** 2, optimize=True)
    )
    units = [(float(strength[k]), [int(k)]) for k in np.flatnonzero(np.imag(poles) == 0)]
    pairs = [(float(2 * strength[k]), [int(k), _conjugate(poles, int(k))]) for k in np.flatnonzero(np.imag(poles) > 0)]
    reals = sorted(units, key=lambda unit: unit[0])[:EXTRA]
    choices = [(sum(size for size, _ in reals), [k for _, ks in reals for k in ks])] if len(reals) == EXTRA else []
    if pairs:
        choices.append(min(pairs, key=lambda pair: pair[0]))
    if not choices:
        return None
    dropped = min(choices, key=lambda choice: choice[0])[1]
    kept = [k for k in range(flexible) if k not in dropped]
    T, outputs = _real_modal(poles[kept], left[:, kept])
    rest = A[flexible:, flexible:]
    dynamics = diagonal_blocks(T, rest)
    outputs = np.hstack([outputs, C[:, flexible:]])
    inputs, D, _ = fit_inputs(data, dynamics, outputs, feedthrough)
    return StateMatrices(dynamics, inputs, outputs, D)


def _conjugate(poles: np.ndarray, k: int) -> int:
    return int(np.argmin(np.abs(poles - poles[k].conj())))


def _real_modal(poles: np.ndarray, outputs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Real blocks and the outputs that belong to them, for poles that come in pairs."""
    T, C = np.zeros((len(poles), len(poles))), np.zeros(outputs.shape)
    at = 0
    for pole, shape in zip(poles, outputs.T, strict=True):
        if pole.imag == 0:
            T[at, at], C[:, at] = pole.real, shape.real
            at += 1
        elif pole.imag > 0:
            T[at : at + 2, at : at + 2] = [[pole.real, pole.imag], [-pole.imag, pole.real]]
            C[:, at], C[:, at + 1] = shape.real, shape.imag
            at += 2
    return T, C
