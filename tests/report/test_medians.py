"""The median of a guaranteed error: one number at the terminal and on the page, of the model, over the frequencies of the data."""

import statistics

import numpy as np
import pytest

import robustid as rid
from robustid.app.run.findings import band_words, error_words
from robustid.report.guarantee import guarantee_sentence
from robustid.report.pole_box import box_sentence
from robustid.report.proved_band import band_sentence
from support.structure import about_structure

DATA = rid.datasets.flexible_structure(lines=12)


@pytest.fixture(scope="module")
def result():
    return rid.identify(about_structure(DATA, 0.2, 1.1))


@pytest.fixture(scope="module")
def small(result):
    return rid.reduce_within_bounds(result).model


def shares(found, model, omega):
    """Errors over responses, evaluated one by one at the frequencies between the lines."""
    low, high = DATA.frequency.omega[[0, -1]]
    return [
        100 * float(np.linalg.norm(upper, 2)) / abs(complex(model(np.exp(1j * w * model.dt))))
        for w, upper in zip(omega, found.upper, strict=True)
        if low <= w <= high
    ]


def check(found, expected, *texts):
    middle = statistics.median(expected)
    assert middle <= found.relative.median <= middle * 1.001
    assert found.relative.omega.size == len(expected)
    words = f"{found.relative.median:.4g} % of the response at {len(expected)} frequencies"
    assert [text for text in texts if words not in text] == []


def test_of_a_band(result, small):
    found = rid.band(result).with_model(small)
    assert found.omega[-1] > 1.5 * DATA.frequency.omega[-1], "nothing lies beyond the data"
    sentence = band_sentence(result, found)
    check(found, shares(found, small, found.omega), found.summary(), sentence, band_words(found, None))
    from_centres = rid.band(result.problem)
    sizes = np.abs(from_centres.centre[:, 0, 0])
    inside = (from_centres.omega >= DATA.frequency.omega[0]) & (from_centres.omega <= DATA.frequency.omega[-1])
    check(
        from_centres,
        (100 * from_centres.upper[:, 0, 0] / sizes)[inside].tolist(),
        from_centres.summary(),
        band_sentence(result, from_centres),
    )


def test_of_worst_cases(result, small):
    omega = np.append(DATA.frequency.omega[2:5] * 1.01, 0.99 * np.pi / result.problem.dt)
    error = rid.worst_case_error(result, model=small, omega=omega, directions=4)
    check(error, shares(error, small, omega), error.summary(), guarantee_sentence(error), error_words(error))
    box = DATA.modes[:, :1] * [0.999, 1.001], DATA.modes[:, 1:] * [0.95, 1.05]
    over = rid.guarantee.worst_case_over_poles(result, *box, model=small, omega=omega, directions=4, cells=1)
    check(over, shares(over, small, omega), over.summary(), box_sentence(over))


def test_of_frequencies_that_are_all_outside_of_the_data(result):
    omega = np.array([0.9, 0.95]) * np.pi / result.problem.dt
    found = rid.band(result, omega=omega)
    assert found.relative.omega.tolist() == omega.tolist()
    assert found.relative.median == pytest.approx(
        100 * np.median(found.upper[:, 0, 0] / np.abs(found.nominal[:, 0, 0])), rel=1e-3
    )
