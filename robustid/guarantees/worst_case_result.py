"""Result of worst_case_error(): bounds of the error at every frequency, in every parameter and on the circle, with proofs."""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np

from robustid.core import Real, Source, Tabular, counted, freeze, hz_words, rounded_up, threads_for
from robustid.errors import InputError
from robustid.guarantees.circle import LARGEST, CircleBound, ModelError, refine, supported
from robustid.guarantees.consistent_set import ConsistentSet, Sample, consistent_set, which
from robustid.guarantees.over_cells import WorstCase
from robustid.guarantees.parameters import ParameterIntervals, parameter_claims, parameter_intervals
from robustid.guarantees.pole_proofs import Cell
from robustid.guarantees.stated_box import has_single_pairs
from robustid.guarantees.sweep import Means, Processes
from robustid.guarantees.value_set import Errors, SupportClaim, ValueSet, by_frequency, value_set_claims
from robustid.identification import Identification, MixedProblem

_AT_ONCE = 5.0  # seconds of work, as estimated, that an attribute may take
_COARSE_STEPS = 100  # Newton steps at a frequency of the circle, approximately
_SECONDS, _EACH = 2e-10, 0.01  # for a multiplication of a Newton step, and for a frequency besides: estimates


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class WorstCaseError(WorstCase, Tabular):
    """Largest distance of all consistent systems from a model, of poles as stated: proved from above, attained from below.

    The guarantee holds under the assumptions of the identification: gain bound, decay rate and parametric poles, and the bounds of
    the samples. Data can refute these, never prove them.

    Attributes
    ----------
    identification : Identification
    model : control.StateSpace
        The nominal that the errors are measured from.
    values : tuple of ValueSet
        At each frequency the polygon that contains F, and attained points; MIMO: one for every entry (of symmetric
        matrices the upper triangle), entry after entry, row by row.
    parameters : ParameterIntervals
    directions : int
    gap : float
        Part of the distance from the centre to which every support value was found.
    missing : (k,) array, rad/s
        Frequencies that were asked for and not finished in the time limit; the parameters may be incomplete then.
    """

    identification: Identification
    omega: Real = dataclasses.field(init=False)
    kept: tuple[Cell, ...] = dataclasses.field(init=False)
    values: tuple[ValueSet, ...]
    parameters: ParameterIntervals
    directions: int
    gap: float
    missing: Real = dataclasses.field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        self._set(omega=freeze(np.array(list(by_frequency(self.values)))), kept=(Cell(self.values),))

    @property
    def problem(self) -> MixedProblem:
        """Statement that the systems are consistent with."""
        return self.identification.problem

    @functools.cached_property
    def _sets_at(self) -> dict[float, tuple[ValueSet, ...]]:
        return by_frequency(self.values)

    @functools.cached_property
    def _errors(self) -> tuple[Errors, ...]:
        return self._around.at(self._sets_at)

    @functools.cached_property
    def _around(self) -> ModelError:
        return ModelError(self.identification, self.model, self.parameters, float(self.omega.min()))

    def of_entry(self, output: int, input: int) -> tuple[ValueSet, ...]:
        """The sets of values of an entry at every frequency; of symmetric matrices of either one."""
        return self.kept[0].of_entry(output, input)

    @property
    def lower(self) -> Real:
        """Error of consistent systems that were found, (F, ny, nu): no bound can be smaller."""
        return freeze(np.array([e.lower for e in self._errors]))

    @property
    def sigma_upper(self) -> Real:
        """Guaranteed bound of the largest singular value of F - model, (F,).

        The norm of the matrix `upper`; or, if that is less, what the class allows whatever the data are, or at a frequency point
        what a bound of its columns or of the whole matrix leaves. At most about sqrt(ny nu)/cos(pi/directions) times the truth.
        """
        return freeze(np.array([e.sigma_upper for e in self._errors]))

    @property
    def sigma_lower(self) -> Real:
        """Largest singular value of F - model of consistent systems that were found, (F,)."""
        return freeze(np.array([e.sigma_lower for e in self._errors]))

    @property
    def phase(self) -> Real:
        """Guaranteed range of the phase in rad, (F, 2); MIMO: of every entry, (F, ny, nu, 2)."""
        places = list(np.ndindex(self._nominal.shape[1:]))
        ranges = np.array([[one.phase for one in self.of_entry(*place)] for place in places])
        ranges = ranges.transpose(1, 0, 2).reshape(*self._nominal.shape, 2)
        return freeze(self.problem.entries.as_given(ranges))

    @property
    def circle(self) -> CircleBound:
        """The bound on the whole circle that `on_circle` has found; before, that of sums, narrowed by the polygons.

        Of positive-real and negative-imaginary classes, which have no gain bound and no sums, to 5 %, or what little work gives
        (`CircleBound.converged`): counted in frequencies and their size, not in seconds of this machine.
        """
        if self.known_circle is not None or not self.problem.prior.positive_real:
            return super().circle
        return self._with_little_work

    @functools.cached_property
    def _with_little_work(self) -> CircleBound:
        most = int(_AT_ONCE / (_SECONDS * self.consistent_set.posed.work * _COARSE_STEPS + _EACH))
        return self._refined(0.05, False, Means(), most)

    def with_circle(self, circle: CircleBound) -> WorstCaseError:
        """Return the same result with a bound on the circle that is known from elsewhere, a file for instance."""
        result = dataclasses.replace(self)
        result._circle.take(circle)
        return result

    def table(self) -> dict[str, list[Any]]:
        """Model and bounds of its error, a row for every frequency and entry."""
        upper, lower = self.upper, self.lower
        nominal, places = self.nominal.reshape(upper.shape), list(np.ndindex(*upper.shape))
        return {
            "frequency [Hz]": [self.omega[k] / (2 * np.pi) for k, *_ in places],
            "output": [str(self.problem.outputs[int(i)]) for _, i, _ in places],
            "input": [str(self.problem.inputs[int(j)]) for *_, j in places],
            "real": nominal.real.ravel().tolist(),
            "imag": nominal.imag.ravel().tolist(),
            "guaranteed error": upper.ravel().tolist(),
            "reached error": lower.ravel().tolist(),
        }

    def claims(self) -> Iterator[SupportClaim]:
        """Every inequality that is stated, with its certificate; those at the edges of the circle, if it has been bounded."""
        yield from parameter_claims(self.consistent_set, self.parameters)
        for _, sets in itertools.groupby(self._sets(), key=lambda one: one.omega):
            yield from value_set_claims(self.consistent_set, *sets)

    @property
    def claim_count(self) -> int:
        """Number of `claims`."""
        return len(self.parameters.certificates) + sum(len(v.certificates) for v in self._sets())

    @property
    def supported(self) -> bool:
        """Return whether the polygons are closed and of every entry and frequency, and give the bound on the circle."""
        return self.kept[0].is_about(self.problem, self.omega) and self.circle_supported

    @property
    def circle_supported(self) -> bool:
        """Return whether the certified sets at its edges give the stated bound on the circle; true where there is none."""
        return self.known_circle is None or supported(self._around, self.known_circle)

    def _sets(self) -> Iterator[ValueSet]:
        circle, mine = self.known_circle, set(map(id, self.values))
        yield from self.values
        yield from (v for v in (circle.values if circle is not None else ()) if id(v) not in mine)

    @functools.cached_property
    def consistent_set(self) -> ConsistentSet:
        """All consistent systems, as a convex set."""
        return consistent_set(self.identification)

    def completed(self, *, executor: Processes = None) -> WorstCaseError:
        """Return the result with the intervals of all parameters: itself, unless a time limit left some out."""
        if self.parameters.complete:
            return self
        return dataclasses.replace(self, parameters=parameter_intervals(self.consistent_set, executor))

    def _refined(self, rtol: float, everywhere: bool, means: Means, most: int = LARGEST) -> CircleBound:
        """The bound on the circle from what is known, of `most` frequencies at most."""
        if not self.parameters.complete:
            raise InputError(
                "`parameters` are incomplete: the time limit left intervals out that the bound between frequencies rests on;"
                " call on_circle of completed()"
            )
        consistent, settings = self.consistent_set, (self.directions, self.gap)
        known = self.values, self.known_circle
        with threads_for(consistent.data.sarason.pair.order):
            return refine(self._around, consistent, *known, settings, rtol, everywhere, means, min(most, LARGEST))

    def worst(self, count: int = 5) -> list[tuple[float, float, float, Sample]]:
        """Frequencies with the largest bounds: (rad/s, upper, lower, the active constraint of largest dual weight).

        MIMO: `sigma_upper` and `sigma_lower`.
        """
        order: list[int] = np.argsort(-self.sigma_upper)[:count].tolist()
        samples = [
            Sample(r.kind, r.index, at, which(self.problem, r.entry))
            for r in self.identification.residuals
            for at in r.axis.tolist()
        ]
        rows = ((k, self._errors[k].sigma_upper, self._errors[k].sigma_lower) for k in order)
        return [(float(self.omega[k]), high, low, samples[self.active_constraint(k)]) for k, high, low in rows]

    def active_constraint(self, index: int) -> int:
        """Number of the sample with the largest dual weight in the proofs at a frequency (of the samples' part, however small)."""
        rows = self.consistent_set.data.rows
        sets = self._sets_at[float(self.omega[index])]
        return int(np.argmax(sum(c.shares(rows) for one in sets for c in one.certificates)))

    @property
    def unfinished(self) -> str:
        """Sentence on what the time limit, or Ctrl-C, has left out; empty where nothing is missing."""
        if not self.missing.size:
            return ""
        count = f"{self.omega.size} of {self.omega.size + self.missing.size}"
        return f"Its time limit, or Ctrl-C, ended the sweep: {count} frequencies are bounded, nothing is said of the others."

    def __repr__(self) -> str:
        return f"<WorstCaseError: {counted(self.omega.size, 'frequency')}, largest {self.sigma_upper.max():.4g}>"

    def summary(self) -> str:
        """The result in plain text."""
        upper, lower = self.sigma_upper, self.sigma_lower
        gap = 1 - np.divide(lower, upper, out=np.ones(upper.size), where=upper > 0)
        lines = [f"unfinished {self.unfinished}"] * bool(self.missing.size)
        lines += [
            f"guarantee  every consistent system is within {rounded_up(upper.max()):.4g} of the model at {self.omega.size}"
            f" frequencies{self.problem.scope}",
            f"           (median {self.relative.words}; attained: {lower.max():.4g})",
            f"gap        upper bounds exceed attained errors by {100 * gap.max():.2g} % at most",
        ]
        if not self.problem.entries.single:
            _, output, input = map(int, np.unravel_index(np.argmax(self.upper), self.upper.shape))
            name = which(self.problem, (output, input))
            lines.append("norm       largest singular value of F - model, from the bounds of its entries and the class")
            lines.append(f"entry      at most {self.upper.max():.4g}{name}")
        for w, high, low, sample in self.worst():
            lines.append(
                f"worst      {hz_words(w / (2 * np.pi))}: {high:.4g} (attained {low:.4g}), active constraint: {sample}"
            )
        modes = self.identification.choices.get("modes")
        if modes is not None and modes.source is Source.DATA:
            lines.append(
                "warning    the poles were taken from these data, which leave them a pole-uncertainty box: this band does not cover"
                " it, but that of worst_case_over_poles (robustid bounds --poles) does"
                if has_single_pairs(self.problem.parametric)
                else "warning    the poles were taken from these data and are a part of the class: others may follow them as well"
            )
        lines.append(
            "assumed    gain bound, decay rate, poles and bounds of the samples: data can refute them, never prove them"
        )
        return "\n".join(lines)
