"""Proof files on arcs with answers known by hand, and those of random bands and controllers."""

import functools
import json
from typing import Any

import control
import numpy as np

import robustid as rid
from robustid.guarantees import Band, LoopBounds, proof_text
from support.proofs import problem, sealed

GAIN, RATE = 1.0, 4.0
Functions = tuple[list[list[float]], list[float], list[list[float]], list[float]]


def by_hand(
    kind: str, functions: Functions, bound: float, *, gain: float = GAIN, arcs: int = 16, edges: list[str] | None = None
) -> str:
    """A statement on the whole axis about all F with |F| <= `gain` that are analytic outside of 1/4; a sample that says nothing.

    Seen from its own zeta the value of phi is a mean: the radius at a knot is `gain`.
    """
    omega = [*map(repr, np.linspace(0, np.pi, arcs + 1)[:-1].tolist()), "half"] if edges is None else edges
    omega = ["0" if one == "0.0" else one for one in omega]
    angles = [np.pi if one == "half" else float(one) for one in omega]
    A, B, C, D = functions
    text = {"A": _texts(A), "B": _texts([B])[0], "C": _texts(C), "D": _texts([D])[0]}
    said = {"kind": kind, "functions": text, "edges": omega, "bounds": [repr(bound)] * (len(omega) - 1)}
    question = {
        "class": {
            "gain_bound": repr(gain),
            "decay_rate": repr(RATE),
            "functions": {"A": [], "B": [], "C": [], "D": []},
        },
        "sample_time": "1",
        "units": {"frequency": "rad/s", "time": "s", "response": "m/N"},
        "level": "1",
        "data": [["1", "0", "0", "100"]],
        "records": [],
        "statements": [said],
    }
    bases = [complex(np.exp(-1j * one)) / RATE for one in angles]
    knots = [{"base": [repr(one.real), repr(one.imag)], "factors": [], "multipliers": []} for one in bases]
    none = {"centre": [], "radius": [], "combinations": []}
    return sealed(question, {"powers": 0, "parameters": none, "statements": [{"knots": knots}]})


def _texts(rows: list[list[float]]) -> list[list[str]]:
    return [[repr(one) for one in row] for row in rows]


def constants(*values: float) -> Functions:
    """Functions without states."""
    return [], [], [[] for _ in values], list(values)


def polynomials(*rows: list[float]) -> Functions:
    """Polynomials in 1/z, of one degree."""
    count = len(rows[0]) - 1
    A = np.eye(count, k=-1).tolist()
    return A, np.eye(1, count)[0].tolist(), [row[1:] for row in rows], [row[0] for row in rows]


@functools.cache
def band_with_model(seed: int, lines: int = 8) -> Band:
    """A band of a random problem around a small model."""
    posed = problem(seed, lines)
    model = rid.identify(posed).model
    small = rid.balanced_truncation(model, order=min(4, model.nstates)).model
    return rid.band(posed, model=small, omega=posed.frequency[0].omega[:1])


def controller_for(band: Band) -> control.StateSpace:
    """A controller small enough to stabilise: with integral action where the sign of the static gain is known."""
    one, dt = band.bands[0], float(band.problem.dt or 1.0)
    size, static = float(np.max(np.abs(one.centre) + one.radius)), float(one.centre[0].real)
    if one.radius[0] < abs(static):
        return control.ss([[1.0]], [[1.0]], [[0.02 * np.sign(static) / size]], [[0.1 / size]], dt)
    return control.ss([], [], [], 0.5 / size, dt)


@functools.cache
def loop_of(seed: int) -> LoopBounds:
    band = band_with_model(seed)
    return rid.loop_bounds(band, controller=controller_for(band))


def statement_of(text: str, place: int = -1) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(text)["question"]["statements"][place]
    return found


def shortened(text: str, first: int, arcs: int) -> str:
    """The last statement of a file alone, of some of its arcs (kind arcs)."""
    whole = json.loads(text)
    question, evidence = whole["question"], whole["evidence"]
    said, knots = question["statements"][-1], evidence["statements"][-1]["knots"]
    said["edges"], said["bounds"] = said["edges"][first : first + arcs + 1], said["bounds"][first : first + arcs]
    question["statements"], evidence["statements"] = [said], [{"knots": knots[first : first + arcs + 1]}]
    return sealed(question, evidence)


@functools.cache
def small_proofs() -> tuple[str, ...]:
    """Files on arcs that a judge in fractions reads in little time."""
    text = proof_text(band_with_model(1))
    middle = len(statement_of(text)["bounds"]) // 2
    return (
        shortened(text, middle, 2),
        by_hand("arcs", constants(-0.5, 1.0), 1.51, arcs=8),
        by_hand("arcs", polynomials([0.5, 0.0], [0.25, 0.0], [1.0, 0.2]), 1.0, arcs=8),
        by_hand("loop", polynomials([1.0, -0.5], [0.2, 0.1], [1.0, -0.5]), 2.6, gain=0.5, arcs=8),
    )
