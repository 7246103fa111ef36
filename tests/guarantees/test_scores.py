"""Probabilities from scores: every order counted, and simulated records whose distribution is known."""

import itertools

import numpy as np
import pytest

import robustid as rid
from robustid.guarantees import ResponseDiscs, band_of_others, chance_of_order, ranked


def test_the_kth_of_the_scores_holds_the_next_one_in_so_many_of_all_orders():
    """k/(R + 1) exactly, where no two scores are equal: every order of five numbers, the last one the next record."""
    orders = list(itertools.permutations([0.3, 0.9, 1.4, 2.0, 7.0]))
    for k in range(1, 5):
        held = np.mean([order[-1] <= ranked(order[:-1], k).factor for order in orders])
        assert held == pytest.approx(ranked(orders[0][:-1], k).probability)
        assert held == pytest.approx(k / 5)


def test_one_score_gives_no_probability():
    assert ranked([1.31]) == (1.31, None)


@pytest.mark.parametrize("rank", [0, 4])
def test_a_rank_that_is_not_there_is_refused(rank):
    with pytest.raises(rid.InputError, match="`rank` must be from 1"):
        ranked([1.0, 2.0, 3.0], rank)


@pytest.mark.parametrize("scores", [[1, 2, 3, 4, 5], [5, 4, 3, 2, 1], [1, 3, 2, 4, 5], [2, 1, 4, 3], [1, 2]])
def test_the_chance_of_an_order_is_counted_over_all_orders(scores):
    def falls(order):
        return sum(a > b for a, b in itertools.combinations(order, 2))

    pairs = len(scores) * (len(scores) - 1) // 2
    mine = min(falls(scores), pairs - falls(scores))
    counted = [min(falls(order), pairs - falls(order)) <= mine for order in itertools.permutations(scores)]
    assert chance_of_order(scores) == pytest.approx(min(1.0, np.mean(counted)))


def test_equal_scores_are_in_no_order():
    assert chance_of_order([1.0, 1.0, 1.0, 1.0, 1.0]) == 1.0
    assert chance_of_order([2.0]) == 1.0


def drawn(rng, count, points=6):
    """Records of plants that differ in gain and phase, heavy tails: exchangeable by construction."""
    size = rng.standard_t(3, (count, 1)) * 0.1
    return (1 + size + 0.05j * rng.standard_t(3, (count, points)))[:, :, None, None]


def test_split_scores_hold_the_next_record_as_often_as_they_say():
    """800 draws of 4 + 4 + 1 records: at least 4/5, within three standard deviations of a binomial count."""
    rng, held = np.random.default_rng(0), 0
    for _ in range(800):
        records = drawn(rng, 9)
        centre, radius = records[:4].mean(axis=0), np.abs(records[:4] - records[:4].mean(axis=0)).max(axis=0)
        scores = (np.abs(records[4:] - centre) / radius).max(axis=(1, 2, 3))
        held += scores[-1] <= ranked(scores[:-1]).factor
    assert held >= 800 * 0.8 - 3 * np.sqrt(800 * 0.16)
    assert held <= 800 * 0.8 + 3 * np.sqrt(800 * 0.16)


def test_leave_one_out_bands_hold_the_next_record_at_least_as_often_as_they_say():
    """400 draws of 5 + 1 records: at least 1 - 2/6."""
    rng, held = np.random.default_rng(1), 0
    omega = np.arange(1.0, 7.0)
    for _ in range(400):
        records = drawn(rng, 6)
        bands, scores = [], []
        for k in range(5):
            rest = np.delete(records[:5], k, axis=0)
            centre = rest.mean(axis=0)
            bands.append(ResponseDiscs(omega, centre, np.abs(rest - centre).max(axis=0), 0.1))
            scores.append((np.abs(records[k] - centre) / bands[-1].radius).max())
        centre, radius, probability = band_of_others(bands, scores)
        assert probability == pytest.approx(2 / 3)
        for band, score in zip(bands, scores, strict=True):
            assert np.all(np.abs(band.centre - centre) + score * band.radius <= radius * (1 + 1e-12))
        held += bool(np.all(np.abs(records[5] - centre) <= radius))
    assert held >= 400 * 2 / 3
