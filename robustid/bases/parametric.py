"""Parametric bases: known functions whose linear combination is the parametric part of a model."""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.linalg

from robustid.bases.input_normal import solve_stein
from robustid.core import Frozen, StateMatrices, as_array, as_count, as_positive, freeze, input_states
from robustid.errors import InputError, InputTypeError

# Eigenvalue routines split a double pole at z = 1 by about sqrt(eps).
_INTEGRATOR_RADIUS = 1e-7


@dataclasses.dataclass(frozen=True, eq=False)
class ParametricBasis(Frozen):
    """m known functions P_i(z), the outputs of one state-space system with one input.

    ``P(z) = C (zI - A)^{-1} B + D`` has m rows; the parametric part of a model is ``p' P(z)`` with real p.

    Parameters
    ----------
    A, B, C, D : (n, n), (n, 1), (m, n), (m, 1) arrays
    dt : float
        Sample time in s.
    labels : tuple of str
        One name per function.
    poles : (n,) complex array, optional
        Poles in the z-plane, where they are known: the eigenvalues of a repeated pole split by rounding. Default: the
        eigenvalues of A.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    dt: float
    labels: tuple[str, ...]
    poles: Any = None

    def __post_init__(self) -> None:
        self._set(**{name: freeze(getattr(self, name)) for name in "ABCD"})
        computed = np.linalg.eigvals(self.A) if self.states and self.poles is None else self.poles
        self._set(poles=freeze(np.zeros(0, complex) if computed is None else np.asarray(computed, complex)))

    @property
    def size(self) -> int:
        """Number m of functions."""
        return self.C.shape[0]

    @property
    def states(self) -> int:
        """Number of states that the functions share."""
        return self.A.shape[0]

    @property
    def has_integrator(self) -> bool:
        """True if a pole sits at z = 1."""
        return bool(np.any(np.abs(self.poles - 1) <= _INTEGRATOR_RADIUS))

    def response(self, angles: np.ndarray) -> np.ndarray:
        """P(exp(j*angle)), shape (len(angles), m)."""
        z = np.exp(1j * np.asarray(angles))
        if not self.states:
            return np.broadcast_to(self.D[:, 0].astype(complex), (z.size, self.size))
        return (self.C @ input_states(self.A, self.B, z) + self.D)[..., 0]

    def impulse(self, count: int) -> np.ndarray:
        """Impulse responses, shape (count, m)."""
        out = np.zeros((count, self.size))
        if count:
            out[0] = self.D[:, 0]
        state = self.B
        for k in range(1, count):
            out[k] = (self.C @ state)[:, 0]
            state = self.A @ state
        return out

    def transients(self, count: int) -> np.ndarray:
        """Orthonormal columns that span every free response of the functions over `count` samples."""
        rows = np.zeros((count, self.size, self.states))
        power = np.eye(self.states)
        for k in range(count):
            rows[k] = self.C @ power
            power = self.A @ power
        columns = rows.reshape(count, -1)
        if columns.size == 0:
            return np.zeros((count, 0))
        scale = np.linalg.norm(columns, axis=0)
        left, singular, _ = np.linalg.svd(columns[:, scale > 0] / scale[scale > 0], full_matrices=False)
        return left[:, singular > 1e-10 * singular.max(initial=0.0)]


def kautz(omega: Any, damping: Any, *, dt: float, repeat: int = 1, delay: int = 0) -> ParametricBasis:
    """Kautz pairs: the impulse responses Re a^k and Im a^k of lightly damped modes, unit H2 norm each.

    ``a = exp((-damping + j sqrt(1 - damping^2)) omega dt)``; `repeat` adds the terms with k a^k, k^2 a^k ..., which
    absorb errors of the assumed pole to that order.

    Parameters
    ----------
    omega : float or (M,) array, rad/s
        Natural frequencies, 0 < omega sqrt(1 - damping^2) < pi/dt.
    damping : float or (M,) array
        Damping ratios, 0 < damping <= 1; 1 stands for one real pole exp(-omega dt), as in `mode_table`.
    dt : float, s
        Sample time.
    repeat : int
        Multiplicity of each pole.
    delay : int, samples
        0: the pair starts at k = 0 (feed-through). 1: it starts at k = 1, as a zero-order-hold mode without
        feed-through does; such a mode is not in the span of the undelayed pair.

    Returns
    -------
    ParametricBasis
        2 * repeat functions per mode; `repeat` for a real pole.

    Notes
    -----
    Source: `inanc2001`, equation (29), as the real span of the pole pair.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> pair = rid.kautz(2 * np.pi * 17.67, 0.004, dt=0.01, delay=1)
    >>> pair.size, pair.states
    (2, 2)
    """
    dt = as_positive("dt", dt)
    omega = np.atleast_1d(as_array("omega", omega))
    damping = np.atleast_1d(as_array("damping", damping))
    repeat, delay = as_count("repeat", repeat, least=1), as_count("delay", delay)
    if omega.ndim != 1 or damping.ndim != 1:
        raise InputError(f"`omega` and `damping` must be scalars or 1-D; got {omega.shape} and {damping.shape}")
    if damping.size == 1:
        damping = np.repeat(damping, omega.size)
    if omega.size != damping.size:
        raise InputError(f"`omega` and `damping` must have the same length; got {omega.size} and {damping.size}")
    if np.any((damping <= 0) | (damping > 1)):
        raise InputError(
            "`damping` must lie between 0 and 1 (1 for a real pole; integrators are `rid.integrators`);"
            f" got {damping[(damping <= 0) | (damping > 1)][0]:g}"
        )
    turn = omega * dt * np.sqrt(1 - damping**2)
    if np.any((omega <= 0) | (turn >= np.pi)):
        bad = omega[(omega <= 0) | (turn >= np.pi)][0]
        raise InputError(f"`omega` must lie between 0 and pi/dt = {np.pi / dt:g} rad/s; got {bad:g} rad/s")
    parts = [_mode(w, z, dt, repeat, delay) for w, z in zip(omega, damping, strict=True)]
    return stack_bases(parts)


def integrators(count: int = 1, *, dt: float) -> ParametricBasis:
    """Integrators: the functions 1/(z - 1) and, with `count` 2, 1/(z - 1)^2.

    Parameters
    ----------
    count : int
        1 for an integrator (from torque to speed), 2 for a rigid body (from torque to angle).
    dt : float, s
        Sample time.

    Returns
    -------
    ParametricBasis
        `count` functions.

    Notes
    -----
    A rigid body behind a zero-order hold, (z + 1)/(z - 1)^2, is in their span.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> rid.integrators(2, dt=0.1).response([np.pi]).real
    array([[-0.5 ,  0.25]])
    """
    dt, count = as_positive("dt", dt), as_count("count", count, least=1)
    labels = ("integrator", "double integrator", *(f"integrator of order {k}" for k in range(3, count + 1)))
    A, B = np.eye(count) + np.eye(count, k=-1), np.eye(count, 1)
    return ParametricBasis(A, B, np.eye(count), np.zeros((count, 1)), dt, labels[:count], np.ones(count, complex))


def _mode(omega: float, damping: float, dt: float, repeat: int, delay: int) -> ParametricBasis:
    a = complex(np.exp((-damping + 1j * np.sqrt(1 - damping**2)) * (omega * dt)))
    real = damping == 1
    R = np.array([[a.real]]) if real else np.array([[a.real, -a.imag], [a.imag, a.real]])
    # Chain of binomials: x_j(k) = binom(k, j) a^k obeys x_j(k+1) = a (x_j(k) + x_{j-1}(k)).
    A = np.kron(np.eye(repeat) + np.eye(repeat, k=-1), R)
    states = A.shape[0]
    B = np.zeros((states, 1))
    B[0] = 1.0
    C, D = np.eye(states), np.zeros((states, 1))
    if delay == 0:
        C, D = A.copy(), B.copy()
    gramian = solve_stein(A, A.T, B @ B.T)
    norms = np.sqrt(np.maximum(np.diag(C @ gramian @ C.T) + D[:, 0] ** 2, 0))
    C, D = C / norms[:, None], D / norms[:, None]
    for _ in range(delay - 1):  # one more pure delay at the input
        n = A.shape[0]
        A = np.block([[A, B], [np.zeros((1, n + 1))]])
        B = np.eye(n + 1)[:, -1:]
        C = np.hstack([C, np.zeros((C.shape[0], 1))])
    hz = f"{omega / (2 * np.pi):.4g} Hz"
    parts = ("real pole",) if real else ("Re", "Im")
    labels = [f"{part} {hz}" + (f" (k^{j})" if j else "") for j in range(repeat) for part in parts]
    own = [a.real] if real else [a, a.conjugate()]
    poles = np.concatenate([np.repeat(own, repeat), np.zeros(A.shape[0] - states)])
    return ParametricBasis(A, B, C, D, dt, tuple(labels), poles)


def as_basis(value: Any, dt: float) -> ParametricBasis:
    """A `ParametricBasis` from bases, `control.StateSpace` systems (one input, m outputs), or a sequence of them.

    Poles must lie inside the unit circle or at z = 1 (integrators).
    """
    if isinstance(value, Sequence) and not isinstance(value, str):
        if not value:
            raise InputError("`parametric` is an empty sequence; leave it out instead")
        items: list[Any] = list(value)  # type: ignore[reportUnknownArgumentType]
        return stack_bases([as_basis(item, dt) for item in items])
    basis = value if isinstance(value, ParametricBasis) else _from_statespace(value, dt)
    if abs(basis.dt - dt) > 1e-9 * dt:
        raise InputError(
            f"`parametric` has dt = {basis.dt:g} s, the data have dt = {dt:g} s; build the basis with the same"
        )
    poles = basis.poles
    bad = poles[(np.abs(poles) >= 1) & (np.abs(poles - 1) > _INTEGRATOR_RADIUS)]
    if bad.size:
        raise InputError(
            f"`parametric` must have its poles inside the unit circle or at z = 1; got |z| = {np.abs(bad).max():.6g}"
        )
    return basis


def _from_statespace(value: Any, dt: float) -> ParametricBasis:
    import control

    if isinstance(value, control.TransferFunction):
        value = control.ss(value)
    if not isinstance(value, control.StateSpace):
        raise InputTypeError(
            "`parametric` must be a basis from `kautz`, a control.StateSpace, or a sequence of them;"
            f" got {type(value).__name__}"
        )
    if value.ninputs != 1:
        raise InputError(f"`parametric` systems must have one input (each output is one function); got {value.ninputs}")
    if value.dt == 0:
        raise InputError("`parametric` must be discrete-time with the dt of the data; got a continuous-time system")
    known = value.dt is not None and value.dt is not True
    labels = tuple(f"{value.name}:{label}" for label in value.output_labels)
    step = float(value.dt) if known else dt  # type: ignore[reportArgumentType]
    return ParametricBasis(*StateMatrices.of(value), step, labels)


def stack_bases(parts: Sequence[ParametricBasis]) -> ParametricBasis:
    """All functions of several bases, side by side."""
    if len(parts) == 1:
        return parts[0]
    if len({p.dt for p in parts}) > 1:
        raise InputError(f"`parametric` mixes sample times {sorted({p.dt for p in parts})}; use one dt")
    A, C = (np.asarray(scipy.linalg.block_diag(*(getattr(p, name) for p in parts))) for name in "AC")
    B, D = (np.vstack([getattr(p, name) for p in parts]) for name in "BD")
    labels = tuple(label for p in parts for label in p.labels)
    return ParametricBasis(A, B, C, D, parts[0].dt, labels, np.concatenate([p.poles for p in parts]))
