"""suggest_roll_off: of data that fall and of data that do not."""

import numpy as np
import pytest

import robustid as rid


def problem_of(values, omega, dt=None, **more):
    frf = rid.FrequencyResponse(omega, values, bound=0.002, dt=dt)
    return rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=1.0, decay=4.0, **more))


@pytest.mark.parametrize("dt", [None, pytest.param(0.02, marks=pytest.mark.slow)])
def test_a_roll_off_that_the_data_show(dt):
    omega = np.linspace(1.0, 60.0, 16)
    problem = problem_of(1 / (1 + 1j * omega / 8) ** 2, omega, dt)
    found = rid.advise.suggest_roll_off(problem)
    assert found.roll_off == 2
    assert 5 < found.corner < 25
    plain = rid.suggest_prior(problem, decay_rates=[found.rate]).prior
    assert found.gain_bound < 1.3 * plain.gain_bound
    far = [150.0]
    both = [rid.identify(rid.MixedProblem(frequency=problem.frequency, prior=p)).require() for p in (found, plain)]
    widths = [rid.worst_case_error(one, omega=far, directions=4).upper.item() for one in both]
    assert widths[0] < (0.1 if dt is None else 0.5) * widths[1]


def test_none_where_the_data_do_not_fall_or_the_modes_do_all():
    omega = np.linspace(1.0, 60.0, 12)
    assert rid.advise.suggest_roll_off(problem_of((8 - 1j * omega) / (8 + 1j * omega), omega)) is None
    assert rid.advise.suggest_roll_off(problem_of(np.zeros(12), omega)) is None
    with pytest.raises(rid.InputError, match="roll-off or a weight already"):
        rid.advise.suggest_roll_off(problem_of(np.ones(12), omega, roll_off=2, corner=10.0))
