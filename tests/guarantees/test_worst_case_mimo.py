"""Worst-case errors of matrices: closed forms, drawn truths, laws, certificates, storage, refusals."""

import dataclasses

import control
import numpy as np
import pytest

import robustid as rid
from robustid.advice.sensitivity import guaranteed
from robustid.guarantees import norm_of_bounds
from robustid.guarantees.value_set import schur_bound
from support.bounds import rebound
from support.cases import slow
from support.matrix_plants import random_matrix_problem, response

SHAPES = [(2, 2), (1, 2), (2, 1), (2, 3)]


def bounded(problem, omega, **options):
    return rid.worst_case_error(rid.identify(problem), omega=omega, **{"directions": 4, "rtol": 0.3} | options)


def small_problem(p=2, q=2, rho=1.5, damping=0.05, **options):
    """Three lines and one mode: the problem, and the truth as a function of frequency with its residues."""
    modes = rid.kautz([0.8], [damping], dt=1.0, delay=1)
    problem, plant = random_matrix_problem(5, p, q, 3, rho=rho, bound=0.02, parametric=modes, **options)
    residues = 2 * np.random.default_rng(3).standard_normal((2, p, q))
    residues = residues + residues.swapaxes(1, 2) if problem.symmetric else residues

    def truth(omega):
        return response(plant, omega) + np.tensordot(modes.response(omega), residues, 1)

    frf = problem.frequency[0]
    values = frf.values + np.tensordot(modes.response(frf.omega), residues, 1)
    return dataclasses.replace(problem, frequency=dataclasses.replace(frf, values=values)), truth, residues


@pytest.fixture(scope="module")
def error():
    problem, *_ = small_problem()
    return bounded(problem, [0.0, 0.9])


# Known answers.


def test_without_data_the_largest_singular_value_is_at_most_the_gain_bound():
    """Of the model 0: K, attained, although every entry reaches K and the norm of their bounds is 2 K."""
    frf = rid.FrequencyResponse([0.0], np.zeros((1, 2, 2)), bound=100.0, dt=1.0)
    error = bounded(rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=2.0, decay_rate=1.2)), [1.2])
    error = error.with_model(control.ss([], [], [], np.zeros((2, 2)), 1.0))
    assert error.sigma_upper == pytest.approx([2.0], rel=1e-6)
    assert 0.95 * 2 < error.sigma_lower[0] <= 2
    assert norm_of_bounds(error.upper)[0] > 3.9


def test_norms_of_bounds_and_of_entrywise_products():
    rng = np.random.default_rng(0)
    for p, q in SHAPES:
        bounds = rng.uniform(0, 1, (50, p, q))
        E = bounds * rng.uniform(0, 1, bounds.shape) * np.exp(2j * np.pi * rng.uniform(0, 1, bounds.shape))
        assert np.all(np.linalg.norm(E, 2, axis=(1, 2)) <= norm_of_bounds(bounds))
        M = rng.standard_normal((50, p, q)) + 1j * rng.standard_normal((50, p, q))
        M /= np.linalg.norm(M, 2, axis=(1, 2))[:, None, None]
        assert np.linalg.norm(bounds[0] * M, 2, axis=(1, 2)).max() <= schur_bound(bounds[0])
        a, b = rng.uniform(0.1, 1, p), rng.uniform(0.1, 1, q)
        assert schur_bound(np.outer(a, b)) == pytest.approx(a.max() * b.max(), rel=1e-9)
    assert norm_of_bounds(np.array([[[1.0, np.inf], [0, 0]], [[3.0, 0], [0, 4.0]]])).tolist() == [
        np.inf,
        4 * (1 + 1e-12),
    ]


# Laws.


@pytest.mark.slow  # quick: plants at the edge, in test_edge_of_class
@pytest.mark.parametrize("seed", range(30))
def test_the_truth_is_inside_on_random_plants(seed):
    """30 plants of four shapes, symmetric ones among them, truth of the class and noise in the discs: no bound is exceeded."""
    p, q = SHAPES[seed % 4]
    problem, truth = random_matrix_problem(seed, p, q, 3, rho=1.3, symmetric=seed % 8 == 4)
    omega = np.append(problem.frequency[0].omega[1], [0.1, 2.7] if seed else [2.7])
    error = bounded(problem, omega)
    values = response(truth, error.omega)
    off = values - error.nominal
    assert np.all(np.abs(off) <= error.upper)
    assert np.all(np.linalg.norm(off, 2, axis=(1, 2)) <= error.sigma_upper)
    assert np.all(error.lower <= error.upper)
    assert np.all(error.sigma_lower <= error.sigma_upper)
    assert np.all(error.sigma_lower >= error.lower.max(axis=(1, 2)))
    for entry in np.ndindex(p, q):
        for k, found in enumerate(error.of_entry(*entry)):
            assert found.excludes(values[k][entry]) == 0
    low, high = np.moveaxis(error.magnitude, -1, 0)
    assert np.all((low <= np.abs(values)) & (np.abs(values) <= high))
    assert error.certified


def test_every_kind_of_data_bounds_the_errors():
    """A record with two inputs, bounds of columns, samples in a direction: the truth is inside, every claim is proved."""
    problem, truth = random_matrix_problem(6, 2, 2, 2, rho=1.4)
    rng, frf = np.random.default_rng(0), problem.frequency[0]
    u = rng.standard_normal((4, 2))
    y = control.forced_response(truth, np.arange(4.0), u.T).outputs.T + rng.uniform(-0.05, 0.05, (4, 2))
    columns = rebound(frf, radius=1.5 * frf.bound, joint="column")
    exact = rid.FrequencyResponse([2.9], response(truth, np.array([2.9])), bound=0.1, dt=1.0)
    lines = columns, exact.tangential(right=[1.0, -1.0], bound=0.05)
    integrator = control.ss(1.0, 1.0, 1.0, 0.0, 1.0)
    record = rid.TimeRecord(u, y, dt=1.0, bound=0.05)
    problem = dataclasses.replace(problem, frequency=lines, time=record, parametric=integrator)
    error = bounded(problem, [0.5], directions=3)
    assert np.all(np.abs(response(truth, error.omega) - error.nominal) <= error.upper)
    assert np.all((error.parameters.lower <= 0) & (error.parameters.upper >= 0))
    assert error.certified
    assert error.worst(1)[0][3][:2] in (("time", 0), ("frequency", 0), ("frequency", 1))


# Parameters, the circle, other nominals.


def test_intervals_of_all_residues_hold_the_truth(error):
    residues = small_problem()[2]
    found = error.parameters
    assert found.lower.shape == error.identification.parameters.shape == (2, 2, 2)
    assert np.all((found.lower <= residues) & (residues <= found.upper))
    assert np.all((found.lower <= found.attained[..., 0]) & (found.attained[..., 1] <= found.upper))
    # Found on the way from the centre to what the entry alone could do.
    assert np.all(found.attained[..., 1] - found.attained[..., 0] >= 0.9 * (found.upper - found.lower))
    for raised in (found.lower + 1e-4, np.where(np.arange(8).reshape(2, 2, 2) == 5, found.lower + 1e-4, found.lower)):
        assert not dataclasses.replace(error, parameters=dataclasses.replace(found, lower=raised)).certified


def test_intervals_of_symmetric_residues_are_symmetric_and_proved():
    problem, truth, residues = small_problem(symmetric=True)
    error = bounded(problem, [2.0], directions=3)
    assert [v.entry for v in error.values] == [(0, 0), (0, 1), (1, 1)]
    assert np.array_equal(error.parameters.upper, error.parameters.upper.swapaxes(1, 2))
    assert np.all((error.parameters.lower <= residues) & (residues <= error.parameters.upper))
    around = error.with_model(control.ss([], [], [], truth(np.array([2.0]))[0].real, 1.0))
    assert np.array_equal(around.upper, around.upper.swapaxes(1, 2))
    assert len(error.parameters.certificates) == 2 * 2 * 3
    assert error.certified
    lowered = np.array(error.parameters.upper)
    lowered[0, 1, 0] -= 1e-3 * abs(lowered[0, 1, 0])  # below the diagonal, where no certificate is stored
    assert not dataclasses.replace(error, parameters=dataclasses.replace(error.parameters, upper=lowered)).certified


@pytest.mark.parametrize(("p", "q", "rho", "damping"), [(2, 1, 4.0, 0.5), slow(2, 2, 1.5, 0.05)])
def test_the_bound_on_the_circle_holds_between_frequencies(p, q, rho, damping):
    problem, truth, _ = small_problem(p, q, rho, damping)
    error = bounded(problem, [0.0, 1.0, np.pi], directions=3)
    circle = error.on_circle(1.0)
    assert circle.converged
    assert circle.entries.shape == (circle.bound.size, p, q)
    assert error.hinf == circle.largest >= error.sigma_upper.max()
    assert circle.largest >= circle.lower >= error.sigma_lower.max()
    omega = np.linspace(circle.edges[:-1], circle.edges[1:], 20)
    cell = np.tile(np.arange(circle.bound.size), 20)
    off = truth(omega.ravel()) - response(error.model, omega.ravel())
    assert np.all(np.abs(off) <= circle.entries[cell])
    # The margin: at least that of either bound, of the norm and of the entries.
    gain = control.ss([], [], [], 0.05 * np.ones((q, p)) / error.hinf, error.model.dt)
    found = error.robust_stability_margin(gain)
    for bound in (circle.bound, circle.entries):
        alone = rid.guarantee.robust_stability_margin(error.model, gain, circle.edges, bound)
        assert found.margin >= 0.999 * alone.margin
        assert found.guaranteed or not alone.guaranteed
    assert np.all(np.linalg.norm(off, 2, axis=(1, 2)) <= circle.bound[cell])
    assert error.claim_count == len(list(error.claims()))
    assert error.certified
    for part in ("bound", "entries"):
        forged = dataclasses.replace(circle, **{part: 0.9 * getattr(circle, part)})
        assert not error.with_circle(forged).certified


@pytest.mark.slow
def test_the_weight_is_above_the_largest_singular_value():
    problem, truth, _ = small_problem(2, 1, 4.0, 0.5)
    error = bounded(problem, [0.0, 1.0, np.pi], directions=3)
    omega, model = np.linspace(0, np.pi, 500), error.weight().model
    off = truth(omega) - response(error.model, omega)
    assert np.all(np.linalg.norm(off, 2, axis=(1, 2)) <= np.abs([model(np.exp(1j * w)) for w in omega]))


def test_another_nominal_needs_no_solver_and_its_channels(error):
    nothing = control.ss([], [], [], np.zeros((2, 2)), 1.0)
    other = error.with_model(nothing)
    assert np.all(other.upper <= error.upper + np.abs(error.nominal) + 1e-12)
    assert np.all(other.upper >= np.abs(error.nominal) - error.upper)
    assert other.upper == pytest.approx(np.moveaxis(error.magnitude, -1, 0)[1])
    with pytest.raises(rid.InputError, match="2 inputs and 2 outputs; got 1 and 1"):
        error.with_model(control.ss([], [], [], 0.0, 1.0))


# Proofs and storage.


def test_what_is_stored_comes_back_and_forgeries_of_any_entry_fail(error, tmp_path):
    error.save(tmp_path / "bounds")
    again = rid.load(tmp_path / "bounds")
    for name in ("upper", "lower", "sigma_upper", "sigma_lower", "phase"):
        assert np.array_equal(getattr(again, name), getattr(error, name))
    assert again.certified
    assert again.summary() == error.summary()
    assert again.worst() == error.worst()
    for k, one in enumerate(error.values):
        size = np.abs(one.support).max()
        lowered = dataclasses.replace(one, support=one.support - 1e-3 * size)
        assert not dataclasses.replace(again, values=(*again.values[:k], lowered, *again.values[k + 1 :])).certified
    named = [dataclasses.replace(v, entry=(v.entry[1], v.entry[0])) for v in error.values]
    assert not dataclasses.replace(again, values=tuple(named)).certified


def test_files_with_the_entries_of_others_are_refused(error, tmp_path):
    error.save(tmp_path / "bounds")
    with np.load(tmp_path / "bounds.npz") as archive:
        arrays = dict(archive)
    assert len(arrays["values/entry"]) == 8
    from robustid.guarantees.packing import part, unpack_values

    stored, entries = part(arrays, "values/"), error.identification.problem.entries
    for name, changed in (
        ("entry", stored["entry"][::-1]),
        ("omega", stored["omega"] + np.arange(8) * 1e-3),
        ("points", stored["points"][:-4]),
    ):
        with pytest.raises(ValueError, match="polygons"):
            unpack_values(stored | {name: changed}, 1.0, entries)


def test_the_text_names_entries(error):
    _, output, input = np.unravel_index(np.argmax(error.upper), error.upper.shape)
    text = error.summary()
    assert "norm       largest singular value" in text
    assert f"entry      at most {error.upper.max():.4g} (u{input + 1} to y{output + 1})" in text
    names = [claim.name for claim in error.claims()]
    assert any(name.startswith("0.9 rad/s (u2 to y1), direction 3 of ") for name in names)
    assert len(set(names)) == len(names)


def test_the_diameter_covers_the_sets():
    problem, _ = random_matrix_problem(6, 2, 2, 2, rho=1.4)
    wide = rid.guarantee.diameter(problem, omega=[2.5], directions=8, rtol=0.05)
    error = bounded(problem, [2.5], directions=8)
    for entry in np.ndindex(2, 2):
        points = np.concatenate([one.matrices[:, *entry] for one in error.values])
        assert np.nanmax(np.abs(points[:, None] - points)) <= wide.upper[0][entry]
    assert np.all(wide.lower <= wide.upper)
    assert f"{wide.upper.max():.4g}" in wide.summary()
    assert wide.verify()


def test_half_widths_of_matrices_are_below_the_errors():
    problem, _ = random_matrix_problem(6, 2, 2, 2, rho=1.4)
    _, median, worst = guaranteed(problem, np.array([2.5]))
    error = bounded(problem, [2.5], directions=8, rtol=0.1)
    largest = float((error.sigma_upper / np.linalg.norm(error.nominal, 2, axis=(1, 2))).item())
    assert 0.5 * largest < median == worst <= largest


@pytest.mark.parametrize("joint", [slow("column"), "matrix"])
def test_a_bound_of_the_whole_matrix_bounds_the_largest_singular_value(joint):
    """At a frequency point sigma(F - N) <= sigma(y - N) + r, where the entries alone would give twice that for 2x2."""
    problem, truth = random_matrix_problem(3, 2, 2, 3, rho=1.05)
    frf = problem.frequency[0]
    radius = 2 * frf.bound.max()
    if joint == "matrix":
        wide = frf.with_bound(rid.Bound(joint="matrix", ellipsoid=np.tile(radius**2 * np.eye(4), (3, 1, 1))))
    else:
        wide = rebound(frf, radius=np.full(frf.values.shape, radius), joint="column")
    error = bounded(dataclasses.replace(problem, frequency=wide), frf.omega[:2], directions=3)
    off = np.linalg.norm(frf.values[:2] - error.nominal, 2, axis=(1, 2))
    reach = radius if joint == "matrix" else np.sqrt(2) * radius
    assert np.all(error.sigma_upper <= (off + reach) * (1 + 1e-5))
    assert np.all(norm_of_bounds(error.upper) > 1.1 * error.sigma_upper)
    assert np.all(np.linalg.norm(response(truth, error.omega) - error.nominal, 2, axis=(1, 2)) <= error.sigma_upper)
    assert np.all(error.sigma_lower <= error.sigma_upper)


@pytest.mark.parametrize("omega", [[1.6], slow(np.linspace(1.4, 1.8, 4))])
def test_entries_are_bounded_more_tightly_where_the_largest_singular_value_asks_for_it(omega, monkeypatch):
    """The gap of the largest singular value is smaller where it misses the one asked for by little, and nowhere wider."""
    from robustid.guarantees import polygons

    problem, *_ = small_problem()
    finer = bounded(problem, omega, directions=8, rtol=0.1)
    monkeypatch.setattr(polygons, "_WORTH", 0.0)
    before = bounded(problem, omega, directions=8, rtol=0.1)
    gaps = [1 - one.sigma_lower / one.sigma_upper for one in (finer, before)]
    assert np.all(gaps[0] <= gaps[1] + 1e-9)
    asked = (gaps[1] > 0.1) & (gaps[1] < 0.16)
    assert asked.any()
    assert np.all(gaps[0][asked] < 0.8 * gaps[1][asked])
    assert finer.certified
