"""Measured frequency responses with the bounds on their errors."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any, ClassVar, cast

import numpy as np
from numpy.typing import ArrayLike

from robustid.core import as_array, as_flag, as_float, as_positive, as_signals, counted, freeze, hz_span, numbered
from robustid.data.bound import Bound
from robustid.data.bound_checks import as_probability, in_part
from robustid.data.error_sets import ellipse_of, joint_radius, variances
from robustid.data.faults import Fault, as_faults
from robustid.data.frequency_points import as_entries, as_level, as_modes, as_note, as_points, check_measured
from robustid.data.response_parts import ENTRIES, LEVELS, ResponseParts
from robustid.data.tangential import TangentialResponse, as_left, as_right, combined
from robustid.errors import InputError, InputTypeError
from robustid.figures import Drawable

if TYPE_CHECKING:
    import control


@dataclasses.dataclass(frozen=True, eq=False)
class FrequencyResponse(ResponseParts, Drawable):
    """Samples of a frequency response with bounds on their errors: per entry, per column or of the whole matrix.

    ``values[k] = F(exp(1j*omega[k]*dt)) + e``, ``|e| <= bound[k]``, entry by entry (forward-shift convention;
    ``F(1j*omega[k])`` where `dt` is None), or whatever set the `Bound` says.

    Parameters
    ----------
    omega : (F,) array, rad/s, or control.FRD in place of `omega` and `values`
        Frequencies, >= 0, at most pi/dt; sorted on entry together with what belongs to them. One frequency
        may come several times (repeated measurements).
    values : (F,) or (F, ny, nu) complex array
        Response in output units per input unit. Frequency is the first axis; nothing is ever transposed. NaN is allowed
        where `bound` is infinite.
    bound : scalar, (F,) or (F, ny, nu) array, text such as "5%", or Bound, optional
        Radius of the disc around each value, or the part of its size: a hard bound; ``inf`` marks an entry that was not measured
        (see `missing`). A `Bound` says more: what kind it is, ellipses, errors that share a bound.
    covariance : (F, ny*nu, ny*nu) complex array, optional
        E[e e^H] of vec(values[k]) (columns stacked), of the estimate itself: E|e|^2, not per real part. What it says of
        missing entries is not used.
    dt : float, optional
        Sample time in s; None for continuous time.
    inputs, outputs : sequence of str or (name, unit), optional
        Signal names and units; ``"current [A]"`` is split.
    note : str, optional
        Where the bound comes from, for reports.
    dof : float, optional
        Degrees of freedom of `covariance`: how many independent residuals it was estimated from.
    coherence : (F, ny) array, optional
        Multiple coherence: the part of the power of each output that the inputs explain linearly, 0 to 1.
    noise : (F, ny, nu) array, optional
        Standard deviation of the values that noise alone causes, by every method: without distortion, and without what a plant
        changed by while it was measured.
    distortion : (F, ny, nu) array, optional
        Standard deviation of what changes with the realisation of the excitation beyond noise, in one realisation:
        stochastic nonlinear distortion.
    changed : (F, ny, nu) array, optional
        Standard deviation that halves of the measurement add to the values where they differ beyond chance: its square is part of
        `covariance`. No class is chosen smaller for it (`suggest_prior`).
    doubt : (F, ny, nu) complex array, optional
        What modes that may be of the noise would add to the values: the response is as likely the one as the other, and half the
        square is part of `covariance`. No class is chosen smaller for it (`suggest_prior`, `suggest_kautz`).
    faults : sequence of Fault
        Of the records that it was estimated from (`record_faults`).
    judged : bool
        True of one of so many points: its faults are those of all of them, which it brings. Points too far apart for what lies
        between them look like faults.
    modes : sequence of four numbers
        Light modes that its record shows (1x1), or both halves of one that differ: ends of the natural frequency in rad/s and of
        the damping ratio of each.

    Raises
    ------
    InputError, InputTypeError
        On any wrong shape, NaN, negative bound, frequency above pi/dt.

    Examples
    --------
    >>> import robustid as rid
    >>> frf = rid.FrequencyResponse([10.0, 20.0], [1 - 0.1j, 0.9 - 0.3j], bound=0.02, dt=0.01)
    >>> frf
    <FrequencyResponse: 2 frequency points, 1.5915 to 3.1831 Hz, 1x1, bound, dt=0.01 s>
    """

    PER_POINT: ClassVar[tuple[str, ...]] = ("omega", *ENTRIES, "coherence", "covariance")
    omega: np.ndarray
    values: np.ndarray = None  # type: ignore[assignment] # only beside a control.FRD
    _: dataclasses.KW_ONLY
    bound: Any = None
    covariance: Any = None
    dt: float | None = None
    inputs: Any = None
    outputs: Any = None
    note: str = ""
    dof: float | None = None
    coherence: Any = None
    noise: Any = None
    distortion: Any = None
    changed: Any = None
    doubt: Any = None
    faults: tuple[Fault, ...] = ()
    judged: bool = False
    modes: tuple[tuple[float, float, float, float], ...] = ()

    def __post_init__(self) -> None:
        if cast("object", self.values) is None:
            if not hasattr(self.omega, "frdata"):
                raise InputError("`values` is missing: give frequencies and values, or a control.FRD in place of both")
            given = {
                f.name: value for f in dataclasses.fields(self)[1:] if (value := getattr(self, f.name)) is not f.default
            }
            self._set(**vars(FrequencyResponse.from_control(self.omega, **given)))
            return
        omega, values, dt = as_points(self.omega, self.values, self.dt, "ny, nu")
        points, ny, nu = values.shape
        bound = Bound.of(in_part(self.bound, np.abs(values)), values.shape)
        check_measured(values, bound)
        covariance = None
        if self.covariance is not None:
            covariance = as_array("covariance", self.covariance, dtype=complex)
            if covariance.shape != (wanted := (points, ny * nu, ny * nu)):
                raise InputError(f"`covariance` must have shape (F, ny*nu, ny*nu) = {wanted}; got {covariance.shape}")
        levels = {"coherence": (points, ny), **dict.fromkeys(LEVELS, values.shape)}
        levels = {name: as_level(name, getattr(self, name), shape) for name, shape in levels.items()}
        doubt = None if self.doubt is None else as_entries("doubt", self.doubt, values.shape)
        order = np.argsort(omega, kind="stable")
        self._set(
            omega=freeze(omega[order]),
            values=freeze(values[order]),
            bound=None if bound is None else bound.select(order),
            covariance=None if covariance is None else freeze(covariance[order]),
            doubt=None if doubt is None else freeze(doubt[order]),
            dt=dt,
            inputs=as_signals("inputs", self.inputs, nu, "u"),
            outputs=as_signals("outputs", self.outputs, ny, "y"),
            note=as_note(self.note),
            faults=as_faults(self.faults),
            judged=as_flag("judged", self.judged),
            modes=as_modes("modes", self.modes),
            dof=None if self.dof is None else as_positive("dof", self.dof),
            **{name: None if level is None else freeze(level[order]) for name, level in levels.items()},
        )

    def __repr__(self) -> str:
        parts = [
            f"{counted(self.omega.size, 'frequency point')}, {hz_span(*self.freq_hz[[0, -1]].tolist())}",
            f"{len(self.outputs)}x{len(self.inputs)}",
        ]
        if self.bound is not None:
            parts.append("bound" if self.bound.joint == "entry" else f"{self.bound.joint} bound")
            parts += ["ellipses"] if self.bound.tilt is not None else []
        parts += ["covariance"] if self.covariance is not None else []
        parts += [f"{count} missing"] if (count := int(np.sum(self.missing))) else []
        parts += [f"dt={self.dt:.6g} s"] if self.dt is not None else []
        return f"<FrequencyResponse: {', '.join(parts)}>"

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
        return self._with(
            values=self.values * turn,
            doubt=None if self.doubt is None else self.doubt * turn,
            bound=None if self.bound is None else self.bound.turned(turn),
        )

    def tangential(
        self, *, right: ArrayLike | None = None, left: ArrayLike | None = None, bound: ArrayLike | None = None
    ) -> TangentialResponse:
        """Responses that sensors `left` see when inputs move in directions `right`: ``left @ values @ right``.

        Parameters
        ----------
        right : (nu,), (nu, r) or (F, nu, r) array, optional
            The columns are directions of the inputs; default: each input alone.
        left : (ny,), (l, ny) or (F, l, ny) array, optional
            The rows are what is seen of the outputs; default: each output alone.
        bound : scalar, (F,) or (F, l, r) array, optional
            Default: the largest error that the bound of the response leaves to each value (`Bound.reach`): ``|left| bound |right|``
            where every entry has its own. A value that takes part of a missing entry is missing.

        Examples
        --------
        >>> import numpy as np, robustid as rid
        >>> frf = rid.FrequencyResponse([10.0], [[[1.0, 2.0], [3.0, 4.0]]], bound=0.1)
        >>> both = frf.tangential(right=[1.0, -1.0])
        >>> both.values.real.ravel().tolist(), both.bound.ravel().tolist()
        ([-1.0, -1.0], [0.2, 0.2])
        """
        points, ny, nu = self.values.shape
        right, left = as_right(right, points, nu), as_left(left, points, ny)
        weights, reach = combined(left, right), None
        if self.bound is not None:
            reach = Bound(self.bound.reach(weights), **self.bound.of_kind)
        values = np.einsum("fijab,fab->fij", weights, np.where(self.missing, 0, self.values))
        values = values if reach is None else np.where(reach.missing, np.nan, values)
        made = TangentialResponse(
            self.omega,
            values,
            right=right,
            left=left,
            bound=reach,
            **{name: getattr(self, name) for name in ("dt", "inputs", "outputs", "note")},
        )
        return made if bound is None else made.with_bound(bound)

    def with_column_bound(self, radius: ArrayLike, note: str = "") -> FrequencyResponse:
        """Return the samples, the errors of each column together in a ball: ``||e[:, j]||_2 <= radius[j]``.

        One experiment with one input leaves such errors on all outputs. For other weights than equal ones use `with_bound` and a
        `Bound` with ``joint="column"``. Missing entries stay missing; they are left out of the norm.

        Parameters
        ----------
        radius : scalar, (F,) or (F, nu) array
            In units of the response, one for all outputs, per frequency point in the order of `omega` here.
        note : str, optional
            Where the bound comes from.

        Examples
        --------
        >>> import numpy as np, robustid as rid
        >>> frf = rid.FrequencyResponse([10.0, 20.0], np.ones((2, 3, 2)), dt=0.01).with_column_bound([[0.1, 0.2], [0.3, 0.4]])
        >>> frf
        <FrequencyResponse: 2 frequency points, 1.5915 to 3.1831 Hz, 3x2, column bound, dt=0.01 s>
        >>> frf.bound[0].tolist()
        [[0.1, 0.2], [0.1, 0.2], [0.1, 0.2]]
        """
        points, _, nu = self.values.shape
        radius = as_array("radius", radius)
        if radius.shape not in ((), (points,), (points, nu)):
            raise InputError(
                f"`radius` must be a scalar or have shape (F,) = {(points,)} or (F, nu) = {(points, nu)}; got {radius.shape}"
            )
        if np.any(radius <= 0):
            raise InputError(f"`radius` must be positive; got {radius.min():g}")
        each = radius if radius.ndim == 0 else radius.reshape(points, 1, -1)
        return self.with_bound(Bound(np.broadcast_to(each, self.values.shape), joint="column"), note)

    def with_ellipsoid(
        self, deviations: float, covariance: ArrayLike | None = None, note: str = ""
    ) -> FrequencyResponse:
        """Return the samples, all errors of a frequency point together in ``vec(e)^H C^-1 vec(e) <= deviations^2``.

        Parameters
        ----------
        deviations : float
            How many standard deviations the bound is. Of ``n = ny*nu`` circular normal errors of a known C,
            ``2 vec(e)^H C^-1 vec(e)`` is chi-square with 2 n degrees of freedom: they are inside at all F points with
            probability p or more for ``deviations = sqrt(chi2(2 n, 1 - (1 - p)/F)/2)``, chi2 the quantile (Bonferroni; at
            omega = 0 and pi/dt, where errors are real, ``sqrt(chi2(n, ...))`` is needed, which is larger).
        covariance : (F, ny*nu, ny*nu) complex array, optional
            C = E[vec(e) vec(e)^H], columns stacked, in the order of `omega` here; default: the covariance of the response.
        note : str, optional
            Where the bound comes from.

        Raises
        ------
        InputError
            No covariance, one that isn't Hermitian and positive definite, missing entries.

        Examples
        --------
        >>> import numpy as np, robustid as rid
        >>> from scipy.special import chdtri
        >>> covariance = [[[4e-4, 1e-4j], [-1e-4j, 1e-4]]]
        >>> frf = rid.FrequencyResponse([10.0], np.ones((1, 2, 1)), covariance=covariance, dt=0.01)
        >>> probability, points, entries = 0.95, 1, 2
        >>> deviations = np.sqrt(chdtri(2 * entries, (1 - probability) / points) / 2)
        >>> deviations.round(4).item(), frf.with_ellipsoid(deviations).bound.ravel().round(4).tolist()
        (2.178, [0.0436, 0.0218])
        """
        deviations = as_positive("deviations", deviations)
        self.require_complete("`with_ellipsoid`")
        if covariance is None and self.covariance is None:
            raise InputError("`covariance` is needed: the response has none")
        C = self.covariance if covariance is None else as_array("covariance", covariance, dtype=complex)
        bound = Bound(joint="matrix", ellipsoid=deviations**2 * C, kind="confidence")
        return self.with_bound(bound, note or self.note)

    def with_ellipses(self, covariance: ArrayLike, deviations: float, note: str = "") -> FrequencyResponse:
        """Return the samples, each in the ellipse ``e'C^-1 e <= deviations^2`` with e = (Re e, Im e).

        Parameters
        ----------
        covariance : (F, 2, 2) real array
            C = E[e e'] of the real and the imaginary part at every point, in the order of `omega` here.
        deviations : float
            How many standard deviations the bound is.
        note : str, optional
            Where the bound comes from.

        Raises
        ------
        InputError
            MIMO data, another shape, a matrix that isn't symmetric and positive definite.

        Examples
        --------
        >>> import robustid as rid
        >>> frf = rid.FrequencyResponse([10.0], [1 - 0.1j], dt=0.01)
        >>> frf = frf.with_ellipses([[[4e-4, 0.0], [0.0, 1e-4]]], deviations=3)
        >>> frf.bound.inner_radius.round(9).item(), frf.bound.outer_radius.round(9).item()
        (0.03, 0.06)
        """
        if self.values.shape[1:] != (1, 1):
            raise InputError(
                f"`with_ellipses` takes one entry at a time; this response has {counted(len(self.outputs), 'output')} and"
                f" {counted(len(self.inputs), 'input')}. Pick one entry with .entry(output, input)"
            )
        radius, tilt = ellipse_of(covariance, self.omega.size, as_positive("deviations", deviations))
        return self.with_bound(Bound(radius, tilt=tilt, kind="confidence"), note or self.note)

    def with_joint_bound(self, probability: float = 0.95) -> FrequencyResponse:
        """Return the samples with the confidence bound that holds for all points and entries at once with this probability.

        From `covariance` and its `dof` (normal errors of known covariance where that is None), see `estimate_frf`.

        Examples
        --------
        >>> import robustid as rid
        >>> frf = rid.FrequencyResponse([10.0, 20.0], [1 - 0.1j, 0.5j], covariance=[[[1e-4]], [[4e-4]]], dt=0.01)
        >>> frf.with_joint_bound(0.95).bound.ravel().round(4)
        array([0.0192, 0.0384])
        """
        if self.covariance is None:
            raise InputError(
                "`with_joint_bound` needs the covariance of the response; give `covariance`, or with_bound(...)"
            )
        probability = as_probability(probability)
        radius = joint_radius(probability, int(np.sum(~self.missing)), self.dof, self.all_real)
        radius = radius * np.sqrt(variances(self.covariance, self.values.shape))
        excitations = None if self.bound is None else self.bound.excitations
        bound = Bound(radius, kind="confidence", probability=probability, dof=self.dof, excitations=excitations)
        return self.with_bound(bound, f"{counted(self.omega.size, 'frequency point')}, from the covariance")

    @classmethod
    def from_control(cls, frd: Any, **options: Any) -> FrequencyResponse:
        """From `control.FrequencyResponseData` (whose arrays are (ny, nu, F)), with the names; `options` as for the class.

        Examples
        --------
        >>> import control, robustid as rid
        >>> rid.FrequencyResponse.from_control(control.FRD([1 - 0.1j, 0.5j], [10.0, 20.0], inputs="force"))
        <FrequencyResponse: 2 frequency points, 1.5915 to 3.1831 Hz, 1x1>
        """
        import control

        if not isinstance(frd, control.FrequencyResponseData):
            raise InputTypeError(f"`frd` must be a control.FrequencyResponseData; got {type(frd).__name__}")
        if "dt" not in options:
            if frd.dt is True:
                raise InputError("`frd` is of discrete time without a sample time; give `dt` in s")
            options["dt"] = frd.dt or None
        for side, labels, letter in (("inputs", frd.input_labels, "u"), ("outputs", frd.output_labels, "y")):
            if not numbered(labels, letter):
                options.setdefault(side, labels)
        return cls(frd.omega, np.moveaxis(frd.frdata, -1, 0), **options)

    def to_control(self) -> control.FrequencyResponseData:
        """As `control.FrequencyResponseData`."""
        import control

        self.require_complete("`to_control`")
        return control.FRD(np.moveaxis(self.values, 0, -1), self.omega, dt=0 if self.dt is None else self.dt)


def as_frequency_response(name: str, value: object) -> FrequencyResponse:
    """A FrequencyResponse as it is, or what a `control.FRD` says."""
    if isinstance(value, FrequencyResponse):
        return value
    if hasattr(value, "frdata"):
        return FrequencyResponse.from_control(value)
    raise InputTypeError(f"`{name}` must be a FrequencyResponse or a control.FRD; got {type(value).__name__}")
