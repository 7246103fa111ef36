"""The fit of a run: a matrix fraction of the response, whose modes become those of the parametric part."""

from __future__ import annotations

import dataclasses
from functools import partial
from typing import Any

import numpy as np

from robustid.app.checks import AUTO
from robustid.app.folder import RunFolder
from robustid.app.measurements import Measured, Say
from robustid.app.options import Modes
from robustid.app.run_file import MODES_NOTE, RunFile
from robustid.core import Source
from robustid.data import FrequencyResponse
from robustid.errors import InputError
from robustid.fitting import MatrixFraction, ModeRow, fit_covariance, fit_mfd, mode_table, suggest_order

_SWEEP = 60.0  # s for the choice of an order, where no limit is stated
_DEVIATIONS = 3.0  # of the pole-uncertainty box, on either side
_MOST = 2  # integrators of a class
_LEAST = 0.1  # part of the damping at which the box ends below, however large its deviation


def with_fit(run: RunFile, data: Measured, say: Say, folder: RunFolder) -> RunFile:
    """The poles of the parametric part from a fit, where one is asked for and they aren't stated; the fit is kept."""
    if run.fit.order is None or run.modes.hz is not None:
        return run
    if not data.responses:
        raise InputError("[fit] needs a frequency response; the run has samples alone. Leave [fit] out")
    frf = data.responses[0]
    try:
        fit, why = _fitted(run, frf, say)
    except InputError as error:
        raise InputError(f"[fit]: {error}") from None
    folder.fitted(fit)
    rows = mode_table(fit, fit_covariance(fit))
    rigid = sum(row.count for row in rows if row.rigid)
    if rigid + run.modes.integrators > _MOST:
        raise InputError(
            f"[fit] gives {rigid} poles of rigid-body modes, more than the {_MOST} integrators that a class can have; take"
            " rigid_body out of [fit]"
        )
    modes = [row for row in rows if _usable(row, frf)]
    left = sum(row.count for row in rows if not row.rigid) - sum(row.count for row in modes)
    chosen = run.modes
    words = f"a matrix fraction of order {len(fit.poles)}{why}, weighted by {fit.weight_choice}."
    words += f" {left} of its poles lie beside the band or are not damped, and are left out." if left else ""
    lines = [
        f"  {row.hz:.5g} Hz (± {row.hz_std:.2g}), damping {row.damping:.3g} (± {row.damping_std:.2g})" for row in modes
    ]
    found = Modes(
        hz=tuple(row.hz for row in modes),
        damping=tuple(row.damping for row in modes),
        repeat=chosen.repeat,
        integrators=chosen.integrators + rigid,
        delay=chosen.delay if chosen.delay is not None else int(not run.fit.feedthrough and frf.dt is not None),
        source=Source.DATA,
        note="\n".join([MODES_NOTE + words, *lines]),
        **_box(modes),
    )
    return dataclasses.replace(run, modes=found).changed("fit", order=len(fit.poles))


def _fitted(run: RunFile, frf: FrequencyResponse, say: Say) -> tuple[MatrixFraction, str]:
    """The fit, and why it has its order."""
    asked, order, why = run.fit.arguments, run.fit.order, ""
    if order == AUTO:
        say("fitting a range of orders")
        limited: dict[str, Any] = {**asked, "time_limit": asked["time_limit"] or _SWEEP}
        sweep = suggest_order(frf, progress=partial(say, "fitting a range of orders"), **limited)
        if sweep.interrupted:
            raise KeyboardInterrupt
        order, why = (
            sweep.suggested,
            f", which {sweep.reason} (orders {sweep.orders[0]} to {sweep.orders[-1]} were tried)",
        )
    say(f"fitting a matrix fraction of order {order}")
    return fit_mfd(frf, order=int(order or 0), **asked), why


def _usable(row: ModeRow, frf: FrequencyResponse) -> bool:
    """Tell whether a pole is damped and lies where the data say something of it."""
    high = frf.freq_hz.max() if frf.dt is None else 0.5 / frf.dt
    return not row.rigid and 0 < row.damping <= 1 and 0 < row.hz < high


def _box(modes: list[ModeRow]) -> dict[str, Any]:
    """The pole-uncertainty box: three standard deviations on either side; none where one isn't known."""
    spread = np.array([(row.hz_std, row.damping_std) for row in modes])
    if not len(spread) or not np.all(np.isfinite(spread)):
        return {}
    hz, damping = (np.array([getattr(row, name) for row in modes]) for name in ("hz", "damping"))
    ends = [(np.maximum(hz - _DEVIATIONS * spread[:, 0], _LEAST * hz), hz + _DEVIATIONS * spread[:, 0])]
    low = np.maximum(damping - _DEVIATIONS * spread[:, 1], _LEAST * damping)
    ends.append((low, np.minimum(damping + _DEVIATIONS * spread[:, 1], 1.0)))
    pairs = [tuple(zip(below.tolist(), above.tolist(), strict=True)) for below, above in ends]
    return {"hz_interval": pairs[0], "damping_interval": pairs[1]}
