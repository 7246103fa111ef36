"""Margins of one loop at a time: against open loops of true plants, and of scalars against those of the loop itself."""

import control
import numpy as np
import pytest

import robustid as rid
from robustid.core import StateMatrices, points_of, response_at
from robustid.guarantee import margins_by_loop
from support.design_cases import DT, band_of, matrix_band_of

PI = control.ss(1.0, 0.02, 1.0, 0.1, DT)
OMEGA = np.linspace(0.05, np.pi / DT, 6000)


def loops_of(plant, controller):
    """Scalar open loops at every output and at every input, the others closed: by elimination, (places, F)."""
    P, C = (response_at(StateMatrices.of(one), points_of(OMEGA, DT)) for one in (plant, controller))
    found = []
    for L in (P @ C, C @ P):
        for k in range(L.shape[1]):
            others = [i for i in range(L.shape[1]) if i != k]
            rest = np.eye(len(others)) + L[:, others][:, :, others]
            through = np.linalg.solve(rest, L[:, others, k][..., None])[..., 0]
            found.append(L[:, k, k] - np.einsum("fi,fi->f", L[:, k, others], through))
    return found


def margins_of_loop(L):
    """Modulus, gain, phase and delay of a scalar open loop of which -1 is not encircled."""
    crossing = np.flatnonzero(L.imag[1:] * L.imag[:-1] < 0)
    real = L.real[crossing]
    outside = np.flatnonzero((np.abs(L[1:]) - 1) * (np.abs(L[:-1]) - 1) < 0)
    turned = np.abs(np.angle(-L[outside]))
    delays = np.mod(np.angle(-L[outside]), 2 * np.pi) / OMEGA[outside]
    high = 1 / np.max(-real[(real > -1) & (real < 0)], initial=1e-9)
    return np.abs(1 + L).min(), high, turned.min(initial=np.pi), delays.min(initial=np.inf)


@pytest.mark.parametrize("seed", [pytest.param(k, marks=[] if k == 0 else pytest.mark.slow) for k in range(6)])
def test_true_plants_have_the_margins_that_are_proved_at_every_place(seed):
    plant, band = matrix_band_of(seed)
    controller = control.append(PI, PI)
    bounds = rid.loop_bounds(band, controller=controller)
    assert bounds.guaranteed
    found = margins_by_loop(bounds)
    for L, proved in zip(loops_of(plant, controller), (*found.outputs, *found.inputs), strict=True):
        modulus, high, phase, delay = margins_of_loop(L)
        assert proved.modulus <= modulus
        assert proved.gain[1] <= high
        assert proved.phase <= phase
        assert proved.delay <= delay
        assert proved.modulus >= bounds.margins.modulus * 0.995  # no worse than for all at once
        assert proved.gain[1] >= bounds.margins.gain[1]


def test_of_one_output_they_are_those_of_the_loop():
    bounds = rid.loop_bounds(band_of(3)[1], controller=PI)
    (output,), (given,) = margins_by_loop(bounds)
    for one in (output, given):
        for name in ("modulus", "phase", "delay", "disk"):
            assert getattr(one, name) == pytest.approx(getattr(bounds.margins, name), rel=0.01)
        assert one.gain == pytest.approx(bounds.margins.gain, rel=0.01)
    with pytest.raises(rid.InputError, match="must be proved"):
        margins_by_loop(rid.loop_bounds(band_of(3)[1], controller=-100 * PI))
