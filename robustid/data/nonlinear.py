"""Simulated machines that are not linear: records whose true scatter is known by making as many of them as one likes."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from robustid.core import Real, as_count, as_float, as_positive
from robustid.data.excitation import multisine
from robustid.data.time_record import TimeRecord
from robustid.errors import InputError

PERIOD = 512
_DT = 1 / 512  # s: the lines are 1 Hz apart
_BAND_HZ = (5, 60)
_SUBSTEPS = 4  # Runge-Kutta steps per sample: see tests/data/test_nonlinear.py for the error
_SETTLED = 5  # periods before the one that is kept; the slowest motion decays by more than 100 in each

Rate = Callable[[Real, Real], Real]  # states (n, R) and input (R,) to the derivative of the states


class _Plant(NamedTuple):
    states: int
    rate: Rate
    output: int
    what: str


def _hardening(x: Real, u: Real) -> Real:
    """``x'' = w^2 (u - x - 0.01 x^3) - 2 d w x'``, w = 2 pi 25, d = 0.03."""
    w = 2 * np.pi * 25
    return np.stack([x[1], w**2 * (u - x[0] - 0.01 * x[0] ** 3) - 0.06 * w * x[1]])


def _friction(x: Real, u: Real) -> Real:
    """``x'' = w^2 (u - x - 0.15 tanh(x'/(0.2 w))) - 2 d w x'``, w = 2 pi 25, d = 0.02."""
    w = 2 * np.pi * 25
    return np.stack([x[1], w**2 * (u - x[0] - 0.15 * np.tanh(5 * x[1] / w)) - 0.04 * w * x[1]])


def _backlash(x: Real, u: Real) -> Real:
    """Two equal inertias, the first held by a soft spring and driven, the shaft between them with a gap.

    ``x1'' = w^2 (u - x1/4 - T) - d x1'``, ``x2'' = w^2 T - d x2'``, ``T = s - 0.3 tanh(s/0.4)``, s the twist.
    """
    w = 2 * np.pi * 18
    twist = x[0] - x[2]
    torque = twist - 0.3 * np.tanh(2.5 * twist) + 0.04 * (x[1] - x[3]) / w
    return np.stack([x[1], w**2 * (u - 0.25 * x[0] - torque) - 0.12 * w * x[1], x[3], w**2 * torque - 0.12 * w * x[3]])


_PLANTS = {
    "hardening spring": _Plant(2, _hardening, 0, "displacement"),
    "dry friction": _Plant(2, _friction, 0, "displacement"),
    "backlash": _Plant(4, _backlash, 0, "motor angle"),
}
NONLINEAR = tuple(_PLANTS)


def nonlinear_records(
    kind: str,
    count: int = 1,
    *,
    rms: float = 0.5,
    noise: float = 0.0,
    periods: int = 2,
    spacing: str = "all",
    seed: int = 0,
) -> list[TimeRecord]:
    """Records of a simulated nonlinear machine in periodic steady state, each with its own random-phase multisine.

    Multisines of 5 to 60 Hz, 1 Hz apart, period 512 samples of 1/512 s, held between the samples. Each machine has a
    resonance in the band.

    Parameters
    ----------
    kind : {"hardening spring", "dry friction", "backlash"}
        A mass on a spring that hardens; a mass on a spring with dry friction; two inertias with a gap in the shaft between them.
    count : int
        How many records: realisations of the excitation. They are exchangeable.
    rms : float
        Root mean square of the input.
    noise : float
        Standard deviation of the white noise on the output, as a part of the rms of the output.
    periods : int
        Of every record.
    spacing : {"all", "odd", "random-odd", "log"}
        Lines of the excitation, as for `multisine`.
    seed : int
        Of phases and noise. The phases do not depend on the noise.

    Returns
    -------
    list of TimeRecord

    Raises
    ------
    InputError
        Another kind, counts below 1, a negative noise.

    Notes
    -----
    Runge-Kutta steps of fourth order and fixed size, four a sample; five periods pass before the one that is kept.

    Examples
    --------
    >>> from robustid import estimate_frf
    >>> from robustid.prepare import nonlinear_records
    >>> records = nonlinear_records("hardening spring", 4, noise=0.01)
    >>> estimate_frf(records, period=512, about="next record").bound.words()
    'tolerance bound of the next record, 95 % jointly, from 4 independent excitations'
    """
    if kind not in _PLANTS:
        raise InputError(f"`kind` must be one of {NONLINEAR}; got {kind!r}")
    count, periods = as_count("count", count, least=1), as_count("periods", periods, least=1)
    rms, noise = as_positive("rms", rms), as_float("noise", noise)
    if noise < 0:
        raise InputError(f"`noise` must be >= 0; got {noise:g}")
    play = multisine(
        period=PERIOD,
        dt=_DT,
        band_hz=_BAND_HZ,
        spacing=spacing,
        realisations=count,
        rms=rms,
        minimise_crest=False,
        seed=seed,
    )
    u = play.u[:, :, 0]
    y = _steady(_PLANTS[kind], u)
    rng = np.random.default_rng([seed, 1])
    inputs, outputs = ["force"], [_PLANTS[kind].what]
    records: list[TimeRecord] = []
    for one, answer in zip(u, y, strict=True):
        measured = np.tile(answer, periods)
        measured += noise * answer.std() * rng.standard_normal(measured.size)
        records.append(
            TimeRecord(np.tile(one, periods), measured, dt=_DT, initial="periodic", inputs=inputs, outputs=outputs)
        )
    return records


def _steady(plant: _Plant, u: Real) -> Real:
    """Output (R, N) in the last of the periods, from zero initial conditions; all records at once."""
    x = np.zeros((plant.states, len(u)))
    y = np.empty_like(u)
    h, rate = _DT / _SUBSTEPS, plant.rate
    for period in range(_SETTLED + 1):
        for k in range(u.shape[1]):
            if period == _SETTLED:
                y[:, k] = x[plant.output]
            held = u[:, k]
            for _ in range(_SUBSTEPS):
                a = rate(x, held)
                b = rate(x + h / 2 * a, held)
                c = rate(x + h / 2 * b, held)
                x = x + h / 6 * (a + 2 * b + 2 * c + rate(x + h * c, held))
    return y
