"""The modes of a parametric part with matrix residues."""

from __future__ import annotations

import dataclasses

import numpy as np
import scipy.linalg

from robustid.bases import ParametricBasis
from robustid.core import Frozen, freeze

_SAME_POLE = 1e-9
_DEFECTIVE = 1e-6  # of the eigenvectors of both sides: rounding splits those of a Jordan block, and leaves them nearly orthogonal


@dataclasses.dataclass(frozen=True, eq=False)
class Mode(Frozen):
    """One pole pair (or real pole) of the parametric part: R/(z - a) + conj(R)/(z - conj(a)), of a simple pole.

    Attributes
    ----------
    omega : float, rad/s
        Natural frequency |log a|/dt.
    damping : float
        Damping ratio.
    residue : (ny, nu) complex array
        R.
    rank_ratio : float
        Second singular value of R over the first: 0 where R has rank one, as that of a single mode of a structure has.
    """

    omega: float
    damping: float
    residue: np.ndarray
    rank_ratio: float

    def __post_init__(self) -> None:
        self._set(residue=freeze(self.residue))


def modes_of(basis: ParametricBasis, residues: np.ndarray) -> tuple[Mode, ...]:
    """The modes of sum_i P_i R_i, residues (m, ny, nu), by frequency; those of repeated poles are left out."""
    values, *vectors = scipy.linalg.eig(basis.A, left=True)
    left, right = (np.asarray(side) for side in vectors)
    overlap = np.sum(left.conj() * right, axis=0)
    near = np.abs(values[:, None] - values) <= _SAME_POLE
    found = []
    for k, pole in enumerate(values):
        if np.sum(near[k]) > 1 or np.abs(overlap[k]) < _DEFECTIVE or np.imag(pole) < 0 or pole == 0:
            continue
        weights = (basis.C @ right[:, k]) * (left[:, k].conj() @ basis.B[:, 0]) / overlap[k]
        R = np.tensordot(weights, residues, 1)
        log = np.log(pole) / basis.dt
        singular = np.linalg.svd(R, compute_uv=False)
        ratio = float(singular[1] / singular[0]) if singular.size > 1 and singular[0] > 0 else 0.0
        damping = float(-log.real / abs(log)) if log != 0 else 0.0
        found.append(Mode(float(abs(log)), damping, R, ratio))
    return tuple(sorted(found, key=lambda mode: mode.omega))
