"""Variances that neighbouring lines share: how often bounds from them fail, exactly, and what they gain."""

import numpy as np
import pytest

from robustid.data import joint_radius
from support.cases import slow
from support.line_variances import PLACES, chance, drawn, of_loop
from support.pairwise import every_one

SMOOTH = 1 / np.abs(np.exp(2j * np.pi * PLACES / 400) - 0.9) ** 2


def every_fifth(factor):
    return np.where(np.arange(PLACES.size) % 5 == 2, factor, 1.0)


def mean_of(cases, periods, rng):
    """Mean of the chances and its standard deviation."""
    found = [chance(response, variance, PLACES, periods, rng) for response, variance in cases]
    return np.mean(found), np.std(found) / np.sqrt(len(found))


@pytest.mark.parametrize("periods", [3, 10])
@pytest.mark.parametrize(("machines", "draws"), [(range(10), 12), slow(range(10, 110), 20)])
@pytest.mark.parametrize("name", ["R", "u to y"])
def test_in_a_loop_bounds_fail_no_more_often_than_they_promise(name, machines, draws, periods):
    """Noise of R has peaks that neighbours do not know of: with a variance that is smooth for certain 6.7 % and 9 % fail."""
    cases = [of_loop(seed)[name] for seed in machines for _ in range(draws)]
    mean, deviation = mean_of(cases, periods, np.random.default_rng(periods))
    assert mean <= 0.05 + 2 * deviation


@pytest.mark.parametrize(
    ("periods", "variance"),
    every_one([2, 4, 10], [SMOOTH, np.ones(40), SMOOTH * np.where(np.arange(40) == 20, 1e3, 1.0)]),
)
def test_in_open_loop_too_and_beside_a_line_that_stands_out(variance, periods):
    response = np.linspace(1, 2, 40)
    mean, deviation = mean_of([(response, variance)] * 100, periods, np.random.default_rng(1))
    assert mean <= 0.05 + 2 * deviation


@pytest.mark.parametrize(("periods", "part"), [(2, 0.25), (4, 0.72), (10, 0.93)])
def test_neighbours_that_are_alike_narrow_the_bounds(periods, part):
    """To a quarter of those of each line by itself with two periods; at best .18, .66 and .90."""
    rng, widths = np.random.default_rng(2), []
    for _ in range(50):
        variance, dof, _ = drawn(np.linspace(1, 2, 40), SMOOTH, PLACES, periods, rng)
        widths.append(joint_radius(0.95, 40, dof) * np.sqrt(variance))
    own = [
        joint_radius(0.95, 40, periods - 1.0) * np.sqrt(rng.gamma(periods - 1, 1 / (periods - 1))) for _ in range(2000)
    ]
    assert np.median(widths) < part * np.median(own)


def test_lines_that_scatter_beyond_chance_are_worth_less():
    """From the same draws: as lines differ more, the neighbours are worth less, and in the end not one residual more."""
    degrees = [
        np.median(drawn(np.ones(40), every_fifth(factor), PLACES, 4, np.random.default_rng(3))[1])
        for factor in (1.0, 4.0, 1e4)
    ]
    assert degrees[0] > degrees[1] > degrees[2]
    assert degrees[2] < 4  # three are its own


def test_a_line_alone_keeps_its_own_variance():
    """Far from all others nothing is known of it but its own scatter."""
    index = np.array([20, 25, 30, 35, 40, 400])
    variance, dof, lines = drawn(np.ones(6), np.ones(6), index, 3, np.random.default_rng(5))
    own = np.random.default_rng(5)
    own.standard_normal(6), own.standard_normal(6)
    assert variance[5] == pytest.approx(own.gamma(2.0, 0.5, 6)[5])
    assert dof[5] == 2.0
    assert np.all(dof[:5] > 2.0)
    assert lines == 5
