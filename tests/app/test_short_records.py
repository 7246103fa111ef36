"""Short noisy records of lightly damped plants, everything by default: the truth in the band, true modes in the boxes."""

import pytest

from support.short_records import judged, record_of


def counted(seeds):
    """Seeds in which the band holds the truth, and all boxes hold a mode; all of those where the bound of the response holds."""
    band = boxes = 0
    for seed in seeds:
        plant, record, _ = record_of(seed)
        found = judged(plant, record, compare=False)
        band += found.band is not None and found.band <= 1
        boxes += found.found == found.held == 3
        if found.lines <= 1:
            assert found.band is not None
            assert found.band <= 1
    return band, boxes


def test_band_of_half_a_second_holds_the_truth():
    assert min(counted([0])) == 1


@pytest.mark.slow
def test_band_of_half_a_second_holds_the_truth_in_forty_seeds():
    assert min(counted(range(40))) >= 34
