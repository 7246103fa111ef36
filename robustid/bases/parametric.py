"""Parametric bases: known functions whose linear combination is the parametric part of a model."""

# pyright: reportConstantRedefinition=false
# Matrices have capital letters.
from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence
from typing import Any, cast

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from robustid.bases.function import Function, FunctionKind
from robustid.bases.input_normal import solve_stein
from robustid.core import (
    Frozen,
    Plane,
    SPlane,
    StateMatrices,
    ZPlane,
    as_array,
    as_count,
    as_positive,
    as_state_space,
    freeze,
    hz_words,
    input_states,
    time_words,
)
from robustid.errors import InputError, InputTypeError

# Eigenvalue routines split a double pole at z = 1 by about sqrt(eps).
_INTEGRATOR_RADIUS = 1e-7
_MODES = 4096  # that are kept: cells of a pole-uncertainty box have most of theirs in common


@dataclasses.dataclass(frozen=True, eq=False)
class ParametricBasis(Frozen):
    """m known functions P_i(z) or P_i(s), the outputs of one state-space system with one input.

    ``P(z) = C (zI - A)^{-1} B + D`` has m rows; the parametric part of a model is ``p' P(z)`` with real p.

    Parameters
    ----------
    A, B, C, D : (n, n), (n, 1), (m, n), (m, 1) arrays
    dt : float
        Sample time in s; 0 for functions of s.
    functions : tuple of Function or str
        Label and kind of every function; labels alone will do.
    poles : (n,) complex array, optional
        Eigenvalues of A where they are known: those of a repeated pole split by rounding. Default: as they are computed.
    corner : float, rad/s, optional
        Of functions of s that are written in the variable z = (corner + s)/(corner - s), as a problem holds them.
    original : ParametricBasis, optional
        Those functions as they are written in s.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    dt: float
    functions: tuple[Any, ...]
    poles: Any = None
    corner: float | None = None
    original: ParametricBasis | None = None

    def __post_init__(self) -> None:
        self._set(**{name: freeze(getattr(self, name)) for name in "ABCD"})
        self._set(functions=tuple(Function.of(function) for function in self.functions))
        computed = np.linalg.eigvals(self.A) if self.states and self.poles is None else self.poles
        self._set(poles=freeze(np.zeros(0, complex) if computed is None else np.asarray(computed, complex)))

    @property
    def size(self) -> int:
        """Number m of functions."""
        return self.C.shape[0]

    @property
    def labels(self) -> tuple[str, ...]:
        """One label per function."""
        return tuple(function.label for function in self.functions)

    @property
    def states(self) -> int:
        """Number of states that the functions share."""
        return self.A.shape[0]

    @property
    def matrices(self) -> StateMatrices:
        """A, B, C, D."""
        return StateMatrices(self.A, self.B, self.C, self.D)

    @property
    def plane(self) -> Plane | None:
        """The plane whose points are on the circle of z; None for functions written in s."""
        if self.corner is not None:
            return SPlane(self.corner)
        return ZPlane(self.dt) if self.dt else None

    @property
    def has_integrator(self) -> bool:
        """True if a pole sits at z = 1, or s = 0."""
        return bool(np.any(np.abs(self.poles - (self.plane is not None)) <= _INTEGRATOR_RADIUS))

    def on(self, plane: Plane) -> ParametricBasis:
        """The same functions as ones of the variable z of a plane of the same kind."""
        if not isinstance(plane, SPlane) or self.corner == plane.corner:
            return self
        own = self.in_s()
        poles = (plane.corner + own.poles) / (plane.corner - own.poles)
        return ParametricBasis(*plane.in_z(own.matrices), 0.0, own.functions, poles, plane.corner, own)

    def in_s(self) -> ParametricBasis:
        """Functions of s that are written in z, written in s; others as they are."""
        return self if self.original is None else self.original

    def response(self, angles: np.ndarray) -> np.ndarray:
        """P(exp(j*angle)), shape (len(angles), m), of functions that are written in z."""
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


def kautz(omega: ArrayLike, damping: ArrayLike, *, dt: float, repeat: int = 1, delay: int = 0) -> ParametricBasis:
    """Kautz pairs: the impulse responses Re a^k and Im a^k of lightly damped modes, unit H2 norm each.

    ``a = exp((-damping + j sqrt(1 - damping^2)) omega dt)``; `repeat` adds the terms with k a^k, k^2 a^k ..., which
    absorb errors of the assumed pole to that order. In continuous time (dt = 0) Re exp(s t) and Im exp(s t),
    ``s = (-damping + j sqrt(1 - damping^2)) omega``, and t, t^2 ... times them.

    Parameters
    ----------
    omega : float or (M,) array, rad/s
        Natural frequencies, 0 < omega sqrt(1 - damping^2) < pi/dt.
    damping : float or (M,) array
        Damping ratios, 0 < damping <= 1; 1 stands for one real pole exp(-omega dt), as in `mode_table`.
    dt : float, s
        Sample time; 0 for continuous time.
    repeat : int
        Multiplicity of each pole.
    delay : int, samples
        In discrete time. 0: the pair starts at k = 0 (feed-through). 1: it starts at k = 1, as a zero-order-hold mode without
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
    dt = _as_time(dt)
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
    if not dt:
        return _continuous_kautz(omega, damping, repeat, delay)
    turn = omega * dt * np.sqrt(1 - damping**2)
    if np.any((omega <= 0) | (turn >= np.pi)):
        bad = omega[(omega <= 0) | (turn >= np.pi)][0]
        raise InputError(f"`omega` must lie between 0 and pi/dt = {np.pi / dt:g} rad/s; got {bad:g} rad/s")
    parts = [_mode(w, z, dt, repeat, delay) for w, z in zip(omega, damping, strict=True)]
    return stack_bases(parts)


def integrators(count: int = 1, *, dt: float) -> ParametricBasis:
    """Integrators: the functions 1/(z - 1) and, with `count` 2, 1/(z - 1)^2; 1/s and 1/s^2 in continuous time.

    Parameters
    ----------
    count : int
        1 for an integrator (from torque to speed), 2 for a rigid body (from torque to angle).
    dt : float, s
        Sample time; 0 for continuous time.

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
    dt, count = _as_time(dt), as_count("count", count, least=1)
    labels = ("integrator", "double integrator", *(f"integrator of order {k}" for k in range(3, count + 1)))
    A, B = (np.eye(count) if dt else 0.0) + np.eye(count, k=-1), np.eye(count, 1)
    functions = tuple(Function(label, FunctionKind.INTEGRATOR) for label in labels[:count])
    poles = np.full(count, bool(dt), complex)
    return ParametricBasis(A, B, np.eye(count), np.zeros((count, 1)), dt, functions, poles)


def _as_time(dt: float | None) -> float:
    """A sample time in s; 0 for continuous time, which None stands for too."""
    return 0.0 if dt is None or np.array_equal(dt, 0) else as_positive("dt", dt)


@functools.lru_cache(maxsize=_MODES)
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
    functions = _mode_functions(omega, real, repeat, "k")
    own = [a.real] if real else [a, a.conjugate()]
    poles = np.concatenate([np.repeat(own, repeat), np.zeros(A.shape[0] - states)])
    return ParametricBasis(A, B, C, D, dt, functions, poles)


def _mode_functions(omega: float, real: bool, repeat: int, variable: str) -> tuple[Function, ...]:
    hz, found = hz_words(omega / (2 * np.pi), 4), list[Function]()
    for j in range(repeat):
        power = f" ({variable}^{j})" if j else ""
        if real:
            found.append(Function(f"real pole {hz}{power}", FunctionKind.MODE))
            continue
        place = f"mode at {hz}" + (f", times {variable}" if j == 1 else power)
        for short, part in (("Re", "real part"), ("Im", "imaginary part")):
            found.append(Function(f"{short} {hz}{power}", FunctionKind.MODE, f"{place}, {part}"))
    return tuple(found)


def _continuous_kautz(omega: np.ndarray, damping: np.ndarray, repeat: int, delay: int) -> ParametricBasis:
    """The pairs in s, ordered as those in z."""
    if delay:
        raise InputError(f"`delay` is a number of samples, and there are none in continuous time (dt = 0); got {delay}")
    if np.any(omega <= 0):
        raise InputError(f"`omega` must be positive; got {omega.min():g} rad/s")
    return stack_bases([_continuous_mode(w, z, repeat) for w, z in zip(omega, damping, strict=True)])


@functools.lru_cache(maxsize=_MODES)
def _continuous_mode(omega: float, damping: float, repeat: int) -> ParametricBasis:
    s = complex(-damping, np.sqrt(1 - damping**2)) * omega
    real = damping == 1
    R = np.array([[s.real]]) if real else np.array([[s.real, -s.imag], [s.imag, s.real]])
    # x_j(t) = t^j/j! exp(s t) obeys x_j' = s x_j + x_(j-1); in units of 1/omega.
    A = np.kron(np.eye(repeat), R) + omega * np.kron(np.eye(repeat, k=-1), np.eye(R.shape[0]))
    B = np.eye(A.shape[0], 1)
    norms = np.sqrt(np.diag(scipy.linalg.solve_continuous_lyapunov(A, -B @ B.T)))
    own = [s.real] if real else [s, s.conjugate()]
    functions = _mode_functions(omega, real, repeat, "t")
    return ParametricBasis(A, B, np.diag(1 / norms), np.zeros_like(B), 0.0, functions, np.repeat(own, repeat))


def as_basis(value: object, plane: Plane) -> ParametricBasis:
    """A `ParametricBasis` from bases, `control.StateSpace` systems (one input, m outputs), or a sequence of them.

    Of functions of z on the circle of the plane. Poles must lie inside it or at z = 1 (integrators).
    """
    return _as_basis(value, plane.dt).on(plane)


def _as_basis(value: object, dt: float) -> ParametricBasis:
    if isinstance(value, Sequence) and not isinstance(value, str):
        if not value:
            raise InputError("`parametric` is an empty sequence; leave it out instead")
        return stack_bases([_as_basis(item, dt).in_s() for item in cast("Sequence[object]", value)])
    basis = value if isinstance(value, ParametricBasis) else _from_statespace(value, dt)
    if abs(basis.dt - dt) > 1e-9 * dt:
        raise InputError(
            f"`parametric` is of {time_words(basis.dt)}, the data are of {time_words(dt)}; build the basis with the same dt"
        )
    poles = basis.poles
    if basis.plane is None:
        bad = poles[(poles.real >= 0) & (np.abs(poles) > _INTEGRATOR_RADIUS)]
        if bad.size:
            raise InputError(
                f"`parametric` must have its poles in Re s < 0 or at s = 0; got one with real part {bad.real.max():.6g} rad/s"
            )
        return basis
    bad = poles[(np.abs(poles) >= 1) & (np.abs(poles - 1) > _INTEGRATOR_RADIUS)]
    if bad.size:
        raise InputError(
            f"`parametric` must have its poles inside the unit circle or at z = 1; got |z| = {np.abs(bad).max():.6g}"
        )
    return basis


def _from_statespace(value: Any, dt: float) -> ParametricBasis:
    import control

    value = as_state_space("parametric", value)
    if not isinstance(value, control.StateSpace):
        raise InputTypeError(
            "`parametric` must be a basis from `kautz`, a control.StateSpace, or a sequence of them;"
            f" got {type(value).__name__}"
        )
    if value.ninputs != 1:
        raise InputError(f"`parametric` systems must have one input (each output is one function); got {value.ninputs}")
    if value.dt == 0 and dt:
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
    functions = tuple(function for p in parts for function in p.functions)
    return ParametricBasis(A, B, C, D, parts[0].dt, functions, np.concatenate([p.poles for p in parts]))
