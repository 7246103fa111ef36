"""Classes chosen by the guaranteed error: truth inside, boxes covered, and what is said where the data leave a pole open."""

import numpy as np
import pytest

import robustid as rid
from robustid.advice import ClassCandidate, class_table, model_class, suggest_class
from robustid.advice.class_table import choice, rank
from robustid.advice.sensitivity import default_points

DT = 0.01
HZ = np.array([1, 3, 5, 7, 9, 11, 13, 15, 16, 17, 17.67, 18.5, 20, 21.0])
RESONANCE = 10
DIRECTIONS = 4
FINE = np.linspace(17.2, 18.1, 10)


def fewer(patch):
    """The first line and the modes alone, few cells and directions: a fifth of the time of 7 frequencies and 8 cells."""
    patch.setattr(model_class, "default_points", lambda data: default_points(data)[:1])
    patch.setattr(class_table, "_CELLS", 2)
    patch.setattr(class_table, "_DIRECTIONS", DIRECTIONS)


@pytest.fixture
def few_points(monkeypatch):
    fewer(monkeypatch)


@pytest.fixture(scope="module")
def given():
    """Five lines with the poles of the truth."""
    data = rid.datasets.flexible_structure(lines=5, samples=2)
    with pytest.MonkeyPatch.context() as patch:
        fewer(patch)
        return suggest_class(frequency=data.frequency, time=data.time, modes=data.modes)


def judged(data, found, hz):
    """Relative guaranteed error at frequencies, and whether the truth is inside."""
    omega = 2 * np.pi * np.asarray(hz)
    result, upper = found.recommended.guaranteed(omega)
    assert result.consistent
    z = np.exp(1j * omega * DT)
    return upper / np.abs(result.model(z)), np.abs(data.truth(z) - result.model(z)) <= upper


@pytest.mark.slow
def test_the_class_that_the_lines_determine_holds_the_truth(few_points):
    data = rid.datasets.flexible_structure(lines=6, extra_hz=np.linspace(17.3, 18.0, 5))
    found = suggest_class(frequency=data.frequency)
    best = found.recommended
    assert (best.pairs, best.covers_box) == (2, True)
    ends = np.stack([best.modes.omega_interval, best.modes.damping_interval], axis=1)
    assert np.all((ends[..., 0] <= data.modes) & (data.modes <= ends[..., 1]))
    relative, holds = judged(data, found, HZ[[2, RESONANCE]])
    assert np.all(holds)
    assert np.all(relative <= [0.04, 0.03])
    # All multiplicities, further priors, and the numbers of modes that were left out, each with its reason.
    evaluated = [row for row in found.candidates if not np.any(np.isnan(row.error))]
    assert {(row.pairs, row.repeat) for row in evaluated} == {(2, 1), (2, 2), (2, 3)}
    assert len({row.prior.decay_rate for row in evaluated}) == 3
    assert [rank(row) for row in found.candidates] == sorted(rank(row) for row in found.candidates)
    left_out = {row.pairs: row.note for row in found.candidates if row.note}
    assert "contradict so few modes" in left_out[1]
    assert "do not determine" in left_out[3]
    # What a repeated pair leaves out between its samples is part of its error.
    repeated = next(row for row in evaluated if row.repeat == 2)
    result, upper = repeated.guaranteed(data.modes[1:, 0])
    bare = rid.worst_case_error(result, omega=data.modes[1:, 0], directions=DIRECTIONS, rtol=0.1).upper[0, 0, 0]
    assert upper[0] == pytest.approx(bare + repeated.cell.remainder(data.modes[1:, 0]).sum(), rel=1e-9)
    assert upper[0] > bare
    text = found.summary()
    assert "for all poles in the pole-uncertainty box" in text
    assert "poles inside the pole-uncertainty box" in text
    assert text.count("<- recommended") == 1


def test_eleven_lines_leave_the_damping_open_and_say_what_to_measure(few_points, monkeypatch):
    monkeypatch.setattr(model_class, "_REPEATS", (1,))
    monkeypatch.setattr(model_class, "_PRIORS", 1)
    data = rid.datasets.flexible_structure()
    found = suggest_class(frequency=data.frequency)
    best = found.recommended
    assert best.pairs == 2
    assert best.modes.undetermined.tolist() == [False, True]
    assert np.isinf(best.worst)
    assert abs(found.next_line / (2 * np.pi) - 17.67) < 0.5
    text = found.summary()
    assert "hardly determine its damping: measure more of them around it" in text
    assert "There is no bound at 17." in text
    _, holds = judged(data, found, HZ[[2]])  # at the resonance everything is inside
    assert np.all(holds)


@pytest.mark.slow
def test_classes_of_five_experiments():
    """Truth inside in all, median at most 4 %, at the resonance at most 3 %."""
    medians, peaks = [], []
    for seed in range(5):
        data = rid.datasets.flexible_structure(seed=seed, extra_hz=FINE)
        relative, holds = judged(data, suggest_class(frequency=data.frequency, time=data.time), HZ)
        assert np.all(holds), seed
        medians.append(float(np.median(relative)))
        peaks.append(float(relative[RESONANCE]))
    assert max(medians) <= 0.04
    assert max(peaks) <= 0.03


def test_poles_that_are_given_are_prior_knowledge(given):
    best = given.recommended
    assert (best.repeat, best.covers_box, best.modes) == (1, False, None)
    omega = 2 * np.pi * HZ[[4, RESONANCE]]
    own = rid.worst_case_error(rid.identify(given.problem), omega=omega, directions=6, rtol=0.1)
    np.testing.assert_allclose(best.guaranteed(omega)[1], own.upper[:, 0, 0], rtol=1e-9)
    assert "poles that were given" in given.summary()


def test_data_without_a_mode_and_data_that_contradict_each_other(few_points):
    smooth = rid.FrequencyResponse(np.linspace(1, 100, 12), np.full(12, 0.3), bound=0.01, dt=DT)
    found = suggest_class(frequency=smooth)
    assert (found.recommended.pairs, found.recommended.covers_box) == (0, False)
    again = rid.FrequencyResponse(smooth.omega, smooth.values + 0.1, bound=0.01, dt=DT)
    found = suggest_class(frequency=[smooth, again])
    assert found.problem is None
    assert found.next_line is None
    assert "no candidate has a guaranteed error" in found.summary()


@pytest.mark.slow
def test_few_samples_bound_nothing_at_the_light_mode():
    """Six lines and the amplitudes that are assumed: a bound away from the light mode, none at it, and so it is to be measured."""
    data = rid.datasets.flexible_structure(lines=6, samples=2)
    found = suggest_class(frequency=data.frequency)
    best = found.recommended
    assert best.covers_box
    assert np.isfinite(best.error).any()
    assert np.isinf(best.error).any()
    assert found.next_line == pytest.approx(data.modes[1, 0], rel=0.01)


def test_frequencies_in_any_order(given):
    orders = np.array([30.0, 60.0, 30.0]), np.array([60.0, 30.0, 60.0])
    there, back = (given.recommended.guaranteed(omega)[1] for omega in orders)
    assert there[0] == there[2] == back[1] != back[0] == there[1]


def candidate(pairs, repeat, *error):
    error = np.array(error)
    parts = {"problem": None, "modes": None, "cell": None, "margin": 0.5, "note": ""}
    return ClassCandidate(pairs=pairs, repeat=repeat, upper=error, error=error, **parts)


def test_ranking():
    """Bounds everywhere before smaller ones; unknown last; the simplest of those that are as good."""
    single, double = candidate(1, 1, 0.104, 0.1), candidate(1, 2, 0.1, 0.1)
    open_one, unknown = candidate(1, 1, 0.01, np.inf), candidate(1, 1, np.nan, np.nan)
    rows = [unknown, open_one, single, double]
    assert sorted(rows, key=rank) == [double, single, open_one, unknown]
    assert choice(rows) is single
    assert choice([candidate(1, 1, 0.2, 0.1), double]) is double
    assert choice([unknown]) is None


def test_bad_input():
    data = rid.datasets.flexible_structure(lines=8, samples=2)
    with pytest.raises(rid.InputError, match="`frequency` is needed"):
        suggest_class(time=data.time)
    free = rid.TimeRecord(data.time.u, data.time.y, dt=DT, bound=0.03, initial="free", past_input_bound=1.0)
    with pytest.raises(rid.InputError, match="`time` has a record with initial"):
        suggest_class(frequency=data.frequency, time=free)
    with pytest.raises(rid.InputError, match="one row"):
        suggest_class(frequency=data.frequency, modes=np.ones((2, 3)))
