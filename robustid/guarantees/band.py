"""band(): a proved disc around every consistent system, at every frequency, from sums; searched, or from known multipliers."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from robustid.core import Array, Arrays, Budget, Progress, Real, as_count
from robustid.errors import InputError, InputTypeError
from robustid.guarantees.band_result import Band
from robustid.guarantees.consistent_set import independent_entries
from robustid.guarantees.linear.amplitudes import Extraction
from robustid.guarantees.linear.directed import DirectedBand, Sides, directed_fit
from robustid.guarantees.linear.entry_band import EntryBand, extraction_fits, multipliers_fit
from robustid.guarantees.linear.functions import Box, BoxLike, ends_of, functions_of
from robustid.guarantees.linear.samples import Samples, samples_of, seen_in
from robustid.guarantees.linear.solved_nodes import NO_NODES, Nodes, said, with_nodes
from robustid.guarantees.nominal import as_frequencies, check_nominal, default_grid
from robustid.guarantees.over_poles import Bounded
from robustid.guarantees.refinement import check_polygons, nodes_of, polygons_hold
from robustid.guarantees.whole_axis import axis_ends, discs_of_entries
from robustid.identification import Identification, MixedProblem

if TYPE_CHECKING:
    import control


def band(
    thing: Identification | MixedProblem,
    *,
    omega: ArrayLike | None = None,
    box: BoxLike | None = None,
    model: control.StateSpace | None = None,
    knots: int | None = None,
    time_limit: float | None = None,
    progress: Progress | None = None,
) -> Band:
    r"""Proved band of all consistent systems at every frequency, from linear certificates: milliseconds a frequency.

    For any numbers d_k,

    .. math::
        |F(z_0) - \sum_k d_k y_k| \le \sum_k |d_k| \varepsilon_k + K \|r_d\| + \sum_i \Delta_i |\sum_k d_k P_i(z_k) - P_i(z_0)|,
        \qquad r_d(g) = g(z_0) - \sum_k d_k g(z_k),

    with the norm of H2 of the harmonic measure seen from z_0, whose unit ball contains the class, and Delta_i proved radii of the
    coefficients (measured from their centres). Good d come from reweighted least squares; whatever they are, the sum is a proof.

    Parameters
    ----------
    thing : Identification or MixedProblem
        The statement: data with bounds, class, parametric part. Of an identification `model` is the nominal.
    omega : (F,) array, rad/s, optional
        Frequencies to report; the band holds at all others too. Default: as in `worst_case_error`.
    box : KautzSuggestion or pair of (M, 2) arrays, optional
        Pole-uncertainty box: ends of the natural frequencies in rad/s and of the damping ratios of the `kautz` pairs of the
        parametric part, by rising frequency. Poles that were taken from the same data need it. Default: poles exactly as stated.
    model : control.StateSpace, optional
        The nominal that errors are measured from.
    knots : int, optional
        Most frequencies of an entry at which certificates are searched, but at least 50 and 19 for every mode: sooner, and a
        wider band. 400 leave it at most half as wide again in most cases. Default: as many as interpolation between them asks for.
    time_limit : float, optional
        Seconds. Every entry gets a coarse band first, and then, one after the other, as much as time allows: the band is proved,
        and its `unfinished` says what is wider than it need be. So it is on Ctrl-C.
    progress : callable (text, done, count), optional
        Entries.

    Returns
    -------
    Band

    Raises
    ------
    InconsistentDataError
        An identification that isn't consistent.
    InputError
        A passive class without a gain bound, a box that does not hold the poles, frequencies above pi/dt, less than 2 knots.

    Notes
    -----
    Linear methods reach the smallest worst case over all data [`micchelli1977`]; what these data say beyond that is left to
    `worst_case_error`, which takes a hundred times as long. Records are used up to 256 samples an entry, those of an unknown
    initial state only where there is no box; ellipses as the discs around them. Source: theorem 1 of `micchelli1977` for the
    optimality, Szego kernels of the disc for the norm.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> omega = np.linspace(1.0, 30.0, 20)
    >>> frf = rid.FrequencyResponse(omega, 1 / (2 - np.exp(-0.1j * omega)), bound=0.01, dt=0.1)
    >>> problem = rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=2.0, decay_rate=1.5))
    >>> found = rid.band(problem)
    >>> centre, radius = found.at([7.5])
    >>> bool(abs(centre[0, 0, 0] - 1 / (2 - np.exp(-0.75j))) <= radius[0, 0, 0] < 0.02), found.certified
    (True, True)
    """
    budget = Budget(time_limit, progress, "proving the error at every frequency")
    problem, model = _statement(thing, model)
    low, _ = axis_ends(problem, np.zeros(0))
    grid = default_grid(problem) if omega is None else as_frequencies(omega, problem)
    grid = grid[grid >= low] if omega is None else grid
    most = None if knots is None else as_count("knots", knots, least=2)
    bands = discs_of_entries(problem, box, grid, most, budget)
    stated = None if box is None else ends_of(box)
    return Band(problem=problem, omega=grid, bands=bands, box=stated, model=model)


def _statement(thing: object, model: control.StateSpace | None) -> tuple[MixedProblem, control.StateSpace | None]:
    """The problem and the nominal."""
    if isinstance(thing, Identification):
        thing.require()
        problem, model = thing.problem, thing.model if model is None else model
    elif isinstance(thing, MixedProblem):
        problem = thing
    else:
        raise InputTypeError(f"`thing` must be an Identification or a MixedProblem; got {type(thing).__name__}")
    if problem.prior.positive_real:
        raise InputError(
            f"`thing` is of a {problem.prior.passive} class, which has no gain bound: its band comes from worst_case_error"
        )
    return problem, None if model is None else check_nominal(model, problem)


class Multipliers(NamedTuple):
    """Knots of an entry, with points and multipliers, the fields of an `Extraction` but for its samples, and what holds of them."""

    angles: Real
    points: Array
    multipliers: Array
    amplitudes: Arrays
    complete: bool
    nodes: bool  # polygons are among the samples


def band_of_multipliers(
    problem: MixedProblem,
    box: Box | None,
    omega: Real,
    model: control.StateSpace | None,
    multipliers: Sequence[Multipliers],
    polygons: Bounded | None = None,
    directed: Sequence[Multipliers] = (),
) -> Band:
    """Make the band of known multipliers; all that it claims follows from them. ValueError for arrays of another problem.

    `directed` are those of one direction each, and over polygons.
    """
    functions, seen = functions_of(problem, box), seen_in(problem)
    places = independent_entries(problem.entries)
    if len(places) != len(multipliers) or len(directed) not in (0, len(places)):
        raise ValueError("its entries are not those of the problem")
    every = [samples_of(problem, functions, place, seen) for place in places]
    bands = tuple(_entry_of(*pair) for pair in zip(every, multipliers, strict=True))
    grid = as_frequencies(omega, problem)
    found = Band(problem=problem, omega=grid, bands=bands, box=box, model=model)
    if polygons is not None:
        if not polygons_hold(polygons):
            raise ValueError("its polygons do not follow from their certificates")
        check_polygons(polygons, problem, box)
        found = dataclasses.replace(found, problem=polygons.identification.problem, polygons=polygons)
    nodes = [NO_NODES if polygons is None else nodes_of(polygons, one.entry) for one in every]
    further = tuple(_directed_of(*each) for each in zip(every, nodes, directed, strict=False))
    return dataclasses.replace(found, directed=further)


def _entry_of(samples: Samples, known: Multipliers) -> EntryBand:
    """The band of an entry."""
    angles, points, d, proof, complete, _ = known
    extraction = Extraction(samples, **proof)
    _check(multipliers_fit(samples, points, d, angles.size) and extraction_fits(extraction), angles)
    return EntryBand(samples, extraction, angles, points, d, bool(complete))


def _directed_of(samples: Samples, nodes: Nodes, known: Multipliers) -> EntryBand | DirectedBand:
    """The band of an entry by sums of one direction each, or with polygons among its samples."""
    angles, points, c, proof, complete, over_nodes = known
    nodes = said(samples, nodes) if over_nodes else NO_NODES
    samples = with_nodes(samples, nodes)
    if c.ndim != 3:
        return _entry_of(samples, known)
    sides = Sides(samples, Extraction(samples, **proof), nodes.corners)
    _check(directed_fit(sides, points, c, angles.size) and extraction_fits(sides.extraction), angles)
    return DirectedBand(sides, angles, points, c, bool(complete))


def _check(fits: bool, angles: Real) -> None:
    """Refuse multipliers of other samples, and knots that do not rise."""
    if not (fits and angles.ndim == 1 and angles.size > 1 and bool(np.all(np.diff(angles) > 0))):
        raise ValueError("its multipliers do not belong to the samples of the problem")
