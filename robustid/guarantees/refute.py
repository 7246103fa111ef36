"""refute(): comparison of new samples with what an identification guarantees."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from robustid.core import Complex, Frozen, Real, as_kind, freeze, hz_words, one_thread, threads_for, time_words
from robustid.data import FrequencyResponse, TimeRecord
from robustid.errors import InputError, InputTypeError
from robustid.guarantees.consistent_set import ConsistentSet, consistent_set, which
from robustid.guarantees.outputs import consistent_outputs
from robustid.guarantees.value_set import SupportClaim
from robustid.identification import Functional, Identification, MixedProblem, SupportCertificate

Experiment = FrequencyResponse | TimeRecord

_GAP = 5e-3  # of the ends that are proved
_TRIES, _PROGRESS = 12, 1e-3  # half-planes for one sample, and the least that another one must bring


@dataclasses.dataclass(frozen=True, eq=False)
class HalfPlane(Frozen):
    """A proof that Re(conj(normal) v) <= value for the value v of every consistent system at one new sample."""

    place: int  # number of the sample within its experiment
    normal: complex  # of modulus 1; 1 or -1 for time samples
    value: float
    certificate: SupportCertificate


@dataclasses.dataclass(frozen=True, eq=False)
class Judged(Frozen):
    """The new samples of one experiment against everything that is consistent."""

    kind: str  # {"frequency", "time"}
    index: int  # number of the experiment, as given
    axis: Real  # (N,); rad/s, or s; only samples with a finite bound
    # (N,); proved: no consistent system has a smaller |error|/bound at this sample. 0 where a consistent system is
    # inside the bound
    ratio: Real
    # (N,); |error|/bound of a consistent system that was found at this sample; inf where none was verified
    attainable: Real
    proofs: tuple[HalfPlane, ...]  # for the samples that the centre of the set does not keep
    entries: NDArray[np.intp]  # (N, 2); output and input of each sample; of a record the input is 0

    def __post_init__(self) -> None:
        self._set(**{name: freeze(getattr(self, name)) for name in ("axis", "ratio", "attainable", "entries")})


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Refutation(Frozen):
    """Verdict whether new samples contradict an identification, each by itself: which one, and by how much.

    Attributes
    ----------
    identification : Identification
    data : tuple of FrequencyResponse or TimeRecord
        The new samples.
    samples : tuple of Judged
        One entry per experiment.
    """

    identification: Identification
    data: tuple[Experiment, ...]
    samples: tuple[Judged, ...]

    @property
    def ratio(self) -> Real:
        """Proved distance of every sample from everything consistent, in units of its bound, (N,): above 1 it refutes."""
        return np.concatenate([s.ratio for s in self.samples])

    @property
    def attainable(self) -> Real:
        """Distance of every sample from a consistent system that was found, in units of its bound, (N,)."""
        return np.concatenate([s.attainable for s in self.samples])

    @property
    def refuted(self) -> bool:
        """Return whether a sample is proved to be further from everything consistent than its bound."""
        return bool(np.any(self.ratio > 1))

    @property
    def inside(self) -> bool:
        """Return whether for every sample a consistent system was found that keeps it (for each its own)."""
        return bool(np.all(self.attainable <= 1))

    @property
    def worst(self) -> tuple[str, int, float, float, float]:
        """The sample furthest outside: (kind, experiment, rad/s or s, ratio, attainable)."""
        labels = [(s.kind, s.index, float(at)) for s in self.samples for at in s.axis]
        k = self._worst
        return *labels[k], float(self.ratio[k]), float(self.attainable[k])

    @property
    def _worst(self) -> int:
        return int(np.lexsort((self.attainable, self.ratio))[-1])

    @property
    def _place(self) -> str:
        """The sample furthest outside, in words."""
        kind, index, at, _, _ = self.worst
        output, input = np.concatenate([s.entries for s in self.samples])[self._worst].tolist()
        problem = self.identification.problem
        where = hz_words(at / (2 * np.pi)) if kind == "frequency" else f"{at:.5g} s"
        return f"{kind} experiment {index + 1} at {where}{which(problem, (output, input if kind == 'frequency' else None))}"

    @one_thread()
    def verify(self) -> bool:
        """Evaluate all certificates again and compare the distances with them; no solver's answer is involved."""
        return all(
            _verify(self.identification, item, judged) for item, judged in zip(self.data, self.samples, strict=True)
        )

    @property
    def verdict(self) -> tuple[str, str]:
        """The verdict in a word, refuted, inside or undecided, and in a sentence."""
        count, place = self.ratio.size, self._place
        if self.refuted:
            broken = int(np.sum(self.ratio > 1))
            return "refuted", f"{broken} of {count} new samples contradict the guarantee; worst: {place}"
        if self.inside:
            kept = f"each of the {count} new samples is kept by a consistent system; nearest to its bound: {place}"
            return "inside", kept
        open_ = int(np.sum(self.attainable > 1))
        return "undecided", f"{open_} of {count} new samples are at the edge of what is consistent; worst: {place}"

    def __repr__(self) -> str:
        return f"<Refutation: {self.verdict[0]}, {self.ratio.size} new samples, worst ratio {self.ratio.max():.4g}>"

    def summary(self) -> str:
        """The result in plain words."""
        *_, ratio, attainable = self.worst
        word, sentence = self.verdict
        found = f"one was found at {attainable:.4g}" if np.isfinite(attainable) else "none was found"
        tail = {
            "refuted": f"no consistent system comes nearer to it than {ratio:.4g} times its bound ({found})",
            "inside": f"({attainable:.4g} times its bound at most)",
            "undecided": f"the nearest consistent value is between {ratio:.6g} and {attainable:.6g} times its bound away",
        }[word]
        meaning = "nothing is proved of the samples jointly: identify with the old and the new data together"
        if self.refuted:
            meaning = (
                "an assumption is wrong, data cannot say which: gain bound, decay rate, parametric poles or their"
                " intervals, a bound of the old samples, or the bound of this one"
            )
        return "\n".join([f"{word:<11}{sentence}", f"           {tail}", f"meaning    {meaning}"])


@one_thread()
def refute(identification: Identification, new_data: Experiment | Sequence[Experiment]) -> Refutation:
    """Compare new samples with everything that an identification leaves possible; say which one breaks it, and by how much.

    For every new sample y with its bound e, the two numbers that enclose its distance from all consistent systems:

        ratio <= min over consistent F of |y - F|/e <= attainable.

    A ratio above 1 is a proof that no system of the class keeps the old samples and this one: it refutes an assumption (the class,
    or one of the bounds; data cannot say which). An attainable value of at most 1 is a consistent system that keeps the sample.

    Parameters
    ----------
    identification : Identification
        Consistent.
    new_data : FrequencyResponse, TimeRecord, or a sequence of them
        With bounds of the entries (ellipses too), the outputs, inputs and dt of the data; records with zero initial conditions.

    Returns
    -------
    Refutation

    Raises
    ------
    InconsistentDataError
        The old data fit no system of the class already.
    InputError, InputTypeError
        Other objects, no bounds or joint ones, another dt, other signals or units, a record with other than zero initial
        conditions, a frequency point on an integrator.

    Notes
    -----
    Each sample by itself: samples that are inside one by one may still contradict the class together, which `identify` decides for
    old and new data joined. The distance is proved by half-planes, each with a certificate, turned towards the nearest value that
    is attained so far (Gilbert's method). Source: model validation, `inanc2001` section II.

    Examples
    --------
    The class allows |f_1| <= 1/2 after f_0 = 0:

    >>> import robustid as rid
    >>> from robustid.guarantees import refute
    >>> record = rid.TimeRecord([1.0], [0.0], dt=0.1, bound=1e-6)
    >>> result = rid.identify(rid.MixedProblem(time=record, prior=rid.Prior(gain_bound=1.0, decay_rate=2.0)))
    >>> found = refute(result, rid.TimeRecord([1.0, 0.0], [0.0, 0.7], dt=0.1, bound=0.1))
    >>> found.refuted, found.ratio.round(2), found.verify()
    (True, array([0., 2.]), True)
    """
    as_kind("identification", identification, Identification, "an Identification")
    data = tuple(new_data) if isinstance(new_data, Sequence) else (new_data,)
    if not data:
        raise InputError("`new_data` is empty; give at least one FrequencyResponse or TimeRecord")
    for item in data:
        _check(item, identification.problem)
    samples: list[Judged] = []
    numbers = {FrequencyResponse: 0, TimeRecord: 0}
    for item in data:
        number, numbers[type(item)] = numbers[type(item)], numbers[type(item)] + 1
        found: list[tuple[float, float]] = []
        proofs: list[HalfPlane] = []
        for place in _places(identification, item, None):
            with threads_for(place.consistent.data.sarason.pair.order):
                ratio, attainable, planes = _judge(place)
            found.append((ratio, attainable))
            proofs += planes
        ratio, attainable = np.array(found).T
        used = np.argwhere(item.bound.used)
        if isinstance(item, FrequencyResponse):
            kind, axis, entries = "frequency", item.omega, used[:, 1:]
        else:
            kind, axis, entries = "time", item.time, np.column_stack([used[:, 1], np.zeros(len(used), int)])
        samples.append(Judged(kind, number, axis[used[:, 0]], ratio, attainable, tuple(proofs), entries))
    return Refutation(identification=identification, data=data, samples=tuple(samples))


@dataclasses.dataclass(frozen=True, eq=False)
class _Place:
    """One new sample y, and the value at it as a functional of the set: x, p weigh the coefficients, complex in frequency."""

    number: int
    y: complex
    bound: float
    tilt: complex
    consistent: ConsistentSet
    x: Real | Complex
    p: Real | Complex
    tail: float

    def functional(self, normal: complex) -> Functional:
        """Re(conj(normal) v)."""
        turn = np.conj(normal)
        return Functional(np.real(turn * self.x), np.real(turn * self.p), self.tail)

    def relative(self, value: complex) -> complex:
        """Error of a value in units of the bound: its modulus counts."""
        error = self.y - value
        return (error + self.tilt * np.conj(error)) / self.bound

    def beyond(self, plane: HalfPlane) -> float:
        """Distance of the sample from the half-plane, in units of its bound.

        e = y - v has Re(conj(n) e) >= d = Re(conj(n) y) - value. With t = e + kappa conj(e), a symmetric map, Re(conj(n) e) =
        Re(conj(m) t) for m = (n - kappa conj(n))/(1 - |kappa|^2), hence |t| >= d/|m|.
        """
        n = plane.normal
        turned = abs(n - self.tilt * np.conj(n)) / (1 - abs(self.tilt) ** 2)
        return max(0.0, float(np.real(np.conj(n) * self.y) - plane.value) / (turned * self.bound))


def _places(identification: Identification, item: Experiment, wanted: set[int] | None) -> Iterator[_Place]:
    """The used samples of one experiment, or those `wanted` of them."""
    used = np.argwhere(item.bound.used)  # frequency, output and input; or sample and output
    if isinstance(item, TimeRecord):
        outputs = consistent_outputs(identification, item.u[: used[:, 0].max() + 1])
        for number, (k, i) in enumerate(used.tolist()):
            if wanted is None or number in wanted:
                f = outputs.functional(k, output=i)
                sample = float(item.y[k, i]), float(item.bound.radius[k, i]), 0.0
                yield _Place(number, *sample, outputs.consistent, f.x, f.p, f.tail)
        return
    own, before = consistent_set(identification), (-1, None)
    tilt = np.zeros(item.values.shape, complex) if item.bound.tilt is None else item.bound.tilt
    for number, (k, i, j) in enumerate(used.tolist()):
        if wanted is None or number in wanted:
            omega = float(item.omega[k])
            here = before[1] if before[0] == k and before[1] is not None else own.with_node(omega)
            before = k, here
            sample = complex(item.values[k, i, j]), float(item.bound.radius[k, i, j]), complex(tilt[k, i, j])
            yield _Place(number, *sample, here, *here.value_weights(omega, (i, j)))


def _judge(place: _Place) -> tuple[float, float, list[HalfPlane]]:
    """Proved and attained distance of one sample, and the half-planes that prove it.

    Gilbert's method: maximise over the set in the direction from the nearest attained value to the sample.
    """
    here, center = place.consistent, place.consistent.center
    # |e + kappa conj(e)| grows by at most 1 + |kappa| times what the other coefficients do.
    slack = place.tail * (1 + abs(place.tilt)) / place.bound
    nearest = place.relative(complex(place.x @ center.x + place.p @ center.p))
    attained = [nearest] if here.contains(center.x, center.p) else []
    ratio, attainable = 0.0, abs(nearest) + slack if attained else np.inf
    planes: list[HalfPlane] = []
    while attainable > 1 and len(planes) < _TRIES:
        normal = nearest + place.tilt * np.conj(nearest)  # Re(conj(t) T(e)) = Re(conj(T(t)) e)
        normal = normal / abs(normal) if normal else 1.0
        found = here.extreme(place.functional(normal), _GAP)
        planes.append(HalfPlane(place.number, normal, found.upper, found.certificate))
        ratio, before = max(ratio, place.beyond(planes[-1])), attainable
        if np.isfinite(found.attained):
            attained.append(place.relative(complex(place.x @ found.x + place.p @ found.p)))
            nearest = _nearest(np.array(attained))
            attainable = abs(nearest) + slack
        if not attained or attainable > (1 - _PROGRESS) * before or attainable - ratio <= _GAP * attainable:
            break
    return ratio, attainable, planes


def _nearest(errors: Complex) -> complex:
    """Approximately the number of least modulus in the convex hull of attained errors: a convex combination, hence attained too."""
    import scipy.optimize

    size, heavy = float(np.abs(errors).max()), 1e3
    rows = np.stack([np.real(errors) / size, np.imag(errors) / size, np.full(errors.size, heavy)])
    weights = scipy.optimize.nnls(rows, np.array([0.0, 0.0, heavy]))[0]
    mixed, single = complex(weights @ errors / weights.sum()), complex(errors[np.argmin(np.abs(errors))])
    return min(mixed, single, key=abs)


def _verify(identification: Identification, item: Experiment, judged: Judged) -> bool:
    """Return whether the half-planes hold and prove the ratios; a sample without one is proved to be 0 away."""
    proved = np.zeros(judged.ratio.size)
    for place in _places(identification, item, {plane.place for plane in judged.proofs}):
        data = place.consistent.data
        for plane in judged.proofs:
            if plane.place != place.number:
                continue
            about = place.functional(plane.normal), plane.value, plane.certificate, data.rows, data.sarason
            if not (abs(abs(plane.normal) - 1) < 1e-12 and SupportClaim(f"sample {place.number}", *about).verify()):
                return False
            proved[place.number] = max(proved[place.number], place.beyond(plane))
    return bool(np.all(judged.ratio <= proved))


def _check(item: object, problem: MixedProblem) -> None:
    """One experiment of new data: of the same plant, with bounds."""
    if not isinstance(item, FrequencyResponse | TimeRecord):
        raise InputTypeError(
            f"`new_data` must be a FrequencyResponse, a TimeRecord or a sequence of them; got {type(item).__name__}"
        )
    ours, theirs = problem.entries, (len(item.outputs), len(item.inputs))
    if theirs != ours.shape:
        raise InputError(
            f"`new_data` must have the outputs and inputs of the identified data, {ours.outputs} and {ours.inputs};"
            f" got {theirs[0]} and {theirs[1]}"
        )
    for role, old, new in (("output", problem.outputs, item.outputs), ("input", problem.inputs, item.inputs)):
        for a, b in zip(old, new, strict=True):
            if a.unit and b.unit and a.unit != b.unit:
                raise InputError(
                    f"`new_data` has its {role} in [{b.unit}], the identification in [{a.unit}]; convert it"
                )
    if abs((item.dt or 0.0) - problem.dt) > 1e-9 * problem.dt:
        own, other = time_words(problem.dt), time_words(item.dt)
        raise InputError(f"`new_data` must have the dt of the identified data, {own}; got {other}")
    if item.bound is None or not np.any(item.bound.used):
        raise InputError("`new_data` needs a bound on its samples: what is outside depends on it; use with_bound(...)")
    if item.bound.radius is None or item.bound.joint != "entry":
        raise InputError(
            "`new_data` needs a bound of every entry; a bound that entries share tells nothing of one alone"
        )
    if isinstance(item, TimeRecord) and item.initial != "rest":
        joined = "identify with the old and the new data together"
        hint = joined if item.initial == "free" else "use `estimate_frf` and its frequency response"
        raise InputError(
            f"`new_data` must have zero initial conditions; got a record with initial={item.initial!r}: {hint}"
        )
    basis = problem.parametric
    if isinstance(item, FrequencyResponse) and basis is not None and basis.has_integrator and item.omega[0] == 0:
        raise InputError(
            "`new_data` has a frequency point at omega = 0, where the integrator of the parametric part is infinite; leave it out"
        )
