"""response_tube(): responses of all consistent systems in time, to an impulse, a step or any known input."""

from __future__ import annotations

import concurrent.futures
import dataclasses
import functools
import itertools
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robustid.core import Budget, Frozen, Progress, Real, as_kind, as_positive, freeze, one_thread, simulate
from robustid.errors import InputError
from robustid.figures import Drawable
from robustid.guarantees.consistent_set import which
from robustid.guarantees.curvature import known_part
from robustid.guarantees.linear.amplitudes import Extraction
from robustid.guarantees.nominal import as_nominal
from robustid.guarantees.outputs import (
    Outputs,
    as_entry,
    as_samples,
    as_signal,
    consistent_outputs,
    driven,
    tail_bounds,
)
from robustid.guarantees.parameters import ParameterIntervals, parameter_claims, parameter_intervals
from robustid.guarantees.tube_ends import ends_by_sums, extraction_of, little_work, reach_of, solved_ends, sums_of
from robustid.identification import Identification, SupportCertificate, check_gain, check_sampled

if TYPE_CHECKING:
    import control


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ResponseTube(Frozen, Drawable):
    """The response to a known input of every consistent system with zero initial conditions: lower <= y_k <= upper, both proved.

    Assumed is what the identification assumes: gain bound, decay rate, parametric poles, and the bounds of the samples.

    Attributes
    ----------
    identification : Identification
    model : control.StateSpace
        The nominal that the errors are measured from.
    input : str
        "impulse", "step" or "given".
    u : (H,) array
        Over the horizon.
    samples : (T,) int array
        Numbers k of the samples that were bounded, ascending; not always all H.
    lower, upper : (T,) arrays
    attained : (T, 2) array
        Consistent systems were found whose output is at most the first and at least the second: no tube is narrower. NaN where
        none was verified.
    parameters : ParameterIntervals
        Infinite where they were too much work; peaks then stand on sums.
    certificates : tuple of SupportCertificate or None
        Of -y_k and of y_k, in turn; None of ends that are proved by sums of the samples, which `verify` makes again.
    gap : float
        Part of the distance from the centre to which every end with a certificate was found.
    entry : (int, int)
        Output and input; the other inputs are 0.
    """

    identification: Identification
    model: control.StateSpace
    input: str
    u: Real
    samples: NDArray[np.intp]
    lower: Real
    upper: Real
    attained: Real
    parameters: ParameterIntervals
    certificates: tuple[SupportCertificate | None, ...]
    gap: float
    entry: tuple[int, int] = (0, 0)

    def __post_init__(self) -> None:
        self._set(**{name: freeze(getattr(self, name)) for name in ("u", "samples", "lower", "upper", "attained")})

    @property
    def times(self) -> Real:
        """Instants of the samples in s, (T,)."""
        return freeze(self.samples * self.identification.problem.dt)

    @property
    def complete(self) -> bool:
        """Return whether every sample of the horizon was bounded."""
        return self.samples.size == self.u.size

    @functools.cached_property
    def _simulated(self) -> Real:
        return simulate(self.model, driven(self.u, self.entry, self.identification))[0][:, self.entry[0]]

    @property
    def response(self) -> Real:
        """Response of the model over the whole horizon, (H,)."""
        return freeze(self._simulated)

    @property
    def nominal(self) -> Real:
        """Response of the model at `times`, (T,)."""
        return freeze(self._simulated[self.samples])

    @property
    def error_upper(self) -> Real:
        """Guaranteed bound of |y - nominal| over all consistent systems, (T,)."""
        return freeze(np.maximum(self.upper - self.nominal, self.nominal - self.lower))

    @property
    def error_lower(self) -> Real:
        """Error of consistent systems that were found, (T,): no bound can be smaller."""
        beyond = np.stack([self.nominal - self.attained[:, 0], self.attained[:, 1] - self.nominal])
        return freeze(np.maximum(np.nan_to_num(beyond).max(axis=0), 0.0))

    @property
    def peak(self) -> float:
        """Guaranteed bound of max |y_k| over the whole horizon; see `error_peak` for samples that were left out."""
        bounds = np.abs(self._simulated) + self._errors
        bounds[self.samples] = np.maximum(np.abs(self.lower), np.abs(self.upper))
        return float(bounds.max())

    @property
    def error_peak(self) -> float:
        """Guaranteed bound of max |y_k - nominal_k| over the whole horizon; of an impulse response over all k.

        At samples that were left out, and after the horizon, from the class: |g_k| <= K rho^-k, and the certified intervals of
        the parameters.
        """
        return float(max(self._errors.max(), self._after[1] if self.input == "impulse" else 0.0))

    @property
    def error_l1(self) -> float:
        """Guaranteed bound of sum_k |f_k - nominal_k| over all k, f the impulse response: the peak-to-peak gain of the error.

        The tube inside the horizon; after it |g_k| <= K rho^-k, and the parametric functions times the certified intervals. It is
        infinite where an integrator is uncertain.

        Raises
        ------
        InputError
            The tube is not that of an impulse.
        """
        if self.input != "impulse":
            raise InputError(
                f'`error_l1` is the norm of an impulse response; this tube is of input {self.input!r}: use input="impulse"'
            )
        return float(self._errors.sum() + self._after[0])

    @one_thread()
    def verify(self) -> bool:
        """Evaluate all certificates again, from their numbers and those of the problem; no solver's answer is involved."""
        ends = np.stack([-self.lower, self.upper], axis=1)
        pairs, outputs = itertools.product(range(self.samples.size), (0, 1)), self._outputs
        return (
            len(self.certificates) == ends.size
            and all(
                (2.0 * side - 1) * float(self._sums[side][self.samples[k]]) <= ends[k, side]
                if certificate is None
                else outputs.supports(
                    int(self.samples[k]), 2.0 * side - 1, float(ends[k, side]), certificate, self.entry[0]
                )
                for (k, side), certificate in zip(pairs, self.certificates, strict=True)
            )
            and all(claim.verify() for claim in parameter_claims(outputs.consistent, self.parameters))
        )

    @functools.cached_property
    def _outputs(self) -> Outputs:
        return consistent_outputs(self.identification, driven(self.u, self.entry, self.identification))

    @property
    def solved(self) -> int:
        """Number of samples whose ends are proved by semidefinite programs; those of the others are by sums, and wider."""
        return sum(one is not None for one in self.certificates) // 2

    @functools.cached_property
    def _extraction(self) -> Extraction:
        return extraction_of(self.identification, self.entry)

    @functools.cached_property
    def _sums(self) -> tuple[Real, Real]:
        """Lower and upper ends over the horizon, (H,) each, by sums of the samples."""
        return sums_of(self._extraction, self.u)

    @functools.cached_property
    def _reach(self) -> Real:
        """Largest distance of each parameter of the entry from that of the identification, (m,)."""
        reach = self._of_entry(self.parameters.reach(self.identification.parameters))
        if np.all(np.isfinite(reach)):
            return reach
        return reach_of(self._extraction, self._of_entry(self.identification.parameters))

    def _of_entry(self, parameters: Real) -> Real:
        """(m,) of parameters (m,), or (m, ny, nu)."""
        return parameters.reshape(-1, *self.identification.problem.entries.shape)[:, *self.entry]

    @property
    def _gain(self) -> float:
        """Gain bound of the entry; with a weight, times the largest value of that where the class is bounded."""
        problem = self.identification.problem
        prior, peak = problem.prior, problem.weighting.peak(problem.prior.decay_rate)
        return prior.gain_bound * float(prior.scales(*problem.entries.shape)[self.entry]) * peak

    @functools.cached_property
    def _errors(self) -> Real:
        """Bounds of |y_k - nominal_k| at every sample of the horizon, (H,).

        Where no tube was computed: from the class, or from the next sample that has one and what the class lets the
        difference of both be, whichever is least.
        """
        count, bounds = self.u.size, np.full(self.u.size, np.inf)
        bounds[self.samples] = self.error_upper
        others: list[int] = np.setdiff1d(np.arange(count), self.samples).tolist()
        for k in others:
            after = int(np.searchsorted(self.samples, k))
            candidates = [self._largest(self._delayed(k))]
            for near in self.samples[max(after - 1, 0) : after + 1]:
                difference = self._delayed(k) - self._delayed(near)
                candidates.append(float(bounds[near]) + self._largest(difference))
            bounds[k] = min(candidates)
        return bounds

    def _delayed(self, k: int) -> Real:
        """Weights of f_0 ... f_(H-1) in y_k."""
        return np.concatenate([self.u[k::-1], np.zeros(self.u.size - 1 - k)])

    def _largest(self, weights: Real) -> float:
        """Bound of |sum_j weights_j (f_j - nominal_j)| from the class and the intervals of the parameters alone."""
        known, functions, decay = self._impulses
        return float(abs(weights @ known) + np.abs(weights @ functions) @ self._reach + np.abs(weights) @ decay)

    @functools.cached_property
    def _impulses(self) -> tuple[Real, Real, Real]:
        """Impulse responses: q'P - nominal (H,), the functions P_i (H, m) and the bound K rho^-k of |g_k| (H,)."""
        problem, count = self.identification.problem, self.u.size
        pulse = driven(np.eye(count, 1)[:, 0], self.entry, self.identification)
        known = -simulate(self.model, pulse)[0][:, self.entry[0]]
        functions = np.zeros((count, 0)) if problem.parametric is None else problem.parametric.impulse(count)
        decay = self._gain * problem.prior.decay_rate ** -np.arange(count, dtype=float)
        return known + functions @ self._of_entry(self.identification.parameters), functions, decay

    @functools.cached_property
    def _after(self) -> tuple[float, float]:
        """Sum and maximum of |f_k - nominal_k| after the horizon."""
        problem, count = self.identification.problem, self.u.size
        K, rho, basis = self._gain, problem.prior.decay_rate, problem.parametric
        first, (output, input) = K * rho ** -float(count), self.entry
        A, B, C = known_part(self.model, self.identification)
        total, largest = tail_bounds(A, B[:, [input]], C[[output]], count)
        sums = [first / (1 - 1 / rho) + float(total[0]), first + float(largest[0])]
        if basis is not None:
            loose = self._reach > 0
            for place, tail in enumerate(tail_bounds(basis.A, basis.B, basis.C[loose], count)):
                sums[place] += float(tail @ self._reach[loose])
        return sums[0], sums[1]

    def __repr__(self) -> str:
        return f"<ResponseTube: {self.input}, {self.samples.size} of {self.u.size} samples, error {self.error_upper.max():.4g}>"

    def summary(self) -> str:
        """The result in plain text."""
        worst, problem = int(np.argmax(self.error_upper)), self.identification.problem
        share = "every sample" if self.complete else f"{self.samples.size} of {self.u.size} samples"
        by_sums, reached = self.samples.size - self.solved, self.error_lower[worst]
        attained = f" (attained there: {reached:.4g})" if reached > 0 else ""
        lines = [
            f"guarantee  every consistent system's response to the {self.input} input{which(problem, self.entry)} stays within"
            f" {self.error_upper.max():.4g} of the model at {share}",
            f"           worst at {self.times[worst]:.5g} s{attained}",
            f"peak       |y| <= {self.peak:.4g}, |y - model| <= {self.error_peak:.4g} over the whole horizon of"
            f" {self.u.size * problem.dt:.5g} s",
        ]
        if by_sums:
            lines.append(
                f"sums       prove {by_sums} of the samples, wider than programs would: state `times`, or a time limit, for these"
            )
        if self.input == "impulse":
            lines.append(f"l1 norm    of the error, over all time: at most {self.error_l1:.4g}")
        lines.append(
            "assumed    gain bound, decay rate, poles and bounds of the samples: data can refute them, never prove them"
        )
        return "\n".join(lines)


@one_thread()
def response_tube(
    identification: Identification,
    *,
    input: str | ArrayLike = "impulse",
    entry: tuple[int | str, int | str] | None = None,
    horizon: int | None = None,
    model: control.StateSpace | None = None,
    times: ArrayLike | None = None,
    gap: float = 0.01,
    executor: concurrent.futures.Executor | None = None,
    progress: Progress | None = None,
    time_limit: float | None = None,
) -> ResponseTube:
    """Guaranteed tube around the response to an impulse, a step or a given input: no consistent system leaves it.

    Every output sample is a linear functional of the system, so that its smallest and largest value over all consistent systems are
    two convex problems, each answered with a certificate (evaluated without the solver) and with a system that almost attains it:

        lower_k <= y_k = sum_j u_(k-j) f_j <= upper_k    for every consistent F, zero initial conditions.

    Parameters
    ----------
    identification : Identification
        Consistent.
    input : {"impulse", "step"} or (H,) array
        Unit impulse or step (in units of the input), or any input that meets zero initial conditions: its worst-case output.
    entry : (output, input), optional
        By number or name; needed where there are several outputs or inputs. The other inputs are 0.
    horizon : int, optional
        Number H of samples. Default: the length of a given input; else where the class lets the non-parametric part fall to 1 % of
        its gain bound, at least the time data, at most 500.
    model : control.StateSpace, optional
        Any stable nominal with the dt of the data. Default: that of the identification.
    times : (T,) array, s, optional
        Sample instants at which the tube is wanted. Default: every sample of up to 60, else 60 spread over the horizon; where these
        would take longer than some seconds, without a time limit, every sample, few of them by programs and all others by sums.
    gap : float
        Aim for the distance between a proved end and an attained one, relative to the distance from the centre.
    executor : concurrent.futures.Executor, optional
        Spreads the samples. Default: in this process.
    progress : callable (text, done, count), optional
    time_limit : float, optional
        Seconds; then, and on Ctrl-C, the tube has the samples that are finished, spread over the horizon.

    Returns
    -------
    ResponseTube

    Raises
    ------
    InconsistentDataError
        The data fit no system of the class.
    InputError
        An unknown signal, no entry of a matrix, instants that are no samples of the horizon, an unstable model.

    Notes
    -----
    The coefficients determine the impulse response over the horizon: Taylor coefficients join the exact form, or the problem is
    posed in them. Where both are too large (a slow decay and a long horizon) the remainder is bounded by its H2 norm.
    Source: `inanc2001` section II-C; the certificate is the dual of the LMI of Theorem 1 with a linear objective.

    Examples
    --------
    One sample f_0 = 0 leaves |f_1| <= K/rho (Schwarz's lemma):

    >>> import numpy as np, robustid as rid
    >>> from robustid.guarantees import response_tube
    >>> record = rid.TimeRecord([1.0], [0.0], dt=0.1, bound=1e-6)
    >>> result = rid.identify(rid.MixedProblem(time=record, prior=rid.Prior(gain_bound=1.0, decay_rate=2.0)))
    >>> tube = response_tube(result, horizon=2)
    >>> tube.times, tube.upper.round(2), tube.verify()
    (array([0. , 0.1]), array([0. , 0.5]), True)
    """
    as_kind("identification", identification, Identification, "an Identification")
    check_sampled(identification.problem)
    check_gain(identification.problem, "a response in time")
    at = as_entry(entry, identification.problem)
    kind, u = as_signal(input, horizon, identification)
    samples = as_samples(times, u.size, identification.problem.dt)
    model, gap = as_nominal(model, identification), as_positive("gap", gap)
    outputs = consistent_outputs(identification, driven(u, at, identification))
    budget = Budget(time_limit, progress, "bounding the response")
    spare = None
    if times is None and time_limit is None and not little_work(outputs, samples.size):
        sums = sums_of(extraction_of(identification, at), u)
        ends, spare = ends_by_sums(outputs, at[0], sums, gap, executor, budget), Budget(1e-9)
    else:
        ends = solved_ends(outputs, at[0], samples, gap, executor, budget)
    return ResponseTube(
        identification=identification,
        model=model,
        input=kind,
        u=u,
        samples=ends.samples,
        lower=ends.lower,
        upper=ends.upper,
        attained=ends.attained,
        parameters=parameter_intervals(outputs.consistent, budget=spare),
        certificates=ends.certificates,
        gap=gap,
        entry=at,
    )
