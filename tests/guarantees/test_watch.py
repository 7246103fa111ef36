"""Watching a machine: the rate of false alarms, what is found and how soon, and proofs that the new contradicts the old."""

import dataclasses
import itertools

import control
import numpy as np
import pytest
from scipy.stats import beta

import robustid as rid
from robustid.errors import InputError, InputTypeError
from robustid.guarantees import drift, refute
from robustid.guarantees.drift import POWERS, _steps

DT, OMEGA0, ZETA = 0.01, 60.0, 0.02
LINES = np.linspace(40.0, 80.0, 21)
NOISE = 0.02


def machine(shift=0.0):
    """One mode; `shift` in half-widths."""
    omega = OMEGA0 * (1 + shift * ZETA)
    return control.ss(control.c2d(control.tf([omega**2 * ZETA], [1, 2 * ZETA * omega, omega**2]), DT, "zoh"))


def response(plant, rng):
    """Response with errors anywhere in the disc of its hard bound."""
    values = plant(np.exp(1j * LINES * DT))
    noise = NOISE * np.sqrt(rng.uniform(size=LINES.size)) * np.exp(2j * np.pi * rng.uniform(size=LINES.size))
    return rid.FrequencyResponse(LINES, values + noise, bound=rid.Bound(NOISE, kind="hard"), dt=DT)


@pytest.fixture(scope="module")
def identified():
    first = response(machine(), np.random.default_rng(99))
    basis = rid.kautz(OMEGA0, ZETA, dt=DT)
    return rid.identify(
        rid.MixedProblem(frequency=first, prior=rid.Prior(gain_bound=0.05, decay_rate=1.1), parametric=basis)
    )


@pytest.fixture(scope="module")
def proved(identified):
    return rid.band(identified)


def watched(proved, usual, changed, rng, *, before=20, rate=None):
    """A watch over `usual` records of the machine as it is, and then `changed` of another one."""
    responses = [response(machine(), rng) for _ in range(before + usual)] + changed
    records = tuple(responses[before:])
    start = rid.watch(proved, usual=responses[:before], rate=rate)
    return dataclasses.replace(start, records=records, names=tuple(f"r{k}" for k in range(len(records))))


@pytest.mark.parametrize("count", [2, 7, 40])
def test_steps_have_the_mean_one_over_the_ranks(count):
    steps = np.array([_steps(rank, count) for rank in range(1, count + 1)])
    np.testing.assert_allclose(steps.mean(axis=0), np.ones(POWERS.size), rtol=1e-12)


def test_sums_less_the_number_of_records_have_the_mean_zero_over_all_orders():
    """All orders of six scores, of which two are from before: the expectation is exact, not sampled."""
    orders = np.array(list(itertools.permutations(np.arange(6.0))))
    sums = np.array([drift(order[:2], order[2:], 1e-6).sums for order in orders])
    np.testing.assert_allclose(sums.mean(axis=0), [1, 2, 3, 4], rtol=1e-12)


def test_equal_scores_are_never_evidence():
    assert np.all(drift(np.ones(5), np.ones(50), 0.5).e_values <= 1)


def false_alarms(sequences, records, rate):
    rng = np.random.default_rng(5)
    return sum(int(drift(rng.gumbel(size=20), rng.gumbel(size=records), rate).alarms.sum()) for _ in range(sequences))


def test_false_alarms_come_at_most_at_the_stated_rate():
    count, records = false_alarms(20, 300, 0.01), 20 * 300
    assert count > 0
    assert beta.ppf(0.025, count, records - count + 1) <= 0.01


def test_no_change_is_never_refuted_and_a_moved_resonance_is_found(proved):
    rng = np.random.default_rng(0)
    quiet = watched(proved, 60, [], rng)
    assert not quiet.refuted
    moved = watched(proved, 30, [response(machine(0.5), rng) for _ in range(10)], rng)
    assert not any(one.drifted or one.refuted for one in moved.history[:30])
    assert moved.drifted
    assert moved.refuted
    assert abs(moved.refuted[0].refuted.omega - OMEGA0) < 3 * ZETA * OMEGA0
    assert "no plant of the class" in moved.summary()
    assert "1 false" not in moved.summary()


def test_a_change_too_small_for_a_proof_is_a_drift(proved):
    """A twenty-fifth of a half-width lies within band and bound: the ranks tell it all the same."""
    rng = np.random.default_rng(1)
    found = watched(proved, 60, [response(machine(0.04), rng) for _ in range(25)], rng, rate=0.01)
    assert not found.refuted
    assert any(one.drifted for one in found.history[60:])
    assert "Drifted" in found.verdict


def test_what_is_refuted_no_system_of_the_class_explains(identified, proved):
    rng = np.random.default_rng(2)
    record = response(machine(0.5), rng)
    found = rid.watch(proved).update(record, "monday")
    judged = refute(identified, record)  # every sample against every consistent system, by semidefinite programs
    [one] = found.refuted
    k = int(np.argmin(np.abs(LINES - one.refuted.omega)))
    assert one.name == "monday"
    assert judged.refuted
    assert np.concatenate([s.ratio for s in judged.samples])[k] > 1


def test_a_bound_that_is_not_sure_refutes_nothing(proved):
    unsure = response(machine(0.5), np.random.default_rng(3)).with_bound(
        rid.Bound(NOISE, kind="confidence", probability=0.95)
    )
    assert not rid.watch(proved).update(unsure).refuted
    covariance = np.full((LINES.size, 1, 1), (NOISE / 3) ** 2)
    estimated = dataclasses.replace(unsure, covariance=covariance)
    assert rid.watch(proved).update(estimated).refuted


def test_earlier_verdicts_stay(proved):
    rng = np.random.default_rng(4)
    records = [response(machine(0.5 * (k > 6)), rng) for k in range(12)]
    found = rid.watch(proved, usual=records[:4])
    for k, record in enumerate(records[4:]):
        before, found = found, found.update(record)
        assert found.history[:k] == before.history


def test_the_peak_of_a_loop_is_that_of_the_record(proved):
    rng, controller = np.random.default_rng(6), control.tf2ss([0.2, 0.0], [1.0, -0.9], DT)
    record = response(machine(), rng)
    found = rid.watch(proved, controller=controller).update(record).history[-1].sensitivity
    z = np.exp(1j * LINES * DT)
    true = np.max(1 / np.abs(1 + machine()(z) * controller(z)))
    assert found.least <= true <= found.most
    assert true <= found.limit
    members = 1 / np.abs(
        1 + (record.values[:, 0, 0] + NOISE * np.exp(2j * np.pi * rng.uniform(size=(500, 21)))) * controller(z)
    )
    assert found.least <= members.max(axis=1).min()
    assert members.max() <= found.most <= 1.02 * members.max()


def test_a_watch_is_kept_in_a_file(proved, tmp_path):
    rng = np.random.default_rng(7)
    found = watched(proved, 6, [response(machine(0.5), rng)], rng)
    found.save(tmp_path / "stage")
    again = rid.load(tmp_path / "stage")
    assert again.history == found.history
    assert again.rate == found.rate
    assert again.to_dataframe().shape[0] == 7
    assert again.update(response(machine(), rng)).names[-1] == "record 8"


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda w: w.update("monday.csv"), "estimate_frf"),
        (lambda w: w.update(rid.FrequencyResponse([1.0], [1.0], dt=DT)), "no frequency in common"),
        (lambda w: w.update(rid.FrequencyResponse([5.0], [1.0], dt=0.5)), "sample time"),
        (lambda w: rid.watch(w.band, rate=2), "at most 1/2"),
        (lambda w: rid.watch(w.band, controller=control.ss([], [], [], np.eye(2), DT)), "2 x 2"),
        (lambda w: rid.watch(w.band, controller=control.ss([0.5], [1], [1], [0], 1.0)), "as it runs"),
        (lambda w: rid.watch(w.band, usual=["a"]), "usual"),
        (lambda w: rid.watch(3), "must be a Band"),
        (lambda w: w.update(response(machine(), np.random.default_rng(0)), condition="warm"), "the band is none"),
    ],
)
def test_what_cannot_be_watched_is_refused(proved, call, says):
    discs = rid.FrequencyResponse(LINES, np.ones(LINES.size), bound=0.1, dt=DT)
    with pytest.raises((InputError, InputTypeError), match=says):
        call(rid.watch(discs))


@pytest.fixture(scope="module")
def by_load():
    """A family of two loads, a whole half-width apart, at lines around both resonances."""
    members = []
    for load, seed in ((0.0, 21), (1.0, 22)):
        first, basis = (
            response(machine(-load), np.random.default_rng(seed)),
            rid.kautz(OMEGA0 * (1 - load * ZETA), ZETA, dt=DT),
        )
        prior = rid.Prior(gain_bound=0.05, decay_rate=1.1)
        one = rid.identify(rid.MixedProblem(frequency=first, prior=prior, parametric=basis))
        members.append(
            rid.guarantee.Member(rid.worst_case_error(one, omega=LINES[[8, 9, 10]], directions=8), load=load)
        )
    return rid.family(members, model=members[0].identification.model)


def test_a_condition_is_a_member_and_what_no_member_explains_is_refuted(by_load, tmp_path):
    rng, found = np.random.default_rng(9), rid.watch(by_load)
    found = found.update(response(machine(), rng)).update(response(machine(-1.0), rng))
    assert [one.member for one in found.history] == ["load 0", "load 1"]
    assert not found.refuted
    between = found.update(response(machine(-0.5), rng))  # the band around all members holds it, no member does
    assert [one.name for one in between.refuted] == ["record 3"]
    assert "no member explains it" in between.summary()
    stated = found.update(response(machine(-1.0), rng), condition="load 1").update(
        response(machine(-1.0), rng), condition="load 0"
    )
    assert [one.name for one in stated.refuted] == ["record 4"]
    stated.save(tmp_path / "loads")
    assert rid.load(tmp_path / "loads").history == stated.history
    with pytest.raises(InputError, match="must be one of load 0, load 1"):
        found.update(response(machine(), rng), condition="load 2")


def test_scores_of_a_stated_condition_are_those_of_any_member_so_that_ranks_compare(by_load):
    record = response(machine(-1.0), np.random.default_rng(10))
    watched = rid.watch(by_load)
    assert watched.update(record, condition="load 0").scores == watched.update(record).scores


def test_the_mode_that_moved_is_told_with_its_intervals(proved):
    rng = np.random.default_rng(11)
    usual = [response(machine(), rng) for _ in range(2)]
    found = rid.watch(proved, usual=usual).update(response(machine(0.5), rng))
    [frequency, _] = rid.advise.moved_modes(found)
    before, after = (OMEGA0 * (1 + shift * ZETA) / (2 * np.pi) for shift in (0, 0.5))
    assert frequency.shown
    assert frequency.before[0] <= before <= frequency.before[1]
    assert frequency.after[0] <= after <= frequency.after[1]
    assert frequency.change[0] <= 0.5 * ZETA <= frequency.change[1]
    assert "% higher" in frequency.words
    quiet = rid.watch(proved, usual=usual).update(response(machine(), rng))
    assert not any(one.shown for one in rid.advise.moved_modes(quiet))
    with pytest.raises(InputError, match="no record yet"):
        rid.advise.moved_modes(rid.watch(proved))


@pytest.mark.slow
def test_two_hundred_sequences_of_three_hundred_records(proved):
    """Rates with their own 95 % intervals: false alarms, refuted without a change, and changes found within ten records."""
    rng, alarms, refuted, soon = np.random.default_rng(8), 0, 0, 0
    for _ in range(200):
        quiet = watched(proved, 300, [], rng)
        alarms, refuted = alarms + len(quiet.drifted), refuted + bool(quiet.refuted)
        moved = watched(proved, 30, [response(machine(0.5), rng) for _ in range(10)], rng)
        soon += any(one.drifted for one in moved.history[30:])
    low, high = beta.ppf(0.025, alarms, 60000 - alarms + 1), beta.ppf(0.975, alarms + 1, 60000 - alarms)
    print(
        f"{alarms} false alarms in 60 000 records, rate {low:.2g} to {high:.2g}; {refuted} refuted; {soon} of 200 found by drift"
    )
    assert low <= 0.002
    assert refuted == 0
    assert soon >= 180
