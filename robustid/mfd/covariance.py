"""Uncertainty of a fit: covariance of the coefficients, and standard deviations of poles and response."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import scipy.linalg

from robustid.core import Frozen, as_array, as_kind, as_positive, freeze, one_thread, points_of
from robustid.errors import InputError
from robustid.mfd.chains import nearest_poles
from robustid.mfd.criterion import Weight
from robustid.mfd.fit import MatrixFraction
from robustid.mfd.krylov_blocks import raised
from robustid.mfd.modal_covariance import ModalCovariance, modal_covariance
from robustid.mfd.vector_polynomials import VectorPolynomials

_LINES_AT_ONCE = 256
# A pole that moves by this part of the largest motion along directions which the data don't see isn't determined.
_FREE = 1e-6


@dataclasses.dataclass(frozen=True, eq=False)
class FitCovariance(Frozen):
    """First-order uncertainty of a fitted model.

    In polynomials that the data of the model make orthonormal the Jacobian of the weighted residual has orthonormal
    columns, so that the covariance of the coefficients is ``variance (I - R^T R)`` and no matrix is inverted. The rows
    of R are the directions that constraints forbid.

    Attributes
    ----------
    fit : MatrixFraction
    variance : float
        Of the real part, and of the imaginary part, of each weighted residual; 1/2 where the weight whitens the noise.
    parameters : int
        Number of free coefficients.
    poles : (n,) complex array
        In s (rad/s) or z; those of rigid-body modes, exact, last.
    pole_std : (n,) array
        ``sqrt(E|d pole|^2)``, unit of the poles; 0 for rigid-body poles, inf for poles that the data don't
        determine (they cancel).
    hz, hz_std : (n,) arrays
        Natural frequency |s|/2π and its standard deviation, Hz; s = log(z)/dt.
    damping, damping_std : (n,) arrays
        -Re(s)/|s| and its standard deviation; nan and 0 for rigid-body poles.
    basis : VectorPolynomials
        The orthonormal polynomials, without their values at the frequency points.
    forbidden : (m, parameters + m) array
        R; with modal structure also the directions that it forbids.
    modes : ModalCovariance or None
        Of the coordinates of a modal structure, for the deviations of mode shapes.
    """

    fit: MatrixFraction
    variance: float
    parameters: int
    poles: np.ndarray
    pole_std: np.ndarray
    hz: np.ndarray
    hz_std: np.ndarray
    damping: np.ndarray
    damping_std: np.ndarray
    basis: VectorPolynomials
    forbidden: np.ndarray
    modes: ModalCovariance | None = None

    def __post_init__(self) -> None:
        names = ("poles", "pole_std", "hz", "hz_std", "damping", "damping_std", "forbidden")
        self._set(**{name: freeze(getattr(self, name)) for name in names})

    def response_std(self, omega: Any = None) -> np.ndarray:
        """Standard deviation ``sqrt(E|dP|^2)`` of every entry of the response.

        Parameters
        ----------
        omega : (F,) array, optional
            rad/s; default the frequency points of the data.

        Returns
        -------
        (F, ny, nu) array
            In the unit of the response.
        """
        problem, model = self.fit.problem, self.fit.fraction
        if omega is None:
            xi, fraction = problem.xi, self.fit.nodes
            denominators, response = fraction.denominators, fraction.response
        else:
            omega = as_array("omega", omega, ndim=1)
            points = points_of(omega, model.dt)
            xi, response = points / model.scale, model.fitted(model.response(omega))
            denominators = model.denominator(points)
            if model.form != "right":
                denominators = denominators.transpose(0, 2, 1)
        std = np.empty(response.shape)
        for start in range(0, xi.size, _LINES_AT_ONCE):
            part = slice(start, start + _LINES_AT_ONCE)
            changes = response_changes(self.basis, xi[part], denominators[part], response[part])
            changes = _admissible(changes, self.basis, self.forbidden)
            std[part] = np.linalg.norm(changes, axis=-1).reshape(-1, *response.shape[:0:-1]).transpose(0, 2, 1)
        std *= np.sqrt(self.variance)
        return model.oriented(std)


@one_thread()
def fit_covariance(fit: MatrixFraction, *, noise: float | None = None) -> FitCovariance:
    r"""Standard deviations of poles and response of a fit, from the noise of the data.

    .. math:: \operatorname{Cov}(c) = v (I - R^T R), \qquad
        d\lambda = -\frac{w^H dD(\lambda) v_\lambda}{w^H D'(\lambda) v_\lambda}, \qquad dP = (dN - P\,dD) D^{-1}

    where c are the coordinates of (dD, dN) in the polynomials that the data of the model make orthonormal.

    Parameters
    ----------
    fit : MatrixFraction
        At an optimum; elsewhere the numbers have no meaning.
    noise : float, optional
        Variance E|e|^2 of the weighted noise per complex entry: 1 where the weight is the inverse standard deviation,
        as with the default weight of data with a covariance that counts as exact. None: estimated from what the fit leaves,
        ``v = cost / (real equations - free coefficients)``, which takes model errors for noise.

    Returns
    -------
    FitCovariance

    Raises
    ------
    InputError, InputTypeError
        `fit` isn't one, or has as many coefficients as equations and `noise` isn't given; `noise` isn't positive.

    Notes
    -----
    Assumes circular complex noise, independent between frequency points and, after the weight, between entries, small enough for
    first order. Weights made of the noisy data themselves (relative ones) count as known.

    The quotient needs neither D nor its derivative: with the eigenvectors of the realisation, ``A x = lambda x``,
    ``y^H A = lambda y^H``, and ``xi Pi = A Pi + B D``, it is ``w^H = y^H B``, ``Pi(lambda) v = x`` and
    ``w^H D'(lambda) v = y^H x``.

    Source: `voorhoeve2016` section IV (Jacobian), `pintelon2012` chapter 9 (covariance of the sample maximum
    likelihood estimate).

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> from robustid.mfd import Weight, fit_mfd
    >>> omega = np.linspace(1, 9, 60)
    >>> values = 1 / ((1j * omega) ** 2 + 0.2j * omega + 16)
    >>> weight = Weight(np.full((60, 1, 1), 1000.0))  # noise of 1e-3
    >>> found = fit_covariance(fit_mfd(rid.FrequencyResponse(omega, values), order=2, weight=weight), noise=1.0)
    >>> np.round(found.hz, 4), np.round(found.hz_std, 6)
    (array([0.6366, 0.6366]), array([1.2e-05, 1.2e-05]))
    """
    problem = as_kind("fit", fit, MatrixFraction, "a MatrixFraction from fit_mfd").problem
    basis = problem.basis(fit.nodes.denominators, fit.nodes.response)
    modes = modal_covariance(fit, basis) if fit.modal is not None else None
    forbidden = problem.forbidden(basis, fit.nodes) if modes is None else modes.forbidden
    parameters = basis.size - len(forbidden)
    spare = problem.equations - parameters
    if noise is not None:
        variance = as_positive("noise", noise) / 2
    elif spare > 0:
        variance = fit.cost / spare
    else:
        raise InputError(f"`fit` has {parameters} free coefficients and no more real equations; give `noise`")
    if modes is not None:
        modes = dataclasses.replace(modes, variance=variance)
    empty = basis.columns.shape[1:]
    basis = dataclasses.replace(basis, values=np.empty((0, basis.size)), columns=np.empty((0, *empty)))
    poles, changes = pole_changes(fit, basis)
    undetermined = np.linalg.norm(changes[:, basis.null], axis=1)
    undetermined = undetermined > _FREE * undetermined.max(initial=0.0)
    changes = _admissible(changes, basis, forbidden)
    count, origin = 2 * fit.fraction.rigid_count, 0.0 if problem.dt is None else 1.0
    fixed = nearest_poles(poles, origin, count) if count else np.zeros(poles.size, dtype=bool)
    changes[undetermined] = np.inf
    changes[fixed], poles[fixed] = 0.0, origin
    last = np.argsort(fixed, kind="stable")
    poles, changes = poles[last], changes[last]
    return FitCovariance(
        fit, variance, parameters, poles, *_deviations(poles, changes, variance, problem.dt), basis, forbidden, modes
    )


def pole_changes(fit: MatrixFraction, basis: VectorPolynomials) -> tuple[np.ndarray, np.ndarray]:
    """Poles (n,) in s or z, and their derivatives (n, coefficients) with respect to the coordinates in the basis."""
    model = fit.fraction
    ny = fit.problem.values.shape[1]
    poles, left, right = scipy.linalg.eig(model.A, left=True, right=True)  # type: ignore[misc]
    w = left.conj().T @ model.B / -np.sum(left.conj() * right, axis=0)[:, None]
    # Components that Pi lacks have v = 0, which the pseudo-inverse gives.
    v = (np.linalg.pinv(model.states(poles).transpose(0, 2, 1)) @ right.T[..., None])[..., 0]
    rows = v[:, :, None] * np.concatenate([w, np.zeros((poles.size, ny))], axis=1)[:, None, :]
    return model.scale * poles, model.scale * _carried(basis, poles, rows.reshape(poles.size, 1, -1))[:, 0]


def response_changes(basis: VectorPolynomials, xi: np.ndarray, D: np.ndarray, P: np.ndarray) -> np.ndarray:
    """Derivatives (m, nu*ny, coefficients) of vec of the response: ``(D^{-T} kron [-P I]) Phi``."""
    lines, ny, _ = P.shape
    left = np.concatenate([-P, np.broadcast_to(np.eye(ny), (lines, ny, ny))], axis=2)
    rows = Weight(np.ones(P.shape)).linearised(np.linalg.inv(D).transpose(0, 2, 1), left)
    return _carried(basis, xi, rows)


def _carried(basis: VectorPolynomials, xi: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """``rows Phi`` (m, r, n) at points xi (m,), by the recursion: what the rows (m, r, b) see of every polynomial.

    Rows first: D^{-1} is large where Phi is large, and only their product is known well.
    """
    out = np.empty((2 * xi.size * rows.shape[1], basis.size), order="F")
    for G, (before, here, fresh) in zip(basis.recursion, basis.blocks, strict=True):
        block = raised(xi, out[:, before], rows[..., fresh]) - out[:, : here.start] @ G[: here.start]
        out[:, here] = block @ np.linalg.inv(G[here])
    half = len(out) // 2
    return (out[:half] + 1j * out[half:]).reshape(xi.size, -1, basis.size)


def _admissible(changes: np.ndarray, basis: VectorPolynomials, forbidden: np.ndarray) -> np.ndarray:
    """Derivatives in the last axis, freed of the directions that constraints forbid and that the data don't see."""
    changes = changes - (changes @ forbidden.T) @ forbidden
    changes[..., basis.null] = 0.0
    return changes


def _deviations(
    poles: np.ndarray, changes: np.ndarray, variance: float, dt: float | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """pole_std, hz, hz_std, damping, damping_std."""
    with np.errstate(divide="ignore", invalid="ignore"):
        s = poles if dt is None else np.log(poles) / dt
        ds = changes if dt is None else changes / (poles[:, None] * dt)
        size = np.abs(s)
        direction = (s / size)[:, None]
        radial = np.real(direction.conj() * ds)  # d|s|; the other part turns s, which changes -cos of its angle
        turning = np.imag(direction.conj() * ds) / size[:, None]
        damping = -np.real(direction[:, 0])
        spread = [changes, radial / (2 * np.pi), np.imag(direction) * turning]
    std = [np.sqrt(variance) * np.linalg.norm(part, axis=1) for part in spread]
    for part in std:
        part[~np.any(changes, axis=1)] = 0.0
        part[np.isinf(std[0])] = np.inf
    return std[0], size / (2 * np.pi), std[1], damping, std[2]
