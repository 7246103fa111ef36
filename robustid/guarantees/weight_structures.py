"""Weights of structured uncertainties of matrices: full, per input, per output, per entry, and which of them costs the least."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from robustid.core import Arrays, Frozen, Real, freeze
from robustid.figures import Drawable
from robustid.guarantees.bilinear import bilinear, discrete
from robustid.guarantees.cells import STRUCTURES, as_bounds, check_plant, implied, log_volume, shape_of, structure_of
from robustid.guarantees.stability_margin import RobustStabilityMargin, robust_stability_margin
from robustid.guarantees.weight import UncertaintyWeight, magnitude_weight

if TYPE_CHECKING:
    import control


@dataclasses.dataclass(frozen=True, eq=False)
class StructuredPlant(Frozen):
    r"""A nominal model with an uncertainty of known structure, :math:`F = F_{id} + L \Delta R`, for continuous-time synthesis.

    Attributes
    ----------
    nominal, left, right : control.StateSpace
        Continuous, with the values of the discrete models at ``s = (2/T)(z - 1)/(z + 1)``.
    blocks : tuple of (int, int)
        Rows and columns of the blocks on the diagonal of Delta, each of largest singular value at most 1.
    dt : float
        Sample time in s of the discrete models.
    """

    nominal: control.StateSpace
    left: control.StateSpace
    right: control.StateSpace
    blocks: tuple[tuple[int, int], ...]
    dt: float

    def controller(self, continuous: control.StateSpace) -> control.StateSpace:
        """The discrete controller of a continuous one that was synthesised for this plant."""
        return discrete(continuous, self.dt)


@dataclasses.dataclass(frozen=True, eq=False)
class StructuredWeight(Frozen, Drawable):
    r"""Weights of an uncertainty of one structure: :math:`F = F_{id} + L \Delta R` for every F within the bounds.

    Attributes
    ----------
    structure : str
        "full", "input", "output" or "entry".
    weights : tuple of UncertaintyWeight
        Of every block, row by row, each stable, minimum-phase and of the smallest order that follows its bound.
    nominal : control.StateSpace
        F_id.
    edges : (C + 1,) array, rad/s
    bound : (C, p, q) array
        Of every block on every cell.
    margin : RobustStabilityMargin or None
        Of the controller that was given, against all errors within `bound`.
    """

    structure: str
    weights: tuple[UncertaintyWeight, ...]
    nominal: control.StateSpace
    edges: Real
    bound: Real
    margin: RobustStabilityMargin | None = None

    def __post_init__(self) -> None:
        self._set(edges=freeze(self.edges), bound=freeze(self.bound))

    def __repr__(self) -> str:
        said = f", margin {self.margin.margin:.4g}" if self.margin is not None else ""
        return f"<StructuredWeight: {self.structure}, {len(self.weights)} weights of order {self.order} in all{said}>"

    @property
    def order(self) -> int:
        """Number of states of all weights, each counted once."""
        return sum(weight.order for weight in self.weights)

    @property
    def certified(self) -> bool:
        """Return whether every weight is proved to be above its bound; see `UncertaintyWeight.certified`."""
        return all(weight.certified for weight in self.weights)

    @property
    def radius(self) -> float:
        r"""Size of what `bound` allows: the geometric mean, over the angle and all directions of a matrix.

        The volume of the set of matrices to the power :math:`1/(2 n_y n_u)`. Other units of a signal change it by the same factor
        for all structures whose bounds change with them.
        """
        angles = np.diff(self.edges)
        size = log_volume(self.bound, self._size)
        return float(np.exp(angles @ size / angles.sum()))

    @property
    def _size(self) -> tuple[int, int]:
        plant: control.StateSpace = self.nominal
        return plant.noutputs, plant.ninputs

    @property
    def blocks(self) -> tuple[tuple[int, int], ...]:
        """Rows and columns of every block on the diagonal of Delta."""
        _, p, q = self.bound.shape
        return ((self._size[0] // p, self._size[1] // q),) * (p * q)

    @property
    def left(self) -> control.StateSpace:
        """L, discrete: adds the blocks up at the outputs; it holds the weights where blocks have fewer rows than columns."""
        return self._sides[0]

    @property
    def right(self) -> control.StateSpace:
        """R, discrete: gives every block its inputs; it holds the weights elsewhere."""
        return self._sides[1]

    @property
    def _sides(self) -> tuple[control.StateSpace, control.StateSpace]:
        _, p, q = self.bound.shape
        rows, columns = self.blocks[0]
        # Block (a, b) takes the inputs of group b and adds to the outputs of group a.
        add = np.kron(np.kron(np.eye(p), np.ones((1, q))), np.eye(rows))
        take = np.kron(np.kron(np.ones((p, 1)), np.eye(q)), np.eye(columns))
        each = [weight.model for weight in self.weights for _ in range(min(rows, columns))]
        A, B, C, D = (scipy.linalg.block_diag(*[np.asarray(getattr(m, part)) for m in each]) for part in "ABCD")
        dt = float(each[0].dt)
        if rows < columns:
            return _model(A, B, add @ C, add @ D, dt), _static(take, dt)
        return _static(add, dt), _model(A, B @ take, C, D @ take, dt)

    def to_control(self) -> StructuredPlant:
        """Nominal model and both sides of Delta in continuous time, for `control.augw`, `control.hinfsyn` and synthesis by scaling.

        Raises
        ------
        InputError
            The nominal model has a pole at z = -1.
        """
        plant: control.StateSpace = self.nominal
        return StructuredPlant(bilinear(plant), bilinear(self.left), bilinear(self.right), self.blocks, float(plant.dt))

    def arrays(self) -> Arrays:
        """Everything as plain arrays: `edges`, `bound`, `blocks`, and A, B, C, D of ``nominal``, ``left`` and ``right``."""
        found: Arrays = {"edges": self.edges, "bound": self.bound, "blocks": np.array(self.blocks)}
        for name in ("nominal", "left", "right"):
            model: control.StateSpace = getattr(self, name)
            found |= {f"{name}_{part}": np.asarray(getattr(model, part)) for part in "ABCD"}
        return found


def _model(A: Real, B: Real, C: Real, D: NDArray[np.floating], dt: float) -> control.StateSpace:
    import control

    return control.StateSpace(A, B, C, D, dt, remove_useless_states=False)


def _static(gain: NDArray[np.floating], dt: float) -> control.StateSpace:
    ny, nu = gain.shape
    return _model(np.zeros((0, 0)), np.zeros((0, nu)), np.zeros((ny, 0)), gain, dt)


def structured_weight(
    nominal: control.StateSpace,
    edges: ArrayLike,
    bound: ArrayLike,
    *,
    structure: str,
    order: int | None = None,
    tightness: float = 1.5,
) -> StructuredWeight:
    r"""Turn bounds of the error of a matrix into weights of one structure, each of the smallest order that follows its bound.

    .. math:: F = F_{id} + [w_{ij} \Delta_{ij}], \qquad \bar\sigma(\Delta_{ij}) \le 1

    with one block ("full"), a block for every column ("input": the error that an input causes), for every row ("output": the
    error at an output), or for every entry. The bounds of the blocks are the smallest that follow from what is given.

    Parameters
    ----------
    nominal : control.StateSpace
        F_id, discrete.
    edges : (C + 1,) array
        Edges of the cells in rad/s, rising, to pi/dt.
    bound : array or tuple of arrays
        As in `robust_stability_margin`; not necessarily of this structure.
    structure : {"full", "input", "output", "entry"}
    order, tightness
        As in `uncertainty_weight`, for every weight.

    Returns
    -------
    StructuredWeight

    Raises
    ------
    InputError, InputTypeError
        Another structure; shapes that don't fit, or two bounds of the same structure.

    Examples
    --------
    >>> import control, numpy as np
    >>> from robustid.guarantees import structured_weight
    >>> nominal = control.ss(0.5 * np.eye(2), np.eye(2), np.eye(2), np.zeros((2, 2)), 1.0)
    >>> weight = structured_weight(nominal, [0.0, np.pi], [[[0.3, 0.1], [0.4, 0.1]]], structure="input")
    >>> weight.bound.round(3).tolist(), weight.blocks, weight.certified
    ([[[0.5, 0.141]]], ((2, 1), (2, 1)), True)
    """
    plant = check_plant(nominal)
    size = plant.noutputs, plant.ninputs
    shape_of(structure, size)  # before anything is computed
    cells, bounds = as_bounds(plant, edges, bound)
    found = implied(bounds, structure, size)
    blocks = found.reshape(found.shape[0], -1).T
    weights = tuple(
        magnitude_weight(cells.edges, block, dt=float(plant.dt), order=order, tightness=tightness) for block in blocks
    )
    return StructuredWeight(structure, weights, plant, cells.edges, found)


def structured_weights(
    nominal: control.StateSpace,
    edges: ArrayLike,
    bound: ArrayLike,
    *,
    controller: control.StateSpace | None = None,
    order: int | None = None,
    tightness: float = 1.5,
) -> tuple[StructuredWeight, ...]:
    """All structures that a matrix has, the one that costs the least first.

    With a controller the cost of a structure is the margin that is lost: the largest robust stability margin against all errors
    that the bounds of the structure allow comes first. Without one the cost is the size of that set, `StructuredWeight.radius`.
    Structures within one per cent of the best are told apart by the number of states of their weights: what costs no margin may
    as well be simple.

    Parameters
    ----------
    nominal, edges, bound, order, tightness
        As in `structured_weight`.
    controller : control.StateSpace, optional
        From the outputs to the inputs of the nominal model.

    Returns
    -------
    tuple of StructuredWeight
        With `margin` where there is a controller. Structures that are the same for this size stand once.

    Raises
    ------
    InputError, InputTypeError
        As there, and as in `robust_stability_margin`.

    Examples
    --------
    >>> import control, numpy as np
    >>> from robustid.guarantees import structured_weights
    >>> nominal = control.ss(0.5 * np.eye(2), np.eye(2), np.eye(2), np.zeros((2, 2)), 1.0)
    >>> found = structured_weights(nominal, [0.0, np.pi], [[[0.3, 1e-3], [1e-3, 0.1]]])  # two machines that hardly meet
    >>> found[0].structure
    'entry'
    """
    plant = check_plant(nominal)
    size = plant.noutputs, plant.ninputs
    _, bounds = as_bounds(plant, edges, bound)
    names = list(dict.fromkeys(structure_of(implied(bounds, name, size), size) for name in STRUCTURES))
    found: list[StructuredWeight] = []
    for name in names:
        weight = structured_weight(plant, edges, bound, structure=name, order=order, tightness=tightness)
        if controller is not None:
            margin = robust_stability_margin(plant, controller, weight.edges, weight.bound)
            weight = dataclasses.replace(weight, margin=margin)
        found.append(weight)
    costs = [1 / one.margin.margin if one.margin and one.margin.margin else one.radius for one in found]
    least = min(costs)
    ranks = [(0.0 if cost <= 1.01 * least else cost, one.order) for cost, one in zip(costs, found, strict=True)]
    return tuple(found[k] for k in sorted(range(len(found)), key=ranks.__getitem__))
