"""Semidefinite polygons beside the discs of a band: found where the discs are loose, checked, and the smaller bound of both."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from robustid.core import Budget, Complex, Real, exponents_of, fingerprint, hz_words, one_thread, was_interrupted
from robustid.errors import InputError, InputTypeError
from robustid.guarantees.common_nominal import smallest_disc
from robustid.guarantees.consistent_set import Entry
from robustid.guarantees.linear.directed import DirectedBand
from robustid.guarantees.linear.entry_band import EntryBand
from robustid.guarantees.linear.functions import Box, pairs_of
from robustid.guarantees.linear.polygon_discs import hull
from robustid.guarantees.linear.solved_nodes import Nodes, joined_band, of_directions
from robustid.guarantees.over_poles import Bounded, WorstCaseOverPoles
from robustid.guarantees.pole_proofs import Cell, corners_of, union_of
from robustid.guarantees.worst_case_result import WorstCaseError
from robustid.identification import MixedProblem
from robustid.identification.formulation import Entries

if TYPE_CHECKING:
    import control

_ROUNDING = 1e-12  # relative: of corners, and of distances from a centre
Directed = tuple[EntryBand | DirectedBand, ...]
BY_PROGRAMS = "Semidefinite programs", "a semidefinite program narrows"
BY_CELLS = "Sums over cells of the pole-uncertainty box", "sums over cells of the pole-uncertainty box narrow"
_NARROWER = 0.995  # of the width: what is worth words
SAME = 1e-9  # relative distance up to which two frequencies are one


def in_order(problem: MixedProblem, box: Box) -> tuple[Real, Real, int]:
    """The box, which has the modes by rising frequency, in the order of the functions; and the delay of their pairs."""
    if problem.parametric is None:
        return *box, 0
    poles = problem.parametric.in_s().poles
    poles = poles[np.imag(poles) > 0]
    sizes = np.abs(exponents_of(poles, problem.dt))
    rank = np.argsort(np.argsort(sizes, kind="stable"), kind="stable")
    if rank.size != len(box[0]):  # refused, with its sentence, by what is asked for polygons
        rank = np.arange(len(box[0]))
    delay = max((delay for _, delay in pairs_of(problem.parametric).values()), default=0)
    return box[0][rank], box[1][rank], max(delay, 0)


def check_polygons(polygons: object, problem: MixedProblem, box: Box | None) -> None:
    """Refuse polygons that do not bound what the discs bound: of another problem, at other poles, over another box."""
    if not isinstance(polygons, WorstCaseError | WorstCaseOverPoles):
        raise InputTypeError(
            "`polygons` must be a WorstCaseError, or over a box a WorstCaseOverPoles; got " + type(polygons).__name__
        )
    check_same(polygons.identification.problem, problem)
    if isinstance(polygons, WorstCaseError):
        if box is not None:
            raise InputError(
                "`polygons` stand on exact poles, and the band covers a box of them: of the other poles in it they prove nothing;"
                " take those of worst_case_over_poles over the same box"
            )
        return
    if box is None:
        raise InputError("`polygons` cover a box of poles, and the band has none; take those of worst_case_error")
    order = np.argsort(polygons.box.omega.mean(axis=1), kind="stable")
    for name, ends in zip(("omega", "damping"), box, strict=True):
        mine = getattr(polygons.box, name)[order]
        if mine.shape != ends.shape or np.any(mine[:, 0] > ends[:, 0]) or np.any(mine[:, 1] < ends[:, 1]):
            raise InputError(
                f"`polygons` must cover the box of the band; their `{name}` is {mine.tolist()}, its {ends.tolist()}"
            )


def check_same(other: MixedProblem, problem: MixedProblem) -> None:
    """Refuse polygons of another problem."""
    if other is not problem and fingerprint(other) != fingerprint(problem):
        raise InputError("`polygons` are about another problem than the band; take an identification of the same one")


def polygons_hold(polygons: Bounded, exact: bool = False) -> bool:
    """Evaluate every certificate of polygons again, and say whether they are of all entries at rising frequencies."""
    return bool(polygons.omega.size and np.all(np.diff(polygons.omega) > 0)) and polygons.verify(exact)


def narrowed(found: Real, polygons: Bounded | None, omega: Real, nominal: Complex) -> Real:
    """Bounds (F, ny, nu) of the errors of nominal values, or those of the polygons at exactly their frequencies, if smaller."""
    if polygons is None:
        return found
    here = np.isin(omega, polygons.omega)
    if not here.any():
        return found
    at = np.searchsorted(polygons.omega, omega[here])
    values = np.zeros((polygons.omega.size, *nominal.shape[1:]), complex)
    values[at] = nominal[here]
    found = np.array(found)
    found[here] = np.minimum(found[here], union_of(polygons.kept, values, polygons.omega)[0][at])
    return found


def smaller_discs(centre: Complex, radius: Real, polygons: Bounded | None, omega: Real) -> tuple[Complex, Real]:
    """Discs (F, ny, nu), or those around the polygons at exactly their frequencies, if smaller."""
    here = np.zeros(omega.size, bool) if polygons is None else np.isin(omega, polygons.omega)
    if polygons is None or not here.any():
        return centre, radius
    centre, radius = np.array(centre), np.array(radius)
    at = np.searchsorted(polygons.omega, omega[here])
    for entry in np.ndindex(*radius.shape[1:]):
        own, least = (one[at] for one in solved_discs(polygons, entry))
        place = np.flatnonzero(here), *entry
        smaller = least < radius[place]
        centre[place] = np.where(smaller, own, centre[place])
        radius[place] = np.where(smaller, least, radius[place])
    return centre, radius


def narrowed_norm(found: Real, polygons: Bounded | None, omega: Real, model: control.StateSpace) -> Real:
    """Bounds (F,) of the largest singular value of F - model, or those that polygons of matrices have of it, if smaller."""
    if not isinstance(polygons, WorstCaseError) or model is None or polygons.identification.problem.entries.single:
        return found
    here = np.isin(omega, polygons.omega)
    own = polygons.with_model(model).sigma_upper
    found = np.array(found)
    found[here] = np.minimum(found[here], own[np.searchsorted(polygons.omega, omega[here])])
    return found


def discs_of(cells: Sequence[Cell], omega: Real, entries: Entries) -> tuple[Complex, Real]:
    """The same of all entries of cells, (F, ny, nu)."""
    found = np.empty((omega.size, *entries.shape), complex), np.empty((omega.size, *entries.shape))
    for entry in np.ndindex(*entries.shape):
        for whole, own in zip(found, _discs(cells, omega, entry), strict=True):
            whole[:, *entry] = own
    return found


def solved_discs(polygons: Bounded, entry: Entry) -> tuple[Complex, Real]:
    """Centres and radii (F,) of the smallest discs around the polygons of an entry, of all cells; infinite of one too wide."""
    return _discs(polygons.kept, polygons.omega, entry)


def _discs(cells: Sequence[Cell], omega: Real, entry: Entry) -> tuple[Complex, Real]:
    every = corners_of(cells, omega, entry)
    discs = [(0j, np.inf) if corners is None else smallest_disc(corners) for corners in every]
    centre, radius = np.array([one[0] for one in discs], complex), np.array([one[1] for one in discs], float)
    return centre, radius + _ROUNDING * (np.abs(centre) + radius)


def nodes_of(polygons: Bounded, entry: Entry) -> Nodes:
    """Polygons of an entry as nodes of linear certificates."""
    every = [np.zeros(1) if one is None else hull(one) for one in corners_of(polygons.kept, polygons.omega, entry)]
    most = max((one.size for one in every), default=1)
    corners = np.array([np.pad(one, (0, most - one.size), mode="edge") for one in every], dtype=complex).reshape(
        -1, most
    )
    return Nodes(polygons.problem.plane.angles(polygons.omega), *solved_discs(polygons, entry), corners)


def narrowing_words(
    omega: Real, part: Real, solved: NDArray[np.bool_] | None, narrowed: NDArray[np.bool_], by: tuple[str, str]
) -> str:
    """Words on bounds that are a `part` of those of discs, at frequencies that are solved `by` what does it, and others."""
    others = part if solved is None else part[~solved]
    middle = float(np.median(others)) if others.size else 1.0
    to = f"(to {100 * middle:.3g} % in the median)" if middle < _NARROWER else ""
    if solved is None:
        return to and f"Sums of one direction each narrow the band {to}"
    if not narrowed.any():
        return f"{by[0]} at {solved.sum()} of {omega.size} frequencies narrow the band nowhere: that of sums stands" + (
            to and f", one direction at a time {to}"
        )
    sizes, least = part[narrowed], float(omega[narrowed][np.argmin(part[narrowed])]) / (2 * np.pi)
    widths = f"to {100 * np.median(sizes):.3g} % of its width in the median, to {100 * sizes.min():.3g} % at {hz_words(least)}"
    return (
        f"At {narrowed.sum()} of {omega.size} frequencies {by[1]} the band ({widths}); everywhere else the"
        " band of sums stands" + (to and f", one direction at a time, with these values among its samples {to}")
    )


def directed_bands(bands: tuple[EntryBand, ...], budget: Budget) -> Directed:
    """The entries by certificates of one direction each, as far as the time goes; none where all of them stay as they are."""
    with one_thread():
        found = tuple(of_directions(one, budget.share(1 / (len(bands) - k))) for k, one in enumerate(bands))
    return found if any(isinstance(one, DirectedBand) for one in found) else ()


def joined_bands(
    bands: tuple[EntryBand, ...], directed: Directed, polygons: Bounded, budget: Budget | None
) -> Directed:
    """The entries with certificates over samples and polygons: everywhere, between the polygons too.

    From those that are `directed` on, as far as the time goes; after Ctrl-C as they are.
    """
    if was_interrupted():
        return directed
    found: list[EntryBand | DirectedBand] = []
    with one_thread():
        for k, (band, before) in enumerate(zip(bands, directed or bands, strict=True)):
            own = None if budget is None else budget.share(1 / (len(bands) - k))
            found.append(joined_band(band, before, nodes_of(polygons, band.samples.entry), own))
    return tuple(found) if any(one is not band for one, band in zip(found, bands, strict=True)) else ()
