"""What the class and the small model are worth: verdicts at the head of the page, and their pictures."""

import dataclasses

import control
import numpy as np
import pytest

import robustid as rid
from robustid.advice import content
from robustid.reduction import model_worth_having, why_not_compared
from robustid.report import plot, render_report
from robustid.report.sensitivity_section import content_chart, content_verdict
from robustid.report.small_model import worth_chart, worth_verdict
from support.report_pages import Page, layers


def question(**prior):
    data = rid.datasets.flexible_structure(lines=24)
    basis = rid.kautz(*data.modes.T, dt=0.01, delay=1)
    return rid.MixedProblem(frequency=data.frequency, parametric=basis, prior=rid.Prior(**prior))


@pytest.fixture(scope="module")
def result():
    return rid.identify(question(gain_bound=0.1, decay_rate=1.2))


@pytest.fixture(scope="module")
def worth(result):
    return model_worth_having(result, rid.reduce_within_bounds(result), result.problem.frequency[0], time_limit=3.0)


def test_a_class_with_content_says_so_after_the_verdict_and_one_without_before_it(result):
    says, empty = content(result), rid.identify(question(gain_bound=10.0, decay_rate=1.005))
    page = Page(render_report(result, content=says))
    assert page.text.index("A system of the assumed class") < page.text.index("as much between the points as on them")
    nothing = content(empty)
    assert content_verdict(nothing).key == "inconsistent"
    text = Page(render_report(empty, content=nothing)).text
    assert text.index("The class says nothing between the points") < text.index("A system of the assumed class")
    assert "What the class says between the points" in text


def test_widths_are_drawn_as_they_are(result):
    says = content(result)
    drawn = layers(content_chart(says), 0)
    np.testing.assert_array_equal(drawn["on the points"].y, says.on)
    np.testing.assert_array_equal(drawn["between them"].y, says.between)
    np.testing.assert_allclose(drawn["between them"].x, says.omega / (2 * np.pi))


def test_the_small_model_stands_among_the_best_fits(result, worth):
    drawn = layers(worth_chart(worth), 0)
    np.testing.assert_array_equal(drawn["best fits"].y, worth.misfits)
    assert drawn[f"small model, order {worth.reduction.order}"].y == worth.misfit
    assert worth_verdict(worth).key == "consistent"
    assert worth_verdict(dataclasses.replace(worth, worse=True)).key == "weak"
    text = Page(render_report(result, worth=worth)).text
    assert "What the small model is worth" in text
    assert text.index("The small model fits about as well") < text.index("Consistency margin")
    assert plot.orders(worth).axes[0].get_ylabel() == "misfit [–]"


def test_what_cannot_be_compared_says_why(result):
    small = rid.reduce_within_bounds(result)
    frf = result.problem.frequency[0]
    assert why_not_compared(result, small, frf) == ""
    assert "no frequency response" in why_not_compared(result, small, None)
    assert "1 frequency points are too few" in why_not_compared(result, small, frf.select(slice(0, 1)))

    integrator = dataclasses.replace(small, model=control.ss(1.0, 1.0, 1.0, 0, 0.01))
    assert "integrators" in why_not_compared(result, integrator, frf)
    assert model_worth_having(result, integrator, frf) is None
