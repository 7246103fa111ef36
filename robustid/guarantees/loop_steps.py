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
from robustid.guarantees.cells import Pieces, enclose
from robustid.guarantees.loop_axis import BandAxis
from robustid.guarantees.loop_bounds import LoopBounds
from robustid.guarantees.loop_values import Part, image_over
from robustid.guarantees.tubes import response_tube
from robustid.identification import Identification

STEPS = ("set point", "load")
_TOLERANCE = 0.02  # of the width: what arcs may take of it
_FEW = 50_000  # pieces of arc, beyond which the width is left as it is
_SETTLED, _LEAST, _MOST = 5.0, 40, 2000  # time constants of the slowest pole, and samples
_ZERO = 1e-9  # of a gain: what is 0 but for rounding
_ROUNDING = 1e-12
_AT_ONCE = 2_000_000  # terms of all samples at once


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
    as_kind("bounds", bounds, LoopBounds, "LoopBounds, such as one of the proofs of a design")
    if of not in STEPS:
        raise InputError(f"`of` must be one of {STEPS}; got {of!r}")
    if not bounds.loop.dt:
        raise InputError(
            "`bounds` must be of a sampled loop; got continuous time: sample the plant as its controller runs"
        )
    if not bounds.guaranteed or bounds.unbounded:
        raise InputError(f"`bounds` must be proved at every frequency; got: {bounds.unbounded or bounds.status.value}")
    steps, dt = _steps_of(bounds, of, entry), bounds.loop.dt
    count = settled(poles_of(steps.around.A), dt) if horizon is None else as_count("horizon", horizon, least=1)
    nominal, (centre, width) = steps.nominal(count), steps.difference(count)
    samples, low, high = np.arange(count), centre - width, centre + width
    if identification is not None:
        samples, inner, outer = steps.narrowed(_as_one_entry(identification), count)
        low, high = np.maximum(low[samples], inner), np.minimum(high[samples], outer)
    return StepTube(
        bounds=bounds,
        of=of,
        entry=entry,
        times=dt * samples.astype(float),
        nominal=nominal[samples],
        lower=nominal[samples] + low,
        upper=nominal[samples] + high,
    )


def _as_one_entry(identification: object) -> Identification:
    """The identification of a problem of one input and one output."""
    found = as_kind("identification", identification, Identification, "an Identification")
    if not found.problem.entries.single:
        raise InputError("`identification` must be of one input and one output; leave it out for a matrix")
    return found


def _steps_of(bounds: LoopBounds, of: str, entry: tuple[int, int]) -> _Steps:
    """The question, checked."""
    nu, ny = bounds.loop.shape
    sizes = ny, (ny if of == "set point" else nu)
    if len(entry) != 2 or not all(0 <= place < size for place, size in zip(entry, sizes, strict=True)):
        raise InputError(f"`entry` must be (output, {of}) of {sizes[0]} and {sizes[1]}, from 0; got {entry}")
    controller = None if bounds.stability is None else bounds.loop.as_controller(bounds.controller)
    model = bounds.band.model
    if model is None:
        raise InputError("`bounds` must be of a band about a model")
    around = bounds.loop.about(StateMatrices.of(model), controller)
    return _Steps(BandAxis(bounds.band), around, (nu, ny), of, entry)


@dataclasses.dataclass(frozen=True)
class _Steps:
    """Steps of all plants: that of the model at samples, and the difference of the others from it."""

    axis: BandAxis
    around: StateMatrices  # from [r; e; d] to [u; y; x]
    shape: tuple[int, int]
    of: str
    entry: tuple[int, int]

    @property
    def _places(self) -> tuple[int, slice, slice, int]:
        """Rows of the output and of x, columns of e and of what steps."""
        nu, ny = self.shape
        column = self.entry[1] + (nu + ny if self.of == "set point" else 0)
        return nu + self.entry[0], slice(nu + ny, None), slice(nu, nu + ny), column

    def nominal(self, count: int) -> Real:
        """The step with the model; a set point stands where d does, with the other sign: then the output is y - r."""
        row, _, _, column = self._places
        u = np.zeros((count, self.around.B.shape[1]))
        u[:, column] = 1.0
        found = simulate(self.around, u)[0][:, row]
        return float(self.entry[0] == self.entry[1]) - found if self.of == "set point" else found

    def difference(self, count: int) -> tuple[Real, float]:
        """Centre at every sample, and how far from it the difference of any plant may be."""
        pieces, parts = self.arcs
        balls = image_over(*parts, self.axis.errors(pieces))
        wide: Real = 2 * pieces.half
        width = float(wide @ balls.radius) / np.pi
        if not np.isfinite(width):
            raise InputError("`bounds` must be proved at every frequency; got a loop that may be singular on an arc")
        c, centre, k = balls.centre[:, 0, 0], np.zeros(count), np.arange(1, count + 1)  # times z: one sample later
        step = max(1, _AT_ONCE // c.size)
        for first in range(0, count if c.any() else 0, step):
            some = k[first : first + step, None]
            parts = np.real(c * np.exp(1j * some * pieces.middle)) * (2 * np.sin(some * pieces.half) / some)
            centre[first : first + step] = parts.sum(axis=1) / np.pi
        return self.sign * centre, width + _ROUNDING * float(wide @ (np.abs(c) + balls.radius))

    def narrowed(self, identification: Identification, count: int) -> tuple[NDArray[np.intp], Real, Real]:
        """Samples, and bounds of the difference there whose linear part is that of the consistent set, at single outputs.

        ``H_1 Delta H_2`` of a step is the response of Delta to a known input; the rest is ``H_1 m Delta^2 / (1 - m Delta) H_2``.
        """
        row, x, e, column = self._places
        u = np.zeros((count, self.around.B.shape[1]))
        u[:, column] = 1.0
        given = np.zeros(u.shape)
        given[:, e] = simulate(self.around, u)[0][:, x]
        known = simulate(self.around, given)[0][:, row]
        tube = response_tube(identification, input=known, model=self.axis.band.model)
        pieces, parts = self.arcs
        left, right, inner = ((np.abs(values) + reach)[:, 0, 0] for values, reach in parts)
        b = self.axis.bounds(pieces)[:, 0, 0]
        room = 1 - inner * b
        rest = np.where(room > 0, left * right * inner * b**2 / np.where(room > 0, room, 1.0), np.inf)
        width = float(2 * pieces.half @ rest) / np.pi  # infinite: nothing is narrowed
        low, high = sorted(
            (self.sign * (tube.lower - tube.nominal), self.sign * (tube.upper - tube.nominal)), key=np.sum
        )
        return tube.samples, low - width, high + width

    @property
    def sign(self) -> float:
        """The set point is a disturbance of the other sign."""
        return -1.0 if self.of == "set point" else 1.0

    @functools.cached_property
    def arcs(self) -> tuple[Pieces, tuple[Part, Part, Part]]:
        """Pieces of arc, and on each what is before and behind Delta and around it, but for a factor z."""
        row, x, e, column = self._places
        A, B, C, D = self.around
        _, ny = self.shape
        back = np.asarray(np.linalg.solve(np.eye(len(A)) - A, B[:, e]), dtype=float)
        last = D[row, e] + C[row] @ back
        if np.any(np.abs(last) > _ZERO * (1 + np.abs(C[row]) @ np.abs(back))):
            raise InputError(
                "`bounds` must be of a controller that integrates: else the final value of a step is another one with every plant,"
                " and values at single frequencies bound no step"
            )
        system = StateMatrices(
            A,
            np.hstack([B[:, [column]], B[:, e], back]),
            np.vstack([-C[[row]], C[x]]),
            np.vstack([np.zeros((1, 1 + 2 * ny)), np.hstack([D[x, [column]], D[x, e], 0 * D[x, e]])]),
        )
        model, lost, angles, _ = self.axis.arcs_of(system)
        mean, count = 0.0, 0

        def parts(pieces: Pieces, reach: Real) -> tuple[Part, Part, Part]:
            def part(rows: slice, columns: slice) -> Part:
                return pieces.values[:, rows, columns], reach[:, rows, columns]

            one, others = slice(0, 1), slice(1, None)
            return part(one, slice(1 + ny, None)), part(others, one), part(others, slice(1, 1 + ny))

        def radius(pieces: Pieces, reach: Real) -> Real:
            return image_over(*parts(pieces, reach), self.axis.errors(pieces)).radius

        def coarse(pieces: Pieces) -> NDArray[np.bool_]:
            nonlocal mean, count
            middle, arc = radius(pieces, 0.0 * pieces.radius), radius(pieces, pieces.radius + lost)
            mean = mean or float(middle @ pieces.half) / np.pi
            count += arc.size
            more = (arc > middle + _TOLERANCE * np.maximum(middle, mean)) & np.isfinite(middle)
            return more & np.any(pieces.radius > lost, axis=(1, 2)) & (count < _FEW)

        pieces = enclose(model, angles, coarse)
        return pieces, parts(pieces, pieces.radius + lost)
