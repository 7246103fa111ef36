"""The inverse of a measured response, point by point, with its bound: an admittance from an impedance."""

from __future__ import annotations

import numpy as np

from robustid.core import hz_words
from robustid.data.bound import Bound
from robustid.data.frequency_response import FrequencyResponse, as_frequency_response
from robustid.errors import InputError

_ROUNDED = 1 + 1e-9


def inverse_response(frf: FrequencyResponse) -> FrequencyResponse:
    r"""Inverse of a measured square response, with a proved bound of every entry: the admittance of a measured impedance.

    With :math:`Y = Z^{-1}` and errors :math:`|E| \le B`, entry by entry,

    .. math:: |(Z + E)^{-1} - Y| \le |Y| B\, (I - |Y| B)^{-1} |Y|

    where the spectral radius of :math:`|Y| B` is below 1; elsewhere the bound allows a singular matrix, as far as this tells.

    Parameters
    ----------
    frf : FrequencyResponse
        As many outputs as inputs, every entry measured. Of ellipses and joint bounds the discs of the entries are taken.

    Returns
    -------
    FrequencyResponse
        Outputs and inputs exchanged; the bound (of the same kind) and the covariance (to first order), where there were any.

    Raises
    ------
    InputError, InputTypeError
        A response that is not square, is singular at a frequency, or whose bound allows one that is.

    Notes
    -----
    The bound is that of the Neumann series of ``(I + Y E)^-1``, taken with moduli.

    Examples
    --------
    >>> import robustid as rid
    >>> impedance = rid.FrequencyResponse([10.0], [2 + 0j], bound=0.4, inputs=["i [A]"], outputs=["v [V]"])
    >>> admittance = rid.prepare.inverse_response(impedance)
    >>> admittance.values.real.item(), round(admittance.bound.item(), 6)  # 1/(2 - 0.4) - 1/2
    (0.5, 0.125)
    """
    frf = as_frequency_response("frf", frf)
    frf.require_complete("`inverse_response`")
    points, ny, nu = frf.values.shape
    if ny != nu:
        raise InputError(f"`frf` must have as many outputs as inputs; got {ny} and {nu}")
    sizes = np.linalg.svd(frf.values, compute_uv=False)
    flat = sizes[:, -1] <= 1e-14 * sizes[:, 0]
    if flat.any():
        raise InputError(
            f"`frf` must be regular at every frequency; it is singular at {hz_words(frf.freq_hz[np.argmax(flat)], 6)}. Leave such"
            " points out"
        )
    back = np.linalg.inv(frf.values)
    bound = None if frf.bound is None else Bound(_radius(frf, np.abs(back)), **frf.bound.of_kind)
    covariance = None
    if frf.covariance is not None:
        # vec(-Y E Y) = -(Y^T kron Y) vec(E), columns stacked.
        turned = np.einsum("fba,fcd->facbd", back, back).reshape(points, ny * ny, ny * ny)
        covariance = turned @ frf.covariance @ turned.conj().swapaxes(1, 2)
    return FrequencyResponse(
        frf.omega,
        back,
        bound=bound,
        covariance=covariance,
        dt=frf.dt,
        inputs=frf.outputs,
        outputs=frf.inputs,
        note=f"inverse of a response: {frf.note}" if frf.note else "",
        dof=frf.dof,
        faults=frf.faults,
    )


def _radius(frf: FrequencyResponse, size: np.ndarray) -> np.ndarray:
    """Bounds of the entries of the inverse, whose moduli are `size`."""
    loss: np.ndarray = size @ np.asarray(frf.bound.outer_radius, dtype=float)
    reach = np.max(np.abs(np.linalg.eigvals(loss)), axis=1)
    if np.any(reach >= 1):
        k = int(np.argmax(reach))
        raise InputError(
            f"`frf` has bounds that allow a singular response, as at {hz_words(frf.freq_hz[k], 6)}, where they would have to be"
            f" smaller by a factor of {reach[k]:.3g}. Measure these points better, or leave them out"
        )
    return loss @ np.linalg.solve(np.eye(size.shape[1]) - loss, size) * _ROUNDED
