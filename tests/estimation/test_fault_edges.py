"""Faults of measurements of any shape: short, constant, all alike, tiny or large ones are judged without an error."""

import numpy as np
import pytest

import robustid as rid

MANY = [range(8), pytest.param(range(8, 600), marks=pytest.mark.slow)]
INPUTS = {
    "noise": lambda rng, n: rng.standard_normal((n, 1)),
    "constant": lambda rng, n: np.ones((n, 1)),
    "sine": lambda rng, n: np.sin(0.3 * np.arange(n))[:, None],
    "step": lambda rng, n: (np.arange(n) > n // 3)[:, None] * 1.0,
    "periodic": lambda rng, n: np.tile(rng.standard_normal((max(2, n // 4), 1)), (8, 1))[:n],
    "pulse": lambda rng, n: (np.arange(n) == n // 2)[:, None] * 1.0,
}


def any_record(rng):
    samples, outputs = int(np.exp(rng.uniform(np.log(2), np.log(400)))), int(rng.integers(1, 3))
    u = INPUTS[str(rng.choice(list(INPUTS)))](rng, samples) * np.ones(int(rng.integers(1, 3)))
    y = np.cumsum(u[:, :1], axis=0) * rng.choice([0, 1, 1e-9]) + u[:, :1] * rng.choice([0, 1])
    y = y + rng.choice([0, 1e-3, 1]) * rng.standard_normal((samples, outputs))
    y = np.round(y) if rng.random() < 0.2 else y * 2.0 ** rng.choice([-60, 0, 60])
    return rid.TimeRecord(u, y, dt=float(10 ** rng.uniform(-6, 3)), initial=str(rng.choice(["rest", "free"])))


def any_response(rng):
    points, shape = int(np.exp(rng.uniform(0, np.log(120)))), tuple(rng.integers(1, 3, 2))
    omega = np.sort(rng.uniform(0.01, 100, points))
    values = (1 / (0.2j * omega - omega**2 + rng.uniform(1, 2000)))[:, None, None] * rng.standard_normal(shape)
    match rng.integers(0, 5):
        case 0:
            values = 0 * values
        case 1:
            values = values + rng.standard_normal(values.shape)
        case 2:
            values[rng.integers(points)] = 0
        case 3:
            values = 2.0**60 * values
    bound = None if rng.random() < 0.3 else 1e-3 * np.abs(values).max() + 1e-12
    return rid.FrequencyResponse(omega, values, bound=bound, dt=0.03)


@pytest.mark.parametrize("seeds", MANY)
def test_any_record_is_judged(seeds):
    for seed in seeds:
        rng = np.random.default_rng(seed)
        one = any_record(rng)
        given = [one, rid.TimeRecord(one.u, one.y[::-1].copy(), dt=one.dt, initial=one.initial)][: rng.integers(1, 3)]
        period = None if rng.random() < 0.5 else int(rng.integers(2, max(3, len(one.u))))
        assert isinstance(rid.prepare.record_faults(given, period=period), tuple)


@pytest.mark.parametrize("seeds", MANY)
def test_any_response_is_judged_with_any_record_beside_it(seeds):
    for seed in seeds:
        rng = np.random.default_rng(seed)
        frf = any_response(rng)
        assert isinstance(rid.prepare.response_faults(frf), tuple)
        samples, (outputs, inputs) = int(rng.integers(3, 200)), frf.values.shape[1:]
        u, y = rng.standard_normal((samples, inputs)), rng.standard_normal((samples, outputs))
        bound, initial = rng.choice([None, 0.1]), str(rng.choice(["rest", "free", "periodic"]))
        found = rid.prepare.experiment_faults(frf, rid.TimeRecord(u, y, dt=0.03, bound=bound, initial=initial))
        assert isinstance(found, tuple)
