"""A bound on the errors of measurements: of what kind it is, which errors it allows, and how it is said."""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Iterator, Sequence
from typing import Any, Self

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin
from numpy.typing import ArrayLike, DTypeLike, NDArray

from robustid.core import Frozen, Record, as_array, as_count, as_positive, freeze
from robustid.data.bound_checks import as_probability, as_radius, broadcast, projected
from robustid.data.error_sets import as_ellipsoid, as_tilt, bound_ratio, correlations, stacked
from robustid.errors import InputError

# A mask (which numpy types as one bool, too), indices or a slice of the first axis.
Points = np.bool_ | NDArray[np.bool_] | NDArray[np.intp] | Sequence[bool] | Sequence[int] | slice
JOINT = ("entry", "column", "matrix")
KINDS = {
    "hard": "hard bound",
    "noise_floor": "bound from the noise floor",
    "confidence": "confidence bound",
    "tolerance": "tolerance bound of the next record",
}


class Caveat(enum.StrEnum):
    """A reason why errors may be larger than an estimated bound knows."""

    SMEARED = "smeared"  # by the windows of Welch's method
    UNSTEADY = "unsteady"  # the record isn't in steady state, for which the bound holds
    CHANGING = "changing"  # halves of the measurement differ: the bound holds either, not what comes after


_CHANGED = (
    " Halves of the measurement differ beyond chance: the plant changed, and the bound holds what they differ by."
)
PROBABLE = ("confidence", "tolerance")
_OF_PROBABLE = ("probability", "dof")


@dataclasses.dataclass(frozen=True, eq=False)
class Bound(NDArrayOperatorsMixin, Frozen):
    """Bound on the errors of a response or record: its kind, and the set in which the errors lie.

    ``|e| <= radius`` sample by sample; or an ellipse, or a set for all entries of a column or of the matrix together. Where an
    array is expected (``np.asarray(bound)``, arithmetic, indexing, methods of an array) a bound stands for its `radius`.

    Parameters
    ----------
    radius : scalar, (F,), (F, ny, nu) or (T, ny) array
        Radius of the disc around each value of a response, half-width of the interval around each sample of a record; ``inf``
        marks what was not measured or is not used. Data give it the shape of their values.
    kind : {"hard", "noise_floor", "confidence", "tolerance"}
        "hard": a statement of the user's that holds always. "noise_floor": estimated from a record without excitation.
        "confidence": holds for the mean, for all frequency points and entries at once, with `probability`. "tolerance": the same
        for the next record, with what changes from record to record.
    probability : float, optional
        Of a confidence or tolerance bound.
    dof : float, optional
        Degrees of freedom of the scatter from which a confidence or tolerance bound was taken; None: it was known.
    excitations : int, optional
        How many independent excitations (realisations, or blocks of as many experiments as inputs) an estimated bound was
        taken from; of one alone, what varies from record to record is unknown (see `about`). None: it isn't stated.
    caveats : tuple of {"smeared", "unsteady", "changing"}
        What an estimated bound doesn't know: what the windows of Welch's method smear, that the record isn't steady, or what
        becomes of a plant that changed while it was measured.
    tilt : (F,) or (F, ny, nu) complex array, optional
        Makes the disc an ellipse, ``|e + tilt conj(e)| <= radius`` with ``|tilt| < 1``: semi-axes radius/(1 + |tilt|), in the
        direction arg(tilt)/2, and radius/(1 - |tilt|), across.
    joint : {"entry", "column", "matrix"}
        Which errors share a bound: none, each is in its own; those of a column (one input), ``||e[:, j]/radius[:, j]||_2 <= 1``;
        all, ``vec(e)^H ellipsoid^-1 vec(e) <= 1``, columns stacked. Then too `radius` holds for every entry alone.
    ellipsoid : (F, ny*nu, ny*nu) complex array, optional
        Of joint="matrix": Hermitian, positive definite; `radius` is the square root of its diagonal and is left out.

    Raises
    ------
    InputError, InputTypeError
        On NaN, radii that aren't positive, parts that do not belong together.

    Examples
    --------
    >>> import robustid as rid
    >>> bound = rid.Bound([0.1, 0.2], kind="confidence", probability=0.95)
    >>> frf = rid.FrequencyResponse([10.0, 20.0], [1 - 0.1j, 0.9 - 0.3j], bound=bound, dt=0.01)
    >>> frf.bound
    <Bound: confidence bound, 95 % jointly, (2, 1, 1), 0.1 to 0.2>
    >>> (2 * frf.bound).ravel().tolist(), frf.bound.inflated(2).kind
    ([0.2, 0.4], 'confidence')
    """

    radius: Any = None
    _: dataclasses.KW_ONLY
    kind: str = "hard"
    probability: float | None = None
    dof: float | None = None
    excitations: int | None = None
    caveats: tuple[str, ...] = ()
    tilt: Any = None
    joint: str = "entry"
    ellipsoid: Any = None

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InputError(f"`kind` of a bound must be one of {tuple(KINDS)}; got {self.kind!r}")
        for name in _OF_PROBABLE:
            if getattr(self, name) is not None and self.kind not in PROBABLE:
                raise InputError(f"`{name}` belongs to a confidence or tolerance bound; got kind={self.kind!r}")
        if self.excitations is not None and self.kind == "hard":
            raise InputError("`excitations` belongs to an estimated bound; a hard bound is a statement of yours")
        self._check_joint()
        self._set(
            radius=None if self.radius is None else freeze(as_radius(self.radius)),
            probability=None if self.probability is None else as_probability(self.probability),
            dof=None if self.dof is None else as_positive("dof", self.dof),
            excitations=None if self.excitations is None else as_count("excitations", self.excitations, least=1),
            caveats=tuple(Caveat(caveat) for caveat in self.caveats),
            tilt=None if self.tilt is None else freeze(as_array("tilt", self.tilt, dtype=complex)),
            ellipsoid=None
            if self.ellipsoid is None
            else freeze(as_array("ellipsoid", self.ellipsoid, dtype=complex, ndim=3)),
        )

    def _check_joint(self) -> None:
        """Refuse joint bounds whose parts do not belong together."""
        joint, there = self.joint, self.ellipsoid is not None
        if joint not in JOINT:
            raise InputError(f"`joint` must be one of {JOINT}; got {joint!r}")
        if joint != "entry" and self.tilt is not None:
            raise InputError(f'`tilt` shapes the disc of one entry: it goes with joint="entry"; got joint={joint!r}')
        if (joint == "matrix") != there:
            raise InputError(
                '`ellipsoid` is the set of joint="matrix": give both or none;'
                f" got joint={joint!r} {'with' if there else 'without'} an ellipsoid"
            )
        if self.radius is None and not there:
            raise InputError(
                "`radius` of a bound is missing; give it, or data without any bound"
                + (
                    ': joint="column" and `tilt` only say how it is meant'
                    if joint == "column" or self.tilt is not None
                    else ""
                )
            )

    @classmethod
    def of(cls, value: object, shape: tuple[int, ...], axis: str = "F") -> Self | None:
        """The bound that an argument `bound` of data of this shape gives: a number or an array is a hard bound, None is none."""
        if value is None:
            return None
        return (value if isinstance(value, cls) else cls(value)).fitted(shape, axis)

    def fitted(self, shape: tuple[int, ...], axis: str = "F") -> Self:
        """Return the bound with arrays of the shape of the values that it bounds."""
        if axis != "F" and (self.tilt is not None or self.joint != "entry"):
            raise InputError(
                "`bound` of a record is an interval for every sample; leave out `tilt`, `joint` and `ellipsoid`"
            )
        tilt = None if self.tilt is None else as_tilt(self.tilt, shape)
        if self.ellipsoid is None:
            return self._with(radius=broadcast(self.radius, shape, axis), tilt=tilt)
        ellipsoid = as_ellipsoid(self.ellipsoid, shape)
        return self._with(radius=projected(ellipsoid, self.radius, shape, axis), ellipsoid=ellipsoid)

    def _with(self, **changes: object) -> Self:
        return dataclasses.replace(self, **changes)

    # --- in the place of its radius -------------------------------------------------------------------------------------------

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> np.ndarray:
        return np.array(self.radius, dtype=dtype, copy=copy)

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: object, **options: object) -> Any:
        plain = (value.radius if isinstance(value, Bound) else value for value in inputs)
        return getattr(ufunc, method)(*plain, **options)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(self.radius, name)

    def __getitem__(self, index: Any) -> Any:
        return self.radius[index]

    def __len__(self) -> int:
        return len(self.radius)

    def __iter__(self) -> Iterator[Any]:
        return iter(self.radius)

    def __repr__(self) -> str:
        shape = "" if self.joint == "entry" else f", {self.joint}"
        radius = np.zeros(0) if self.radius is None else self.radius
        used = radius[np.isfinite(radius)]
        size = f", {radius.shape}, {used.min():.4g} to {used.max():.4g}" if used.size else ""
        return f"<Bound: {self.words()}{', ellipses' if self.tilt is not None else shape}{size}>"

    # --- which errors it allows -----------------------------------------------------------------------------------------------

    @property
    def missing(self) -> NDArray[np.bool_]:
        """True where nothing was measured: where the radius is infinite."""
        return np.isinf(self.radius)

    @property
    def used(self) -> NDArray[np.bool_]:
        """True where there is a sample: where the radius is finite."""
        return np.isfinite(self.radius)

    @property
    def inner_radius(self) -> NDArray[np.float64]:
        """Radius of the largest disc inside the bound of each entry alone: the smaller semi-axis of an ellipse."""
        return self.radius if self.tilt is None else self.radius / (1 + np.abs(self.tilt))

    @property
    def outer_radius(self) -> NDArray[np.float64]:
        """Radius of the smallest disc around the bound of each entry alone: the larger semi-axis of an ellipse."""
        return self.radius if self.tilt is None else self.radius / (1 - np.abs(self.tilt))

    @property
    def whitening(self) -> NDArray[np.complex128]:
        """L^-1 with ellipsoid = LL', (F, ny*nu, ny*nu): the norm of L^-1 vec(e) is at most 1 where e is inside."""
        return np.asarray(np.linalg.inv(np.asarray(np.linalg.cholesky(self.ellipsoid), dtype=complex)), dtype=complex)

    def ratio(self, error: ArrayLike) -> NDArray[np.float64]:
        """Size of an error in units of the bound, at most 1 inside: as the bound means it; what is missing counts as 0.

        ``|e + tilt conj(e)|/radius``, of the shape of the values, for joint="entry"; ``||e[:, j]/radius[:, j]||_2``, (F, 1, nu),
        for "column"; ``sqrt(vec(e)^H ellipsoid^-1 vec(e))``, (F, 1, 1), for "matrix".
        """
        error = as_array("error", error, dtype=complex, finite=False)
        if error.shape != self.radius.shape:
            raise InputError(f"`error` must have shape {self.radius.shape} as the values; got {error.shape}")
        error = np.where(self.missing, 0, error)
        if self.joint == "entry":
            return bound_ratio(error, self.radius, self.tilt)
        if self.ellipsoid is None:
            return np.linalg.norm(error / self.radius, axis=1, keepdims=True)
        # The correlations rather than E: nothing depends on the units of the entries.
        white = np.linalg.solve(
            np.linalg.cholesky(correlations(self.ellipsoid)), stacked(error / self.radius)[..., None]
        )
        return np.linalg.norm(white, axis=1, keepdims=True)

    def reach(self, weights: NDArray[np.complex128]) -> NDArray[np.float64]:
        """Largest |sum(weights * e)| over the errors that the bound allows, (F, l, r), for weights (F, l, r, ny, nu)."""
        if self.ellipsoid is not None:
            w = weights.swapaxes(3, 4).reshape(*weights.shape[:3], -1)
            return np.sqrt(np.einsum("fijp,fpq,fijq->fij", w, self.ellipsoid, w.conj()).real)
        reach = np.abs(weights)
        # An infinite bound counts where its entry has a weight.
        parts = np.multiply(reach, self.outer_radius[:, None, None], out=np.zeros(reach.shape), where=reach > 0)
        if self.joint == "column":
            return np.linalg.norm(parts, axis=3).sum(axis=3)
        return parts.sum(axis=(3, 4))

    def tighter_than(self, other: Bound | NDArray[np.float64]) -> NDArray[np.bool_]:
        """True where this bound leaves less room to an entry alone than another one, by the discs around both."""
        return self.outer_radius < (other.outer_radius if isinstance(other, Bound) else other)

    # --- others made from it --------------------------------------------------------------------------------------------------

    def inflated(self, factor: float) -> Self:
        """The bound with every error it allows multiplied by a factor; its kind stays."""
        factor = as_positive("factor", factor)
        ellipsoid = None if self.ellipsoid is None else float(factor) ** 2 * self.ellipsoid
        return self._with(radius=None if self.radius is None else factor * self.radius, ellipsoid=ellipsoid)

    def widened(self, extra: NDArray[np.float64]) -> Self:
        """The bound of every entry with so much added to its radius; its shape (`tilt`) and kind stay."""
        return self._with(radius=self.radius + extra, joint="entry", ellipsoid=None)

    def select(self, index: Points) -> Self:
        """The bound of some frequency points or samples: a mask, indices or a slice of the first axis."""
        return self._with(
            **{
                name: part[index]
                for name in ("radius", "tilt", "ellipsoid")
                if (part := getattr(self, name)) is not None
            }
        )

    def entries(self, *index: Points) -> Self:
        """Bound that is left to some entries, each alone: indices of the axes after the first, which keep them."""
        place = (slice(None), *index)
        tilt = None if self.tilt is None else self.tilt[place]
        return self._with(radius=self.radius[place], tilt=tilt, joint="entry", ellipsoid=None)

    def only(self, measured: NDArray[np.bool_]) -> Self:
        """The bound where `measured`, and an infinite one, for what was not measured or is not used, elsewhere."""
        if self.ellipsoid is not None and not np.all(measured):
            raise InputError('joint="matrix" needs every entry of the matrix; select the complete frequency points')
        return self._with(radius=np.where(measured, self.radius, np.inf))

    def turned(self, turn: NDArray[np.complex128]) -> Self:
        """The bound of the errors times numbers of modulus 1: discs and joint sets stay as they are, ellipses turn."""
        return self if self.tilt is None else self._with(tilt=self.tilt * turn**2)

    # --- in words -------------------------------------------------------------------------------------------------------------

    def words(self, note: str = "") -> str:
        """Kind of the bound in words, and where it comes from, as the note of the data says.

        Examples
        --------
        >>> from robustid.data import Bound
        >>> Bound(0.1).words()
        'hard bound'
        >>> Bound(0.1, kind="confidence", probability=0.95).words("scatter over 10 periods")
        'confidence bound, 95 % jointly: scatter over 10 periods'
        >>> Bound(0.1, kind="confidence", probability=0.95, excitations=1).words()
        'confidence bound of the mean response, 95 % jointly, from one excitation'
        """
        said = self._named(" jointly")
        return f"{said}: {note}" if note else said

    @property
    def heading(self) -> str:
        """Kind of the bound in few words.

        Examples
        --------
        >>> from robustid.data import Bound
        >>> Bound(0.1, kind="confidence", probability=0.95).heading
        'Confidence bound, 95 %'
        """
        said = self._named("")
        return said[0].upper() + said[1:]

    def _named(self, jointly: str) -> str:
        said = KINDS[self.kind]
        if self.excitations is not None and self.kind == "confidence":
            said += " of the mean response"
        if self.probability is not None:
            said += f", {100 * self.probability:.6g} %{jointly}"
        if self.excitations is not None:
            several = f"{self.excitations} independent excitations"
            said += f", from {'one excitation' if self.excitations == 1 else several}"
        return said

    @property
    def of_kind(self) -> Record:
        """Arguments of another bound about the same: kind, probability, degrees of freedom, excitations and caveats."""
        return {name: getattr(self, name) for name in ("kind", "excitations", "caveats", *_OF_PROBABLE)}

    @property
    def of_one_excitation(self) -> bool:
        """True of a bound that was estimated from a single excitation: what rests on it is a statement for this excitation."""
        return self.kind in PROBABLE and self.excitations == 1

    @property
    def about(self) -> str:
        """Sentence that says what an estimated bound holds for; empty where the number of its excitations isn't stated.

        It belongs into the first lines of whatever rests on the bound.

        Examples
        --------
        >>> from robustid.data import Bound
        >>> Bound(0.1, kind="tolerance", excitations=4).about
        'This is about the response in the next record, judged by 4 independent excitations.'
        >>> Bound(0.1, kind="confidence", excitations=1).about[:84]
        'This is about the mean response for this excitation, and rests on it alone: variatio'
        """
        if self.excitations is None:
            return ""
        changed = _CHANGED * (Caveat.CHANGING in self.caveats)
        if self.kind == "noise_floor":
            return (
                "This is about noise without excitation: what the excitation itself disturbs, and how the response varies from"
                " record to record, is not in the bound."
            )
        what = "the response in the next record" if self.kind == "tolerance" else "the mean response"
        if self.excitations > 1:
            return f"This is about {what}, judged by {self.excitations} independent excitations.{changed}"
        return (
            f"This is about {what} for this excitation, and rests on it alone: variation of the plant was not measured, and other"
            f" records may contradict the bound. Measure several realisations of the excitation.{changed}"
        )

    @property
    def shape_words(self) -> str:
        """Sentence that says which errors share a bound; empty where each entry has a bound of its own."""
        return {
            "entry": "",
            "column": "The entries of a column share one bound: the errors of all outputs to one input, each divided by its"
            " bound, have a root sum of squares of at most 1.",
            "matrix": "All entries at a frequency point share one bound: their errors together lie in one ellipsoid.",
        }[self.joint]
