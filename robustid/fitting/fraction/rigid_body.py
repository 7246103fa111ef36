"""Rigid-body modes asked for by number: where the fit starts, which inputs drive them, the exact realisation."""

from __future__ import annotations

import dataclasses
from typing import cast

import numpy as np
import scipy.linalg

from robustid.core import Frozen, StateMatrices, as_array, as_count, freeze, response_at
from robustid.errors import InputError, InputTypeError
from robustid.fitting.fraction.conditions import RigidModes
from robustid.fitting.fraction.fraction_model import realise
from robustid.fitting.fraction.fraction_problem import FractionProblem
from robustid.fitting.fraction.fraction_steps import into_form
from robustid.fitting.state_space.given_poles import (
    Samples,
    diagonal_blocks,
    fit_inputs,
    fit_outputs,
    reflected,
    solution,
)
from robustid.fitting.state_space.integrator_chains import chain, sorted_schur

_ALTERNATIONS = 20


@dataclasses.dataclass(frozen=True, eq=False)
class RigidBody(Frozen):
    """Undamped rigid-body modes: each is a chain of two integrators, ``C_r B_r / s^2`` (or its samples).

    Parameters
    ----------
    count : int
        Number of modes.
    directions : (count, nu) array, optional
        Rows B_r: how the inputs drive the modes (side "input"; (ny, count), the shapes C_r at the outputs, for side
        "output"); only their span matters. They are held. Default: found from the data and refined with the fit.
    side : {"input", "output"}
        Which directions are constant; "output" needs a left fraction.
    factor : {"outside", "inside"}
        ``N D^{-1} I_RB^{-1} T_u^{-1}``, or ``N I_RB^{-1} D^{-1}`` (directions constant behind the flexible part, a
        restriction that undamped machines do not have; without `directions`).

    Notes
    -----
    With a right fraction N D^{-1}, "outside" is ``B_r D(s) = O(s^2)``, linear in D for given B_r, whatever the flexible
    modes are and whichever inputs they share with the rigid body: no decoupling is needed.

    Source: `voorhoeve2016` section III.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> s = 1j * np.geomspace(1, 100, 200)[:, None, None]
    >>> values = np.array([[1.0, 2.0]]) / s**2 + np.array([[1.0, -1.0]]) / (s**2 + 0.4 * s + 400)
    >>> fit = rid.fit_mfd(rid.FrequencyResponse(np.abs(s.ravel()), values), order=4, rigid_body=rid.RigidBody(1))
    >>> int(np.sum(fit.fraction.poles == 0))
    2
    >>> (fit.rigid_directions / fit.rigid_directions[:, :1]).round(6)
    array([[1., 2.]])
    """

    count: int
    _: dataclasses.KW_ONLY
    directions: np.ndarray | None = None
    side: str = "input"
    factor: str = "outside"

    def __post_init__(self) -> None:
        count = as_count("count", self.count, least=1)
        if self.side not in ("input", "output"):
            raise InputError(f'`side` must be "input" or "output"; got {self.side!r}')
        if self.factor not in ("outside", "inside"):
            raise InputError(f'`factor` must be "outside" or "inside"; got {self.factor!r}')
        directions = self.directions
        if directions is not None:
            if self.factor == "inside":
                raise InputError('`directions` belong to factor "outside"; leave them out or change the factor')
            directions = freeze(as_array("directions", directions, ndim=2))
            axis = 0 if self.side == "input" else 1
            if directions.shape[axis] != count:
                shape = f"({count}, nu)" if axis == 0 else f"(ny, {count})"
                raise InputError(f"`directions` must have shape {shape}; got {directions.shape}")
            if np.linalg.matrix_rank(directions) < count:
                raise InputError("`directions` must be linearly independent: they have a rank below `count`")
        self._set(count=count, directions=directions)

    def check(self, values: np.ndarray, order: int, omega: np.ndarray) -> None:
        """Raise where the data of a right fraction don't allow it: `values` transposed for side "output"."""
        ny, nu = values.shape[1:]
        names = ("inputs", "outputs") if self.side == "input" else ("outputs", "inputs")
        for size, name in ((nu, names[0]), (ny, names[1])):
            if self.count > size:
                raise InputError(
                    f"`rigid_body` asks for {self.count} modes, more than there are {name} ({size}); each needs a"
                    " direction of its own"
                )
        if self.directions is not None and self.directions.size != self.count * nu:
            shape = (self.count, nu) if self.side == "input" else (nu, self.count)
            raise InputError(f"`directions` must have shape {shape} for {nu} {names[0]}; got {self.directions.shape}")
        if 2 * self.count > order:
            raise InputError(f"`order` = {order} has no room for {self.count} rigid-body modes of two states each")
        if np.any(omega == 0):
            raise InputError(
                "`frf` has a frequency point at 0 Hz, where a rigid body has no finite response; leave that point out"
            )


def as_rigid_body(body: object) -> RigidBody | None:
    """The modes that are asked for, also by their number alone."""
    if isinstance(body, int | np.integer) and not isinstance(body, bool):
        count = int(cast("int", body))
        return RigidBody(count) if count else None
    if body is not None and not isinstance(body, RigidBody):
        raise InputTypeError(f"`rigid_body` must be a RigidBody, such as RigidBody(3); got {type(body).__name__}")
    return body


def rigid_start(
    data: Samples, A: np.ndarray, C: np.ndarray, body: RigidBody, *, feedthrough: bool
) -> tuple[StateMatrices, np.ndarray]:
    """A model with exact rigid-body modes, and their directions (count, nu), from an estimate that has them somewhere near: the
    2*count poles nearest to the origin make place for chains of two integrators; free chains at every output show the gains of
    1/s^2, whose row space is what drives the modes; then everything linear is fitted anew.
    """
    origin = 0.0 if data.domain == "s" else 1.0
    count, (ny, nu) = body.count, data.values.shape[1:]
    T, Z = sorted_schur(A, origin, 2 * count)
    flexible = len(A) - 2 * count
    Af, Cf = reflected(T[:flexible, :flexible], data.points, data.domain), (C @ Z)[:, :flexible]
    free = diagonal_blocks(Af, chain(ny, origin))
    gains = fit_inputs(data, free, np.hstack([Cf, np.eye(ny, 2 * ny)]), feedthrough)[0]
    if body.directions is not None:
        directions = body.directions if body.side == "input" else body.directions.T
    else:
        directions = _row_space(gains[flexible + ny :], data, count)
    blocks = diagonal_blocks(Af, chain(count, origin))
    B = np.vstack([gains[:flexible], np.zeros((count, nu)), directions])
    return StateMatrices(blocks, B, *fit_outputs(data, blocks, B, feedthrough)), directions


def _row_space(gains: np.ndarray, data: Samples, count: int) -> np.ndarray:
    """The nearest rows (count, nu) of the low-rank gains of 1/s^2, every entry in its own standard deviation: a cross
    approximation on the most significant entries, then alternating least squares. No scaling of rows and columns would do:
    where a signal is decoupled from the rigid body, its own entry is noise of any size.
    """
    deviation = _deviations(data)
    rest, variance = np.array(gains), deviation**2
    chosen: list[int] = []
    for _ in range(count):
        score = rest**2 / variance
        score[chosen] = 0.0
        i, j = np.unravel_index(np.argmax(score), score.shape)
        chosen.append(int(i))
        a, b = rest[:, j] / rest[i, j], rest[i] / rest[i, j]
        variance = (
            variance
            + np.outer(a**2, variance[i])
            + np.outer(variance[:, j], b**2)
            + np.outer(a**2, b**2) * variance[i, j]
        )
        rest = rest - np.outer(a, rest[i])
        rest[i], rest[:, j] = 0.0, 0.0
    rows, weight = gains[chosen], 1 / deviation
    for _ in range(_ALTERNATIONS):
        left = np.stack([solution((rows * w).T, g * w) for w, g in zip(weight, gains, strict=True)])
        pairs = zip(weight.T, gains.T, strict=True)
        rows = np.stack([solution(left * w[:, None], g * w) for w, g in pairs], axis=1)
    return rows


def _deviations(data: Samples) -> np.ndarray:
    """Standard deviation (ny, nu) of the gains of 1/s^2 that the weights let expect; huge where all is masked."""
    distance = np.abs(data.points - (0.0 if data.domain == "s" else 1.0))
    information = np.einsum("kij,k->ij", data.weight**2, distance**-4.0)
    return 1 / np.sqrt(np.maximum(information, 1e-24 * information.max()))


def pivoted(directions: np.ndarray, sizes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Row-equivalent directions with an identity in the pivot columns; `sizes` of the columns decide on the pivots."""
    order = scipy.linalg.qr(directions * sizes, pivoting=True, mode="r")[1]  # type: ignore[index]
    pivots = np.sort(order[: len(directions)])
    out = np.linalg.solve(directions[:, pivots], directions)
    out[:, pivots] = np.eye(len(pivots))
    return out, pivots


def rigid_modes(
    problem: FractionProblem, data: Samples, model: StateMatrices, directions: np.ndarray, body: RigidBody
) -> FractionProblem:
    """The problem with the modes that were asked for, at directions found from a start that has them."""
    if body.factor == "outside":
        directions, pivots = pivoted(directions, np.linalg.norm(1 / _deviations(data), axis=0))
        free = body.directions is None and body.count < directions.shape[1]
        return dataclasses.replace(problem, rigid=RigidModes(directions, pivots, True, free))
    # D V = O(s^2): V spans the null space of D at the pole, of the fraction that the start makes without conditions.
    plain, nu = realise(problem, into_form(problem, response_at(model, data.points))), problem.values.shape[2]
    null = np.linalg.svd(plain.denominator(np.array([problem.origin]))[0].real)[2][-body.count :]
    directions, pivots = pivoted(null, np.ones(int(nu)))
    return dataclasses.replace(problem, rigid=RigidModes(directions.T, pivots, False, body.count < nu))
