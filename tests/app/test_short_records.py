"""Short noisy records of lightly damped plants, everything by default: the truth in the band, true modes in the boxes."""

import pytest

from support.cases import slow
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


@pytest.mark.parametrize(("seeds", "least"), [(1, 1), slow(40, 34)])
def test_band_of_half_a_second_holds_the_truth(seeds, least):
    assert min(counted(range(seeds))) >= least
