"""Files with one fault each of a plant of two real poles: a response, and a record of a step beside it."""

import numpy as np
from scipy.signal import lfilter

import robustid as rid

DT = 0.01
CLASS = ["--mode", "none", "--gain", "20", "--decay-rate", "1.3", "--no-reduce", "--accuracy", "1"]
CLASS_KEYS = {
    "modes": {"hz": [], "damping": []},
    "prior": {"gain_bound": 20.0, "decay_rate": 1.3},
    "identify": {"accuracy": 1.0},
}


def response(off=0.0):
    """Noise of a tenth of the bound, and one value that is off."""
    rng, hz = np.random.default_rng(0), np.arange(1.0, 41.0)
    z = np.exp(2j * np.pi * hz * DT)
    noise = 1e-3 * (rng.standard_normal(40) + 1j * rng.standard_normal(40))
    values = 0.5 / (z - 0.6) + 0.2 / (z - 0.4) + noise
    values[22] += off
    return rid.FrequencyResponse(2 * np.pi * hz, values, bound=1e-2, dt=DT)


def record(seed=0):
    """Noise as input, from rest, after some samples without any."""
    rng = np.random.default_rng(seed)
    u = rng.standard_normal(80)
    u[:6] = 0.0
    y = lfilter([0, 0.5], [1, -0.6], u) + lfilter([0, 0.2], [1, -0.4], u)
    return rid.TimeRecord(u, y + 0.01 * rng.uniform(-0.5, 0.5, y.shape), dt=DT, bound=0.01)


def faulty(kind):
    """Response and record with a fault of a kind; "clean" has none."""
    frf, one = response(0.3 if kind == "outlier" else 0.0), record()
    if kind == "conjugate":
        frf = rid.prepare.correct(frf, "conjugate")
    changes = {"sign": "negate", "unit": "times 1000", "late": "delay 2"}
    if kind in changes:
        one = rid.prepare.correct(one, changes[kind])
    if kind == "offset":
        one = rid.TimeRecord(one.u, one.y + 0.4, dt=DT, bound=0.01)
    return frf, one


KINDS = ("outlier", "conjugate", "sign", "unit", "late", "offset")
