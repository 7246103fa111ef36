"""Cells of a box of poles that are halved where the error is largest, other ones at every frequency, proved by sums."""

import dataclasses
import functools
import importlib.util

import numpy as np
import pytest

import robustid as rid
from robustid.core import Budget
from robustid.errors import FileFormatError
from robustid.guarantees import box_of, placement
from robustid.guarantees.candidates import candidates_of, shares_of
from robustid.guarantees.linear import amplitudes
from robustid.guarantees.linear.certificate import targets_at
from robustid.guarantees.linear.further_points import contradicted, further_points
from robustid.guarantees.over_poles import WorstCaseOverPoles
from robustid.guarantees.pole_proofs import RefutedBySums, SummedCell, is_empty
from robustid.guarantees.pole_tree import Branch, PoleTree
from robustid.guarantees.sweep import Means
from robustid.guarantees.value_set import corners
from support.forging import arrays_of, forge
from support.refusals import refused

BOX = np.array([[9.85, 10.15]]), np.array([[0.035, 0.065]])
PEAK, NEAR, BESIDE = 10.0, 12.0, 18.0


def response(omega):
    x, a = np.exp(-0.1j * omega), np.exp(-0.05 + 1j * np.sqrt(1 - 0.05**2))
    return 0.3 * x / (1 - a * x) + 0.3 * x / (1 - a.conj() * x) + 1 / (2 - x)


@functools.cache
def identified(omega=10.0, damping=0.05, bound=0.3):
    lines = np.linspace(1.0, 25.0, 17)
    values = response(lines) + 0.9 * bound * np.exp(2j * np.pi * np.random.default_rng(0).random(lines.size))
    frf = rid.FrequencyResponse(lines, values, bound=bound, dt=0.1)
    prior = rid.Prior(gain_bound=2.0, decay_rate=1.5)
    pair = rid.kautz(omega, damping, dt=0.1, delay=1)
    return rid.identify(rid.MixedProblem(frequency=frf, prior=prior, parametric=pair))


SMALL = 0.02  # bound of the samples where the box matters


def nominal(omega):
    return identified().problem.plane.values_at(identified(bound=SMALL).model, np.array([omega]))[0]


@functools.cache
def tree():
    found = identified(bound=SMALL)
    return PoleTree(found.problem, found.model, box_of(found, *BOX, 1))


def largest(omega, most):
    """Largest error at a frequency that so many cells prove, and the cells."""
    leaves = tree().cover(omega, np.ones((1, 1)), most, None)
    return max(float(leaf.errors(omega, nominal(omega)).max()) for leaf in leaves), leaves


@functools.cache
def reached(omega, count):
    """Largest error of consistent systems with poles on a grid of the box."""
    found = []
    for w in np.linspace(*BOX[0][0], count):
        for d in np.linspace(*BOX[1][0], count):
            one = identified(w, d, SMALL)
            if one.consistent:
                error = rid.worst_case_error(
                    one, model=identified(bound=SMALL).model, omega=[omega], directions=8, rtol=0.05
                )
                found.append(error.lower.max())
    return max(found)


def test_more_cells_prove_less_and_never_less_than_consistent_systems_reach():
    one, few, many = (largest(NEAR, most)[0] for most in (1, 4, 8))
    assert reached(NEAR, 3) <= many <= few <= 0.9 * one
    assert many <= 0.8 * one


@pytest.mark.slow
def test_many_cells_come_near_to_what_consistent_systems_reach():
    """A plain grid of poles, each solved by itself."""
    assert reached(NEAR, 9) <= largest(NEAR, 24)[0] <= 1.1 * reached(NEAR, 9)


def test_the_error_of_a_cell_is_that_of_the_farthest_corner_of_its_polygon():
    """By the sides themselves: from a point inside the walk in every direction ends at the first one."""
    _, leaves = largest(NEAR, 8)
    (value,) = nominal(NEAR).ravel()
    turns = np.exp(2j * np.pi * np.arange(20000) / 20000)
    for leaf in leaves:
        (one,) = leaf.kept([NEAR]).values
        normals = np.exp(1j * one.directions)
        assert np.all(np.real(np.conj(normals) * one.vertices.mean()) < one.support)
        room, speed = (
            one.support - np.real(np.conj(normals) * one.vertices.mean()),
            np.real(np.conj(normals) * turns[:, None]),
        )
        steps = np.where(speed > 1e-12, room / np.where(speed > 1e-12, speed, 1.0), np.inf).min(axis=1)
        walked = np.abs(one.vertices.mean() + steps * turns - value).max()
        np.testing.assert_allclose(leaf.errors(NEAR, nominal(NEAR)).max(), walked, rtol=1e-4)


def test_lines_that_the_farthest_system_contradicts_are_the_slopes_of_the_bound():
    """Differences of the bound itself, with a little of each line that is not among the points, in the direction of least bound."""
    branch = tree().root
    branch.solve(BESIDE, nominal(BESIDE))
    (search,), (one,) = branch._searches, branch.found[BESIDE]
    samples = search.sides.samples
    target = targets_at(samples, identified().problem.plane.angles(np.array([BESIDE])))
    points = one.points[:5]
    c, bounds = search.search(target, points)
    away, of_records = contradicted(search.sides, target, points, c, search.turns)
    assert not of_records.size
    for k in (1, 6):
        others = np.setdiff1d(np.arange(search.sides.half), points)
        for line in others[[0, 4, 8]].tolist():
            more, slopes = np.append(points, line), []
            for turn in np.exp(2j * np.pi * np.arange(24) / 24):
                step = 1e-3 * np.abs(c[k]).max()
                tried = np.append(c[k], step * turn)[None, None]
                total = rid.guarantees.linear.directed.supports(
                    search.sides, target, more, tried, search.turns[k : k + 1]
                )
                slopes.append((total[0, 0] - bounds[k]) / step)
            # What is gained by the best direction is how far the line lies outside, if it does.
            assert -min(slopes) <= away[k, line] + 0.1 * samples.bound[line]
            if away[k, line] > 0.3 * samples.bound[line]:
                assert -min(slopes) >= 0.5 * away[k, line]
    chosen = further_points(search.sides, target, points, c[:2], search.turns[:2], 9)
    assert chosen.size == 9
    assert np.all(np.diff(chosen) > 0)


def test_far_from_the_box_few_cells_say_it_all():
    assert largest(25.0, 24)[0] >= 0.9 * largest(25.0, 1)[0]


def test_halves_have_amplitudes_of_their_own():
    """A mode of less damping has a smaller residue for the same peak; what a half says is proved by its own sums."""
    whole = box_of(identified(), *BOX, 1)
    halves = whole.split(identified().problem, 0)
    assert all(half.amplitude[0] < whole.amplitude[0] for half in halves)
    for half in halves:
        np.testing.assert_array_equal(half.proved_again(identified().problem).amplitude, half.amplitude)
    assert max(half.amplitude[0] for half in halves) >= 0.3


def test_amplitudes_of_a_half_take_one_search_from_those_of_the_whole(monkeypatch):
    """Also where the other middle makes them larger: from discs that are too small no sums would be as good as none."""
    problem, calls, search = identified(bound=SMALL).problem, [], amplitudes.search
    monkeypatch.setattr(amplitudes, "search", lambda *given, **named: calls.append(1) or search(*given, **named))
    whole = box_of(identified(bound=SMALL), *BOX, 1)
    calls.clear()
    halves = whole.split(problem, 0)
    quarters = [one for half in halves for one in half.split(problem, 0, hyperbolic=True)]
    assert len(calls) == len(halves) + len(quarters)
    for one in (*halves, *quarters):
        middle = identified(omega=one.omega.mean(), damping=one.damping.mean(), bound=SMALL)
        own = box_of(middle, one.omega, one.damping, 1)  # from nothing
        assert one.amplitude[0] <= 1.02 * own.amplitude[0]


@functools.cache
def polygons():
    return polygons_of(identified(bound=SMALL), BOX, [NEAR, BESIDE])


def polygons_of(one, box, omega, cells=6):
    """Those of so many cells at frequencies, without what a band makes of them."""
    plain = rid.band(one, omega=omega, box=box, model=one.model, knots=40)
    programs = placement.OverBox(one, one.model, box, np.ones((1, 1)), every=True)
    with pytest.MonkeyPatch.context() as patch:
        for most in ("_CELLS", "_CELLS_AT_PEAK"):
            patch.setattr(placement, most, cells)
        programs.solve(np.array(omega), plain, Means())
    return programs.polygons()


def test_every_frequency_has_its_own_cells_and_each_cover_is_checked(tmp_path):
    found = polygons()
    used = {tuple(w in item.omega for w in (NEAR, BESIDE)) for item in found.kept}
    assert len(used) > 1  # some cells stand at one frequency alone
    assert all(isinstance(item, SummedCell) for item in found.kept)
    assert found.verify()
    rid.save(tmp_path / "box", found)
    again = rid.load(tmp_path / "box")
    np.testing.assert_array_equal(again.upper, found.upper)
    assert again.verify()
    for w in (NEAR, BESIDE):
        number = next(k for k, item in enumerate(found.kept) if w in item.omega)
        left = [k for k, item in enumerate(found.kept) if k != number]
        less = dataclasses.replace(found, kept=tuple(found.kept[k] for k in left))
        assert not less.covered
        assert not less.verify()


def test_sums_that_are_others_prove_what_they_prove_and_stated_values_below_them_nothing(tmp_path):
    found = polygons()
    first = found.kept[0]
    low = tuple(dataclasses.replace(one, support=one.support - 1e-6) for one in first.values)
    forged = dataclasses.replace(found, kept=(dataclasses.replace(first, values=low), *found.kept[1:]))
    assert forged.covered
    assert not forged.verify()
    rid.save(tmp_path / "box", found)
    name = next(n for n in arrays_of(tmp_path / "box.npz") if n.startswith("kept/0") and n.endswith("multipliers"))
    forge(tmp_path / "box", lambda a: {name: 0.5 * a[name]})
    assert np.all(rid.load(tmp_path / "box").upper >= found.upper)
    forge(tmp_path / "box", lambda a: {name: a[name][:, :-1]})
    refused("do not belong to the samples", rid.load, tmp_path / "box", error=FileFormatError)


def test_sums_over_a_part_of_a_cell_prove_nothing_of_the_whole():
    """Samples are made anew from the ends of a cell: those of smaller boxes, kept in its proofs, are not taken over."""
    one, omega = identified(bound=SMALL), np.array([NEAR])
    nominal = one.problem.plane.values_at(one.model, omega)[0]
    whole = box_of(one, *BOX, 1)
    half = next(h for h in Branch(one.problem, whole).halves(0))
    half.solve(NEAR, nominal)
    own = half.kept([NEAR])
    forged = dataclasses.replace(own.cell, omega=whole.omega, damping=whole.damping)
    kept = (dataclasses.replace(own, cell=forged),)
    found = WorstCaseOverPoles(identification=one, model=one.model, omega=omega, box=whole, kept=kept, refuted=())
    assert not found.verify()
    large = dataclasses.replace(forged, amplitude=whole.amplitude)
    found = dataclasses.replace(found, kept=(dataclasses.replace(own, cell=large),))
    assert not found.verify()


def test_where_the_response_is_real_two_sides_close_the_polygon(tmp_path):
    """At zero and half of the sampling frequency."""
    one, ends = identified(bound=SMALL), [0.0, NEAR, np.pi / 0.1]
    found = polygons_of(one, BOX, ends)
    for value in (value for item in found.kept for value in item.values):
        assert value.directions.size == (16 if value.omega == NEAR else 2)
    assert found.verify()
    error = np.abs(response(np.array(ends)) - one.problem.plane.values_at(one.model, np.array(ends))[:, 0, 0])
    assert np.all(error <= found.upper[:, 0, 0])
    rid.save(tmp_path / "box", found)
    np.testing.assert_array_equal(rid.load(tmp_path / "box").upper, found.upper)


@pytest.mark.slow
def test_beside_a_record_sums_over_lines_prove_the_polygons(tmp_path):
    """The samples of a record help to bound the amplitudes, and stand in the sums."""
    plain, rng = identified(bound=SMALL).problem, np.random.default_rng(0)
    a = np.exp(-0.05 + 1j * np.sqrt(1 - 0.05**2))
    taps = np.arange(40)
    impulse = 2 * np.real(0.3 * a ** (taps - 1)) * (taps > 0) + 0.5 ** (taps + 1)
    u = rng.standard_normal(40)
    y = np.convolve(u, impulse)[:40] + rng.uniform(-SMALL, SMALL, 40)
    record = rid.TimeRecord(u, y, bound=SMALL, dt=0.1, initial="rest")
    one = rid.identify(dataclasses.replace(plain, time=record))
    assert one.consistent
    found = polygons_of(one, BOX, [NEAR])
    own = found.kept[0].bands[0]
    assert np.any((own.points < 0) & (np.abs(own.multipliers).max(axis=1) > 0))
    error = np.abs(response(NEAR) - one.problem.plane.values_at(one.model, np.array([NEAR]))[0, 0, 0])
    assert error <= found.upper[0, 0, 0] <= rid.band(one, omega=[NEAR], box=BOX, knots=40).upper[0, 0, 0]
    assert found.verify(exact=importlib.util.find_spec("flint") is not None)
    rid.save(tmp_path / "box", found)
    np.testing.assert_array_equal(rid.load(tmp_path / "box").upper, found.upper)


def test_an_amplitude_below_the_proved_one_is_not_accepted():
    found = polygons()
    first = found.kept[0]
    small = dataclasses.replace(first.cell, amplitude=0.99 * first.cell.amplitude)
    assert not dataclasses.replace(found, kept=(dataclasses.replace(first, cell=small), *found.kept[1:])).verify()
    unproved = dataclasses.replace(first.cell, proofs=())
    assert not dataclasses.replace(found, kept=(dataclasses.replace(first, cell=unproved), *found.kept[1:])).verify()


def test_cells_that_contradict_the_data_are_left_out_with_a_proof(tmp_path):
    """Bounds that are narrow for a wide box: no system has its poles in most of it."""
    one, wide = identified(bound=0.01), (np.array([[9.3, 10.7]]), np.array([[0.02, 0.12]]))
    branches = PoleTree(one.problem, one.model, box_of(one, *wide, 1))
    leaves = branches.cover(PEAK, np.ones((1, 1)), 48, None)
    gone = [leaf for leaf in branches.refuted if not leaf._halves]
    assert gone
    for leaf in gone:
        (w,), (d,) = leaf.cell.omega, leaf.cell.damping
        assert not (w[0] <= 10.0 <= w[1] and d[0] <= 0.05 <= d[1])
        for poles in ((w.mean(), d.mean()), (w[0], d[1])):
            assert not identified(*poles, bound=0.01).consistent
    found = polygons_of(one, wide, [PEAK])
    assert any(isinstance(item, RefutedBySums) for item in found.refuted)
    assert found.verify()
    rid.save(tmp_path / "box", found)
    assert rid.load(tmp_path / "box").verify()
    assert not dataclasses.replace(found, refuted=found.refuted[:0]).verify()
    assert leaves


def test_opposite_sides_that_leave_nothing_between_them_are_empty():
    square = np.array([1.0, 1.0, 1.0, 1.0])
    assert not is_empty(square)
    assert is_empty(np.array([1.0, -0.5, 1.0, 0.4]))
    assert not is_empty(np.array([1.0, -0.5, 1.0, 0.6]))


def test_without_time_for_the_whole_box_there_are_no_polygons():
    found, omega = identified(), np.array([BESIDE, PEAK])
    programs = placement.OverBox(found, found.model, BOX, np.ones((1, 1)))
    band = rid.band(found, omega=omega, box=BOX, knots=40)
    seen, radius = programs.solve(omega, band, Means(budget=Budget(1e-9)))
    assert seen.size == radius.size == 0
    assert programs.polygons() is None


def test_errors_without_bound_are_larger_than_all_others_and_one_of_themselves():
    errors = np.array([[[1.0, np.inf]], [[np.inf, 2.0]], [[4.0, 1.0]]])
    np.testing.assert_array_equal(shares_of(errors, np.array([[2.0, 4.0]])), [np.inf, np.inf, 2.0])
    np.testing.assert_array_equal(shares_of(errors, np.array([[2.0, np.inf]])), [1.0, np.inf, 2.0])


def test_frequencies_beyond_the_data_are_thought_of_where_the_discs_are_larger_than_within_them():
    problem = identified().problem  # lines from 1 to 25 rad/s
    omega = np.array([0.5, 5.0, 20.0, 26.0, 28.0, 30.0])

    class Discs:
        range = (0.0, 31.0)

        def at(self, omega):
            return 0 * omega, np.interp(omega, [0.0, 25.0, 27.0, 31.0], [1.0, 1.0, 1.0, 2.0])[:, None, None]

    for box in (None, BOX):
        found = candidates_of(Discs(), problem, omega, box)
        assert np.isin([5.0, 20.0, 28.0, 30.0], found).all()
        assert not np.isin([0.5, 26.0], found).any()
        assert np.all(np.diff(found) > 0)
        assert np.all(found[(found < 1.0) | (found > 25.0)] == [28.0, 30.0])


def test_cells_without_a_bound_end_the_search_without_a_warning(monkeypatch):
    """Of a box that reaches undamped poles: where the band has no bound either, infinite errors are 1 in units of it."""
    monkeypatch.setattr(Branch, "errors", lambda *_: np.full((1, 1), np.inf))
    found, infinite, omega = identified(bound=SMALL), np.full((1, 1), np.inf), np.array([PEAK, NEAR])
    own = PoleTree(found.problem, found.model, box_of(found, *BOX, 1))
    assert own.cover(PEAK, infinite, 4, None)
    programs = placement.OverBox(found, found.model, BOX, infinite)
    seen, radius = programs.lower(omega, rid.band(found, box=BOX, omega=omega), Means(None, None, None, Budget()))
    assert seen.size == radius.size == 0
    assert programs.polygons() is None


def test_sides_without_a_bound_have_no_corners():
    found = corners(np.arange(16) * np.pi / 8, np.full(16, np.inf))
    assert np.all(np.isinf(np.abs(found - 1j)))
