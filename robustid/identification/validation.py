"""A model against data it may never have seen: fit, residuals against their bounds, whiteness."""

from __future__ import annotations

import dataclasses
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from robustid.core import (
    Complex,
    Frozen,
    Model,
    Numbers,
    Real,
    Record,
    StateMatrices,
    as_kind,
    as_state_space,
    balanced_scales,
    freeze,
    hz_words,
    lengths,
    model_of,
    one_thread,
    points_of,
    simulate,
)
from robustid.data import FrequencyResponse, TangentialResponse, TimeRecord
from robustid.errors import InputError, InputTypeError
from robustid.identification.residuals import known

_WHITE = 0.01  # a white residual is called coloured in 1 % of the cases
_LAGS = 20
_SAME_DT = 1e-9


@dataclasses.dataclass(frozen=True, eq=False)
class Validation(Frozen):
    """Fit of a model to data, and what it leaves unexplained.

    Attributes
    ----------
    data : TimeRecord, FrequencyResponse or TangentialResponse
        What the model was held against.
    predicted : (T, ny), (F, ny, nu) or (F, l, r) array
        What the model says, in the units of the data.
    residuals : array, same shape
        Measured minus predicted.
    fit : (ny,), (ny, nu) or (l, r) array
        NRMSE fit as a fraction, ``1 - ||y - yhat|| / ||y - mean(y)||`` per output or entry: 1 is perfect, 0 no better
        than the mean, negative worse, nan where nothing was measured. Frequency points whose bound is above every value that
        is above its own are left out: at lines that hardly anything excited, values may be of any size.
    ratio : float or None
        Largest residual in units of its bound, as the bound means it (see `FrequencyResponse.ratio`); None where the data
        have no bound.
    worst : tuple of int, or None
        Index of that sample in `residuals`; of a joint bound (frequency point, 0, input) or (frequency point, 0, 0).
    outside : int or None
        Number of samples (of a joint bound: of columns, or lines) outside their bound.
    whiteness : (ny,) array or None
        Time records: p value of the Ljung-Box test of each residual over 20 lags (fewer in short records).
        Below 0.01 the residual is not white at 99 %: something predictable is left. nan where it can't be
        tested.
    """

    data: TimeRecord | FrequencyResponse | TangentialResponse
    _: dataclasses.KW_ONLY
    predicted: Numbers
    residuals: Numbers
    fit: Real
    ratio: float | None = None
    worst: tuple[int, ...] | None = None
    outside: int | None = None
    whiteness: Real | None = None

    def __post_init__(self) -> None:
        for name in ("predicted", "residuals", "fit", "whiteness"):
            value = getattr(self, name)
            self._set(**{name: None if value is None else freeze(value)})

    def summary(self) -> str:
        """A few lines of text for people."""
        data, time = self.data, isinstance(self.data, TimeRecord)
        axis, unit = (data.time, "s") if isinstance(data, TimeRecord) else (data.freq_hz, "Hz")
        samples = self.residuals.shape[0]
        lines = [f"validation on {samples} {'samples' if time else 'frequencies'}"]
        for index in np.ndindex(self.fit.shape):
            residuals = self.residuals[(slice(None), *index)][_used(data)[(slice(None), *index)]]
            if not residuals.size:
                lines.append(f"  {self._place(index)}: not measured")
                continue
            largest = np.max(np.abs(residuals))
            line = f"  {self._place(index)}: fit {100 * self.fit[index]:.2f} %, largest |residual| {largest:.3g}"
            if self.whiteness is not None and np.isfinite(self.whiteness[index]):
                p = self.whiteness[index]
                line += f", residual {'white' if p >= _WHITE else 'not white'} (Ljung-Box p = {p:.2g})"
            lines.append(line)
        if self.ratio is None or self.worst is None:
            lines.append("  the data have no bound to hold the residuals against")
        else:
            where = f"{axis[self.worst[0]]:.6g} {unit}"
            verdict = f"{self.outside} outside" if self.outside else "all inside"
            lines.append(f"  largest |residual|/bound {self.ratio:.4g} at {where} (index {self.worst}); {verdict}")
        return "\n".join(lines)

    def _place(self, index: tuple[int, ...]) -> str:
        data = self.data
        if isinstance(data, TimeRecord):
            return str(data.outputs[index[0]])
        if isinstance(data, FrequencyResponse):
            return f"{data.inputs[index[1]]} -> {data.outputs[index[0]]}"
        return f"direction {index[1] + 1} -> sensor {index[0] + 1}"


@one_thread()
def validate(model: object, data: TimeRecord | FrequencyResponse | TangentialResponse) -> Validation:
    """Hold a model against a time record, a frequency response or a response in directions.

    Parameters
    ----------
    model : control.StateSpace or TransferFunction, scipy.signal's lti or dlti, or a result that has a model
        Discrete with the dt of the data, or continuous for a frequency response without dt. Of an Identification, a
        MatrixFraction, a Reduction and other results their `model` is taken.
    data : TimeRecord, FrequencyResponse or TangentialResponse
        A time record is simulated as its `initial` says: from zero initial conditions; from the initial state that fits best
        (least squares, each sample weighted by 1/bound, else each output by its size); or in periodic steady
        state. Samples with an infinite bound count nowhere.

    Returns
    -------
    Validation

    Raises
    ------
    InputError, InputTypeError
        If dt or the numbers of inputs or outputs differ, if an unstable model has no periodic steady state or its
        simulation overflows, or if a frequency point lies on a pole.

    References
    ----------
    Ljung and Box 1978 for the whiteness test (no degrees of freedom are taken off for fitted parameters: the
    model may come from other data).

    Examples
    --------
    >>> import control, numpy as np, robustid as rid
    >>> model = control.ss(0.5, 1.0, 1.0, 0.0, 0.01)
    >>> record = rid.TimeRecord(np.ones(4), [0.0, 1.0, 1.5, 1.8], dt=0.01, bound=0.1)
    >>> validation = rid.validate(model, record)
    >>> round(validation.ratio, 6), validation.outside
    (0.5, 0)
    """
    system = check_model("model", model)
    kinds = TimeRecord, FrequencyResponse, TangentialResponse
    as_kind("data", data, kinds, "a TimeRecord, FrequencyResponse or TangentialResponse")
    if isinstance(data, TimeRecord):
        measured, shape = data.y, (data.y.shape[1], data.u.shape[1])
    else:
        measured, shape = data.values, (len(data.outputs), len(data.inputs))
    if (system.noutputs, system.ninputs) != shape:
        raise InputError(
            f"`model` must have the {shape[0]} outputs and {shape[1]} inputs of `data`;"
            f" got {system.noutputs} and {system.ninputs}"
        )
    _check_time_base(system, data)
    predicted = _simulate_record(system, data) if isinstance(data, TimeRecord) else _evaluate(system, data)
    residuals = measured - predicted
    used = _used(data)
    result: Record = {}
    if data.bound is not None:
        ratios = data.ratio(residuals)
        worst = tuple(int(i) for i in np.unravel_index(np.argmax(ratios), ratios.shape))
        result.update(ratio=float(ratios[worst]), worst=worst, outside=int(np.sum(ratios > 1)))
    if isinstance(data, TimeRecord):
        result["whiteness"] = np.array([_ljung_box(residuals[:, i], used[:, i]) for i in range(shape[0])])
    counted = known(data) if isinstance(data, FrequencyResponse) and data.bound is not None else used
    fit = _fit(measured, residuals, counted)
    return Validation(data, predicted=predicted, residuals=residuals, fit=fit, **result)


def check_model(name: str, model: object) -> Model:
    """Return a finite `control.StateSpace` whose time base is known, of a model in any form or of a result that has one."""
    model = as_state_space(name, model_of(model))
    if not _is_state_space(model):
        if hasattr(model, "frdata"):
            raise InputTypeError(
                f"`{name}` must be a control.StateSpace; got a frequency response. Give the model that it is the response of, or"
                " one that fits it, fit_mfd(...).model; that of a controller is prepare.controller_model(response)"
            )
        raise InputTypeError(
            f"`{name}` must be a control.StateSpace or TransferFunction, or a result that has a model; got {type(model).__name__}"
        )
    for letter in "ABCD":
        if not np.all(np.isfinite(getattr(model, letter))):
            raise InputError(f"`{name}` must be finite; its matrix {letter} holds NaN or infinite values")
    if model.dt is None and model.nstates:
        raise InputError(f"`{name}` has dt = None: say what it is, dt=0 for continuous time or the sample time in s")
    return model


def as_system(name: str, model: Any) -> tuple[StateMatrices, float | None]:
    """The matrices of a model, its states balanced, and its time base; None of a static gain."""
    found = check_model(name, model)
    system = balanced_scales(StateMatrices.of(found))
    return system, found.dt if len(system.A) else None


def _is_state_space(model: object) -> TypeGuard[Model]:
    import control

    return isinstance(model, control.StateSpace)


def describe_poles(poles: Numbers, dt: float | None) -> str:
    """A few poles in words: Hz and 1/s, or |z| where the sample time is unknown."""
    words = [_describe_pole(pole, dt) for pole in poles if pole.imag >= 0]
    more = f" and {len(words) - 4} more" if len(words) > 4 else ""
    return f"pole{'s' * (len(words) > 1)} at " + ", ".join(words[:4]) + more


def _describe_pole(pole: complex, dt: float | None) -> str:
    if dt is not True and dt and pole == 0:
        return "z = 0"
    exponent = complex(pole) if not dt else complex(np.log(complex(pole) or 1e-300)) / (1.0 if dt is True else dt)
    if dt is True:
        return f"z = {complex(pole):.6g}"
    rate = f"real part {exponent.real:+.3g} 1/s"
    text = f"{hz_words(exponent.imag / (2 * np.pi), 4)} ({rate})" if exponent.imag else f"0 Hz ({rate})"
    return text if not dt else f"{text[:-1]}, |z| = {abs(pole):.9g})"


def _check_time_base(model: Model, data: TimeRecord | FrequencyResponse | TangentialResponse) -> None:
    if not model.nstates or (model.dt is True and data.dt is not None):
        return
    if data.dt is None:
        if model.dt != 0:
            raise InputError(
                f"`model` is discrete (dt = {model.dt}), `data` has no dt: give the FrequencyResponse its"
                " `dt`, or a continuous model (to_continuous)"
            )
    elif model.dt == 0:
        raise InputError(
            f"`model` is continuous, `data` is sampled with dt = {data.dt:g} s: discretise the model first,"
            f" control.sample_system(model, {data.dt:g})"
        )
    elif abs(model.dt - data.dt) > _SAME_DT * data.dt:
        raise InputError(f"`model` has dt = {model.dt:g} s, `data` has dt = {data.dt:g} s; they must agree")


def _evaluate(model: Model, data: FrequencyResponse | TangentialResponse) -> Complex:
    values = np.moveaxis(model(points_of(data.omega, data.dt), squeeze=False, warn_infinite=False), -1, 0)
    bad = ~np.all(np.isfinite(values), axis=(1, 2))
    if np.any(bad):
        raise InputError(
            f"`model` has a pole at the frequency {data.freq_hz[bad][0]:g} Hz of `data`: remove this point (data.select)"
        )
    return values if isinstance(data, FrequencyResponse) else data.left @ values @ data.right


def _simulate_record(model: Model, data: TimeRecord) -> Real:
    start = np.zeros(int(model.nstates))
    if data.initial == "periodic":
        start = _periodic_state(model, data)
    predicted, _ = simulate(model, data.u, start)
    if data.initial == "free" and model.nstates:
        predicted = predicted + _free_response(model, data, data.y - predicted)
    if not np.all(np.isfinite(predicted)):
        poles = model.poles()
        raise InputError(
            f"`model` is unstable, with {describe_poles(poles[np.abs(poles) > 1], model.dt)}: its response"
            " overflows within the record. Use a shorter record or a stable model"
        )
    return predicted


def _periodic_state(model: Model, data: TimeRecord) -> Real:
    """The state to which one period returns: x = A^T x + (state after one period from zero)."""
    poles = model.poles()
    outside = np.abs(poles) >= 1 - 1e-12
    if np.any(outside):
        raise InputError(
            "`model` must be stable to have a periodic steady state; it has"
            f' {describe_poles(poles[outside], model.dt)}. Pass the record with initial="free" instead'
        )
    _, after = simulate(model, data.u, np.zeros(int(model.nstates)))
    one_period = np.linalg.matrix_power(model.A, data.u.shape[0])
    return np.asarray(np.linalg.solve(np.eye(model.nstates) - one_period, after), dtype=float)


def _free_response(model: Model, data: TimeRecord, missing: Real) -> Real:
    """The free response nearest to `missing`."""
    samples, outputs = missing.shape
    rows, power = model.C[None], model.A
    with np.errstate(over="ignore", invalid="ignore"):
        while rows.shape[0] < samples:  # rows[k] = C A^k, doubled each time
            rows = np.concatenate([rows, rows @ power])
            power = power @ power
    rows = rows[:samples]
    if not (np.all(np.isfinite(rows)) and np.all(np.isfinite(missing))):
        return np.full(missing.shape, np.inf)
    if data.bound is not None:
        weight = 1 / data.bound.radius
    else:
        size = np.sqrt(np.mean(data.y**2, axis=0))
        weight = np.broadcast_to(1 / np.where(size > 0, size, 1.0), missing.shape)
    left: Real = (rows * weight[:, :, None]).reshape(samples * outputs, -1)
    scale = lengths(left)
    state = np.linalg.lstsq(left / scale, (missing * weight).ravel(), rcond=None)[0] / scale
    return rows @ state


def _used(data: TimeRecord | FrequencyResponse | TangentialResponse) -> NDArray[np.bool_]:
    """Mask of the samples that count: those of a finite bound, or all."""
    return data.used if isinstance(data, TimeRecord) else ~data.missing


def _fit(measured: Numbers, residuals: Numbers, used: NDArray[np.bool_]) -> Real:
    count = np.sum(used, axis=0)
    mean = np.sum(np.where(used, measured, 0), axis=0) / np.maximum(count, 1)
    rest = np.linalg.norm(np.where(used, residuals, 0), axis=0)
    size = np.linalg.norm(np.where(used, measured - mean, 0), axis=0)
    # A constant signal has nothing to explain: perfect if it is met, else infinitely bad.
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(count == 0, np.nan, np.where(rest == 0, 1.0, 1 - rest / size))


def _ljung_box(residual: Numbers, used: NDArray[np.bool_]) -> float:
    """P value of the hypothesis that the residual is white."""
    count = int(np.sum(used))
    lags = min(_LAGS, count // 5)
    if lags == 0:
        return np.nan
    centred = np.where(used, residual - np.mean(residual[used]), 0.0)
    power = centred @ centred
    if power == 0:
        return np.nan
    correlation = np.array([centred[k:] @ centred[:-k] for k in range(1, lags + 1)]) / power
    statistic = count * (count + 2) * np.sum(correlation**2 / (count - np.arange(1, lags + 1)))
    return float(chdtrc(lags, statistic))
