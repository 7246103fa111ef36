"""Withheld responses against a band: shares, excess, sentences, and bad input."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from support.refusals import refused

OMEGA = np.array([1.0, 2.0, 3.0])


def response(values, bound=None, omega=OMEGA, **options):
    return rid.FrequencyResponse(omega, values, bound=bound, **{"dt": 0.5} | options)


@pytest.fixture(scope="module")
def band():
    return response([1.0, 0.5j, -0.2], bound=[0.1, 0.05, 0.02])


def test_inside(band):
    found = rid.coverage(band, response([1.05, 0.5j, -0.19], bound=0.01))
    assert not found.contradicted
    assert found.share == 1
    assert found.scores == pytest.approx([1.0])  # 0.01 off and 0.01 of its own, over 0.02
    assert found.next_record == (pytest.approx(1.0), None)
    assert "no probability" in found.summary()
    assert found.verdict.startswith("Supported by withheld data: but for their own bounds the samples of 1 withheld")


def test_outside_by_more_than_its_own_bound_contradicts(band):
    found = rid.coverage(band, [response([1.05, 0.5j, -0.2], bound=0.01), response([1.0, 0.7j, -0.2], bound=0.01)])
    assert found.contradicted
    assert found.share == pytest.approx(5 / 6)
    assert found.largest == pytest.approx((0.2 - 0.01) / 0.05)
    assert found.where == f"record 2, {2 / (2 * np.pi):.5g} Hz"
    said = found.summary()
    assert said.startswith("Contradicted by withheld data: only 83.33 %")
    assert "Needed: a band at least 3.8 times as wide; or poles in a pole-uncertainty box" in said
    assert "or another record" in said
    assert "times 4.2 holds the next record with probability at least 2/3" in said


def test_outside_by_less_than_its_own_bound_does_not(band):
    found = rid.coverage(band, response([1.105, 0.5j, -0.2], bound=0.01))
    assert not found.contradicted
    assert found.scores[0] == pytest.approx(1.15)


def test_lines_and_periods_say_nothing_of_the_next_record(band):
    many = [response([1.0, 0.5j, d - 0.2], bound=0.01) for d in (0.01, 0.0, 0.005)]
    for kind in ("lines", "periods"):
        found = rid.coverage(band, many, kind=kind)
        assert found.next_record.probability is None
        assert "say nothing of the next record" in found.summary()
    assert rid.coverage(band, many).next_record.probability == 3 / 4


def test_scores_in_the_order_of_the_records_are_named(band):
    drifting = [response([1.0 + 0.05 * k, 0.5j, -0.2], bound=0.001) for k in range(1, 7)]
    found = rid.coverage(band, drifting)
    assert not found.exchangeable
    assert found.next_record.probability is None
    assert "the 6 scores stand in the order of the records (0.51, 1.01, 1.51," in found.summary()
    assert "drifts" in found.summary()
    mixed = rid.coverage(band, [drifting[k] for k in (2, 0, 5, 1, 4, 3)])
    assert mixed.exchangeable
    assert mixed.next_record.probability == 6 / 7


def test_common_frequencies_only_and_missing_entries(band):
    finer = response(np.full(5, 1.0), bound=[0.01, 0.01, np.inf, 0.01, 0.01], omega=[1.0, 1.5, 2.0, 2.5, 3.5])
    found = rid.coverage(band, finer)
    assert found.omega.tolist() == [1.0, 2.0]
    assert np.isnan(found.error[0, 1, 0, 0])
    assert found.share == 1


def test_the_band_of_a_worst_case_error_and_of_a_box():
    frf = rid.FrequencyResponse(OMEGA, [1.0, 0.9 - 0.1j, 0.7 - 0.1j], bound=0.05, dt=0.5)
    result = rid.identify(rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=2.0, decay_rate=1.3)))
    error = rid.worst_case_error(result, omega=OMEGA, directions=8)
    own = rid.coverage(error, frf, kind="lines")
    assert not own.contradicted
    assert own.error[0, :, 0, 0] == pytest.approx(np.abs(frf.values[:, 0, 0] - error.nominal) / error.upper[:, 0, 0])
    far = frf.values + 3 * error.upper
    assert rid.coverage(error, dataclasses.replace(frf, values=far, bound=None)).contradicted


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"dt": 0.4}, "of dt = 0.4 s, the band of dt = 0.5 s"),
        ({"omega": OMEGA + 0.1}, "no frequency in common"),
        ({"values": np.ones((3, 2, 1)), "bound": None}, "record 1 is a 2 x 1 response, the band is about 1 x 1"),
    ],
)
def test_unlike_responses_are_refused(band, change, words):
    plain = {"values": np.ones(3), "bound": 0.1} | change
    refused(words, lambda: rid.coverage(band, response(**plain)))


def test_bad_arguments(band):
    one = response(np.ones(3))
    refused("`withheld` is empty", rid.coverage, band, [])
    refused("`kind` must be one of", rid.coverage, band, one, kind="days")
    refused("`names` must be one for each of 1", rid.coverage, band, one, names=["a", "b"])
    refused("without a bound", rid.coverage, one, one)
    refused("`band` must be a Band, a WorstCaseError", rid.coverage, 0.1, one, error=TypeError)
    refused("`withheld` must be a FrequencyResponse", rid.coverage, band, [0.1], error=TypeError)
