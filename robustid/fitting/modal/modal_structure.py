"""Modal(): the structure of a mechanical system, asked of a fit."""

from __future__ import annotations

import dataclasses

import numpy as np

from robustid.core import Frozen, as_flag, counted
from robustid.errors import InputError, InputTypeError
from robustid.fitting.fraction.rigid_body import RigidBody

DAMPINGS = ("general", "proportional")
QUANTITIES = ("position", "velocity", "acceleration")


@dataclasses.dataclass(frozen=True, eq=False)
class Modal(Frozen):
    r"""Modes of a mechanical structure: residues of rank one, by its damping and where its sensors and actuators sit.

    .. math:: P = \sum_k \frac{s^q\, c_k b_k^T}{s^2 + 2 \zeta_k \omega_k s + \omega_k^2}
        + \frac{C_r B_r}{s^2} + D

    with proportional damping: c_k, b_k real; q = 0 for positions, 1 for velocities, 2 for accelerations over forces. Discrete
    models are its samples behind a zero-order hold, so that the shapes stay real. With general damping, ``R_k/(s - p_k)``
    and its conjugate, with ``R_k`` complex of rank one.

    Parameters
    ----------
    damping : {"general", "proportional"}
        Complex or real mode shapes.
    symmetric : bool
        Reciprocal: ``P = P^T``, as where sensors and actuators sit together (as many outputs as inputs, in the same order and
        unit but for one common factor). The sign of a mode is found.
    quantity : {"position", "velocity", "acceleration"}
        What the outputs measure, of inputs that are forces (or proportional to them). With accelerations P has a direct term:
        D is fitted, too, and takes up what rigid bodies add.

    Notes
    -----
    A mode of proportional damping may be overdamped, with two real poles; one of general damping too, each pole with shapes
    of its own.

    A delay that is left in the data turns real shapes complex: take it out first (`FrequencyResponse.without_delay`). Whether a
    structure is true the cost tells, beside that of the free fit.

    Source: `maia1997` chapter 2; `golub1973` for the linear factor that is projected out.

    Examples
    --------
    >>> import numpy as np, robustid as rid
    >>> s = 1j * np.linspace(1, 9, 60)[:, None, None]
    >>> values = np.outer([1.0, -2.0], [3.0, 1.0]) / (s**2 + 0.2 * s + 16)
    >>> fit = rid.fit_mfd(rid.FrequencyResponse(np.abs(s.ravel()), values), order=2, modal=rid.fits.Modal("proportional"))
    >>> (row,) = rid.fits.mode_table(fit)
    >>> round(row.hz, 4), row.shape.round(6), row.drive.round(6)
    (0.6366, array([-0.5,  1. ]), array([-6., -2.]))
    """

    damping: str = "general"
    _: dataclasses.KW_ONLY
    symmetric: bool = False
    quantity: str = "position"

    def __post_init__(self) -> None:
        if self.damping not in DAMPINGS:
            raise InputError(f'`damping` must be "general" or "proportional"; got {self.damping!r}')
        if self.quantity not in QUANTITIES:
            raise InputError(f'`quantity` must be "position", "velocity" or "acceleration"; got {self.quantity!r}')
        self._set(symmetric=as_flag("symmetric", self.symmetric))

    @property
    def real(self) -> bool:
        """True where mode shapes are real."""
        return self.damping == "proportional"

    @property
    def power(self) -> int:
        """Number q of derivatives of the position."""
        return QUANTITIES.index(self.quantity)

    @property
    def tied(self) -> bool:
        """True where the response has fewer free numbers than that of any fraction of the order."""
        return self.real or self.symmetric

    def parameters(self, order: int, shape: tuple[int, int], rigid: int, feedthrough: bool) -> int:
        """Number of free numbers of a tied structure: poles, shapes but for their scale, rigid body, direct term."""
        ny, nu = shape
        own = (ny if self.symmetric else ny + nu - 1) if self.real else 2 * ny
        body = ny * rigid - rigid * (rigid - 1) // 2 if self.symmetric else rigid * (ny + nu - rigid)
        through = ny * (ny + 1) // 2 if self.symmetric else ny * nu
        return (order - 2 * rigid) // 2 * (2 + own) + body + feedthrough * through

    @property
    def words(self) -> str:
        """Words for the structure that is kept, for reports."""
        shapes = "real shapes (proportional damping)" if self.real else "complex shapes (general damping)"
        symmetric = ", reciprocal: the response is symmetric" if self.symmetric else ""
        return f"modes of rank one with {shapes}{symmetric}; outputs are {self.quantity}s"

    def check(self, values: np.ndarray, order: int, body: RigidBody | None) -> None:
        """Raise where the data or other arguments don't allow it."""
        ny, nu = values.shape[1:]
        if self.symmetric and ny != nu:
            raise InputError(
                f"`symmetric` modes need as many outputs as inputs, in the same order; got {counted(ny, 'output')}"
                f" and {counted(nu, 'input')}."
                " Select those that sit together, or leave `symmetric` out"
            )
        if order % 2:
            raise InputError(f"`order` must be even with `modal`: every mode has two states; got {order}")
        if body is None:
            return
        if body.factor == "inside":
            raise InputError('`rigid_body` must have factor "outside" with `modal`')
        if self.power:
            raise InputError(
                f"`rigid_body` needs positions; got `quantity` = {self.quantity!r}. Integrate the data, or fit without it"
                + (" and with `feedthrough`: to accelerations a rigid body is a constant" if self.power == 2 else "")
            )


def as_modal(modal: object) -> Modal | None:
    """The structure that is asked for, if any."""
    if modal is None or modal is False:
        return None
    if modal is True:
        return Modal()
    if not isinstance(modal, Modal):
        raise InputTypeError(
            f'`modal` must be True or a Modal, such as Modal("proportional"); got {type(modal).__name__}'
        )
    return modal
