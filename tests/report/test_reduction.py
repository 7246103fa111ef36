"""The order of a model and of a reduced one."""

import control
import numpy as np
import pytest

import robustid as rid
from robustid.reduction import hankel_singular_values
from robustid.report import plot, render_report
from robustid.report.assumptions import assumptions
from robustid.report.small_model import hankel_chart, margin_chart
from support.paper_plant import structure
from support.report_pages import Page, layers

pytestmark = pytest.mark.quick


def test_hankel_chart_marks_the_order(consistent, reduction):
    drawn = layers(hankel_chart(consistent, reduction), 0)
    values = hankel_singular_values(consistent.model)
    assert drawn["kept"].x.size == reduction.order
    np.testing.assert_allclose(np.concatenate([drawn["kept"].y, drawn["truncated"].y]), values, rtol=1e-6)
    assert np.all(drawn[f"chosen order {reduction.order}"].x == reduction.order + 0.5)
    assert list(layers(hankel_chart(consistent), 0)) == ["of the nominal model"]


def test_integrators_are_kept_aside():
    integrator = control.ss(1.0, 1.0, 1.0, 0, 0.1)
    record = rid.TimeRecord(np.ones(8), np.arange(8.0), dt=0.1, bound=0.1)
    prior = rid.Prior(gain_bound=1.0, decay_rate=1.2)
    result = rid.identify(rid.MixedProblem(time=record, prior=prior, parametric=integrator))
    chart = hankel_chart(result)
    assert "1 state on the stability boundary" in chart.panels[0].title
    assert layers(chart, 0)["of the nominal model"].x.size == result.order - 1
    assert "integrator" in dict(assumptions(result))["Parametric part"]
    assert "∞" in Page(render_report(result)).text


def test_the_order_against_the_margin():
    result = rid.identify(structure(0))
    reduction = rid.reduce_within_bounds(result)
    drawn = layers(margin_chart(reduction), 0)
    assert list(zip(drawn["smallest found"].x, drawn["smallest found"].y, strict=True)) == list(reduction.tried)
    assert drawn["chosen order 4"].y == [reduction.margin]
    assert np.all(drawn["beyond the bounds"].y > 1)
    assert plot.orders(reduction).axes[0].get_xlabel() == "order [–]"
    page = render_report(result, reduction=reduction)
    assert "Best model of every order: at the samples" in page
    with pytest.raises(rid.InputError, match="tries no orders"):
        plot.orders(rid.balanced_truncation(result.model, order=10))
    with pytest.raises(
        rid.errors.InputTypeError,
        match="`result` must be of class OrderSweep, Reduction or ModelWorth; got Identification",
    ):
        plot.orders(result)
