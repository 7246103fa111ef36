"""fit_mfd(): from a frequency response to a matrix fraction at the maximum-likelihood optimum, from a cold start."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from robustid.core import (
    Budget,
    Frozen,
    Interruptible,
    Progress,
    Savable,
    StateMatrices,
    Unfinished,
    as_flag,
    counted,
    one_thread,
)
from robustid.data import FrequencyResponse, as_frequency_response
from robustid.errors import InputError
from robustid.figures import Drawable, Modes
from robustid.fitting.fraction.constraints import Constraint, RollOff, StaticGain, as_constraints
from robustid.fitting.fraction.criterion import Weight
from robustid.fitting.fraction.first_models import EXTRA, first_model, strongest
from robustid.fitting.fraction.fit_search import FitEnd, fit_from, unstable_poles
from robustid.fitting.fraction.fit_statement import stated, takes_feedthrough
from robustid.fitting.fraction.fraction_forms import constraint_of
from robustid.fitting.fraction.fraction_iteration import FitStatus, FitStep, counted_steps, phases_of
from robustid.fitting.fraction.fraction_model import FractionModel
from robustid.fitting.fraction.fraction_problem import FractionProblem
from robustid.fitting.fraction.node_fraction import NodeFraction
from robustid.fitting.fraction.rigid_body import RigidBody, as_rigid_body
from robustid.fitting.fraction.weight_choice import asks_for_level, chosen, levelled
from robustid.fitting.modal.modal_fit import modal_fit_from
from robustid.fitting.modal.modal_structure import Modal, as_modal
from robustid.fitting.state_space.given_poles import Samples
from robustid.fitting.state_space.integrator_chains import Decoupling, decoupling
from robustid.fitting.state_space.state_descent import Settings, dear, suspicious

if TYPE_CHECKING:
    import control

_SEARCHING = 0.7  # part of a time limit; in the rest the last step ends and the fraction is formed
_ROUNDS = 3  # of adding a mode and taking the least important one away, where a fit may have missed one


@dataclasses.dataclass(frozen=True, eq=False)
class MatrixFraction(Frozen, Drawable, Modes, Savable):
    """A fitted model P = N D^{-1} (or D^{-1} N, or N/d with poles that all entries share), and how it was found.

    Attributes
    ----------
    problem : FractionProblem
        What was asked; for a left fraction the transposed problem, for shared poles that of the entries as one column.
    nodes : NodeFraction
        The fraction at the frequency points, of that problem.
    fraction : FractionModel
        Polynomials and realisation.
    cost : float
        ``sum_k |W(k) vec(P_k - model)|^2`` over the frequency points.
    start_cost : float
        The same of the start (of its projection on a modal structure), in the same weight. The fit is never worse, but for a start
        with unstable poles that had to be reflected.
    status : FitStatus
    history : tuple of FitStep
        Cost, condition number and step of every iteration; also of those in a weight that the residuals changed later, and of
        those before a modal structure, whose costs are of that `FitStep.former` criterion.
    reflected : int
        Number of unstable poles that the best fit had and that were reflected before it was refined again.
    unstable_cost : float
        Cost of that fit (nan where nothing was reflected).
    modal : Modal or None
        Structure of the modes that was asked for. `model`, `poles` and `cost` keep it exactly; numerator and denominator are formed
        of that model, as far as `fraction.error` says.
    unfinished : Unfinished or None
        What Ctrl-C left out of the sweep that its order comes from; pages of the fit say it first.
    """

    problem: FractionProblem
    nodes: NodeFraction
    fraction: FractionModel
    cost: float
    start_cost: float
    status: FitStatus
    history: tuple[FitStep, ...]
    reflected: int = 0
    unstable_cost: float = np.nan
    modal: Modal | None = None
    unfinished: Unfinished | None = None

    @property
    def model(self) -> control.StateSpace:
        """The `control.StateSpace`, of order = McMillan degree; shared poles are there for every signal of the smaller side."""
        return self.fraction.model

    def to_control(self) -> control.StateSpace:
        """`model`, for those who look for this name on every object that python-control understands."""
        return self.model

    @property
    def poles(self) -> np.ndarray:
        """Poles in s (rad/s) or z, (order,); those of rigid-body modes, exact, last."""
        return self.fraction.poles

    @property
    def numerator(self) -> Callable[[np.ndarray], np.ndarray]:
        """N as a function of complex points s or z: (m,) to (m, ny, nu)."""
        return self.fraction.numerator

    @property
    def denominator(self) -> Callable[[np.ndarray], np.ndarray]:
        """D as a function of complex points s or z: (m,) to (m, nu, nu); left fraction (m, ny, ny), shared poles (m, 1, 1)."""
        return self.fraction.denominator

    @property
    def weight_choice(self) -> str:
        """Words for the weight of the residuals, and why it was chosen."""
        return self.problem.weight.note or "as given"

    @property
    def condition_numbers(self) -> np.ndarray:
        """Condition number of the normal matrix, one per iteration."""
        return np.array([step.condition for step in self.history])

    @property
    def rigid_directions(self) -> np.ndarray | None:
        """Directions (count, nu) in which the inputs drive the rigid-body modes; shapes (ny, count) of a left fraction."""
        directions = self.nodes.held.directions
        if directions is None or self.problem.rigid is None or not self.problem.rigid.outside:
            return None
        return directions.T if self.fraction.form == "left" else directions

    @property
    def decoupling(self) -> Decoupling | None:
        """T_y and T_u with ``T_y P T_u = diag(I/s^2, 0) + less``: the rigid body by itself (`voorhoeve2016` section III)."""
        if self.fraction.rigid is None or not self.fraction.rigid_count:
            return None
        found = decoupling(self.fraction.rigid, self.fraction.rigid_count)
        return Decoupling(found.input.T, found.output.T) if self.fraction.form == "left" else found

    @property
    def stable(self) -> bool:
        """True if every pole but those of rigid-body modes lies inside the stability region."""
        return not np.any(unstable_poles(self.fraction))

    def __repr__(self) -> str:
        fraction = self.fraction
        points, ny, nu = fraction.oriented(self.problem.values).shape
        states = f" shared by all entries, {fraction.states_in_all} states" if fraction.form == "shared" else ""
        if self.modal is not None:
            states += (
                f", {'symmetric ' * self.modal.symmetric}modes of {'real' if self.modal.real else 'complex'} shape"
            )
        domain = "continuous" if fraction.dt is None else f"dt={fraction.dt:.6g} s"
        return (
            f"<MatrixFraction: order {len(fraction.A)}{states}, {ny}x{nu}, {domain}, {'stable' if self.stable else 'unstable'};"
            f" cost {self.cost:.6g} on {counted(points, 'frequency point')}, {self.status.name.lower()} after"
            f" {counted(len(self.history), 'step')}>"
        )


@one_thread()
def fit_mfd(
    frf: FrequencyResponse | control.FRD,
    *,
    order: int,
    domain: str | None = None,
    form: str | None = None,
    weight: Weight | np.ndarray | None = None,
    method: str = "lm",
    rigid_body: RigidBody | int | None = None,
    modal: Modal | bool = False,
    start: control.StateSpace | ArrayLike | None = None,
    feedthrough: bool | None = None,
    constraints: Iterable[Constraint] = (),
    stable: bool = True,
    restart: bool = True,
    time_limit: float | None = None,
    progress: Progress | None = None,
) -> MatrixFraction:
    """Fit a matrix fraction of a given McMillan degree by least squares on the weighted residuals.

    Subspace estimate, then Levenberg-Marquardt in local coordinates of the realisation whose tangent space is made
    orthonormal; the end is brought into fraction form by Sanathanan-Koerner steps on its noise-free response, in polynomials
    that these data make orthonormal. Static gains, zeros and roll-off are linear in the outputs of the realisation, which are
    projected out, and hold at every step. With entries that are zero, rigid-body modes inside, and other methods than "lm", the
    descent is one of fractions in these polynomials. Every normal matrix has condition number one.

    Parameters
    ----------
    frf : FrequencyResponse or control.FRD
        Entries that are missing have no weight.
    order : int
        McMillan degree, with the two states of every rigid-body mode.
    domain : {"s", "z"}, optional
        Default "z" where the data have a sample time, else "s".
    form : {"right", "left", "shared"}, optional
        N D^{-1} (default), D^{-1} N (default with rigid-body modes of side "output"), or N/d: every entry has all poles and
        residues of its own, as in vector fitting, ``P = sum_k R_k/(s - p_k) + D``. `order` is then the number of poles, and
        the model has order*min(ny, nu) states; not with `rigid_body`. Its default weight takes the variances of the
        covariance alone, so that the work grows with the number of entries and no faster.
    weight : Weight or (F, ny, nu) array, optional
        Weight of the residual (not its square). Default: the covariance of the data where they have one (maximum likelihood);
        one that was estimated, as its `dof` says, or that is singular, is shrunk first, and a tenth of the response's level is
        added for what the model misses; the level alone, or the shrunk covariance alone, where a short fit with it predicts
        withheld points better (not tried where steps are dear); else relative, 1/|P| per entry, but where that leaves noise of
        a level, which the fit finds in its residuals, a level and a relative part for every entry. See
        `MatrixFraction.weight_choice`.
    method : str
        What follows the start: "lm", or phases "sk", "sk-relaxed", "sk-minimum-norm", "iv", "gn", "lm" joined by "+".
    rigid_body : RigidBody or int, optional
        Modes that are exact: ``RigidBody(3)``, or 3.
    modal : bool or Modal, optional
        Keep the structure of a mechanical system: modes of rank one with complex shapes (True), with real ones
        (``Modal("proportional")``), or symmetric where sensors and actuators sit together (``Modal(symmetric=True)``). Every mode
        takes two states, so that the order is even. The free fit is projected on the structure and refined in it;
        `mode_table` gives the shapes. Not with `constraints`, other methods, or form "shared".
    start : control.StateSpace or (n,) array of poles, optional
        Where to start in place of the subspace estimate: a model of any order, or poles (s in rad/s, or z), which SK
        takes as ``D = prod (s - pole) I``; not with `rigid_body`.
    feedthrough : bool, optional
        Whether P(infinity) may differ from 0. Default: for accelerations under forces, by their units, and for scattering
        parameters, by the names of their waves, unless a roll-off, rigid-body modes or a structure of the modes are asked for.
    constraints : iterable of StaticGain, Zero, RollOff, ZeroEntries
        What else must hold exactly.
    stable : bool
        Reflect unstable poles of the best fit and refine within the stable models. False: leave them.
    restart : bool
        Where the first descent ends without convergence or with residuals that are correlated over frequency: add a mode
        that the residual asks for, refine, take the least important mode away, refine; the best end is kept. It takes
        two to four times as long.
    time_limit : float, optional
        Seconds after which the best model so far is returned, with the status that says so; so does Ctrl-C.
    progress : callable (text, done, count), optional
        Told the number of every step, and its criterion in words; `count` is 0.

    Returns
    -------
    MatrixFraction

    Raises
    ------
    InputError, InputTypeError
        Wrong arguments; an order larger than the data allow; constraints that contradict.

    Notes
    -----
    Source: `voorhoeve2016`, `mckelvey1996`.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> omega = np.linspace(1, 9, 60)
    >>> frf = rid.FrequencyResponse(omega, 1 / ((1j * omega) ** 2 + 0.2j * omega + 16))
    >>> fit = rid.fit_mfd(frf, order=2)
    >>> fit.model.nstates, fit.stable, fit.status.converged
    (2, True, True)
    """
    budget = Budget(time_limit).share(_SEARCHING)
    stable, restart = as_flag("stable", stable), as_flag("restart", restart)
    structure, rigid_body = as_modal(modal), as_rigid_body(rigid_body)
    frf, constraints = as_frequency_response("frf", frf), as_constraints(constraints)
    falls = any(isinstance(constraint, RollOff) for constraint in constraints)
    through = takes_feedthrough(frf, feedthrough, excluded=falls or rigid_body is not None or structure is not None)
    through = through or (structure is not None and structure.power == 2)
    problem, data, form, shape, relative, others = stated(frf, order, domain, form, weight, through, rigid_body)
    rounds = _ROUNDS if restart else 0
    settings = Settings(phases_of(method), rigid_body, form, stable, counted_steps(progress), rounds, budget)
    if structure is not None:
        _check_modal(structure, problem, settings, constraints)
    for constraint in constraints:
        if rigid_body is not None and isinstance(constraint, StaticGain):
            raise InputError("`constraints`: a static gain and a rigid body exclude each other")
        held = constraint_of(constraint, form, shape)
        problem, others = held.apply(problem), tuple((held.apply(other), samples) for other, samples in others)
    begin = functools.partial(first_model, start=start, form=form, body=rigid_body, stable=stable, budget=budget)
    with Interruptible() as choosing:
        problem, data = chosen([(problem, data), *others], begin, settings)
    if choosing.interrupted:
        settings = dataclasses.replace(settings, budget=Budget(1e-9))  # the start is what there is so far
    search: Callable[..., FitEnd] = fit_from
    if structure is not None:
        search = functools.partial(modal_fit_from, modal=structure, given=start is not None)
    best = _best(search, problem, data, begin(problem, data), start, settings, relative=relative)
    fit = best.fit
    return MatrixFraction(
        fit.problem,
        fit.fraction,
        dataclasses.replace(best.found, shape=shape if form == "shared" else None),
        fit.cost,
        best.start_cost,
        fit.status,
        fit.history,
        best.reflected,
        best.unstable_cost,
        structure,
    )


def _best(
    search: Callable[..., FitEnd],
    problem: FractionProblem,
    data: Samples,
    first: StateMatrices,
    start: object,
    settings: Settings,
    *,
    relative: bool,
) -> FitEnd:
    """The best end of a search: from the first model, from a richer fit where that end is suspicious, with the noise's level."""
    quick = settings
    if relative and search is fit_from and dear(problem):
        quick = dataclasses.replace(settings, enough=asks_for_level)
    best = search(problem, data, first, quick)
    if (
        settings.rounds
        and not best.refined
        and suspicious(best.fit.problem, best.fit.fraction.response, best.fit.status)
    ):
        other = _second(problem, data, settings)
        if (
            other is not None
            and other.fit.cost < best.fit.cost
            and (not settings.stable or not np.any(unstable_poles(other.found)))
        ):
            best = other
    if not relative:
        return best
    level = levelled(best, problem, data, start, settings, search)
    if level is None and best.early:
        return min(best, search(problem, data, first, settings), key=lambda end: end.fit.cost)
    return best if level is None else level


def _check_modal(
    structure: Modal, problem: FractionProblem, settings: Settings, constraints: Iterable[Constraint]
) -> None:
    """Raise where other arguments contradict the structure of the modes."""
    structure.check(problem.values, problem.order, settings.body)
    if settings.form == "shared":
        raise InputError('`modal` and form "shared" exclude each other: shared poles have residues of any rank')
    if settings.phases != ["lm"]:
        raise InputError(f'`modal` goes with method "lm" only; got {"+".join(settings.phases)!r}')
    if as_constraints(constraints):
        raise InputError("`modal` and `constraints` exclude each other; leave one of them out")


def _second(problem: FractionProblem, data: Samples, settings: Settings) -> FitEnd | None:
    """A fit from the strongest modes of a richer fit; None where the data don't allow one."""
    try:
        richer = dataclasses.replace(problem, order=problem.order + EXTRA)
        quiet = dataclasses.replace(settings, progress=None)
        start = first_model(richer, data, None, settings.form, settings.body, settings.stable, settings.budget)
        found = fit_from(richer, data, start, quiet).found
    except (InputError, np.linalg.LinAlgError):
        return None
    model = strongest(found, data, problem.feedthrough)
    return None if model is None else fit_from(problem, data, model, settings)
