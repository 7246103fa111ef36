"""Measured frequency responses with the bounds on their errors."""

from __future__ import annotations

import dataclasses
import operator
from typing import Any

import numpy as np

from robustid._arrays import Channel, Frozen, as_array, as_bound, as_channels, as_float, as_positive, freeze
from robustid.data.ellipses import as_tilt, ellipse_of
from robustid.errors import InputError, InputTypeError

# Above pi/dt by a rounding error only: a grid that ends at the Nyquist frequency is legitimate.
_NYQUIST_SLACK = 1 + 1e-12
_ENTRIES = ("values", "bound", "tilt", "noise", "distortion")  # one number per line and entry of the matrix
BOUND_KINDS = ("hard", "rest", "statistical")


@dataclasses.dataclass(frozen=True, eq=False)
class FrequencyResponse(Frozen):
    """Samples of a frequency response, each in a complex disc (or ellipse) of known size.

    ``values[k] = F(exp(1j*omega[k]*dt)) + e``, ``|e| <= bound[k]``, entry by entry (engineer's convention;
    ``F(1j*omega[k])`` where `dt` is None).

    Parameters
    ----------
    omega : (F,) array, rad/s
        Frequencies, >= 0, at most pi/dt; sorted on entry together with what belongs to them. One frequency
        may come several times (repeated measurements).
    values : (F,) or (F, ny, nu) complex array
        Response in output units per input unit. Frequency is the first axis; nothing is ever transposed.
    bound : scalar, (F,) or (F, ny, nu) array, optional
        Radius of the disc around each value.
    tilt : (F,) or (F, ny, nu) complex array, optional
        Makes the disc an ellipse, ``|e + tilt conj(e)| <= bound`` with ``|tilt| < 1``: semi-axes bound/(1 + |tilt|), in the
        direction arg(tilt)/2, and bound/(1 - |tilt|), across. `with_ellipses` takes it from covariances.
    covariance : (F, ny*nu, ny*nu) complex array, optional
        E[e e^H] of vec(values[k]) (columns stacked), of the estimate itself: E|e|^2, not per real part.
    dt : float, optional
        Sample time in s; None for continuous time.
    inputs, outputs : sequence of str or (name, unit), optional
        Channel names and units; ``"current [A]"`` is split.
    note : str, optional
        Where the bound comes from, for reports.
    bound_kind : {"hard", "rest", "statistical"}
        What the bound is: a statement of the user's that holds always; estimated from a record without excitation; or one that
        holds for all lines and entries at once with `probability`.
    probability : float, optional
        Of a statistical bound.
    dof : float, optional
        Degrees of freedom of `covariance`: how many independent residuals it was estimated from.
    coherence : (F, ny) array, optional
        Multiple coherence: the part of the power of each output that the inputs explain linearly, 0 to 1.
    noise : (F, ny, nu) array, optional
        Standard deviation of the values that noise alone causes.
    distortion : (F, ny, nu) array, optional
        Standard deviation of what changes with the realisation of the excitation beyond noise, in one realisation:
        stochastic nonlinear distortion.

    Raises
    ------
    InputError, InputTypeError
        On any wrong shape, NaN, negative bound, frequency above pi/dt.

    Examples
    --------
    >>> import robustid as rid
    >>> frf = rid.FrequencyResponse([10.0, 20.0], [1 - 0.1j, 0.9 - 0.3j], bound=0.02, dt=0.01)
    >>> frf
    <FrequencyResponse: 2 lines, 1.5915 to 3.1831 Hz, 1x1, bound, dt=0.01 s>
    >>> frf.values.shape, frf.bound.shape
    ((2, 1, 1), (2, 1, 1))
    """

    omega: np.ndarray
    values: np.ndarray
    _: dataclasses.KW_ONLY
    bound: Any = None
    tilt: Any = None
    covariance: Any = None
    dt: float | None = None
    inputs: Any = None
    outputs: Any = None
    note: str = ""
    bound_kind: str = "hard"
    probability: float | None = None
    dof: float | None = None
    coherence: Any = None
    noise: Any = None
    distortion: Any = None

    def __post_init__(self) -> None:
        omega = as_array("omega", self.omega, ndim=1)
        lines = omega.size
        if lines == 0:
            raise InputError("`omega` is empty; give at least one frequency")
        values = as_array("values", self.values, dtype=complex)
        if values.shape == (lines,):
            values = values.reshape(lines, 1, 1)
        if values.ndim != 3 or values.shape[0] != lines or 0 in values.shape:
            raise InputError(
                f"`values` must have shape (F,) or (F, ny, nu) with F = {lines} from `omega`; got {values.shape}"
            )
        ny, nu = values.shape[1:]
        if np.any(omega < 0):
            raise InputError(f"`omega` must be >= 0 (conjugate lines are implied); got {omega.min():g} rad/s")
        dt = None if self.dt is None else as_positive("dt", self.dt)
        if dt is not None and omega.max() * dt > np.pi * _NYQUIST_SLACK:
            raise InputError(
                f"`omega` must not exceed pi/dt = {np.pi / dt:g} rad/s; got {omega.max():g} rad/s."
                " Frequencies are in rad/s, not Hz; check `dt` too"
            )
        bound = as_bound(self.bound, values.shape, "F")
        tilt = as_tilt(self.tilt, values.shape, bound)
        covariance = None
        if self.covariance is not None:
            covariance = as_array("covariance", self.covariance, dtype=complex)
            if covariance.shape != (lines, ny * nu, ny * nu):
                raise InputError(
                    f"`covariance` must have shape (F, ny*nu, ny*nu) = {(lines, ny * nu, ny * nu)};"
                    f" got {covariance.shape}"
                )
        if not isinstance(self.note, str):
            raise InputTypeError(f"`note` must be text; got {type(self.note).__name__}")
        levels = {"coherence": (lines, ny), "noise": values.shape, "distortion": values.shape}
        levels = {name: _level(name, getattr(self, name), shape) for name, shape in levels.items()}
        order = np.argsort(omega, kind="stable")
        self._set(
            omega=freeze(omega[order]),
            values=freeze(values[order]),
            bound=None if bound is None else freeze(bound[order]),
            tilt=None if tilt is None else freeze(tilt[order]),
            covariance=None if covariance is None else freeze(covariance[order]),
            dt=dt,
            inputs=as_channels("inputs", self.inputs, nu, "u"),
            outputs=as_channels("outputs", self.outputs, ny, "y"),
            bound_kind=as_bound_kind(self.bound_kind),
            probability=None if self.probability is None else as_probability(self.probability),
            dof=None if self.dof is None else as_positive("dof", self.dof),
            **{name: None if level is None else freeze(level[order]) for name, level in levels.items()},
        )

    def __repr__(self) -> str:
        low, high = self.freq_hz[[0, -1]]
        parts = [f"{self.omega.size} lines, {low:.5g} to {high:.5g} Hz", f"{len(self.outputs)}x{len(self.inputs)}"]
        parts += [name for name in ("bound", "tilt", "covariance") if getattr(self, name) is not None]
        parts += [f"dt={self.dt:.6g} s"] if self.dt is not None else []
        return f"<FrequencyResponse: {', '.join(parts)}>"

    @property
    def freq_hz(self) -> np.ndarray:
        """Frequencies in Hz, (F,)."""
        return self.omega / (2 * np.pi)

    @property
    def inner_radius(self) -> np.ndarray:
        """Of the largest disc inside each bound, (F, ny, nu): the smaller semi-axis of an ellipse."""
        return self.bound if self.tilt is None else self.bound / (1 + np.abs(self.tilt))

    @property
    def outer_radius(self) -> np.ndarray:
        """Of the smallest disc around each bound, (F, ny, nu): the larger semi-axis of an ellipse."""
        return self.bound if self.tilt is None else self.bound / (1 - np.abs(self.tilt))

    def channel(self, output: int | str = 0, input: int | str = 0) -> FrequencyResponse:
        """One entry of the matrix, by index or channel name, still with shape (F, 1, 1)."""
        i, j = channel_index("output", output, self.outputs), channel_index("input", input, self.inputs)
        pick = (slice(None), slice(i, i + 1), slice(j, j + 1))
        flat = j * len(self.outputs) + i
        return dataclasses.replace(
            self,
            **{name: array[pick] for name in _ENTRIES if (array := getattr(self, name)) is not None},
            coherence=None if self.coherence is None else self.coherence[:, i : i + 1],
            covariance=None if self.covariance is None else self.covariance[:, flat, flat, None, None],
            inputs=(self.inputs[j],),
            outputs=(self.outputs[i],),
        )

    def select(self, lines: Any) -> FrequencyResponse:
        """Keep some lines: a boolean mask, indices or a slice along the frequency axis."""
        try:
            index = np.atleast_1d(np.arange(self.omega.size)[lines])
        except IndexError as error:
            raise InputError(f"`lines` doesn't select from {self.omega.size} lines: {error}") from None
        if index.size == 0:
            raise InputError(f"`lines` selects none of the {self.omega.size} lines")
        each = ("omega", *_ENTRIES, "coherence", "covariance")
        return dataclasses.replace(
            self, **{name: array[index] for name in each if (array := getattr(self, name)) is not None}
        )

    def band(self, low_hz: float, high_hz: float) -> FrequencyResponse:
        """Keep the lines with ``low_hz <= f <= high_hz``."""
        inside = (self.freq_hz >= low_hz) & (self.freq_hz <= high_hz)
        if not np.any(inside):
            raise InputError(
                f"no line lies between `low_hz` = {low_hz:g} and `high_hz` = {high_hz:g} Hz; the lines go"
                f" from {self.freq_hz[0]:g} to {self.freq_hz[-1]:g} Hz"
            )
        return self.select(inside)

    def with_bound(self, bound: Any, note: str = "") -> FrequencyResponse:
        """The same samples with a bound of your own, of the same tilt; it takes the place of any that was estimated."""
        return dataclasses.replace(self, bound=bound, note=note, bound_kind="hard", probability=None)

    def with_ellipses(self, covariance: Any, deviations: float, note: str = "") -> FrequencyResponse:
        """The same samples, each in the ellipse ``e'C^-1 e <= deviations^2`` with e = (Re e, Im e).

        Parameters
        ----------
        covariance : (F, 2, 2) real array
            C = E[e e'] of the real and the imaginary part at every line, in the order of `omega` here.
        deviations : float
            How many standard deviations the bound is.
        note : str, optional
            Where the bound comes from.

        Raises
        ------
        InputError
            Several channels, another shape, a matrix that isn't symmetric and positive definite.

        Examples
        --------
        >>> import robustid as rid
        >>> frf = rid.FrequencyResponse([10.0], [1 - 0.1j], dt=0.01)
        >>> frf = frf.with_ellipses([[[4e-4, 0.0], [0.0, 1e-4]]], deviations=3)
        >>> frf.inner_radius.round(9).item(), frf.outer_radius.round(9).item()
        (0.03, 0.06)
        """
        if self.values.shape[1:] != (1, 1):
            raise InputError(
                f"`with_ellipses` takes one channel at a time; this response has {len(self.outputs)} outputs and"
                f" {len(self.inputs)} inputs. Pick one entry with .channel(output, input)"
            )
        bound, tilt = ellipse_of(covariance, self.omega.size, as_positive("deviations", deviations))
        return dataclasses.replace(
            self, bound=bound, tilt=tilt, note=note or self.note, bound_kind="statistical", probability=None
        )

    def with_joint_bound(self, probability: float = 0.95) -> FrequencyResponse:
        """The same samples with the bound that holds for all lines and entries at once with this probability.

        From `covariance` and its `dof` (normal errors of known covariance where that is None), see `estimate_frf`.

        Examples
        --------
        >>> import robustid as rid
        >>> frf = rid.FrequencyResponse([10.0, 20.0], [1 - 0.1j, 0.5j], covariance=[[[1e-4]], [[4e-4]]], dt=0.01)
        >>> frf.with_joint_bound(0.95).bound.ravel().round(4)
        array([0.0192, 0.0384])
        """
        from robustid.data.frf_bounds import joint_radius, variances

        if self.covariance is None:
            raise InputError(
                "`with_joint_bound` needs the covariance of the response; give `covariance`, or with_bound(...)"
            )
        probability = as_probability(probability)
        real = (self.omega == 0) | (self.omega * (self.dt or 0.0) >= np.pi / _NYQUIST_SLACK)
        radius = joint_radius(probability, self.values.size, self.dof, real)
        return dataclasses.replace(
            self,
            bound=radius * np.sqrt(variances(self.covariance, self.values.shape)),
            tilt=None,
            note=f"statistical: joint {100 * probability:g} % over {self.omega.size} lines, from the covariance",
            bound_kind="statistical",
            probability=probability,
        )

    def without_delay(self, seconds: float) -> FrequencyResponse:
        """The response times exp(+j omega seconds): without a delay in front of the plant, of any fraction of a sample.

        Bounds turn with their values: discs stay as they are, ellipses keep their size. See `estimate_delay`, `with_delay`.

        Examples
        --------
        >>> import numpy as np, robustid as rid
        >>> frf = rid.FrequencyResponse([10.0], [2 * np.exp(-0.3j)], bound=0.1)
        >>> frf.without_delay(0.03).values.round(9).item()
        (2+0j)
        """
        turn = np.exp(1j * self.omega * as_float("seconds", seconds))[:, None, None]
        tilt = None if self.tilt is None else self.tilt * turn**2
        return dataclasses.replace(self, values=self.values * turn, tilt=tilt)

    @classmethod
    def from_control(cls, frd: Any, **options: Any) -> FrequencyResponse:
        """From `control.FrequencyResponseData` (whose arrays are (ny, nu, F)); `options` as for the class."""
        import control

        if not isinstance(frd, control.FrequencyResponseData):
            raise InputTypeError(f"`frd` must be a control.FrequencyResponseData; got {type(frd).__name__}")
        if "dt" not in options:
            if frd.dt is True:
                raise InputError("`frd` is of discrete time without a sample time; give `dt` in s")
            options["dt"] = frd.dt or None
        return cls(frd.omega, np.moveaxis(frd.frdata, -1, 0), **options)

    def to_control(self) -> Any:
        """As `control.FrequencyResponseData`."""
        import control

        return control.FRD(np.moveaxis(self.values, 0, -1), self.omega, dt=0 if self.dt is None else self.dt)


def as_bound_kind(kind: Any) -> str:
    """One of `BOUND_KINDS`."""
    if kind not in BOUND_KINDS:
        raise InputError(f"`bound_kind` must be one of {BOUND_KINDS}; got {kind!r}")
    return kind


def as_probability(value: Any) -> float:
    """A number between 0 and 1."""
    value = as_float("probability", value)
    if not 0 < value < 1:
        raise InputError(f"`probability` must be between 0 and 1; got {value:g}")
    return value


def _level(name: str, value: Any, shape: tuple[int, ...]) -> np.ndarray | None:
    """A coherence or standard deviation of every line, not negative."""
    if value is None:
        return None
    level = as_array(name, value)
    if level.size == shape[0] and np.prod(shape) == shape[0]:
        level = level.reshape(shape)
    if level.shape != shape:
        raise InputError(f"`{name}` must have shape {shape}; got {level.shape}")
    if np.any(level < 0) or (name == "coherence" and np.any(level > 1)):
        raise InputError(
            f"`{name}` must lie between 0 and {'1' if name == 'coherence' else 'infinity'};"
            f" got {level.min():g} to {level.max():g}"
        )
    return level


def channel_index(name: str, wanted: int | str, channels: tuple[Channel, ...]) -> int:
    """Index of a channel given by number or by name."""
    if isinstance(wanted, str):
        names = [c.name for c in channels]
        if wanted not in names:
            raise InputError(f"`{name}` must be one of {names}; got {wanted!r}")
        return names.index(wanted)
    try:
        index = operator.index(wanted)
    except TypeError:
        raise InputTypeError(f"`{name}` must be a channel's number or name; got {wanted!r}") from None
    if not -len(channels) <= index < len(channels):
        raise InputError(f"`{name}` must be below {len(channels)}; got {index}")
    return index % len(channels)
