"""A table of the modes of a model: frequency, damping, what each contributes, and how sure all that is."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from robustid.core import Tabular, as_kind, points_of, response_at
from robustid.fitting.fraction.fit_covariance import FitCovariance
from robustid.fitting.matrix_fraction import MatrixFraction
from robustid.fitting.modal.modal_covariance import mode_shapes
from robustid.fitting.modal.modal_form import continuous, modal_form, schur_poles
from robustid.fitting.state_space.real_modes import mode_gains

if TYPE_CHECKING:
    import control


Array = NDArray[np.generic]


@dataclasses.dataclass(frozen=True)
class ModeRow:
    """One mode: a conjugate pair, a real pole, or the rigid body.

    Attributes
    ----------
    pole : complex
        In the plane of the model; of a pair the one above the real axis.
    count : int
        Number of poles: 1, 2 for a pair, all of the rigid body.
    hz : float
        Natural frequency |s|/2π; 0 for the rigid body.
    damping : float
        -Re(s)/|s|; nan for the rigid body.
    rigid : bool
    multiplicity : int
        Number of poles that share the block: larger than `count` where poles are too close to be told apart.
    participation : float
        Size of the mode's own response at its peak, every entry relative to the largest such peak of that entry,
        relative to that of the largest mode: 0 to 1. inf for rigid-body and undamped modes.
    output, input : int
        The entry where that is largest.
    hz_std, damping_std : float
        Standard deviations, where a covariance is given, else nan.
    shape, drive : (ny,), (nu,) arrays or None
        How a pair shows at the outputs (largest entry 1) and what of each input drives it: ``shape drive'`` stands over
        ``s^2 + 2 zeta omega s + omega^2``, real for a fit with real shapes (a fit's `Modal.quantity` counted); of the sampled
        model behind a zero-order hold the same. For the rigid body ``shape drive/s^2``, (ny, count) and (count, nu). None for
        real poles, poles too close to be told apart, and poles that all entries share.
    shape_std, drive_std : arrays or None
        Standard deviations ``sqrt(E|d|^2)`` of pairs, for fits with `modal` structure where a covariance is given.
    """

    pole: complex
    count: int
    hz: float
    damping: float
    rigid: bool
    multiplicity: int
    participation: float
    output: int
    input: int
    hz_std: float = np.nan
    damping_std: float = np.nan
    # Arrays: too long to print, and no equality.
    shape: Array | None = dataclasses.field(default=None, repr=False, compare=False)
    drive: Array | None = dataclasses.field(default=None, repr=False, compare=False)
    shape_std: Array | None = dataclasses.field(default=None, repr=False, compare=False)
    drive_std: Array | None = dataclasses.field(default=None, repr=False, compare=False)


class ModeTable(tuple[ModeRow, ...], Tabular):
    """Rows of modes, by frequency; printed as a table, and a DataFrame on request."""

    __slots__ = ()

    def table(self) -> dict[str, list[object]]:
        """Columns: frequency in Hz, damping, participation, states, entry where it is largest, pole; deviations where known."""
        names = {"frequency [Hz]": "hz", "damping": "damping", "participation": "participation", "states": "count"}
        names |= {"rigid": "rigid", "output": "output", "input": "input", "pole": "pole"}
        if any(np.isfinite(row.hz_std) for row in self):
            names |= {"frequency std [Hz]": "hz_std", "damping std": "damping_std"}
        return {head: [getattr(row, name) for row in self] for head, name in names.items()}

    def __str__(self) -> str:
        lines = ["  frequency [Hz]   damping   participation   states"]
        for row in self:
            hz = "rigid body" if row.rigid else f"{row.hz:.6g}"
            lines.append(f"{hz:>16}  {row.damping:>8.4g}  {row.participation:>14.3g}  {row.count:>7}")
        return "\n".join(lines)


def mode_table(model: control.StateSpace | MatrixFraction, covariance: FitCovariance | None = None) -> ModeTable:
    """Modes of a model with frequency, damping and how much each contributes, by frequency.

    Parameters
    ----------
    model : control.StateSpace or TransferFunction, MatrixFraction, or another result that has a model
        Continuous, or discrete with its sample time. Poles of a fit that all its entries share are told once; in its
        state space they are there for every signal of the smaller side.
    covariance : FitCovariance, optional
        Of the fit that the model comes from: gives the standard deviations.

    Returns
    -------
    ModeTable
        A tuple of `ModeRow`, which prints as a table and has `to_dataframe`.

    Raises
    ------
    InputError, InputTypeError
        As `modal_form`; `covariance` isn't one.

    Examples
    --------
    >>> import control
    >>> row, = mode_table(control.ss([[0, 1], [-16, -2]], [[0], [1]], [[1, 0]], 0))
    >>> round(row.hz, 4), round(row.damping, 4), row.participation
    (0.6366, 0.25, 1.0)
    """
    if covariance is not None:
        as_kind("covariance", covariance, FitCovariance, "a FitCovariance")
    if isinstance(model, MatrixFraction):
        return _of_fit(model, covariance)
    form = modal_form(model)
    A, B, C = (np.asarray(part) for part in (form.model.A, form.model.B, form.model.C))
    dt = form.model.dt
    rows: list[ModeRow] = []
    peaks: list[np.ndarray] = []
    for block in form.blocks:
        part, inputs, outputs = A[block, block], B[block], C[:, block]
        if form.rigid and block.start == 0:
            pole = 1.0 if dt else 0.0
            row = ModeRow(pole, form.rigid, 0.0, np.nan, True, form.rigid, np.inf, 0, 0)
            chains = int(np.count_nonzero(np.diag(part, form.rigid // 2))) if form.rigid % 2 == 0 else 0
            if 2 * chains == form.rigid and not np.any(inputs[:chains]):
                unit = 1.0 if not dt else 1 / dt**2
                row = dataclasses.replace(row, shape=outputs[:, :chains], drive=unit * inputs[chains:])
            rows.append(row)
            # Gain of the rigid body at low frequency: of 1/s^2, or of 1/s where there are single integrators only.
            N = part - pole * np.eye(form.rigid)
            peaks.append(np.abs(outputs @ N @ inputs if np.any(N) else outputs @ inputs))
            continue
        for pole in schur_poles(part):
            if pole.imag >= 0:
                count, s = 1 + int(pole.imag > 0), continuous(pole, dt)
                damping = float(-s.real / abs(s)) if s else np.nan
                row = ModeRow(complex(pole), count, abs(s) / (2 * np.pi), damping, False, len(part), 0.0, 0, 0)
                if len(part) == 2 == count:
                    row = dataclasses.replace(row, **_shapes(inputs, outputs, s, dt))
                rows.append(row)
                peaks.append(_peak(part, inputs, outputs, s, dt))
    found = [_with_deviation(row, covariance) for row in _with_participation(rows, peaks)]
    return ModeTable(sorted(found, key=lambda row: (not row.rigid, row.hz)))


def _of_fit(fit: MatrixFraction, covariance: FitCovariance | None) -> ModeTable:
    """Modes of a fit, each once: where poles are shared, those of the entries as one column."""
    fraction = fit.fraction
    if fraction.shape is None:
        rows = mode_table(fit.model, covariance)
        return rows if fit.modal is None else _with_shapes(rows, fit, covariance)
    rows = mode_table(dataclasses.replace(fraction, shape=None).model, covariance)
    places = (divmod(row.output, fraction.shape[1]) for row in rows)
    return ModeTable(
        dataclasses.replace(row, output=i, input=j, shape=None, drive=None)
        for row, (i, j) in zip(rows, places, strict=True)
    )


def _with_shapes(rows: tuple[ModeRow, ...], fit: MatrixFraction, covariance: FitCovariance | None) -> ModeTable:
    """Rows of a fit of modal structure with its own shapes, exactly as the structure has them."""
    found = mode_shapes(fit, None if covariance is None else covariance.modes)
    out: list[ModeRow] = []
    for row in rows:
        if row.count == 2 and not row.rigid:
            k = int(np.nanargmin(np.abs(found.poles - row.pole)))
            deviations = (
                {} if covariance is None else {"shape_std": found.shape_std[k], "drive_std": found.drive_std[k]}
            )
            row = dataclasses.replace(row, shape=found.shape[k], drive=found.drive[k], **deviations)
        out.append(row)
    return ModeTable(out)


def _shapes(B: np.ndarray, C: np.ndarray, s: complex, dt: float) -> dict[str, np.ndarray]:
    """Shape and drive of a pair ``[[a, b], [-b, a]]``: its residue over that of a real mode, of the largest entry."""
    residue = np.outer(C[:, 0] + 1j * C[:, 1], B[0] - 1j * B[1])
    unit = dt if dt else 1.0
    M = residue / (2 * unit**2 * mode_gains(np.array([s * unit]), bool(dt), 0)[0])
    i, j = np.unravel_index(np.argmax(np.abs(M)), M.shape)
    return {"shape": M[:, j] / (M[i, j] or 1.0), "drive": M[i]}


def _peak(A: np.ndarray, B: np.ndarray, C: np.ndarray, s: complex, dt: float) -> np.ndarray:
    """Largest modulus (ny, nu) of a mode's own response, inf where it isn't damped."""
    own = (A, B, C, np.zeros((len(C), B.shape[1])))
    if not np.isfinite(s):
        return np.abs(response_at(own, 1.0))[0]
    if s.real == 0:
        return np.where(np.abs(C) @ np.abs(B) > 0, np.inf, 0.0)
    omega = np.array([abs(s.imag), np.sqrt(max(0.0, s.imag**2 - s.real**2))])
    return np.max(np.abs(response_at(own, points_of(omega, dt))), axis=0)


def _with_participation(rows: list[ModeRow], peaks: list[np.ndarray]) -> list[ModeRow]:
    """Peaks of every entry relative to the largest of that entry: no unit of a signal counts."""
    finite = [k for k, peak in enumerate(peaks) if np.all(np.isfinite(peak)) and not rows[k].rigid]
    entry = np.max([peaks[k] for k in finite], axis=0) if finite else np.ones(1)
    entry = np.where(entry > 0, entry, 1.0)
    largest = max((float(np.linalg.norm(peaks[k] / entry)) for k in finite), default=1.0) or 1.0
    found: list[ModeRow] = []
    for k, (row, peak) in enumerate(zip(rows, peaks, strict=True)):
        output, column = np.unravel_index(int(np.argmax(peak / entry)), peak.shape)
        share = float(np.linalg.norm(peak / entry)) / largest if k in finite else np.inf
        found.append(dataclasses.replace(row, participation=share, output=int(output), input=int(column)))
    return found


def _with_deviation(row: ModeRow, covariance: FitCovariance | None) -> ModeRow:
    if covariance is None:
        return row
    k = int(np.argmin(np.abs(covariance.poles - row.pole)))
    return dataclasses.replace(row, hz_std=float(covariance.hz_std[k]), damping_std=float(covariance.damping_std[k]))
