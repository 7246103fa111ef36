"""The two sides of a loop: their models, their bounds on cells of the whole axis, and where systems of them come from."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy.linalg

from robustid.core import Frozen, Real, StateMatrices, counted, freeze, is_well_posed, poles_of, responses
from robustid.errors import InputError, InputTypeError
from robustid.guarantees.band import band
from robustid.guarantees.band_result import Band
from robustid.guarantees.bilinear import Image
from robustid.guarantees.over_cells import AroundModel
from robustid.guarantees.worst_case_result import WorstCaseError
from robustid.identification import Identification, MixedProblem, PositiveReal, as_system, identify
from robustid.reduction import is_stable

if TYPE_CHECKING:
    import control

_CELLS = 256  # at least, so that passivity and small gain can take turns along the axis
_LEAST = 1e-9  # of the largest bound of a side: entries that are known exactly
_SAME = 1e-9  # relative: sample times, and edges at the end of the axis


@dataclasses.dataclass(frozen=True, eq=False)
class Side(Frozen):
    """One side of the loop: `model` and bounds of the entries of F - model on arcs; zero bounds of a known system."""

    name: str
    model: control.StateSpace
    edges: Real  # (C + 1,), rad/s
    entries: Real  # (C, ny, nu)
    passive: bool = False  # every system of the class has F + F^H >= 0 on the axis
    result: Any = None  # Identification, MixedProblem or None: what consistent systems are those of
    thing: Any = None  # the band, or the known system

    def __post_init__(self) -> None:
        self._set(edges=freeze(self.edges), entries=freeze(self.entries))

    @property
    def known(self) -> bool:
        """True of a system without error."""
        return not self.entries.any()

    @property
    def problem(self) -> MixedProblem | None:
        """Problem of the consistent systems; None of a known one."""
        return self.result.problem if isinstance(self.result, Identification) else self.result

    @property
    def dt(self) -> float | None:
        """Sample time in s, 0 in continuous time; None where a constant has none."""
        return None if self.model.dt is None else float(self.model.dt)

    def identified(self, time_limit: float | None) -> Identification | None:
        """The data with a consistent system; None of a known one, and where the search found none."""
        if isinstance(self.result, MixedProblem):
            found = identify(self.result, time_limit=time_limit)
            return found if found.consistent else None
        return self.result


def as_side(name: str, thing: object) -> Side:
    """The side that an argument describes."""
    if isinstance(thing, Identification):
        return dataclasses.replace(as_side(name, band(thing)), result=thing)
    if isinstance(thing, Band) and thing.model is None:
        raise InputError(
            f"`{name}` is a band without a model, about which the loop is judged; use {name}.with_model(...)"
        )
    if isinstance(thing, AroundModel):
        circle = thing.circle
        if circle.edges[0] > 0:
            raise InputError(
                f"`{name}` must be stable, standing alone; nothing bounds it below {circle.edges[0]:g} rad/s, as it has an"
                " integrator"
            )
        return Side(name, thing.model, circle.edges, circle.entries, _is_passive(thing), _members_of(thing), thing)
    if not hasattr(thing, "feedback") or hasattr(thing, "frdata"):
        raise InputTypeError(
            f"`{name}` must be a Band (rid.band of its identification), an Identification, a WorstCaseError or a known"
            f" control.StateSpace or TransferFunction; got {type(thing).__name__}"
        )
    return _known(name, thing)


def _known(name: str, thing: object) -> Side:
    """A system without error."""
    import control

    matrices, dt = as_system(name, thing)
    if dt is True:
        raise InputError(f"`{name}` must have its sample time in s; got dt = True")
    if not np.all(is_stable(matrices.A, dt or 0)[1]):
        raise InputError(f"`{name}` must be stable, standing alone; it has a pole that is not")
    model = control.StateSpace(*matrices, dt, remove_useless_states=False)
    edges = np.array([0.0, np.pi / dt if dt else np.inf])
    return Side(name, model, edges, np.zeros((1, *matrices.D.shape)), thing=model)


def _is_passive(thing: AroundModel) -> bool:
    """True where the class, with its parametric part, is positive real on the axis."""
    prior = getattr(getattr(thing, "problem", None), "prior", None)
    return isinstance(prior, PositiveReal) and prior.passive == PositiveReal.passive and not prior.slack


def _members_of(thing: AroundModel) -> Identification | MixedProblem | None:
    """Source of consistent systems: of a band without polygons from its problem, of a family from none."""
    if isinstance(thing, WorstCaseError):
        return thing.identification
    if isinstance(thing, Band):
        return thing.problem if thing.polygons is None else thing.polygons.identification
    found = getattr(thing, "identification", None)
    return found if isinstance(found, Identification) else None


class Cells(NamedTuple):
    """Both sides in z, on common cells: edges in rad/s and as angles, bounds (C, ny, nu) of each.

    In units in which both have about the same gain: `units` times these are those of the user, powers of two.
    """

    models: tuple[control.StateSpace, control.StateSpace]
    edges: Real
    angles: Real
    entries: tuple[Real, Real]
    image: Image | None
    units: tuple[float, float] = (1.0, 1.0)

    def omega(self, angle: float) -> float:
        """The frequency of an angle, rad/s."""
        if self.image is not None:
            return self.image.omega(angle)
        return float(angle / np.pi * self.edges[-1])


def check_pair(source: Side, load: Side) -> float:
    """The sample time of both, 0 in continuous time; refuses sides that make no loop."""
    ny, nu = source.model.noutputs, source.model.ninputs
    if (load.model.ninputs, load.model.noutputs) != (ny, nu):
        raise InputError(
            f"`load` must have {counted(ny, 'input')} and {counted(nu, 'output')}, those of `source` reversed (an"
            " admittance beside an impedance);"
            f" got {load.model.ninputs} and {load.model.noutputs}"
        )
    if not is_well_posed(*(StateMatrices.of(side.model) for side in (source, load))):
        raise InputError("`source` and `load` make no loop: I + G H is singular for infinite frequencies")
    first, second = source.dt, load.dt
    if first is None or second is None:
        return first or second or 0.0
    if abs(first - second) > _SAME * max(first, second):
        words = [f"dt = {one:g} s" if one else "continuous time" for one in (first, second)]
        raise InputError(
            f"`load` must have the time base of `source`, {words[0]}; got {words[1]}. Measure or convert both alike"
        )
    return first


def common_cells(source: Side, load: Side, dt: float) -> Cells:
    """Cells between all edges of both sides; each side's bound on a cell is that of its own arc around it."""
    import control

    top = np.pi / dt if dt else np.inf
    every = np.union1d(source.edges, load.edges)
    every = every[every < top * (1 - _SAME)] if dt else every[np.isfinite(every)]
    inside = every[every > 0]
    scale = np.sqrt(inside[0] * inside[-1]) if inside.size else _corner(source, load)
    grid = np.linspace(0, np.pi, _CELLS + 1)[1:-1]
    edges = np.append(np.union1d(every, grid / dt if dt else scale * np.tan(grid / 2)), top)
    entries = tuple(_on_cells(side, edges) for side in (source, load))
    if dt:
        angles = edges * dt
        angles[-1] = np.pi
        return _alike(Cells((source.model, load.model), freeze(edges), freeze(angles), (entries[0], entries[1]), None))
    image: Any = Image.of(control.StateSpace([], [], [], [[0.0]], 0.0), edges)
    models = tuple(image.model(side.name, side.model) for side in (source, load))
    return _alike(Cells((models[0], models[1]), freeze(edges), freeze(image.edges), (entries[0], entries[1]), image))


def _alike(cells: Cells) -> Cells:
    """The same in units of about the same gain: the source times a power of two, the load divided by it."""
    middle = (cells.angles[:-1] + cells.angles[1:]) / 2
    sizes = [float(np.abs(responses(model, middle)).max()) for model in cells.models]
    if not all(sizes):
        return cells
    unit = 2.0 ** round(float(np.log2(sizes[1]) - np.log2(sizes[0])) / 2)
    first, second = cells.models
    models = _times(first, unit), _times(second, 1 / unit)
    entries = cells.entries[0] * unit, cells.entries[1] / unit
    return cells._replace(models=models, entries=entries, units=(1 / unit, unit))


def _times(model: control.StateSpace, factor: float) -> control.StateSpace:
    import control

    A, B, C, D = StateMatrices.of(model)
    return control.StateSpace(A, B, factor * C, factor * D, model.dt, remove_useless_states=False)


def _corner(source: Side, load: Side) -> float:
    """Middle of the poles of two known systems, rad/s."""
    poles = np.abs(np.concatenate([poles_of(np.asarray(side.model.A)) for side in (source, load)]))
    return float(np.sqrt(poles.min() * poles.max())) if poles.size else 1.0


def _on_cells(side: Side, edges: Real) -> Real:
    arc = np.searchsorted(side.edges, edges[:-1], side="right") - 1
    return side.entries[np.clip(arc, 0, len(side.entries) - 1)]


class Uncertainty(NamedTuple):
    """The errors of both sides as one of the nominal loop: ``I + Delta M`` is singular where a loop is on its edge."""

    nominal: control.StateSpace  # the two sides side by side, or the one that is not known
    controller: control.StateSpace
    bound: Real  # (C, p, q) of the entries of Delta
    places: tuple[tuple[slice, slice] | None, tuple[slice, slice] | None]  # of each side in Delta


def uncertainty_of(cells: Cells) -> Uncertainty:
    """The loop as one plant with a static controller: ``u_G = -y_H, u_H = y_G``; of a known side that is the controller."""
    import control

    (source, load), (first, second) = cells.models, (_with_floor(one) for one in cells.entries)
    whole = slice(None), slice(None)
    if first is None and second is not None:
        return Uncertainty(load, source, second, (None, whole))
    if second is None and first is not None:
        return Uncertainty(source, load, first, (whole, None))
    ny, nu = source.noutputs, source.ninputs
    parts = [[np.asarray(getattr(model, name)) for model in (source, load)] for name in "ABCD"]
    dt = source.dt or load.dt or 1.0
    both = control.StateSpace(*(scipy.linalg.block_diag(*part) for part in parts), dt, remove_useless_states=False)
    eye = np.zeros((nu + ny, ny + nu))
    eye[:nu, ny:], eye[nu:, :ny] = np.eye(nu), -np.eye(ny)
    bound = np.zeros((cells.edges.size - 1, ny + nu, nu + ny))
    if first is not None and second is not None:
        bound[:, :ny, :nu], bound[:, ny:, nu:] = first, second
    places = (slice(0, ny), slice(0, nu)), (slice(ny, None), slice(nu, None))
    return Uncertainty(both, control.StateSpace([], [], [], eye, dt), bound, places)


def _with_floor(entries: Real) -> Real | None:
    """Bounds without zeros; None of a system that is known."""
    finite = entries[np.isfinite(entries)]
    if not entries.any():
        return None
    largest = float(finite.max(initial=0.0)) or 1.0
    return np.maximum(np.where(np.isfinite(entries), entries, largest), _LEAST * largest)
