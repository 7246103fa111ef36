"""A fit as numbers and text, and made from them again: its cost and its realisation are verified anew."""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Sequence
from typing import Any, cast

import numpy as np

from robustid.core import Arrays, Record, Signal, StateMatrices, keep
from robustid.data import Bound, TimeRecord
from robustid.fitting.fit import MatrixFraction
from robustid.fitting.fraction.conditions import Condition, RigidModes
from robustid.fitting.fraction.criterion import Weight
from robustid.fitting.fraction.iteration import FitStatus, FitStep
from robustid.fitting.fraction.model import FractionModel
from robustid.fitting.fraction.node_fraction import Held, NodeFraction
from robustid.fitting.fraction.problem import FractionProblem
from robustid.fitting.fraction.vector_polynomials import VectorPolynomials
from robustid.fitting.modal.modal_structure import Modal
from robustid.fitting.records.record_fit import RecordFit

_CLASSES: dict[str, Any] = {
    cls.__name__: cls
    for cls in (
        Bound,
        Condition,
        FitStep,
        FractionModel,
        FractionProblem,
        Held,
        MatrixFraction,
        Modal,
        NodeFraction,
        RecordFit,
        RigidModes,
        Signal,
        StateMatrices,
        TimeRecord,
        VectorPolynomials,
        Weight,
    )
}
_SAME = 1e-6  # relative difference of a cost or response that was saved from the one evaluated again


def pack(fit: MatrixFraction | RecordFit) -> tuple[Record, Arrays]:
    """Text and numbers of a fit."""
    arrays: Arrays = {}
    return {"fit": _described(fit, "fit", arrays)}, arrays


def unpack(record: Record, arrays: Arrays) -> MatrixFraction:
    """The fit that was packed so; cost and state space are evaluated again."""
    fit = _made(record["fit"], arrays)
    if not isinstance(fit, MatrixFraction):
        raise ValueError("it holds no fit")
    problem = fit.problem
    response = fit.fraction.fitted(fit.fraction.response(problem.omega))
    again, rounding = problem.cost(fit.nodes), problem.rounding
    if fit.modal is not None:  # of the exact modes, from which the fraction was formed
        again = float(np.linalg.norm(problem.residual(response))) ** 2
    if not abs(again - fit.cost) <= _SAME * again + rounding:
        raise ValueError(f"its cost is {again:.6g}, and not {fit.cost:.6g}")
    size = float(np.linalg.norm(fit.nodes.response))
    if not np.linalg.norm(response - fit.nodes.response) <= (_SAME + fit.fraction.error) * size:
        raise ValueError("its state-space model is not that of its fraction")
    return fit


def unpack_records(record: Record, arrays: Arrays) -> RecordFit:
    """The fit of records that was packed so; its outputs are simulated again."""
    fit = _made(record["fit"], arrays)
    if not isinstance(fit, RecordFit):
        raise ValueError("it holds no fit of records")
    again = sum(
        float(np.sum(((one.y - simulated) * fit.weight) ** 2))
        for one, simulated in zip(fit.records, fit.simulated, strict=True)
    )
    size = sum(float(np.sum((one.y * fit.weight) ** 2)) for one in fit.records)
    if not abs(again - fit.record_cost) <= _SAME * again + _SAME**2 * size:
        raise ValueError(f"its cost is {again:.6g}, and not {fit.record_cost:.6g}")
    return fit


def _described(value: Any, path: str, arrays: Arrays) -> Any:
    """The value as JSON can hold it; arrays by their path."""
    if isinstance(value, np.ndarray):
        arrays[path] = value
        return {"$array": path}
    if isinstance(value, np.generic):
        value = cast("Any", value.item())
    if isinstance(value, complex):
        return {"$complex": [value.real, value.imag]}
    if isinstance(value, enum.Enum):
        return {"$status": value.name}
    if type(value).__name__ in _CLASSES:
        return {"$class": type(value).__name__} | {
            name: _described(getattr(value, name), f"{path}/{name}", arrays) for name in _names(type(value))
        }
    if isinstance(value, tuple | list):
        return [_described(item, f"{path}/{k}", arrays) for k, item in enumerate(cast("Sequence[Any]", value))]
    return value


def _made(text: Any, arrays: Arrays) -> Any:
    """The value that was described so; sequences become tuples."""
    if isinstance(text, list):
        return tuple(_made(item, arrays) for item in cast("list[Any]", text))
    if not isinstance(text, dict):
        return text
    if "$array" in text:
        return arrays[text["$array"]]
    if "$complex" in text:
        real, imag = cast("Sequence[float]", text["$complex"])
        return complex(real, imag)
    if "$status" in text:
        return FitStatus[text["$status"]]
    cls = _CLASSES[text["$class"]]
    return cls(**{name: _made(text[name], arrays) for name in _names(cls) if name in text})


def _names(cls: Any) -> tuple[str, ...]:
    return tuple(field.name for field in dataclasses.fields(cls)) if dataclasses.is_dataclass(cls) else cls._fields


keep(MatrixFraction, "matrix fraction", words="fit", pack=pack, unpack=unpack)
keep(RecordFit, "fit of records", pack=pack, unpack=unpack_records)
