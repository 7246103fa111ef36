"""The guaranteed error against the assumptions, and the prior that makes it small."""

import importlib

import numpy as np
import pytest

import robustid as rid
from robustid.advice.sensitivity import guaranteed
from robustid.advice.smallest_gain import smallest_gain
from robustid.core import Interruptible
from support.structure import about_structure


def structure(lines, gain=0.2, rate=1.2):
    return about_structure(rid.datasets.flexible_structure(lines=lines, samples=2), gain, rate, time=True)


def test_larger_classes_and_fewer_lines_have_wider_bands():
    problem = structure(8)
    found = rid.advise.sensitivity(problem, omega=[70.0])
    rows = {row.what: row for row in found.variations}
    stated = rows["as stated"]
    assert stated.margin == pytest.approx(rid.identify(problem).margin, abs=1e-4)
    assert rows["gain bound x 0.5"].median < stated.median < rows["gain bound x 2"].median
    slower, faster = (row for name, row in rows.items() if name.startswith("decay rate"))
    assert slower.median > stated.median > faster.median
    assert rows["every second frequency point"].worst >= stated.worst
    assert "as stated" in found.summary()
    abscissa, median = found.curve("gain")
    np.testing.assert_allclose(abscissa, [0.1, 0.2, 0.4])
    assert median.tolist() == [rows["gain bound x 0.5"].median, stated.median, rows["gain bound x 2"].median]
    abscissa, median = found.curve("decay")
    np.testing.assert_allclose(abscissa, [1.1, 1.2, 1.4])
    assert np.all(np.diff(median) < 0)
    assert found.curve("lines")[0].tolist() == [4, 8]
    with pytest.raises(rid.InputError, match="`kind`"):
        found.curve("poles")


def test_the_time_ends_the_table_and_says_what_is_missing():
    record, told = rid.TimeRecord([1.0, 0.0], [0.5, 0.2], dt=1.0, bound=0.1), []
    problem = rid.MixedProblem(time=record, prior=rid.Prior(gain_bound=1.0, decay_rate=1.5))
    found = rid.advise.sensitivity(problem, omega=[0.5], time_limit=1e-9)
    assert [row.what for row in found.variations] == ["as stated"]
    assert found.left_out[:2] == ("gain bound x 0.5", "gain bound x 2")
    assert "No time was left for: gain bound x 0.5" in found.summary()
    whole = rid.advise.sensitivity(problem, omega=[0.5], progress=lambda text, *at: told.append(at))
    assert whole.left_out == ()
    assert told == [(k, len(whole.variations)) for k in range(1, 6)]


def test_a_refuted_variation_says_so():
    frf = rid.FrequencyResponse([10.0, 60.0], [1.0, -1.0], bound=0.1, dt=0.01)
    problem = rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=1.0, decay_rate=1.2))
    problem = problem.with_prior(gain_bound=1.2 * smallest_gain(problem, 1.2))
    assert rid.identify(problem).consistent
    found = rid.advise.sensitivity(problem, omega=[30.0])
    refuted = [row for row in found.variations if row.margin > 1]
    assert refuted
    assert all(np.isnan(row.median) for row in refuted)
    assert found.summary().count("refuted") == len(refuted)


def test_the_prior_with_the_smallest_guaranteed_error():
    problem = structure(6)
    options = {"decay_rates": [1.05, 1.3]}
    found = rid.suggest_prior(problem, criterion="error", **options)
    assert np.all(np.isfinite(found.errors))
    best = int(np.argmin(found.errors))
    assert found.prior.decay_rate == found.decay_rates[best]
    chosen = problem.with_prior(gain_bound=found.prior.gain_bound, decay_rate=found.prior.decay_rate)
    lines = problem.frequency[0].omega
    assert guaranteed(chosen, np.linspace(lines[0], lines[-1], 7))[1] == pytest.approx(found.errors[best], rel=1e-6)
    assert "guaranteed error" in found.summary()
    plain = rid.suggest_prior(problem, decay_rates=[1.3])
    assert np.all(np.isnan(plain.errors))
    with pytest.raises(rid.InputError, match="`criterion`"):
        rid.suggest_prior(problem, criterion="best")
    with pytest.raises(rid.errors.InputTypeError, match="MixedProblem"):
        rid.advise.sensitivity(3)


def test_ctrl_c_in_a_variation_that_keeps_it_back_ends_the_table(monkeypatch):
    """An error at some of the frequencies is what one search keeps; the next variations do not begin."""
    calls = []

    def kept_back(result, **how):
        calls.append(result)
        with Interruptible():
            if len(calls) == 2:
                raise KeyboardInterrupt
        return rid.worst_case_error(result, **how)

    monkeypatch.setattr(importlib.import_module(guaranteed.__module__), "worst_case_error", kept_back)
    record = rid.TimeRecord([1.0, 0.0], [0.5, 0.2], dt=1.0, bound=0.1)
    problem = rid.MixedProblem(time=record, prior=rid.Prior(gain_bound=1.0, decay_rate=1.5))
    found = rid.advise.sensitivity(problem, omega=[0.5])
    assert [row.what for row in found.variations] == ["as stated"]
    assert len(calls) == 2
