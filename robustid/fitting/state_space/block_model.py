"""A realisation in real blocks of two poles: its states, its tangent space modulo similarities, its steps."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from robustid.core import Array, Complex, Frozen, Real, StateMatrices, freeze
from robustid.fitting.modal.modal_form import poles_in_pairs
from robustid.fitting.state_space.given_poles import diagonal_blocks
from robustid.fitting.state_space.integrator_chains import chain
from robustid.fitting.state_space.pole_distances import EDGE, RESOLVED, distance, least_distances, line_spacing

_FAR = 100.0  # in the unit of the nodes, the largest of which lies between 0.5 and 1
_DOUBLE = 1e-2  # a block of a double pole is coupled by this part of the pole's distance from the boundary
_LEAST_COUPLING = 1e-6  # of a block of a double pole on the stability boundary
_PAIRED = ("centre", "coupling", "fall", "inputs")


@dataclasses.dataclass(frozen=True, eq=False)
class BlockModel(Frozen):
    """A and B of a realisation: blocks ``[[a, s], [-v, a]]`` of two poles ``a ± sqrt(-s v)``, single poles, chains. The
    coupling s is fixed, so that a complex pair becomes two real poles smoothly where v passes zero. Modulo similarities the
    model has n*nu coordinates in (A, B), with C n*(ny + nu) in all: the dimension of the model set.
    """

    # The coordinates are two a block for its poles, and what of the inputs isn't moved by the block's commutant (I and the
    # off-diagonal part of the block), which C takes up.
    centre: Real  # a, s and v of the blocks, (m,)
    coupling: Real
    fall: Real
    inputs: Real  # B of the blocks (m, 2, nu), of norm one
    single: Real  # (r,) real poles without a partner
    single_inputs: Real  # (r, nu)
    directions: Real  # (count, nu) velocity rows of the rigid-body chains (count may be 0)
    free: NDArray[np.bool_]  # entries of the directions that are refined
    discrete: bool

    width = 2  # columns of C that a block of two poles has

    def __post_init__(self) -> None:
        self._set(**{f.name: freeze(getattr(self, f.name)) for f in dataclasses.fields(self) if f.name != "discrete"})

    @classmethod
    def of(
        cls, A: Real, B: Real, *, discrete: bool, directions: Real | None = None, free: NDArray[np.bool_] | None = None
    ) -> BlockModel:
        """Blocks of a state space in the unit of the nodes, and chains of integrators that these directions drive."""
        nu = B.shape[1]
        directions = np.zeros((0, nu)) if directions is None else directions
        free = np.zeros(directions.shape, dtype=bool) if free is None else free
        pairs, single, single_inputs = poles_in_pairs(A, B, float(discrete))
        return cls(
            np.array([pair.centre for pair in pairs]),
            np.array([pair.coupling for pair in pairs]),
            np.array([pair.fall for pair in pairs]),
            np.array([pair.inputs for pair in pairs]).reshape(-1, 2, nu),
            single,
            single_inputs,
            directions,
            free,
            discrete,
        ).normalised()

    def normalised(self) -> BlockModel:
        """The same poles and input directions with balanced blocks and inputs of norm one."""
        product = self.coupling * self.fall
        s = np.maximum(np.sqrt(np.abs(product)), _DOUBLE * self.distances[: self.centre.size])
        s = np.maximum(s, _LEAST_COUPLING)
        ratio = self.coupling / s  # x_2 -> ratio x_2
        inputs = self.inputs * np.stack([np.ones(ratio.size), ratio], axis=1)[:, :, None]
        size = np.linalg.norm(inputs, axis=(1, 2), keepdims=True)
        single = np.linalg.norm(self.single_inputs, axis=1, keepdims=True)
        return dataclasses.replace(
            self,
            coupling=s,
            fall=product / s,
            inputs=inputs / np.where(size > 0, size, 1.0),
            single_inputs=self.single_inputs / np.where(single > 0, single, 1.0),
        )

    @property
    def order(self) -> int:
        """Number of states."""
        return 2 * self.centre.size + self.single.size + 2 * len(self.directions)

    @property
    def poles(self) -> Complex:
        """Poles of the blocks, each pair together, then single ones; without rigid-body modes."""
        swing = np.sqrt((-self.coupling * self.fall).astype(complex))
        pairs = np.stack([self.centre + swing, self.centre - swing], axis=1).ravel()
        return np.concatenate([pairs, self.single]).astype(np.complex128)

    @property
    def distances(self) -> Real:
        """Distance of the blocks and of the single poles from the stability boundary, negative outside."""
        pairs = distance(self.centre, self.coupling * self.fall, self.discrete)
        return np.concatenate([pairs, distance(self.single, np.zeros(self.single.size), self.discrete)])

    def matrices(self) -> tuple[Real, Real]:
        """A and B."""
        count, nu = len(self.directions), self.inputs.shape[2]
        blocks = [np.array([[a, s], [-v, a]]) for a, s, v in zip(self.centre, self.coupling, self.fall, strict=True)]
        A = diagonal_blocks(*blocks, np.diag(self.single), chain(count, float(self.discrete)))
        parts = [self.inputs.reshape(-1, nu), self.single_inputs, np.zeros((count, nu)), self.directions]
        return A, np.concatenate(parts)

    def realised(self, C: Real, D: Real) -> StateMatrices:
        """State space in the unit of the nodes."""
        return StateMatrices(*self.matrices(), C, D)

    def driven(self, inputs: Real) -> BlockModel:
        """The model with other inputs (n, m), as they are; without rigid-body modes."""
        flexible, count = 2 * self.centre.size, inputs.shape[1]
        pairs, single = inputs[:flexible].reshape(-1, 2, count), inputs[flexible:]
        none = np.zeros((0, count))
        return dataclasses.replace(self, inputs=pairs, single_inputs=single, directions=none, free=none.astype(bool))

    def states(self, xi: Complex) -> Complex:
        """``(xi I - A)^{-1} B``, (F, n, nu)."""
        lines, nu = xi.size, self.inputs.shape[2]
        out = np.empty((lines, self.order, nu), dtype=complex)
        flexible, m = 2 * self.centre.size, self.single.size
        first, second = self.inputs[:, 0], self.inputs[:, 1]
        shifted, inverse = self._resolvent(xi)
        out[:, 0:flexible:2] = inverse[..., None] * (shifted[..., None] * first + self.coupling[:, None] * second)
        out[:, 1:flexible:2] = inverse[..., None] * (shifted[..., None] * second - self.fall[:, None] * first)
        out[:, flexible : flexible + m] = self.single_inputs / (xi[:, None] - self.single)[..., None]
        distance = 1 / (xi - float(self.discrete))[:, None, None] if len(self.directions) else np.ones((lines, 1, 1))
        count = len(self.directions)
        out[:, flexible + m : flexible + m + count] = distance**2 * self.directions
        out[:, flexible + m + count :] = distance * self.directions
        return out

    def output_rows(self, xi: Complex, C: Real) -> Complex:
        """``C (xi I - A)^{-1}``, (F, ny, n)."""
        out = np.empty((xi.size, len(C), self.order), dtype=complex)
        flexible, m, count = 2 * self.centre.size, self.single.size, len(self.directions)
        shifted, inverse = self._resolvent(xi)
        first, second = C[:, 0:flexible:2], C[:, 1:flexible:2]
        out[:, :, 0:flexible:2] = inverse[:, None] * (shifted[:, None] * first - self.fall * second)
        out[:, :, 1:flexible:2] = inverse[:, None] * (shifted[:, None] * second + self.coupling * first)
        out[:, :, flexible : flexible + m] = C[:, flexible : flexible + m] / (xi[:, None] - self.single)[:, None]
        if count:
            distance = 1 / (xi - float(self.discrete))[:, None, None]
            position, velocity = C[:, -2 * count : self.order - count], C[:, self.order - count :]
            out[:, :, -2 * count : self.order - count] = distance * position
            out[:, :, self.order - count :] = distance**2 * position + distance * velocity
        return out

    def tangent(self, xi: Complex, states: Complex, C: Real, directions: Complex | None = None) -> Complex:
        """Derivatives (F, ny, nu, T) of the response in the coordinates of `moved`, ``dP = C R (dA R B + dB)``. With directions
        (F, nu, c) of the inputs, ``R B directions`` for the states, those of ``P directions``, (F, ny, c, T).
        """
        rows = self.output_rows(xi, C)
        return np.concatenate([self._pole_changes(rows, states), self._input_changes(rows, directions)], axis=3)

    def markov_tangent(self, C: Real, power: int) -> Real:
        """Derivatives (ny, nu, T) of ``C A^power B`` in the coordinates of `moved`."""
        A, B = self.matrices()
        rows, states = [C], [B]
        for _ in range(power):
            rows.append(rows[-1] @ A)
            states.append(A @ states[-1])
        products = self._pole_changes(np.stack(rows)[:power], np.stack(states)[:power][::-1])
        return np.concatenate([products.sum(axis=0), self._input_changes(rows[-1][None])[0]], axis=2)

    def _pole_changes(self, rows: Array, states: Array) -> Array:
        """``rows dA states`` (F, ny, c, 2 m + r) for rows (F, ny, n) and states (F, n, c)."""
        flexible, m = 2 * self.centre.size, self.single.size
        left, right = rows[:, :, None, :], states.transpose(0, 2, 1)[:, None]
        diagonal = left[..., : flexible + m] * right[..., : flexible + m]
        parts = [
            diagonal[..., 0:flexible:2] + diagonal[..., 1:flexible:2],
            -left[..., 1:flexible:2] * right[..., 0:flexible:2],
            diagonal[..., flexible:],
        ]
        return np.concatenate(parts, axis=3)

    def _input_changes(self, rows: Array, directions: Complex | None = None) -> Array:
        """``rows dB directions`` (F, ny, c, T - 2 m - r); directions (F, nu, c) of the inputs, or every input alone."""
        lines, outputs, nu = *rows.shape[:2], self.inputs.shape[2]
        flexible, m, count = 2 * self.centre.size, self.single.size, len(self.directions)
        parts: list[Array] = []
        pair_moves, single_moves = self.input_moves()
        blocks = rows[:, :, :flexible].reshape(lines, outputs, -1, 2)
        blocks = np.einsum("fomr,mruq->foumq", blocks, pair_moves, optimize=True)
        alone = np.einsum("fom,muq->foumq", rows[:, :, flexible : flexible + m], single_moves, optimize=True)
        for part in (blocks, alone):
            if directions is not None:
                part = np.einsum("foumq,fuc->focmq", part, directions, optimize=True)
            parts.append(part.reshape(*part.shape[:3], part.shape[3] * part.shape[4]))
        for i, j in np.argwhere(self.free):
            velocity = rows[:, :, self.order - count + i, None, None]
            parts.append(
                velocity * (np.eye(nu)[j : j + 1] if directions is None else directions[:, j])[:, None, :, None]
            )
        return np.concatenate(parts, axis=3)

    @property
    def pole_coordinates(self) -> int:
        """Number of the coordinates that move poles, the first of `tangent`."""
        return 2 * self.centre.size + self.single.size

    def tied_outputs(self) -> Real:
        """Matrices C (T, nu, order) for which the response is symmetric: ``B' K`` with ``K A = A' K``, K symmetric."""
        m, single, count, nu = self.centre.size, self.single.size, len(self.directions), self.inputs.shape[2]
        out: list[Real] = []
        for k, (first, second) in enumerate(self.inputs):
            part = np.zeros((2, nu, self.order))
            part[0, :, 2 * k], part[0, :, 2 * k + 1] = second, first
            part[1, :, 2 * k], part[1, :, 2 * k + 1] = -self.fall[k] / self.coupling[k] * first, second
            out.append(part)
        for k, row in enumerate(self.single_inputs):
            part = np.zeros((1, nu, self.order))
            part[0, :, 2 * m + k] = row
            out.append(part)
        for start in (2 * m + single, 2 * m + single + count):
            out.append(tied_gains(self.directions, start, self.order))
        return np.concatenate(out)

    def tied_changes(self, states: Complex, C: Real, tangent: Complex) -> Complex:
        """The tangent where C is tied to the inputs: what moves the inputs moves the outputs as well, and so does v."""
        tangent = with_transposes(tangent, self.pole_coordinates)
        for k, fall in enumerate(self.tied_falls(C)):
            tangent[..., self.centre.size + k] += fall[:, None] * states[:, None, 2 * k]
        return tangent

    def reach(self, xi: Complex) -> Real:
        """Scale of every coordinate (T,): distance of a pole from the nearest frequency point, size of the inputs."""
        poles = self.poles
        near = np.array([np.abs(xi - pole).min() for pole in poles])
        blocks = near[: 2 * self.centre.size].reshape(-1, 2).min(axis=1)
        nu = self.inputs.shape[2]
        ones = self.centre.size * (2 * nu - 2) + self.single.size * (nu - 1)
        sizes = np.abs(self.directions).max(axis=1, initial=0.0)[:, None] * np.ones(nu)
        return np.concatenate([blocks, blocks, near[2 * self.centre.size :], np.ones(ones), sizes[self.free]])

    def normals(self) -> Real:
        """Gradients (m + r, T') of the `distances` in the coordinates of the poles, the first of `tangent`."""
        product = self.coupling * self.fall
        swing = np.sqrt(np.maximum(np.abs(product), np.finfo(float).tiny))
        real = product <= 0
        along = np.where(real, -self.coupling / (2 * swing), 0.0)
        across, single = np.ones(self.centre.size), np.ones(self.single.size)
        if self.discrete:
            radius = np.hypot(self.centre, swing)
            across = np.where(real, np.sign(self.centre), self.centre / radius)
            along = np.where(real, along, self.coupling / (2 * radius))
            single = np.sign(self.single)
        pairs = np.hstack([np.diag(across), np.diag(along)])
        return -diagonal_blocks(pairs, np.diag(single))

    def least_distances(self, xi: Complex, resolved: float) -> Real:
        """Least distance of the poles from the stability boundary after a step: a part of the way, and what the data resolve."""
        return least_distances(self.distances, self.spacing(xi), resolved)

    def spacing(self, xi: Complex) -> Real:
        """Distance between the frequency points where the blocks and the single poles are; beyond the last, that from it."""
        poles = np.concatenate([self.poles[: 2 * self.centre.size : 2], self.single.astype(np.complex128)])
        return line_spacing(xi, poles, self.discrete)

    def moved(self, step: Real, least: Real | None = None) -> BlockModel:
        """The model after a step in the coordinates of `tangent`, poles kept at least so far inside."""
        m, r, nu = self.centre.size, self.single.size, self.inputs.shape[2]
        pair_moves, single_moves = self.input_moves()
        ends = np.cumsum([m, m, r, m * pair_moves.shape[3], r * single_moves.shape[2]])
        centre, fall, single, pair, alone, rest = np.split(step, ends)
        directions = self.directions.copy()
        directions[self.free] += rest
        trial = dataclasses.replace(
            self,
            centre=self.centre + centre,
            fall=self.fall + fall,
            inputs=self.inputs + np.einsum("mruq,mq->mru", pair_moves, pair.reshape(m, 2 * nu - 2)),
            single=self.single + single,
            single_inputs=self.single_inputs + np.einsum("muq,mq->mu", single_moves, alone.reshape(r, nu - 1)),
            directions=directions,
        )
        trial = trial._near()
        return (trial if least is None else trial._inside(least)).normalised()

    def without(self, block: int) -> BlockModel:
        """The model without a block of two poles."""
        parts = {name: np.delete(getattr(self, name), block, axis=0) for name in _PAIRED}
        return dataclasses.replace(self, **parts)

    def joined(self, other: BlockModel) -> BlockModel:
        """The model with the blocks of two poles of another one."""
        parts = {name: np.concatenate([getattr(self, name), getattr(other, name)]) for name in _PAIRED}
        return dataclasses.replace(self, **parts)

    def reflected(self) -> BlockModel:
        """The model with unstable poles reflected: -conj(s), 1/conj(z)."""
        return self._inside(np.full(self.centre.size + self.single.size, EDGE), reflect=True).normalised()

    def resolved(self, xi: Complex, part: float = RESOLVED) -> BlockModel:
        """The model with unstable poles reflected and at least the damping that the frequency points resolve."""
        inside = self.reflected()
        return inside._inside(part * inside.spacing(xi)).normalised()

    def _near(self) -> BlockModel:
        """Poles in s at most `_FAR` away: beyond, a pole is a feed-through in disguise, and costs digits."""
        if self.discrete:
            return self
        far = _FAR**2 / self.coupling
        return dataclasses.replace(
            self,
            centre=np.maximum(self.centre, -_FAR),
            fall=np.clip(self.fall, -far, far),
            single=np.maximum(self.single, -_FAR),
        )

    def _inside(self, least: Real, *, reflect: bool = False) -> BlockModel:
        """Poles at least so far from the boundary: pulled in, or reflected."""
        m = self.centre.size
        distance, least = self.distances, np.maximum(least, EDGE)
        out = distance < least
        if not np.any(out):
            return self
        if not self.discrete:
            wanted = np.maximum(np.abs(distance), least) if reflect else least
            shift = np.where(out, distance - wanted, 0.0)
            return dataclasses.replace(self, centre=self.centre + shift[:m], single=self.single + shift[m:])
        radius = 1 - distance
        target = np.where(reflect & (radius > 1), np.minimum(1 / np.maximum(radius, 1e-300), 1 - least), 1 - least)
        factor = np.where(out, target / np.maximum(radius, 1e-300), 1.0)
        return dataclasses.replace(
            self, centre=self.centre * factor[:m], fall=self.fall * factor[:m] ** 2, single=self.single * factor[m:]
        )

    def _resolvent(self, xi: Complex) -> tuple[Complex, Complex]:
        """``xi - a`` and the inverse of ``(xi - a)^2 + s v``, (F, m): by factors, which keeps lightly damped poles exact."""
        shifted = xi[:, None] - self.centre
        swing = np.sqrt((-self.coupling * self.fall).astype(complex))
        return shifted, 1 / ((shifted - swing) * (shifted + swing))

    def tied_falls(self, C: Real) -> Real:
        """Derivatives (m, nu) of the first columns of C by v, where C is tied to the inputs."""
        out = np.zeros((self.centre.size, self.inputs.shape[2]))
        for k, inputs in enumerate(self.inputs):
            first, second = inputs[:, :, None]
            ratio = -self.fall[k] / self.coupling[k]
            system = np.vstack([np.hstack([second, ratio * first]), np.hstack([first, second])])
            gain = np.linalg.lstsq(system, C[:, 2 * k : 2 * k + 2].T.ravel(), rcond=None)[0][1]
            out[k] = -gain / self.coupling[k] * inputs[0]
        return out

    def input_moves(self) -> tuple[Real, Real]:
        """Orthonormal moves of the inputs that no scaling within a block makes: (m, 2, nu, 2 nu - 2), (r, nu, nu - 1)."""
        m, _, nu = self.inputs.shape
        turned = np.stack([self.coupling[:, None] * self.inputs[:, 1], -self.fall[:, None] * self.inputs[:, 0]], axis=1)
        both = np.stack([self.inputs.reshape(m, 2 * nu), turned.reshape(m, 2 * nu)], axis=2)
        pairs = np.linalg.svd(both)[0][:, :, 2:].reshape(m, 2, nu, 2 * nu - 2)
        return pairs, np.linalg.svd(self.single_inputs[:, :, None])[0][:, :, 1:]


def tied_gains(directions: Real, start: int, order: int) -> Real:
    """Matrices C (T, nu, order) = ``directions' (symmetric)`` on the columns from `start` on."""
    count, nu = directions.shape
    pairs = [(i, j) for i in range(count) for j in range(i + 1)]
    out = np.zeros((len(pairs), nu, order))
    for gain, (i, j) in zip(out, pairs, strict=True):
        gain[:, start + j] = directions[i]
        gain[:, start + i] = directions[j]
    return out


def with_transposes(tangent: Complex, poles: int) -> Complex:
    """Derivatives (F, nu, nu, T) with their transposes added, but for the coordinates of the poles."""
    shapes = tangent[..., poles:]
    return np.concatenate([tangent[..., :poles], shapes + shapes.transpose(0, 2, 1, 3)], axis=3)
