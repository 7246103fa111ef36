"""Fits of modal structure: from the free fit's modes, each projected on the structure, refined in it and kept exact."""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np
from numpy.typing import NDArray

from robustid.core import Complex, Real, StateMatrices, response_at
from robustid.fitting.fraction.fit_search import FORMED, FitEnd, formed
from robustid.fitting.fraction.fraction_iteration import FitStatus, FitStep, FractionFit, former
from robustid.fitting.fraction.fraction_model import realise
from robustid.fitting.fraction.fraction_problem import FractionProblem
from robustid.fitting.modal.modal_structure import Modal
from robustid.fitting.modal.mode_gains import gains
from robustid.fitting.state_space.block_model import BlockModel
from robustid.fitting.state_space.given_poles import Samples
from robustid.fitting.state_space.projected_outputs import Criterion, Fitted, LocalModel, Numbers, Outputs
from robustid.fitting.state_space.real_modes import RealModes
from robustid.fitting.state_space.state_descent import (
    Settings,
    blocks_of,
    descended,
    flipped,
    suspicious,
    with_rigid_modes,
)
from robustid.fitting.state_space.state_refinement import Refined, exchange_modes, refine
from robustid.fitting.state_space.withheld_points import STEPS

_FREE = 0.5  # part of the time for the fit without structure
_STEPS = 100  # of the refinement, twice where it ends slowly
_NEAR_NYQUIST = 0.98 * math.pi  # rad/sample: where a mode begins whose poles lie left of the origin


def modal_fit_from(
    problem: FractionProblem, data: Samples, model: StateMatrices, settings: Settings, modal: Modal, given: bool
) -> FitEnd:
    """Fit of this structure from a first model: projected at once if the user gave it in this order, else refined freely first.
    `start` is the projection, and `found` keeps the structure exactly; the fraction is formed of it. The history holds the
    steps of the free descent, too.
    """
    interrupted = False
    history: tuple[FitStep, ...] = ()
    problem, model = with_rigid_modes(problem, data, model, settings.body)
    if not given or len(model.A) != problem.order:
        part = dataclasses.replace(settings, budget=settings.budget.share(_FREE))
        free = descended(problem, data, model, part)
        problem, model, interrupted = free.problem, free.model, free.refined.status is FitStatus.INTERRUPTED
        history = former(free.refined.history, "without structure")
    turned = flipped(problem) and not modal.symmetric
    if turned:
        problem, data, model = problem.transposed(), data.transposed(), model.transposed()
    outputs = TiedOutputs(problem) if modal.symmetric else Outputs(problem)
    start = _start(problem, model, settings.stable, modal, outputs)
    refined = _refined(problem, data, start, settings, modal, outputs, 0 if interrupted else _STEPS)
    refined = refined._replace(history=history + refined.history)
    if interrupted:
        refined = refined._replace(status=FitStatus.INTERRUPTED)
    first, exact = (_realised(end, problem.scale, turned) for end in (outputs.fitted(start), refined.fitted))
    if turned:
        problem, data = problem.transposed(), data.transposed()
    if problem.rigid is not None:
        rigid = dataclasses.replace(problem.rigid, directions=refined.fitted.model.directions)
        problem = dataclasses.replace(problem, rigid=rigid)
    return _formed(problem, data, first, exact, refined, settings)


def _refined(
    problem: FractionProblem,
    data: Samples,
    start: LocalModel,
    settings: Settings,
    modal: Modal,
    outputs: Outputs,
    limit: int,
) -> Refined:
    """End of the descent in this structure."""
    descend = functools.partial(
        refine, problem, stable=settings.stable, budget=settings.budget, report=settings.progress, outputs=outputs
    )
    found = descend(start, limit=limit)
    if limit and settings.rounds and suspicious(problem, found.fitted.response, found.status):
        found = exchange_modes(
            problem,
            data,
            found,
            stable=settings.stable,
            rounds=settings.rounds,
            budget=settings.budget,
            report=settings.progress,
            outputs=outputs,
            structured=functools.partial(_structured, problem, modal),
        )
    if found.status is FitStatus.SLOW and not settings.budget.over:
        more = descend(found.fitted.model, limit=limit, patient=True)
        found = more._replace(history=found.history + more.history)
    return found


def modal_withheld_residual(
    problem: FractionProblem, model: StateMatrices, modal: Modal, mask: NDArray[np.bool_], *, stable: bool
) -> Complex:
    """`withheld_residual` within the structure, from a model that has it."""
    others = dataclasses.replace(
        problem, omega=problem.omega[~mask], values=problem.values[~mask], weight=problem.weight.select(~mask)
    )
    outputs = TiedOutputs(others) if modal.symmetric else Outputs(others)
    start = _start(others, model, stable, modal, outputs)
    found = refine(others, start, stable=stable, limit=STEPS, outputs=outputs).fitted
    return problem.values[mask] - found.C @ found.model.states(problem.xi[mask]) - found.D


def _start(problem: FractionProblem, model: StateMatrices, stable: bool, modal: Modal, outputs: Outputs) -> LocalModel:
    """The modes of a model, projected on the structure."""
    start = _structured(problem, modal, blocks_of(problem, model), problem.values)
    if not stable:
        return start
    inside = start.reflected()
    return min(inside, inside.resolved(problem.xi), key=lambda one: outputs.fitted(one).cost)


def _structured(problem: FractionProblem, modal: Modal, blocks: BlockModel, values: Complex) -> LocalModel:
    """Blocks as modes of this structure: the nearest to what they are in the best model of these values that they allow."""
    if not modal.real and not modal.symmetric:
        return blocks
    C = Outputs(dataclasses.replace(problem, values=values)).fitted(blocks).C
    return _real_modes(problem, modal, blocks, C) if modal.real else _symmetric_blocks(blocks, C, modal.power)


def _symmetric_blocks(blocks: BlockModel, C: Real, power: int) -> BlockModel:
    """Blocks whose input shape is that of the symmetric part of the gain; real poles keep theirs."""
    inputs = blocks.inputs.copy()
    for k, M in enumerate(gains(blocks, C, power)):
        if blocks.fall[k] > 0:
            # M + M' = s u u' up to a phase, which the commutant of the block takes up; its inputs [1, -j/w] B are u.
            shape = np.linalg.svd(M + M.T)[0][:, 0]
            ratio = math.sqrt(blocks.fall[k] / blocks.coupling[k])
            inputs[k] = np.real(shape), -ratio * np.imag(shape)
    return dataclasses.replace(blocks, inputs=inputs).normalised()


def _real_modes(problem: FractionProblem, modal: Modal, blocks: BlockModel, C: Real) -> RealModes:
    """Modes of real shape: of every gain the real part, of that the largest term."""
    swing = np.sqrt((-blocks.coupling * blocks.fall).astype(complex))
    single = blocks.single[: blocks.single.size // 2 * 2].reshape(-1, 2).astype(complex)
    poles = np.concatenate([np.stack([blocks.centre + swing, blocks.centre - swing], axis=1), single])
    discrete = problem.dt is not None
    poles = _in_s(poles) if discrete else poles
    centre, square = poles.mean(axis=1).real, -(((poles[:, 0] - poles[:, 1]) / 2) ** 2).real
    rows, columns = (np.sqrt(np.mean(problem.weight.entrywise**2, axis=axes)) for axes in ((0, 2), (0, 1)))
    inputs = np.empty((centre.size, blocks.inputs.shape[2]))
    inputs[blocks.centre.size :] = blocks.single_inputs[: 2 * len(single) : 2]
    for k, gain in enumerate(gains(blocks, C, modal.power)):
        shape: Real = np.real(gain)
        if blocks.fall[k] <= 0:  # real poles: of the static gain
            A = np.array([[blocks.centre[k], blocks.coupling[k]], [-blocks.fall[k], blocks.centre[k]]])
            states = np.asarray(np.linalg.solve(problem.origin * np.eye(2) - A, blocks.inputs[k]), dtype=float)
            shape = C[:, 2 * k : 2 * k + 2] @ states
        inputs[k] = _largest(shape, rows, columns, modal.symmetric)
    modes = RealModes(centre, square, inputs, blocks.directions, blocks.free, discrete=discrete, power=modal.power)
    return modes.normalised()


def _largest(M: Real, rows: Real, columns: Real, symmetric: bool) -> Real:
    """Input direction of the largest term of a real matrix, in units of the weights; of its symmetric part."""
    if symmetric:
        values, vectors = np.linalg.eigh(M + M.T)
        return vectors[:, np.argmax(np.abs(values))]
    return np.linalg.svd(rows[:, None] * M * columns)[2][0] / columns


def _in_s(poles: Complex) -> Complex:
    """Pairs (m, 2) of poles in z as those of samples, in rad/sample; real ones left of the origin as a mode near Nyquist."""
    logarithm = np.log(np.where(poles == 0, 1e-300, poles).astype(complex))
    real = poles.imag == 0
    left = np.any(real & (poles.real <= 0), axis=1)
    decay = np.maximum(np.real(logarithm).mean(axis=1, keepdims=True), -math.pi)
    return np.where(left[:, None], decay + 1j * _NEAR_NYQUIST * np.array([1.0, -1.0]), logarithm)


def _realised(fitted: Fitted, scale: float, turned: bool) -> StateMatrices:
    """State space in s or z with the structure exact; of the transposed response where that was not turned."""
    if not turned:
        return fitted.state_space(scale)
    if not isinstance(fitted.model, RealModes):
        A, B, C, D = fitted.state_space(scale).transposed()
        swapped = np.arange(len(A))  # the states of a block change places: [[a, s], [-v, a]] again
        paired = 2 * fitted.model.centre.size
        swapped[:paired] = swapped[:paired].reshape(-1, 2)[:, ::-1].ravel()
        return StateMatrices(A[np.ix_(swapped, swapped)], B[swapped], C[:, swapped], D)
    none = np.zeros((0, len(fitted.C)))
    model = dataclasses.replace(fitted.model, inputs=fitted.C.T, directions=none, free=none.astype(bool))
    return fitted._replace(model=model, C=fitted.model.inputs.T, D=fitted.D.T).state_space(scale)


def _formed(
    problem: FractionProblem,
    data: Samples,
    first: StateMatrices,
    exact: StateMatrices,
    refined: Refined,
    settings: Settings,
) -> FitEnd:
    """The fit from a first model to an exact one, with the fraction of that beside it."""
    start, response = (response_at(model, data.points) for model in (first, exact))
    cost = float(np.linalg.norm(problem.residual(response))) ** 2
    problem, nodes = formed(problem, data, exact, max((1 + FORMED) * cost, problem.rounding))
    found = realise(problem, nodes, form=settings.form)
    size = np.linalg.norm(response, axis=(1, 2))
    error = np.linalg.norm(nodes.response - response, axis=(1, 2)) / np.maximum(size, 1e-12 * size.max())
    found = dataclasses.replace(found, rigid=exact, error=float(error.max()))
    fit = FractionFit(problem, nodes, cost, refined.status, refined.history)
    return FitEnd(fit, found, start, 0, np.nan, True)


class TiedOutputs(Outputs):
    """`Outputs` of reciprocal systems, ``P = P'``: what drives a mode is also how it shows. C combines the matrices that the
    model names (`tied_outputs`), one or two for every mode in the place of one or two for every mode and output; D is
    symmetric. Moving the inputs moves C, whose derivative is the transpose.
    """

    def __init__(self, problem: FractionProblem | Criterion) -> None:
        super().__init__(problem)
        self.apart = self.alike = False
        self.target = self.rows([block.values[..., None] for block in self.criterion.blocks])[..., 0]

    def design(self, model: LocalModel, states: Complex) -> Real:
        """Weighted response (1, rows, columns) of every coefficient: of C first, then of D."""
        changes: Numbers = np.einsum("tok,fku->fout", model.tied_outputs(), states, optimize=True)
        if self.criterion.feedthrough:
            through = symmetric_matrices(self.ny).transpose(1, 2, 0)
            through = np.broadcast_to(through, (*changes.shape[:3], through.shape[2]))
            changes = np.concatenate([changes, through], axis=3)
        return self.rows([changes])

    def matrix(self, model: LocalModel, coefficients: Real) -> Real:
        """[C D] of the coefficients (1, columns) that `design` belongs to."""
        ties = model.tied_outputs()
        C = np.tensordot(coefficients[0, : len(ties)], ties, axes=1)
        if not self.criterion.feedthrough:
            return C
        return np.hstack([C, np.tensordot(coefficients[0, len(ties) :], symmetric_matrices(self.ny), axes=1)])

    def changes(self, fitted: Fitted) -> Real:
        """Weighted derivatives (1, rows, T) of the response in the coordinates of the model, the ties kept."""
        xi, model = self.criterion.xi, fitted.model
        tangent = model.tangent(xi, fitted.states, fitted.C)
        return self.rows([model.tied_changes(fitted.states, fitted.C, tangent)])

    def by_blocks(self, fitted: Fitted) -> tuple[Real, int]:
        """Coefficients (1, columns), and how many belong to a block of poles."""
        seen = fitted.basis.transpose(0, 2, 1) @ self.target[..., None]
        return (fitted.inverse @ seen)[..., 0], fitted.model.width


def symmetric_matrices(size: int) -> Real:
    """A basis (T, size, size) of the symmetric matrices."""
    pairs = [(i, j) for i in range(size) for j in range(i + 1)]
    out = np.zeros((len(pairs), size, size))
    for gain, (i, j) in zip(out, pairs, strict=True):
        gain[i, j] = gain[j, i] = 1.0
    return out
