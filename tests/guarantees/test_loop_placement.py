"""Polygons of R only where they limit the loop: as tight as polygons at all frequencies."""

import numpy as np
import pytest

import robustid as rid
from robustid.core import Budget, StateMatrices
from robustid.core import progress as clocks
from robustid.guarantees import limiting_polygons
from robustid.guarantees.consistent_set import ConsistentSet, consistent_set
from robustid.guarantees.loop_axis import LoopAxis
from robustid.guarantees.loop_placement import _binding
from robustid.guarantees.sweep import Means, value_sets
from support.unstable_loop import measured


@pytest.mark.slow
def test_peaks_and_margins_are_those_of_polygons_at_every_frequency():
    loop, result, band, found, _ = measured()
    assert 0 < found.omega.size < band.omega.size
    whole = rid.worst_case_error(result, model=band.model, omega=band.omega, directions=8, rtol=0.1)
    few, every = (rid.loop_bounds(band.with_polygons(one), loop) for one in (found, whole))
    plain = rid.loop_bounds(band, loop)
    for name, peak in every.peaks.items():
        assert few.peaks[name].value <= 1.01 * peak.value
        assert few.peaks[name].value < plain.peaks[name].value
    assert few.margins.modulus >= 0.99 * every.margins.modulus
    assert few.margins.phase >= 0.98 * every.margins.phase


@pytest.mark.slow
def test_a_peak_is_bound_by_frequencies_with_polygons_in_the_end():
    loop, _, band, found, refined = measured()
    around = loop.about(StateMatrices.of(band.model), None)
    sizes = LoopAxis(refined, loop.shape, around).sizes_at(band.omega)
    solved = np.isin(band.omega, found.omega)
    assert np.all(sizes[:, :4].max(axis=0) <= 1.01 * sizes[solved, :4].max(axis=0))


def test_peaks_hold_where_the_time_is_over():
    loop, _, band, *_ = measured()
    whole, ended = rid.loop_bounds(band, loop), rid.loop_bounds(band, loop, time_limit=1e-9)
    for name, peak in whole.peaks.items():
        assert peak.value <= ended.peaks[name].value < np.inf
    assert ended.peaks["sensitivity"].value > whole.peaks["sensitivity"].value
    assert ended.margins.phase <= whole.margins.phase


def test_polygons_are_given_up_where_the_time_is_over(monkeypatch):
    loop, result, band, *_ = measured()
    monkeypatch.setattr(ConsistentSet, "extreme", None)
    assert limiting_polygons(band, loop, result, band.omega, directions=8, rtol=0.1, time_limit=1e-6) is None


def test_a_frequency_is_given_up_between_two_programs(monkeypatch):
    """By a clock that goes on by a second whenever it is read; the first frequency is finished whatever the time is."""
    _, result, band, *_ = measured()
    seconds, programs, own = iter(range(10**6)), [], ConsistentSet.extreme
    monkeypatch.setattr(clocks.time, "monotonic", lambda: float(next(seconds)))
    monkeypatch.setattr(ConsistentSet, "extreme", lambda *one, **how: programs.append(1) or own(*one, **how))
    consistent, omega, counts = consistent_set(result), band.omega[1:5], {}
    for least, limit in ((0, 9.0), (1, 2.0), (1, 12.0), (1, None)):
        programs.clear()
        found = value_sets(consistent, omega, 8, 0.1, Means(budget=Budget(limit)), least=least)
        counts[least, limit] = len(found), len(programs)
        assert all(one.support.size == 8 for one in found)
    assert counts[0, 9.0][0] == 0 < counts[0, 9.0][1] < 8
    assert counts[1, 2.0] == (1, 8)
    assert counts[1, 12.0][0] == 1
    assert 8 < counts[1, 12.0][1] < 16
    assert counts[1, None] == (4, 32)


def test_those_above_all_that_are_solved_come_first_and_no_others():
    sizes = np.array([[3.0, 0.1], [5.0, 0.2], [4.0, -1.0], [1.0, -1.0]])
    assert _binding(sizes, np.array([False, False, False, True]), 2).tolist() == [1, 2, 0]
    assert _binding(sizes, np.array([True, True, False, False]), 2).size == 0
    assert _binding(np.full((3, 1), -1.0), np.zeros(3, bool), 2).size == 0
