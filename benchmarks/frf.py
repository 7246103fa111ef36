"""Frequency responses from records: time and memory of 10^6 samples x 4 channels, and the peak of a light mode against Welch.

Run: python benchmarks/frf.py. The peer is scipy.signal.csd with Hann windows, on the same record in the same run.
"""

import resource
import subprocess
import sys
import time

import numpy as np
from scipy.signal import csd, lfilter

import robustid as rid

SAMPLES, DT = 10**6, 1e-3
MODE_HZ, DAMPING = 118.9, 0.005


def pole():
    w = 2 * np.pi * MODE_HZ * DT
    return np.exp((-DAMPING + 1j * np.sqrt(1 - DAMPING**2)) * w)


def plant(u):
    """Two channels, each a lightly damped mode, the second with a tenth of the first."""
    a = pole()
    first, second = (lfilter([0, 1], [1, -2 * a.real, abs(a) ** 2], u[:, k]) for k in (0, 1))
    return np.column_stack([first + 0.1 * second, second])


def truth(omega):
    a, z = pole(), np.exp(1j * omega * DT)
    return z / ((z - a) * (z - np.conj(a)))


def one(method):
    """Time and memory of one method, in a process of its own."""
    rng = np.random.default_rng(0)
    if method == "periodic":
        u = np.tile(rng.standard_normal((SAMPLES // 200, 2)), (100, 1))
        records = [rid.TimeRecord(s, plant(s), dt=DT) for s in (u, u * [1, -1])]  # two experiments of half the samples
        options = {"period": SAMPLES // 200}
    else:
        u = rng.standard_normal((SAMPLES, 2))
        records, options = [rid.TimeRecord(u, plant(u), dt=DT)], {"method": method}
    start = time.perf_counter()
    frf = rid.estimate_frf(records, **options)
    spent = time.perf_counter() - start
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{method:10}{spent:8.2f} s{memory:9.0f} MB{frf.omega.size:8} lines")


def peak(samples, seeds=20, noise=0.01):
    """Error of the peak of the mode, local method and scipy's Hann windows of the same length as ours, from the same data."""
    local, hann = [], []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        u = rng.standard_normal((samples, 1))
        y = plant(np.hstack([u, 0 * u]))[:, :1]
        y = y + noise * y.std() * rng.standard_normal(y.shape)
        frf = rid.estimate_frf(rid.TimeRecord(u, y, dt=DT), lines=[round(MODE_HZ * samples * DT)])
        local.append(abs(abs(frf.values[0, 0, 0] / truth(frf.omega[0])) - 1))
        hz, cross = csd(u[:, 0], y[:, 0], fs=1 / DT, nperseg=2 * samples // 9)
        _, power = csd(u[:, 0], u[:, 0], fs=1 / DT, nperseg=2 * samples // 9)
        k = np.argmin(np.abs(hz - MODE_HZ))
        hann.append(abs(abs(cross[k] / power[k] / truth(2 * np.pi * hz[k])) - 1))
    a, b = 100 * np.median(local), 100 * np.median(hann)
    print(f"{samples * DT:6.0f} s of noise: local {a:.3f} %, scipy.signal.csd {b:.1f} %, ratio {b / a:.0f}")


if __name__ == "__main__":
    if len(sys.argv) > 1:
        one(sys.argv[1])
    else:
        print("10^6 samples, 2 inputs and 2 outputs")
        for name in ("periodic", "local", "welch"):
            subprocess.run([sys.executable, __file__, name], check=True)
        print(f"peak of a mode with {100 * DAMPING:g} % damping, median of 20 seeds, 1 % noise")
        for count in (10_000, 20_000, 50_000):
            peak(count)
