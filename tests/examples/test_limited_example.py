"""The page on model reduction as its users run it, and the claims that it prints."""

import numpy as np
import pytest

from support.example_runs import load
from support.measured import needs


@pytest.mark.realdata
def test_limits_gain_where_they_are_meant_to(run):
    needs("slicot/build.mat")
    printed = run(load("model_reduction"), ["model_reduction.png"], "--models", "build")
    rows = {}
    for line in printed.splitlines():
        method, *numbers = line.replace("static gain", "static_gain").replace("unstable", "").split() or [""]
        if method in ("plain", "static_gain", "band", "horizon", "weight"):
            rows[method, int(numbers[0])] = np.array([float(value) for value in numbers[1:]])
    for (method, _), (bound, error, *_) in rows.items():
        if method in ("plain", "static_gain"):
            assert error <= bound
        else:
            assert np.isinf(bound)
    assert "of all others 0" in printed
    assert "The bound holds in 12 of 12" in printed
    assert rows["band", 24][2] < 0.2 * rows["plain", 24][2]
    assert rows["horizon", 24][3] < 0.2 * rows["plain", 24][3]
