"""Records of a simulated lightly damped 2x2 plant in a feedback loop, sample by sample and quick."""

import control
import numpy as np
from scipy.signal import lfilter

from robustid.data import TimeRecord

DT, PERIOD = 1e-3, 2048
LINES = np.arange(10, 800, 4)
MODES_HZ, DAMPING = np.array([37.3, 118.9, 262.4]), np.array([0.002, 0.005, 0.01])


def plant():
    """Three modes behind a zero-order hold, damping ratios 0.2 to 1 %, each seen by both channels."""
    w, blocks, b, c = 2 * np.pi * MODES_HZ, [], [], []
    shapes = np.array([[1.0, 0.6], [0.8, -1.0], [0.5, 0.9]])
    for wi, di, shape in zip(w, DAMPING, shapes, strict=True):
        blocks.append([[0, wi], [-wi, -2 * di * wi]])
        b += [np.zeros(2), wi * shape]
        c.append(np.column_stack([shape, np.zeros(2)]))
    a = np.zeros((6, 6))
    for k, block in enumerate(blocks):
        a[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = block
    return control.sample_system(control.ss(a, np.array(b), np.hstack(c), 0), DT)


def feedback(gain=0.02):
    """``u = r - C y`` with C(z) = gain (1 - z^-1): damps the modes."""
    return control.ss(np.zeros((2, 2)), np.eye(2), -gain * np.eye(2), gain * np.eye(2), DT)


def simulate(model, inputs):
    """(T, ny) output from rest, one filter for every pole and its conjugate."""
    poles, vectors = np.linalg.eig(model.A)
    drive = np.linalg.solve(vectors, model.B.astype(complex)) * np.where(poles.imag > 0, 2, 1)[:, None]
    upper = poles.imag >= 0
    poles, vectors, drive = poles[upper], vectors[:, upper], inputs @ drive[upper].T
    states = np.stack([lfilter([0, 1], [1, -p], drive[:, k]) for k, p in enumerate(poles)], axis=1)
    return (states @ (model.C @ vectors).T).real + inputs @ model.D.T


class Loop:
    """Responses from (reference, output noise) to (u, y)."""

    def __init__(self, gain=0.02):
        g, c = plant(), feedback(gain)
        n, m = g.nstates, c.nstates
        # y = G u + v; u = r - C y, G strictly proper.
        a = np.block([[g.A - g.B @ c.D @ g.C, -g.B @ c.C], [c.B @ g.C, c.A]])
        b = np.block([[g.B, -g.B @ c.D], [np.zeros((m, 2)), c.B]])
        rows = np.block([[-c.D @ g.C, -c.C], [g.C, np.zeros((2, m))]])
        d = np.block([[np.eye(2), -c.D], [np.zeros((2, 2)), np.eye(2)]])
        self.system = control.ss(a, b, rows, d, DT)
        assert n + m == len(a)
        assert np.abs(np.linalg.eigvals(a)).max() < 1
        self.decay = np.log(1e-7) / np.log(np.abs(np.linalg.eigvals(a)).max())

    def record(self, r, rng, noise, lead):
        """The record after `lead` samples: noise is this part of the rms of y, in the loop, and of u where it is read."""
        clean = simulate(self.system, np.hstack([r, np.zeros_like(r)]))[:, 2:]
        size = noise * clean[lead:].std(axis=0)
        out = simulate(self.system, np.hstack([r, size * rng.standard_normal(r.shape)]))[lead:]
        u = out[:, :2] + noise * out[:, :2].std(axis=0) * rng.standard_normal((len(out), 2))
        return TimeRecord(u, out[:, 2:], dt=DT, reference=r[lead:], initial="periodic")


def truth(omega):
    return np.moveaxis(plant()(np.exp(1j * omega * DT)), -1, 0)


def multisines(rng, realisations, periods):
    """Orthogonal pairs of multisines, two experiments a realisation."""
    out = []
    for _ in range(realisations):
        spectra = np.zeros((2, PERIOD // 2 + 1), complex)
        spectra[:, LINES] = np.exp(2j * np.pi * rng.uniform(size=(2, LINES.size))) * PERIOD / 2
        first, second = np.fft.irfft(spectra, axis=1)
        for sign in (1, -1):
            out.append(np.tile(np.column_stack([first, sign * second]), (periods, 1)))
    return out
