"""The modes of a parametric part with several channels, as a table."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from robustid.identification import Identification
from robustid.report.facts import transfer
from robustid.report.style import number


class ModeRow(NamedTuple):
    """A mode of the parametric part with several channels, as text."""

    hz: str
    damping: str
    peak: str
    largest: str
    rank_ratio: str


def mode_rows(identification: Identification) -> list[ModeRow]:
    """The modes of the parametric part and their residue matrices; none of one channel, whose coefficients say it all."""
    problem, rows = identification.problem, []
    for mode in () if problem.entries.single else identification.modes:
        size = np.abs(mode.residue)
        i, j = np.unravel_index(int(np.argmax(size)), size.shape)
        with np.errstate(divide="ignore"):  # an integrator
            peak = np.linalg.norm(mode.residue, 2) / -np.expm1(-mode.omega * mode.damping * problem.dt)
        ratio = number(mode.rank_ratio, 2) if min(size.shape) > 1 else "–"
        rows.append(
            ModeRow(
                number(mode.omega / (2 * np.pi), 5),
                number(mode.damping, 3),
                number(float(peak), 3),
                transfer(identification, int(i), int(j)),
                ratio,
            )
        )
    return rows


RANKS = (
    "A mode adds R/(z − a) and its conjugate to the response, R its residue matrix. Peak: σmax(R)/(1 − |a|), about the height of"
    " its resonance. Rank ratio: the second singular value of R over the first; near 0 where the mode has one shape, as that of"
    " a structure has, larger where two modes share the poles, or where the data leave it open."
)
