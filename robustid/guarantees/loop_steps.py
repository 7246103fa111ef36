r"""step_tube(): steps of a loop with every consistent plant, between bounds that are proved at every sample.

From a step to an output the loop of :math:`R_0 + \Delta` differs by :math:`H_1 \Delta (I - m\Delta)^{-1} H_2` from that of R_0,
times :math:`1/(1 - z^{-1})`. Where the controller integrates :math:`H_1 = D + C (zI - A)^{-1} B` is 0 at z = 1 for every plant, and

.. math:: \frac{H_1}{1 - z^{-1}} = -z\, C (z I - A)^{-1} (I - A)^{-1} B

is stable: what is divided by zero at frequency 0 is gone. With a ball of centre c and radius r around all values on each arc the
difference at sample k is near :math:`\frac{1}{\pi} \operatorname{Re} \int_0^\pi c\, e^{jk\theta} d\theta`, by at most
:math:`\frac{1}{\pi} \int_0^\pi r\, d\theta`.
"""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from robustid.core import (
    Complex,
    Frozen,
    Real,
    StateMatrices,
    as_count,
    as_kind,
    decay_of,
    freeze,
    one_thread,
    poles_of,
    simulate,
)
from robustid.errors import InputError
from robustid.guarantees.cells import Pieces, enclose_judged
from robustid.guarantees.loop_axis import BandAxis
from robustid.guarantees.loop_bounds import LoopBounds
from robustid.guarantees.loop_values import Part, entries_over, image_over
from robustid.guarantees.tubes import response_tube
from robustid.identification import Identification

Asked = tuple[str, int, int]  # what steps, the output, and the set point or the input

STEPS = ("set point", "load")
_TOLERANCE = 0.02  # of the width: what arcs may take of it
_FEW = 50_000  # pieces of arc, beyond which the width is left as it is
_SETTLED, _LEAST, _MOST = 5.0, 40, 2000  # time constants of the slowest pole, and samples
_ZERO = 1e-9  # of a gain: what is 0 but for rounding
_ROUNDING = 1e-12


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class StepTube(Frozen):
    """The step of a loop with every consistent plant: lower <= y_k <= upper at every sample, both proved.

    Attributes
    ----------
    bounds : LoopBounds
    of : str
        "set point": a step of r, with u = C (r - y); "load": a step that is added to the input of the plant.
    entry : (int, int)
        Output, and the set point or the input that steps; the others are 0.
    times : (T,) array, s
    nominal : (T,) array
        With the plant of the model of the band.
    lower, upper : (T,) arrays
    """

    bounds: LoopBounds
    of: str
    entry: tuple[int, int]
    times: Real
    nominal: Real
    lower: Real
    upper: Real

    def __post_init__(self) -> None:
        self._set(**{name: freeze(getattr(self, name)) for name in ("times", "nominal", "lower", "upper")})

    @property
    def overshoot(self) -> float:
        """Largest value of any consistent plant beyond a set point of 1, at least 0; of others and of a load the largest size."""
        if self.of == "load" or self.entry[0] != self.entry[1]:
            return float(np.maximum(np.abs(self.lower), np.abs(self.upper)).max())
        return max(float(self.upper.max()) - 1.0, 0.0)

    def __repr__(self) -> str:
        return f"<StepTube: {self.of}, {self.times.size} samples, at most {self.upper.max():.4g}>"


def settled(poles: Complex, dt: float) -> int:
    """Samples until the slowest pole of a sampled loop has settled, within reason."""
    rate = decay_of(poles, dt) * dt
    return int(np.clip(_SETTLED / rate if rate > 0 else _LEAST, _LEAST, _MOST))


@one_thread()
def step_tube(
    bounds: LoopBounds,
    of: str = "set point",
    *,
    entry: tuple[int, int] = (0, 0),
    horizon: int | None = None,
    identification: Identification | None = None,
) -> StepTube:
    r"""Bounds of the step response of a loop with every plant that the data allow, proved at every sample.

    Of the discs of the band on the whole axis, by :math:`|\delta y_k| \le \frac{1}{\pi} \int_0^\pi |\delta Y| d\theta`: the width
    is the same at all samples, unless an `identification` narrows it.

    Parameters
    ----------
    bounds : LoopBounds
        Of a sampled loop whose controller integrates and is proved: of a design one of its `proofs`.
    of : {"set point", "load"}
        A step of 1 of r in u = C (r - y), or at the input of the plant.
    entry : (output, input), optional
        The output, and the set point or the input that steps.
    horizon : int, optional
        Number of samples. Default: until the loop with the model has settled.
    identification : Identification, optional
        Of the problem of the band, of one input and one output: the linear part of the difference is then bounded in the class
        itself, at up to 60 samples, a second or two each. That is narrower, above all where the response has settled.

    Returns
    -------
    StepTube

    Raises
    ------
    InputError
        A loop in continuous time, that is not proved, or without integral action: its final value is not known, and values at
        single frequencies bound no step then.

    Notes
    -----
    Phases of the errors at different frequencies are taken as independent, which those of a class are not: consistent plants come
    to about half of the width. Assumed: what the band assumes.

    Examples
    --------
    >>> import control, numpy as np, robustid as rid
    >>> from robustid.guarantee import step_tube
    >>> omega = np.linspace(0.5, 31.0, 30)
    >>> z = np.exp(0.1j * omega)
    >>> frf = rid.FrequencyResponse(omega, 0.1 / (z - 0.9), bound=0.01, dt=0.1)
    >>> problem = rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=4.0, decay_rate=1.08))
    >>> pi = control.ss(control.tf([2.0, -1.8], [1.0, -1.0], 0.1))
    >>> small = rid.balanced_truncation(rid.identify(problem).model, order=3).model
    >>> tube = step_tube(rid.loop_bounds(rid.band(problem, model=small), controller=pi))
    >>> loop = control.feedback(pi * control.tf([0.1], [1.0, -0.9], 0.1))
    >>> y = control.step_response(loop, tube.times).outputs
    >>> bool(np.all((tube.lower <= y) & (y <= tube.upper))), bool(np.ptp(tube.upper - tube.lower) < 1e-9)
    (True, True)
    """
    if of not in STEPS:
        raise InputError(f"`of` must be one of {STEPS}; got {of!r}")
    steps, dt = _steps_of(bounds, [(of, entry)]), bounds.loop.dt
    count = steps.settled if horizon is None else as_count("horizon", horizon, least=1)
    tube = steps.tube(bounds, (of, *entry), count)
    if identification is None:
        return tube
    found = as_kind("identification", identification, Identification, "an Identification")
    if not found.problem.entries.single:
        raise InputError("`identification` must be of one input and one output; leave it out for a matrix")
    samples, inner, outer = steps.narrowed(found, count)
    nominal = tube.nominal[samples]
    low, high = np.maximum(tube.lower[samples], nominal + inner), np.minimum(tube.upper[samples], nominal + outer)
    return dataclasses.replace(tube, times=dt * samples.astype(float), nominal=nominal, lower=low, upper=high)


@one_thread()
def step_tubes(bounds: LoopBounds) -> dict[Asked, StepTube]:
    """Ranges of the steps of every output after one of each set point and at each input, by what steps, output and input.

    All stand on the same pieces of arc.
    """
    nu, ny = as_kind("bounds", bounds, LoopBounds, "LoopBounds").loop.shape
    every = [(of, place) for of, count in zip(STEPS, (ny, nu), strict=True) for place in np.ndindex(ny, count)]
    steps = _steps_of(bounds, every)
    return {asked: steps.tube(bounds, asked, steps.settled) for asked in steps.asked}


def _integrals(values: Complex, pieces: Pieces, count: int) -> Real:
    r"""Real parts of the integrals of values (N,), each on its arc, times exp(j k theta) for k = 1, ..., count.

    That is :math:`c\, e^{jk\theta} 2 \sin(k h)/k` about the middle of an arc of half length h. With k = b + m all of them are two
    products of matrices: the exponential of a sum is a product, and its sine is ``sin b cos m + cos b sin m``.
    """
    size = math.isqrt(count - 1) + 1
    few: Real = np.arange(float(size))[:, None]
    first: Real = 1 + size * few
    turned = np.exp(1j * few * pieces.middle)
    begun: Complex = 2 * values * np.exp(1j * first * pieces.middle)
    found = (turned * np.cos(few * pieces.half)) @ (begun * np.sin(first * pieces.half)).T
    found += (turned * np.sin(few * pieces.half)) @ (begun * np.cos(first * pieces.half)).T
    return np.real(found).T.ravel()[:count] / np.arange(1, count + 1)


def _steps_of(bounds: LoopBounds, asked: Sequence[tuple[str, tuple[int, ...]]]) -> _Steps:
    """The questions, checked."""
    as_kind("bounds", bounds, LoopBounds, "LoopBounds, such as one of the proofs of a design")
    if not bounds.loop.dt:
        raise InputError(
            "`bounds` must be of a sampled loop; got continuous time: sample the plant as its controller runs"
        )
    if not bounds.guaranteed or bounds.unbounded:
        raise InputError(f"`bounds` must be proved at every frequency; got: {bounds.unbounded or bounds.status.value}")
    nu, ny = bounds.loop.shape
    every = list[Asked]()
    for of, entry in asked:
        sizes = ny, (ny if of == "set point" else nu)
        if len(entry) != 2 or not all(0 <= place < size for place, size in zip(entry, sizes, strict=True)):
            raise InputError(f"`entry` must be (output, {of}) of {sizes[0]} and {sizes[1]}, from 0; got {entry}")
        every.append((of, *entry))
    controller = None if bounds.stability is None else bounds.loop.as_controller(bounds.controller)
    model = bounds.band.model
    if model is None:
        raise InputError("`bounds` must be of a band about a model")
    around = bounds.loop.about(StateMatrices.of(model), controller)
    return _Steps(BandAxis(bounds.band), around, (nu, ny), tuple(every))


@dataclasses.dataclass(frozen=True)
class _Steps:
    """Steps of all plants: that of the model at samples, and the difference of the others from it."""

    axis: BandAxis
    around: StateMatrices  # from [r; e; d] to [u; y; x]
    shape: tuple[int, int]
    asked: tuple[Asked, ...]

    @property
    def settled(self) -> int:
        """Samples until the loop with the model has settled."""
        return settled(poles_of(self.around.A), float(self.axis.band.problem.dt or 0.0))

    @property
    def _inner(self) -> tuple[slice, slice]:
        """Rows of x, and columns of e."""
        nu, ny = self.shape
        return slice(nu + ny, None), slice(nu, nu + ny)

    def _place(self, asked: Asked) -> tuple[int, int]:
        """Row of the output, and column of what steps: a set point stands where d does."""
        nu, ny = self.shape
        of, i, j = asked
        return nu + i, j + (nu + ny if of == "set point" else 0)

    @functools.cached_property
    def _lines(self) -> tuple[list[int], list[int]]:
        """Rows and columns of all that is asked."""
        rows, columns = zip(*map(self._place, self.asked), strict=True)
        return sorted(set(rows)), sorted(set(columns))

    def tube(self, bounds: LoopBounds, asked: Asked, count: int) -> StepTube:
        """The range of one step at samples."""
        nominal, (centre, width) = self.nominal(asked, count), self.difference(asked, count)
        of, *entry = asked
        return StepTube(
            bounds=bounds,
            of=of,
            entry=(entry[0], entry[1]),
            times=bounds.loop.dt * np.arange(count, dtype=float),
            nominal=nominal,
            lower=nominal + (centre - width),
            upper=nominal + (centre + width),
        )

    def nominal(self, asked: Asked, count: int) -> Real:
        """The step with the model; a set point has the other sign: then the output is y - r."""
        row, column = self._place(asked)
        u = np.zeros((count, self.around.B.shape[1]))
        u[:, column] = 1.0
        found = simulate(self.around, u)[0][:, row]
        of, i, j = asked
        return float(i == j) - found if of == "set point" else found

    def difference(self, asked: Asked, count: int) -> tuple[Real, float]:
        """Centre at every sample, and how far from it the difference of any plant may be."""
        pieces, _, (centres, radii) = self.arcs
        row, column = self._place(asked)
        rows, columns = self._lines
        at = rows.index(row), columns.index(column)
        c, radius = centres[:, *at], radii[:, *at]
        wide: Real = 2 * pieces.half
        width = float(wide @ radius) / np.pi
        if not np.isfinite(width):
            raise InputError("`bounds` must be proved at every frequency; got a loop that may be singular on an arc")
        centre = _integrals(c, pieces, count) / np.pi if c.any() else np.zeros(count)
        return self._sign(asked) * centre, width + _ROUNDING * float(wide @ (np.abs(c) + radius))

    def narrowed(self, identification: Identification, count: int) -> tuple[NDArray[np.intp], Real, Real]:
        """Samples, and bounds of the difference there whose linear part is that of the consistent set, at single outputs.

        ``H_1 Delta H_2`` of a step is the response of Delta to a known input; the rest is ``H_1 m Delta^2 / (1 - m Delta) H_2``.
        """
        (asked,), (x, e) = self.asked, self._inner
        row, column = self._place(asked)
        u = np.zeros((count, self.around.B.shape[1]))
        u[:, column] = 1.0
        given = np.zeros(u.shape)
        given[:, e] = simulate(self.around, u)[0][:, x]
        known = simulate(self.around, given)[0][:, row]
        tube = response_tube(identification, input=known, model=self.axis.band.model)
        pieces, parts, _ = self.arcs
        left, right, inner = ((np.abs(values) + reach)[:, 0, 0] for values, reach in parts)
        b = self.axis.bounds(pieces)[:, 0, 0]
        room = 1 - inner * b
        rest = np.where(room > 0, left * right * inner * b**2 / np.where(room > 0, room, 1.0), np.inf)
        width = float(2 * pieces.half @ rest) / np.pi  # infinite: nothing is narrowed
        sign = self._sign(asked)
        low, high = sorted((sign * (tube.lower - tube.nominal), sign * (tube.upper - tube.nominal)), key=np.sum)
        return tube.samples, low - width, high + width

    @staticmethod
    def _sign(asked: Asked) -> float:
        """The set point is a disturbance of the other sign."""
        return -1.0 if asked[0] == "set point" else 1.0

    @functools.cached_property
    def arcs(self) -> tuple[Pieces, tuple[Part, Part, Part], tuple[Complex, Real]]:
        """Pieces of arc, on each what is before and behind Delta and around it, but for a factor z, and what holds all differences.

        Before Delta are all outputs, behind it is all that steps, (N, rows, columns).
        """
        (x, e), (rows, columns) = self._inner, self._lines
        A, B, C, D = self.around
        _, ny = self.shape
        back = np.asarray(np.linalg.solve(np.eye(len(A)) - A, B[:, e]), dtype=float)
        last = D[rows, e] + C[rows] @ back
        if np.any(np.abs(last) > _ZERO * (1 + np.abs(C[rows]) @ np.abs(back))):
            raise InputError(
                "`bounds` must be of a controller that integrates: else the final value of a step is another one with every plant,"
                " and values at single frequencies bound no step"
            )
        Q, R = len(columns), len(rows)
        system = StateMatrices(
            A,
            np.hstack([B[:, columns], B[:, e], back]),
            np.vstack([-C[rows], C[x]]),
            np.vstack([np.zeros((R, Q + 2 * ny)), np.hstack([D[x][:, columns], D[x, e], 0 * D[x, e]])]),
        )
        model, lost, angles, _ = self.axis.arcs_of(system)
        mean, count = np.zeros(0), 0

        def parts(pieces: Pieces, reach: Real) -> tuple[Part, Part, Part]:
            def part(rows: slice, columns: slice) -> Part:
                return pieces.values[:, rows, columns], reach[:, rows, columns]

            outputs, others = slice(0, R), slice(R, None)
            return (part(outputs, slice(Q + ny, None)), part(others, slice(0, Q)), part(others, slice(Q, Q + ny)))

        def judge(pieces: Pieces) -> tuple[NDArray[np.bool_], Real]:
            nonlocal mean, count
            _, middle = self._discs(pieces, parts(pieces, 0.0 * pieces.radius))
            centre, arc = self._discs(pieces, parts(pieces, pieces.radius + lost))
            mean = mean if mean.any() else np.einsum("nrq,n->rq", middle, pieces.half) / np.pi
            count += len(middle)
            more = (arc > middle + _TOLERANCE * np.maximum(middle, mean)) & np.isfinite(middle)
            halved = np.any(more, axis=(1, 2)) & np.any(pieces.radius > lost, axis=(1, 2)) & (count < _FEW)
            return halved, np.stack([centre.real, centre.imag, arc], axis=1)

        pieces, found = enclose_judged(model, angles, judge)
        return pieces, parts(pieces, pieces.radius + lost), (found[:, 0] + 1j * found[:, 1], found[:, 2])

    def _discs(self, pieces: Pieces, parts: tuple[Part, Part, Part]) -> tuple[Complex, Real]:
        """Centres and radii of discs that hold the entries of all differences, (N, rows, columns)."""
        (left, right, inner), errors = parts, self.axis.errors(pieces)
        if self.shape != (1, 1):
            radius = entries_over(left, right, inner, errors.bound)
            return np.zeros(radius.shape, complex), radius
        every = [
            image_over(left, (right[0][:, :, [k]], right[1][:, :, [k]]), inner, errors)
            for k in range(right[0].shape[2])
        ]
        centres: Complex = np.concatenate([one.centre for one in every], axis=2)
        return centres, np.stack([one.radius for one in every], axis=1)[:, None, :]
