"""Cells of a pole-uncertainty box in ball arithmetic: those that cover their poles are told from those that fall short by 1e-8."""

import dataclasses
from typing import Any

import numpy as np
import pytest

import robustid as rid
from robustid.guarantees import PoleCell
from robustid.guarantees.exact_cells import relaxed_enough
from support.pairwise import every_one
from support.pole_cells import drawn_cell

pytest.importorskip("flint", reason="python-flint is not installed: robustid[exact]")

DT = 0.01
OMEGA = np.array([0.0, 30.0, 100.0, np.pi / DT])


def problem_of(shape: tuple[int, ...]) -> rid.MixedProblem:
    """Frequency points and a record; their values don't matter here."""
    ny, nu = shape or (1, 1)
    omega = 2 * np.pi * np.linspace(1, 45, 12)
    frf = rid.FrequencyResponse(omega, np.ones((12, ny, nu), complex), bound=0.1, dt=DT)
    record = rid.TimeRecord(np.ones((20, nu)), np.ones((20, ny)), dt=DT, bound=0.1)
    return rid.MixedProblem(frequency=frf, time=record, prior=rid.Prior(gain_bound=1.0, decay_rate=1.2))


@pytest.mark.parametrize(
    ("width", "delay", "shape"), every_one([0.0, 1e-11, 1e-3, 0.1, 0.3], [(0, ()), (1, (2, 2)), (2, (1, 3))])
)
def test_cells_cover_their_poles(width: float, delay: int, shape: tuple[int, ...]) -> None:
    """Five drawn cells of every width, delay and shape: all of them."""
    rng = np.random.default_rng(delay)
    assert all(
        relaxed_enough(drawn_cell(rng, width, delay=delay, shape=shape), problem_of(shape), OMEGA) for _ in range(5)
    )


def fallen_short(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """Numbers of cells that are smaller by a part of 1e-8."""
    whole: Any = getattr(PoleCell, name)
    monkeypatch.setattr(PoleCell, name, lambda *arguments: (1 - 1e-8) * whole(*arguments))


@pytest.mark.parametrize("name", ["intervals", "remainder", "impulse_remainder"])
def test_numbers_that_fall_short_are_found(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    cell = drawn_cell(np.random.default_rng(3), 0.1, delay=1, shape=(2, 2))
    fallen_short(monkeypatch, name)
    assert not relaxed_enough(cell, problem_of((2, 2)), OMEGA)


def test_a_radius_that_leaves_out_a_corner_is_found() -> None:
    cell = drawn_cell(np.random.default_rng(3), 0.1, delay=1, shape=())
    radius = np.array(cell.radius)
    radius[1] *= 1 - 1e-8
    short = dataclasses.replace(cell)
    short.__dict__["radius"] = radius
    assert relaxed_enough(cell, problem_of(()), OMEGA)
    assert not relaxed_enough(short, problem_of(()), OMEGA)
