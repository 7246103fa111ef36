"""Windows of the local method across line 0: conjugate lines keep them centred, and are counted once."""

import numpy as np
import pytest

from robustid.data import TimeRecord, joint_radius
from robustid.estimation import response_alone
from robustid.estimation.excited_lines import excited_lines
from robustid.estimation.nonperiodic import _fit
from support.cases import slow
from support.fault_plants import recipes, records

HALF, SAMPLES = 15, 400


def spectra(rng, outputs, noise):
    """An input, and outputs 2 u + v of as many independent noises v."""
    u = rng.standard_normal((1, SAMPLES, 1))
    y = 2 * u + noise * rng.standard_normal((1, SAMPLES, outputs))
    return (np.fft.rfft(part, axis=1) / SAMPLES for part in (u, y))


@pytest.mark.parametrize("outputs", [400, slow(4000)])
def test_errors_at_the_first_lines_are_no_larger_than_stated(outputs):
    """Taken for twice the independent residuals, and alike in all directions, 2.6 % of errors at line 1 were beyond 99 %."""
    rng, lines = np.random.default_rng(3), np.array([1, 2, 4, 8, 12])
    beyond = np.zeros(lines.size)
    dof = float(2 * HALF + 1 - 8)
    for _ in range(outputs // 100):
        x, z = spectra(rng, 100, 0.3)
        values, covariance, *_ = _fit(x, z, np.zeros((0, *x.shape)), lines, HALF, (SAMPLES - 1) // 2)
        deviations = np.sqrt(np.einsum("fii->fi", covariance).real)
        limit = joint_radius(0.99, 1, np.array([dof]), np.array([False])).item()
        beyond += np.sum(np.abs(values[:, :, 0] - 2) > limit * deviations, axis=1)
    assert np.all(beyond <= np.where(lines > 4, 0.015, 0.01) * outputs), beyond


def test_conjugate_lines_are_of_the_same_response():
    """Without noise a response of a window's form is exact at line 1; with lines that are not conjugates it would be far off."""
    rng = np.random.default_rng(0)
    x = np.fft.rfft(rng.standard_normal((1, SAMPLES, 1)), axis=1) / SAMPLES
    s = 1j * np.arange(x.shape[1])[:, None]
    response, transient = (3 + s) / (5 + s + s**2 / 10), (1 - s) / (5 + s + s**2 / 10)
    values, *_ = _fit(x, response * x + transient, np.zeros((0, *x.shape)), np.array([1, 3]), HALF, (SAMPLES - 1) // 2)
    np.testing.assert_allclose(values[:, 0, 0], response[[1, 3], 0], rtol=1e-8)


def test_offsets_say_nothing():
    """Line 0 is no part of any window."""
    rng = np.random.default_rng(1)
    u = rng.standard_normal((SAMPLES, 1))
    y = 2 * u + 0.1 * rng.standard_normal(u.shape)
    plain, moved = (response_alone(TimeRecord(u, y + offset, dt=0.1), method="local") for offset in (0, 50))
    np.testing.assert_allclose(moved.values, plain.values, rtol=1e-9)


@pytest.mark.slow
def test_clean_records_of_a_heater_keep_their_bound_at_the_first_lines():
    """60 pairs of records: at 95 % three may leave it. Windows to one side left it by up to 3.5 bounds."""
    recipe, far = recipes()["heater"], []
    for seed in range(60):
        frf = response_alone(records(recipe, np.random.default_rng([seed, 77, *map(ord, "heater")]), kind="random"))
        truth = recipe.plant(np.exp(1j * frf.omega * frf.dt))
        far.append(np.max(np.abs(frf.values[:5, 0, 0] - truth[:5]) / frf.bound.radius[:5, 0, 0]))
    assert np.sum(np.array(far) > 1) <= 3, far
    assert max(far) < 2, far


@pytest.mark.parametrize("rounding", [0.0, 1e-14, 1e-4])
def test_beside_the_last_line_of_a_multisine_a_window_holds_as_many_lines_as_it_has_coefficients(rounding):
    """Three of a numerator of second degree; what rounding, or a column of four digits, leaves beside the band counts for none."""
    top, half, last = 125, 14, 499
    x = rounding * np.ones((1, last + 1, 1), complex)
    x[0, 1 : top + 1] = 1
    assert excited_lines(x, half, last, 3).tolist() == list(range(1, top + half - 1))
