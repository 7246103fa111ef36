"""The statement: measurements with bounds, a prior, and a parametric basis."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from robustid.bases import ParametricBasis, as_basis
from robustid.core import Frozen, Plane, Real, Signal, ZPlane, as_array, as_flag, as_kind, freeze, plane_of
from robustid.data import Fault, FrequencyResponse, PlacedFault, TangentialResponse, TimeRecord, as_faults
from robustid.errors import InputError, InputTypeError
from robustid.estimation import all_faults, experiment_faults
from robustid.identification.entries import Entries
from robustid.identification.passive import centred, check_passive
from robustid.identification.prior import Prior, any_prior
from robustid.identification.region import Region, region_of
from robustid.identification.sample_faults import sample_faults
from robustid.identification.signals import check_excitation, check_signals
from robustid.identification.weighting import Weighting

# Angles closer than this, relatively, are one node with several discs on one value.
_SAME_ANGLE = 1e-12
# Lines of a periodic input below this fraction of the largest are rounding noise of the FFT.
_EXCITED = 1e-12


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class MixedProblem(Frozen):
    """Do these samples fit F = p'P + G, with p free and G in the ball of the prior?

    Frequency samples ``|y_k - F(exp(j omega_k dt))| <= bound_k`` (or in ellipses; F(j omega_k) in continuous time, where the
    frequency responses have no dt) and time samples
    ``|y_k - sum_j f_j u_{k-j}| <= bound_k`` together; every sample needs a bound. For MIMO F is a matrix: every
    measured entry is a sample, p are free real matrices (residues), and the prior bounds the largest singular value of G.

    Parameters
    ----------
    frequency : FrequencyResponse or TangentialResponse or sequence of them, optional
    time : TimeRecord or sequence of them, optional
        At least one of the two; the same inputs and outputs everywhere; one common dt. Entries that were not measured have an
        infinite bound.
    prior : Prior
        The class of the non-parametric part.
    parametric : ParametricBasis, control.StateSpace, or a sequence of them, optional
        Known functions with free real coefficients (`kautz`); integrators at z = 1 are allowed where no
        frequency point lies on them.
    parameter_bounds : (m, 2) or (m, ny, nu, 2) array, optional
        What is known of the coefficients of `parametric`, hard: lower and upper end of each, in the units of
        `Identification.parameters`. Two equal ends fix a coefficient, two infinite ones leave it free; for a known sign
        alone, give as the other end a size that is surely not exceeded. Unlike the bounds of the samples they do not grow
        with the margin: data that contradict them have a margin above 1.
    symmetric : bool
        Whether F is a symmetric matrix, as that of collocated inputs and outputs of a reciprocal structure, in the same order.
    faults : sequence of Fault
        Of experiments that contradict the others, as the choice of the class has found them; they join `data_faults`.

    Raises
    ------
    InputError
        Missing bounds, different dt, a prior of the other kind of time, different signals, an input that no experiment excites or
        an output that none sees, inputs that always move together, a frequency point on an integrator, functions that the data
        cannot tell apart, bounds of another shape, in the wrong order or with one infinite end.

    Notes
    -----
    Source: `inanc2001` Problem 1.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> record = rid.TimeRecord(np.ones(3), [1.0, 1.5, 1.75], dt=0.1, bound=0.01)
    >>> problem = rid.MixedProblem(time=record, prior=rid.Prior(gain_bound=2.0, decay_rate=1.2))
    >>> problem.coefficients
    3
    """

    frequency: Any = None
    time: Any = None
    prior: Prior
    parametric: Any = None
    parameter_bounds: Any = None
    symmetric: bool = False
    faults: tuple[Fault, ...] = dataclasses.field(default=(), repr=False)

    entries: Entries = dataclasses.field(init=False, repr=False)
    plane: Plane = dataclasses.field(init=False, repr=False)
    region: Region = dataclasses.field(init=False, repr=False)
    weighting: Weighting = dataclasses.field(init=False, repr=False)
    angles: Real = dataclasses.field(init=False, repr=False)
    taylor: int = dataclasses.field(init=False, repr=False)

    def __post_init__(self) -> None:
        frequency = _experiments("frequency", self.frequency, (FrequencyResponse, TangentialResponse))
        time = _experiments("time", self.time, (TimeRecord,))
        if not frequency and not time:
            raise InputError("`frequency` and `time` are both missing; give at least one experiment")
        as_kind("prior", self.prior, Prior, "a Prior")
        _check_same_time((*frequency, *time))
        self._set(frequency=frequency, time=time, symmetric=as_flag("symmetric", self.symmetric))
        self._set(faults=as_faults(self.faults))
        check_signals((*frequency, *time))
        self._set(entries=self._entries())
        self.prior.scales(self.entries.outputs, self.entries.inputs)
        self._set(plane=self._plane())
        self._set(region=self._region())
        self._set(weighting=self._weighting())
        check_excitation((*frequency, *time))
        self._set_class(frequency, time)
        if self.parametric is not None:
            self._set(parametric=as_basis(self.parametric, self.plane))
        if self.parameter_bounds is not None:
            self._set(parameter_bounds=freeze(_intervals(self.parameter_bounds, self.parametric, self.entries)))
        self._set(angles=freeze(_merge(self._all_angles())), taylor=self._taylor())
        self._check_integrators()

    @property
    def dt(self) -> float:
        """Sample time in s, common to all experiments; 0 in continuous time."""
        return self.plane.dt

    @property
    def coefficients(self) -> int:
        """Number n of real coefficients of an entry of the non-parametric part: order of the exact form."""
        return self.taylor + sum(1 if angle in (0.0, np.pi) else 2 for angle in self.angles)

    @property
    def functions(self) -> int:
        """Number of parametric functions, without the constant of a positive-real class."""
        return 0 if self.parametric is None else self.parametric.size - self.prior.positive_real

    @property
    def samples(self) -> int:
        """Number of samples: one per frequency point and measured entry, and per used time sample."""
        return sum(int(item.bound.used.sum()) for item in (*self.frequency, *self.time))

    @property
    def outputs(self) -> tuple[Signal, ...]:
        """The outputs, names and units."""
        return (*self.frequency, *self.time)[0].outputs

    @property
    def inputs(self) -> tuple[Signal, ...]:
        """The inputs, names and units."""
        return (*self.frequency, *self.time)[0].inputs

    @property
    def signals(self) -> tuple[Signal, Signal]:
        """The first output and the first input: all there are for SISO."""
        return self.outputs[0], self.inputs[0]

    @property
    def about(self) -> tuple[str, ...]:
        """Sentences on what the bounds hold for, the mean or the next record, and from how many excitations (`Bound.about`)."""
        sentences = (item.bound.about for item in (*self.frequency, *self.time))
        return tuple(dict.fromkeys(words for words in sentences if words))

    @property
    def of_one_excitation(self) -> bool:
        """True where a response was estimated from a single excitation: what follows is a statement for this excitation."""
        return any(item.bound.of_one_excitation for item in (*self.frequency, *self.time))

    @functools.cached_property
    def data_faults(self) -> tuple[Fault, ...]:
        """Faults of records from which responses were estimated, of responses, and of records beside them or alone, each once.

        See `response_faults`, `experiment_faults` and `record_faults`.
        """
        return tuple(placed.fault for placed in self.placed_faults)

    @property
    def open_faults(self) -> tuple[Fault, ...]:
        """The faults that nothing has undone."""
        return tuple(fault for fault in self.data_faults if not fault.undone)

    @property
    def scope(self) -> str:
        """Words that follow a claim about these data, ", for this excitation, from data with a fault"; empty where none is due."""
        return common_scope([self])

    @functools.cached_property
    def placed_faults(self) -> tuple[PlacedFault, ...]:
        """The faults, each with the response or the record that it is of, the first where several show it."""
        responses = [(k, one) for k, one in enumerate(self.frequency) if isinstance(one, FrequencyResponse)]
        alone = 0 if len(self.time) == 1 else None
        found = [PlacedFault(fault, "frequency", fault.response - 1) for fault in self.faults if fault.response]
        found += [PlacedFault(fault, "frequency", k) for k, one in responses for fault in all_faults(one)]
        beside = [*(fault for fault in self.faults if not fault.response), *self.record_faults]
        found += [PlacedFault(fault, "time", fault.record - 1 if fault.record else alone) for fault in beside]
        told = {one.number for one in found if one.kind == "time"}
        for k, record in enumerate(self.time):
            number = k + 1 if len(self.time) > 1 else 0
            own = [] if k in told else sample_faults(record)
            found += [PlacedFault(fault._replace(record=number), "time", k) for fault in own]
        kept: dict[str, PlacedFault] = {}
        for one in found:
            kept.setdefault(str(one.fault), one)
        return tuple(kept.values())

    @functools.cached_property
    def record_faults(self) -> tuple[Fault, ...]:
        """Faults of records beside responses (`experiment_faults`), but of experiments that `faults` names."""
        suspected = {fault.response - 1 for fault in self.faults if fault.response}
        named = {max(fault.record - 1, 0) for fault in self.faults if not fault.response}
        trusted = [item for k, item in enumerate(self.frequency) if k not in suspected]
        trusted = [item for item in trusted if isinstance(item, FrequencyResponse)] if self.time else []
        found = [fault for item in trusted for fault in experiment_faults(item, self.time)]
        return tuple(fault for fault in found if max(fault.record - 1, 0) not in named)

    @property
    def unknown_bounds(self) -> Real:
        """The parameter bounds of the independent parameters, entry by entry, (count m, 2)."""
        ends = np.moveaxis(self.parameter_bounds, 0, 2) if self.parameter_bounds.ndim == 4 else self.parameter_bounds
        pairs = np.broadcast_to(ends, (self.entries.outputs, self.entries.inputs, *ends.shape[-2:]))
        parts: dict[int, Real] = {}
        for output, input in np.ndindex(pairs.shape[:2]):
            number, part = self.entries.place(output, input)
            low, high = (pairs[output, input] / part).T
            if number in parts:
                low, high = np.maximum(low, parts[number][:, 0]), np.minimum(high, parts[number][:, 1])
            parts[number] = np.stack([low, high], axis=1)
        return np.concatenate([parts[number] for number in sorted(parts)])

    def with_prior(self, *, rate: float | None = None, **changes: Any) -> MixedProblem:
        """Problem with the same data and another prior; `rate` is the decay rate, in continuous time the decay."""
        prior = self.prior if rate is None else self.prior.with_rate(rate)
        return dataclasses.replace(self, prior=dataclasses.replace(prior, **changes))

    def node_index(self, angles: Real) -> NDArray[np.intp]:
        """Index of the node of each angle."""
        if not self.angles.size:
            return np.zeros(0, int)
        after = np.clip(np.searchsorted(self.angles, angles), 1, max(self.angles.size - 1, 1))
        pair = np.stack([after - 1, np.minimum(after, self.angles.size - 1)])
        return pair[np.argmin(np.abs(self.angles[pair] - angles), axis=0), np.arange(np.size(angles))]

    def _all_angles(self) -> Real:
        angles = [self.plane.angles(f.omega[f.bound.used.any(axis=(1, 2))]) for f in self.frequency]
        angles += [2 * np.pi * excited_lines(t) / t.u.shape[0] for t in self.time if t.initial == "periodic"]
        return np.concatenate(angles) if angles else np.zeros(0)

    def _region(self) -> Region:
        """The region of the class; of discrete data the prior states it per sample."""
        if isinstance(self.plane, ZPlane):
            self._set(prior=self.prior.sampled(self.plane.dt))
        return region_of(self.prior, self.plane)

    def _weighting(self) -> Weighting:
        """The weight of the class on the circle."""
        return Weighting(self.prior.weight_in(self.plane), self.plane)

    def _set_class(
        self, frequency: tuple[FrequencyResponse | TangentialResponse, ...], time: tuple[TimeRecord, ...]
    ) -> None:
        """Check what a passive class asks of the data, and pose it about its constant."""
        if not self.prior.physical:
            return
        check_passive(self.prior, self.entries, frequency, time)
        if self.prior.positive_real:
            prior, constant, bounds = centred(self)
            self._set(prior=prior, parametric=constant, parameter_bounds=bounds)
        elif self.parametric is not None:
            raise InputError(
                "`parametric` can't be joined with a BoundedReal class: with free coefficients the whole is not passive. Leave it"
                " out, and choose a `decay` below the smallest damping times frequency of the modes, in rad/s"
            )

    def _plane(self) -> Plane:
        """The plane of the data: of continuous time unless they have a sample time."""
        used = [f.omega[f.bound.used.any(axis=(1, 2))] for f in self.frequency]
        return plane_of((*self.frequency, *self.time)[0].dt, np.concatenate([np.zeros(0), *used]))

    def _taylor(self) -> int:
        used = [t.bound.used.any(axis=1) for t in self.time if t.initial != "periodic"]
        last = [np.flatnonzero(one)[-1] + 1 for one in used]
        return int(max(last, default=0))

    def _entries(self) -> Entries:
        p, q = len(self.outputs), len(self.inputs)
        if self.symmetric and p != q:
            raise InputError(
                f"`symmetric` needs as many outputs as inputs, in the same order; got {p} outputs and {q} inputs"
            )
        return Entries(p, q, self.symmetric and p > 1)

    def _check_integrators(self) -> None:
        if self.parametric is None or not self.parametric.has_integrator:
            return
        if np.any(self.angles == 0):
            raise InputError(
                "`frequency` has a point at omega = 0, where the integrator of `parametric` is infinite; leave that point out"
            )
        if any(t.initial == "periodic" for t in self.time):
            raise InputError(
                "`time`: a record in periodic steady state leaves the state of an integrator undetermined;"
                ' use initial="free", or `estimate_frf` and what it returns'
            )


def check_sampled(problem: MixedProblem) -> None:
    """Refuse a problem of continuous time where a response in time is asked for."""
    if not problem.dt:
        raise InputError(
            "`identification` is of continuous time, and a response in time needs a sample time: give the FrequencyResponse the"
            " `dt` at which inputs are held and outputs sampled, and identify it again"
        )


def posed_alone(frequency: object, time: object) -> MixedProblem:
    """Data with a prior of no meaning, to be chosen from them; whatever is wrong with the data is refused."""
    items: list[Any] = []
    for given in (frequency, time):
        items += given if isinstance(given, Sequence) else [given]
    dt = next((getattr(one, "dt", None) for one in items if one is not None), None)
    return MixedProblem(frequency=frequency, time=time, prior=any_prior(dt))


def excited_lines(record: TimeRecord) -> NDArray[np.intp]:
    """Spectral lines of the record at which its inputs are not zero."""
    spectrum = np.abs(np.fft.rfft(record.u, axis=0))
    spectrum = (spectrum / np.maximum(spectrum.max(axis=0), np.finfo(float).tiny)).max(axis=1)
    return np.flatnonzero(spectrum > _EXCITED * spectrum.max(initial=0.0))


def _experiments(name: str, value: object, kinds: tuple[type, ...]) -> tuple[Any, ...]:
    if value is None:
        return ()
    items: tuple[Any, ...] = tuple(cast("Sequence[Any]", value)) if isinstance(value, Sequence) else (value,)
    for item in items:
        if not isinstance(item, kinds):
            raise InputTypeError(
                f"`{name}` must be a {kinds[0].__name__} or a sequence of them; got {type(item).__name__}"
            )
        if item.bound is None:
            raise InputError(f"`{name}` needs a bound on every sample; use with_bound, estimate_bound or estimate_frf")
        if not np.any(item.bound.used):
            raise InputError(f"`{name}` has no sample with a finite bound; nothing would be used")
    return items


def _intervals(value: object, basis: ParametricBasis | None, entries: Entries) -> Real:
    """The parameter bounds, checked."""
    if basis is None:
        raise InputError(
            "`parameter_bounds` bounds the coefficients of `parametric`, which is missing; give both or none"
        )
    ends = as_array("parameter_bounds", value, finite=False)
    each = (basis.size, entries.outputs, entries.inputs, 2)
    if ends.shape != (basis.size, 2) and (entries.single or ends.shape != each):
        raise InputError(
            f"`parameter_bounds` must have shape (m, 2) with m = {basis.size} from `parametric`, a lower and an upper end"
            f" of each{'' if entries.single else f', or (m, ny, nu, 2) = {each}'}; got {ends.shape}"
        )
    for place in np.ndindex(ends.shape[:-1]):
        number, (low, high) = place[0], ends[place]
        name = f"`parameter_bounds`: number {number} ({basis.labels[number]})"
        if np.isnan([low, high]).any():
            raise InputError(f"{name} must not be NaN; a free coefficient has the ends -inf and inf")
        if low > high:
            raise InputError(f"{name} has its lower end above the upper one: {low:g} > {high:g}; swap them")
        if np.isfinite([low, high]).sum() == 1 or (low == high and np.isinf(low)):
            raise InputError(
                f"{name} has one infinite end: [{low:g}, {high:g}]; give both ends, the other one a size that is surely not"
                " exceeded, or -inf and inf"
            )
    return ends


def _merge(angles: Real) -> Real:
    angles = np.sort(np.where(angles >= np.pi * (1 - _SAME_ANGLE), np.pi, angles))
    keep = np.ones(angles.size, bool)
    keep[1:] = np.diff(angles) > _SAME_ANGLE * angles[1:]
    return angles[keep]


def _check_same_time(items: Sequence[Any]) -> None:
    steps = [item.dt or 0.0 for item in items]
    if min(steps) == 0 < max(steps):
        raise InputError(
            f"`dt`: some experiments are of continuous time (no dt), others are sampled (dt = {max(steps):g} s); give each"
            " FrequencyResponse the sample time of the records"
        )
    if max(steps) - min(steps) > 1e-9 * max(steps):
        raise InputError(f"`dt` differs between experiments: {sorted(set(steps))} s; resample to one sample time")


def common_scope(problems: Sequence[MixedProblem]) -> str:
    """Words that follow a claim about the data of several problems: each once, where it is due to any of them."""
    one, open_ = any(each.of_one_excitation for each in problems), [f for each in problems for f in each.open_faults]
    asked = bool(open_) and all(fault.asks for fault in open_)
    faulty = ", with a delay that nobody stated" if asked else ", from data with a fault" if open_ else ""
    return ", for this excitation" * one + faulty
