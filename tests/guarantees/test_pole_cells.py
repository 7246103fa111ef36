"""Cells of a pole-uncertainty box: expansions against drawn poles, relaxations against drawn plants."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.guarantees import PoleCell
from robustid.identification.formulation import ExactFormulation
from support.cases import slow
from support.pairwise import every_one
from support.pole_cells import drawn_cell, drawn_poles, expansion, functions_at, impulse_of, modes_at
from support.structure import about_structure

DT = 0.01
TIMES = [{"dt": DT, "delay": 0}, {"dt": DT, "delay": 1}, {"dt": DT, "delay": 2}, {"dt": 0.0}]


@pytest.mark.parametrize(("dt", "width"), every_one([DT, 0.0], [1e-11, 0.01, 0.1, 0.3]))
def test_the_radius_covers_the_box(width, dt):
    rng, largest = np.random.default_rng(0), 0.0
    for _ in range(20):
        cell = drawn_cell(rng, width, dt=dt)
        for _ in range(50):
            ratio = np.abs(drawn_poles(cell, rng) - cell.middle) / cell.radius
            assert ratio.max() <= 1
            largest = max(largest, float(ratio.max()))
    assert largest >= (0.7 if width > 1e-3 else 0.05)  # there the allowance for rounding is a part of it


@pytest.mark.parametrize("time", TIMES, ids=str)
def test_a_mode_in_the_cell_is_a_repeated_pair_and_a_small_remainder(time):
    """Coefficients within the intervals leave no more than the remainder: on the circle or axis, and in the impulse response."""
    rng, tightest = np.random.default_rng(time.get("delay", 0)), 0.0
    for _ in range(10 if time["dt"] else 20):
        cell = drawn_cell(rng, 0.15, **time)
        poles = drawn_poles(cell, rng)
        c = cell.amplitude * np.exp(2j * np.pi * rng.uniform(size=poles.size))
        ends, p = cell.intervals(), expansion(cell, c, poles)
        allowed = np.abs(ends) * (1 + 1e-12)
        assert np.all((-allowed[:, 0] <= p) & (p <= allowed[:, 1]))
        top, turns = (np.pi / DT, np.angle(poles) / DT) if cell.dt else (100.0, poles.imag)
        omega = np.concatenate([np.linspace(0, top, 300), turns])
        left = np.abs(modes_at(cell, omega, c, poles) - functions_at(cell, omega) @ p)
        bound = cell.remainder(omega).sum(axis=1)
        assert np.all(left <= bound * (1 + 1e-9) + 1e-12)
        tightest = max(tightest, float((left / bound).max()))
        if cell.dt:
            rest = np.abs(impulse_of(cell, c, poles, 400) - cell.basis().impulse(400) @ p)
            assert np.all(rest <= cell.impulse_remainder(400).sum(axis=1) * (1 + 1e-9) + 1e-12)
        else:
            assert np.all(cell.remainder(np.array([np.inf])) == 0)
    assert tightest >= 0.05


@pytest.mark.parametrize("time", [slow(TIMES[0]), slow(TIMES[1]), *TIMES[2:]], ids=str)
def test_plants_with_poles_in_the_cell_solve_its_relaxed_problem(time):
    """Thirty drawn plants each, measured with errors at the limit and against the expansion, on tilted lines and in records."""
    rng, needed, count = np.random.default_rng(10 + time.get("delay", 0)), 0, 25
    for _ in range(30):
        cell = drawn_cell(rng, 0.1 * rng.uniform(), **time)
        poles = drawn_poles(cell, rng)
        c = cell.amplitude * rng.choice([1.0, rng.uniform()]) * np.exp(2j * np.pi * rng.uniform(size=poles.size))
        gain, g = 0.3, rng.uniform(-1, 1)  # the rest is a constant: K g, of the coefficients g c
        drawn, turns = (
            (rng.uniform(0.2, 3, 12) / DT, np.angle(poles) / DT) if cell.dt else (rng.uniform(2, 60, 12), poles.imag)
        )
        omega = np.sort(np.concatenate([drawn, turns]))
        p, truth = expansion(cell, c, poles), modes_at(cell, omega, c, poles)
        u = rng.uniform(-1, 1, count) if cell.dt else None
        phases = omega * (cell.dt or 1.0)
        bound, tilt = rng.uniform(0.01, 0.1, omega.size), 0.8 * rng.uniform(size=omega.size) * np.exp(7j * phases)
        left = truth - functions_at(cell, omega) @ p
        left = left + tilt * left.conj()
        pushed = bound * np.exp(1j * np.angle(left))  # any direction where nothing is left
        error = (pushed - tilt * pushed.conj()) / (1 - np.abs(tilt) ** 2)
        frf = rid.FrequencyResponse(
            omega, truth + gain * g + error, bound=rid.Bound(bound, tilt=tilt), dt=cell.dt or None
        )
        record, prior = None, rid.Prior(gain_bound=gain, decay=1.3)
        if cell.dt:
            h, prior = impulse_of(cell, c, poles, count), rid.Prior(gain_bound=gain, decay_rate=1.3)
            rest = np.convolve(u, h - cell.basis().impulse(count) @ p)[:count]
            y = np.convolve(u, h)[:count] + gain * g * u + 0.02 * np.sign(rest)
            record = rid.TimeRecord(u, y, dt=DT, bound=0.02)
        relaxed = cell.relaxed(rid.MixedProblem(frequency=frf, time=record, prior=prior))
        data = ExactFormulation(relaxed).data
        scaled = p * data.rows.column_scale
        assert data.rows.within(scaled)
        ratio = data.rows.ratio(g * data.sarason.pair.c[0], scaled)
        assert ratio.max() <= 1 + (1e-11 if cell.dt else 1e-10)
        old = [
            frf.bound.ravel()[np.isin(frf.omega, relaxed.frequency[0].omega)],
            *(t.bound.ravel() for t in [record] if t),
        ]
        wider = [relaxed.frequency[0].bound.ravel(), *(t.bound.ravel() for t in relaxed.time)]
        needed += np.max(ratio * np.concatenate(wider) / np.concatenate(old)) > 1 + 1e-6
    assert needed >= 26


def test_halves_cover_a_cell_and_do_not_refute_the_truth():
    """Splitting three times towards the truth: its relaxation is consistent, and it stays in one half."""
    data = rid.datasets.flexible_structure(seed=3, extra_hz=np.linspace(17.2, 18.1, 10))
    problem = about_structure(data, 0.1, 1.2, time=True)
    whole = PoleCell(
        data.modes[:, :1] * [0.97, 1.04], data.modes[:, 1:] * [0.6, 1.5], np.array([0.6, 0.1]), delay=1, dt=DT
    )
    assert rid.identify(problem).consistent
    for _ in range(3):
        halves = whole.split(problem, whole.widest(problem, problem.frequency[0].omega))
        inside = [np.all((h.omega[:, 0] <= data.modes[:, 0]) & (data.modes[:, 0] <= h.omega[:, 1])) for h in halves]
        inside = [
            a and np.all((h.damping[:, 0] <= data.modes[:, 1]) & (data.modes[:, 1] <= h.damping[:, 1]))
            for a, h in zip(inside, halves, strict=True)
        ]
        assert any(inside)
        whole = halves[inside.index(True)]
        relaxed = whole.relaxed(problem)
        assert ExactFormulation(relaxed).data.rows.ends.shape == (12, 2)
        assert rid.identify(relaxed).margin <= 1


def test_halves_of_halves_cover_the_box_and_nothing_less_does():
    """Thirty boxes of one to three modes in twelve cells: every one of them is needed, up to its ends."""
    rng = np.random.default_rng(0)
    for _ in range(30):
        modes = rng.integers(1, 4)
        low = rng.uniform(1, 2, (2, modes, 1))
        box = PoleCell(low[0] * [1, 1.5], low[1] * [0.1, 0.2], np.ones(modes), 1, 0.01)
        cells = [box]
        while len(cells) < 12:
            cell = cells.pop(rng.integers(len(cells)))
            name, mode = rng.choice(["omega", "damping"]), rng.integers(modes)
            middle, ends = getattr(cell, name)[mode].mean(), (getattr(cell, name).copy(), getattr(cell, name).copy())
            ends[0][mode, 1] = ends[1][mode, 0] = middle
            cells += [dataclasses.replace(cell, **{name: e}) for e in ends]
        order = rng.permutation(len(cells))
        cells = [cells[k] for k in order]
        assert box.covered_by(cells)
        for k in range(len(cells)):
            others = cells[:k] + cells[k + 1 :]
            assert not box.covered_by(others)
            side, end = rng.integers(modes), rng.integers(2)
            ends = cells[k].damping.copy()
            ends[side, end] += (1e-9 if end == 0 else -1e-9) * ends[side, end]
            assert not box.covered_by([*others, dataclasses.replace(cells[k], damping=ends)])
