"""Tables as CSV: poles of a model, bounds at every frequency, the verdict of an identification."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from robustid.core import Complex


def poles(model: Any, name: str) -> str:
    """Return the poles of a model: in Hz with damping ratio, and as complex numbers."""
    found: Complex = np.array(model.poles(), dtype=complex)
    with np.errstate(divide="ignore"):
        s: Complex = np.log(found) / model.dt if model.dt else found
    size = np.abs(s)
    damping = -s.real / np.where(size > 0, size, 1)
    order = np.lexsort((found.imag, size))
    rows = [(size[k] / (2 * np.pi), damping[k], found[k].real, found[k].imag) for k in order]
    return _text(("frequency [Hz]", "damping ratio", "real", "imag"), rows)


def bounds(error: Any, name: str) -> str:
    """Return the model and the bounds of its error at every frequency, a row for each entry."""
    upper, lower = error.upper, error.lower
    nominal = error.nominal.reshape(upper.shape)
    problem = error.identification.problem
    rows: list[tuple[Any, ...]] = []
    for k, i, j in np.ndindex(upper.shape):
        value = nominal[k, i, j]
        of = error.omega[k] / (2 * np.pi), str(problem.outputs[i]), str(problem.inputs[j])
        rows.append((*of, value.real, value.imag, upper[k, i, j], lower[k, i, j]))
    heads = ("frequency [Hz]", "output", "input", "real", "imag", "guaranteed error", "reached error")
    return _text(heads, rows)


def verdict(identification: Any, name: str) -> str:
    """Return status, margin, order, class and checks."""
    prior = identification.problem.prior
    rows = [
        ("status", identification.status.value),
        ("margin, proved from below", identification.margin_lower),
        ("margin, reached", identification.margin),
        ("order of the model", identification.order),
        ("gain bound K", prior.gain_bound),
        ("decay rate rho" if identification.problem.dt else "decay alpha [1/s]", prior.rate),
        ("samples", identification.problem.samples),
    ]
    rows += [(f"check: {one.name}", "holds" if one.holds else "fails") for one in identification.verification.checks]
    return _text(("what", "value"), rows)


def _text(heads: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(heads)
    for row in rows:
        writer.writerow([f"{cell:.17g}" if isinstance(cell, float) else cell for cell in row])
    return out.getvalue()
