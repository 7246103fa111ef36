"""Simulated periodic records of a 2 x 2 plant, one entry of which ends in the noise."""

import numpy as np

import robustid as rid
from robustid.data import TimeRecord

HZ = 2 * np.pi
DT, PERIOD = 0.01, 200
NASTY = "<script>alert(1)</script>"


def gain(freq_hz):
    """(F, 2, 2): one mode at 10 Hz, and a small entry that ends in the noise."""
    s = 1j * HZ * np.asarray(freq_hz)
    mode = (HZ * 10) ** 2 / (s**2 + 0.4 * HZ * s + (HZ * 10) ** 2)
    return np.stack([np.stack([2 * mode, mode], axis=-1), np.stack([0 * mode + 0.05, -mode], axis=-1)], axis=-2)


def measured(realisations=2, periods=4, noise=0.02):
    """Records of a 2 x 2 plant in steady state, noise on the outputs."""
    play = rid.prepare.multisine(
        band_hz=(1, 40), dt=DT, period=PERIOD, inputs=2, realisations=realisations, minimise_crest=False
    )
    rng = np.random.default_rng(0)
    records = []
    for u in play.u:
        spectrum = np.fft.rfft(u, axis=0)
        spectrum[play.lines] = np.einsum("fij,fj->fi", gain(play.freq_hz), spectrum[play.lines])
        y = np.tile(np.fft.irfft(spectrum, PERIOD, axis=0), (periods, 1))
        y = y + noise * rng.standard_normal(y.shape)
        names = {"inputs": ["force [N]", "torque [Nm]"], "outputs": ["x [mm]", NASTY]}
        records.append(TimeRecord(np.tile(u, (periods, 1)), y, dt=DT, initial="periodic", **names))
    return play, records
