"""Frequency responses of several channels: entries that were not measured, bounds of columns and of whole matrices."""

import dataclasses
import itertools

import control
import numpy as np
import pytest
from scipy.special import chdtri

import robustid as rid
from robustid.errors import InputError
from robustid.report.fit_charts import response_charts
from robustid.report.fit_view import FitView
from support.bounds import rebound
from support.mimo_data import DT, KINDS, complex_normal, positive_definite, response, same
from support.pairwise import every_one
from support.refusals import refusals

# --- what a bound means -------------------------------------------------------------------------------------------------


def judge(frf, error, joint):
    """The definition, entry by entry, in plain loops."""
    lines, ny, nu = error.shape
    if joint == "matrix":
        out = np.empty((lines, 1, 1))
        for k in range(lines):
            e = np.array([error[k, i, j] for j in range(nu) for i in range(ny)])
            out[k] = np.sqrt((e.conj() @ np.linalg.inv(frf.bound.ellipsoid[k]) @ e).real)
        return out
    parts = np.zeros(error.shape)
    for k, i, j in np.ndindex(error.shape):
        if np.isfinite(frf.bound[k, i, j]):
            parts[k, i, j] = abs(error[k, i, j]) / frf.bound[k, i, j]
    return parts if joint == "entry" else np.sqrt((parts**2).sum(axis=1, keepdims=True))


@pytest.mark.parametrize(("joint", "missing"), KINDS)
def test_ratio_is_the_definition(joint, missing):
    for seed, (ny, nu) in enumerate([(1, 1), (3, 2), (2, 3), (1, 4), (4, 1)]):
        if missing and ny * nu == 1:
            continue
        frf = response(seed, joint, ny=ny, nu=nu, missing=missing)
        error = complex_normal(np.random.default_rng(seed), *frf.values.shape)
        expected = judge(frf, error, joint)
        assert frf.ratio(error).shape == expected.shape
        np.testing.assert_allclose(frf.ratio(error), expected, rtol=1e-9)
        error[frf.missing] = np.nan  # data minus model, where there are no data
        np.testing.assert_allclose(frf.ratio(error), expected, rtol=1e-9)


def test_ratio_of_ellipses():
    frf = rid.FrequencyResponse([1.0], [[[0.0, 0.0]]], bound=rid.Bound([[[0.1, np.inf]]], tilt=[[[0.5, 0.5j]]]))
    assert frf.ratio([[[0.1, 3.0]]]).ravel().tolist() == pytest.approx([1.5, 0.0])


@pytest.mark.parametrize("joint", ["column", "matrix"])
def test_the_bound_is_the_projection_on_each_entry(joint):
    """The largest |e| of an entry over random errors on the border: never above the bound, and attained."""
    frf = response(3, joint, ny=2, nu=2)
    E = frf.bound.ellipsoid if joint == "matrix" else None
    for i, j in itertools.product(range(2), repeat=2):
        alone = np.zeros(frf.values.shape, complex)
        if E is None:
            alone[:, i, j] = frf.bound[:, i, j]
        else:  # vec(e) = E column/sqrt(E_ii) is the error on the border where the entry is largest
            flat = 2 * j + i
            alone = (E[:, :, flat] / np.sqrt(E[:, flat, flat].real)[:, None]).reshape(-1, 2, 2).swapaxes(1, 2)
        np.testing.assert_allclose(np.abs(alone[:, i, j]), frf.bound[:, i, j], rtol=1e-12)
        np.testing.assert_allclose(frf.ratio(alone).max(axis=(1, 2)), 1.0, rtol=1e-9)
    rng = np.random.default_rng(0)
    for _ in range(200):
        error = complex_normal(rng, *frf.values.shape)
        error /= frf.ratio(error)
        assert np.all(np.abs(error) <= frf.bound * (1 + 1e-12))


def test_an_ellipsoid_holds_with_its_probability():
    """The formula of the docstring on 20000 draws of three entries: 0.9 within four standard deviations of the count."""
    rng, draws, probability = np.random.default_rng(1), 20_000, 0.9
    covariance = positive_definite(rng, 1, 3)
    noise = (np.linalg.cholesky(covariance[0]) @ complex_normal(rng, 3, draws)).T / np.sqrt(2)
    deviations = np.sqrt(chdtri(6, 1 - probability) / 2)
    frf = rid.FrequencyResponse(
        np.arange(1.0, draws + 1), np.zeros((draws, 3, 1)), covariance=np.repeat(covariance, draws, axis=0)
    ).with_ellipsoid(deviations)
    inside = np.mean(frf.ratio(noise[:, :, None]) <= 1)
    assert abs(inside - probability) < 4 * np.sqrt(probability * (1 - probability) / draws)


# --- laws ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("joint", "missing"), KINDS)
def test_permuted_channels(joint, missing):
    frf = response(4, joint, missing=missing)
    rows, columns = [2, 0, 1], [1, 0]
    flat = [3 * j + i for j in columns for i in rows]  # columns stacked
    E = None if frf.bound.ellipsoid is None else frf.bound.ellipsoid[:, flat][:, :, flat]
    bound = rid.Bound(frf.bound[:, rows][:, :, columns], joint=joint, ellipsoid=E)
    other = rid.FrequencyResponse(frf.omega, frf.values[:, rows][:, :, columns], bound=bound, dt=DT)
    assert np.array_equal(other.missing, frf.missing[:, rows][:, :, columns])
    error = complex_normal(np.random.default_rng(1), *frf.values.shape)
    expected = frf.ratio(error)
    expected = expected[:, rows] if joint == "entry" else expected
    expected = expected if joint == "matrix" else expected[:, :, columns]
    np.testing.assert_allclose(other.ratio(error[:, rows][:, :, columns]), expected, rtol=1e-9)


@pytest.mark.parametrize(("joint", "missing", "power"), every_one(KINDS, [-60, 60]))
def test_units_do_not_matter(joint, missing, power):
    frf = response(5, joint, missing=missing)
    rows = 2.0 ** np.array([power, 0, -power // 2])[:, None]  # another unit for every output
    flat = np.tile(rows.ravel(), 2)
    E = None if frf.bound.ellipsoid is None else frf.bound.ellipsoid * np.outer(flat, flat)
    bound = rid.Bound(rows * frf.bound, joint=joint, ellipsoid=E)
    other = dataclasses.replace(frf, values=rows * frf.values, bound=bound)
    error = complex_normal(np.random.default_rng(2), *frf.values.shape)
    assert np.array_equal(other.ratio(rows * error), frf.ratio(error))
    if E is not None:
        assert np.array_equal(rebound(other, radius=None).bound, rows * frf.bound)


@pytest.mark.parametrize(("joint", "missing"), KINDS)
def test_parts_keep_the_meaning(joint, missing):
    frf = response(7, joint, lines=6, missing=missing)
    error = complex_normal(np.random.default_rng(3), *frf.values.shape)
    picked = frf.select([4, 1])
    assert picked.bound.joint == joint
    np.testing.assert_array_equal(picked.ratio(error[[1, 4]]), frf.ratio(error)[[1, 4]])
    low, high = frf.freq_hz[[1, 3]]
    np.testing.assert_array_equal(frf.band(low, high).ratio(error[1:4]), frf.ratio(error)[1:4])
    turn = np.exp(1j * frf.omega * 0.003)[:, None, None]
    early = frf.without_delay(0.003)
    np.testing.assert_allclose(early.ratio(error * turn), frf.ratio(error), rtol=1e-12)
    one = frf.entry("place 2", 1)
    assert (one.bound.joint, one.bound.ellipsoid) == ("entry", None)
    np.testing.assert_array_equal(one.bound, frf.bound[:, 2:, 1:])
    np.testing.assert_array_equal(one.missing, frf.missing[:, 2:, 1:])


@pytest.mark.parametrize(("joint", "missing"), KINDS)
def test_a_new_bound_is_of_entries_and_leaves_gaps(joint, missing):
    frf = response(8, joint, missing=missing)
    for other in (frf.with_bound(0.5), frf.with_joint_bound(0.9)):
        assert (other.bound.joint, other.bound.ellipsoid) == ("entry", None)
        assert np.array_equal(other.missing, frf.missing)
    assert np.all(frf.with_bound(0.5).bound[~frf.missing] == 0.5)
    column = frf.with_column_bound(np.full((5, 2), 0.25))
    assert column.bound.joint == "column"
    assert np.array_equal(column.missing, frf.missing)
    assert frf.with_joint_bound(0.9).bound.probability == 0.9


def test_a_joint_bound_counts_the_entries_that_were_measured():
    frf = rid.FrequencyResponse([1.0, 2.0], np.ones((2, 2, 1)), covariance=np.tile(np.eye(2), (2, 1, 1)))
    half = dataclasses.replace(frf, bound=np.array([[[1.0], [np.inf]]] * 2)).with_joint_bound(0.95)
    assert half.bound[0, 0, 0] == pytest.approx(np.sqrt(-np.log(0.05 / 2)))
    assert frf.with_joint_bound(0.95).bound[0, 0, 0] == pytest.approx(np.sqrt(-np.log(0.05 / 4)))


def test_column_bounds_of_every_shape():
    frf = rid.FrequencyResponse([1.0, 2.0], np.ones((2, 3, 2)))
    assert np.all(frf.with_column_bound(0.1).bound == 0.1)
    assert frf.with_column_bound([0.1, 0.2]).bound[:, 2, 1].tolist() == [0.1, 0.2]
    each = frf.with_column_bound([[0.1, 0.2], [0.3, 0.4]])
    assert each.bound[1, 0].tolist() == [0.3, 0.4]
    tilted = frf.with_bound(rid.Bound(1.0, tilt=np.full(2, 0.5))).with_column_bound(0.1)
    assert tilted.bound.tilt is None


# --- refusals -----------------------------------------------------------------------------------------------------------

TWO = rid.FrequencyResponse([1.0], np.ones((1, 2, 1)))
GAPS = response(9, missing=True)
EVERY_ENTRY = r"every entry at every frequency point; \d+ of 30 are missing, the first at"


test_what_a_bound_of_a_response_refuses = refusals(
    ({"joint": "row"}, "`joint` must be one of"),
    ({"joint": "column"}, "`radius` of a bound is missing"),
    ({"tilt": [0.1]}, "`radius` of a bound is missing"),
    ({"joint": "matrix", "radius": 1.0}, "give both or none"),
    ({"ellipsoid": [np.eye(2)]}, "give both or none"),
    ({"joint": "column", "radius": 1.0, "tilt": [0.1]}, "`tilt` shapes the disc of one entry"),
    ({"joint": "matrix", "ellipsoid": [np.eye(3)]}, r"must have shape \(F, ny\*nu, ny\*nu\) = \(1, 2, 2\)"),
    ({"joint": "matrix", "ellipsoid": [np.diag([1, 0])]}, "positive numbers on its diagonal"),
    ({"joint": "matrix", "ellipsoid": [[[1, 1j], [1j, 4]]]}, "must be Hermitian"),
    ({"joint": "matrix", "ellipsoid": [np.ones((2, 2))]}, "must be positive definite"),
    ({"joint": "matrix", "ellipsoid": [np.eye(2)], "radius": 2.0}, "square root of the diagonal"),
    ({"joint": "matrix", "ellipsoid": [np.eye(2)], "radius": [[[1], [np.inf]]]}, "needs every entry of the matrix"),
    ({"radius": 1, "tilt": [0.1, 0.1]}, r"`tilt` must have shape \(F,\) = \(1,\) or \(1, 2, 1\); got \(2,\)"),
    ({"radius": 1, "tilt": 0.5}, "`tilt` must have shape"),
    ({"radius": 1, "tilt": [1j]}, "`tilt` must be smaller than 1 in modulus"),
    ({"radius": 1, "tilt": [np.nan]}, "`tilt` must be finite"),
    of=lambda **parts: dataclasses.replace(TWO, bound=rid.Bound(**parts)),
)

test_what_needs_more_says_so = refusals(
    (GAPS.to_control, EVERY_ENTRY),
    (lambda: GAPS.with_ellipsoid(2.0), EVERY_ENTRY),
    (lambda: rid.prepare.estimate_delay(GAPS), EVERY_ENTRY),
    (lambda: GAPS.with_bound(None), "`bound` is needed"),
    (lambda: TWO.with_ellipsoid(2.0), "`covariance` is needed"),
    (lambda: TWO.with_ellipses(np.eye(2)[None], 1.0), "one entry at a time"),
    (lambda: TWO.ratio(np.ones((1, 2, 1))), "`ratio` needs the bound"),
    (lambda: TWO.with_bound(1.0).ratio(1.0), r"`error` must have shape \(1, 2, 1\)"),
    (lambda: TWO.with_column_bound(np.ones(3)), "`radius` must be a scalar or have shape"),
    (lambda: TWO.with_column_bound(-1), "`radius` must be positive"),
    (lambda: TWO.with_bound([[[1], [np.inf]]]).entry(1, 0), "'y2'.* was measured at no frequency point"),
)


# --- those who read it --------------------------------------------------------------------------------------------------


def plant():
    a = np.array([[0.9, 0.3, 0.0], [-0.3, 0.9, 0.1], [0.0, 0.0, 0.5]])
    return control.ss(a, [[1.0, 0.0], [0.5, 1.0], [0.0, 2.0]], [[1.0, 0.0, 0.3], [0.0, 1.0, -1.0]], 0, DT)


def measured(rng, lines=60, noise=0.0, share=0.15):
    omega = np.linspace(1.0, 300.0, lines)
    values = np.moveaxis(plant()(np.exp(1j * omega * DT)), -1, 0)
    values = values + noise * complex_normal(rng, *values.shape)
    bound = np.where(rng.uniform(size=values.shape) < share, np.inf, 0.1)
    return rid.FrequencyResponse(omega, np.where(np.isinf(bound), np.nan, values), bound=bound, dt=DT)


@pytest.mark.parametrize("covariance", [False, True])
@pytest.mark.parametrize("form", ["right", "left"])
def test_a_fit_goes_through_what_was_measured(covariance, form):
    frf = measured(np.random.default_rng(0))
    if covariance:
        correlated = np.broadcast_to(0.5 * np.eye(4) + 0.5, (frf.omega.size, 4, 4))
        frf = dataclasses.replace(frf, covariance=correlated)
    fit = rid.fit_mfd(frf, order=3, form=form)
    validation = rid.validate(fit.model, frf)
    assert validation.ratio < 1e-6
    assert fit.problem.equations == 2 * int(np.sum(~frf.missing))


def test_the_default_weight_is_that_of_the_measured_part():
    """With a covariance the criterion is e' C^-1 e of the measured entries, by the inverse of their block."""
    rng = np.random.default_rng(1)
    frf = measured(rng, lines=12)
    frf = dataclasses.replace(frf, covariance=positive_definite(rng, 12, 4))
    weight = rid.fit_mfd(frf, order=3).problem.weight
    error = complex_normal(rng, *frf.values.shape)
    found = np.linalg.norm(weight.apply(error), axis=1) ** 2
    for k in range(12):
        known = ~frf.missing[k].T.ravel()
        e, C = error[k].T.ravel()[known], frf.covariance[k][np.ix_(known, known)]
        assert found[k] == pytest.approx((e.conj() @ np.linalg.solve(C, e)).real, rel=1e-9, abs=1e-12)


def test_a_report_of_a_fit_draws_what_was_measured():
    frf = measured(np.random.default_rng(3))
    view = FitView(rid.fit_mfd(frf, order=3), frf)
    for (i, j), chart in zip(np.ndindex(2, 2), response_charts(view), strict=True):
        for panel in chart.panels:
            shown = {layer.name: layer for layer in panel.layers}
            assert "data without weight" not in shown
            assert len(shown["data"].x) == np.sum(~frf.missing[:, i, j])


def test_bounds_from_rest_are_of_entries():
    rng = np.random.default_rng(5)
    u = np.tile(rng.standard_normal(100), 4)
    y = np.stack([2 * u, -u], axis=1) + 0.01 * rng.standard_normal((400, 2))
    record = rid.TimeRecord(u, y, dt=DT, initial="periodic")
    quiet = rid.TimeRecord(np.zeros(400), 0.01 * rng.standard_normal((400, 2)), dt=DT)
    noise = rid.prepare.bounds_from_noise_floor(quiet)
    frf = rid.estimate_frf(record, period=100)
    expected = noise.bound_response(frf, record, period=100)
    assert expected.bound.joint == "entry"
    same(noise.bound_response(frf.with_column_bound(1.0), record, period=100), expected)


def test_a_weight_of_one_s_own():
    frf = measured(np.random.default_rng(2))
    fit = rid.fit_mfd(frf, order=3, weight=np.ones(frf.values.shape))
    assert rid.validate(fit.model, frf).ratio < 1e-6
    with pytest.raises(InputError, match="mixes the entries"):
        rid.fit_mfd(frf, order=3, weight=rid.fits.Weight(np.ones(frf.values.shape), output=np.eye(2)))


def test_modes_come_from_the_measured_lines():
    data = rid.datasets.flexible_structure(extra_hz=np.linspace(17.2, 18.1, 10)).frequency
    gone = np.zeros(data.values.shape, bool)
    gone[[1, 5]] = True
    values, bound = np.where(gone, np.nan, data.values), np.where(gone, np.inf, data.bound)
    gaps = dataclasses.replace(data, values=values, bound=bound)
    found, expected = rid.suggest_kautz(gaps), rid.suggest_kautz(data.select(~gone[:, 0, 0]))
    np.testing.assert_array_equal(found.omega, expected.omega)


@pytest.mark.parametrize("joint", ["entry", "column", "matrix"])
def test_validation_uses_the_bound_as_it_is_meant(joint):
    rng = np.random.default_rng(3)
    truth = measured(rng, lines=8, share=0.0)
    error = 0.05 * complex_normal(rng, *truth.values.shape)
    frf = dataclasses.replace(truth, values=truth.values + error, covariance=positive_definite(rng, 8, 4))
    frf = {"entry": frf, "column": frf.with_column_bound(0.1), "matrix": frf.with_ellipsoid(0.1)}[joint]
    validation, ratios = rid.validate(plant(), frf), judge(frf, error, joint)
    assert validation.ratio == pytest.approx(ratios.max())
    assert validation.worst == np.unravel_index(np.argmax(ratios), ratios.shape)
    assert validation.outside == np.sum(ratios > 1)
    assert 0 < validation.outside < ratios.size


def test_validation_says_what_was_not_measured():
    frf = measured(np.random.default_rng(4), lines=8)
    bound = frf.bound.copy()
    bound[:, 1, 0] = np.inf
    validation = rid.validate(plant(), dataclasses.replace(frf, bound=bound))
    assert np.isnan(validation.fit).tolist() == [[False, False], [True, False]]
    assert "u1 -> y2: not measured" in validation.summary()
    assert "nan" not in validation.summary()
