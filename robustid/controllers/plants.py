"""Plants that a controller is designed for: values of all consistent ones at frequencies, and proofs on the whole axis."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from robustid.controllers.discs import Discs
from robustid.controllers.images import Chart, discs_of_entry, smallest_sets
from robustid.controllers.limits import Limits, Template
from robustid.controllers.matrix_images import Quotients, discs_of_matrices
from robustid.core import (
    Complex,
    Real,
    Response,
    StateMatrices,
    closed_loop,
    decay_of,
    loop_is_stable,
    norms,
    points_of,
    poles_of,
    response_at,
)
from robustid.errors import InputError, InputTypeError
from robustid.guarantees import Balls, Band, BandAxis, LoopBounds, LoopValues, loop_bounds, norm_of_bounds
from robustid.identification import Loop
from robustid.reduction import balanced_truncations

if TYPE_CHECKING:
    import control

    from robustid.guarantees import Pieces

_POINTS = 100  # frequencies that a design begins with, equally apart on a logarithmic axis
_CHANGE, _HALVED, _MOST = 0.2, 8, 600  # of the plant from one to the next; rounds of halving, and frequencies at most
_BELOW = 30.0  # times the lowest frequency of the data: where the axis begins
_PARTS = (0.25, 0.5, 1.0, 2.0, 4.0)  # of the ratio of two norms, which weighs them
_FEW, _SHARE = 4, 0.03  # states that a truncation begins with, and what it may add to the bounds
_ROUNDING = 1e-9  # of the end of an interval
_HALF = 0.5  # the real part of S up to which |L| is at least 1
_BANDWIDTH = Template("bandwidth", "sensitivity", least=True)
_LITTLE = 1e-9  # of the bounds of the largest input: smaller ones are as good as none


@dataclasses.dataclass(frozen=True)
class Plants:
    """All plants that one band allows, measured in open loop or in the loop of a controller."""

    band: Band
    loop: Loop

    @classmethod
    def of(cls, given: object) -> Plants:
        """The plants of a band about a model, or of the worst cases of a loop."""
        if isinstance(given, LoopBounds):
            return cls(_about_fewer_states(given.band), given.loop)
        if not isinstance(given, Band):
            raise InputTypeError(
                f"`bands` must be a Band, or LoopBounds of a plant in a loop, or a sequence of them; got {type(given).__name__}"
            )
        if given.model is None:
            raise InputError("`bands` must be about models; use band.with_model(result.model)")
        import control

        ny, nu = given.model.D.shape
        loop = Loop(control.ss([], [], [], np.zeros((nu, ny)), given.problem.dt or 0))
        return cls(_about_fewer_states(given), loop)

    @property
    def dt(self) -> float:
        """Sample time in s; 0 in continuous time."""
        return self.loop.dt

    @functools.cached_property
    def in_open_loop(self) -> bool:
        """True of a plant that was measured without a controller."""
        return self.loop.auxiliary is None and not self.loop.as_controller(self.loop.controller).D.any()

    @functools.cached_property
    def model(self) -> StateMatrices:
        """The plant of the model of the band."""
        return StateMatrices.of(self.loop.plant_of(self._nominal))

    @functools.cached_property
    def _response(self) -> Response:
        """The plant of the model, or the open loop about the model of the band: asked at many frequencies, many times."""
        if self.in_open_loop:
            return Response(self.model)
        nu, ny = self.loop.shape
        nothing = StateMatrices(np.zeros((0, 0)), np.zeros((0, ny)), np.zeros((nu, 0)), np.zeros((nu, ny)))
        return Response(self.loop.about(StateMatrices.of(self._nominal), nothing))

    @property
    def _nominal(self) -> control.StateSpace:
        model = self.band.model
        if model is None:
            raise InputError("`bands` must be about models")
        return model

    def grid(self) -> Real:
        """Frequencies to begin with: spread, and closer where a column of the plant changes fast."""
        edges, sets = self.band.circle.edges, self.band.circle.sets
        _check_bounded(edges[:-1], np.minimum(sets.bound, sets.radius).max(axis=(1, 2)))
        known = edges[(edges > 0) & np.isfinite(edges)]
        low = max(float(known[0]), float(self.band.omega[self.band.omega > 0].min()) / _BELOW)
        top = math.pi / self.dt if self.dt else float(known[-1])
        omega = np.geomspace(low, top, _POINTS)
        for _ in range(_HALVED):
            discs = self.discs(omega)
            change, size = np.linalg.norm(np.diff(discs.plant, axis=0), axis=1), discs.columns
            far = np.any(change > _CHANGE * np.minimum(size[1:], size[:-1]), axis=1)
            if not far.any() or omega.size > _MOST:
                break
            omega = np.sort(np.concatenate([omega, np.sqrt(omega[1:] * omega[:-1])[far]]))
        return omega

    def discs(self, omega: Real, smaller: Real | None = None) -> Discs:
        """Discs and polygons that hold the values of all consistent plants at frequencies: those of the proof on arcs.

        `smaller`: factors of the errors, (F,). Of fewer inputs than outputs those of the transposed plants: C P is that of P^T C^T.
        """
        factor = np.ones(omega.size) if smaller is None else smaller
        errors, around = self.band.circle.sets_at(omega), self.open_loop(omega)
        if self.loop.shape == (1, 1):
            slope = around.part("y", "e")[0] * around.part("x", "r")[0]
            parts = (around.part("y", "r")[0], slope, around.part("x", "e")[0])
            found = discs_of_entry(omega, Chart(*(one[:, 0, 0] for one in parts)), smallest_sets(errors, factor))
        else:
            _check_bounded(omega, errors.bound.max(axis=(1, 2)))
            ball = around.balls(errors.bound * factor[:, None, None])["process_sensitivity"].radius
            found = discs_of_matrices(omega, self._quotients(omega, around, errors.bound), ball, factor)
        _check_bounded(omega, found.radius * found.units.max(axis=1))
        return found

    @property
    def turned(self) -> bool:
        """True of fewer inputs than outputs: the transposed plant is what a controller is designed for."""
        nu, ny = self.loop.shape
        return nu < ny

    def _quotients(self, omega: Real, around: LoopValues, bound: Real) -> Quotients:
        """Values about the model, how they depend on the errors, and what the controller that ran makes of it."""
        parts = [around.part(*one)[0] for one in (("y", "r"), ("y", "e"), ("x", "r"), ("x", "e"))]
        value, left, right, inner = parts
        running = np.zeros((omega.size, *self.loop.shape), complex)
        if not self.in_open_loop:
            running = self.running(omega)
        if not self.turned:
            return Quotients(value, left, right, inner, bound, running)
        value, left, right, inner, bound, running = (
            one.swapaxes(1, 2) for one in (value, right, left, inner, bound, running)
        )
        return Quotients(value, left, right, inner, bound, running)

    def open_loop(self, omega: Real) -> LoopValues:
        """Values about the model of the loop without a controller."""
        values, shape = self._response.at(points_of(omega, self.dt)), self.loop.shape
        if not self.in_open_loop:
            return LoopValues.at(values, shape)
        (nu, ny), count = shape, omega.size
        one, other = (np.broadcast_to(np.eye(k, dtype=complex), (count, k, k)) for k in (nu, ny))
        none, far = np.zeros((count, nu, 2 * ny)), np.concatenate([other, other], axis=2)
        rows = [[one, none], [values, far], [one, none]]
        every = np.concatenate([np.concatenate(row, axis=2) for row in rows], axis=1)
        return LoopValues.at(np.asarray(every, dtype=complex), shape)

    def running(self, omega: Real) -> Complex:
        """Values of the controller that ran, which stabilises all of them, (F, nu, ny)."""
        return response_at(self.loop.as_controller(self.loop.controller), points_of(omega, self.dt))

    def is_stable_with(self, controller: control.StateSpace) -> bool:
        """Say whether a controller stabilises the model."""
        poles = poles_of(closed_loop(self.model, self.loop.as_controller(controller)).A)
        return loop_is_stable(poles, self.dt)

    def proved(self, controller: control.StateSpace) -> LoopBounds:
        """Worst cases of a controller over all plants, on the whole axis."""
        return loop_bounds(self.band, self.loop, controller)

    def shares(self, controller: control.StateSpace, limits: Limits) -> dict[str, tuple[float, float]]:
        """Largest share of every template and of the bandwidth that any consistent plant takes, on the whole axis; and where."""
        rows = list(limits.rows)
        if limits.bandwidth is not None:
            rows.append((_BANDWIDTH, 0.0, limits.bandwidth, 1.0))
        if not rows:
            return {}
        around = self.loop.about(StateMatrices.of(self._nominal), self.loop.as_controller(controller))
        axis = BandAxis(self.band, np.array([end for _, *ends, _ in rows for end in ends if end > 0]))

        def sizes(pieces: Pieces, reach: Real, low: Real, high: Real) -> Real:
            values, errors = LoopValues(pieces.values, reach, self.loop.shape), axis.errors(pieces)
            return np.minimum.reduce([of(balls, values, errors.bound, low, high) for balls in values.over(errors)])

        def of(balls: Mapping[str, Balls], values: LoopValues, bounds: Real, low: Real, high: Real) -> Real:
            found: list[Real] = []
            for template, begin, end, value in rows:
                here = (high > begin * (1 + _ROUNDING)) & (low < end * (1 - _ROUNDING))
                if template is _BANDWIDTH:  # sigma_min(L) >= 1: the Hermitian part of S is at most 1/2
                    S = balls["sensitivity"]
                    real = (S.centre + S.centre.conj().swapaxes(1, 2)) / 2
                    size = (np.linalg.eigvalsh(real)[:, -1] + S.radius) / _HALF
                    if min(self.loop.shape) == 1:
                        size = largest_reciprocal(S.centre[:, 0, 0], S.radius)
                    if self.in_open_loop and self.loop.shape != (1, 1):
                        size = np.minimum(size, _closed_share(values, bounds, self.turned))
                else:
                    size = template.share(balls[template.map], value)
                found.append(np.where(here, np.maximum(size, 0.0), 0.0))
            return np.stack(found, axis=1)

        share, omega = axis.largest(around, sizes, np.zeros(len(rows)), top=max(end for _, _, end, _ in rows))
        found: dict[str, tuple[float, float]] = {}
        for (template, *_), one, where in zip(rows, share.tolist(), omega.tolist(), strict=True):
            if one >= found.get(template.name, (0.0, 0.0))[0]:
                found[template.name] = one, where
        return found


def _check_bounded(omega: Real, size: Real) -> None:
    """Refuse plants of which nothing is known at a frequency."""
    if not np.all(np.isfinite(size)):
        first = float(omega[np.argmin(np.isfinite(size))])
        raise InputError(
            f"`bands` must be bounded at every frequency; at {first:.5g} rad/s nothing is known of the plant. Measure there, or"
            " state a class that is bounded there"
        )


def _about_fewer_states(band: Band) -> Band:
    """The band about a truncated model, where that hardly widens it: a central model has a state for every sample."""
    model, wide = band.model, norm_of_bounds(band.upper)
    if model is None or decay_of(poles_of(StateMatrices.of(model).A), band.problem.dt or 0.0) <= 0:
        return band
    truncated, order = balanced_truncations(model), _FEW
    while order < model.nstates / 2:
        small = band.with_model(truncated(order).model)
        if np.all(norm_of_bounds(small.upper) <= (1 + _SHARE) * wide):
            return small
        order += order // 2
    return band


def _closed_parts(
    values: LoopValues, bounds: Real, turned: bool
) -> tuple[tuple[Complex, Real], tuple[Complex, Real], Real]:
    """S and C S about the model with what holds around them, and the bounds; `turned`: of the transposed plants."""
    if not turned:
        return values.part("y", "d"), values.part("x", "d"), bounds
    (S, far), (CS, away) = values.part("u", "r"), values.part("u", "d")
    return (S.swapaxes(1, 2), far.swapaxes(1, 2)), (CS.swapaxes(1, 2), away.swapaxes(1, 2)), bounds.swapaxes(1, 2)


def _closed_share(values: LoopValues, bounds: Real, turned: bool) -> Real:
    r"""A number that is at most 1 only where the smallest singular value of L is at least 1 for all plants in open loop, (N,).

    With ``L = (T + \Delta C S) S^{-1}`` about the model it is where :math:`\|T v\| - \|S v\| - r \|D C S v\| \ge 0` for all v, with
    ``|Delta| <= r D``; that is at least the smallest eigenvalue of
    :math:`T^* T - (1 + \tau) S^* S - (1 + 1/\tau) r^2 (D C S)^* D C S`, for any positive tau, over the sum of the three norms. Of
    one row the entries of Delta C S are added, which is exact. `turned`: of the transposed plants, whose L is that of C P.
    """
    (S, far), (CS, away), errors = _closed_parts(values, bounds, turned)
    if S.shape[1] == 1:
        added = np.sum(errors[:, 0] * (np.abs(CS) + away)[:, :, 0], axis=1) + far[:, 0, 0]
        least = np.abs(1 - S[:, 0, 0]) - added
        return (np.abs(S) + far)[:, 0, 0] / np.maximum(least, np.finfo(float).tiny)
    units = np.linalg.norm(errors, axis=1)
    units = np.maximum(units, _LITTLE * units.max(axis=1, keepdims=True) + np.finfo(float).tiny)
    reach = norm_of_bounds(errors / units[:, None])[:, None, None] * units[:, :, None]
    T, given = np.eye(S.shape[1]) - S, reach * CS
    sizes = norms(S), norms(given)
    squares = [one.conj().swapaxes(1, 2) @ one for one in (T, S, given)]
    least = np.full(len(S), -np.inf)
    for factor in _PARTS:
        tau = np.maximum(factor * sizes[1] / np.maximum(sizes[0], np.finfo(float).tiny), _LITTLE)[:, None, None]
        whole = squares[0] - (1 + tau) * squares[1] - (1 + 1 / tau) * squares[2]
        least = np.maximum(least, np.linalg.eigvalsh(whole)[:, 0])
    left = least / (norms(T) + sizes[0] + sizes[1])
    return 1 - left + 2 * norms(far) + norms(reach * away)


def largest_reciprocal(centre: Complex, radius: Real) -> Real:
    r"""Largest :math:`1/|L|` where S = 1/(1 + L) is in a disc: infinite where L may be 0.

    The inverse of the disc is a disc of 1 + L, or the outside of one where the disc holds 0.
    """
    room = np.abs(centre) ** 2 - radius**2
    with np.errstate(divide="ignore", invalid="ignore"):
        far = np.abs(centre.conj() / room - 1)
        least = np.where(room > 0, far - radius / room, radius / -room - far)
        least = np.where(room == 0, -np.inf, least)
        return np.where(np.isfinite(radius) & (least > 0), 1 / least, np.inf)
