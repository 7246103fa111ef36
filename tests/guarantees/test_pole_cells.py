"""Cells of a pole-uncertainty box: expansions against drawn poles, relaxations against drawn plants."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.guarantees import PoleCell
from robustid.identification.formulation import ExactFormulation
from support.cases import slow

DT = 0.01


def draw(rng, modes=2, delay=1, width=0.02):
    middle = 2 * np.pi * np.sort(rng.uniform(5, 40, modes))
    damping = rng.uniform(0.005, 0.1, modes)
    spread = width * damping * middle
    ends = np.stack([middle - spread, middle + spread], axis=1)
    return PoleCell(ends, damping[:, None] * np.array([1 - width, 1 + width]), rng.uniform(0.1, 2, modes), delay, DT)


def drawn_poles(cell, rng):
    """A pole of every mode inside the cell, often at a corner."""
    t = rng.choice([0.0, 1.0, rng.uniform()], size=(2, cell.amplitude.size))
    omega = cell.omega[:, 0] + t[0] * np.ptp(cell.omega, axis=1)
    damping = cell.damping[:, 0] + t[1] * np.ptp(cell.damping, axis=1)
    return np.exp((-damping + 1j * np.sqrt(1 - damping**2)) * omega * DT), omega, damping


def expansion(cell, c, poles):
    """Coefficients of c a^k in the functions of the cell: those of binom(k, j) a0^k are c (a - a0)^j / a0^j."""
    p = []
    for number, (amplitude, a, a0) in enumerate(zip(c, poles, cell.middle, strict=True)):
        one = rid.kautz(cell.omega[number].mean(), cell.damping[number].mean(), dt=DT, repeat=3, delay=cell.delay)
        for j in range(3):
            factor = 2 * amplitude * ((a - a0) / a0) ** j
            wanted = np.array([factor.real, -factor.imag])
            # In units of the basis: what its functions are at their first samples.
            first = one.impulse(cell.delay + 4)[cell.delay :, 2 * j : 2 * j + 2]
            k = np.arange(4)
            ways = np.array([1, 1, 1, 1]) if j == 0 else k if j == 1 else k * (k - 1) / 2
            plain = ways[:, None] * np.stack([(a0**k).real, (a0**k).imag], axis=1)
            p.append(wanted * np.abs(plain).max(axis=0) / np.abs(first).max(axis=0))
    return np.concatenate(p)


@pytest.mark.parametrize("width", [1e-11, 0.01, 0.1, 0.3])
def test_the_radius_covers_the_box(width):
    rng = np.random.default_rng(0)
    largest = 0.0
    for _ in range(20):
        cell = draw(rng, width=width)
        for _ in range(50):
            ratio = np.abs(drawn_poles(cell, rng)[0] - cell.middle) / cell.radius
            assert ratio.max() <= 1
            largest = max(largest, float(ratio.max()))
    assert largest >= (0.7 if width > 1e-3 else 0.05)  # there the allowance for rounding is a part of it


@pytest.mark.parametrize("delay", [0, 1, 2])
def test_a_mode_in_the_cell_is_a_repeated_pair_and_a_small_remainder(delay):
    """Coefficients within the intervals leave no more than the remainder, on the circle and in the impulse response."""
    rng = np.random.default_rng(delay)
    tightest = 0.0
    for _ in range(10):
        cell = draw(rng, delay=delay, width=0.15)
        poles = drawn_poles(cell, rng)[0]
        c = cell.amplitude * np.exp(2j * np.pi * rng.uniform(size=poles.size))
        basis, ends = cell.basis(), cell.intervals()
        p = expansion(cell, c, poles)
        assert np.all((ends[:, 0] <= p * (1 + 1e-12)) & (p * (1 - 1e-12) <= ends[:, 1]))
        angles = np.concatenate([np.linspace(0, np.pi, 300), np.angle(poles)])
        z = np.exp(-1j * angles)
        terms = [c[i] / (1 - poles[i] * z) + c[i].conj() / (1 - poles[i].conj() * z) for i in range(poles.size)]
        left = np.abs(z**delay * sum(terms) - basis.response(angles) @ p)
        bound = cell.remainder(angles / DT).sum(axis=1)
        assert np.all(left <= bound * (1 + 1e-9) + 1e-12)
        tightest = max(tightest, float((left / bound).max()))
        k = np.arange(400 - delay)
        h = np.concatenate([np.zeros(delay), 2 * np.real(c[:, None] * poles[:, None] ** k).sum(axis=0)])
        rest = np.abs(h - basis.impulse(400) @ p)
        assert np.all(rest <= cell.impulse_remainder(400).sum(axis=1) * (1 + 1e-9) + 1e-12)
    assert tightest >= 0.05


@pytest.mark.parametrize("delay", [*(slow(k) for k in (0, 1)), 2])
def test_plants_with_poles_in_the_cell_solve_its_relaxed_problem(delay):
    """Seventy drawn plants each, measured with errors at the limit and against the expansion, tilted lines and records."""
    rng = np.random.default_rng(10 + delay)
    needed = 0
    for _ in range(70):
        cell = draw(rng, delay=delay, width=0.1 * rng.uniform())
        poles = drawn_poles(cell, rng)[0]
        c = cell.amplitude * rng.choice([1.0, rng.uniform()]) * np.exp(2j * np.pi * rng.uniform(size=poles.size))
        gain, g = 0.3, rng.uniform(-1, 1)  # the rest is a constant: K g, of the coefficients g c
        angles = np.sort(np.concatenate([rng.uniform(0.2, 3, 12), np.angle(poles)]))
        z, count = np.exp(-1j * angles), 25
        modes = sum(c[i] / (1 - poles[i] * z) + c[i].conj() / (1 - poles[i].conj() * z) for i in range(poles.size))
        k = np.arange(count - delay)
        h = np.concatenate([np.zeros(delay), 2 * np.real(c[:, None] * poles[:, None] ** k).sum(axis=0)])
        basis, p, u = cell.basis(), expansion(cell, c, poles), rng.uniform(-1, 1, count)
        bound, tilt = rng.uniform(0.01, 0.1, angles.size), 0.8 * rng.uniform(size=angles.size) * np.exp(7j * angles)
        left = z**delay * modes - basis.response(angles) @ p
        left = left + tilt * left.conj()
        pushed = bound * np.exp(1j * np.angle(left))  # any direction where nothing is left
        error = (pushed - tilt * pushed.conj()) / (1 - np.abs(tilt) ** 2)
        values = z**delay * modes + gain * g + error
        frf = rid.FrequencyResponse(angles / DT, values, bound=rid.Bound(bound, tilt=tilt), dt=DT)
        rest = np.convolve(u, h - basis.impulse(count) @ p)[:count]
        y = np.convolve(u, h)[:count] + gain * g * u + 0.02 * np.sign(rest)
        record = rid.TimeRecord(u, y, dt=DT, bound=0.02)
        prior = rid.Prior(gain_bound=gain, decay_rate=1.3)
        relaxed = cell.relaxed(rid.MixedProblem(frequency=frf, time=record, prior=prior))
        data = ExactFormulation(relaxed).data
        scaled = p * data.rows.column_scale
        assert data.rows.within(scaled)
        ratio = data.rows.ratio(g * data.sarason.pair.c[0], scaled)
        assert ratio.max() <= 1 + 1e-11
        wider = np.concatenate([relaxed.frequency[0].bound.ravel(), relaxed.time[0].bound.ravel()])
        old = np.concatenate([frf.bound.ravel()[np.isin(frf.omega, relaxed.frequency[0].omega)], record.bound.ravel()])
        needed += np.max(ratio * wider / old) > 1 + 1e-6
    assert needed >= 60


def structure(seed, fine=True):
    return rid.flexible_structure(seed=seed, extra_hz=np.linspace(17.2, 18.1, 10) if fine else ())


def test_halves_cover_a_cell_and_do_not_refute_the_truth():
    """Splitting five times towards the truth: its relaxation is consistent, and it stays in one half."""
    data = structure(3)
    problem = rid.MixedProblem(
        frequency=data.frequency,
        time=data.time,
        prior=rid.Prior(gain_bound=0.1, decay_rate=1.2),
        parametric=rid.kautz(*data.modes.T, dt=DT, delay=1),
    )
    result = rid.identify(problem)
    whole = PoleCell(
        data.modes[:, :1] * [0.97, 1.04], data.modes[:, 1:] * [0.6, 1.5], np.array([0.6, 0.1]), delay=1, dt=DT
    )
    assert result.consistent
    for _ in range(5):
        halves = whole.split(problem, problem.frequency[0].omega)
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
