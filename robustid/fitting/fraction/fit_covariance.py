"""Uncertainty of a fit: covariance of the coefficients, and standard deviations of poles and response."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from robustid.core import Frozen, as_array, as_kind, as_positive, exponents_of, freeze, one_thread, points_of
from robustid.errors import InputError
from robustid.fitting.fraction.coordinates import Coordinates, EntryCoordinates, JointCoordinates
from robustid.fitting.matrix_fraction import MatrixFraction
from robustid.fitting.modal.modal_covariance import ModalCovariance, modal_covariance
from robustid.fitting.state_space.integrator_chains import nearest_poles

_LINES_AT_ONCE = 256


@dataclasses.dataclass(frozen=True, eq=False)
class FitCovariance(Frozen):
    """First-order uncertainty of a fitted model.

    In polynomials that the data of the model make orthonormal the Jacobian of the weighted residual has orthonormal
    columns, so that the covariance of the coefficients is ``variance (I - R^T R)`` and no matrix is inverted. The rows
    of R are the directions that constraints forbid. Entries that share poles and nothing else are taken one by one.

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
    coordinates : JointCoordinates or EntryCoordinates
        Coordinates of changes of the coefficients in which their covariance is one.
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
    coordinates: Coordinates
    modes: ModalCovariance | None = None

    def __post_init__(self) -> None:
        names = ("poles", "pole_std", "hz", "hz_std", "damping", "damping_std")
        self._set(**{name: freeze(getattr(self, name)) for name in names})

    def response_std(self, omega: ArrayLike | None = None) -> np.ndarray:
        """Standard deviation ``sqrt(E|dP|^2)`` of every entry of the response.

        (F, ny, nu), in the unit of the response, at `omega` in rad/s; default the frequency points of the data.
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
            std[part] = self.coordinates.response_std(xi[part], denominators[part], response[part])
        std *= np.sqrt(self.variance)
        return model.oriented(std)


@one_thread()
def fit_covariance(fit: MatrixFraction, *, noise: float | None = None) -> FitCovariance:
    r"""Standard deviations of poles and response of a fit, from the noise of the data.

    .. math:: \operatorname{Cov}(c) = v (I - R^T R), \qquad
        d\lambda = -\frac{w^H dD(\lambda) v_\lambda}{w^H D'(\lambda) v_\lambda}, \qquad dP = (dN - P\,dD) D^{-1}

    where c are the coordinates of (dD, dN) in the polynomials that the data of the model make orthonormal. The same, but one
    factorisation an entry, where entries share the poles alone (`EntryCoordinates`).

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
    >>> from robustid.fitting import Weight, fit_mfd
    >>> omega = np.linspace(1, 9, 60)
    >>> values = 1 / ((1j * omega) ** 2 + 0.2j * omega + 16)
    >>> weight = Weight(np.full((60, 1, 1), 1000.0))  # noise of 1e-3
    >>> found = fit_covariance(fit_mfd(rid.FrequencyResponse(omega, values), order=2, weight=weight), noise=1.0)
    >>> np.round(found.hz, 4), np.round(found.hz_std, 6)
    (array([0.6366, 0.6366]), array([1.2e-05, 1.2e-05]))
    """
    problem = as_kind("fit", fit, MatrixFraction, "a MatrixFraction from fit_mfd").problem
    coordinates, modes = _coordinates(fit)
    parameters = coordinates.parameters
    spare = problem.equations - parameters
    if noise is not None:
        variance = as_positive("noise", noise) / 2
    elif spare > 0:
        variance = fit.cost / spare
    else:
        raise InputError(f"`fit` has {parameters} free coefficients and no more real equations; give `noise`")
    if modes is not None:
        modes = dataclasses.replace(modes, variance=variance)
    poles, changes, undetermined = coordinates.pole_changes(fit)
    count, origin = 2 * fit.fraction.rigid_count, 0.0 if problem.dt is None else 1.0
    fixed = nearest_poles(poles, origin, count) if count else np.zeros(poles.size, dtype=bool)
    changes[undetermined] = np.inf
    changes[fixed], poles[fixed] = 0.0, origin
    last = np.argsort(fixed, kind="stable")
    poles, changes = poles[last], changes[last]
    return FitCovariance(
        fit, variance, parameters, poles, *_deviations(poles, changes, variance, problem.dt), coordinates, modes
    )


def _coordinates(fit: MatrixFraction) -> tuple[Coordinates, ModalCovariance | None]:
    """Coordinates entry by entry where entries are apart, else all together; with modal structure those of the modes too."""
    problem = fit.problem
    if fit.modal is None and problem.entries_apart:
        return EntryCoordinates.of(fit), None
    basis = problem.basis(fit.nodes.denominators, fit.nodes.response)
    if fit.modal is None:
        return JointCoordinates(basis, problem.forbidden(basis, fit.nodes)), None
    modes = modal_covariance(fit, basis)
    return JointCoordinates(basis, modes.forbidden), modes


def _deviations(
    poles: np.ndarray, changes: np.ndarray, variance: float, dt: float | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """pole_std, hz, hz_std, damping, damping_std."""
    with np.errstate(divide="ignore", invalid="ignore"):
        s = exponents_of(poles, dt)
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
