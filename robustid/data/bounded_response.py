"""Bounds of a frequency response: as entries, ellipses, columns or ellipsoids; from covariances; an error in their units."""

from __future__ import annotations

from typing import Any, Self

import numpy as np

from robustid.core import as_array, as_positive
from robustid.data.ellipses import ellipse_of
from robustid.data.joint_bounds import joint_ratio
from robustid.data.lines import NYQUIST_SLACK, Lines, as_probability
from robustid.errors import InputError


class BoundedResponse(Lines):
    """What a frequency response can do with its bounds."""

    tilt: Any
    joint: str
    ellipsoid: Any
    covariance: Any
    dof: float | None
    note: str
    inputs: Any
    outputs: Any

    @property
    def inner_radius(self) -> np.ndarray:
        """Of the largest disc inside the bound of each entry alone, (F, ny, nu): the smaller semi-axis of an ellipse."""
        return self.bound if self.tilt is None else self.bound / (1 + np.abs(self.tilt))

    @property
    def outer_radius(self) -> np.ndarray:
        """Of the smallest disc around the bound of each entry alone, (F, ny, nu): the larger semi-axis of an ellipse."""
        return self.bound if self.tilt is None else self.bound / (1 - np.abs(self.tilt))

    def ratio(self, error: Any) -> np.ndarray:
        """The size of an error (F, ny, nu) in units of the bound, at most 1 inside: as the bound means it.

        ``|e + tilt conj(e)|/bound``, (F, ny, nu), for joint="entry"; ``||e[:, j]/bound[:, j]||_2``, (F, 1, nu), for "column";
        ``sqrt(vec(e)^H ellipsoid^-1 vec(e))``, (F, 1, 1), for "matrix". Missing entries count as 0.

        Raises
        ------
        InputError
            Another shape, or data without a bound.

        Examples
        --------
        >>> import numpy as np, robustid as rid
        >>> frf = rid.FrequencyResponse([10.0], np.zeros((1, 2, 1))).with_column_bound(0.1)
        >>> frf.ratio([[[0.06], [0.08j]]]).round(9).item()
        1.0
        """
        return joint_ratio(self._error(error), self.bound, self.joint, self.tilt, self.ellipsoid)

    def with_bound(self, bound: Any, note: str = "") -> Self:
        """The same samples with a bound of your own for every entry, of the same tilt, in the place of any other.

        What was not measured stays so.
        """
        return self._with(
            bound=self._where_measured(bound),
            joint="entry",
            ellipsoid=None,
            note=note,
            bound_kind="hard",
            probability=None,
        )

    def with_column_bound(self, radius: Any, note: str = "") -> Self:
        """The same samples, the errors of each column together in a ball: ``||e[:, j]||_2 <= radius[j]``.

        What one experiment with one input leaves on all outputs. For other weights than equal ones give the class ``bound``
        and ``joint="column"``. Missing entries stay missing; they are left out of the norm.

        Parameters
        ----------
        radius : scalar, (F,) or (F, nu) array
            In units of the response, one for all outputs, per line in the order of `omega` here.
        note : str, optional
            Where the bound comes from.

        Examples
        --------
        >>> import numpy as np, robustid as rid
        >>> frf = rid.FrequencyResponse([10.0, 20.0], np.ones((2, 3, 2)), dt=0.01).with_column_bound([[0.1, 0.2], [0.3, 0.4]])
        >>> frf
        <FrequencyResponse: 2 lines, 1.5915 to 3.1831 Hz, 3x2, column bound, dt=0.01 s>
        >>> frf.bound[0].tolist()
        [[0.1, 0.2], [0.1, 0.2], [0.1, 0.2]]
        """
        lines, _, nu = self.values.shape
        radius = as_array("radius", radius)
        if radius.shape not in ((), (lines,), (lines, nu)):
            raise InputError(
                f"`radius` must be a scalar or have shape (F,) = {(lines,)} or (F, nu) = {(lines, nu)}; got {radius.shape}"
            )
        if np.any(radius <= 0):
            raise InputError(f"`radius` must be positive; got {radius.min():g}")
        each = radius if radius.ndim == 0 else radius.reshape(lines, 1, -1)
        plain = self._with(tilt=None).with_bound(np.broadcast_to(each, self.values.shape), note)
        return plain._with(joint="column")

    def with_ellipsoid(self, deviations: float, covariance: Any = None, note: str = "") -> Self:
        """The same samples, all errors of a line together in ``vec(e)^H C^-1 vec(e) <= deviations^2``.

        Parameters
        ----------
        deviations : float
            How many standard deviations the bound is. Of ``n = ny*nu`` circular normal errors of a known C,
            ``2 vec(e)^H C^-1 vec(e)`` is chi-square with 2 n degrees of freedom: they are inside at all F lines with
            probability p or more for ``deviations = sqrt(chi2(2 n, 1 - (1 - p)/F)/2)``, chi2 the quantile (Bonferroni; at
            omega = 0 and pi/dt, where errors are real, ``sqrt(chi2(n, ...))`` is needed, which is larger).
        covariance : (F, ny*nu, ny*nu) complex array, optional
            C = E[vec(e) vec(e)^H], columns stacked, in the order of `omega` here; default: the covariance of the response.
        note : str, optional
            Where the bound comes from.

        Raises
        ------
        InputError
            No covariance, one that isn't Hermitian and positive definite, missing entries.

        Examples
        --------
        >>> import numpy as np, robustid as rid
        >>> from scipy.special import chdtri
        >>> covariance = [[[4e-4, 1e-4j], [-1e-4j, 1e-4]]]
        >>> frf = rid.FrequencyResponse([10.0], np.ones((1, 2, 1)), covariance=covariance, dt=0.01)
        >>> probability, lines, entries = 0.95, 1, 2
        >>> deviations = np.sqrt(chdtri(2 * entries, (1 - probability) / lines) / 2)
        >>> deviations.round(4).item(), frf.with_ellipsoid(deviations).bound.ravel().round(4).tolist()
        (2.178, [0.0436, 0.0218])
        """
        deviations = as_positive("deviations", deviations)
        self.require_complete("`with_ellipsoid`")
        if covariance is None and self.covariance is None:
            raise InputError("`covariance` is needed: the response has none")
        covariance = self.covariance if covariance is None else as_array("covariance", covariance, dtype=complex)
        return self._with(
            bound=None,
            tilt=None,
            joint="matrix",
            ellipsoid=deviations**2 * covariance,
            note=note or self.note,
            bound_kind="statistical",
            probability=None,
        )

    def with_ellipses(self, covariance: Any, deviations: float, note: str = "") -> Self:
        """The same samples, each in the ellipse ``e'C^-1 e <= deviations^2`` with e = (Re e, Im e).

        Parameters
        ----------
        covariance : (F, 2, 2) real array
            C = E[e e'] of the real and the imaginary part at every line, in the order of `omega` here.
        deviations : float
            How many standard deviations the bound is.
        note : str, optional
            Where the bound comes from.

        Raises
        ------
        InputError
            Several channels, another shape, a matrix that isn't symmetric and positive definite.

        Examples
        --------
        >>> import robustid as rid
        >>> frf = rid.FrequencyResponse([10.0], [1 - 0.1j], dt=0.01)
        >>> frf = frf.with_ellipses([[[4e-4, 0.0], [0.0, 1e-4]]], deviations=3)
        >>> frf.inner_radius.round(9).item(), frf.outer_radius.round(9).item()
        (0.03, 0.06)
        """
        if self.values.shape[1:] != (1, 1):
            raise InputError(
                f"`with_ellipses` takes one channel at a time; this response has {len(self.outputs)} outputs and"
                f" {len(self.inputs)} inputs. Pick one entry with .entry(output, input)"
            )
        bound, tilt = ellipse_of(covariance, self.omega.size, as_positive("deviations", deviations))
        plain = self.with_bound(bound, note or self.note)
        return plain._with(tilt=tilt, bound_kind="statistical")

    def with_joint_bound(self, probability: float = 0.95) -> Self:
        """The same samples with the bound that holds for all lines and entries at once with this probability.

        From `covariance` and its `dof` (normal errors of known covariance where that is None), see `estimate_frf`.

        Examples
        --------
        >>> import robustid as rid
        >>> frf = rid.FrequencyResponse([10.0, 20.0], [1 - 0.1j, 0.5j], covariance=[[[1e-4]], [[4e-4]]], dt=0.01)
        >>> frf.with_joint_bound(0.95).bound.ravel().round(4)
        array([0.0192, 0.0384])
        """
        from robustid.data.estimate.frf_bounds import joint_radius, variances

        if self.covariance is None:
            raise InputError(
                "`with_joint_bound` needs the covariance of the response; give `covariance`, or with_bound(...)"
            )
        probability = as_probability(probability)
        real = (self.omega == 0) | (self.omega * (self.dt or 0.0) >= np.pi / NYQUIST_SLACK)
        radius = joint_radius(probability, int(np.sum(~self.missing)), self.dof, real)
        note = f"statistical: joint {100 * probability:g} % over {self.omega.size} lines, from the covariance"
        plain = self._with(tilt=None).with_bound(radius * np.sqrt(variances(self.covariance, self.values.shape)), note)
        return plain._with(bound_kind="statistical", probability=probability)
