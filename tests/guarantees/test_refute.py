"""New samples against the guarantee: judged by identifying old and new data together."""

import dataclasses

import control
import numpy as np
import pytest

import robustid as rid
from robustid.guarantees import refute
from support.cases import slow
from support.matrix_plants import random_matrix_problem
from support.matrix_plants import response as matrix_response
from support.problems import CASES, random_problem, truth_of


@pytest.fixture(scope="module")
def mixed():
    return rid.identify(random_problem(3, "mixed", 12))


def one_line(result, at, value, bound, tilt=None):
    tilts = None if tilt is None else [tilt]
    return rid.FrequencyResponse([at], [value], bound=rid.Bound(bound, tilt=tilts), dt=result.problem.dt)


def joined_margin(result, new):
    """Margin of old and new data together, its proved interval."""
    problem = result.problem
    kind = "frequency" if isinstance(new, rid.FrequencyResponse) else "time"
    found = rid.identify(dataclasses.replace(problem, **{kind: (*getattr(problem, kind), new)}))
    return found.margin_lower, found.margin


@pytest.mark.parametrize("case", CASES)
def test_new_data_of_the_truth_are_never_refuted(case):
    result = rid.identify(random_problem(3, case, 12))
    impulse, response = truth_of(3, case)
    rng = np.random.default_rng(5)
    omega = np.array([30.0, 160.0, 290.0])
    frf = rid.FrequencyResponse(omega, response(omega) + 0.05 * np.exp(1j * omega), bound=0.05, dt=0.01)
    u = rng.standard_normal(14)
    y = np.convolve(u, impulse(14))[:14] + 0.1 * np.sign(rng.standard_normal(14))
    record = rid.TimeRecord(u, y, dt=0.01, bound=np.where(np.arange(14) % 5, np.inf, 0.1))
    found = refute(result, [frf, record])
    assert not found.refuted
    assert found.ratio.max() <= 1
    assert np.all(found.ratio <= found.attainable)
    assert found.ratio.size == 3 + 3
    assert found.verify()
    assert [s.kind for s in found.samples] == ["frequency", "time"]
    np.testing.assert_allclose(found.samples[1].axis, [0.0, 0.05, 0.1])


@pytest.mark.parametrize("push", [0.0, 0.4, 1.5])
@pytest.mark.parametrize("kind", ["frequency", "time"])
def test_agrees_with_joint_identification(mixed, kind, push):
    # One new sample: inside or refuted is the question whether old data and this sample are consistent together.
    if kind == "frequency":
        new = one_line(mixed, 140.0, truth_of(3, "mixed")[1](140.0) + push * np.exp(0.7j), 0.05)
    else:
        u = np.array([0.3, -1.0, 2.0, 1.0])
        y = np.convolve(u, truth_of(3, "mixed")[0](4))[:4] + push * np.array([0, 0, 0, 4.0])
        new = rid.TimeRecord(u, y, dt=0.01, bound=[np.inf, np.inf, np.inf, 0.05])
    found = refute(mixed, new)
    low, high = joined_margin(mixed, new)
    if found.refuted:
        assert low > 1
    if found.inside:
        assert high <= 1 + 1e-6
    assert found.refuted or found.inside
    assert found.inside or push > 0
    assert found.refuted or push < 1


def test_distance_in_closed_form_by_pick():
    # Nodes +-1/rho: from the value w at z = 1, |w| <= 0.2, the value at z = -1 is at most (0.2 + d)/(1 + 0.2 d).
    rho = 1.4
    d = (2 / rho) / (1 + rho**-2)
    frf = rid.FrequencyResponse([0.0], [0.0], bound=0.2, dt=0.1)
    result = rid.identify(rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=1.0, decay_rate=rho)))
    most = (0.2 + d) / (1 + 0.2 * d)
    for value, bound in ((1.5, 0.1), (-1.2, 0.05), (most + 0.01, 0.1)):
        found = refute(result, one_line(result, np.pi / 0.1, value, bound))
        exact = (abs(value) - most) / bound
        assert found.ratio.item() <= exact + 1e-9
        assert exact <= found.attainable.item() + 1e-9
        assert found.ratio.item() == pytest.approx(exact, abs=2e-3 / bound)
        assert found.attainable.item() == pytest.approx(exact, abs=2e-3 / bound)
    sideways = refute(result, one_line(result, np.pi / 0.1, 0.3 + 0.4j, 0.1))  # the response is real there
    assert sideways.ratio.item() == pytest.approx(4.0)
    assert sideways.refuted


def test_complex_distance_encloses_that_of_the_joint_margin(mixed):
    # The smallest bound with which the new sample is consistent with the old data, by bisection.
    value = truth_of(3, "mixed")[1](140.0) + 1.2 * np.exp(2.2j)
    low, high = 0.0, 3.0
    for _ in range(12):
        middle = (low + high) / 2
        consistent = joined_margin(mixed, one_line(mixed, 140.0, value, middle))[1] <= 1
        low, high = (low, middle) if consistent else (middle, high)
    found = refute(mixed, one_line(mixed, 140.0, value, 1.0))
    assert found.ratio.item() <= high * 1.001
    assert low * 0.999 <= found.attainable.item()
    assert found.ratio.item() == pytest.approx(low, rel=0.01)
    assert found.attainable.item() == pytest.approx(low, rel=0.01)


@pytest.mark.parametrize("tilt", [slow(0.6), slow(0.7j), -0.5 + 0.4j])
def test_ellipses_of_new_samples(mixed, tilt):
    truth = truth_of(3, "mixed")[1](140.0)
    for push in (0.0, 0.6, 1.0):
        new = one_line(mixed, 140.0, truth + push * np.exp(0.3j), 0.06, tilt)
        found = refute(mixed, new)
        low, high = joined_margin(mixed, new)
        assert not (found.refuted and low <= 1)
        assert not (found.inside and high > 1 + 1e-6)
    assert found.ratio.item() <= found.attainable.item() <= 1.01 * found.ratio.item()
    # An ellipse lies between two discs.
    inner, outer = (
        refute(mixed, one_line(mixed, 140.0, new.values.item(), r.item()))
        for r in (new.bound.inner_radius, new.bound.outer_radius)
    )
    assert outer.ratio.item() <= found.attainable.item()
    assert found.ratio.item() <= inner.attainable.item()


@pytest.fixture(scope="module")
def broken(mixed):
    values = truth_of(3, "mixed")[1]([100.0, 140.0]) + np.array([0.0, 2.0])
    frf = rid.FrequencyResponse([100.0, 140.0], values, bound=0.1, dt=0.01)
    record = rid.TimeRecord([1.0, 0.0], [0.0, 3.0], dt=0.01, bound=0.5)
    return refute(mixed, (frf, record))


def test_worst_sample_and_words(broken):
    kind, index, at, ratio, attainable = broken.worst
    assert (kind, index, at) == ("frequency", 0, 140.0)
    assert 1 < ratio <= attainable
    text = broken.summary()
    assert "refuted    2 of 4 new samples" in text
    assert f"frequency experiment 1 at {140 / (2 * np.pi):.5g} Hz" in text
    assert f"{ratio:.4g} times its bound" in text
    assert "refuted, 4 new samples" in repr(broken)


def test_inside_in_words(mixed):
    found = refute(mixed, one_line(mixed, 140.0, truth_of(3, "mixed")[1](140.0), 0.3))
    assert found.inside
    assert "inside     each of the 1 new samples" in found.summary()
    assert "jointly" in found.summary()


def test_forged_proofs_fail(broken):
    assert broken.verify()
    lines, record = broken.samples
    for judged, place in ((lines, 0), (record, 1)):
        plane = judged.proofs[-1]
        forged = [
            dataclasses.replace(plane, value=plane.value - 0.1),
            dataclasses.replace(plane, normal=-plane.normal),
            dataclasses.replace(plane, normal=1.01 * plane.normal),
            dataclasses.replace(plane, place=0),
            dataclasses.replace(plane, certificate=dataclasses.replace(plane.certificate, level=0.0)),
        ]
        bad = [dataclasses.replace(judged, proofs=(*judged.proofs[:-1], one)) for one in forged]
        bad += [dataclasses.replace(judged, proofs=()), dataclasses.replace(judged, ratio=judged.ratio * 1.001)]
        for one in bad:
            both = [lines, record]
            both[place] = one
            assert not dataclasses.replace(broken, samples=tuple(both)).verify()


def test_taylor_form():
    result = rid.identify(random_problem(3, "frequency", 12), form="taylor", accuracy=0.05)
    truth = truth_of(3, "frequency")[1](140.0)
    assert refute(result, one_line(result, 140.0, truth + 0.02, 0.05)).ratio.item() <= 1
    far = refute(result, one_line(result, 140.0, truth + 3.0, 0.05))
    assert far.refuted
    assert far.ratio.item() <= far.attainable.item()
    assert joined_margin(result, one_line(result, 140.0, truth + 3.0, 0.05))[0] > 1


def test_bad_input(mixed):
    good = one_line(mixed, 10.0, 1.0, 0.1)
    record = rid.TimeRecord([1.0, 0.0], [0.0, 0.0], dt=0.01, bound=0.1)
    two = rid.FrequencyResponse([1.0], np.ones((1, 2, 1)), bound=0.1, dt=0.01)
    cases = [
        ([], "`new_data` is empty"),
        (dataclasses.replace(good, bound=None), "`new_data` needs a bound"),
        (
            dataclasses.replace(good, dt=0.02),
            "`new_data` must have the dt of the identified data, dt = 0.01 s; got dt = 0.02 s",
        ),
        (dataclasses.replace(good, dt=None), "`new_data` must have the dt .* got continuous time"),
        (two, "`new_data` must have the outputs and inputs of the identified data, 1 and 1; got 2 and 1"),
        (one_line(mixed, 10.0, 1.0, 0.1).with_column_bound(0.1), "`new_data` needs a bound of every entry"),
        (
            dataclasses.replace(record, initial="free"),
            "`new_data` must have zero initial conditions; .*'free'.*together",
        ),
        (
            dataclasses.replace(record, initial="periodic"),
            "`new_data` must have zero initial conditions; .*'periodic'.*estimate_frf",
        ),
    ]
    for data, sentence in cases:
        with pytest.raises(rid.InputError, match=sentence):
            refute(mixed, data)
    with pytest.raises(
        rid.errors.InputTypeError, match=r"`new_data` must be a FrequencyResponse, a TimeRecord .* got float"
    ):
        refute(mixed, 3.0)
    with pytest.raises(rid.errors.InputTypeError, match="`identification` must be an Identification"):
        refute(mixed.problem, good)


def test_units_must_agree():
    frf = rid.FrequencyResponse([0.0], [0.0], bound=0.2, dt=0.1, outputs=["x [um]"])
    result = rid.identify(rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=1.0, decay_rate=1.4)))
    with pytest.raises(rid.InputError, match=r"output in \[mm\], the identification in \[um\]"):
        refute(result, dataclasses.replace(frf, outputs=["x [mm]"]))
    assert not refute(result, dataclasses.replace(frf, outputs=["y [um]"])).refuted


# Matrices.

BASIS = rid.kautz([0.8], [0.1], dt=1.0, delay=1)


def at_one_entry(values, entry, bound):
    """The same data with a bound at one entry only."""
    bounds = np.full(values.shape, np.inf)
    bounds[:, *entry] = bound
    return bounds


@pytest.mark.parametrize("options", [slow({}), slow({"symmetric": True}), {"parametric": BASIS}])
def test_one_entry_is_refuted_where_no_joint_system_exists(options):
    problem, truth = random_matrix_problem(2, 2, 2, 3, rho=1.3, **options)
    result = rid.identify(problem)
    values = matrix_response(truth, np.array([1.9]))
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
        found, (low, high) = refute(result, new), joined_margin(result, new)
        assert not found.refuted or high > 1
        assert not found.inside or low <= 1
        verdicts.add("refuted" if found.refuted else "inside" if found.inside else "edge")
    assert {"refuted", "inside"} <= verdicts


@pytest.mark.parametrize(
    ("seed", "shape"), [(0, (2, 1)), slow(0, (2, 2)), *(slow(*c) for c in ((1, (2, 3)), (2, (3, 1))))]
)
def test_new_data_of_a_true_matrix_are_never_refuted(seed, shape):
    """Frequencies and a record of the same plant, errors inside their bounds; one wrong sample is found."""
    p, q = shape
    problem, truth = random_matrix_problem(seed, p, q, 3, rho=1.4)
    result, rng = rid.identify(problem), np.random.default_rng(seed)
    omega = np.array([0.4, 1.1])
    values = matrix_response(truth, omega)
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
    assert joined_margin(result, dataclasses.replace(record, y=wrong))[0] > 1


def test_other_signals_and_shared_bounds_are_refused():
    problem, _ = random_matrix_problem(0, 2, 2, 2, rho=1.4)
    result = rid.identify(problem)
    one = rid.FrequencyResponse([1.0], [1.0], bound=0.1, dt=1.0)
    with pytest.raises(rid.InputError, match="outputs and inputs of the identified data, 2 and 2; got 1 and 1"):
        refute(result, one)
    with pytest.raises(rid.InputError, match="needs a bound of every entry"):
        refute(result, problem.frequency[0].with_column_bound(0.1))
