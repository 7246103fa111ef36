"""Words on what a claim over bands is about: their poles, taken as exact or anywhere in a box, and their data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from robustid.core import Real, exponents_of
from robustid.identification import MixedProblem, common_scope


class OverPoles(Protocol):
    """A band, by what it takes its poles to be."""

    @property
    def problem(self) -> MixedProblem:
        """The data and the class."""
        ...

    @property
    def box(self) -> tuple[Real, Real] | None:
        """Intervals of the poles; None: taken as exact."""
        ...


def pole_words(bands: Sequence[OverPoles]) -> str:
    """Words on the poles of the parametric parts: exact ones are said where any band takes them so; empty without such parts."""
    if any(one.box is None and one.problem.parametric is not None for one in bands):
        return ", poles of the parametric part taken as exact"
    boxes = [one.box for one in bands if one.box is not None]
    counts = sorted({in_box(box) for box in boxes})
    if not counts:
        return ""
    beside = any(one.box is not None and real_poles(one.problem) for one in bands)
    others = ", of others taken as exact" if beside or any(in_box(box) < len(box[0]) for box in boxes) else ""
    return f", poles of {' or '.join(map(str, counts))} mode{'s' * (counts[-1] > 1)} anywhere in their box{others}"


def in_box(box: tuple[Real, Real]) -> int:
    """Number of modes whose pole has an interval; that of others is a point."""
    return int(np.sum(np.any([side[:, 1] > side[:, 0] for side in box], axis=0)))


def real_poles(problem: MixedProblem) -> int:
    """Number of real poles of the parametric part beside integrators, which no box holds: each counts once, however often taken."""
    if (basis := problem.parametric) is None:
        return 0
    basis = basis.in_s()
    exponents = exponents_of(basis.poles[basis.poles != 0], basis.dt)
    real = exponents.real[(exponents.imag == 0) & (exponents.real < 0)]
    return np.unique(real).size


def scope_of(bands: Sequence[OverPoles]) -> str:
    """Words that follow a claim over all plants of bands: on their poles, and on their data; each once."""
    return pole_words(bands) + common_scope([one.problem for one in bands])
