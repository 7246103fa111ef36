"""What is said and drawn of a sweep over the order."""

import dataclasses

import numpy as np
import pytest

from robustid.report.order_sweep_section import order_chart, order_words, stabilisation_chart
from support.fits import HZ, SMALL

pytestmark = pytest.mark.quick


def test_order_charts(sweep):
    singular, cost, criteria = order_chart(sweep).panels
    assert {layer.name: layer.x.size for layer in singular.layers}["above the noise"] == sweep.subspace_order
    drawn = {layer.name: layer for layer in (*cost.layers, *criteria.layers)}
    np.testing.assert_array_equal(drawn["cost"].y, sweep.costs)
    np.testing.assert_allclose(drawn["MDL"].y, sweep.mdl - sweep.mdl.min() + 1)
    np.testing.assert_array_equal(drawn["suggested order 4"].x, [4, 4])
    words = order_words(sweep)
    assert "order 4 has the smallest description length" in words
    assert "Not fitted: order 12" in words
    assert "largest order tried" not in words
    alone = dataclasses.replace(sweep, noise_known=True, parameters=np.zeros(2))
    assert "largest order tried" in order_words(alone)


def test_stabilisation_marks_every_pole_in_the_band(sweep):
    panel = stabilisation_chart(sweep).panels[0]
    marks = [layer for layer in panel.layers if layer.marker]
    assert sum(layer.x.size for layer in marks) == len(sweep.stabilisation)
    stable = next(layer for layer in marks if layer.name.startswith("frequency and damping"))
    assert stable.x.size == 2
    assert np.all(stable.y == 5)
    for hz in stable.x:
        assert np.abs(SMALL.frequency / HZ - hz).min() < 0.01 * hz
    background = panel.layers[0]
    assert panel.y.range == (background.y.min(), background.y.max())
