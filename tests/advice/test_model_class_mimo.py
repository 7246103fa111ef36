"""Classes of matrices chosen by the guaranteed error: truth inside, units of the entries without a part in it."""

import numpy as np
import pytest

import robustid as rid
from robustid.advice import class_table, model_class, suggest_class, suggest_scaling
from robustid.advice.sensitivity import default_points
from robustid.core import responses
from support.matrix_lines import DT, lines, measured, plant


@pytest.fixture
def few_points(monkeypatch):
    """The first line and the modes alone, few cells, and no further multiplicities."""
    monkeypatch.setattr(model_class, "default_points", lambda data: default_points(data)[:1])
    monkeypatch.setattr(class_table, "_CELLS", 1)
    monkeypatch.setattr(model_class, "_REPEATS", (1, 2))
    monkeypatch.setattr(model_class, "_PRIORS", 1)


def drawn(outputs, inputs, **options):
    """A plant of one mode, its pole and its response."""
    rng = np.random.default_rng(2)
    truth, _ = plant(rng, 1, outputs, inputs)
    pole = np.log(truth.poles()[truth.poles().imag > 0][0])
    return truth, np.array([[abs(pole) / DT, -pole.real / abs(pole)]]), lines(rng, truth, **options)


@pytest.mark.usefixtures("few_points")
def test_the_truth_is_inside(monkeypatch):
    monkeypatch.setattr(model_class, "_REPEATS", (1,))
    truth, modes, frf = drawn(2, 1, count=4, bound=0.01)
    found = suggest_class(frequency=frf, modes=modes)
    best, omega = found.recommended, np.append(found.omega, 20.0)
    assert (best.pairs, best.repeat, best.covers_box) == (1, 1, False)
    np.testing.assert_allclose(best.prior.scaling, suggest_scaling(frf))
    assert best.upper.shape == (found.omega.size, 2, 1)
    result, upper = best.guaranteed(omega)
    off = np.abs(responses(truth, omega * DT) - responses(result.model, omega * DT))
    assert np.all(off <= upper)
    assert "<- recommended" in found.summary()
    with pytest.raises(rid.InputError, match="`frequency` is needed to take the modes from"):
        suggest_class(frequency=rid.TangentialResponse([1.0], [[[0.1], [0.1]]], bound=0.1, dt=DT), scaling=[[1], [1]])


@pytest.mark.usefixtures("few_points")
def test_a_candidate_that_time_or_interruption_cuts_short_says_so(monkeypatch):
    _, modes, frf = drawn(2, 1, count=4, bound=0.01)
    found = suggest_class(frequency=frf, modes=modes, time_limit=1e-9)
    first, second = found.candidates
    assert first.note == f"the time was over after 1 of {found.omega.size} frequencies"
    known = np.isfinite(first.error)
    assert known.sum() == 1
    assert np.isnan(first.upper[~known]).all()
    assert (found.recommended, found.next_line) == (first, found.omega[known][0])
    assert second.note == "the time was over"
    assert "frequencies  <- recommended" in found.summary()
    calls = []

    def interrupted(result, *, omega, **options):
        calls.append(omega)
        return rid.worst_case_error(result, omega=omega[-1:], **options)

    monkeypatch.setattr(class_table, "worst_case_error", interrupted)
    monkeypatch.setattr(model_class, "_REPEATS", (1, 1))
    (only,) = suggest_class(frequency=frf, modes=modes).candidates
    assert len(calls) == 1
    assert np.isfinite(only.error).tolist() == [False] * (found.omega.size - 1) + [True]


@pytest.mark.slow
@pytest.mark.usefixtures("few_points")
def test_units_do_not_matter():
    """To the gap that is left between proved and attained errors; the same prior, exactly."""
    _, modes, frf = drawn(2, 1, count=8, bound=0.01)
    found, units = suggest_class(frequency=frf, modes=modes), 2.0 ** np.array([[-20], [10]])
    scaled = rid.FrequencyResponse(frf.omega, units * frf.values, bound=units * frf.bound.radius, dt=DT)
    other = suggest_class(frequency=scaled, modes=modes)
    np.testing.assert_allclose(other.recommended.error, found.recommended.error, rtol=0.1)
    assert other.recommended.prior.gain_bound == pytest.approx(found.recommended.prior.gain_bound, rel=1e-6)
    assert other.next_line == found.next_line


@pytest.mark.slow
@pytest.mark.usefixtures("few_points")
def test_the_box_of_poles_from_the_data_is_covered_in_every_entry():
    truth, modes, frf = drawn(1, 2, count=16, bound=0.002)
    found = suggest_class(frequency=frf)
    best = found.recommended
    assert best.covers_box
    assert {row.repeat for row in found.candidates if np.all(np.isfinite(row.error))} == {1, 2}
    low, high = best.modes.omega_interval[0]
    assert low <= modes[0, 0] <= high
    for row in found.candidates:
        if np.all(np.isfinite(row.error)):
            result, upper = row.guaranteed(modes[:, 0])
            off = np.abs(responses(truth, modes[:, 0] * DT) - responses(result.model, modes[:, 0] * DT))
            assert np.all(off <= upper)
            assert upper.shape == (1, 1, 2)


@pytest.mark.slow
def test_two_modes_of_a_matrix_and_their_box():
    truth, _, frf = measured(bound=0.005, count=20)
    found = suggest_class(frequency=frf)
    best = found.recommended
    assert best.pairs == 2
    omega = np.append(found.omega, [30.0, 70.0])
    result, upper = best.guaranteed(omega)
    off = np.abs(responses(truth, omega * DT) - responses(result.model, omega * DT))
    assert np.all(off <= upper)
