"""Modal form: a state space of small blocks, one a mode; and its poles two by two, as `BlockModel` takes them."""

from __future__ import annotations

import dataclasses
import itertools
import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy.linalg

from robustid.core import Frozen, Real, StateMatrices, freeze, points_of, response_at, scaled_states, threads_for
from robustid.errors import InputError
from robustid.identification import check_model

if TYPE_CHECKING:
    import control

# Poles within this part of the distance to the next one of s = 0 (z = 1) belong to the rigid body.
_RIGID = 1e-6
# Relative size, against the balanced A, of what rounding leaves where a chain of integrators has zeros.
_ROUNDING = 1e-12
# A spectral projector larger than this would cost as many digits: the two nearest groups are kept in one block.
_LARGEST_PROJECTOR = 1e5


@dataclasses.dataclass(frozen=True, eq=False)
class ModalForm(Frozen):
    """A model in real block-diagonal form, and how well it could be brought there."""

    # same response, dt and signals. Blocks of A: ``[[a, b], [-b, a]]`` for a pair a ± jb, 1x1 for a real pole; poles
    # too close to be told apart share a larger block (quasi-triangular)
    model: control.StateSpace
    blocks: tuple[slice, ...]  # states of each block, by distance of the poles from the rigid-body pole
    # number of states of the rigid body, in the first block: ``[[0, I, 0], [0, 0, 0], [0, 0, 0]]`` plus I times the
    # rigid-body pole (0 in s, 1 in z), exactly: chains of two integrators, then single integrators
    rigid: int
    transformation: np.ndarray  # (n, n); T of ``x = T x_modal``; the columns of a block span its invariant subspace
    condition: float  # ``|T| |T^{-1}|`` (spectral norms)
    # largest difference from the response of the model given, relative to its norm at that frequency, on a grid that
    # holds all resonances
    error: float

    def __post_init__(self) -> None:
        self._set(transformation=freeze(self.transformation))


def modal_form(model: control.StateSpace) -> ModalForm:
    """Bring a state space to real block-diagonal form, rigid-body modes as exact chains of integrators.

    ``A T = T diag(A_1, A_2, ...)``: of every block the right and the left invariant subspace come from an ordered Schur
    form and a Sylvester equation, no eigenvector from another one, so that poles may be close and chains stay chains.

    Parameters
    ----------
    model : control.StateSpace
        Continuous, or discrete with its sample time.

    Returns
    -------
    ModalForm

    Raises
    ------
    InputError, InputTypeError
        `model` isn't a finite StateSpace with known time base.

    Notes
    -----
    Poles count as rigid body where a change of A by rounding (1e-12 of its norm, after balancing) makes them chains of
    at most two integrators. Others within 1e-6 of the distance to the next pole share a block.

    Source: `bavely1979` (blocks as small as the condition allows).

    Examples
    --------
    >>> import control
    >>> form = modal_form(control.ss([[0, 1], [-16, -2]], [[0], [1]], [[1, 0]], 0))
    >>> bool(abs(form.model.A[0, 0] + 1) < 1e-14), form.blocks, form.rigid
    (True, (slice(0, 2, None),), 0)
    """
    system = check_model("model", model)
    if system.dt is True:
        raise InputError("`model` is discrete without a sample time; give it its dt in s")
    A, B, C = (np.asarray(part, dtype=float) for part in (system.A, system.B, system.C))
    origin = 1.0 if system.dt else 0.0
    if not len(A):
        return ModalForm(system, (), 0, np.zeros((0, 0)), 1.0, 0.0)
    with threads_for(len(A)):
        parts, rigid, poles = modal_parts(A, origin)
        right, left = np.hstack([part.right for part in parts]), np.vstack([part.left for part in parts])
        ends = np.cumsum([0, *(len(part.block) for part in parts)])
        blocks = tuple(slice(int(a), int(b)) for a, b in itertools.pairwise(ends))
        import control

        result = control.ss(
            np.asarray(scipy.linalg.block_diag(*(part.block for part in parts))),
            left @ B,
            C @ right,
            system.D,
            system.dt,
            inputs=system.input_labels,
            outputs=system.output_labels,
        )
        condition = float(np.linalg.norm(right, 2) * np.linalg.norm(left, 2))
        flexible = np.delete(poles, parts[0].members) if rigid else poles
        return ModalForm(result, blocks, rigid, right, condition, _response_error(system, result, flexible))


def modal_parts(A: np.ndarray, origin: float) -> tuple[list[ModalPart], int, np.ndarray]:
    """Groups of poles with their invariant subspaces, the rigid body first; its number of states; all poles."""
    balanced, scaling = scipy.linalg.matrix_balance(A, permute=False)
    T, Z = scipy.linalg.schur(balanced, output="real")[:2]
    poles = schur_poles(T)
    parts, rigid = _split(T, Z, poles, origin)
    scales = np.diagonal(scaling)
    scaled = [part._replace(right=scales[:, None] * part.right, left=part.left / scales) for part in parts]
    return scaled, rigid, poles


class ModalPart(NamedTuple):
    """A group of poles: ``left A = block left``, ``A right = right block``, ``left right = I``."""

    members: np.ndarray
    block: np.ndarray
    right: np.ndarray
    left: np.ndarray

    def changed(self, basis: np.ndarray, block: np.ndarray) -> ModalPart:
        """The part in another basis of the same subspaces, where the block is known."""
        return ModalPart(self.members, block, self.right @ basis, np.linalg.solve(basis, self.left))


def schur_poles(T: np.ndarray) -> np.ndarray:
    """Eigenvalues of a real Schur form, in the order of its diagonal."""
    poles = np.diag(T).astype(complex)
    for j in np.flatnonzero(np.diag(T, -1)):
        swing = np.sqrt(complex(T[j, j + 1] * T[j + 1, j]))  # equal diagonal entries: LAPACK's standard form
        poles[j], poles[j + 1] = T[j, j] + swing, T[j, j] - swing
    return poles


def _split(T: np.ndarray, Z: np.ndarray, poles: np.ndarray, origin: float) -> tuple[list[ModalPart], int]:
    """Groups as small as well-conditioned projectors allow, by distance; size of the rigid body, which comes first."""
    starts = np.flatnonzero(np.r_[True, np.diag(T, -1) == 0])
    groups: list[np.ndarray] = [np.arange(a, b) for a, b in zip(starts, np.r_[starts[1:], len(T)], strict=True)]
    distance = np.abs(poles - origin)
    groups.sort(key=lambda group: distance[group[0]])
    rigid, held = _rigid_body(T, Z, groups, distance, origin)
    if held:
        groups = [np.sort(np.concatenate(groups[:held])), *groups[held:]]
    parts: dict[bytes, ModalPart] = {}
    while True:
        for group in groups:
            if group.tobytes() not in parts:
                parts[group.tobytes()] = _part(T, Z, group)
        free = groups[1:] if rigid is not None else groups
        sizes = [float(np.linalg.norm(parts[group.tobytes()].left, 2)) for group in free]
        worst = int(np.argmax(sizes)) if sizes else 0
        if len(free) < 2 or sizes[worst] <= _LARGEST_PROJECTOR:
            break
        gaps = [np.inf if k == worst else _gap(poles[free[worst]], poles[g]) for k, g in enumerate(free)]
        pair = {worst, int(np.argmin(gaps))}
        merged = np.sort(np.concatenate([free[k] for k in pair]))
        groups = groups[: len(groups) - len(free)] + [g for k, g in enumerate(free) if k not in pair] + [merged]
    free.sort(key=lambda group: distance[group].min())
    found = [_rotation(parts[group.tobytes()]) for group in free]
    return ([rigid, *found], len(rigid.block)) if rigid is not None else (found, 0)


def _gap(some: np.ndarray, others: np.ndarray) -> float:
    return float(np.abs(some[:, None] - others).min())


def _rigid_body(
    T: np.ndarray, Z: np.ndarray, groups: list[np.ndarray], distance: np.ndarray, origin: float
) -> tuple[ModalPart | None, int]:
    """The part of the rigid body, if rounding alone keeps it from being exact, and the number of groups to hold."""
    size = float(np.linalg.norm(T, 2))
    far = np.array([*(distance[group[0]] for group in groups), np.inf])
    # A chain of two integrators is split by the square root of rounding: everything within that is tried.
    reach = int(np.sum(far <= max(10 * np.sqrt(_ROUNDING) * size, np.finfo(float).tiny)))
    for held in range(reach, 0, -1):
        part = _part(T, Z, np.sort(np.concatenate(groups[:held])))
        chains = _chains(part, origin, _ROUNDING * size)
        if chains is not None:
            return chains, held
    close = np.flatnonzero((far[:-1] <= _RIGID * far[1:]) & np.isfinite(far[1:]))
    return None, int(close[-1]) + 1 if close.size else 0


def _chains(part: ModalPart, origin: float, tolerance: float) -> ModalPart | None:
    """The part as exact chains of one or two integrators, if it is that up to the tolerance."""
    k = len(part.block)
    U, sizes, Vt = np.linalg.svd(part.block - origin * np.eye(k))
    rank = int(np.sum(sizes > 1e3 * tolerance))
    dropped = max(
        np.max(sizes[rank:], initial=0.0), np.max(np.abs(Vt[:rank] @ U[:, :rank] * sizes[:rank]), initial=0.0)
    )
    if 2 * rank > k or dropped > tolerance * k:
        return None
    root = np.sqrt(sizes[:rank])
    rest = scipy.linalg.null_space(np.vstack([U[:, :rank].T, Vt[:rank]])) if 2 * rank < k else np.zeros((k, 0))
    # N V = U S and N U = 0: in the basis (U S^1/2, V S^-1/2, rest) it is [[0, I, 0], [0, 0, 0], [0, 0, 0]].
    block = origin * np.eye(k)
    block[:rank, rank : 2 * rank] += np.eye(rank)
    return part.changed(np.hstack([U[:, :rank] * root, Vt[:rank].T / root, rest]), block)


def _rotation(part: ModalPart) -> ModalPart:
    """A conjugate pair as [[a, b], [-b, a]] with b > 0; every other part as it is."""
    M = part.block
    if len(M) != 2 or M[0, 1] * M[1, 0] >= 0:
        return part
    scale = np.sign(M[0, 1]) * np.sqrt(-M[1, 0] / M[0, 1])
    swing = np.sqrt(-M[0, 1] * M[1, 0])
    block = np.array([[M[0, 0], swing], [-swing, M[0, 0]]])
    return part.changed(np.diag([1.0, scale]), block)


def _part(T: np.ndarray, Z: np.ndarray, members: np.ndarray) -> ModalPart:
    """Invariant subspaces of the chosen poles."""
    n, k = len(T), members.size
    if k == n:
        return ModalPart(members, T, Z, Z.T)
    chosen = np.zeros(n, dtype=np.int32)
    chosen[members] = 1
    (reorder,) = scipy.linalg.get_lapack_funcs(("trsen",), (T, Z))
    S, Q, *_, info = reorder(chosen, T, Z, job="N")
    if info:
        raise np.linalg.LinAlgError("poles too close to be reordered")
    # [I Y] S = S_11 [I Y] with S_11 Y - Y S_22 = S_12
    Y = scipy.linalg.solve_sylvester(S[:k, :k], -S[k:, k:], S[:k, k:])
    return ModalPart(members, S[:k, :k], Q[:, :k], Q[:, :k].T + Y @ Q[:, k:].T)


def continuous(pole: complex, dt: float) -> complex:
    """The pole in s; nan for z = 0."""
    if not dt:
        return complex(pole)
    return complex(np.log(complex(pole))) / dt if pole else complex(np.nan, np.nan)


def _response_error(system: control.StateSpace, result: control.StateSpace, poles: np.ndarray) -> float:
    """Largest difference of two responses on a grid, relative to the norm at the frequency."""
    s = np.array([continuous(pole, system.dt) for pole in poles])
    omega = np.sort(np.abs(s[np.isfinite(s) & (s != 0)]))
    omega = omega if omega.size else np.ones(1)
    # Beside the resonances, between them, and one decade out.
    omega = np.concatenate([1.001 * omega, np.sqrt(omega[1:] * omega[:-1]), [omega[0] / 10, omega[-1] * 10]])
    points = points_of(omega[omega < np.pi / system.dt] if system.dt else omega, system.dt)
    given = response_at((*scaled_states(system.A, system.B, system.C), system.D), points)
    found = response_at(StateMatrices.of(result), points)
    size = np.linalg.norm(given, axis=(1, 2))
    ratio = np.linalg.norm(found - given, axis=(1, 2)) / np.where(size > 0, size, 1.0)
    return float(np.max(ratio, initial=0.0))


class Pair(NamedTuple):
    """A block of two poles."""

    centre: float
    coupling: float
    fall: float
    inputs: Real  # (2, nu)


def poles_in_pairs(A: Real, B: Real, origin: float) -> tuple[list[Pair], Real, Real]:
    """Blocks of two poles; poles without a partner and their inputs. Two real neighbours make a block."""
    pairs: list[Pair] = []
    alone: list[tuple[float, Real]] = []
    if not len(A):
        return pairs, np.zeros(0), np.zeros((0, B.shape[1]))
    parts, rigid, _ = modal_parts(A, origin)
    for number, part in enumerate(parts):
        block, inputs = part.block, np.asarray(part.left @ B, dtype=float)
        if number == 0 and rigid:
            count = int(np.sum(block[np.triu_indices(rigid, 1)] != 0))  # chains of two integrators
            pairs += [Pair(origin, 1.0, 0.0, inputs[[k, count + k]]) for k in range(count)]
            alone += [(origin, row) for row in inputs[2 * count :]]
        elif len(block) == 1:
            alone.append((float(block[0, 0]), inputs[0]))
        elif len(block) == 2 and np.any(block != block[0, 0] * np.eye(2)):
            pairs.append(_cyclic(block, inputs))
        else:
            poles, V = np.linalg.eig(block)
            rows = np.linalg.solve(V.astype(complex), inputs.astype(complex))
            pairs += [
                Pair(pole.real, pole.imag, pole.imag, np.stack([2 * row.real, -2 * row.imag]))
                for pole, row in zip(poles, rows, strict=True)
                if pole.imag > 0
            ]
            alone += [(pole.real, row.real) for pole, row in zip(poles, rows, strict=True) if pole.imag == 0]
    alone.sort(key=lambda item: item[0])
    even = len(alone) // 2 * 2
    single = alone[even:]
    for (low, first), (high, second) in zip(alone[:even:2], alone[1:even:2], strict=True):
        if low == high:  # two modes of one pole: no block of two coordinates holds them
            single += [(low, first), (high, second)]
        else:
            pairs.append(_cyclic(np.diag([low, high]), np.stack([first, second])))
    return pairs, np.array([pole for pole, _ in single]), np.array([row for _, row in single]).reshape(-1, B.shape[1])


def _cyclic(block: Real, inputs: Real) -> Pair:
    """Two poles as ``[[a, s], [-v, a]]``, in the basis (N t/s, t) of N = block - a I for a vector t that N turns most."""
    a = float(np.trace(block)) / 2
    N = block - a * np.eye(2)
    s = math.sqrt(abs(float(np.linalg.det(N)))) or float(np.linalg.norm(N))
    turned = np.array([N[1], -N[0]])  # t' turned t = det [t, N t]
    values, vectors = np.linalg.eigh(turned + turned.T)
    t = vectors[:, np.argmax(np.abs(values))]
    basis = np.stack([N @ t / s, t], axis=1)
    return Pair(a, s, float(np.linalg.det(N)) / s, np.asarray(np.linalg.solve(basis, inputs), dtype=np.float64))
