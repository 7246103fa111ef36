"""A path whose digits end before the accuracy: the best certificate on it counts, and what is known is said."""

import numpy as np
import pytest

import robustid as rid
from robustid.identification import margin
from robustid.identification.solver.paths import margin_path
from support.problems import random_problem


def problem(factor=1.0):
    """A problem of 30 coefficients, its bounds as many times as large as the smallest that are consistent."""
    found = rid.identify(random_problem(3, "mixed", 30, spread=0.2, noise=4.5), solver="structured")
    return random_problem(3, "mixed", 30, spread=0.2 * found.margin * factor, noise=4.5 / (found.margin * factor))


@pytest.fixture
def ended(monkeypatch):
    """Let the path of the solver end where its gap falls below a part of the margin, or only misjudge the gap from there on."""

    def set_up(part, *, goes_on):
        def path(data):
            for point, value, gap in margin_path(data):
                yield point, value, (gap if gap > part * value else value)
                if gap <= part * value and not goes_on:
                    return

        monkeypatch.setattr(margin, "margin_path", path)

    return set_up


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_the_best_of_the_last_certificates_counts_where_the_gap_is_misjudged(ended, factor):
    asked = problem(factor)
    ended(1e-2, goes_on=True)
    found = rid.identify(asked, solver="structured")
    assert found.claim.width <= 1e-4 == found.accuracy
    assert found.verification.passed
    assert not found.choices


@pytest.mark.parametrize(("factor", "status"), [(0.5, rid.Status.INCONSISTENT), (2.0, rid.Status.CONSISTENT)])
def test_a_finding_that_does_not_need_the_accuracy_stands_and_says_what_is_known(ended, factor, status):
    asked = problem(factor)
    whole = rid.identify(asked, solver="structured")
    ended(3e-2, goes_on=False)
    found = rid.identify(asked, solver="structured")
    assert 1e-4 < found.claim.width == found.accuracy < 0.1
    assert found.margin_lower <= whole.margin
    assert whole.margin_lower <= found.margin
    assert found.status is found.verified_status is whole.status is status
    assert found.verification.passed
    assert found.notes[0].startswith(f"the margin is known to {found.claim.width:.2g} only")
    assert found.choices["margin"].value == (found.margin_lower, found.margin)


def test_an_interval_that_contains_1_decides_nothing(ended):
    asked = problem(1.0)
    ended(3e-2, goes_on=False)
    found = rid.identify(asked, solver="structured")
    assert found.margin_lower <= 1 < found.margin
    assert found.claim.width > 1e-3
    assert found.verified_status is found.status is rid.Status.FAILED
    near = rid.identify(asked, solver="structured", accuracy=found.claim.width / 2)
    assert near.status is rid.Status.UNDECIDED
    assert near.verified_status is rid.Status.UNDECIDED
    assert np.isclose(near.accuracy, found.claim.width, rtol=1e-6)
