"""Polygons beside the discs of a band: the smaller bound of both, plants at the edge inside, nothing that a file alone lowers."""

import dataclasses
import functools
import importlib.util
import json

import control
import numpy as np
import pytest

import robustid as rid
from robustid.app.run import sequence
from robustid.app.run.run_file import RunFile
from robustid.app.run.run_folder import Surroundings
from robustid.app.run.work import Work
from robustid.core import Budget
from robustid.errors import FileFormatError, InputTypeError
from robustid.guarantees import placement
from robustid.guarantees.candidates import halved
from robustid.guarantees.common_nominal import smallest_disc
from robustid.guarantees.consistent_set import ConsistentSet
from robustid.guarantees.linear.directed_search import DirectedSearch
from robustid.guarantees.sweep import Means
from support.edge_bands import edge_plant
from support.forging import arrays_of, forge, kept
from support.refusals import refused

OMEGA = np.array([0.5, 3.0, 7.5, 11.0, 28.0])
AT = OMEGA[[1, 2, 4]]
pytestmark = pytest.mark.usefixtures("unhalved")


def truth(omega):
    """A mode beside 1/(2 - x)."""
    x, a = np.exp(-0.1j * np.asarray(omega)), np.exp(-0.05 + 1j * np.sqrt(1 - 0.05**2))
    return (0.3 * x / (1 - a * x) + 0.3 * x / (1 - a.conj() * x) + 1 / (2 - x))[:, None, None]


@functools.cache
def identified(bound=0.03):
    lines = np.linspace(1.0, 25.0, 12)
    values = truth(lines) + 0.9 * bound * np.exp(2j * np.pi * np.random.default_rng(0).random((12, 1, 1)))
    frf = rid.FrequencyResponse(lines, values, bound=bound, dt=0.1)
    prior = rid.Prior(gain_bound=2.0, decay_rate=1.5)
    pair = rid.kautz(10.0, 0.05, dt=0.1, delay=1)
    return rid.identify(rid.MixedProblem(frequency=frf, prior=prior, parametric=pair))


@functools.cache
def plain():
    return rid.band(identified(), omega=OMEGA, knots=60)


@functools.cache
def refined():
    return plain().refine(identified(), omega=AT)


BOX = np.array([[9.99, 10.01]]), np.array([[0.049, 0.051]])


@functools.cache
def over_box():
    plain = rid.band(identified(), omega=OMEGA, box=BOX, knots=60)
    return plain, plain.refine(identified(), omega=AT[:2])


def supports(path):
    return [name for name in arrays_of(path) if name.startswith("polygons/") and name.endswith("support")]


class Loose:
    """Discs that are as good as nothing at one frequency."""

    range = (0.0, 31.0)

    def at(self, omega):
        return plain().at(omega)[0], np.where(omega == OMEGA[3], 1e3, 1e-9)[:, None, None]


def other_model():
    return control.ss(control.tf([0.5, 0.3], [1.0, -0.4], 0.1))


def farthest(value_set, nominal):
    """Largest distance of the points of a polygon from a value, by walking from a point inside to the first side."""
    inside, turns = np.mean(value_set.points), np.exp(2j * np.pi * np.arange(20000) / 20000)
    normals = np.exp(1j * value_set.directions)
    room = value_set.support - np.real(np.conj(normals) * inside)
    speed = np.real(np.conj(normals) * turns[:, None])
    steps = np.where(speed > 1e-12, room / np.where(speed > 1e-12, speed, 1.0), np.inf).min(axis=1)
    return np.abs(inside + steps * turns - nominal).max()


def test_the_smaller_bound_of_both_holds_at_the_frequencies_of_the_polygons():
    np.testing.assert_array_equal(refined().omega, OMEGA)
    at = np.isin(OMEGA, AT)
    smaller = np.minimum(plain().upper[at], refined().polygons.upper)
    np.testing.assert_allclose(refined().upper[at], smaller, rtol=1e-6)
    assert np.all(refined().upper[at] <= smaller * (1 + 1e-12))
    assert np.all(refined().upper[~at] <= plain().upper[~at])
    assert refined().narrowed[at].any()
    assert not refined().narrowed[~at].any()
    np.testing.assert_array_equal(refined().narrowed[at], (refined().upper < plain().upper)[at, 0, 0])
    np.testing.assert_array_equal(refined().sigma_upper, refined().upper[:, 0, 0])


def test_polygons_narrow_the_band_beside_their_frequencies_and_widen_it_nowhere():
    """Samples there, they are: next to one the disc is that around it, farther away some of it is left."""
    at_nodes, (_, alone) = refined().at(AT), plain().at(AT)
    for near in (AT * (1 + 1e-9), AT - 0.01):
        centre, radius = refined().at(near)
        assert np.all(radius <= plain().at(near)[1])
        assert np.any(radius < 0.95 * alone)
        np.testing.assert_allclose(radius, at_nodes[1], rtol=0.05)
        assert np.all(np.abs(centre - at_nodes[0]) <= 0.2 * at_nodes[1])
    np.testing.assert_array_equal(refined().error_at(AT[::-1]), refined().error_at(AT)[::-1])
    omega = np.random.default_rng(0).uniform(0, 31, 400)
    (centre, radius), before = refined().at(omega), plain().at(omega)[1]
    assert np.all(np.abs(truth(omega) - centre) <= radius)
    assert np.all(radius <= before)
    assert np.all(refined().error_at(omega) <= plain().error_at(omega))


def test_polygons_bound_the_error_of_any_model_and_of_the_centres():
    centred = dataclasses.replace(refined(), model=None)
    for found, nominal in [
        (refined(), None),
        (refined().with_model(other_model()), None),
        (centred, centred.at(AT)[0][:, 0, 0]),
    ]:
        values = found.problem.plane.values_at(found.model, AT)[:, 0, 0] if nominal is None else nominal
        judged = [farthest(*pair) for pair in zip(found.polygons.values, values, strict=True)]
        discs = found.at(AT)[1] if found.model is None else dataclasses.replace(found, polygons=None).error_at(AT)
        upper = found.error_at(AT)[:, 0, 0]
        assert np.all(upper >= np.minimum(judged, discs[:, 0, 0]))
        np.testing.assert_allclose(upper, np.minimum(judged, discs[:, 0, 0]), rtol=1e-4)


@pytest.mark.slow
def test_between_solved_frequencies_the_band_is_as_narrow_as_a_polygon_there():
    """Discs around polygons that are solved there, at 10 random frequencies between 24: 1.05 times these in the median."""
    solved, between = np.linspace(1, 25, 24), np.sort(np.random.default_rng(0).uniform(1, 25, 10))
    found = plain().with_polygons(rid.worst_case_error(identified(), omega=solved, directions=8))
    brute = rid.worst_case_error(identified(), omega=between, directions=8)
    least = [smallest_disc(one.vertices).radius for one in brute.values]
    ratio = found.at(between)[1][:, 0, 0] / least
    assert np.median(ratio) <= 1.05
    assert ratio.max() <= 1.2
    assert (plain().at(between)[1][:, 0, 0] / least).max() >= 1.4  # what the samples alone leave
    assert found.verify(exact=importlib.util.find_spec("flint") is not None)


@pytest.mark.slow
def test_polygons_stand_where_they_gain(monkeypatch):
    """Six of them at most, chosen two at a time, in the range of the data: as much as six that are equally spaced."""
    monkeypatch.setattr(placement, "_MOST", 6)
    monkeypatch.setattr(placement.OfExactPoles, "together", 2)
    found, omega = plain().refine(identified()), np.linspace(1, 25, 300)
    solved = found.polygons.omega
    assert 2 <= solved.size <= 6
    assert np.all((solved >= 1) & (solved <= 25))
    own, least = found.at(solved)[1], plain().at(solved)[1]
    assert np.median(least / own) >= 1.05
    equally = plain().refine(identified(), omega=np.linspace(1, 25, 6))
    width = [(one.at(omega)[1] / plain().at(omega)[1]).mean() for one in (found, equally)]
    assert width[0] <= width[1] + 0.01
    assert found.verify()


@pytest.mark.slow
def test_over_a_box_polygons_that_are_no_better_are_not_pursued(monkeypatch):
    monkeypatch.setattr(placement.OverBox, "most", 4)
    band, model = over_box()[0], identified().model
    largest = band.error_at(OMEGA, model).max(axis=0)
    programs = placement.OverBox(identified(), model, BOX, largest)

    class Small(Loose):
        def at(self, omega):
            return band.at(omega)[0], 1e-6 + 0 * band.at(omega)[1]

        def error_at(self, omega, model):
            return band.error_at(omega, model)

    seen, radius = programs.solve(AT[:2], Small(), Means())
    np.testing.assert_array_equal(seen, AT[:2])
    assert programs.polygons() is None
    assert np.all(radius > 1e-6)
    # The largest error is lowered by less too.
    monkeypatch.setattr(placement.OverBox, "lower", placement.Programs.lower)
    found = band.refine(identified())
    if found.polygons is not None:
        own = found.at(found.polygons.omega)[1]
        assert np.all(own <= band.at(found.polygons.omega)[1] / 1.05 * (1 + 1e-9))
    assert np.all(np.abs(truth(OMEGA) - found.at(OMEGA)[0]) <= found.at(OMEGA)[1])
    assert found.verify()


# Plants of which the data are consistent: with exact poles, and with those of a problem whose true poles are elsewhere in a box.
EDGES = {
    "discrete": ([11, 12, 16, 21], [2, 10, 22, 31]),
    "continuous": ([10, 15, 19, 29, 30], [1, 5, 13, 17]),
    "roll-off": ([0, 2, 5, 14, 18], [1, 3, 4, 15]),
    "free record": ([18, 31], []),
    "periodic record": ([0, 28], []),
    "record of two inputs": ([4, 7, 10, 15, 21], []),
    "symmetric": ([2, 23, 31, 35, 36], []),
}
QUICK = [("discrete", 2)]  # over a box; exact poles in test_directed


@pytest.mark.parametrize(
    ("kind", "seed"),
    [
        pytest.param(kind, seed, marks=() if (kind, seed) in QUICK else pytest.mark.slow)
        for kind, seeds in EDGES.items()
        for seed in (*seeds[0], *seeds[1])
    ],
)
def test_a_plant_at_the_edge_is_within_the_refined_bounds(kind, seed):
    plant = edge_plant(kind, seed)
    result = rid.identify(plant.problem)
    band = rid.band(
        result,
        box=plant.box,
        omega=plant.frequencies(np.random.default_rng(seed), 4),
        knots=30 if (kind, seed) in QUICK else 100,
    )
    found = band.refine(result, omega=band.omega)
    error = np.abs(plant.truth(found.omega) - plant.problem.plane.values_at(found.model, found.omega))
    assert (plant.box is None) == (seed in EDGES[kind][0])
    assert np.isin(found.polygons.omega, found.omega).any()
    between = plant.frequencies(np.random.default_rng(seed + 1), 100)
    between = between[(between >= found.range[0]) & (between <= found.range[1])]
    centre, radius = found.at(between)
    assert np.all(np.abs(plant.truth(between) - centre) <= radius)
    assert np.all(error <= found.upper)
    assert np.all(np.linalg.norm(error, 2, axis=(1, 2)) <= found.sigma_upper)
    assert found.verify()


@pytest.mark.slow
def test_the_whole_axis_follows_polygons_that_stand_close_to_each_other():
    peak = plain().omega[int(np.argmax(plain().sigma_upper))]
    close = np.linspace(max(peak - 0.6, 0.1), peak + 0.6, 13)
    found = plain().refine(identified(), omega=close)
    inside = np.random.default_rng(0).uniform(close[0], close[-1], 200)
    arcs = [np.searchsorted(one.circle.edges, inside) - 1 for one in (plain(), found)]
    before, after = plain().circle.bound[arcs[0]], found.circle.bound[arcs[1]]
    assert np.median(after / before) < 0.95
    error = np.abs(truth(inside) - found.problem.plane.values_at(found.model, inside))[:, 0, 0]
    assert np.all(error <= after)
    assert np.all(found.circle.bound[arcs[1]] <= before * (1 + 1e-6))
    assert found.hinf <= plain().hinf * (1 + 1e-6)
    assert found.weight(order=2).order >= 0


def test_polygons_at_exact_poles_never_narrow_a_band_over_a_box(tmp_path):
    exact, (band, _) = refined().polygons, over_box()
    for call in (lambda: band.with_polygons(exact), lambda: dataclasses.replace(band, polygons=exact)):
        refused("stand on exact poles, and the band covers a box", call)
    for one, narrows in ((band, False), (plain(), True)):
        work = Work(run=RunFile(), identification=identified(), band=one, error=exact)
        sequence.refined(work)
        assert (work.band.polygons is exact) == narrows
        assert work.band.narrowed.any() == narrows
    for name, one in (("exact", refined()), ("band", band)):
        one.save(tmp_path / name)
    polygons = json.loads((tmp_path / "exact.json").read_text())["polygons"]
    forge(
        tmp_path / "band",
        lambda _: {n: a for n, a in arrays_of(tmp_path / "exact").items() if "polygons/" in n},
        lambda record: record.update(polygons=polygons),
    )
    refused("stand on exact poles", rid.load, tmp_path / "band", error=FileFormatError)


def test_a_band_over_a_box_is_refined_over_the_same_box():
    band, found = over_box()
    at = np.isin(OMEGA, AT[:2])
    assert isinstance(found.polygons, rid.guarantees.WorstCaseOverPoles)
    np.testing.assert_allclose(found.upper[at], np.minimum(band.upper[at], found.polygons.upper), rtol=1e-12)
    assert np.all(found.upper[~at] <= band.upper[~at])
    error = np.abs(truth(OMEGA) - found.nominal)
    assert np.all(error <= found.upper)
    assert found.verify()
    assert "amplitudes are assumed" not in found.summary()
    wider = rid.band(identified(), omega=OMEGA, box=(BOX[0] + [[-0.01, 0.01]], BOX[1]))
    refused("`polygons` must cover the box of the band; their `omega` is", wider.with_polygons, found.polygons)
    refused("`polygons` cover a box of poles, and the band has none", lambda: plain().with_polygons(found.polygons))


def test_polygons_of_another_problem_or_kind_are_refused():
    other = rid.worst_case_error(identified(0.05), omega=[3.0], directions=4)
    refused("`polygons` are about another problem", lambda: plain().with_polygons(other))
    refused("`polygons` are about another problem", lambda: plain().refine(identified(0.05), omega=[3.0]))
    refused("`polygons` must be a WorstCaseError", lambda: plain().with_polygons(3.0), error=InputTypeError)
    refused("`identification` must be an Identification", lambda: plain().refine(plain()), error=InputTypeError)


@pytest.mark.parametrize("over", ["exact poles", "a box"])
def test_a_refined_band_comes_back_from_its_files(tmp_path, over):
    found = refined() if over == "exact poles" else over_box()[1]
    again = kept(found, tmp_path / "band")
    np.testing.assert_array_equal(again.omega, found.omega)
    np.testing.assert_array_equal(again.upper, found.upper)
    assert again.certified
    assert again.summary() == found.summary()
    assert kept(plain(), tmp_path / "plain").polygons is None


def test_sides_that_no_certificate_supports_are_not_loaded(tmp_path):
    found, path = refined(), tmp_path / "band"
    found.save(path)
    assert supports(path)
    for name in supports(path)[:1]:
        forge(path, lambda a, name=name: {name: a[name] - 1e-3 * np.abs(a[name]).max()})
    refused("polygons do not follow from their certificates", rid.load, path, error=FileFormatError)


def test_sides_that_are_farther_out_than_proved_lower_nothing(tmp_path):
    refined().save(tmp_path / "band")
    forge(tmp_path / "band", lambda a: {n: a[n] + 0.1 for n in supports(tmp_path / "band")})
    again = rid.load(tmp_path / "band")
    assert np.all(again.radius >= refined().radius * (1 - 1e-9))
    assert np.all(again.radius <= plain().radius)


def test_multipliers_of_a_side_that_are_others_prove_nothing(tmp_path):
    refined().save(tmp_path / "band")
    forge(
        tmp_path / "band", lambda a: {n: 0.5 * a[n] for n in a if n.startswith("polygons/values/") and "samples" in n}
    )
    refused("polygons do not follow from their certificates", rid.load, tmp_path / "band", error=FileFormatError)


def test_without_time_the_discs_stand_but_where_they_are_loosest():
    """The first frequency is finished whatever the limit is: that at which a known disc is said to be the loosest."""
    found = plain().refine(identified(), time_limit=1e-6)
    assert found.polygons.omega.size == 1
    error = rid.worst_case_error(identified(), omega=OMEGA, directions=4, known=Loose(), time_limit=1e-6)
    np.testing.assert_array_equal(error.omega, OMEGA[3:4])
    assert plain().refine(omega=AT[:1], time_limit=30.0).polygons.omega.size == 1  # identified on the way


def test_steps_of_a_run_begin_no_program_where_its_time_is_over(monkeypatch):
    """The band stands; a first frequency takes half a minute where the class decays slowly, and so does the search between."""
    error = refined().polygons
    monkeypatch.setattr(ConsistentSet, "extreme", None)
    monkeypatch.setattr(DirectedSearch, "search", None)
    around = Surroundings(budget=Budget(1e-6))
    work = Work(run=RunFile(), identification=identified(), band=plain(), around=around)
    sequence.bounded(work)
    assert work.error is None
    work.error = error
    sequence.refined(work)
    assert work.band.polygons is error
    assert [late.split(" ")[0] for late in around.stops.late] == ["bounding", "narrowing"]


def test_over_a_box_nothing_is_begun_that_takes_longer_than_the_time(monkeypatch):
    band = over_box()[0]
    monkeypatch.setattr(DirectedSearch, "search", None)
    found = band.refine(identified(), time_limit=1e-6)
    assert found.polygons is None
    np.testing.assert_array_equal(found.radius, over_box()[0].radius)


def test_a_frequency_that_differs_by_rounding_is_not_there_twice():
    error = rid.worst_case_error(identified(), omega=np.nextafter(OMEGA[1:3], 0), directions=4)
    found = plain().with_polygons(error)
    np.testing.assert_allclose(found.omega, OMEGA, rtol=1e-12)
    assert np.isin(error.omega, found.omega).all()


def test_the_summary_says_where_the_band_stands_on_what():
    count = int(refined().narrowed.sum())
    assert f"At {count} of 5 frequencies a semidefinite program narrows the band" in refined().summary()
    assert "everywhere else the band of sums stands" in refined().summary()
    assert "semidefinite" not in plain().summary()
    loose = rid.worst_case_error(identified(), omega=AT, directions=3, rtol=5.0).values
    wide = tuple(dataclasses.replace(one, support=one.support + 1.0) for one in loose)
    nothing = plain().with_polygons(dataclasses.replace(refined().polygons, values=wide))
    assert "at 3 of 5 frequencies narrow the band nowhere" in nothing.summary()
    np.testing.assert_array_equal(nothing.upper, plain().upper)


def test_beside_a_frequency_without_a_polygon_the_estimate_may_be_infinite():
    plain, tried = np.array([1.0, 1e3, 7.0]), np.array([np.finfo(float).max, np.nan, 0.7])
    found = placement._estimated(plain[:, None, None], tried[:, None, None], np.array([0.0, 1e-3, 1.0]))
    np.testing.assert_allclose(found.ravel()[1:], [np.inf, 0.7])


def test_frequencies_are_chosen_one_at_a_time_and_then_halfway_between():
    gain = np.array([1.0, 5.0, 4.0, 0.0, 3.0, 2.0])  # no room for another one; two apart at least
    assert [placement._apart(gain, count).tolist() for count in (0, 1, 3)] == [[], [1], [1, 4]]
    omega, tried = halved(np.array([1.0, 2.0, 4.0]), np.array([0.5, np.nan, 0.25])[:, None, None])
    assert omega.tolist() == [1.0, 1.5, 2.0, 3.0, 4.0]
    np.testing.assert_equal(tried[:, 0, 0], [0.5, np.nan, np.nan, np.nan, 0.25])
