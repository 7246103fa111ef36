"""The poles of the parametric part: as stated, from a fit, from the response, or from records alone; and the functions of them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from robustid.advice import KautzSuggestion, suggest_kautz, suspect_modes, tells_modes
from robustid.app.run.checks import AUTO
from robustid.app.run.class_settings import POSITIVE_REAL
from robustid.app.run.measurements import Measured
from robustid.app.run.run_file import MODES_NOTE, RECORD_MODES_NOTE, RunFile
from robustid.app.run.run_folder import Surroundings
from robustid.app.run.settings import Modes
from robustid.app.run.sources import MemberChoice
from robustid.app.run.toml import is_array
from robustid.bases import ParametricBasis, integrators, kautz, passive_modes, stack_bases
from robustid.core import Budget, Real, Source, hz_scale, hz_words, pass_on
from robustid.data import Bound, FaultKind, FrequencyResponse, TimeRecord
from robustid.errors import InputError, InputTypeError, SizeError
from robustid.estimation import delay_fault, response_faults
from robustid.fitting import (
    MatrixFraction,
    ModeRow,
    RecordFit,
    fit_covariance,
    fit_mfd,
    fit_records,
    mode_table,
    orders_fitted,
)
from robustid.guarantees import has_box
from robustid.identification import MixedProblem, check_equations, validate

Box = tuple[Real, Real]  # (M, 2) each: natural frequencies in rad/s, damping ratios

_SWEEP = 60.0  # s for the choice of an order, where no limit is stated
_SHARE = 0.5  # of the time that is left, for the modes: a class without those that the data show says little
_FEW = "No parametric part: the frequency points are too few for a mode beside a smooth remainder."
_NO_TIME = "No parametric part: the time was too short for the search for the first mode."
_DEVIATIONS = 3.0  # of the pole-uncertainty box, on either side
_MOST = 2  # integrators of a class
_LEAST = 0.1  # part of the damping at which the box ends below, however large its deviation
_MOST_ORDER, _SECONDS = 12, 60.0  # of fits of records
_CLOSE = 1.2  # times the bounds: least squares keeps to them no better, where the order is right
_EQUATIONS = 3  # samples that a parameter asks for
_FAST = 0.7  # decay of a pole per sample that any non-parametric part holds as well
_SLOW = {1: 0.2, 2: 0.05}  # decay over the longest record below which a pole, or a pair, is a guess: drift or sustained


def with_modes(run: RunFile, data: Measured, around: Surroundings) -> RunFile:
    """The poles of the parametric part, from the response where they aren't stated."""
    for frf in data.responses:  # before minutes of a search for modes: the two functions of one alone
        check_equations(frf.values.size, frf.values[0].size, 2)
    if run.modes.hz is not None:
        return run if run.modes.delay is not None else run.changed("modes", delay=int(bool(data.dt)))
    chosen = run.modes
    if (kind := run.prior.passive) is not None:
        found = _relaxations(data.responses, kind, run.prior.decay)
        if found is None:
            note = "No parametric part: a passive class is about the whole plant."
            return run.changed("modes", hz=(), damping=(), delay=1, source=Source.PROGRAM, note=note)
        hz = tuple((found.omega / (2 * np.pi)).tolist())
        said = {"source": Source.DATA, "note": MODES_NOTE + found.summary()}
        return run.changed("modes", hz=hz, damping=tuple(found.damping.tolist()), delay=0, **said)
    if not data.responses:
        around.say("looking for modes in the records")
        return dataclasses.replace(run, modes=_from_records(chosen, data.records))
    frf = _of_all_bands(data.responses)
    few = chosen.count is None and not tells_modes(frf)
    found = None if few else _in_time(frf, chosen, around)
    if found is None:
        note = _FEW if few else _NO_TIME
        return run.changed("modes", hz=(), damping=(), delay=chosen.delay or 0, source=Source.PROGRAM, note=note)
    hz_interval = damping_interval = None
    if found.omega.size:
        hz_interval, damping_interval = map(_pairs, (found.omega_interval / (2 * np.pi), found.damping_interval))
    modes = Modes(
        hz=tuple((found.omega / (2 * np.pi)).tolist()),
        damping=tuple(found.damping.tolist()),
        repeat=found.repeat,
        integrators=chosen.integrators,
        delay=found.delay,
        source=Source.DATA,
        note=MODES_NOTE + found.summary(),
        hz_interval=hz_interval,
        damping_interval=damping_interval,
    )
    return dataclasses.replace(run, modes=modes)


def _of_all_bands(responses: Sequence[FrequencyResponse]) -> FrequencyResponse:
    """The first response with the frequency points that others, of the same entries, have outside its band."""
    first, parts = responses[0], [responses[0]]
    if first.bound is None or first.bound.joint == "matrix" or first.bound.tilt is not None:
        return first
    for one in responses[1:]:
        new = (one.omega < min(p.omega[0] for p in parts)) | (one.omega > max(p.omega[-1] for p in parts))
        alike = (one.values.shape[1:], one.dt) == (first.values.shape[1:], first.dt)
        if alike and one.bound is not None and new.any():
            parts.append(one.select(new))
    if len(parts) == 1:
        return first
    omega = np.concatenate([one.omega for one in parts])
    values, radius = (np.concatenate(a) for a in ([p.values for p in parts], [np.asarray(p.bound) for p in parts]))
    order = np.argsort(omega, kind="stable")
    bound = Bound(radius[order], kind=first.bound.kind)
    return FrequencyResponse(
        omega[order], values[order], bound=bound, dt=first.dt, inputs=first.inputs, outputs=first.outputs
    )


def _in_time(frf: FrequencyResponse, chosen: Modes, around: Surroundings) -> KautzSuggestion | None:
    """The modes that a response shows, or those found in a part of the time of the run; None where there is none for the first."""
    words = "looking for modes in the frequency response"
    around.say(words)
    limit = None if chosen.count else around.budget.share(_SHARE).seconds  # a number that was asked for is found
    try:
        found = suggest_kautz(frf, modes=chosen.count, repeat=chosen.repeat, delay=chosen.delay, time_limit=limit)
    except SizeError:
        found = None
    if found is None or not found.complete:
        around.ended_early(words)
    return found


def with_faults(run: RunFile, data: Measured, around: Surroundings) -> Measured:
    """The data with the faults of all their frequency points, used or not, and of modes that rest on one of them."""
    modes, responses = run.modes, list(data.responses)
    for k, frf in enumerate(responses):
        found = [fault for fault in response_faults(frf) if fault not in frf.faults]
        if k == 0 and modes.hz and modes.damping is not None and modes.source is Source.DATA:
            known = {point for fault in found for point in fault.correction.split()}
            omega, damping = 2 * np.pi * np.array(modes.hz), np.array(modes.damping)
            mine = omega <= (frf.omega[-1] if len(responses) > 1 else np.inf)  # others are of other bands
            seen = suspect_modes(frf, omega[mine], damping[mine])
            for fault in seen:
                if not known.issuperset(fault.correction.split()):
                    around.say(str(fault))
                    found.append(fault)
        if found:
            responses[k] = dataclasses.replace(frf, faults=(*frf.faults, *found))
    return data._replace(responses=tuple(responses))


def with_questions(run: RunFile, data: Measured, asked: Modes, around: Surroundings) -> Measured:
    """The data with the delay or lead that the response shows by samples, where poles are chosen and nobody stated a delay."""
    own = run.modes.source is Source.DATA and asked.delay is None and not run.delay.seconds and data.loop is None
    if not own or not data.responses or data.dt is None:
        return data
    frf, read = data.responses[0], data.origins.responses[:1] != (None,)
    held = not read and bool(data.excited) and all(one.held for one in data.excited)
    if (
        any(fault.kind in (FaultKind.LATE, FaultKind.FEEDBACK) for fault in frf.faults)
        or (fault := delay_fault(frf, read, held)) is None
    ):
        return data
    around.say(str(fault))
    first = dataclasses.replace(frf, faults=(*frf.faults, fault))
    return data._replace(responses=(first, *data.responses[1:]))


def box_of_modes(modes: Modes) -> Box | None:
    """The box that data leave to modes, by rising frequency; None where there is none. Real poles (damping 1) have none."""
    if not modes.hz or modes.damping is None or modes.hz_interval is None or modes.damping_interval is None:
        return None
    order = [k for k in np.argsort(modes.hz).tolist() if modes.damping[k] < 1]
    if not order:
        return None
    hz, damping = (np.asarray(ends, dtype=float)[order] for ends in (modes.hz_interval, modes.damping_interval))
    return 2 * np.pi * hz, damping


def box_of(member: MemberChoice) -> Box | None:
    """The pole-uncertainty box of a member, in rad/s; None where it has none."""
    if member.hz_interval is None:
        return None
    return 2 * np.pi * np.array(member.hz_interval), np.array(member.damping_interval)


def held_box(box: Box | None, problem: MixedProblem) -> Box | None:
    """The box, where it goes with the poles of a problem."""
    return box if box is not None and has_box(problem.parametric, len(box[0])) else None


def _from_records(chosen: Modes, records: Sequence[TimeRecord]) -> Modes:
    """The poles of the parametric part from records alone, by a fit of them."""
    rows, words = modes_of_records(records, chosen.count)
    return dataclasses.replace(
        chosen,
        hz=tuple(row.hz for row in rows),
        damping=tuple(row.damping for row in rows),
        count=None,
        delay=1 if chosen.delay is None else chosen.delay,
        source=Source.DATA if rows else Source.PROGRAM,
        note=RECORD_MODES_NOTE + words if rows else words,
    )


def _pairs(intervals: np.ndarray) -> tuple[tuple[float, float], ...]:
    return tuple((float(low), float(high)) for low, high in intervals.tolist())


def basis_of(modes: Modes, dt: float, passive: str | None = None) -> ParametricBasis | None:
    """The Kautz pairs and integrators that the run file states, or the modes beside a passive class; None for none."""
    if passive and (modes.hz or modes.integrators):
        if passive != POSITIVE_REAL or dt:
            what = "is of continuous time" if passive == POSITIVE_REAL else f'is "{POSITIVE_REAL}", of continuous time'
            raise InputError(f"modes have a place beside a passive class only where it {what}; leave them out")
        if modes.integrators:
            raise InputError("integrators have no place beside a passive class: its plants are stable; leave them out")
        return passive_modes(2 * np.pi * np.array(modes.hz), np.array(modes.damping))
    parts = [integrators(modes.integrators, dt=dt)] if modes.integrators else []
    if modes.hz:
        omega = 2 * np.pi * np.array(modes.hz)
        parts.append(kautz(omega, np.array(modes.damping), dt=dt, repeat=modes.repeat, delay=modes.delay or 0))
    return stack_bases(parts) if parts else None


def stated_modes(modes: object) -> dict[str, object]:
    """Keys of the section [modes] for the argument `modes`: pairs (Hz, damping), a fit, or rows of its mode table.

    The poles at z = 1 of a fit become integrators.
    """
    if isinstance(modes, MatrixFraction | RecordFit):
        modes = mode_table(modes if isinstance(modes, MatrixFraction) else modes.model)
    if not is_array(modes):
        raise InputTypeError(
            f"`modes` must be pairs (Hz, damping), a fit, or its mode table; got {type(modes).__name__}"
        )
    if not any(isinstance(row, ModeRow) for row in modes):
        pairs = [_pair(row) for row in modes]
        return {"hz": [hz for hz, _ in pairs], "damping": [damping for _, damping in pairs]}
    rows = [row for row in modes if isinstance(row, ModeRow)]
    rigid = sum(row.count for row in rows if row.rigid)
    rows = [row for row in rows if not row.rigid]
    if bad := [row for row in rows if not 0 < row.damping <= 1 or not row.hz > 0]:
        raise InputError(f"`modes`: the fit has a pole that is not damped, at {hz_words(bad[0].hz)}; leave its row out")
    found: dict[str, object] = {"hz": [row.hz for row in rows], "damping": [row.damping for row in rows]}
    return found | ({"integrators": rigid} if rigid else {})


def _pair(row: Any) -> tuple[float, float]:
    try:
        hz, damping = map(float, row)
    except (TypeError, ValueError):
        raise InputTypeError(f"`modes` must hold pairs (Hz, damping); got {row!r}") from None
    return hz, damping


def _relaxations(frequency: Sequence[FrequencyResponse], kind: str, decay: float | None) -> KautzSuggestion | None:
    """Poles of a response over decades; None where there are none, or the class with its stated decay holds them all itself."""
    if kind != POSITIVE_REAL or not frequency or frequency[0].dt:
        return None
    found = suggest_kautz(frequency[0])
    slow = decay is None or bool(np.any(found.damping * found.omega < decay))
    return found if slow and np.any(found.damping == 1) else None


def with_fit(run: RunFile, data: Measured, around: Surroundings) -> RunFile:
    """The poles of the parametric part from a fit, where one is asked for and they aren't stated; the fit is kept."""
    if run.fit.order is None or run.modes.hz is not None:
        return run
    if not data.responses:
        raise InputError("[fit] needs a frequency response; the run has samples alone. Leave [fit] out")
    frf = data.responses[0]
    try:
        fit, why = _fitted(run, frf, around)
    except InputError as error:
        raise InputError(f"[fit]: {error}") from None
    around.folder.fitted(fit)
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
        f"  {row.hz / size:.5g} {unit} (± {row.hz_std / size:.2g}), damping {row.damping:.3g} (± {row.damping_std:.2g})"
        for row in modes
        for size, unit in [hz_scale(row.hz)]
    ]
    hz_interval, damping_interval = _box(modes) or (None, None)
    found = Modes(
        hz=tuple(row.hz for row in modes),
        damping=tuple(row.damping for row in modes),
        repeat=chosen.repeat,
        integrators=chosen.integrators + rigid,
        delay=chosen.delay if chosen.delay is not None else int(not fit.problem.feedthrough and frf.dt is not None),
        source=Source.DATA,
        note="\n".join([MODES_NOTE + words, *lines]),
        hz_interval=hz_interval,
        damping_interval=damping_interval,
    )
    return dataclasses.replace(run, modes=found).changed("fit", order=len(fit.poles))


def _fitted(run: RunFile, frf: FrequencyResponse, around: Surroundings) -> tuple[MatrixFraction, str]:
    """The fit, and why it has its order."""
    asked, order, why = run.fit.arguments, run.fit.order, ""
    if order == AUTO:
        around.say("fitting a range of orders")
        fitted = {name: value for name, value in asked.items() if name != "time_limit"}
        sweep, _ = orders_fitted(
            frf, fitted, Budget(asked["time_limit"] or _SWEEP, around.told, "fitting a range of orders")
        )
        pass_on(sweep.interrupted)
        order, why = (
            sweep.suggested,
            f", which {sweep.reason} (orders {sweep.orders[0]} to {sweep.orders[-1]} were tried)",
        )
    around.say(f"fitting a matrix fraction of order {order}")
    return fit_mfd(frf, order=int(order or 0), **asked), why


def _usable(row: ModeRow, frf: FrequencyResponse) -> bool:
    """Tell whether a pole is damped and lies where the data say something of it."""
    high = frf.freq_hz.max() if frf.dt is None else 0.5 / frf.dt
    return not row.rigid and 0 < row.damping <= 1 and 0 < row.hz < high


def _box(modes: list[ModeRow]) -> tuple[tuple[tuple[float, float], ...], tuple[tuple[float, float], ...]] | None:
    """The pole-uncertainty box: three standard deviations on either side; none where one isn't known."""
    spread = np.array([(row.hz_std, row.damping_std) for row in modes])
    if not len(spread) or not np.all(np.isfinite(spread)):
        return None
    hz, damping = (np.array([getattr(row, name) for row in modes]) for name in ("hz", "damping"))
    low, high = np.maximum(hz - _DEVIATIONS * spread[:, 0], _LEAST * hz), hz + _DEVIATIONS * spread[:, 0]
    least = np.maximum(damping - _DEVIATIONS * spread[:, 1], _LEAST * damping)
    most = np.minimum(damping + _DEVIATIONS * spread[:, 1], 1.0)
    return _pairs(np.stack([low, high], axis=1)), _pairs(np.stack([least, most], axis=1))


def modes_of_records(
    records: Sequence[TimeRecord], count: int | None = None, seconds: float = _SECONDS
) -> tuple[tuple[ModeRow, ...], str]:
    """Poles that decay slowly, as rows of a mode table, of `count` modes or as many as the bounds ask for; and words on them.
    The order is the first whose output-error fit, from free initial states where the record has them, keeps the samples within
    1.2 times their bounds; else the one of least description length.
    """
    budget = Budget(seconds)
    lengths: dict[int, float] = {}
    fits: dict[int, tuple[RecordFit, float]] = {}
    for order, fit in _fits(records, 2 * count if count else None, budget):
        found = [validate(fit.model, record) for record in records]
        ratio = max(one.ratio or 0.0 for one in found)
        misfit = float(np.sqrt(np.mean([np.square(1 - one.fit) for one in found])))
        samples = sum(record.y.size for record in records)
        free = sum(fit.B.shape) + len(records)
        lengths[order] = 2 * samples * math.log(max(misfit, 1e-300)) + order * free * math.log(samples)
        fits[order] = fit, ratio
        if ratio <= _CLOSE or budget.over:
            break
    if not fits:
        return (), "No parametric part: the records have too few samples for a fit."
    inside = [order for order, (_, ratio) in fits.items() if ratio <= _CLOSE]
    order = min(inside, default=min(lengths, key=lengths.__getitem__))
    fit, ratio = fits[order]
    length = max(len(record.u) for record in records) * fit.dt
    rows = [row for row in mode_table(fit.model) if _tells(row, fit.dt, length)]
    if inside:
        words = (
            f"output error of order {order}, the smallest that keeps every sample within {ratio:.3g} times its bound."
        )
    else:
        words = f"output error of order {order}, of least description length; residuals up to {ratio:.3g} times their bounds."
    lines = [f"  {hz_words(row.hz)}, damping {row.damping:.3g}" for row in rows]
    return tuple(rows), "\n".join([words, *lines])


def _fits(records: Sequence[TimeRecord], only: int | None, budget: Budget) -> Iterator[tuple[int, RecordFit]]:
    """Fits of rising order, as far as the samples go."""
    outputs, inputs = records[0].y.shape[1], records[0].u.shape[1]
    samples = sum(record.y.size for record in records)
    for order in range(1, _MOST_ORDER + 1) if only is None else [only]:
        if _EQUATIONS * order * (outputs + inputs + len(records)) > samples:
            return
        try:
            yield order, fit_records(records, order=order, feedthrough=True, time_limit=budget.seconds)
        except (InputError, np.linalg.LinAlgError):
            continue


def _tells(row: ModeRow, dt: float, length: float) -> bool:
    """Tell whether a pole is damped, decays slower than any fast response, and not much slower than the records last."""
    if row.rigid or not 0 < row.damping <= 1 or not 0 < row.hz < 0.5 / dt:
        return False
    rate = 2 * math.pi * row.hz * row.damping
    return rate * dt < _FAST and rate * length > _SLOW[row.count]
