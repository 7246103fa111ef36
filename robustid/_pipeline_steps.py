"""The steps of a run: each reads its choices from the run file and writes there those that it makes."""

from __future__ import annotations

import dataclasses
from typing import Any, Protocol

import numpy as np

from robustid._pipeline_data import Measured
from robustid._pipeline_file import BOUNDS_NOTE, MODES_NOTE, PRIOR_NOTE, Modes, PriorChoice, RunFile
from robustid.advice import suggest_kautz, suggest_prior
from robustid.advice.prior import _possible_rates, _sizes
from robustid.bases import ParametricBasis, kautz
from robustid.data import FrequencyResponse
from robustid.data.ellipses import bound_ratio
from robustid.identification import Identification
from robustid.identification.consistency import identify
from robustid.identification.residuals import model_residuals
from robustid.identification.validation import Validation
from robustid.interpolation import MixedProblem, Prior

SPARE = 1.1  # beyond the smallest inflation of the bounds
_MOST_NAMED = 6


class Say(Protocol):
    """Where progress goes: what is done now, and how much of it is."""

    def __call__(self, text: str, done: int | None = None, count: int | None = None) -> None:
        """Say it."""


def with_modes(run: RunFile, data: Measured, say: Say) -> RunFile:
    """The poles of the parametric part, from the response where they aren't stated."""
    if run.modes.hz is not None:
        return run if run.modes.delay is not None else run.changed("modes", delay=1)
    if not data.responses:
        note = "No parametric part: there is no frequency response to take modes from."
        return run.changed("modes", hz=(), damping=(), delay=1, note=note)
    say("looking for modes in the frequency response")
    chosen = run.modes
    found = suggest_kautz(data.responses[0], modes=chosen.count, repeat=chosen.repeat, delay=chosen.delay)
    box: dict[str, Any] = {}
    if found.omega.size:
        box = {
            "hz_interval": _pairs(found.omega_interval / (2 * np.pi)),
            "damping_interval": _pairs(found.damping_interval),
        }
    modes = Modes(
        hz=tuple((found.omega / (2 * np.pi)).tolist()),
        damping=tuple(found.damping.tolist()),
        repeat=chosen.repeat,
        delay=found.delay,
        note=MODES_NOTE + found.summary(),
        **box,
    )
    return dataclasses.replace(run, modes=modes)


def _pairs(intervals: np.ndarray) -> tuple:
    return tuple(tuple(pair) for pair in intervals.tolist())


def basis_of(modes: Modes, dt: float) -> ParametricBasis | None:
    """The Kautz pairs that the run file states; None for none."""
    if not modes.hz:
        return None
    omega = 2 * np.pi * np.array(modes.hz)
    return kautz(omega, np.array(modes.damping), dt=dt, repeat=modes.repeat, delay=modes.delay or 0)


def chosen_lines(run: RunFile, frf: FrequencyResponse) -> tuple[FrequencyResponse, FrequencyResponse | None]:
    """The lines that are used, and those that are left to test with."""
    used = np.arange(frf.omega.size) % run.lines.every == 0
    if run.lines.near_hz is not None:
        for hz in run.modes.hz or ():
            used |= np.abs(frf.freq_hz - hz) <= run.lines.near_hz
    return frf.select(used), None if used.all() else frf.select(~used)


def with_inflation(run: RunFile, problem: MixedProblem, say: Say) -> RunFile:
    """The factor on all bounds: as stated, or 10 % more than a reference class needs, never below 1."""
    if run.identify.inflate != "auto":
        return run
    say("looking for the smallest factor on the bounds")
    reference, what = _reference(run, problem)
    margin = identify(problem.with_prior(**dataclasses.asdict(reference))).margin
    factor = max(1.0, SPARE * float(margin))
    note = (
        f"{BOUNDS_NOTE}{what} (|G| <= {reference.gain_bound:.4g} in |z| < {reference.decay_rate:.5g}) needs them"
        f" {margin:.4g} times as large. "
        + (
            "They are left as they are."
            if factor == 1
            else f"All are multiplied by {factor:.4g}"
            f' (that and {100 * (SPARE - 1):.0f} %), as inflate = "auto" asks: every result holds for these wider bounds only.'
        )
    )
    return run.changed("identify", inflate=factor, inflate_note=note)


def _stated(run: RunFile) -> Prior | None:
    gain, decay = run.prior.gain_bound, run.prior.decay_rate
    return None if gain is None or decay is None else Prior(gain_bound=gain, decay_rate=decay)


def _reference(run: RunFile, problem: MixedProblem) -> tuple[Prior, str]:
    """A class that says something: the prior that is stated, or a rest that is not larger than the data and decays."""
    if (stated := _stated(run)) is not None:
        return stated, "the class as stated"
    sizes = np.concatenate([np.zeros(0), *(np.abs(f.values).ravel() for f in problem.frequency)])
    small = run.modes.hz and sizes.size
    size = float(np.median(sizes)) if small else _sizes(problem)[0]
    rates = _possible_rates(problem)
    words = "the modes beside a rest as large as the median response" if small else "a rest as large as the response"
    return Prior(gain_bound=size, decay_rate=float(rates[len(rates) // 2])), words


def inflated(data: Any, run: RunFile) -> Any:
    """Data with all bounds multiplied by the factor of the run file, which their note says."""
    factor = run.identify.inflate
    if factor == 1:
        return data
    why = "as the program found" if run.identify.inflate_note else "as stated"
    return data.with_bound(factor * data.bound, f"{data.note or 'bound of the data'}; times {factor:.4g}, {why}")


def with_prior(run: RunFile, problem: MixedProblem, say: Say) -> tuple[RunFile, Prior]:
    """Gain bound and decay rate; where only a class of anything at all fits, a reference class that is then refuted."""
    if (stated := _stated(run)) is not None:
        return run, stated
    say("looking for a prior")
    found = suggest_prior(problem)
    chosen, note = found.prior, PRIOR_NOTE + found.summary()
    if chosen is None or chosen.gain_bound > found.safety * _sizes(problem)[0]:
        chosen, what = _reference(run, problem)
        note += (
            f"\nNot taken: a rest larger than every response says nothing. In its place {what}: |G| <= {chosen.gain_bound:.4g} in"
            f" |z| < {chosen.decay_rate:.5g}"
        )
    return dataclasses.replace(run, prior=PriorChoice(**dataclasses.asdict(chosen), note=note)), chosen


def sample_words(identification: Identification, model: Any, order: int) -> str:
    """Whether a model keeps all samples, or which not."""
    residuals = model_residuals(identification.problem, model)
    outside = [
        (float(ratio), _place(residual.kind, float(at)))
        for residual in residuals
        for at, ratio in zip(residual.axis, residual.ratio, strict=True)
        if ratio > 1 + 1e-5
    ]
    total = sum(residual.axis.size for residual in residuals)
    largest = max(float(residual.ratio.max()) for residual in residuals)
    if not outside:
        return f"The model of order {order} keeps all {total} samples within their bounds (largest |residual|/bound {largest:.4g})."
    return (
        f"The model of order {order} leaves {len(outside)} of {total} samples outside their bounds: {_named(outside)}."
    )


def unused_words(validation: Validation) -> str:
    """What lines that were not used say of the small model."""
    data: Any = validation.data
    ratio = bound_ratio(validation.residuals, data.bound, data.tilt).ravel()
    outside = [(float(r), _place("frequency", float(w))) for r, w in zip(ratio, data.omega, strict=True) if r > 1]
    text = f"Of {ratio.size} lines that were not used, "
    if not outside:
        return text + f"the small model has all within their bounds (largest |residual|/bound {ratio.max():.4g})."
    return text + f"the small model has {len(outside)} outside their bounds: {_named(outside)}."


def _place(kind: str, at: float) -> str:
    return f"{at / (2 * np.pi):.5g} Hz" if kind == "frequency" else f"{at:.5g} s"


def _named(outside: list[tuple[float, str]]) -> str:
    largest = sorted(outside, reverse=True)[:_MOST_NAMED]
    text = ", ".join(f"{place} ({ratio:.4g} bounds)" for ratio, place in largest)
    return text + (f" and {len(outside) - len(largest)} more" if len(outside) > len(largest) else "")
