"""Starts of a fit of records: poles and shapes from their frequency response, and from a longer difference equation."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Sequence

import numpy as np
import scipy.linalg

from robustid.core import Budget, Real, StateMatrices, balancing, lengths, points_of
from robustid.data import FrequencyResponse, TimeRecord
from robustid.errors import InputError
from robustid.estimation import response_alone
from robustid.fitting.fraction.householder import triangle
from robustid.fitting.state_space.given_poles import reflected
from robustid.fitting.state_space.subspace import subspace_estimate

_LINES = 400  # of an estimated response: more make no better start
_LENGTHS = (1, 2, 4)  # times the order: lengths of the difference equations
_EQUATIONS = 2  # for one unknown of a difference equation, at least
_HORIZON = 400  # samples of the Gramians


def starts(
    records: Sequence[TimeRecord], frf: FrequencyResponse | None, order: int, feedthrough: bool, budget: Budget
) -> Iterator[tuple[Real, Real]]:
    """A and C of stable models, one after the other; the first whatever the time."""
    found = False
    for make in (_differences(records, order), _responses(records, frf, order, feedthrough, budget)):
        for A, C in make:
            found = True
            yield A, C
            if budget.over:
                return
    if not found:
        raise InputError(
            f"`records` are too short for a first model of `order` = {order}; lower the order, give longer records or a `start`"
        )


def _responses(
    records: Sequence[TimeRecord], frf: FrequencyResponse | None, order: int, feedthrough: bool, budget: Budget
) -> Iterator[tuple[Real, Real]]:
    """Subspace estimates from the response that is given, and from that of the records."""
    responses = [] if frf is None else [frf]
    longest = max(len(record.u) for record in records)
    with contextlib.suppress(InputError):  # too short, or inputs that don't tell the entries apart
        responses.append(response_alone([record for record in records if len(record.u) == longest]))
    for response in responses:
        response = response.select(~np.any(response.missing, axis=(1, 2)))
        if not response.omega.size:
            continue
        response = response.select(slice(None, None, math.ceil(response.omega.size / _LINES)))
        for weight in _weights(response):
            try:
                one = subspace_estimate(
                    response.values,
                    points_of(response.omega, records[0].dt),
                    order,
                    weight=weight,
                    feedthrough=feedthrough,
                    domain="z",
                    budget=budget,
                )
            except (InputError, np.linalg.LinAlgError):
                continue
            yield one.A, one.C


def _weights(response: FrequencyResponse) -> list[Real | None]:
    """Relative; the inverse standard deviation, where it is known."""
    weights: list[Real | None] = [None]
    if response.covariance is not None:
        _, ny, nu = response.values.shape
        variance = np.einsum("fii->fi", response.covariance).real.reshape(-1, nu, ny).transpose(0, 2, 1)
        if np.all(variance > 0):
            weights.append(1 / np.sqrt(variance))
    return weights


def _differences(records: Sequence[TimeRecord], order: int) -> Iterator[tuple[Real, Real]]:
    """Difference equations ``y(t) + sum_i A_i y(t-i) = sum_i B_i u(t-i)`` by least squares, reduced by balancing."""
    ny, nu = records[0].y.shape[1], records[0].u.shape[1]
    tried: set[int] = set()
    for times in _LENGTHS:
        length = times * math.ceil(order / ny)
        equations = sum(max(len(record.u) - length, 0) for record in records)
        most = equations // (_EQUATIONS * (ny + nu))
        length = min(length, most)
        if length * ny < order or length in tried:
            continue
        tried.add(length)
        model = _reduced(_difference_equation(records, length), order)
        if model is not None:
            yield model


def _difference_equation(records: Sequence[TimeRecord], length: int) -> StateMatrices:
    """In the state space of its observer form."""
    ny, nu = records[0].y.shape[1], records[0].u.shape[1]
    rows: list[np.ndarray] = []
    right: list[np.ndarray] = []
    for record in records:
        samples = len(record.u)
        if samples <= length:
            continue
        shifts = [-record.y[length - i : samples - i] for i in range(1, length + 1)]
        shifts += [record.u[length - i : samples - i] for i in range(length + 1)]
        rows.append(np.hstack([*shifts, np.ones((samples - length, 1))]))
        right.append(record.y[length:])
    regressors = np.concatenate(rows)
    size = lengths(regressors)
    R, unknowns = triangle(np.hstack([regressors / size, np.concatenate(right)])), size.size
    theta = np.linalg.lstsq(R[:, :unknowns], R[:, unknowns:], rcond=None)[0] / size[:, None]
    past = theta[: length * ny].reshape(length, ny, ny).transpose(0, 2, 1)
    drive = theta[length * ny : -1].reshape(length + 1, nu, ny).transpose(0, 2, 1)
    A = np.eye(length * ny, k=ny)
    A[:, :ny] = -past.reshape(-1, ny)
    B = (drive[1:] - past @ drive[0]).reshape(-1, nu)
    return StateMatrices(A, B, np.eye(ny, length * ny), drive[0])


def _reduced(model: StateMatrices, order: int) -> tuple[Real, Real] | None:
    """A and C of the leading part of the balanced model, Gramians over a finite horizon; stable."""
    A, B, C, _ = model
    try:
        seen, reached = _krylov(A.T, C.T), _krylov(A, B)
        both = balancing(seen, reached)
        if len(both.hankel) < order or not both.hankel[order - 1] > 1e-12 * both.hankel[0]:
            return None
        small, _, outputs = both.truncated(A, B, C, order)
        T, Z = scipy.linalg.schur(small, output="real")[:2]
    except (np.linalg.LinAlgError, ValueError):
        return None
    return reflected(T, np.zeros(0), "z"), outputs @ Z


def _krylov(A: Real, B: Real) -> Real:
    """A square factor of ``sum_t A^t B B' A'^t`` over the horizon."""
    parts = [B]
    for _ in range(_HORIZON):
        parts.append(A @ parts[-1])
        if not np.all(np.isfinite(parts[-1])):
            raise ValueError("an unstable equation, beyond the range of numbers")
    return np.asarray(np.linalg.qr(np.hstack(parts).T, mode="r")).T
