"""Distances of plants in a loop: coprime factors, the robust stability margin of a loop in their sense, the nu-gap.

The loop is u = r - C y throughout. Factors have as many states as their system; a Riccati equation of that size gives each pair.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robustid.core import (
    StateMatrices,
    as_flag,
    bilinear_in_s,
    closed_loop,
    decay_of,
    is_well_posed,
    loop_is_stable,
    mirroring_feedback,
    one_thread,
    poles_of,
    right_factors,
)
from robustid.errors import InputError
from robustid.guarantees.chordal import LargestAngle
from robustid.guarantees.graphs import check_shown, ends_large, graph_complement, graph_factors, graph_of
from robustid.identification import as_system
from robustid.reduction import doubtful_distance, hinf_norm

if TYPE_CHECKING:
    import control

_ONE = 1e-6  # below 1 a sine is 1 to rounding where a zero is on the axis to rounding


class CoprimeFactors(NamedTuple):
    r"""Stable factors of a system, :math:`P = N D^{-1} = \tilde D^{-1} \tilde N`.

    Attributes
    ----------
    numerator, denominator : control.StateSpace
        N (ny, nu) and D (nu, nu), the right factors.
    left_numerator, left_denominator : control.StateSpace
        :math:`\tilde N` (ny, nu) and :math:`\tilde D` (ny, ny).
    """

    numerator: control.StateSpace
    denominator: control.StateSpace
    left_numerator: control.StateSpace
    left_denominator: control.StateSpace


class LoopDistance(NamedTuple):
    """A nu-gap or a coprime factor margin, between 0 and 1, and where on the frequency axis it is reached.

    Attributes
    ----------
    value : float
    omega : float
        In rad/s (per sample where dt is True), infinity included; nan where no frequency decides: the winding number of the plants
        differs, or the loop is not stable.
    """

    value: float
    omega: float


@one_thread()
def coprime(model: control.StateSpace | control.TransferFunction, *, normalised: bool = True) -> CoprimeFactors:
    r"""Coprime factors of a system of any poles: stable ones, without common zeros, whose quotient it is.

    .. math:: P = N D^{-1} = \tilde D^{-1} \tilde N, \qquad
              D^* D + N^* N = I, \quad \tilde D \tilde D^* + \tilde N \tilde N^* = I
              \quad\text{on the axis, or on the circle}

    Parameters
    ----------
    model : control.StateSpace or control.TransferFunction
        P, continuous or discrete. A transfer function with several inputs or outputs is converted where slycot is installed.
    normalised : bool
        False: by the feedback of least energy instead, which mirrors the poles that aren't stable at the axis (at the circle) and
        leaves the others where they are. Where poles lie on it as far as rounding tells, the
        mirror stands inside, at half the decay of the slowest of all other poles and of the poles of the normalised factors:
        poles on the axis come to that decay, and no stable pole is moved.

    Returns
    -------
    CoprimeFactors

    Raises
    ------
    InputError, InputTypeError
        If the model isn't a finite system with known time base, or has a pole that isn't stable and that its inputs do not move or
        its outputs do not show.

    References
    ----------
    `zhou1996`, sections 5.4 and 13.7; `vidyasagar1985`, chapter 4.

    Examples
    --------
    >>> import control, robustid as rid
    >>> factors = rid.guarantee.coprime(control.tf([1], [1, 0]))  # 1/s = [1/(s + 1)] / [s/(s + 1)]
    >>> factors.denominator.poles().real, factors.denominator.zeros().real + 0.0
    (array([-1.]), array([0.]))
    >>> float(round(abs(factors.numerator(2j)) ** 2 + abs(factors.denominator(2j)) ** 2, 12))
    1.0
    """
    as_flag("normalised", normalised)
    system, dt = as_system("model", model)
    pair = system, system.transposed()
    both = [graph_factors("model", one, dt) for one in pair]
    if not normalised:
        decay = _mirror(system, both, dt)
        both = [right_factors(one, mirroring_feedback(one, dt or 0.0, decay)) for one in pair]
    ny, nu = system.D.shape
    denominator, numerator = _parts(both[0], nu)
    left_denominator, left_numerator = (part.transposed() for part in _parts(both[1], ny))
    found = numerator, denominator, left_numerator, left_denominator
    return CoprimeFactors(*(part.model(model.dt) for part in found))


@one_thread()
def ncf_margin(
    plant: control.StateSpace | control.TransferFunction, controller: control.StateSpace | control.TransferFunction
) -> LoopDistance:
    r"""Robust stability margin of a loop against errors of the normalised coprime factors of its plant (or of its controller).

    .. math:: b(P, C) = \left\| \begin{bmatrix} P \\ I \end{bmatrix} (I + C P)^{-1}
              \begin{bmatrix} C & I \end{bmatrix} \right\|_\infty^{-1}, \qquad u = r - C y,

    0 where the loop isn't stable. It is at most 1, and the same with both exchanged. C stabilises every plant whose `nu_gap` from P
    is smaller: :math:`\arcsin b(P_2, C) \ge \arcsin b(P, C) - \arcsin\delta_\nu(P, P_2)`.

    Parameters
    ----------
    plant, controller : control.StateSpace or control.TransferFunction
        P and C, both continuous or with one sample time; any poles. Transfer functions with several inputs or outputs are converted
        where slycot is installed.

    Returns
    -------
    LoopDistance
        ``value``, at most 1e-9 of itself too large, and the frequency that limits it.

    Raises
    ------
    InputError, InputTypeError
        If one isn't a finite system with known time base, or they don't fit together.

    Notes
    -----
    Depends on the units of the signals: put weights around the plant, so that an error counts alike in all signals and at all
    frequencies (loop shaping: C and the weighted plant), before margins are compared.

    References
    ----------
    `vinnicombe1993`; `zhou1996`, chapter 18.

    Examples
    --------
    >>> import control, robustid as rid
    >>> round(rid.guarantee.ncf_margin(control.tf([1], [1, 0]), control.tf([1], [1])).value, 6)  # 1/sqrt(2): none is better for 1/s
    0.707107
    """
    system, dt, feedback = _pair(("plant", plant), ("controller", controller), opposite=True)
    if not is_well_posed(system, feedback):
        return LoopDistance(0.0, np.inf)
    loop = closed_loop(system, feedback)
    if not loop_is_stable(poles_of(loop.A), dt or 0.0):
        return LoopDistance(0.0, np.nan)
    # From what is added to u and to y: u = S_u (v - C w), y = P u + w. With -w and w + y in the place of w and y: [I; P] S_u [I C].
    ny, nu = system.D.shape
    signs = np.repeat([1.0, -1.0], [nu, ny])
    direct = loop.D * signs + np.diag(np.repeat([0.0, 1.0], [nu, ny]))
    peak = hinf_norm(StateMatrices(loop.A, loop.B * signs, loop.C, direct), dt)
    return LoopDistance(min(1 / peak.value, 1.0), peak.omega)


@one_thread()
def nu_gap(
    first: control.StateSpace | control.TransferFunction, second: control.StateSpace | control.TransferFunction
) -> LoopDistance:
    r"""Vinnicombe's distance of two plants, as a loop sees it: 0 for equal ones, at most 1.

    .. math:: \delta_\nu(P_1, P_2) = \sup_\omega \bar\sigma\left( (I + P_2 P_2^*)^{-1/2} (P_1 - P_2) (I + P_1^* P_1)^{-1/2} \right)

    where :math:`\det(I + P_2^* P_1)` has the winding number that makes it a distance of loops, else 1. A controller with
    `ncf_margin` b stabilises every plant within less than b of its own: :math:`\arcsin b(P_2, C) \ge \arcsin b(P_1, C) -
    \arcsin\delta_\nu(P_1, P_2)`. Large errors count for little where the loop gain is large, small ones count around the crossover.

    Parameters
    ----------
    first, second : control.StateSpace or control.TransferFunction
        Same numbers of inputs and outputs, both continuous or with one sample time; any poles, on the axis too. Transfer functions
        with several inputs or outputs are converted where slycot is installed.

    Returns
    -------
    LoopDistance
        ``value``, the formula at ``omega``, at most 1e-9 of itself too small but for rounding: of plants that almost agree, and of
        poles on the axis that are hardly moved or seen. ``omega`` is nan where the winding number makes the distance 1.

    Raises
    ------
    InputError, InputTypeError
        If one isn't a finite system with known time base, if they don't match, or if one has a pole that isn't stable and that its
        inputs do not move or its outputs do not show; if gains are so large that rounding hides the winding number.

    Notes
    -----
    It is the largest sine of the angle between the graphs of both plants, of :math:`G_1 = [I; P_1]` and what
    :math:`\tilde G_2 = [-P_2, I]` is zero on; a level is reached nowhere where a Hamiltonian matrix of twice as many states as both
    have has no eigenvalues on the axis. Normalised factors are in their place where a plant has poles near the axis,
    factors whose value at infinity is an isometry where that of the plant is large.

    The winding condition holds if as many zeros of the square matrix :math:`[G_1, \tilde G_2^*]` as :math:`P_2` has states lie
    right of the axis. Where such a zero comes to the axis, so that its side is a question of rounding, the sine is 1 there: both
    answers are 1, the gap does not jump.

    Depends on the units of the signals, as `ncf_margin` does.

    References
    ----------
    `vinnicombe1993`; `zhou1996`, section 13.7, for the factors; `vidyasagar1985`, chapter 7, for distances of plants in a loop.

    Examples
    --------
    >>> import control, robustid as rid
    >>> stable, unstable = control.tf([1], [1, 0.1]), control.tf([1], [1, -0.1])
    >>> round(rid.guarantee.nu_gap(stable, unstable).value, 6)  # 2 a/(1 + a^2): any sensible loop hides the difference
    0.19802
    >>> rid.guarantee.nu_gap(control.tf([10], [1]), control.tf([10, -10], [1, 1]))  # 0.198 at most, but it winds
    LoopDistance(value=1.0, omega=nan)
    """
    one, dt, two = _pair(("first", first), ("second", second), opposite=False)
    if any(ends_large(system, dt) for system in (one, two)):
        for name, system in (("first", one), ("second", two)):
            check_shown(name, system, dt, poles_of(system.A))
        if dt:
            one, two = bilinear_in_s(one, 2.0), bilinear_in_s(two, 2.0)
        value, omega = _largest_angle(one, two, None, feedback=True)
        return LoopDistance(value, float(2 * np.arctan(omega)) / float(dt) if dt else omega)
    value, angle = _largest_angle(one, two, dt, feedback=False)
    return LoopDistance(value, angle / float(dt) if dt else angle)


def _largest_angle(one: StateMatrices, two: StateMatrices, dt: float | None, *, feedback: bool) -> tuple[float, float]:
    """The nu-gap, and the frequency in continuous time, or the angle."""
    graph = graph_of("first", one, dt, feedback=feedback)
    back = two.transposed()
    complement = graph_of("second", back, dt, lambda found: graph_complement(found.transposed()), feedback=feedback)
    largest = LargestAngle(graph, complement, discrete=bool(dt))
    alike = largest.winds_alike()
    if alike is False:
        return 1.0, np.nan
    found = largest.search()
    if alike is None and found[0] < 1 - _ONE:
        raise InputError(
            "`first` and `second` must have gains nearer to 1: rounding hides how often one winds about the other. Scale their"
            " signals"
        )
    return found


def _pair(
    one: tuple[str, object], other: tuple[str, object], *, opposite: bool
) -> tuple[StateMatrices, float | None, StateMatrices]:
    """Two systems of one size, or of opposite sizes, and their time base."""
    (name, _), (second, _) = one, other
    (first, base), (last, dt) = as_system(*one), as_system(*other)
    ny, nu = last.D.shape[::-1] if opposite else last.D.shape
    if first.D.shape != (ny, nu):
        ny, nu = last.D.shape
        wanted = f"{first.D.shape[opposite]} outputs and {first.D.shape[not opposite]} inputs"
        raise InputError(f"`{second}` must have {wanted}, those of `{name}`{' reversed' * opposite}; got {ny} and {nu}")
    if None not in (base, dt) and base != dt:
        raise InputError(
            f"`{second}` must have the time base of `{name}`, dt = {base}; got dt = {dt}. Convert one of them,"
            " control.sample_system(...)"
        )
    return first, dt if base is None else base, last


def _mirror(system: StateMatrices, normalised: list[StateMatrices], dt: float | None) -> float:
    """The decay at which poles that aren't stable are mirrored: 0, but where some are on the axis."""
    poles, doubt = doubtful_distance(system.A)
    distance = 1 - np.abs(poles) if dt else -poles.real
    if np.all(np.abs(distance) > doubt):
        return 0.0
    others = [decay_of(poles[distance > doubt], dt or 0.0)]
    return min(others + [decay_of(poles_of(one.A), dt or 0.0) for one in normalised]) / 2


def _parts(factors: StateMatrices, count: int) -> tuple[StateMatrices, StateMatrices]:
    """The first rows, and the others."""
    A, B, C, D = factors
    return StateMatrices(A, B, C[:count], D[:count]), StateMatrices(A, B, C[count:], D[count:])
