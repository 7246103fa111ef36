"""H-infinity norm of a stable system and true error of a smaller model: level sets by a Hamiltonian matrix."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy.linalg

from robustid.core import Complex, Numbers, Response, StateMatrices, bilinear_in_s, counted, input_states, threads_for
from robustid.errors import InputError
from robustid.identification import check_model
from robustid.reduction.gramians import split
from robustid.reduction.largest_gain import LargestGain, modes_of, turned

if TYPE_CHECKING:
    import control


class PeakError(NamedTuple):
    """Largest singular value of a response, and where on the frequency axis [rad/s] it is reached (inf included)."""

    value: float
    omega: float


def hinf_error(model: control.StateSpace, reduced: control.StateSpace) -> PeakError:
    r"""Find the largest error over all frequencies.

    .. math:: \max_\omega \bar\sigma(G(j\omega) - G_r(j\omega)), \quad\text{in discrete time of } e^{j\omega T}

    Parameters
    ----------
    model, reduced : control.StateSpace
        Same signals, same time base. Unstable parts, integrators included, must be the same in both, as
        ``balanced_truncation(unstable="keep")`` leaves them: only the stable parts are compared.

    Returns
    -------
    PeakError
        ``value``, reached at ``omega`` in rad/s (per sample where dt is True), is at most 1e-9 below the norm; inf
        where the unstable parts have different numbers of poles.

    Raises
    ------
    InputError, InputTypeError
        If one isn't a finite StateSpace with known time base, or they don't match.

    Notes
    -----
    As `hinf_norm`; seconds for 500 states.

    Examples
    --------
    >>> import control, robustid as rid
    >>> from robustid.reduction import hinf_error
    >>> model = control.ss([[-1.0, 0.0], [0.0, -100.0]], [[1.0], [1.0]], [[1.0, 1.0]], 0.0)
    >>> small = rid.balanced_truncation(model, order=1)
    >>> error = hinf_error(model, small.model)
    >>> round(error.value / small.bound, 5)  # here the bound is attained
    1.0
    """
    first, second = check_model("model", model), check_model("reduced", reduced)
    if (first.noutputs, first.ninputs) != (second.noutputs, second.ninputs):
        raise InputError(
            f"`reduced` must have the {counted(first.noutputs, 'output')} and {counted(first.ninputs, 'input')} of"
            f" `model`; got {second.noutputs}"
            f" and {second.ninputs}"
        )
    if first.nstates and second.nstates and first.dt != second.dt:
        raise InputError(f"`reduced` must have the time base of `model`, dt = {first.dt}; got dt = {second.dt}")
    dt = first.dt if first.nstates else second.dt
    with threads_for(first.nstates + second.nstates):
        (a, kept), (b, held) = split(first, "keep"), split(second, "keep")
        if kept.a.shape != held.a.shape:
            return PeakError(np.inf, np.nan)
        states, inputs = scipy.linalg.block_diag(a.a, b.a), np.vstack([a.b, b.b])
        return hinf_norm(StateMatrices(states, inputs, np.hstack([a.c, -b.c]), first.D - second.D), dt)


def hinf_norm(system: StateMatrices, dt: float | None) -> PeakError:
    """H-infinity norm of a stable system, at most 1e-9 below it, and where it is reached; dt = 0 or None in continuous time.

    Resonances first, refined between their neighbours; then the level just above is tested: it is crossed where a Hamiltonian
    matrix of twice as many states has eigenvalues on the axis (`bruinsma1990`). Discrete systems go through the bilinear
    transformation, which keeps the norm.
    """
    with threads_for(len(system.A)):
        value, angle = _OfSystem(system, discrete=bool(dt)).search()
    return PeakError(value, angle / float(dt) if dt else angle)


class _OfSystem(LargestGain):
    """The H-infinity norm of a stable system."""

    def __init__(self, system: StateMatrices, *, discrete: bool):
        self.system = system
        self.continuous = bilinear_in_s(system, 2.0) if discrete else system
        super().__init__(modes_of(system), self.continuous.D, discrete=discrete)

    def factorised(self) -> Response:
        """The response by its Schur form."""
        return Response(self.system)

    def exact(self, point: Complex) -> float:
        """The largest singular value at a point by one factorisation."""
        A, B, C, D = self.system
        return float(np.linalg.norm(D + C @ input_states(A, B, point)[0], 2))

    def level_matrix(self, level: float, pivot: float | None) -> Numbers:
        """The Hamiltonian matrix of a level, of twice as many states."""
        a, b, c, d = turned(self.continuous, pivot)
        b, c, d = b / np.sqrt(level), c / np.sqrt(level), d / level
        left = np.linalg.inv(np.eye(d.shape[1]) - d.conj().T @ d)
        a = a + b @ left @ d.conj().T @ c
        right = np.eye(d.shape[0]) + d @ left @ d.conj().T
        above, below = b @ left @ b.conj().T, -c.conj().T @ right @ c
        return np.block([[a, above], [below, -a.conj().T]])
