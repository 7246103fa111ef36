"""Points, digits and phases on their way to a chart."""

import numpy as np
import pytest

from robustid.report.charts import frequency_axis
from robustid.report.curves import between_gaps, log_axis, measured_phase, rounded, thinned
from support.frf_records import HZ

pytestmark = pytest.mark.quick


@pytest.mark.parametrize("turns", [1.5, 5.0])
def test_phase_is_continuous_within_two_turns_and_noise_turns_nothing(turns):
    rng = np.random.default_rng(1)
    omega = np.linspace(1.0, 100.0, 400)
    values = np.exp(-1j * HZ * turns * omega / 100) * np.where((omega > 40) & (omega < 60), 0.01, 1)
    values = values + 0.01 * (rng.standard_normal(400) + 1j * rng.standard_normal(400))
    angle, (low, high) = measured_phase(omega, values, np.full(400, 0.05))
    np.testing.assert_allclose(np.exp(1j * np.radians(angle)), values / np.abs(values), atol=1e-9)
    assert low <= angle.min()
    assert angle.max() <= high
    sure = np.abs(values) > 0.1
    if turns == 1.5:
        gradient = np.polyfit(omega[sure], angle[sure], 1)[0]
        assert gradient == pytest.approx(-360 * turns / 100, rel=0.01)
        assert np.abs(np.diff(angle[sure])).max() < 120  # over the lines that are left out
    else:
        assert (low, high) == (-225, 225)


def test_the_axis_follows_the_lines():
    assert log_axis(np.geomspace(1, 100, 50))
    assert not log_axis(np.linspace(0, 100, 50))
    assert "0 Hz" in frequency_axis(np.append(0.0, np.geomspace(1, 1e4, 50))).label


def test_thinning_keeps_every_extreme():
    rng = np.random.default_rng(2)
    size, error = rng.lognormal(size=5000), rng.lognormal(size=5000)
    position = np.sort(rng.uniform(0, 7, 5000))
    kept = thinned(position, [size, error], 100)
    assert kept.size <= 300
    for k in range(99):
        inside = np.flatnonzero((position - position[0]) // ((position[-1] - position[0]) / 100) == k)
        assert {inside[size[inside].argmax()], inside[size[inside].argmin()], inside[error[inside].argmax()]} <= {*kept}
    few = np.array([1, 3, 2, 9, 4, 5, 5, 6, 5, 5, 0, 5])
    np.testing.assert_array_equal(thinned(np.arange(12.0), [few], 2), [0, 3, 7, 10])
    np.testing.assert_array_equal(thinned(position[:300], [size[:300], error[:300]], 100), np.arange(300))


def test_six_digits():
    values = np.array([0.0, 1.23456789e-30, -123456789.0, 3.0, np.nan, 1e-5 / 3])
    expected = [0.0, 1.23457e-30, -123457000.0, 3.0, np.nan, 3.33333e-6]
    np.testing.assert_allclose(rounded(values), expected, rtol=1e-15)


def test_stretches_between_gaps():
    assert between_gaps(np.array([1.0, np.nan, 2.0, 3.0])) == [slice(0, 1), slice(2, 4)]
