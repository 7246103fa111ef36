"""Measured frequency responses with the bounds on their errors."""

from __future__ import annotations

import dataclasses
from typing import Any, ClassVar

import numpy as np

from robustid.core import as_array, as_bound, as_float, as_positive, as_signals, freeze
from robustid.data.bounded_response import BoundedResponse
from robustid.data.ellipses import as_tilt
from robustid.data.joint_bounds import as_ellipsoid, as_joint, largest_combination
from robustid.data.lines import (
    as_bound_kind,
    as_level,
    as_lines,
    as_note,
    as_probability,
    check_measured,
    signal_index,
)
from robustid.data.tangential import TangentialResponse, as_left, as_right, combined
from robustid.errors import InputError, InputTypeError
from robustid.figures import Drawable

_ENTRIES = ("values", "bound", "tilt", "noise", "distortion")  # one number per line and entry of the matrix


@dataclasses.dataclass(frozen=True, eq=False)
class FrequencyResponse(BoundedResponse, Drawable):
    """Samples of a frequency response with bounds on their errors: per entry, per column or of the whole matrix.

    ``values[k] = F(exp(1j*omega[k]*dt)) + e``, ``|e| <= bound[k]``, entry by entry (engineer's convention;
    ``F(1j*omega[k])`` where `dt` is None), or what `joint` says.

    Parameters
    ----------
    omega : (F,) array, rad/s
        Frequencies, >= 0, at most pi/dt; sorted on entry together with what belongs to them. One frequency
        may come several times (repeated measurements).
    values : (F,) or (F, ny, nu) complex array
        Response in output units per input unit. Frequency is the first axis; nothing is ever transposed. NaN is allowed
        where `bound` is infinite.
    bound : scalar, (F,) or (F, ny, nu) array, optional
        Radius of the disc around each value; ``inf`` marks an entry that was not measured (see `missing`).
    tilt : (F,) or (F, ny, nu) complex array, optional
        Makes the disc an ellipse, ``|e + tilt conj(e)| <= bound`` with ``|tilt| < 1``: semi-axes bound/(1 + |tilt|), in the
        direction arg(tilt)/2, and bound/(1 - |tilt|), across. `with_ellipses` takes it from covariances.
    joint : {"entry", "column", "matrix"}
        Which errors share a bound: none, each is in its own; those of a column (one input), ``||e[:, j]/bound[:, j]||_2 <= 1``
        (see `with_column_bound`); all, ``vec(e)^H ellipsoid^-1 vec(e) <= 1``, columns stacked (see `with_ellipsoid`). Then too
        `bound` holds for every entry alone.
    ellipsoid : (F, ny*nu, ny*nu) complex array, optional
        Of joint="matrix": Hermitian, positive definite; `bound` is the square root of its diagonal and may be left out.
    covariance : (F, ny*nu, ny*nu) complex array, optional
        E[e e^H] of vec(values[k]) (columns stacked), of the estimate itself: E|e|^2, not per real part. What it says of
        missing entries is not used.
    dt : float, optional
        Sample time in s; None for continuous time.
    inputs, outputs : sequence of str or (name, unit), optional
        Signal names and units; ``"current [A]"`` is split.
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

    PER_LINE: ClassVar[tuple[str, ...]] = ("omega", *_ENTRIES, "coherence", "covariance", "ellipsoid")
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
    joint: str = "entry"
    ellipsoid: Any = None

    def __post_init__(self) -> None:
        omega, values, dt = as_lines(self.omega, self.values, self.dt, "ny, nu")
        lines, ny, nu = values.shape
        ellipsoid = as_ellipsoid(self.ellipsoid, values.shape)
        bound = as_bound(self.bound, values.shape, "F", infinite=True)
        bound = as_joint(self.joint, bound, ellipsoid, self.tilt, values.shape)
        check_measured(values, bound)
        tilt = as_tilt(self.tilt, values.shape, bound)
        covariance = None
        if self.covariance is not None:
            covariance = as_array("covariance", self.covariance, dtype=complex)
            if covariance.shape != (lines, ny * nu, ny * nu):
                raise InputError(
                    f"`covariance` must have shape (F, ny*nu, ny*nu) = {(lines, ny * nu, ny * nu)};"
                    f" got {covariance.shape}"
                )
        levels = {"coherence": (lines, ny), "noise": values.shape, "distortion": values.shape}
        levels = {name: as_level(name, getattr(self, name), shape) for name, shape in levels.items()}
        order = np.argsort(omega, kind="stable")
        self._set(
            omega=freeze(omega[order]),
            values=freeze(values[order]),
            bound=None if bound is None else freeze(bound[order]),
            tilt=None if tilt is None else freeze(tilt[order]),
            ellipsoid=None if ellipsoid is None else freeze(ellipsoid[order]),
            covariance=None if covariance is None else freeze(covariance[order]),
            dt=dt,
            inputs=as_signals("inputs", self.inputs, nu, "u"),
            outputs=as_signals("outputs", self.outputs, ny, "y"),
            note=as_note(self.note),
            bound_kind=as_bound_kind(self.bound_kind),
            probability=None if self.probability is None else as_probability(self.probability),
            dof=None if self.dof is None else as_positive("dof", self.dof),
            **{name: None if level is None else freeze(level[order]) for name, level in levels.items()},
        )

    def __repr__(self) -> str:
        low, high = self.freq_hz[[0, -1]]
        parts = [f"{self.omega.size} lines, {low:.5g} to {high:.5g} Hz", f"{len(self.outputs)}x{len(self.inputs)}"]
        if self.bound is not None:
            parts.append("bound" if self.joint == "entry" else f"{self.joint} bound")
        parts += [name for name in ("tilt", "covariance") if getattr(self, name) is not None]
        parts += [f"{count} missing"] if (count := int(np.sum(self.missing))) else []
        parts += [f"dt={self.dt:.6g} s"] if self.dt is not None else []
        return f"<FrequencyResponse: {', '.join(parts)}>"

    def entry(self, output: int | str = 0, input: int | str = 0) -> FrequencyResponse:
        """One entry of the matrix, by index or channel name, still with shape (F, 1, 1), and its own bound."""
        i, j = signal_index("output", output, self.outputs), signal_index("input", input, self.inputs)
        pick = (slice(None), slice(i, i + 1), slice(j, j + 1))
        flat = j * len(self.outputs) + i
        if np.all(self.missing[pick]):
            raise InputError(
                f"`output` = {self.outputs[i].name!r}, `input` = {self.inputs[j].name!r}: this entry was measured at no line"
            )
        return self._with(
            joint="entry",
            ellipsoid=None,
            **{name: array[pick] for name in _ENTRIES if (array := getattr(self, name)) is not None},
            coherence=None if self.coherence is None else self.coherence[:, i : i + 1],
            covariance=None if self.covariance is None else self.covariance[:, flat, flat, None, None],
            inputs=(self.inputs[j],),
            outputs=(self.outputs[i],),
        )

    def without_delay(self, seconds: float) -> FrequencyResponse:
        """The response times exp(+j omega seconds): without a delay in front of the plant, of any fraction of a sample.

        Bounds turn with their values: discs and joint bounds stay as they are, ellipses keep their size. See `estimate_delay`,
        `with_delay`.

        Examples
        --------
        >>> import numpy as np, robustid as rid
        >>> frf = rid.FrequencyResponse([10.0], [2 * np.exp(-0.3j)], bound=0.1)
        >>> frf.without_delay(0.03).values.round(9).item()
        (2+0j)
        """
        turn = np.exp(1j * self.omega * as_float("seconds", seconds))[:, None, None]
        tilt = None if self.tilt is None else self.tilt * turn**2
        return self._with(values=self.values * turn, tilt=tilt)

    def tangential(self, *, right: Any = None, left: Any = None, bound: Any = None) -> TangentialResponse:
        """What sensors `left` see when inputs move in directions `right`: ``left @ values @ right``.

        Parameters
        ----------
        right : (nu,), (nu, r) or (F, nu, r) array, optional
            The columns are directions of the inputs; default: each input alone.
        left : (ny,), (l, ny) or (F, l, ny) array, optional
            The rows are what is seen of the outputs; default: each output alone.
        bound : scalar, (F,) or (F, l, r) array, optional
            Default: the largest error that the bounds of the response leave to each value, ``|left| bound |right|`` for entries,
            the norms that `joint` says else. A value that takes part of a missing entry is missing.

        Examples
        --------
        >>> import numpy as np, robustid as rid
        >>> frf = rid.FrequencyResponse([10.0], [[[1.0, 2.0], [3.0, 4.0]]], bound=0.1)
        >>> both = frf.tangential(right=[1.0, -1.0])
        >>> both.values.real.ravel().tolist(), both.bound.ravel().tolist()
        ([-1.0, -1.0], [0.2, 0.2])
        """
        lines, ny, nu = self.values.shape
        right, left = as_right(right, lines, nu), as_left(left, lines, ny)
        weights, reach = combined(left, right), None
        if self.bound is not None:
            reach = largest_combination(weights, self.outer_radius, self.joint, self.ellipsoid)
        values = np.einsum("fijab,fab->fij", weights, np.where(self.missing, 0, self.values))
        values = values if reach is None else np.where(np.isinf(reach), np.nan, values)
        made = TangentialResponse(
            self.omega,
            values,
            right=right,
            left=left,
            bound=reach,
            **{name: getattr(self, name) for name in ("dt", "inputs", "outputs", "note", "bound_kind", "probability")},
        )
        return made if bound is None else made.with_bound(bound)

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

        self.require_complete("`to_control`")
        return control.FRD(np.moveaxis(self.values, 0, -1), self.omega, dt=0 if self.dt is None else self.dt)
