"""New samples of matrices against the guarantee: judged by identifying old and new data together."""

import dataclasses

import control
import numpy as np
import pytest

import robustid as rid
from robustid.guarantees import refute
from support.cases import slow
from support.matrix_plants import random_matrix_problem, response

BASIS = rid.kautz([0.8], [0.1], dt=1.0, delay=1)


def joined(problem, new):
    """Proved interval of the margin of old and new data together."""
    kind = "frequency" if isinstance(new, rid.FrequencyResponse) else "time"
    found = rid.identify(dataclasses.replace(problem, **{kind: (*getattr(problem, kind), new)}))
    return found.margin_lower, found.margin


def at_one_entry(values, entry, bound):
    """The same data with a bound at one entry only."""
    bounds = np.full(values.shape, np.inf)
    bounds[:, *entry] = bound
    return bounds


@pytest.mark.parametrize("options", [slow({}), {"symmetric": True}, {"parametric": BASIS}])
def test_one_entry_is_refuted_where_no_joint_system_exists(options):
    problem, truth = random_matrix_problem(2, 2, 2, 3, rho=1.3, **options)
    result = rid.identify(problem)
    values = response(truth, np.array([1.9]))
    bound = problem.frequency[0].bound.max()
    entry = (0, 1)
    inside = rid.FrequencyResponse([1.9], values, bound=at_one_entry(values, entry, bound), dt=1.0)
    assert not refute(result, inside).refuted
    assert refute(result, inside).attainable.shape == (1,)
    found = refute(result, dataclasses.replace(inside, values=values + 1e3))
    assert found.refuted
    assert found.ratio <= found.attainable
    assert found.verify()
    assert not dataclasses.replace(
        found, samples=(dataclasses.replace(found.samples[0], ratio=found.ratio * 1.1),)
    ).verify()
    assert found.samples[0].entries.tolist() == [[0, 1]]
    assert "(u2 to y1)" in found.summary()
    # One new sample is refuted exactly where no system of the class keeps it together with the old ones.
    verdicts = set()
    for shift in (0.5, 3.0, 30.0, 300.0):
        new = dataclasses.replace(inside, values=values + shift * bound)
        found, (low, high) = refute(result, new), joined(problem, new)
        assert not found.refuted or high > 1
        assert not found.inside or low <= 1
        verdicts.add("refuted" if found.refuted else "inside" if found.inside else "edge")
    assert {"refuted", "inside"} <= verdicts


@pytest.mark.parametrize(("seed", "shape"), [(0, (2, 2)), *(slow(*c) for c in ((1, (2, 3)), (2, (3, 1))))])
def test_new_data_of_the_truth_are_never_refuted(seed, shape):
    """Frequencies and a record of the same plant, errors inside their bounds; one wrong sample is found."""
    p, q = shape
    problem, truth = random_matrix_problem(seed, p, q, 3, rho=1.4)
    result, rng = rid.identify(problem), np.random.default_rng(seed)
    omega = np.array([0.4, 1.1])
    values = response(truth, omega)
    frf = rid.FrequencyResponse(omega, values + 0.1 * np.exp(1j * rng.random(values.shape)), bound=0.1, dt=1.0)
    u = rng.standard_normal((5, q))
    y = control.forced_response(truth, np.arange(5.0), u.T).outputs.reshape(p, 5).T
    record = rid.TimeRecord(u, y + 0.05 * np.sign(rng.standard_normal(y.shape)), dt=1.0, bound=0.05)
    found = refute(result, [frf, record])
    assert found.ratio.size == 2 * p * q + 5 * p
    assert not found.refuted
    assert np.all(found.ratio <= found.attainable)
    assert found.verify()
    wrong = np.array(record.y)
    wrong[3, p - 1] += 1e3
    broken = refute(result, dataclasses.replace(record, y=wrong))
    assert broken.refuted
    assert broken.verify()
    assert broken.samples[0].entries[np.argmax(broken.ratio)].tolist() == [p - 1, 0]
    assert "at 3 s" in broken.summary()
    assert joined(problem, dataclasses.replace(record, y=wrong))[0] > 1


def test_other_signals_and_shared_bounds_are_refused():
    problem, _ = random_matrix_problem(0, 2, 2, 2, rho=1.4)
    result = rid.identify(problem)
    one = rid.FrequencyResponse([1.0], [1.0], bound=0.1, dt=1.0)
    with pytest.raises(rid.InputError, match="outputs and inputs of the identified data, 2 and 2; got 1 and 1"):
        refute(result, one)
    with pytest.raises(rid.InputError, match="needs a bound of every entry"):
        refute(result, problem.frequency[0].with_column_bound(0.1))
