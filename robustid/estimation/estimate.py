"""Findings of a method in the records, and the bound for all spectral lines and entries at once that follows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from robustid.data import Bound, Caveat, joint_radius, stacked, variances
from robustid.errors import InputError
from robustid.estimation.pooling import pool, pooled_words
from robustid.estimation.scatter import Changing

ABOUT = {"mean": "confidence", "next record": "tolerance"}


class Estimate(NamedTuple):
    """Result of a method from the records, before any bound."""

    index: np.ndarray  # type: ignore[assignment] # (F,) spectral line of the transform
    step: float  # distance of the lines of the transform, rad/s
    values: np.ndarray  # (F, ny, nu)
    covariance: np.ndarray  # (F, ny nu, ny nu) of the values about the mean response
    dof: np.ndarray | float  # of every line, (F,), or of all
    coherence: np.ndarray | None  # (F, ny)
    rounding: np.ndarray  # (F, ny, nu) floor of the bound
    source: str  # what the scatter was taken over
    excitations: int  # independent ones
    changing: Changing | None = None  # what changes from record to record; None: not seen
    noise: np.ndarray | None = None  # (F, ny, nu) standard deviations
    distortion: np.ndarray | None = None
    changed: np.ndarray | None = None  # what halves that differ add; None: they do not
    doubt: np.ndarray | None = None  # (F, ny, nu) what modes that may be of the noise would add
    driven: np.ndarray | None = None  # (F,) lines that the excitation drives; None: all
    real: np.ndarray | None = None  # (F,) lines at which everything is real
    caveats: tuple[Caveat, ...] = ()
    modes: tuple[tuple[float, float, float, float], ...] = ()  # per sample: see `FrequencyResponse`


def pooled(estimate: Estimate) -> Estimate:
    """The estimate with its covariance shared among neighbouring spectral lines where few residuals leave it hardly known."""
    shared = pool(
        estimate.covariance, float(np.min(estimate.dof)), np.abs(stacked(estimate.values)), estimate.index, None
    )
    return estimate._replace(
        covariance=shared.matrix, dof=shared.dof, source=f"{estimate.source}{pooled_words(shared.lines)}"
    )


def bound(estimate: Estimate, probability: float, about: str) -> Bound:
    """The bound that holds for all lines and entries at once: of the mean response, or of that in the next record."""
    variance, dof = variances(estimate.covariance, estimate.values.shape), estimate.dof
    if about == "next record":
        if estimate.changing is None:
            raise InputError(
                '`about` = "next record": one excitation does not show what changes from record to record. Give records of'
                ' several realisations of a periodic excitation (method="periodic"), or leave spectral lines in its band'
                " unexcited"
            )
        variance, dof = variance + estimate.changing.variance, estimate.changing.dof
    dof = np.broadcast_to(dof, estimate.index.shape)
    real = np.zeros(dof.shape, bool) if estimate.real is None else estimate.real
    radius = joint_radius(probability, estimate.values.size, dof, real)
    return Bound(
        np.maximum(radius * np.sqrt(np.maximum(variance, 0)), estimate.rounding),
        kind=ABOUT[about],
        probability=probability,
        dof=float(dof.min()),
        excitations=estimate.excitations,
        caveats=estimate.caveats,
    )
