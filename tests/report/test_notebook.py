"""Heads for notebooks: small, in words, of every kind of result, and nothing is computed for them."""

import inspect

import numpy as np
import pandas
import pytest

import robustid as rid


def test_results_show_the_head_of_their_page(consistent, inconsistent):
    head = consistent._repr_html_()
    assert "Consistent" in head
    assert "rid.worst_case_error(result)" in head
    assert "Inconsistent" in inconsistent._repr_html_()
    error = rid.worst_case_error(consistent, omega=[60.0], directions=4)
    assert "guaranteed error" in error._repr_html_()
    fit = rid.fit_mfd(consistent.problem.frequency[0], order=2)
    assert "weighted residual" in fit._repr_html_()
    for one in (head, error._repr_html_(), fit._repr_html_()):
        assert len(one) < 5000
        assert "<script" not in one
        assert "http" not in one


def test_data_say_what_they_are():
    frf = rid.FrequencyResponse([10.0, 20.0], [1.0, 0.5j], bound=0.1, dt=0.01)
    assert "Hard bound" in frf._repr_html_()
    record = rid.TimeRecord(np.ones(4), np.ones(4), dt=0.01, outputs=["<b>angle</b>"])
    assert "No bound on the errors" in record._repr_html_()
    assert "&lt;b&gt;angle" in record._repr_html_()
    assert "<b>angle" not in record._repr_html_()


def test_what_has_a_summary_shows_its_first_lines_and_all_else_its_text():
    data = rid.datasets.flexible_structure(seed=0)
    assert "mode 1" in rid.suggest_kautz(data.frequency)._repr_html_()
    assert rid.Prior(gain_bound=1.0, decay_rate=1.1)._repr_html_() is None


def test_tables_are_tables_of_pandas(consistent):
    """Rows are named tuples or data classes: a data frame takes them as they are."""
    fit = rid.fit_mfd(consistent.problem.frequency[0], order=4)
    for rows in (rid.fits.mode_table(fit), rid.report.pole_table(consistent.model)):
        frame = pandas.DataFrame(rows)
        assert len(frame) == len(rows)
        assert "damping" in frame


@pytest.mark.parametrize("name", [name for name in dir(rid.plot) if name not in ("of",) and not name.startswith("_")])
def test_plots_take_axes_and_return_their_figure(name, consistent):
    function = getattr(rid.plot, name)
    if not inspect.isfunction(function) or function.__module__ != rid.plot.__name__:
        pytest.skip("no plot")
    assert "ax" in inspect.signature(function).parameters
