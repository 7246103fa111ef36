"""Inverse zero-order hold: the continuous model behind a sampled one."""

from __future__ import annotations

import dataclasses
import warnings
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg

from robustid.core import Frozen, Real, response_at, scaled_states, threads_for
from robustid.errors import InputError
from robustid.identification import check_model, describe_poles
from robustid.reduction.gramians import Parts, doubtful_distance

if TYPE_CHECKING:
    import control

_GRID = 400
_ON_CIRCLE = 1e-9
_USELESS = 1e-6  # a relative error above this is a failed logarithm, not rounding


@dataclasses.dataclass(frozen=True, eq=False)
class ContinuousModel(Frozen):
    """A continuous model, and how well its zero-order hold gives the discrete one back.

    Attributes
    ----------
    model : control.StateSpace
        Continuous, same order and signals.
    error : float
        Largest |zoh(model) - discrete model| over a grid up to the Nyquist frequency that includes every
        pole's frequency, relative to the largest |discrete model| there (largest singular values).
    """

    model: control.StateSpace
    _: dataclasses.KW_ONLY
    error: float


def to_continuous(model: control.StateSpace) -> ContinuousModel:
    r"""Find the continuous model whose response to a staircase input, sampled, is the given one.

    .. math:: A_c = \log(A)/T, \quad B_c = \Phi^{-1} B, \quad \Phi = \int_0^T e^{A_c t}\,dt

    the upper blocks of the logarithm of [[A, B], [0, I]], but linear in B: nothing depends on the unit of the
    input. Φ is invertible for every A with a principal logarithm, integrators included.

    Parameters
    ----------
    model : control.StateSpace
        Discrete, with its sample time.

    Returns
    -------
    ContinuousModel

    Raises
    ------
    InputError, InputTypeError
        If `model` is not discrete with a known dt, or has poles that can't be told from zero or from the
        negative real axis: no real continuous model of the same order has them. Likewise if poles near zero
        (a delay) leave no accurate logarithm, that is an `error` above 1e-6.

    Notes
    -----
    Assumes that no mode lies above the Nyquist frequency π/dt: the principal logarithm puts every pole below
    it (|Im s| < π/dt), and no data taken at dt can tell otherwise. Models identified from time data often
    have poles near zero (delays): reduce them first.

    References
    ----------
    Åström and Wittenmark 1997, section 2.3; Al-Mohy and Higham 2012 for the logarithm.

    Examples
    --------
    >>> import control, robustid as rid
    >>> sampled = control.sample_system(control.ss(-2.0, 3.0, 1.0, 0.0), 0.1)
    >>> continuous = rid.to_continuous(sampled)
    >>> continuous.model.A.round(12), continuous.error < 1e-14
    (array([[-2.]]), True)
    """
    system = check_model("model", model)
    if system.dt == 0 or system.dt is True or system.dt is None:
        raise InputError(f"`model` must be discrete with its sample time in s; got dt = {system.dt}")
    with threads_for(system.nstates):
        return _continuous(system)


def _continuous(system: control.StateSpace) -> ContinuousModel:
    parts = Parts(*scaled_states(system.A, system.B, system.C))
    poles, doubt = doubtful_distance(parts.a)
    distance = np.where(np.real(poles) > 0, np.abs(poles), np.abs(np.imag(poles)))
    if np.any(distance <= doubt):
        raise InputError(
            f"`model` has {describe_poles(poles[distance <= doubt], system.dt)}, at zero or on the negative"
            " real axis: no continuous model of this order has them. Reduce it first (balanced_truncation)"
        )
    dt, error = float(system.dt), np.inf
    log, drive = _inverse_hold(parts.a, parts.b)
    if np.all(np.isfinite(log)) and np.all(np.isfinite(drive)):
        error = _error(system, _like(system, scipy.linalg.expm(log), _hold(log) @ drive, parts.c, dt))
    if not error <= _USELESS:
        first = np.argsort(np.abs(poles))[:4]
        raise InputError(
            "`model` has poles too near zero for a logarithm in double precision"
            f" ({describe_poles(poles[first], dt)}; relative error {error:.2g})."
            " Reduce it first (balanced_truncation)"
        )
    return ContinuousModel(_like(system, log / dt, drive / dt, parts.c, 0.0), error=error)


def _inverse_hold(a: Real, b: Real) -> tuple[Real, Real]:
    """log(a), and the input matrix whose hold over one sample is b; not finite where that failed."""
    if a.size == 0:
        return a, b
    # logm warns by an estimate of its error and trips over its own overflow; the caller measures the error.
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore", RuntimeWarning)
        try:
            log = np.real(scipy.linalg.logm(a))
            return log, np.asarray(np.linalg.solve(_hold(log), b), dtype=float)
        except (ValueError, np.linalg.LinAlgError):
            return np.full(a.shape, np.nan), np.full(b.shape, np.nan)


def _hold(log: Real) -> Real:
    """Integral of exp(log t) over 0 <= t <= 1."""
    n = log.shape[0]
    return scipy.linalg.expm(np.block([[log, np.eye(n)], [np.zeros((n, 2 * n))]]))[:n, n:]


def _like(model: control.StateSpace, a: Real, b: Real, c: Real, dt: float) -> control.StateSpace:
    import control

    return control.StateSpace(a, b, c, model.D, dt, inputs=model.input_labels, outputs=model.output_labels)


def _error(model: control.StateSpace, back: control.StateSpace) -> float:
    """Largest difference over the grid, relative to the largest response; none on a pole of the circle."""
    poles = model.poles()
    damped = poles[np.abs(np.abs(poles) - 1) > _ON_CIRCLE]
    angle = np.concatenate([np.pi * np.logspace(-4, 0, _GRID), np.abs(np.angle(damped))])
    points = np.exp(1j * angle)
    undamped = poles[np.abs(np.abs(poles) - 1) <= _ON_CIRCLE]
    if undamped.size:
        points = points[np.min(np.abs(points[:, None] - undamped), axis=1) > 1e-6]
    given, returned = (response_at((*scaled_states(m.A, m.B, m.C), m.D), points) for m in (model, back))
    size = np.max(np.linalg.norm(given, 2, axis=(1, 2)), initial=0.0)
    return 0.0 if size == 0 else float(np.max(np.linalg.norm(returned - given, 2, axis=(1, 2))) / size)
