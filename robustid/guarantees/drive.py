"""Drive of a tube: an input of one entry, the horizon and the instants that are asked for, checked."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from robustid.core import Real, as_array, as_count
from robustid.data import signal_index
from robustid.errors import InputError
from robustid.identification import Identification, MixedProblem

SIGNALS = ("impulse", "step")
_MOST = 60  # samples of a default tube
_FADED = 1e-2  # of the gain bound: where the class lets the non-parametric part end, for a default horizon
_LONGEST = 500


def as_entry(entry: Any, problem: MixedProblem) -> tuple[int, int]:
    """The output and input of a tube, checked."""
    if entry is None:
        if problem.entries.single:
            return 0, 0
        raise InputError(
            "`entry` is missing: a tube is about one output and one input, the others being 0; give entry=(output, input),"
            f" by number or name, of {[s.name for s in problem.outputs]} and {[s.name for s in problem.inputs]}"
        )
    if not isinstance(entry, tuple | list) or len(cast("Sequence[Any]", entry)) != 2:
        raise InputError(f"`entry` must be (output, input), by number or name; got {entry!r}")
    output, input = cast("Sequence[Any]", entry)
    return signal_index("output", output, problem.outputs), signal_index("input", input, problem.inputs)


def driven(u: Real, entry: tuple[int, int], identification: Identification) -> Real:
    """The input of an entry, and zeros for the others, (H, nu)."""
    out = np.zeros((u.size, identification.problem.entries.inputs))
    out[:, entry[1]] = u
    return out


def as_signal(value: Any, horizon: Any, identification: Identification) -> tuple[str, Real]:
    """Kind of the input and its samples over the horizon, checked."""
    problem = identification.problem
    count = None if horizon is None else as_count("horizon", horizon, least=1)
    if isinstance(value, str):
        if value not in SIGNALS:
            raise InputError(f"`input` must be one of {SIGNALS} or an array of samples; got {value!r}")
        faded = int(np.ceil(np.log(1 / _FADED) / np.log(problem.prior.decay_rate)))
        count = count or max(problem.taylor, min(faded, _LONGEST))
        return value, np.eye(1, count)[0] if value == "impulse" else np.ones(count)
    u = as_array("input", value)
    if u.ndim != 1 or u.size == 0:
        raise InputError(f"`input` must have shape (H,), one input over the horizon; got {u.shape}")
    if count is not None and count > u.size:
        raise InputError(f"`horizon` must not exceed the {u.size} samples of `input`; got {count}")
    return "given", u[:count]


def as_samples(times: Any, horizon: int, dt: float) -> NDArray[np.intp]:
    """Numbers of the samples, checked and sorted."""
    if times is None:
        return np.unique(np.round(np.linspace(0, horizon - 1, min(horizon, _MOST))).astype(int))
    wanted = np.unique(np.atleast_1d(as_array("times", times)))
    if wanted.ndim != 1 or wanted.size == 0:
        raise InputError("`times` is empty; give at least one sample instant in s")
    samples = np.round(wanted / dt).astype(int)
    bad = (np.abs(wanted / dt - samples) > 1e-6 * np.maximum(1, samples)) | (samples < 0) | (samples >= horizon)
    if np.any(bad):
        raise InputError(
            f"`times` must be sample instants of the horizon, 0 to {(horizon - 1) * dt:g} s in steps of dt = {dt:g} s;"
            f" got {wanted[bad][0]:g}"
        )
    return np.unique(samples)
