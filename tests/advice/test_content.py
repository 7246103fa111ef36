"""A verdict with content: how wide the set is between the frequency points beside on them."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.advice import content
from robustid.errors import InconsistentDataError, InputTypeError
from robustid.guarantees import consistent_set
from support.cases import slow
from support.structure import about_structure


def identified(gain_bound, decay_rate, lines=12, value=0):
    problem = about_structure(rid.datasets.flexible_structure(lines=lines), gain_bound, decay_rate)
    (frf,) = problem.frequency
    return rid.identify(dataclasses.replace(problem, frequency=dataclasses.replace(frf, values=frf.values + value)))


def test_a_class_that_lets_anything_happen_between_the_points_is_empty():
    empty, full = content(identified(10.0, 1.005)), content(identified(0.1, 1.2))
    assert empty.empty
    assert empty.separation < 1
    assert "decay rate" in " ".join(empty.signs)
    assert "says nothing between" in empty.summary()
    assert not full.empty
    assert full.signs == ()
    assert full.ratio < 3
    assert "as wide as on them" in full.summary()


@pytest.mark.parametrize(("gain_bound", "decay_rate"), [(10.0, 1.005), (0.1, 1.2), slow(1.0, 1.05)])
def test_widths_compare_as_guaranteed_ones_do(gain_bound, decay_rate):
    result = identified(gain_bound, decay_rate, lines=8)
    said = content(result)
    points = result.problem.frequency[0].omega
    pairs = [int(np.argmin(np.abs(points - w))) for w in said.omega[:2]]
    on, between = points[pairs], said.omega[:2]
    error = rid.worst_case_error(result, omega=np.append(on, between), directions=4, rtol=0.3)
    true = error.upper[:, 0, 0]
    ratio = np.median(true[np.isin(error.omega, between)]) / np.median(true[np.isin(error.omega, on)])
    assert 0.2 < said.ratio / ratio < 5


def test_the_ellipsoid_is_inside_the_set():
    result = identified(0.1, 1.2, lines=8)
    omega = np.array([20.0, 57.0, 100.0])
    widths = consistent_set(result).spreads(omega)
    error = rid.worst_case_error(result, omega=omega, directions=8)
    assert widths.shape == error.upper.shape
    for place, sets in enumerate(error.values):
        half = (sets.support + np.roll(sets.support, 4)).max() / 2
        assert 0 < widths[place, 0, 0] <= half * (1 + 1e-9)


def test_content_of_what_is_not_consistent_and_of_something_else():
    with pytest.raises(InconsistentDataError):
        content(identified(0.01, 1.2, value=np.tile([1.0, -1.0], 6)[:, None, None]))
    with pytest.raises(InputTypeError, match="Identification"):
        content(3)
