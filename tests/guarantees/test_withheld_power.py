"""What withheld data could have shown: bands that are too narrow are not called supported, true ones not contradicted."""

from collections import Counter

import numpy as np
import pytest
from scipy.stats import ncx2

import robustid as rid
from robustid.data import joint_radius
from robustid.guarantees import Judgement, shown
from support.withheld_cases import case

OMEGA = np.array([1.0, 2.0, 3.0, 4.0])


def response(values, bound, **options):
    return rid.FrequencyResponse(OMEGA, values, bound=bound, **{"dt": 0.5} | options)


@pytest.fixture(scope="module")
def band():
    return response(np.ones(4), 0.1)


@pytest.mark.parametrize(
    ("bound", "power", "judgement"),
    [
        (0.099, 1.0, Judgement.SUPPORTED),
        (0.1, 0.0, Judgement.NOT_TESTED),
        ([0.01, 0.01, 0.01, 0.2], 0.75, "not tested"),
    ],
)
def test_samples_with_a_bound_as_large_as_the_band_support_nothing(band, bound, power, judgement):
    found = rid.coverage(band, response(np.ones(4), bound), kind="lines")
    assert (found.power, found.judgement) == (power, judgement)
    assert found.verdict.startswith(f"{judgement.capitalize()} by withheld data: ")


def test_what_they_contradict_is_contradicted_whatever_they_could_have_shown(band):
    found = rid.coverage(band, response([1.0, 1.0, 1.0, 1.4], 0.2))
    assert (found.power, found.judgement, found.contradicted) == (0.0, Judgement.CONTRADICTED, True)
    assert "not tested" not in found.summary()


def test_a_sample_that_another_record_judges_counts(band):
    left, right = ([0.01, 0.01, 0.3, 0.3], [0.3, 0.3, 0.01, 0.01])
    found = rid.coverage(band, [response(np.ones(4), bound) for bound in (left, right)])
    assert found.judgement is Judgement.SUPPORTED
    assert rid.coverage(band, response(np.ones(4), left)).power == 0.5


def test_where_the_band_says_nothing_there_is_nothing_to_test(band):
    half = response(np.ones(4), [0.1, np.inf, 0.1, 0.1])
    assert rid.coverage(half, response(np.ones(4), [0.01, 0.01, 0.2, 0.01])).power == pytest.approx(2 / 3)
    nowhere = rid.coverage(half, response(np.ones(4), 0.01).select([1]))
    assert (nowhere.power, nowhere.judgement) == (0.0, Judgement.NOT_TESTED)


def test_an_error_of_three_half_widths_shows_wherever_it_is_sure_to():
    """Known bounds: over all errors that they allow the nearest sample is outside, or there is one that is not."""
    turn = np.exp(2j * np.pi * np.arange(720) / 720)
    for own in (0.2, 0.95, 1.05, 1.9):
        away = np.abs(3 + own * turn)
        sure = shown(np.ones((1, 1, 1)), rid.FrequencyResponse([1.0], [0.0], bound=own, dt=0.1)).item()
        assert sure == float(np.all(away > 1 + own))


def test_its_probability_is_at_most_that_of_normal_errors():
    half = np.linspace(0.05, 3.0, 40)[:, None, None]
    omega = np.linspace(1.0, 2.0, 40)
    frf = rid.FrequencyResponse(omega, np.zeros(40), covariance=np.ones((40, 1, 1)), dt=0.1).with_joint_bound()
    found, own = shown(half, frf), frf.bound.radius
    exact = ncx2.sf(2 * (half + own) ** 2, 2, 2 * (3 * half) ** 2)  # of |3 r + n|^2, E|n|^2 = 1
    counts = half > np.sqrt(np.log(20))  # what |n| alone exceeds with a probability of 5 %
    assert np.array_equal(found > 0, counts)
    assert np.all(found <= exact)
    assert np.max((exact - found)[counts]) < 0.05
    assert found.max() > 0.95


def test_its_probability_with_few_degrees_of_freedom():
    """Of levels of the noise that are all as likely, so that how it was estimated counts."""
    rng, dof, tries = np.random.default_rng(3), 4, 200_000
    level = 10 ** rng.uniform(-2, 1, tries)
    estimate = level * np.sqrt(rng.chisquare(2 * dof, tries) / (2 * dof))
    error = level * (rng.standard_normal(tries) + 1j * rng.standard_normal(tries)) / np.sqrt(2)
    own = float(joint_radius(0.95, 50, dof)) * estimate
    omega = np.linspace(0.1, 3.0, tries)
    covariance = (estimate**2)[:, None, None]
    bound = rid.Bound(own, kind="confidence", probability=0.95, dof=dof)
    frf = rid.FrequencyResponse(omega, np.zeros(tries), bound=bound, covariance=covariance, dof=dof, dt=1.0)
    said, hit = shown(np.ones((tries, 1, 1)), frf).ravel(), np.abs(3 + error) > 1 + own
    for low, high in ((0.2, 0.5), (0.5, 0.8), (0.8, 0.95), (0.95, 0.99)):
        here = (said > low) & (said <= high)
        assert said[here].mean() <= hit[here].mean() + 3 / np.sqrt(here.sum())


def test_the_stated_rate_is_that_of_the_bounds(band):
    bound = rid.Bound(0.01, kind="confidence", probability=0.95)
    assert rid.coverage(band, response(np.ones(4), 0.01)).false_alarm == 0
    found = rid.coverage(band, [response(np.ones(4), bound)] * 3)
    assert found.false_alarm == pytest.approx(0.15)
    assert "contradicted with a probability of at most 15 %" in found.summary()
    assert rid.coverage(band, response(np.ones(4), rid.Bound(0.01, kind="confidence"))).false_alarm is None


def test_scores_are_shown_where_they_say_something_and_explained_above_one(band):
    alone = rid.coverage(band, response(np.ones(4), 0.9))
    assert alone.scores == pytest.approx([9.0])
    assert "9" not in alone.summary().replace("9 times smaller", "")
    two = rid.coverage(band, [response(np.ones(4), b) for b in (0.9, 0.5)])
    assert "The band times 9 holds the next record" in two.summary()
    assert "The factor is above 1 although nothing was seen outside the band" in two.summary()
    assert "scores" not in rid.coverage(band, response(np.ones(4), 0.9), kind="periods").summary()


def judged(kinds, seeds):
    """How often a band is called what: true ones, those that are three times too narrow, and the rate that is stated."""
    true, narrow, allowed = Counter(), Counter(), 0.0
    for kind, how in kinds:
        for seed in seeds:
            one = case(kind, seed, how)
            first = rid.coverage(one.band, one.withheld, kind=kind)
            true[first.judgement] += 1
            narrow[rid.coverage(one.narrow, one.of_narrow, kind=kind).judgement] += 1
            allowed += first.false_alarm
    return true, narrow, allowed


def test_of_whole_cases_few_that_are_too_narrow_are_supported():
    kinds = [("records", "scaled"), ("periods", "moved"), ("lines", "scaled")]
    true, narrow, allowed = judged(kinds, range(1))
    assert narrow[Judgement.SUPPORTED] == 0
    assert true[Judgement.CONTRADICTED] <= allowed
    assert true[Judgement.SUPPORTED] >= 2  # of 3: of one the withheld data may be a few periods


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "how"),
    [("records", "scaled"), ("records", "moved"), ("periods", "scaled"), ("periods", "moved"), ("lines", "scaled")],
)
def test_of_a_hundred_whole_cases_at_most_five_that_are_too_narrow_are_supported(kind, how):
    true, narrow, allowed = judged([(kind, how)], range(100))
    assert narrow[Judgement.SUPPORTED] <= 5
    assert true[Judgement.CONTRADICTED] <= allowed
