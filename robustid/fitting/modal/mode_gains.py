"""Gains of modes: what stands over ``s^2 + 2 zeta omega s + omega^2``, and its derivatives in the coordinates of a model."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robustid.core import Complex, Real, StateMatrices
from robustid.fitting.state_space.block_model import BlockModel, with_transposes
from robustid.fitting.state_space.projected_outputs import LocalModel
from robustid.fitting.state_space.real_modes import RealModes, mode_gains

_DIFFERENCE = 1e-6  # of central differences, in units of a block's coupling


def gains(model: LocalModel, C: Real, power: int) -> Complex:
    """Matrices (m, ny, nu) of rank one for outputs C, in the unit of the nodes: ``c_k b_k'`` of real modes; of blocks the
    residue over that of a real mode, as ``(xi - A)^{-1}`` of a block has the residue ``[1; jw] [1, -j/w]/2`` at the upper pole,
    w = sqrt(v/s). They are nan for real poles of blocks.
    """
    if isinstance(model, RealModes):
        return (C[:, : model.centre.size].T[:, :, None] * model.inputs[:, None]).astype(np.complex128)
    with np.errstate(invalid="ignore", divide="ignore"):
        shapes, drives = _shapes(model, C)
        return shapes[:, :, None] * drives[:, None, :] / (2 * _functions(model, power))[:, None, None]


def gain_changes(model: LocalModel, C: Real, power: int, *, tied: bool) -> Complex:
    """Their derivatives (m, ny, nu, T) in the coordinates of `tangent`, with C tied to the inputs or held."""
    with np.errstate(invalid="ignore", divide="ignore"):
        out = _of_real_modes(model, C) if isinstance(model, RealModes) else _of_blocks(model, C, power)
    if not tied:
        return out
    out = with_transposes(out, model.pole_coordinates)
    if isinstance(model, BlockModel):
        m, moved = model.centre.size, np.zeros(C.shape)
        moved[:, 0 : 2 * m : 2] = model.tied_falls(C).T
        out[np.arange(m), ..., m + np.arange(m)] += gains(model, moved, power)
    return out


def blocks_in(model: StateMatrices, directions: Real, free: NDArray[np.bool_], *, discrete: bool) -> BlockModel:
    """The blocks that a state space in the unit of the nodes was made of (`BlockModel.matrices`)."""
    flexible = len(model.A) - 2 * len(directions)
    paired = 2 * np.count_nonzero(np.diag(model.A[:flexible, :flexible], 1))
    blocks = np.array([model.A[k : k + 2, k : k + 2] for k in range(0, paired, 2)]).reshape(-1, 2, 2)
    return BlockModel(
        blocks[:, 0, 0],
        blocks[:, 0, 1],
        -blocks[:, 1, 0],
        model.B[:paired].reshape(-1, 2, model.B.shape[1]),
        np.diag(model.A)[paired:flexible],
        model.B[paired:flexible],
        directions,
        free,
        discrete,
    )


def real_modes_in(
    model: StateMatrices, directions: Real, free: NDArray[np.bool_], *, discrete: bool, power: int
) -> RealModes:
    """The modes that a state space in the unit of the nodes was made of (`RealModes.realised`)."""
    count = (len(model.A) - 2 * len(directions)) // 2
    blocks = np.array([model.A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] for k in range(count)]).reshape(-1, 2, 2)
    swing = np.sqrt((blocks[:, 0, 1] * blocks[:, 1, 0]).astype(complex))
    poles = np.stack([blocks[:, 0, 0] + swing, blocks[:, 0, 0] - swing], axis=1)
    decays = np.log(poles) if discrete else poles
    square = -(((decays[:, 0] - decays[:, 1]) / 2) ** 2).real
    inputs = model.B[1 : 2 * count : 2]
    return RealModes(decays.mean(axis=1).real, square, inputs, directions, free, discrete=discrete, power=power)


def _of_real_modes(model: RealModes, C: Real) -> Complex:
    """Changes of the gains ``c_k b_k'`` of real modes: by the directions alone."""
    m, nu = model.inputs.shape
    first = model.pole_coordinates
    out = np.zeros((m, len(C), nu, first + m * (nu - 1) + int(model.free.sum())), dtype=np.complex128)
    for k, moves in enumerate(model.input_moves()):
        at = first + k * (nu - 1)
        out[k, ..., at : at + nu - 1] = C[:, k, None, None] * moves
    return out


def _of_blocks(model: BlockModel, C: Real, power: int) -> Complex:
    """Changes of the gains of blocks: by poles, which turn the shapes, and by inputs."""
    m, nu = model.centre.size, model.inputs.shape[2]
    pair_moves, single_moves = model.input_moves()
    first, per_block = model.pole_coordinates, 2 * nu - 2
    rest = single_moves.shape[0] * single_moves.shape[2] + int(model.free.sum())
    out = np.zeros((m, len(C), nu, first + m * per_block + rest), dtype=np.complex128)
    (shapes, drives), ratio, slopes = _shapes(model, C), _ratio(model), _function_slopes(model, power)
    turn = 1 / (2 * ratio * model.coupling)  # of the ratio, by v
    for k in range(m):
        gain = np.outer(shapes[k], drives[k])
        shape, drive = 1j * turn[k] * C[:, 2 * k + 1], 1j * turn[k] / ratio[k] ** 2 * model.inputs[k, 1]
        out[k, ..., k] = -slopes[0, k] * gain
        out[k, ..., m + k] = np.outer(shape, drives[k]) + np.outer(shapes[k], drive) - slopes[1, k] * gain
        at, moves = first + k * per_block, pair_moves[k, 0] - 1j / ratio[k] * pair_moves[k, 1]
        out[k, ..., at : at + per_block] = shapes[k, :, None, None] * moves
    return out / (2 * _functions(model, power))[:, None, None, None]


def _ratio(model: BlockModel) -> Real:
    """Numbers w = sqrt(v/s) of the complex pairs, (m,); nan for real poles."""
    return np.sqrt(np.where(model.fall > 0, model.fall, np.nan) / model.coupling)


def _shapes(model: BlockModel, C: Real) -> tuple[Complex, Complex]:
    """Shapes (m, ny) and drives (m, nu) at the upper poles: ``C [1; jw]`` and ``[1, -j/w] B``."""
    m, ratio = model.centre.size, 1j * _ratio(model)[:, None]
    return C[:, 0 : 2 * m : 2].T + ratio * C[:, 1 : 2 * m : 2].T, model.inputs[:, 0] + model.inputs[:, 1] / ratio


def _functions(model: BlockModel, power: int, by_centre: Real | float = 0.0, by_fall: Real | float = 0.0) -> Complex:
    """Residues (m,) of real modes of these poles, moved."""
    fall = model.fall + by_fall
    swing = np.sqrt(np.where(fall > 0, model.coupling * fall, np.nan))
    poles = (model.centre + by_centre + 1j * swing).astype(np.complex128)
    return mode_gains(np.log(poles) if model.discrete else poles, model.discrete, power)


def _function_slopes(model: BlockModel, power: int) -> Complex:
    """Relative slopes (2, m) of these by centre and v, by central differences."""
    h = _DIFFERENCE * model.coupling
    moved = [_functions(model, power, *move) for move in ((h, 0.0), (-h, 0.0), (0.0, h), (0.0, -h))]
    return np.stack([moved[0] - moved[1], moved[2] - moved[3]]) / (2 * h * _functions(model, power))
