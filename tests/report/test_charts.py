"""Charts before they are drawn."""

import numpy as np
import pytest

from robustid.report.charts import Axis, lighter
from robustid.report.frequency import frequency_charts

pytestmark = pytest.mark.quick


def test_lighter_charts_keep_every_peak_and_notch(matrix_result):
    full = frequency_charts(matrix_result)
    for one, other in zip(full, lighter(full), strict=True):
        first, second = one.panels[0].layers[0], other.panels[0].layers[0]
        assert second.x.size <= 2 * 350
        assert second.x.size < first.x.size
        assert (second.y.min(), second.y.max()) == pytest.approx((first.y.min(), first.y.max()), rel=1e-5)
        np.testing.assert_allclose(other.panels[0].layers[1].y, one.panels[0].layers[1].y, rtol=1e-5)  # samples: all


@pytest.mark.parametrize("label", ["magnitude", "phase"])
def test_small_numbers_are_powers_of_ten_all_over_an_axis(label):
    assert Axis(label, log=True, range=(0.02, 90.0)).in_full
    assert not Axis(label, log=True, range=(1e-7, 1e-4)).in_full
    assert not Axis(label, log=True, range=(1e-3, 1e2)).in_full
    assert not Axis(label, range=(0.0, 1.0)).in_full
