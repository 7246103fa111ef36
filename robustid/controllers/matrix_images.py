r"""Values of matrices of plants that sets of R make: balls where these are finite, quotients where they may be infinite.

With :math:`P = P_0 + A \Delta (I - M \Delta)^{-1} B` and :math:`V = A^{-1}`

.. math:: P = (V - \Delta M V)^{-1} (V P_0 + \Delta (B - M V P_0)),

so that with a controller C, and a = 1 for S and T or 0 for the bandwidth,

.. math:: (V - \Delta M V)(a I + P C) = V (a I + P_0 C) + \Delta \left((B - M V P_0) C - a M V\right) .

The first factor is that of S itself at the controller that ran, where what Delta multiplies is 0.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from robustid.controllers.discs import Discs
from robustid.core import Complex, Real, norms
from robustid.guarantees import norm_of_bounds

_NEAR = 0.5  # of the least singular value of the plant: balls that are smaller know all directions
_LITTLE = 1e-9  # of the bounds of the largest input: smaller ones are as good as none


class Quotients(NamedTuple):
    """Plants about that of the model, (F, ...): P_0, A, B and M, bounds of the entries of Delta, and the controller that ran."""

    value: Complex
    left: Complex
    right: Complex
    inner: Complex
    bound: Real
    running: Complex

    @property
    def in_open_loop(self) -> bool:
        """True of plants that were measured without a controller."""
        return not np.any(self.inner)


def discs_of_matrices(omega: Real, plants: Quotients, ball: Real, factor: Real) -> Discs:
    """Balls of matrices; quotients where a ball holds plants that are infinite, or wide ones where these say more of S.

    `ball`: radii in the loop (F,). `factor`: of the bounds (F,), as they are there.
    """
    one, bound = plants.value.shape[1] == 1, plants.bound * factor[:, None, None]
    if one:
        reach, units = factor, plants.bound[:, 0]
    else:
        units = np.linalg.norm(plants.bound, axis=1)  # every input in the unit of its own bounds
        units = np.maximum(units, _LITTLE * units.max(axis=1, keepdims=True) + np.finfo(float).tiny)
        with np.errstate(invalid="ignore"):  # where nothing is known
            reach = norm_of_bounds(bound / units[:, None])
    if plants.in_open_loop:
        return Discs.of(omega, plants.value, reach, units, entries=one)
    finite = np.where(np.isfinite(ball), ball, 0.0)
    found = Discs.of(omega, plants.value, finite, np.ones((omega.size, plants.value.shape[2])))
    under = np.linalg.inv(plants.left)
    across = plants.inner @ under
    errors = Discs.of(omega, plants.value, reach, units, entries=one).adds
    top = plants.right - across @ plants.value
    quotients = found._replace(under=under, adds=errors @ top[:, None], shifts=-errors @ across[:, None])
    L = np.eye(plants.value.shape[1]) + plants.value @ plants.running
    of_ball = np.linalg.svd(L, compute_uv=False)[:, -1] - finite * norms(plants.running)
    of_quotient = np.linalg.svd(under @ L, compute_uv=False)[:, -1] / quotients.quotients[0]
    near = finite < _NEAR * np.linalg.svd(plants.value, compute_uv=False)[:, -1]
    far = ~np.isfinite(ball) | (~near & (of_quotient > of_ball))
    terms = errors.shape[1] - 1
    padded = [np.pad(part, ((0, 0), (0, terms), (0, 0), (0, 0))) for part in (found.adds, found.shifts)]
    return found._replace(
        radius=np.where(far, 0.0, finite),
        around=np.where(far, 0.0, finite),
        outside=far,
        under=np.where(far[:, None, None], under, found.under),
        adds=np.where(far[:, None, None, None], quotients.adds, padded[0]),
        shifts=np.where(far[:, None, None, None], quotients.shifts, padded[1]),
    )
