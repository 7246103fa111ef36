"""interconnection(): the loop of two measured things, for every pair of systems that agree with their data."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from robustid.core import Budget, Complex, Interruptible, Real, as_positive, one_thread, responses
from robustid.guarantees.interconnection_result import Interconnection, InterconnectionStatus
from robustid.guarantees.loop_errors import are_discs, closing_error, factor_alone, loci, passive_factors
from robustid.guarantees.loop_sides import Cells, Side, Uncertainty, as_side, check_pair, common_cells, uncertainty_of
from robustid.guarantees.stability_margin import Condition, loop_of
from robustid.guarantees.unstable_pair import Edge, Pair, in_units, pair_again, poles_of_loop, unstable_pair
from robustid.reduction import doubtful_distance

if TYPE_CHECKING:
    import control

    from robustid.guarantees.band_result import Band
    from robustid.guarantees.over_cells import WorstCase
    from robustid.identification import Identification

    Thing = Band | WorstCase | Identification | control.StateSpace | control.TransferFunction
    Systems = tuple[control.StateSpace, control.StateSpace]

_TOP = 1e12  # margins beyond are infinite


@one_thread()
def interconnection(source: Thing, load: Thing, *, time_limit: float | None = None) -> Interconnection:
    r"""Stability of two measured things in one loop, a source impedance and a load admittance say, for all pairs that fit the data.

    The loop of G (source) and H (load) is closed by negative feedback: its poles are the zeros of

    .. math:: \det(I + G(s) H(s)), \qquad \text{for instance } G = Z_s,\; H = Y_l = Z_l^{-1}.

    Both are stable standing alone, and within its band each consistent system is joined with the model through stable ones. Where
    the determinant is not zero for any values of both bands at any frequency, up to infinity or pi/dt, no pole can cross the axis
    on the way from one pair to another: all loops are stable if that of the two models is. At every frequency the determinant is
    kept from zero by small gain, scaled for both errors entry by entry (of two SISO sides exact: no product of values of both
    discs is -1), or by passivity.

    Parameters
    ----------
    source : Band, Identification, WorstCaseError, control.StateSpace or control.TransferFunction
        G, about a model: a `band` of an identification, or of a problem ``with_model(...)``. Of an identification its `band` is
        taken. A control model is known, without error.
    load : as `source`
        H, from the outputs of the source to its inputs: beside an impedance an *admittance*. A measured load impedance is inverted
        with its bound first, `prepare.inverse_response`, and the admittance identified. It may have other lines than the source.
    time_limit : float, optional
        Seconds of the search for an unstable pair, where stability is not proved; Ctrl-C ends it too. Default: as a few
        identifications take.

    Returns
    -------
    Interconnection
        STABLE for every pair; UNSTABLE, with a pair of consistent systems and its poles; or UNDECIDED, with the frequency and
        the side that limit, and how narrow its band must become there.

    Raises
    ------
    InputError, InputTypeError
        Sides that make no loop or stand in different time, one with an integrator, a band without a model.

    Notes
    -----
    Frequencies between the lines are enclosed, not sampled. Passivity is taken on arcs where the Hermitian parts of both are
    proved positive, or that of one where the class of the other has passive systems only (`PositiveReal`). `margins` of arcs are
    at most 5 % below what the condition gives, the least one 0.1 % if small gain decides it. The models need not be consistent: a
    pair of these alone refutes nothing.

    References
    ----------
    `zhou1996`, chapters 9 and 11, for the zero exclusion and its scaling; `vidyasagar1985`.

    Examples
    --------
    >>> import control, numpy as np, robustid as rid
    >>> omega = np.linspace(0.5, 31.0, 30)
    >>> z = np.exp(0.1j * omega)
    >>> prior = rid.Prior(gain_bound=2.0, decay_rate=1.5)
    >>> frf = rid.FrequencyResponse(omega, 0.5 * z / (z - 0.5), bound=0.02, dt=0.1)
    >>> source = rid.band(rid.identify(rid.MixedProblem(frequency=frf, prior=prior)))
    >>> found = rid.interconnection(source, control.ss([], [], [], 0.5, 0.1))
    >>> found.status.name, bool(found.margin > 1)
    ('STABLE', True)
    """
    limit = None if time_limit is None else as_positive("time_limit", time_limit)
    sides = as_side("source", source), as_side("load", load)

    def searched(edge: Edge, dt: float) -> Pair | None:
        with Interruptible():  # undecided then
            return unstable_pair(sides, edge, dt, Budget(limit))
        return None

    return _judged(sides, searched)


@one_thread()
def interconnection_again(source: Thing, load: Thing, pair: Systems | None) -> Interconnection:
    """The verdict on two sides, evaluated anew, with an unstable pair that was found before in place of a search.

    ValueError: a pair that does not agree with the data, or whose loop is stable.
    """
    sides = as_side("source", source), as_side("load", load)

    def found(_: Edge, dt: float) -> Pair | None:
        return None if pair is None else pair_again(sides, pair, dt)

    return _judged(sides, found)


def _judged(sides: tuple[Side, Side], search: Callable[[Edge, float], Pair | None]) -> Interconnection:
    """The verdict on two sides; a pair that is not stable is searched where it is not proved."""
    dt = check_pair(*sides)
    cells = common_cells(*sides, dt)
    nominal = poles_of_loop(sides[0].model, sides[1].model, dt)
    uncertain = uncertainty_of(cells)
    loop = loop_of(uncertain.nominal, uncertain.controller, "additive")
    loop.dt = 1.0 if cells.image is not None else dt
    margins, least, angle = _small_gain(loop, cells, uncertain)
    passive = np.zeros(margins.size, dtype=bool)
    if least <= 1:
        factors = passive_factors(cells.models, cells.angles, cells.entries, (sides[0].passive, sides[1].passive))
        passive = (factors > 1) & (factors > margins)
        margins = np.where(passive, factors, margins)
        if passive.any():
            worst = int(np.argmin(margins))
            least, angle = float(margins[worst]), float(cells.angles[worst : worst + 2].mean())
    edge, shares, needed = _limit(loop, cells, uncertain, angle)
    pair = None
    if not (least > 1 and nominal.stable):
        pair = search(edge, dt)
    return _result(cells, nominal, (least, edge, shares, needed), (margins, passive), pair, sides)


def _small_gain(loop: control.StateSpace, cells: Cells, uncertain: Uncertainty) -> tuple[Real, float, float]:
    """The margin on every cell, the least one and its angle; 0 where nothing bounds an error, or with poles on the edge."""
    count = cells.edges.size - 1
    if not uncertain.bound.any():
        return np.full(count, np.inf), np.inf, 0.0
    poles, doubt = doubtful_distance(in_units(np.asarray(loop.A)))
    distance = np.abs(1 - np.abs(poles))
    if np.any(distance <= doubt):
        angle = float(np.abs(np.angle(poles[np.argmin(distance)])))
        return np.zeros(count), 0.0, angle
    condition = Condition(loop, cells.angles, (uncertain.bound,), not are_discs(uncertain.bound))
    gain, angle = condition.largest()
    margin = 1 / gain if gain > 1 / _TOP else np.inf
    margins = np.maximum(margin, 1 / np.maximum(condition.on_cells(gain), np.finfo(float).tiny))
    open_cells = ~np.all([np.isfinite(one).all(axis=(1, 2)) for one in cells.entries], axis=0)
    if open_cells.any():
        margins[open_cells] = 0.0
        first = int(np.argmax(open_cells))
        return margins, 0.0, float(cells.angles[first : first + 2].mean())
    return margins, float(margin), float(angle)


def _limit(
    loop: control.StateSpace, cells: Cells, uncertain: Uncertainty, angle: float
) -> tuple[Edge, tuple[Real, Real], tuple[float, float]]:
    """The errors that close the loop at an angle, the shares of the entries of both sides, and how far each must shrink alone."""
    cell = min(int(np.searchsorted(cells.angles, angle, side="right")) - 1, cells.edges.size - 2)
    values, limits = [_value(model, angle) for model in cells.models], [entries[cell] for entries in cells.entries]
    errors: list[Complex] = [np.zeros(value.shape, complex) for value in values]
    shares: list[Real] = [np.zeros(value.shape) for value in values]
    factor, needed = np.inf, [1.0, 1.0]
    here, bound = _value(loop, angle), uncertain.bound[cell]
    if bound.any():
        found = closing_error(here, bound)
        factor = found.factor
        for side, place in enumerate(uncertain.places):
            if place is not None:
                errors[side], shares[side] = found.errors[place], found.shares[place]
                needed[side] = factor_alone(here, bound, place)
    first, second = cells.units
    edge = Edge(
        cells.omega(angle),
        factor,
        (values[0] * first, values[1] * second),
        (errors[0] * first, errors[1] * second),
        (limits[0] * first, limits[1] * second),
    )
    return edge, (shares[0], shares[1]), (needed[0], needed[1])


def _value(model: control.StateSpace, angle: float) -> Complex:
    return np.asarray(model(np.exp(1j * angle), squeeze=False), dtype=complex)


def _result(
    cells: Cells,
    nominal: Any,
    limit: tuple[float, Edge, tuple[Real, Real], tuple[float, float]],
    arcs: tuple[Real, Any],
    pair: Pair | None,
    sides: tuple[Side, Side],
) -> Interconnection:
    least, edge, shares, needed = limit
    status = InterconnectionStatus.UNDECIDED
    if pair is not None or (least > 1 and nominal.unstable.size):
        status = InterconnectionStatus.UNSTABLE
    elif least > 1 and nominal.stable:
        status = InterconnectionStatus.STABLE
    middle = (cells.angles[:-1] + cells.angles[1:]) / 2
    omega = np.array([cells.omega(angle) for angle in middle.tolist()])
    values = [responses(model, middle) for model in cells.models]
    places, radius = loci(values[0], values[1], cells.entries)
    return Interconnection(
        source=sides[0].thing,
        load=sides[1].thing,
        status=status,
        margin=least,
        frequency=edge.omega,
        shares=shares,
        bounds=edge.bounds,
        needed=needed,
        edges=cells.edges,
        margins=arcs[0],
        passive=arcs[1],
        pair=None if pair is None else (pair.source, pair.load),
        poles=nominal.unstable if pair is None else pair.poles,
        omega=omega,
        loci=places,
        radius=radius,
    )
