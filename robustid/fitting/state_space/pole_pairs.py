"""The poles of a state space two by two: blocks of a pair, and real poles that find no partner."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from robustid.core import Real
from robustid.fitting.modal.modal import modal_parts


class Pair(NamedTuple):
    """A block of two poles."""

    centre: float
    coupling: float
    fall: float
    inputs: Real  # (2, nu)


def poles_in_pairs(A: Real, B: Real, origin: float) -> tuple[list[Pair], Real, Real]:
    """Blocks of two poles; poles without a partner and their inputs. Two real neighbours make a block."""
    pairs: list[Pair] = []
    alone: list[tuple[float, Real]] = []
    if not len(A):
        return pairs, np.zeros(0), np.zeros((0, B.shape[1]))
    parts, rigid, _ = modal_parts(A, origin)
    for number, part in enumerate(parts):
        block, inputs = part.block, np.asarray(part.left @ B, dtype=float)
        if number == 0 and rigid:
            count = int(np.sum(block[np.triu_indices(rigid, 1)] != 0))  # chains of two integrators
            pairs += [Pair(origin, 1.0, 0.0, inputs[[k, count + k]]) for k in range(count)]
            alone += [(origin, row) for row in inputs[2 * count :]]
        elif len(block) == 1:
            alone.append((float(block[0, 0]), inputs[0]))
        elif len(block) == 2 and np.any(block != block[0, 0] * np.eye(2)):
            pairs.append(_cyclic(block, inputs))
        else:
            poles, V = np.linalg.eig(block)
            rows = np.linalg.solve(V.astype(complex), inputs.astype(complex))
            pairs += [
                Pair(pole.real, pole.imag, pole.imag, np.stack([2 * row.real, -2 * row.imag]))
                for pole, row in zip(poles, rows, strict=True)
                if pole.imag > 0
            ]
            alone += [(pole.real, row.real) for pole, row in zip(poles, rows, strict=True) if pole.imag == 0]
    alone.sort(key=lambda item: item[0])
    even = len(alone) // 2 * 2
    single = alone[even:]
    for (low, first), (high, second) in zip(alone[:even:2], alone[1:even:2], strict=True):
        if low == high:  # two modes of one pole: no block of two coordinates holds them
            single += [(low, first), (high, second)]
        else:
            pairs.append(_cyclic(np.diag([low, high]), np.stack([first, second])))
    return pairs, np.array([pole for pole, _ in single]), np.array([row for _, row in single]).reshape(-1, B.shape[1])


def _cyclic(block: Real, inputs: Real) -> Pair:
    """Two poles as ``[[a, s], [-v, a]]``, in the basis (N t/s, t) of N = block - a I for a vector t that N turns most."""
    a = float(np.trace(block)) / 2
    N = block - a * np.eye(2)
    s = math.sqrt(abs(float(np.linalg.det(N)))) or float(np.linalg.norm(N))
    turned = np.array([N[1], -N[0]])  # t' turned t = det [t, N t]
    values, vectors = np.linalg.eigh(turned + turned.T)
    t = vectors[:, np.argmax(np.abs(values))]
    basis = np.stack([N @ t / s, t], axis=1)
    return Pair(a, s, float(np.linalg.det(N)) / s, np.asarray(np.linalg.solve(basis, inputs), dtype=np.float64))
