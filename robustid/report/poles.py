"""Poles in words and numbers: natural frequency, damping, time constant, delay."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np

from robustid.errors import InputError
from robustid.fitting import continuous
from robustid.identification import check_model
from robustid.report.words import HZ, number

if TYPE_CHECKING:
    import control

# The rounded pole of a (double) integrator lies this close to z = 1.
_INTEGRATOR = 1e-7


@dataclasses.dataclass(frozen=True)
class PoleRow:
    """A real pole or a conjugate pair.

    Attributes
    ----------
    pole : complex
        In the plane of the model (z, or s where it is continuous); of a pair the one above the real axis.
    count : int
        1, or 2 for a pair.
    hz : float
        Natural frequency |s|/2π in Hz, s = log(z)/dt; 0 for an integrator, nan for a pole at z = 0.
    damping : float
        -Re(s)/|s|; nan for an integrator.
    modulus : float
        |z|; nan for a continuous model.
    time_constant : float
        -1/Re(s) in s: inf on the stability boundary, negative beyond it.
    """

    pole: complex
    count: int
    hz: float
    damping: float
    modulus: float
    time_constant: float


def pole_table(model: control.StateSpace) -> list[PoleRow]:
    """Return the poles of a model with their natural frequency, damping and time constant, by frequency.

    ``s = log(z)/dt``, ``hz = |s|/2π``, ``damping = -Re(s)/|s|``.

    Parameters
    ----------
    model : control.StateSpace
        Discrete with its sample time, or continuous.

    Returns
    -------
    list of PoleRow

    Raises
    ------
    InputError, InputTypeError
        If `model` isn't a finite StateSpace, or is discrete without a sample time.

    Examples
    --------
    >>> import control, robustid as rid
    >>> experiment = rid.flexible_structure()
    >>> [(round(row.hz, 2), round(row.damping, 4)) for row in pole_table(experiment.truth)]
    [(9.0, 0.1), (17.67, 0.004)]
    """
    system = check_model("model", model)
    if system.dt is True:
        raise InputError("`model` is discrete without a sample time; give it its dt in s")
    return pole_rows(system.poles(), system.dt or 0)


def pole_rows(poles: Any, dt: float) -> list[PoleRow]:
    """Return the rows of `pole_table`, from the poles."""
    upper = sorted((complex(p) for p in np.atleast_1d(poles) if p.imag >= 0), key=lambda p: (p.imag, p.real))
    rows = [_pole_row(pole, dt) for pole in upper]
    return sorted(rows, key=lambda row: (np.isnan(row.hz), row.hz))


def _pole_row(pole: complex, dt: float) -> PoleRow:
    count, modulus = 1 + (pole.imag > 0), abs(pole) if dt else np.nan
    if dt and pole == 0:
        return PoleRow(pole, count, np.nan, 1.0, 0.0, 0.0)
    if dt and abs(pole - 1) <= _INTEGRATOR:
        return PoleRow(pole, count, 0.0, np.nan, modulus, np.inf)
    s = continuous(pole, dt)
    damping = -s.real / abs(s) if s else np.nan
    return PoleRow(pole, count, abs(s) / HZ, damping, modulus, -1 / s.real if s.real else np.inf)


def describe_pole(row: PoleRow) -> str:
    """One pole in words."""
    if row.modulus == 0:
        return "delay of one sample"
    if row.hz == 0:
        return "integrator"
    if row.count == 1:
        return f"time constant {number(row.time_constant)} s"
    return f"{number(row.hz)} Hz with damping {number(row.damping, 3)}"


def delay_words(basis: Any) -> str:
    """The delays of the functions: zeros at the beginning of their impulse responses."""
    state, pulses = basis.B, [basis.D[:, 0]]
    for _ in range(basis.states):
        pulses.append((basis.C @ state)[:, 0])
        state = basis.A @ state
    delays = np.argmax(np.array(pulses) != 0, axis=0)
    low, high = int(delays.min()), int(delays.max())
    if not np.any(basis.poles):
        return f"none but delays, {low} to {high} samples"
    # Of a pair, one function is zero one sample longer.
    return f"delay, {low} sample{'s' * (low != 1)}"
