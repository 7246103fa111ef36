"""The true error of a smaller model: the H-infinity norm of the difference, level sets by a Hamiltonian matrix."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy.linalg
import scipy.optimize
from numpy.typing import ArrayLike

from robustid.core import Complex, Real, Response, threads_for
from robustid.errors import InputError
from robustid.identification import check_model
from robustid.reduction.gramians import Parts, split

if TYPE_CHECKING:
    import control


_RTOL = 1e-6
_ROUNDS = 30
# An eigenvalue this near the axis, relative to the largest, may be on it. What is on it by mistake costs one more frequency.
_NEAR = 1e-9
_REFINED = 4


class PeakError(NamedTuple):
    """Largest singular value of a difference, and where on the frequency axis [rad/s] it is reached (inf included)."""

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
        ``value``, reached at ``omega`` in rad/s (per sample where dt is True), is at most 1e-6 below the norm; inf
        where the unstable parts have different numbers of poles.

    Raises
    ------
    InputError, InputTypeError
        If one isn't a finite StateSpace with known time base, or they don't match.

    Notes
    -----
    Resonances first, refined between their neighbours; then the level just above is tested: it is crossed where a
    Hamiltonian matrix of twice as many states as both models have together has eigenvalues on the axis (`bruinsma1990`).
    That takes seconds for 500 states. Discrete models go through the bilinear transformation, which keeps the norm.

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
            f"`reduced` must have the {first.noutputs} outputs and {first.ninputs} inputs of `model`; got {second.noutputs}"
            f" and {second.ninputs}"
        )
    if first.nstates and second.nstates and first.dt != second.dt:
        raise InputError(f"`reduced` must have the time base of `model`, dt = {first.dt}; got dt = {second.dt}")
    dt = first.dt if first.nstates else second.dt
    with threads_for(first.nstates + second.nstates):
        (a, kept), (b, held) = split(first, "keep"), split(second, "keep")
        if kept.a.shape != held.a.shape:
            return PeakError(np.inf, np.nan)
        difference = Parts(scipy.linalg.block_diag(a.a, b.a), np.vstack([a.b, b.b]), np.hstack([a.c, -b.c]))
        value, angle = _Peak(difference, first.D - second.D, discrete=bool(dt)).search()
    return PeakError(value, angle / float(dt) if dt else angle)


class _Peak:
    """Largest singular value of a stable response: lower bound by evaluation, proof of the level by eigenvalues."""

    def __init__(self, parts: Parts, feedthrough: Real, *, discrete: bool):
        self.discrete, self.d = discrete, feedthrough
        self.response = Response((parts.a, parts.b, parts.c, feedthrough))
        self.continuous = _bilinear(parts, feedthrough) if discrete else (*parts, feedthrough)
        self.value, self.omega = 0.0, np.inf

    def search(self) -> tuple[float, float]:
        poles = self.response.poles
        peaks = np.abs(np.angle(poles)) if self.discrete else np.abs(poles)
        # Resonances lie near |pole| or at its imaginary part; what is left of the axis between them.
        marks = np.unique(
            np.concatenate([[0.0], peaks, np.abs(np.imag(poles))] if not self.discrete else [[0.0, np.pi], peaks])
        )
        marks = np.unique(np.concatenate([marks, (marks[:-1] + marks[1:]) / 2]))
        values = self._look(marks)
        self._look([np.pi if self.discrete else np.inf])
        for k in np.argsort(values)[::-1][:_REFINED]:
            self._refine(marks[max(0, k - 1)], marks[min(marks.size - 1, k + 1)])
        for _ in range(_ROUNDS):
            crossings = self._crossings(self.value * (1 + _RTOL))
            before = self.value
            self._look(np.concatenate([crossings, (crossings[:-1] + crossings[1:]) / 2]))
            if self.value <= before * (1 + _RTOL):
                break
            self._refine(*self._around(crossings))
        return self.value, self.omega

    def _look(self, frequencies: ArrayLike) -> Real:
        """Largest singular values at the frequencies; the largest of all is kept."""
        omega = np.asarray(frequencies, dtype=float)
        found = self._at(omega)
        if found.size and np.max(found) > self.value:
            self.value, self.omega = float(np.max(found)), float(omega[np.argmax(found)])
        return found

    def _at(self, omega: Real) -> Real:
        values = np.repeat(self.d[None].astype(complex), omega.size, axis=0)
        near = np.isfinite(omega)
        values[near] = self.response.at(np.exp(1j * omega[near]) if self.discrete else 1j * omega[near])
        return np.linalg.norm(values, 2, axis=(1, 2))

    def _refine(self, low: float, high: float) -> None:
        if high > low:

            def lowered(omega: float) -> float:
                return -self._at(np.array([omega]))[0]

            options = {"xatol": 1e-9 * high}
            peak = scipy.optimize.minimize_scalar(lowered, bounds=(low, high), method="bounded", options=options)
            self._look([peak.x])

    def _around(self, crossings: Real) -> tuple[float, float]:
        k = np.searchsorted(crossings, self.omega)
        return crossings[max(0, k - 1)], crossings[min(crossings.size - 1, k + 1)]

    def _crossings(self, level: float) -> Real:
        """Frequencies where a singular value may be `level`, none of them missing; ascending."""
        if level == 0 or not self.response.poles.size:
            return np.zeros(0)
        a, b, c, d = self.continuous
        b, c, d = b / np.sqrt(level), c / np.sqrt(level), d / level
        left = np.linalg.inv(np.eye(d.shape[1]) - d.T @ d)
        a = a + b @ left @ d.T @ c
        right = np.eye(d.shape[0]) + d @ left @ d.T
        values: Complex = scipy.linalg.eigvals(np.block([[a, b @ left @ b.T], [-c.T @ right @ c, -a.T]]))
        near = np.abs(np.real(values)) <= _NEAR * np.max(np.abs(values))
        omega = np.unique(np.abs(np.imag(values[near])))
        return 2 * np.arctan(omega) if self.discrete else omega


def _bilinear(parts: Parts, d: Real) -> tuple[Real, Real, Real, Real]:
    """The continuous system with z = (1 + s)/(1 - s): the response at exp(j angle) is that at j tan(angle/2)."""
    eye = np.eye(parts.a.shape[0])
    solved = np.asarray(np.linalg.solve(parts.a + eye, np.hstack([parts.a - eye, parts.b])), dtype=float)
    a, b = np.hsplit(solved, [eye.shape[0]])
    c = np.linalg.solve((parts.a + eye).T, parts.c.T).T
    return a, np.sqrt(2) * b, np.sqrt(2) * c, d - parts.c @ b
