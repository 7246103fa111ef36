"""Modes of a small model that its data hardly show: at the limit of damping, between the points, or almost cancelled by a zero."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from robustid.core import Frozen, Plane, Real, hz_words, one_thread, plane_of
from robustid.data import FrequencyResponse
from robustid.errors import InputError
from robustid.fitting import continuous, modal_form
from robustid.identification import Identification, largest_ratio

if TYPE_CHECKING:
    import control

_LEAST = 1.5e-5  # damping ratio: searches end at 1e-5
_BETWEEN = 0.25  # of the distance of the frequency points: a mode that is narrower lies between them
_CANCELLED = 0.05  # of the response: what a mode almost cancelled by a zero changes at most, at its peak
_NARROW = "that is narrower than the distance of the frequency points around it, which do not show it"
_AROUND = np.linspace(-3, 3, 61)  # in half-widths


@dataclasses.dataclass(frozen=True, kw_only=True)
class DoubtfulMode(Frozen):
    """A mode that the data hardly show.

    Attributes
    ----------
    hz, damping : float
    why : str
        In words that follow "a mode at ... Hz".
    removed : bool
        Whether the model keeps every sample without it too, so that it was left out.
    """

    hz: float
    damping: float
    why: str
    removed: bool

    def summary(self) -> str:
        """In words."""
        end = (
            "; the model keeps every sample without it too, and it was left out"
            if self.removed
            else "; some frequency points fit less well without it, and it was kept: measure more points around it"
        )
        return f"The small model has a mode at {hz_words(self.hz)} (damping {self.damping:.3g}) {self.why}{end}."


@one_thread()
def without_doubtful_modes(
    identification: Identification, model: control.StateSpace, unused: Sequence[FrequencyResponse] = ()
) -> tuple[control.StateSpace, tuple[DoubtfulMode, ...]]:
    """Leave modes out that the data hardly show, where all samples stay within their bounds.

    A mode is doubtful at the limit of damping; where it changes the response by less than 5 % anywhere near its peak (a pole beside
    a zero); or where it is narrower than a quarter of the distance of the frequency points and these stay within their bounds
    without it. Points that were not used are asked too: the model must not miss them by more without it.
    """
    found: list[DoubtfulMode] = []
    limit = max(1.0, identification.margin * (1 + 1e-5), largest_ratio(identification.problem, model))
    while True:
        for smaller, hz, damping, why in _doubtful(identification, model, limit):
            if any(abs(hz / one.hz - 1) < 1e-6 for one in found):
                continue
            removed = largest_ratio(identification.problem, smaller) <= limit and _predicts(model, smaller, unused)
            found.append(DoubtfulMode(hz=hz, damping=damping, why=why, removed=removed))
            if removed:
                model = smaller
                break
        else:
            return model, tuple(found)


def _doubtful(
    identification: Identification, model: control.StateSpace, limit: float
) -> list[tuple[control.StateSpace, float, float, str]]:
    """The model without each doubtful mode, its frequency and damping, and why it is doubtful."""
    import control

    try:
        form = modal_form(model)
    except InputError:  # nothing to take apart
        return []
    A, B, C = (np.asarray(part) for part in (form.model.A, form.model.B, form.model.C))
    dt, plane = float(model.dt), identification.problem.plane
    points = plane.omega(np.unique(np.abs(identification.problem.angles)))
    out: list[tuple[control.StateSpace, float, float, str]] = []
    for block in form.blocks:
        poles = np.linalg.eigvals(A[block, block])
        if len(poles) != 2 or poles[0].imag == 0 or (form.rigid and block.start == 0):
            continue
        s = complex(continuous(complex(poles[0]), dt))
        omega, damping = abs(s), -s.real / abs(s)
        places: NDArray[np.intp] = np.arange(len(A))
        kept = places[(places < block.start) | (places >= block.stop)]
        names = {"inputs": model.input_labels, "outputs": model.output_labels, "name": "reduced"}
        parts = A[np.ix_(kept, kept)], B[kept], C[:, kept], model.D
        smaller = control.StateSpace(*parts, model.dt, remove_useless_states=False, **names)
        why = _why(model, smaller, omega, damping, points, plane)
        if why == _NARROW and largest_ratio(identification.problem, smaller) > limit:
            continue  # a light mode that the points around it show
        if why:
            out.append((smaller, omega / (2 * np.pi), damping, why))
    return out


def _why(
    model: control.StateSpace, smaller: control.StateSpace, omega: float, damping: float, points: Real, plane: Plane
) -> str:
    if damping <= _LEAST:
        return "at the lower limit of damping"
    near = np.clip(omega + damping * omega * _AROUND, 0, plane.top)
    with_it, without = plane.values_at(model, near), plane.values_at(smaller, near)
    size = np.maximum(np.linalg.norm(with_it, axis=(1, 2)), np.finfo(float).tiny)
    if np.max(np.linalg.norm(with_it - without, axis=(1, 2)) / size) < _CANCELLED:
        return "that a zero almost cancels"
    if points.size > 1 and points[0] < omega < points[-1]:
        place = int(np.searchsorted(points, omega))
        if damping * omega < _BETWEEN * float(points[place] - points[place - 1]):
            return _NARROW
    return ""


def _predicts(model: control.StateSpace, smaller: control.StateSpace, unused: Sequence[FrequencyResponse]) -> bool:
    """Return whether the smaller model misses points not used by no more than they are bounded, or than the model does."""
    for frf in unused:
        before, after = (_missed(one, frf) for one in (model, smaller))
        if after > max(1.0, before * (1 + 1e-9)):
            return False
    return True


def _missed(model: control.StateSpace, frf: FrequencyResponse) -> float:
    used = frf.bound.used
    error = np.abs(np.where(used, frf.values - plane_of(frf.dt, frf.omega).values_at(model, frf.omega), 0.0))
    radius = np.where(used, frf.bound.outer_radius, 1.0)
    return float(np.max(error / np.where(radius > 0, radius, np.finfo(float).tiny), initial=0.0))
