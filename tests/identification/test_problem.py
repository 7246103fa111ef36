"""One thing broken per test: a sentence that names the argument and says what to do."""

import numpy as np
import pytest

import robustid as rid
from support.problems import identified
from support.refusals import refused

pytestmark = pytest.mark.quick


PRIOR = rid.Prior(gain_bound=1.0, decay_rate=1.1)
FRF = rid.FrequencyResponse([1.0, 2.0], [1.0, 0.5], bound=0.1, dt=0.1)
RECORD = rid.TimeRecord(np.ones(4), np.ones(4), dt=0.1, bound=0.1)


def problem(**changes):
    return rid.MixedProblem(**({"frequency": FRF, "prior": PRIOR} | changes))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"decay_rate": 1.0}, "decay_rate.*exceed 1"),
        ({"decay_rate": 0.9}, "decay_rate.*exceed 1"),
        ({"decay_rate": 1 + 1e-9}, "told from 1"),
        ({"gain_bound": 0.0}, "gain_bound.*positive"),
        ({"gain_bound": -1.0}, "gain_bound.*positive"),
        ({"gain_bound": np.nan}, "gain_bound.*finite"),
        ({"gain_bound": np.inf}, "gain_bound.*finite"),
        ({"scaling": [[1.0, 0.0]]}, "`scaling` must be positive"),
        ({"scaling": [[1.0, -2.0]]}, "`scaling` must be positive"),
        ({"scaling": [[1.0, np.inf]]}, "`scaling` must be finite"),
        ({"scaling": [1.0, 2.0]}, "`scaling` must have"),
    ],
)
def test_prior(changes, words):
    refused(words, rid.Prior, **{"gain_bound": 1.0, "decay_rate": 1.1} | changes)


@pytest.mark.parametrize(
    ("changes", "error", "words"),
    [
        ({"frequency": None}, rid.InputError, "both missing"),
        ({"frequency": []}, rid.InputError, "both missing"),
        ({"frequency": np.ones(3)}, rid.errors.InputTypeError, "FrequencyResponse"),
        ({"frequency": RECORD}, rid.errors.InputTypeError, "FrequencyResponse"),
        ({"frequency": rid.FrequencyResponse([1.0], [1.0], dt=0.1)}, rid.InputError, "bound"),
        ({"frequency": rid.FrequencyResponse([1.0], [1.0], bound=1.0)}, rid.InputError, "dt"),
        (
            {"frequency": rid.FrequencyResponse([1.0], np.ones((1, 2, 2)), bound=1.0, dt=0.1), "time": RECORD},
            rid.InputError,
            "inputs. differ",
        ),
        ({"time": rid.TimeRecord([1.0], [1.0], dt=0.1)}, rid.InputError, "time.*bound"),
        ({"time": rid.TimeRecord([1.0], [1.0], dt=0.2, bound=1.0)}, rid.InputError, "dt.*differs"),
        ({"time": rid.TimeRecord([1.0], [1.0], dt=0.1, bound=np.inf)}, rid.InputError, "no sample"),
        ({"prior": 1.1}, rid.errors.InputTypeError, "prior"),
        ({"parametric": rid.kautz(1.0, 0.1, dt=0.2)}, rid.InputError, "dt"),
    ],
)
def test_problem(changes, error, words):
    refused(words, problem, error=error, **changes)


def test_too_large_for_every_form_says_what_each_would_need():
    omega = np.geomspace(0.5, 150, 200)
    values = np.broadcast_to(0.5 / (1 + 1j * omega)[:, None, None] * np.ones((4, 4)), (200, 4, 4))
    frf = rid.FrequencyResponse(omega, values, bound=0.02)
    with pytest.raises(
        rid.errors.SizeError, match=r"400 coefficients where up to \d+ .*sections form.* single entries"
    ) as said:
        rid.identify(problem(frequency=frf, prior=rid.BoundedReal(decay=0.3)), accuracy=1e-3)
    assert 'form="auto"' not in str(said.value)
    assert "0.3 1/s" in str(said.value)


def test_equations_of_many_entries_that_no_memory_holds_are_refused_at_once():
    frf = rid.FrequencyResponse(np.linspace(1.0, 30.0, 30), np.ones((30, 100, 4)), bound=0.1, dt=0.1)
    prior = rid.Prior(gain_bound=1.0, decay_rate=3.0)
    many = problem(frequency=frf, prior=prior, parametric=rid.kautz([3.0, 9.0, 15.0, 20.0], 0.02, dt=0.1))
    words = r"400 entries and 12000 samples: the equations of 8 functions .* 0.61 GB.* single entries, frf.entry"
    refused(words, rid.identify, many, error=rid.errors.SizeError)


@pytest.mark.parametrize("time_limit", [5.0, None])
def test_a_matrix_whose_single_step_is_out_of_reach_is_refused_at_once(time_limit):
    """100 x 4 entries: of its memory, whatever time there is."""
    frf = rid.FrequencyResponse(np.linspace(1.0, 30.0, 20), np.ones((20, 100, 4)), bound=0.1, dt=0.1)
    many = problem(frequency=frf, prior=rid.Prior(gain_bound=2.0, decay_rate=1.2), parametric=pair(3.0))
    words = r"in its 400 entries: one step .* s and matrices of .* GB, .* Take single entries"
    refused(words, rid.identify, many, time_limit=time_limit, error=rid.errors.SizeError)


@pytest.mark.parametrize("samples", [2_000, pytest.param(10_000, marks=pytest.mark.slow)])
def test_thousands_of_samples_are_answered(samples):
    assert identified(problem(**record(samples))).consistent


def test_one_sample_is_enough():
    one = rid.FrequencyResponse([1.0], [0.5 - 0.1j], bound=0.1, dt=0.1)
    assert rid.identify(problem(frequency=one)).consistent
    first = rid.TimeRecord([1.0], [0.5], dt=0.1, bound=0.1)
    result = rid.identify(problem(frequency=None, time=first))
    assert result.consistent
    assert result.model.nstates == 0


def pair(*omega, **options):
    return rid.kautz(omega, 0.1, dt=0.1, **options)


def record(samples):
    return {"frequency": None, "time": rid.TimeRecord(np.ones(samples), np.ones(samples), dt=0.1, bound=0.1)}


SLOW = rid.Prior(gain_bound=1.0, decay_rate=1.001)
TIGHT = rid.FrequencyResponse([1.0, 2.0], [1.0, 0.5], bound=1e-300, dt=0.1)
SIZE = rid.errors.SizeError


@pytest.mark.parametrize(
    ("changes", "options", "error", "words"),
    [
        ({}, {"objective": "best"}, rid.InputError, "objective"),
        ({}, {"solver": "NO_SUCH"}, rid.InputError, "installed SDP solver"),
        ({}, {"solver": 3}, rid.InputError, "solver"),
        ({}, {"accuracy": 0.0}, rid.InputError, "accuracy"),
        ({}, {"form": "pick"}, rid.InputError, "form"),
        ({}, {"time_limit": 0}, rid.InputError, "`time_limit` must be"),
        ({"parametric": [pair(10.0)] * 2, "time": RECORD}, {}, rid.InputError, r"apart.*(Re|Im) 1\.592 Hz"),
        ({"parametric": pair(1.0, 3.0, 5.0)}, {}, rid.InputError, "parametric"),  # more functions than samples
        (record(4) | {"parametric": pair(10.0, delay=9)}, {}, rid.InputError, "does not act"),
        ({"frequency": TIGHT, "parametric": pair(3.0, delay=1)}, {}, rid.InputError, "bound"),
        (record(10_000), {"form": "orthonormal"}, SIZE, r"10000 coefficients.*[Tt]hin"),
        (record(10_000) | {"prior": SLOW}, {}, SIZE, r"rate 1.001: 10000 coefficients.*\d+ Taylor.*thin the data"),
        (record(150), {"solver": "cvxpy"}, SIZE, "auto"),
        (record(150), {"objective": "order"}, SIZE, "objective"),
    ],
)
def test_identify(changes, options, error, words):
    refused(words, rid.identify, problem(**changes), error=error, **options)


def test_identify_wants_a_problem():
    refused("MixedProblem", rid.identify, FRF, error=rid.errors.InputTypeError)


@pytest.mark.parametrize("E", [1.5, np.nan, "central"])
def test_free_parameter(E):
    refused("E", lambda: rid.identify(problem()).solution(E), error=(rid.InputError, rid.errors.InputTypeError))


def test_absurdly_wide_bounds_are_kept():
    loose = rid.FrequencyResponse([1.0, 2.0], [1.0, 0.5], bound=1e12, dt=0.1)
    assert rid.identify(problem(frequency=loose)).consistent
