"""Measurements of a plant in directions: what some sensors see when the inputs move together."""

from __future__ import annotations

import dataclasses
from typing import Any, ClassVar

import numpy as np

from robustid.core import as_array, as_signals, counted, freeze, hz_span
from robustid.data.bound import Bound
from robustid.data.frequency_points import FrequencyPoints, as_note, as_points, check_measured
from robustid.errors import InputError

_SAME = 1e-12  # sine of an angle between directions that is rounding


@dataclasses.dataclass(frozen=True, eq=False)
class TangentialResponse(FrequencyPoints):
    """Samples of a frequency response in directions, each in a complex disc of known size.

    ``values[k, i, j] = left[k, i, :] @ F(exp(1j*omega[k]*dt)) @ right[k, :, j] + e``, ``|e| <= bound[k, i, j]``
    (``F(1j*omega[k])`` where `dt` is None).

    Parameters
    ----------
    omega : (F,) array, rad/s
        Frequencies, >= 0, at most pi/dt; sorted on entry together with what belongs to them. One frequency
        may come several times.
    values : (F,) or (F, l, r) complex array
        What is seen of each direction; NaN is allowed where `bound` is infinite.
    right : (nu,), (nu, r) or (F, nu, r) array, optional
        The columns are directions of the inputs, real or complex; default: each input alone, nu = r. One direction that
        changes from point to point is (F, nu, 1).
    left : (ny,), (l, ny) or (F, l, ny) array, optional
        The rows are what is seen of the outputs; default: each output alone, ny = l.
    bound : scalar, (F,) or (F, l, r) array, or Bound, optional
        Radius of the disc around each value: a hard bound; ``inf`` marks what is not used. See `Bound`.
    dt : float, optional
        Sample time in s; None for continuous time.
    inputs, outputs : sequence of str or (name, unit), optional
        Signals of the plant, nu and ny of them.
    note : str, optional
        Where the bound comes from, for reports.

    Raises
    ------
    InputError, InputTypeError
        On any wrong shape, NaN, negative bound, frequency above pi/dt, direction of length zero.

    Notes
    -----
    Data that excite only some combinations of the inputs say nothing of the others: see `unexcited` and `unseen`.

    Examples
    --------
    >>> import robustid as rid
    >>> data = rid.TangentialResponse([10.0, 20.0], [0.1, 0.2j], right=[1.0, -1.0], bound=0.01, dt=0.01)
    >>> data
    <TangentialResponse: 2 frequency points, 1.5915 to 3.1831 Hz, 1 sensor, 1 direction of a 1x2 plant, bound, dt=0.01 s>
    >>> abs(data.unexcited().ravel()).round(3).tolist()
    [0.707, 0.707]
    """

    PER_POINT: ClassVar[tuple[str, ...]] = ("omega", "values", "right", "left")
    omega: np.ndarray
    values: np.ndarray
    _: dataclasses.KW_ONLY
    right: Any = None
    left: Any = None
    bound: Any = None
    dt: float | None = None
    inputs: Any = None
    outputs: Any = None
    note: str = ""

    def __post_init__(self) -> None:
        omega, values, dt = as_points(self.omega, self.values, self.dt, "l, r")
        points, sensors, directions = values.shape
        right = as_right(self.right, points, directions if self.right is None else None)
        left = as_left(self.left, points, sensors if self.left is None else None)
        for name, count, wanted, axis in (
            ("right", right.shape[2], directions, "columns"),
            ("left", left.shape[1], sensors, "rows"),
        ):
            if count != wanted:
                raise InputError(
                    f"`{name}` must have the {wanted} {axis} that `values` {values.shape} has; got {count}"
                )
        bound = Bound.of(self.bound, values.shape)
        if bound is not None and (bound.tilt is not None or bound.joint != "entry"):
            raise InputError(
                "`bound` of directions is a disc for every value; leave out `tilt`, `joint` and `ellipsoid`"
            )
        check_measured(values, bound)
        order = np.argsort(omega, kind="stable")
        self._set(
            omega=freeze(omega[order]),
            values=freeze(values[order]),
            right=freeze(right[order]),
            left=freeze(left[order]),
            bound=None if bound is None else bound.select(order),
            dt=dt,
            inputs=as_signals("inputs", self.inputs, right.shape[1], "u"),
            outputs=as_signals("outputs", self.outputs, left.shape[2], "y"),
            note=as_note(self.note),
        )

    def __repr__(self) -> str:
        low, high = self.freq_hz[[0, -1]]
        points, sensors, directions = self.values.shape
        plant = f"{len(self.outputs)}x{len(self.inputs)}"
        parts = [
            f"{counted(points, 'frequency point')}, {hz_span(low, high)}",
            f"{sensors} sensor{'s' * (sensors != 1)}",
            f"{directions} direction{'s' * (directions != 1)} of a {plant} plant",
        ]
        parts += ["bound"] if self.bound is not None else []
        parts += [f"{count} missing"] if (count := int(np.sum(self.missing))) else []
        parts += [f"dt={self.dt:.6g} s"] if self.dt is not None else []
        return f"<TangentialResponse: {', '.join(parts)}>"

    @property
    def weights(self) -> np.ndarray:
        """(F, l, r, ny, nu): every value is ``sum(weights * F)``, plus its error."""
        return combined(self.left, self.right)

    def unexcited(self) -> np.ndarray:
        """Combinations of the inputs that no used direction moves: an orthonormal basis of real columns, (nu, d).

        ``v @ right[k, :, j] = 0`` at all points for each column v; (nu, 0) where every input is reached. A complex direction moves
        what its real and its imaginary part move, since the plant is real.
        """
        used = np.any(~self.missing, axis=1)  # (F, r)
        return _beside(self.right.swapaxes(1, 2)[used])

    def unseen(self) -> np.ndarray:
        """Combinations of the outputs that no used row sees: an orthonormal basis of real columns, (ny, d)."""
        used = np.any(~self.missing, axis=2)  # (F, l)
        return _beside(self.left[used])


def combined(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """(F, l, r, ny, nu) with ``left @ F @ right = sum(weights * F)``."""
    return np.einsum("fia,fbj->fijab", left, right)


def as_right(value: object, points: int, inputs: int | None) -> np.ndarray:
    """Directions of the inputs, (F, nu, r), checked; the identity of that size where there are none."""
    array = np.eye(inputs or 1, dtype=complex) if value is None else as_array("right", value, dtype=complex)
    array = array[:, None] if array.ndim == 1 else array
    _check("right", array, "(nu,), (nu, r) or (F, nu, r)", points, inputs, 1)
    return np.broadcast_to(array, (points, *array.shape[-2:]))


def as_left(value: object, points: int, outputs: int | None) -> np.ndarray:
    """Combinations of the outputs that are seen, (F, l, ny), checked; the identity of that size where nothing is given."""
    array = np.eye(outputs or 1, dtype=complex) if value is None else as_array("left", value, dtype=complex)
    array = array[None, :] if array.ndim == 1 else array
    _check("left", array, "(ny,), (l, ny) or (F, l, ny)", points, outputs, 2)
    return np.broadcast_to(array, (points, *array.shape[-2:]))


def _check(name: str, array: np.ndarray, shapes: str, points: int, signals: int | None, axis: int) -> None:
    """The signals of the plant are on this axis of three."""
    if array.ndim not in (2, 3) or (array.ndim == 3 and array.shape[0] != points) or 0 in array.shape:
        raise InputError(f"`{name}` must have shape {shapes} with F = {points} from `omega`; got {array.shape}")
    if signals is not None and array.shape[axis - 3] != signals:
        side = "inputs" if name == "right" else "outputs"
        raise InputError(
            f"`{name}` must have shape {shapes} with the {signals} {side} of the response; got {array.shape}"
        )
    zero = np.argwhere(~np.any(array, axis=axis - 3))
    if len(zero):
        where = ", ".join(
            f"{word} {int(i)}" for word, i in zip(("frequency point", "number")[-zero.shape[1] :], zero[0], strict=True)
        )
        raise InputError(
            f"`{name}` has a direction of length zero ({where}): it measures nothing. Leave it out, or give what is not used an"
            " infinite `bound` and any direction"
        )


def _beside(directions: np.ndarray) -> np.ndarray:
    """Orthonormal basis of the real v with ``v @ d = 0`` for all rows d of an array (N, n)."""
    rows = np.concatenate([np.real(directions), np.imag(directions)])
    # In units of each signal, and of each row, the verdict doesn't depend on either; powers of two are exact.
    unit = np.abs(rows).max(axis=0, initial=0.0)
    unit = 2.0 ** np.round(np.log2(np.where(unit > 0, unit, 1.0)))
    scaled = rows / unit
    size = np.linalg.norm(scaled, axis=1, keepdims=True)
    triangle = np.linalg.qr(np.divide(scaled, size, out=np.zeros_like(scaled), where=size > 0), mode="r")
    _, singular_values, Vt = np.linalg.svd(triangle)
    rank = int(np.sum(singular_values > _SAME * singular_values.max(initial=0.0)))
    # v in units of the signals: scaled @ w = 0 is rows @ (w/unit) = 0.
    return np.linalg.qr(Vt[rank:].T / unit[:, None])[0] + 0.0
