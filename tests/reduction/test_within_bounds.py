"""The smallest model within the bounds: the search against known truths, and what cannot be had."""

import dataclasses

import control
import numpy as np
import pytest

import robustid as rid
from robustid.core import response
from robustid.identification import largest_ratio, model_residuals
from robustid.reduction import SearchStatus
from robustid.reduction.best_models import BestModels
from support.cases import slow
from support.paper_plant import AS_THE_PAPER, mixed, structure
from support.problems import random_problem, rigid_structure

PAIRS = rid.kautz(2 * np.pi * np.array([9.0, 17.67]), [0.1, 0.004], dt=0.01, delay=1)
LIGHT = rid.kautz(2 * np.pi * 17.67, 0.004, dt=0.01, delay=1)
RIGID, BOTH = rigid_structure()


def judged_again(problem, model):
    """Largest |residual|/bound of a model at discs and records from rest: another path than the library's."""
    found = 0.0
    for frf in problem.frequency:
        F = np.array([model(np.exp(1j * w * frf.dt)) for w in frf.omega])
        found = max(found, np.max(np.abs(frf.values[:, 0, 0] - F) / frf.bound[:, 0, 0]))
    for record in problem.time:
        assert record.initial == "rest"
        y = control.forced_response(model, record.time, record.u[:, 0]).outputs
        found = max(found, np.max(np.abs(record.y[:, 0] - y) / record.bound[:, 0]))
    return found


# --- the search -------------------------------------------------------------------------------------------------------


def check(problem, result, reduction):
    """What every reduction must be."""
    poles = reduction.model.poles()
    assert reduction.order == reduction.model.nstates
    assert np.all((np.abs(poles) < 1) | (poles == 1))
    assert reduction.margin == pytest.approx(largest_ratio(problem, reduction.model), rel=1e-9)
    assert reduction.tried[-1][0] >= reduction.order
    assert dict(reduction.tried)[reduction.order] == reduction.margin
    assert all(margin > 1 for order, margin in reduction.tried if order < reduction.order)
    assert reduction.hankel.size <= result.order


@pytest.mark.parametrize("parametric", [True, slow(False)])
def test_plant_of_order_four_comes_out_at_order_four(parametric):
    """Slow: 20 seeds, below."""
    problem = structure(int(parametric), parametric=parametric)
    result = rid.identify(problem)
    assert result.consistent
    reduction = rid.reduce_within_bounds(result)
    check(problem, result, reduction)
    assert reduction.status is SearchStatus.WITHIN
    assert reduction.order == 4
    assert judged_again(problem, reduction.model) <= 1


@pytest.mark.parametrize(("seeds", "sizes"), [(1, {}), slow(4, AS_THE_PAPER)])
def test_from_another_objective_too_every_sample_is_kept(seeds, sizes):
    """All seeds: every sample inside, the margins reported are those of the samples, and no smaller order was skipped."""
    for seed in range(seeds):
        result = rid.identify(structure(seed, **sizes), objective="gain")
        reduction = rid.reduce_within_bounds(result)
        worst = max(r.ratio.max() for r in model_residuals(result.problem, reduction.model))
        assert worst == pytest.approx(reduction.margin, rel=1e-12)
        assert worst <= 1 + 1e-5
        assert reduction.order == reduction.model.nstates == 4  # as the truth
        assert [order for order, _ in reduction.tried] == list(range(5))
        assert all(margin > 1 for _, margin in reduction.tried[:-1])
        angles = np.linspace(1, 314, 500) * 0.01
        error = np.abs(response(result.model, angles) - response(reduction.model, angles)).max()
        assert error <= reduction.bound + 1e-9 * 7  # of the peak: rounding


@pytest.mark.parametrize("beside", [False, slow(True)])
def test_poles_of_the_parametric_part_are_kept_where_they_suffice(beside):
    """Known poles stay, and the model is near the truth between the samples, where moved poles are not."""
    data, problem = rid.datasets.flexible_structure(), structure(0)
    light = rid.kautz(data.modes[1, 0], data.modes[1, 1], dt=0.01, delay=1)
    wide = rid.Prior(gain_bound=18.4, decay_rate=1.051)
    angles = 2 * np.pi * np.linspace(1, 21, 2001) * 0.01
    errors = []
    for changes in ({"parametric": light, "prior": wide}, {"parametric": None, "prior": wide})[: 1 + beside]:
        one = dataclasses.replace(problem, **changes)
        reduction = rid.reduce_within_bounds(rid.identify(one))
        assert reduction.order == 4
        assert judged_again(one, reduction.model) <= 1
        for pole in one.parametric.poles if one.parametric else ():
            assert np.abs(reduction.model.poles() - pole).min() < 1e-9
        errors.append(np.abs(response(reduction.model, angles) - response(data.truth, angles)).max())
    assert errors[0] < 0.1
    assert not beside or errors[1] > 0.5


@pytest.mark.slow
@pytest.mark.parametrize(("parametric", "least"), [(True, 19), (False, 18)])
def test_plant_of_order_four_at_twenty_seeds(parametric, least):
    found = 0
    for seed in range(20):
        problem = structure(seed, parametric=parametric, **AS_THE_PAPER)
        result = rid.identify(problem)
        reduction = rid.reduce_within_bounds(result)
        assert result.consistent
        assert judged_again(problem, reduction.model) <= 1
        found += reduction.order <= 4
    assert found >= least


@pytest.mark.slow
@pytest.mark.parametrize("seeds", [1, 2])
@pytest.mark.parametrize("case", ["parametric", "mixed", "time", "frequency"])
def test_truth_of_known_order_bounds_the_order_found(case, seeds):
    """Random plants: G of order 4 and, parametric, a pair more; their truth is inside the bounds."""
    for seed in range(seeds):
        problem = random_problem(seed, case, 16 if seeds == 1 else 24)
        result = rid.identify(problem)
        reduction = rid.reduce_within_bounds(result)
        check(problem, result, reduction)
        assert reduction.status is SearchStatus.WITHIN
        assert reduction.order <= 4 + 2 * (case == "parametric")
        assert judged_again(problem, reduction.model) <= 1


@pytest.mark.parametrize("kind", [slow("free"), "periodic"])
def test_records_from_an_unknown_state_and_in_steady_state(kind):
    problem = mixed(kind, samples=15)
    result = rid.identify(problem)
    reduction = rid.reduce_within_bounds(result)
    check(problem, result, reduction)
    assert reduction.order <= 4
    assert reduction.margin <= 1


def rigid_problem(basis):
    omega = 2 * np.pi * np.linspace(1, 40, 12)
    F = RIGID(np.exp(1j * omega * 0.01)) + LIGHT.response(omega * 0.01) @ [0.02, 0.01]
    error = 0.9 * np.exp(2j * np.pi * np.random.default_rng(0).uniform(size=12))
    bound = 1e-2 * np.abs(F)
    frf = rid.FrequencyResponse(omega, F + bound * error, bound=bound, dt=0.01)
    return rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=2.0, decay_rate=1.02), parametric=basis)


def test_rigid_body_of_the_parametric_part_and_one_that_is_asked_for_are_exact():
    problem = rigid_problem([RIGID, LIGHT])
    result = rid.identify(problem)
    assert result.consistent
    for asked in (None, rid.RigidBody(1)):
        reduction = rid.reduce_within_bounds(result, rigid_body=asked)
        check(problem, result, reduction)
        assert reduction.order == 4
        assert np.sum(reduction.model.poles() == 1) == 2
    damped = control.ss([[1 - 1e-5, 0.01], [0, 1 - 1e-5]], [[0.5e-4], [0.01]], [[1, 0]], [[0]], 0.01)
    problem = rigid_problem([damped, LIGHT])
    reduction = rid.reduce_within_bounds(rid.identify(problem), rigid_body=rid.RigidBody(1))
    assert reduction.order == 4
    assert np.sum(reduction.model.poles() == 1) == 2


def test_integrators_of_the_parametric_part_survive_another_objective():
    omega = 2 * np.pi * np.linspace(1, 40, 10)
    F = response(BOTH, omega * 0.01)
    frf = rid.FrequencyResponse(omega, F, bound=1e-2 * np.abs(F), dt=0.01)
    prior = rid.Prior(gain_bound=0.1, decay_rate=1.2)
    problem = rid.MixedProblem(frequency=frf, prior=prior, parametric=[RIGID, PAIRS])
    result = rid.identify(problem, objective="gain")
    reduction = rid.reduce_within_bounds(result)
    assert reduction.order < result.order
    assert np.sum(np.abs(reduction.model.poles() - 1) < 1e-6) == 2
    assert reduction.margin <= 1 + 1e-5


def test_order_and_margin_do_not_depend_on_units():
    problem = random_problem(0, "mixed", 8)
    first = rid.reduce_within_bounds(rid.identify(problem))
    gain = 2.0**40
    (frf,), (record,) = problem.frequency, problem.time
    frf = rid.FrequencyResponse(frf.omega, gain * frf.values, bound=gain * frf.bound, dt=frf.dt)
    record = rid.TimeRecord(record.u, gain * record.y, bound=gain * record.bound, dt=record.dt)
    prior = dataclasses.replace(problem.prior, gain_bound=problem.prior.gain_bound * gain)
    scaled = dataclasses.replace(problem, frequency=frf, time=record, prior=prior)
    second = rid.reduce_within_bounds(rid.identify(scaled))
    assert second.order == first.order
    assert second.margin == pytest.approx(first.margin, rel=1e-6)


# --- what cannot be had -----------------------------------------------------------------------------------------------


def test_contradicting_samples_are_never_called_within():
    """Two values of one line, 50 bounds from what they have in common: no model of any order."""
    first = rid.FrequencyResponse([50.0], [1.0], bound=0.01, dt=0.01)
    second = rid.FrequencyResponse([50.0], [2.0], bound=0.01, dt=0.01)
    prior = rid.Prior(gain_bound=5.0, decay_rate=1.1)
    result = rid.identify(rid.MixedProblem(frequency=[first, second], prior=prior))
    reduction = rid.reduce_within_bounds(result)
    assert reduction.status is SearchStatus.INFLATED
    assert "contradict" in reduction.status.value
    assert reduction.margin == pytest.approx(50, rel=1e-3)


def test_wrong_poles_contradict_the_class_and_the_small_model_says_that_it_is_none_of_it():
    wrong = rid.kautz(2 * np.pi * np.array([9.0, 17.2]), [0.1, 0.004], dt=0.01, delay=1)
    problem = dataclasses.replace(structure(0), parametric=wrong)
    result = rid.identify(problem)
    assert not result.consistent
    reduction = rid.reduce_within_bounds(result)
    assert reduction.status is SearchStatus.OUTSIDE
    assert "contradict" in reduction.status.value
    assert reduction.margin <= result.margin * (1 + 2e-5)
    assert reduction.order == 4
    assert judged_again(problem, reduction.model) <= 1


def test_bounds_that_no_smaller_order_meets_leave_the_model_as_it_is():
    """White noise in bounds of a millionth: as many poles as samples are needed, or almost."""
    rng = np.random.default_rng(0)
    noise = rng.standard_normal(4) + 1j * rng.standard_normal(4)
    frf = rid.FrequencyResponse(np.linspace(30, 280, 4), noise, bound=1e-6, dt=0.01)
    prior = rid.Prior(gain_bound=1e3, decay_rate=1.01)
    result = rid.identify(rid.MixedProblem(frequency=frf, prior=prior))
    assert result.consistent
    reduction = rid.reduce_within_bounds(result)
    assert reduction.order > 3  # 2 * 4 numbers need 8 parameters: 3 poles with 4 numerators are 7
    if reduction.status is SearchStatus.UNREDUCED:
        assert reduction.model is result.model
    else:
        assert judged_again(rid.MixedProblem(frequency=frf, prior=prior), reduction.model) <= 1


def test_search_that_finds_nothing_returns_the_identified_model(monkeypatch):
    monkeypatch.setattr("robustid.reduction.best_models.largest_ratio", lambda problem, model: 1.5)
    data = rid.datasets.flexible_structure(lines=2, samples=1)
    prior = rid.Prior(gain_bound=10, decay_rate=1.015)
    result = rid.identify(rid.MixedProblem(frequency=data.frequency, time=data.time, prior=prior))
    reduction = rid.reduce_within_bounds(result)
    assert reduction.status is SearchStatus.UNREDUCED
    assert reduction.model is result.model
    assert reduction.order == result.order
    assert reduction.margin <= 1
    assert reduction.tried[-1] == (result.order, reduction.margin)


def test_misuse_is_named():
    result = rid.identify(structure(0))
    with pytest.raises(rid.errors.InputTypeError, match="identify"):
        rid.reduce_within_bounds(rid.datasets.flexible_structure().truth)
    with pytest.raises(rid.errors.InputTypeError, match=r"RigidBody\(1\)"):
        rid.reduce_within_bounds(result, rigid_body=1)
    with pytest.raises(rid.InputError, match="2 modes"):
        rid.reduce_within_bounds(result, rigid_body=rid.RigidBody(2))
    (frf,) = result.problem.frequency
    still = dataclasses.replace(frf, omega=np.append(0.0, frf.omega[1:]), values=np.real(frf.values) + 0j)
    still = rid.identify(dataclasses.replace(result.problem, frequency=still))
    with pytest.raises(rid.InputError, match="omega = 0"):
        rid.reduce_within_bounds(still, rigid_body=rid.RigidBody(1))


def test_a_start_on_the_circle_is_drawn_inside():
    """Two lines next to each other that differ: the linear fit puts a pole between them, on the circle to rounding."""
    frf = rid.FrequencyResponse([50.0, 50.001, 60.0], [1.0, 1.5, 1.0], bound=0.01, dt=0.01)
    problem = rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=1.5, decay_rate=1.0375))
    small = rid.reduce_within_bounds(rid.identify(problem))
    assert np.all(np.abs(small.model.poles()) < 1)


# --- time -------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module", params=[True, slow(False)])
def searched(request):
    """A problem whose bounds hold, or are too narrow, its identification, and the whole search."""
    problem = structure(1, parametric=False)
    if not request.param:
        problem = dataclasses.replace(problem, prior=rid.Prior(gain_bound=problem.prior.gain_bound / 6, decay_rate=1.1))
    result = rid.identify(problem)
    assert result.consistent == request.param
    return problem, result, rid.reduce_within_bounds(result)


def test_without_time_a_truncated_model_is_inside(searched):
    problem, result, whole = searched
    found = rid.reduce_within_bounds(result, time_limit=1e-9)
    assert found.stopped.startswith("stopped at the time limit")
    assert whole.stopped == ""
    assert whole.order <= found.order < result.order
    assert found.order == found.model.nstates
    assert found.margin == pytest.approx(judged_again(problem, found.model), rel=1e-6)
    assert found.margin <= max(1.0, result.margin * (1 + 1e-5))


def test_truncations_after_the_time_end_soon(searched, monkeypatch):
    _, result, _ = searched
    monkeypatch.setattr("robustid.reduction.within_bounds._AFTER", 1e-9)  # as where one of them takes seconds
    found = rid.reduce_within_bounds(result, time_limit=1e-9)
    assert (found.order, found.model.nstates) == (result.order, result.order)
    assert found.stopped.startswith("stopped at the time limit")


def test_no_search_begins_whose_first_look_takes_longer_than_there_is_time(searched, monkeypatch):
    """Of many states: their responses beside the samples alone take seconds."""
    _, result, _ = searched
    monkeypatch.setattr("robustid.reduction.within_bounds._LOOK", 1.0)
    monkeypatch.setattr("robustid.reduction.within_bounds.BestModels", None)
    found = rid.reduce_within_bounds(result, time_limit=1e-9)
    assert (found.order, found.model.nstates, found.status) == (result.order, result.order, SearchStatus.UNREDUCED)
    assert found.stopped.startswith("stopped at the time limit")
    assert found.margin == pytest.approx(max(one.ratio.max() for one in result.residuals))
    assert found.hankel.size == result.order


def test_an_interrupted_search_keeps_what_it_found(searched):
    problem, result, whole = searched
    told = []

    def interrupt(text, done, count):
        told.append((done, count))
        if len(told) == 3:
            raise KeyboardInterrupt

    found = rid.reduce_within_bounds(result, progress=interrupt)
    assert found.stopped.startswith("interrupted")
    assert len(told) == 3
    assert found.status is (SearchStatus.WITHIN if result.consistent else SearchStatus.INFLATED)
    assert whole.order <= found.order or not result.consistent
    assert judged_again(problem, found.model) <= max(1.0, result.margin * (1 + 1e-5))


def test_functions_of_another_number_than_the_order_are_no_candidates():
    """A family may have more functions than were asked for: its model is none of that order."""
    models = BestModels(rid.identify(structure(0, **AS_THE_PAPER)), 0)
    families = models._families
    models._families = tuple(lambda n, one=one: one(n + 4) for one in families)
    fit = models._parametric_kept(4)
    assert fit.pair.A.shape[0] == 4
