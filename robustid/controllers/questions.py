"""Questions about a controller that have no sense, refused with the number that stands in the way."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from robustid.controllers.factors import FIR, PID, Factor, Fixed, LowPass, Notch
from robustid.controllers.goals import Attenuation, Goal, IntegralGain, LeastControl
from robustid.controllers.limits import TEMPLATES, Limits
from robustid.controllers.obstacles import unstable_of, zeros_of
from robustid.controllers.plants import Plants
from robustid.controllers.structure import Entry, Matrix, entries_of
from robustid.core import StateMatrices, as_count, loop_is_stable, poles_of
from robustid.errors import InputError

_SAME = 1e-6  # of a pole: a zero that is nearer cancels it


def check_question(
    plants: Sequence[Plants], structure: tuple[Factor, ...] | Matrix, limits: Limits, goal: Goal
) -> None:
    """Raise InputError where a design makes no sense whatever the data say."""
    _check_plants(plants)
    dt, (nu, ny) = plants[0].dt, plants[0].loop.shape
    entries = entries_of(structure, (ny, nu))
    _check_integrators(entries)
    products = [factors for *_, factors in entries]
    for factors in products:
        _check_factors(factors, dt)
    limits.check()
    if dt:
        _check_sampling(limits, goal, math.pi / dt)
    _check_integral(products, limits, goal, dt)
    if (nu, ny) == (1, 1):
        _check_cancelled(plants, products[0])
    else:
        _check_matrices(goal.asked(limits, 1.0), products, (nu, ny))
    if isinstance(goal, LeastControl):
        _check_action(plants, limits)


def _check_plants(plants: Sequence[Plants]) -> None:
    if not plants:
        raise InputError("`bands` must hold at least one band")
    for one in plants:
        if one.loop.shape != plants[0].loop.shape:
            raise InputError("`bands` must have the same inputs and outputs")
        if not math.isclose(one.dt, plants[0].dt, rel_tol=1e-9):
            raise InputError(f"`bands` must have one sample time; got {plants[0].dt:g} and {one.dt:g} s")


def _check_integrators(entries: Sequence[Entry]) -> None:
    """Refuse two integrators behind one output or before one input: what they differ by is seen or moved by nothing."""
    places = [(i, j) for i, j, factors in entries if any(isinstance(one, PID) and one.integral for one in factors)]
    for side, name in ((0, "row"), (1, "column")):
        for number in {place[side] for place in places}:
            count = sum(place[side] == number for place in places)
            if count > 1:
                raise InputError(
                    f"`structure` must have at most one integrator in every row and column; got {count} in {name} {number + 1}:"
                    " their difference is a state that no loop moves. Take PID(integral=False) beside one of them"
                )


def _check_factors(factors: Sequence[Factor], dt: float) -> None:
    for one in factors:
        if isinstance(one, FIR):
            as_count("length", one.length, least=1)
            if not dt:
                raise InputError(
                    f"`structure` holds FIR({one.length}), whose past samples a controller in continuous time has not"
                )
        ends = one.free  # checks its numbers
        if dt and isinstance(one, Notch | LowPass) and ends[0][0] >= math.pi / dt:
            raise InputError(
                f"`omega` of {type(one).__name__} must be below the Nyquist frequency, {math.pi / dt:.5g} rad/s; got"
                f" {ends[0][0]:g}"
            )


def _check_sampling(limits: Limits, goal: Goal, top: float) -> None:
    """Limits and goals that begin above the Nyquist frequency."""

    def check(name: str, what: str, value: float) -> None:
        if value >= top:
            raise InputError(f"`{name}` must {what} below the Nyquist frequency, {top:.5g} rad/s; got {value:.5g}")

    for name in TEMPLATES:
        for row in getattr(limits, name):
            check(name, "begin", row[0])
    if limits.bandwidth is not None:
        check("bandwidth", "be", limits.bandwidth)
    if isinstance(goal, Attenuation):
        check("maximise", "be a range that begins", goal.low)


def _fixed(factors: Sequence[Factor]) -> Iterator[StateMatrices]:
    for one in factors:
        if isinstance(one, Fixed):
            yield from (system for system, _ in one.parts([]).systems)


def _check_matrices(limits: Limits, products: Sequence[Sequence[Factor]], shape: tuple[int, int]) -> None:
    """Integrators fewer than the outputs, or the inputs where these are fewer."""
    (nu, ny), count = shape, sum(map(_integrators, products))
    if limits.integral_gain is not None and count < min(shape):
        each = f"{ny} outputs" if ny <= nu else f"{nu} inputs"
        raise InputError(
            f"`structure` must hold an integrator for each of {each}, for their least gain to be large; got {count}"
        )


def _check_integral(products: Sequence[Sequence[Factor]], limits: Limits, goal: Goal, dt: float) -> None:
    """Integrators: one to a product at most, and one where its gain is asked for."""
    edge = 1.0 if dt else 0.0
    for factors in products:
        count = _integrators(factors)
        for one in _fixed(factors):
            poles = poles_of(one.A)
            near = _SAME * max(1.0 if dt else 0.0, np.abs(poles).max(initial=0.0))
            count += int(np.sum(np.abs(poles - edge) < near))
        if count > 1:
            raise InputError(f"`structure` must hold one integrator at most; got {count}. PID(integral=False) has none")
    free = sum(_integrators(factors) for factors in products)
    if free == 0 and (isinstance(goal, IntegralGain) or limits.integral_gain is not None):
        raise InputError("`structure` must hold an integrator for its gain to be large, such as PID()")


def _integrators(factors: Sequence[Factor]) -> int:
    return sum(isinstance(one, PID) and one.integral for one in factors)


def _check_cancelled(plants: Sequence[Plants], factors: Sequence[Factor]) -> None:
    """Unstable poles of the plant that known parts of the controller cancel, and the other way round."""
    for fixed in _fixed(factors):
        for one in plants:
            model, dt = one.model, one.dt
            for poles, zeros, whose in (
                (poles_of(model.A), zeros_of(fixed), "the plant"),
                (poles_of(fixed.A), zeros_of(model), "the fixed part"),
            ):
                bad = unstable_of(poles, dt)
                near = np.abs(bad[:, None] - zeros) < _SAME * np.abs(bad)[:, None]
                if near.any():
                    pole = bad[np.argmax(near.any(axis=1))]
                    raise InputError(
                        f"`structure` must not cancel an unstable pole: that of {whose} at {pole:.6g} stays in the loop,"
                        " where nothing controls it"
                    )


def _check_action(plants: Sequence[Plants], limits: Limits) -> None:
    """The least control where none is enough."""
    least = min((value for *_, value in limits.attenuation), default=math.inf)
    if least < 1 or limits.bandwidth is not None or limits.integral_gain is not None or limits.tracking:
        return
    if any(_exceeds(one, *row) for one in plants for row in limits.disturbance):
        return
    if all(loop_is_stable(poles_of(one.model.A), one.dt) for one in plants):
        got = "none" if math.isinf(least) else f"an attenuation of {least:g}, which is met without control"
        raise InputError(
            "`limits` must ask for action where the least control is sought, such as a bandwidth, an integral gain, an"
            f" attenuation below 1 or a disturbance below the plant, else C = 0 is the answer; got {got}"
        )


def _exceeds(plants: Plants, low: float, high: float, value: float) -> bool:
    """Return whether some consistent plant is larger than a value in a range: it answers a disturbance so without control."""
    discs = plants.discs(plants.grid())
    return bool(np.any(discs.largest[(discs.omega >= low) & (discs.omega <= high)] > value))
