"""Rows of many machines: states, worst cases and those that are unlike the others, by known answers."""

import dataclasses
import math

import numpy as np
import pytest

from robustid.guarantees import FleetRow, FleetState, fleet_of

pytestmark = pytest.mark.quick


def rows(values, **others):
    return [FleetRow(f"m{k}", FleetState.CONSISTENT, "", peak=value, **others) for k, value in enumerate(values)]


def test_outliers_are_those_far_from_the_median_in_robust_deviations():
    """Logarithms -3 to 3 and one at 12: median 0.5, median of the deviations 2."""
    logs = [-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0, 12.0]
    (odd,) = fleet_of(rows(np.exp(logs)), 8).outliers
    assert (odd.name, odd.quantity) == ("m7", "peak")
    assert odd.median == pytest.approx(math.exp(0.5))
    assert odd.score == pytest.approx((12 - 0.5) / (1.4826 * 2))


@pytest.mark.parametrize("factor", [2.0**-60, 1.0, 2.0**60])
def test_outliers_do_not_depend_on_the_unit(factor):
    values = factor * np.array([1.0, 1.1, 0.9, 1.05, 0.95, 1.02, 0.98, 1.0, 0.3])
    found = fleet_of(rows(values), 9).outliers
    assert [one.name for one in found] == ["m8"]
    assert found[0].score == pytest.approx(fleet_of(rows(values / factor), 9).outliers[0].score)


def test_where_most_machines_are_one_the_mean_deviation_is_the_measure():
    values = [1.0] * 20 + [4.0]
    (odd,) = fleet_of(rows(values), 21).outliers
    assert odd.score == pytest.approx(math.log(4) / (1.2533 * math.log(4) / 21))


@pytest.mark.parametrize(
    "values", [[1.0] * 6 + [100.0], [1.0] * 30, [math.nan] * 20, [0.0] * 20, [1.0 + 1e-13 * k for k in range(20)]]
)
def test_few_equal_and_missing_values_have_no_outliers(values):
    assert fleet_of(rows(values), len(values)).outliers == ()


def test_states_are_counted_and_lists_stay_short():
    many = [FleetRow(f"f{k}", FleetState.FAILED, "no data", seconds=1.0) for k in range(200)]
    many += [FleetRow("r", FleetState.CONTRADICTED, "withheld data", relative=7.0, faults=2)]
    many += [
        FleetRow(f"c{k}", FleetState.CONSISTENT, "", relative=0.1 * k, waits="lines" * (k == 3)) for k in range(99)
    ]
    found = fleet_of(many, 310)
    assert found.verdict == "Of 310 machines 99 consistent, 1 contradicted, 200 failed, 10 not run yet."
    assert (len(found.failed), len(found.worst), found.open, found.faulty, found.seconds) == (50, 50, 10, 1, 200.0)
    assert [row.name for row in found.worst[:2]] == ["c98", "c97"]
    assert [row.name for row in found.refuted] == ["r"]
    assert [row.name for row in found.waiting] == ["c3"]
    assert found.relative.size == 100
    assert "c3 waits for data: lines" in found.summary()


def test_nothing_is_a_fleet_too():
    found = fleet_of([], 3)
    assert found.verdict == "Of 3 machines 3 not run yet."
    assert dataclasses.replace(found, asked=0).verdict == "Of 0 machines none."
