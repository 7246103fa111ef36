"""The answer of identify(), with its evidence."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robustid.core import Choice, Frozen, Model, Numbers, Real, Savable, freeze, hz_words
from robustid.data import FrequencyResponse, TangentialResponse, TimeRecord, bound_ratio
from robustid.errors import InconsistentDataError, InputError, SolverError, Status
from robustid.figures import Drawable
from robustid.identification.certificate import MarginCertificate
from robustid.identification.formulation.base import Family, Formulation
from robustid.identification.formulation.convex import Candidate
from robustid.identification.interpolant import FreeParameter
from robustid.identification.model import Mode, level_of, modes_of, nominal_model, parametric_values, residue_matrices
from robustid.identification.prior import Prior
from robustid.identification.problem import MixedProblem
from robustid.identification.residuals import Residual, entry_name
from robustid.identification.verification import Claim, Verification

_MODES = 12  # listed in a summary
_ZERO = 1e-3  # a margin that is 0, to the digits that are shown
_AT_END = 1e-6  # of an interval, or of what the samples tell apart


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Identification(Frozen, Drawable, Savable):
    """Finding about the class, with its proof, and a model.

    Attributes
    ----------
    formulation : Formulation
        The finite problem that was solved, with the `problem` that it stands for.
    objective : str
    claim : Claim
        The proven interval of the margin with its evidence: the point that reaches the upper end and the certificate of the
        lower end; `margin`, `margin_lower`, `status`, `certificate`, `solver` and `accuracy` are read from it.
    prior : Prior
        Of the model: that of the problem, with a smaller gain bound for objective "gain".
    coefficients : (n,) array
        Of the non-parametric part, in the orthonormal basis, relative to the gain bound; for MIMO entry by entry.
    scaled_parameters : (m,) array
        As the solvers see them; `parameters` are in the user's units.
    model : control.StateSpace
        Central interpolant joined with the parametric part, forward-shift convention, with dt; continuous for continuous data.
    verification : Verification
        Every claim, evaluated again.
    timing : dict
        Seconds per stage.
    choices : dict of str to Choice
        How assumptions were chosen, and what was reached where the time was over, by name ("modes", "prior", ...); for reports.
    """

    formulation: Formulation
    objective: str
    claim: Claim
    prior: Prior
    coefficients: Real
    scaled_parameters: Real
    model: Model
    verification: Verification
    timing: dict[str, float]
    choices: dict[str, Choice] = dataclasses.field(default_factory=dict[str, Choice])

    def __post_init__(self) -> None:
        self._set(coefficients=freeze(self.coefficients), scaled_parameters=freeze(self.scaled_parameters))

    @property
    def notes(self) -> tuple[str, ...]:
        """The choices in words, one paragraph each."""
        return tuple(note for choice in self.choices.values() if (note := choice.note))

    @property
    def problem(self) -> MixedProblem:
        """Statement of what was measured and assumed."""
        return self.formulation.problem

    @property
    def status(self) -> Status:
        """The finding; its value is a sentence."""
        return self.claim.status

    @property
    def verified_status(self) -> Status:
        """The status; failed where a check of the `verification` doesn't hold."""
        return self.status if self.verification.passed else Status.FAILED

    @property
    def margin(self) -> float:
        """Upper end of the proven interval of the smallest s with every |residual| <= s * bound: a system reaches it."""
        return self.claim.margin

    @property
    def margin_lower(self) -> float:
        """Lower end of the proven interval: the value of `certificate`."""
        return self.claim.certificate.value

    @property
    def length(self) -> int:
        """Number of coefficients of an entry where they leave something out; 0 for the exact form."""
        return 0 if self.formulation.exact else self.formulation.count

    @property
    def form(self) -> str:
        """The finite problem that stood for the infinite one, in words."""
        return self.formulation.description

    @functools.cached_property
    def tail(self) -> float:
        """Largest effect of the coefficients that were left out, as a part of any sample's bound; 0: exact form.

        Both ends of the interval of the margin allow for it.
        """
        return float(self._used.rows.tail.max())

    @property
    def accuracy(self) -> float:
        """Largest width of the interval that was asked for."""
        return self.claim.accuracy

    @property
    def certificate(self) -> MarginCertificate:
        """The proof of `margin_lower`; above 1 it refutes the class."""
        return self.claim.certificate

    @property
    def solver(self) -> str:
        """Name of the solver that found the point that reaches the margin."""
        return self.claim.solver

    @property
    def consistent(self) -> bool:
        """Say whether a system of the class keeps every sample within its bound (margin <= 1)."""
        return self.margin <= 1

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences on what makes the result say less than it seems to."""
        K = self.problem.prior.gain_bound
        found: list[str] = []
        scales = self.problem.prior.scales(*self.problem.entries.shape)
        largest = max(
            _largest_response(item, scales, self.problem) for item in (*self.problem.frequency, *self.problem.time)
        )
        if self.consistent and largest < K and not self.problem.prior.physical:
            found.append(
                f"the gain bound K = {K:.3g} exceeds the largest response in the data ({largest:.3g}): the class is so large that"
                " consistency says next to nothing, and the model can do anything between the samples"
            )
        wide = [_share_around_zero(f) for f in self.problem.frequency]
        if self.consistent and wide and max(wide) > 0.5:
            found.append(
                f"at {100 * max(wide):.0f} % of the frequency points the bound exceeds the response itself: such points can hardly"
                " contradict any class"
            )
        if self.consistent and self.margin_lower <= 0:
            known = "the margin is 0:" if self.margin < _ZERO else "no margin above 0 is proved: it may be that"
            found.append(f"{known} these data could not have contradicted this class, whatever the bounds")
        return tuple(found)

    @property
    def parameters(self) -> Real:
        """Coefficients of the parametric functions, (m,); for MIMO the residue matrices, (m, ny, nu)."""
        return freeze(self.problem.entries.as_given(self._residues))

    @property
    def _residues(self) -> NDArray[np.float64]:
        """The parameters as matrices, (m, ny, nu)."""
        return residue_matrices(self.problem, self._used.rows, self.scaled_parameters)

    @property
    def modes(self) -> tuple[Mode, ...]:
        """The modes of the parametric part: frequency, damping, residue matrix, and how near it is to rank one."""
        if self.problem.parametric is None:
            return ()
        return modes_of(self.problem.parametric, self._residues)

    @functools.cached_property
    def active_intervals(self) -> tuple[tuple[str, float], ...]:
        """Parameters at an end of their interval, in the model or where the margin is reached: (function, that end).

        Within 1e-6 of half the interval, and so near that approximately no sample feels the difference as 1e-6 of its bound.
        """
        problem, basis = self.problem, self.problem.parametric
        if problem.parameter_bounds is None:
            return ()
        bounds = problem.unknown_bounds
        count = bounds.shape[0]
        found = np.zeros((count, 2), bool)
        for rows, p in ((self._used.rows, self.scaled_parameters), (self.formulation.rows, self.claim.p)):
            ends = rows.ends[:count]
            width = ends[:, 1] - ends[:, 0]
            near = np.abs(p[:count, None] - ends) <= _AT_END * np.minimum(width / 2, 1.0)[:, None]
            found |= near & (width > 0)[:, None]
        return tuple((basis.labels[i % basis.size], float(bounds[i, k])) for i, k in np.argwhere(found))

    @property
    def residuals(self) -> tuple[Residual, ...]:
        """Data minus model at every sample: of each experiment, for MIMO of each entry or output."""
        return self.verification.residuals

    @property
    def order(self) -> int:
        """Number of states of the model."""
        return self.model.nstates

    @property
    def _intervals(self) -> int:
        """Number of parameters with an interval."""
        bounds = self.problem.parameter_bounds
        return 0 if bounds is None else int(np.isfinite(bounds[..., 0]).sum()) - self.problem.prior.positive_real

    @functools.cached_property
    def _used(self) -> Formulation:
        """The formulation with the prior of the model."""
        if self.prior == self.problem.prior:
            return self.formulation
        return self.formulation.of(dataclasses.replace(self.problem, prior=self.prior))

    @functools.cached_property
    def _family(self) -> Family:
        return self._used.family(self.coefficients)

    def solution(self, E: FreeParameter = 0.0) -> Model:
        """Another model of the class with the same values at the samples.

        Parameters
        ----------
        E : float in [-1, 1], (ny, nu) array of norm at most 1, or control.StateSpace
            The free parameter: any function of the unit ball, in the scaled variable zeta = z/rho. 0 gives `model`;
            these are all systems of the class with these coefficients and parameters. A number but for the exact form.

        Returns
        -------
        control.StateSpace
        """
        level = level_of(self.objective, self.margin, self.accuracy, self.prior)
        point = Candidate(
            self.coefficients, self.scaled_parameters, self.certificate.samples, np.zeros((0, 0)), self.solver
        )
        return nominal_model(self._used, point, level, E).model

    def weyl_disc(self, omega: ArrayLike) -> tuple[Numbers, Numbers]:
        """Centre and radius of the values at `omega` [rad/s] of all systems with these coefficients and parameters.

        A disc per frequency: (F,) complex and (F,) arrays. The radius is zero at the frequency points of the data. It does not
        cover other consistent coefficients. SISO only; `weyl_ball` for MIMO.
        """
        centre, left, right = self.weyl_ball(omega)
        if not self.problem.entries.single:
            raise InputError("`weyl_disc` is for one input and one output; take weyl_ball(omega)")
        return centre[:, 0, 0], np.abs(left * right)[:, 0, 0]

    def weyl_ball(self, omega: ArrayLike) -> tuple[Numbers, Numbers, Numbers]:
        """Centre (F, ny, nu), left (F, ny, ny) and right radius (F, nu, nu) of the values at `omega` [rad/s], as `weyl_disc`.

        The values of all systems with these coefficients and parameters are centre + left U right, ||U|| <= 1 (a scaling of the
        prior, where there is one, multiplies left U right entry by entry).
        """
        omega = np.atleast_1d(np.asarray(omega, dtype=float))
        angles, K = self.problem.plane.angles(omega), self.prior.gain_bound
        centre, left, right = self._family.weyl_ball(self.problem.region.points(angles))
        scales = self.prior.scales(*centre.shape[1:])
        outside = parametric_values(self.problem, self._used.rows, self.scaled_parameters, angles)
        weighting = self.problem.weighting
        centre, left = weighting.times(centre, angles), weighting.times(left, angles)
        return K * scales * centre + outside, K * left, right

    def limiting(self, share: float = 0.01) -> list[tuple[Residual, int, float]]:
        """As `conflicting_samples`: the `residuals` that a sample belongs to, its number among them, and its share."""
        places = [(r, k) for r in self.residuals for k in range(r.axis.size)]
        weights = self.certificate.shares(self._used.rows)
        return [(*places[k], float(weights[k])) for k in np.argsort(-weights) if weights[k] >= share]

    def conflicting_samples(self, share: float = 0.01) -> list[tuple[str, int, float, float]]:
        """Samples that carry the proof: (kind, experiment, rad/s or s, share), largest first.

        The shares are the weights |l_k| of the certificate, which sum to one. For inconsistent data these samples alone
        contradict the class; for consistent ones they are what keeps the margin from being smaller.
        """
        return [(r.kind, r.index, float(r.axis[k]), weight) for r, k, weight in self.limiting(share)]

    def require(self) -> Identification:
        """The result itself if the data are consistent and every check holds; an exception otherwise."""
        if not self.consistent:
            raise InconsistentDataError(f"{self.status.value} (margin {self.margin:.6g} > 1)")
        if not self.verification.passed:
            failed = ", ".join(check.name for check in self.verification.failed)
            raise SolverError(f"the model failed its verification: {failed}")
        return self

    def __repr__(self) -> str:
        return f"<Identification: {self.status.name.lower()}, margin {self.margin:.6g}, order {self.order}>"

    def summary(self) -> str:
        """The result in a dozen lines of plain text."""
        problem, prior = self.problem, self.problem.prior
        frequency = sum(int(f.bound.used.sum()) for f in problem.frequency)
        lines = [
            f"status     {self.status.value}{problem.scope}",
            f"margin     {self.margin:.6g}, proved not below {self.margin_lower:.6g}",
            *(f"bounds     {sentence}" for sentence in problem.about),
            f"data       {frequency} frequency samples, {problem.samples - frequency} time samples, "
            + (f"dt = {problem.dt:g} s" if problem.dt else "continuous time"),
            *self._signal_lines,
            f"class      {self._class_words} in {prior.where}{prior.weight_words}"
            + (f", {problem.functions} parametric functions" if problem.functions else "")
            + f", {self._intervals} of their coefficients with an interval"
            * bool(problem.functions and self._intervals),
            *(
                [f"form       {self.form}; the remainder moves no sample by more than {self.tail:.2g} bounds"]
                * (not self.formulation.exact)
            ),
            f"model      order {self.order}, {self.objective}"
            + (f", {self._gain} <= {self.prior.gain_bound:.6g}" if self.prior != prior else ""),
            *self._mode_lines,
        ]
        lines += [
            f"{'verified' if check.holds else 'FAILED':<11}{check.name}: {check.measured:.3g} (limit {check.limit:.8g})"
            for check in self.verification.checks
        ]
        for residual, k, share in self.limiting(0.02)[:6]:
            at = residual.axis[k]
            place = hz_words(at / (2 * np.pi)) if residual.kind == "frequency" else f"{at:.5g} s"
            name = entry_name(problem, residual.entry)
            where = f"{residual.kind} experiment {residual.index + 1}{f' ({name})' if name else ''} at {place}"
            lines.append(f"active     {where}: {100 * share:.0f} % of the proof")
        lines += [
            f"interval   the coefficient of {name} is at the end {end:.6g} of its interval"
            for name, end in self.active_intervals
        ]
        lines += [f"warning    {sentence}" for sentence in self.warnings]
        decay, falls = "decay rate" if problem.dt else "decay", ", how it falls" * prior.weighted
        said = f"gain bound{falls}, {decay} and parametric poles: data can refute them, never prove them"
        if prior.physical:
            said = f"passivity with this {decay}: data can refute it, never prove it"
        return "\n".join([*lines, f"assumed    {said}"])

    @property
    def _class_words(self) -> str:
        """The class of the non-parametric part."""
        prior = self.problem.prior
        return prior.property_words if prior.physical else f"{self._gain} <= {prior.gain_bound:g}"

    @property
    def _gain(self) -> str:
        """The quantity that the gain bound bounds, in words."""
        if self.problem.entries.single:
            return "|G|"
        return "sigma_max(G)" if self.prior.scaling is None else "sigma_max(G / scaling)"

    @property
    def _signal_lines(self) -> list[str]:
        entries = self.problem.entries
        if entries.single:
            return []
        sides = ", ".join(
            f"{len(side)} {name} ({', '.join(map(str, side))})"
            for name, side in (("outputs", self.problem.outputs), ("inputs", self.problem.inputs))
        )
        return [f"signals    {sides}" + (", symmetric" if entries.symmetric else "")]

    @property
    def _mode_lines(self) -> list[str]:
        """Lines on how near the residues of MIMO modes are to rank one, as those of single modes are."""
        if self.problem.entries.single:
            return []
        return [
            f"mode       {hz_words(mode.omega / (2 * np.pi))}, damping {mode.damping:.3g}: second singular value of its residue"
            f" {100 * mode.rank_ratio:.2g} % of the first"
            for mode in self.modes[:_MODES]
        ]


def _largest_response(
    item: FrequencyResponse | TangentialResponse | TimeRecord, scales: Real, problem: MixedProblem
) -> float:
    """Largest response in the data of an experiment, divided by scaling and weight of the prior."""
    if isinstance(item, TimeRecord):
        drive = np.linalg.norm(problem.weighting.filtered(item.u)[:, None] * scales, axis=2).max(axis=0)
        return float((np.abs(item.y).max(axis=0) / np.maximum(drive, np.finfo(float).tiny)).max())
    weight = problem.weighting.sizes(problem.plane.angles(item.omega))[:, None, None]
    if isinstance(item, FrequencyResponse):
        return float((np.abs(item.values) / scales / weight)[item.bound.used].max())
    size = weight * np.linalg.svd(item.weights * scales, compute_uv=False).sum(axis=-1)
    return float((np.abs(item.values) / np.maximum(size, np.finfo(float).tiny))[item.bound.used].max())


def _share_around_zero(frf: FrequencyResponse | TangentialResponse) -> float:
    """Part of the samples whose bound exceeds the response itself."""
    ratio = bound_ratio(frf.values, frf.bound.radius, frf.bound.tilt)
    return float(np.mean(ratio[frf.bound.used] <= 1))
