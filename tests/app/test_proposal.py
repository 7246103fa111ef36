"""Problems that are proposed from data alone."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.app.run.class_settings import PriorChoice
from robustid.app.run.settings import Modes
from support.posed import proposed

pytestmark = pytest.mark.quick


@pytest.mark.parametrize(("missing", "words"), [({"bound": None}, "bound on every sample"), ({}, "both missing")])
def test_a_proposal_needs_data_with_a_bound(missing, words):
    frf = dataclasses.replace(rid.datasets.flexible_structure(seed=0).frequency, **missing)
    with pytest.raises(rid.InputError, match=words):
        proposed([frf] if missing else [])


def test_a_proposal_says_what_was_chosen():
    data = rid.datasets.flexible_structure(seed=0, lines=6, samples=6, extra_hz=np.linspace(17.2, 18.1, 6))
    problem, choices = proposed([data.frequency], [data.time])
    assert rid.identify(problem).consistent
    assert {name: choice.source for name, choice in choices.items()} == {"modes": "data", "prior": "data"}
    poles = problem.parametric.poles
    truth = np.exp((-0.004 + 1j) * 2 * np.pi * 17.67 * 0.01)
    assert np.abs(poles - truth).min() < 1e-3
    modes = Modes(hz=(9.0, 17.67), damping=(0.1, 0.004))
    _, choices = proposed([data.frequency], modes=modes, prior=PriorChoice.of(problem.prior))
    assert choices == {}


def test_data_that_fit_no_gain_still_get_a_problem_and_a_proof():
    first = rid.FrequencyResponse([50.0], [1.0], bound=0.01, dt=0.01)
    second = rid.FrequencyResponse([50.0], [2.0], bound=0.01, dt=0.01)
    problem, _ = proposed([first, second], modes=Modes(hz=(), damping=()))
    result = rid.identify(problem)
    assert result.status is rid.Status.INCONSISTENT
    assert result.margin == pytest.approx(50, rel=1e-3)
