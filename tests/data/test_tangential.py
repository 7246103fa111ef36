"""Responses in directions: what they hold, that unit vectors are full columns, which directions were left out, files."""

import copy
import dataclasses
import pickle

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import robustid as rid
from robustid import load
from robustid.data import save
from robustid.errors import InputError, InputTypeError
from support.mimo_data import KINDS, complex_normal, response, same
from support.refusals import refusals

pytestmark = pytest.mark.quick
DT = 0.01


def tangential(seed, lines=6, ny=3, nu=4, sensors=2, directions=3, missing=False):
    rng = np.random.default_rng(seed)
    values, bound = complex_normal(rng, lines, sensors, directions), rng.uniform(0.1, 1, (lines, sensors, directions))
    if missing:
        gone = rng.uniform(size=values.shape) < 0.3
        gone[0, 0, 0] = False
        values[gone], bound[gone] = np.nan, np.inf
    return rid.TangentialResponse(
        np.sort(rng.uniform(0, np.pi / DT, lines)),
        values,
        right=complex_normal(rng, lines, nu, directions),
        left=complex_normal(rng, lines, sensors, ny),
        bound=rid.Bound(bound, kind="confidence", probability=0.95),
        dt=DT,
        inputs=[f"motor {j} [A]" for j in range(nu)],
        note="from the data sheet",
    )


@pytest.mark.parametrize(("joint", "missing"), KINDS)
def test_unit_vectors_are_full_columns(joint, missing):
    for ny, nu in [(3, 2), (2, 3), (1, 4)]:
        frf = response(1, joint, ny=ny, nu=nu, missing=missing)
        for data in (frf.tangential(right=np.eye(nu)), frf.tangential(left=np.eye(ny)), frf.tangential()):
            np.testing.assert_array_equal(data.values, frf.values)
            np.testing.assert_allclose(data.bound, frf.bound, rtol=1e-15)
            assert np.array_equal(data.missing, frf.missing)
            assert (data.inputs, data.outputs, data.note, data.dt) == (frf.inputs, frf.outputs, frf.note, frf.dt)
        last = frf.tangential(right=np.eye(nu)[-1])
        np.testing.assert_array_equal(last.values, frf.values[:, :, -1:])
        np.testing.assert_allclose(last.bound, frf.bound[:, :, -1:], rtol=1e-15)
        if not missing:
            plain = rid.TangentialResponse(frf.omega, frf.values, bound=frf.bound.radius, dt=DT)
            np.testing.assert_array_equal(plain.right, np.broadcast_to(np.eye(nu), (5, nu, nu)))
            np.testing.assert_array_equal(plain.left, np.broadcast_to(np.eye(ny), (5, ny, ny)))


@pytest.mark.parametrize("joint", ["entry", "column", "matrix"])
def test_bounds_of_combinations_hold_and_are_attained(joint):
    """Errors on the border of what the response allows: never beyond the new bound; the worst error by hand attains it."""
    rng = np.random.default_rng(2)
    frf = response(2, joint)
    right, left = complex_normal(rng, 2, 3), complex_normal(rng, 4, 3)
    data = frf.tangential(right=right, left=left)
    for _ in range(100):
        error = complex_normal(rng, *frf.values.shape)
        error /= frf.ratio(error)
        assert np.all(data.ratio(left @ error @ right) <= 1 + 1e-12)
    w = np.einsum("a,b->ab", left[1], right[:, 2]).conj()
    if joint == "entry":
        worst = frf.bound * w / np.abs(w)
    elif joint == "column":
        worst = frf.bound**2 * w / np.linalg.norm(frf.bound * np.abs(w), axis=1, keepdims=True)
    else:
        worst = (frf.bound.ellipsoid @ w.T.ravel()).reshape(-1, 2, 3).swapaxes(1, 2)
        worst = worst / frf.ratio(worst)
    np.testing.assert_allclose(frf.ratio(worst), 1.0, rtol=1e-9)
    np.testing.assert_allclose(data.ratio(left @ worst @ right)[:, 1, 2], 1.0, rtol=1e-9)


def test_bounds_of_ellipses_are_those_of_the_discs_around_them():
    frf = rid.FrequencyResponse([1.0], [[[1.0, 1.0]]], bound=rid.Bound(0.1, tilt=[[[0.5, 0.0]]]))
    assert frf.tangential(right=[2.0, 1.0]).bound.item() == pytest.approx(2 * 0.2 + 0.1)
    assert frf.tangential(right=[2.0, 1.0], bound=0.3).bound.item() == 0.3
    assert frf.tangential(right=[2.0, 1.0], bound=0.3).bound.kind == "hard"


def test_a_combination_of_what_is_missing_is_missing():
    frf = rid.FrequencyResponse([1.0], [[[1.0, np.nan]]], bound=[[[0.1, np.inf]]])
    data = frf.tangential(right=[[1.0, 1.0], [0.0, 1.0]])
    assert data.missing.ravel().tolist() == [False, True]
    assert data.values.ravel()[0] == 1.0
    assert np.isnan(data.values.ravel()[1])
    assert frf.tangential(right=[[1.0, 1.0], [0.0, 1.0]], bound=0.2).missing.ravel().tolist() == [False, True]


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 4), st.integers(1, 4), st.integers(1, 3), st.integers(1, 3), st.booleans())
def test_weights_and_ratio_are_the_definition(seed, ny, nu, sensors, directions, missing):
    data = tangential(seed, 3, ny, nu, sensors, directions, missing)
    rng = np.random.default_rng(seed)
    F, error = complex_normal(rng, 3, ny, nu), complex_normal(rng, 3, sensors, directions)
    for k, i, j in np.ndindex(3, sensors, directions):
        value = data.left[k, i] @ F[k] @ data.right[k, :, j]
        assert np.sum(data.weights[k, i, j] * F[k]) == pytest.approx(value, rel=1e-12, abs=1e-12)
        expected = 0.0 if data.missing[k, i, j] else abs(error[k, i, j]) / data.bound[k, i, j]
        assert data.ratio(error)[k, i, j] == pytest.approx(expected, rel=1e-12)
    # Permuted channels of the plant, with their directions: the same data.
    inputs, outputs = rng.permutation(nu), rng.permutation(ny)
    other = dataclasses.replace(data, right=data.right[:, inputs], left=data.left[:, :, outputs])
    np.testing.assert_array_equal(other.weights, data.weights[:, :, :, outputs][..., inputs])
    # Other units: exactly the same ratio.
    for unit in (2.0**-60, 2.0**60):
        scaled = dataclasses.replace(data, values=unit * data.values, bound=unit * data.bound, left=unit * data.left)
        assert np.array_equal(scaled.ratio(unit * error), data.ratio(error))
        assert np.array_equal(scaled.weights, unit * data.weights)


def test_everything_is_sorted_together():
    data, order = tangential(3), [3, 1, 5, 0, 2, 4]
    arrays = {name: getattr(data, name)[order] for name in data.PER_POINT}
    same(dataclasses.replace(data, bound=data.bound.select(order), **arrays), data)


@pytest.mark.parametrize("missing", [False, True])
@pytest.mark.parametrize("ending", ["npz", "csv", "mat"])
def test_copies_pickles_and_files_keep_everything(missing, ending, tmp_path):
    for data in (tangential(4, missing=missing), rid.TangentialResponse([1.0], [2.0]), tangential(5, 1, 1, 3, 1, 1)):
        for again in (copy.deepcopy(data), pickle.loads(pickle.dumps(data))):
            same(again, data)
        save(tmp_path / f"data.{ending}", data)
        same(load(tmp_path / f"data.{ending}"), data)
    assert load(tmp_path / f"data.{ending}", bound=0.5).bound.item() == 0.5
    with pytest.raises(InputError, match="the file holds tangential data"):
        load(tmp_path / f"data.{ending}", kind="time")


def test_parts_and_new_bounds():
    data = tangential(6, missing=True)
    part = data.select([2, 4])
    for name in data.PER_POINT:
        np.testing.assert_array_equal(getattr(part, name), getattr(data, name)[[2, 4]])
    np.testing.assert_array_equal(data.band(*data.freq_hz[[1, 3]]).omega, data.omega[1:4])
    other = data.with_bound(0.5, "mine")
    assert np.array_equal(other.missing, data.missing)
    assert (other.note, other.bound.kind, other.bound.probability) == ("mine", "hard", None)
    assert np.all(other.bound[~other.missing] == 0.5)


# --- what was left out --------------------------------------------------------------------------------------------------


def test_directions_never_excited():
    """Known subspaces: the basis is orthonormal, of the right size, and orthogonal to every direction."""
    rng = np.random.default_rng(7)
    for nu, rank in [(2, 1), (4, 1), (4, 3), (5, 5), (6, 2)]:
        root = rng.standard_normal((nu, rank))
        directions = root @ rng.standard_normal((7, rank, 2))
        data = rid.TangentialResponse(np.arange(1.0, 8), np.zeros((7, 1, 2)), right=directions)
        free = data.unexcited()
        expected = nu - min(rank, 14)
        assert free.shape == (nu, expected)
        np.testing.assert_allclose(free.T @ free, np.eye(expected), atol=1e-12)
        assert np.abs(free.T @ root).max(initial=0.0) < 1e-12
        assert data.unseen().shape == (1, 0)
        seen = rid.TangentialResponse(np.arange(1.0, 8), np.zeros((7, 2, 1)), left=directions.swapaxes(1, 2))
        np.testing.assert_array_equal(seen.unseen(), free)


def test_complex_directions_move_both_parts():
    data = rid.TangentialResponse([1.0], [1.0], right=[1.0, 1j])
    assert data.unexcited().shape == (2, 0)


def test_what_is_not_used_excites_nothing():
    bound = np.array([[[1.0, np.inf]], [[1.0, np.inf]]])
    data = rid.TangentialResponse([1.0, 2.0], np.ones((2, 1, 2)), right=np.eye(2), bound=bound)
    np.testing.assert_allclose(np.abs(data.unexcited()), [[0.0], [1.0]])


@pytest.mark.parametrize("power", [-60, 60])
def test_units_of_the_channels_do_not_hide_a_direction(power):
    unit = np.array([1.0, 2.0**power, 1.0])
    for directions, missing in (([[1, 0, 0], [0, 1, 0], [0, 0, 1]], 0), ([[1, 2, 0], [0, 1, 1]], 1)):
        data = rid.TangentialResponse(
            [1.0, 2.0, 3.0], np.ones((3, 1, len(directions))), right=(np.array(directions) * unit).T
        )
        free = data.unexcited()
        assert free.shape == (3, missing)
        if missing:
            rows = np.array(directions) * unit
            assert np.all(np.abs(rows @ free) <= 1e-14 * np.linalg.norm(rows, axis=1, keepdims=True))


# --- models -------------------------------------------------------------------------------------------------------------


def test_a_model_held_against_directions():
    rng = np.random.default_rng(8)
    model = control.ss(0.5 * np.eye(2), rng.standard_normal((2, 3)), rng.standard_normal((2, 2)), 0, DT)
    data = tangential(8, ny=2, nu=3, missing=True)
    F = np.moveaxis(model(np.exp(1j * data.omega * DT)), -1, 0)
    error = complex_normal(rng, *data.values.shape)
    data = dataclasses.replace(data, values=np.where(data.missing, np.nan, data.left @ F @ data.right + error))
    result = rid.validate(model, data)
    ratios = np.where(data.missing, 0, np.abs(error) / data.bound)
    assert result.ratio == pytest.approx(ratios.max())
    assert result.worst == np.unravel_index(np.argmax(ratios), ratios.shape)
    assert result.outside == np.sum(ratios > 1)
    assert "direction 3 -> sensor 2: fit" in result.summary()
    assert "nan" not in result.summary()
    with pytest.raises(InputError, match="must have the 2 outputs and 3 inputs of `data`"):
        rid.validate(control.ss(0.5, 1, 1, 0, DT), data)


# --- refusals -----------------------------------------------------------------------------------------------------------

test_what_is_refused = refusals(
    ({"right": np.ones((3, 1, 1))}, r"`right` must have shape \(nu,\), \(nu, r\) or \(F, nu, r\) with F = 2"),
    ({"left": np.ones((1, 1, 1, 1))}, r"`left` must have shape \(ny,\), \(l, ny\) or \(F, l, ny\) with F = 2"),
    ({"right": np.ones((3, 2))}, r"`right` must have the 1 columns that `values` \(2, 1, 1\) has; got 2"),
    ({"left": np.ones((2, 3))}, r"`left` must have the 1 rows that `values` \(2, 1, 1\) has; got 2"),
    ({"right": [0.0, 0.0]}, "`right` has a direction of length zero"),
    ({"left": [[[0, 1]], [[0, 0]]]}, r"`left` has a direction of length zero \(frequency point 1, number 0\)"),
    ({"right": [np.nan, 1.0]}, "`right` must be finite"),
    ({"right": "x"}, "`right` must be an array of numbers", InputTypeError),
    ({"right": np.ones((0, 1))}, "`right` must have shape"),
    ({"bound": np.inf}, "nothing was measured"),
    ({"bound": [1.0, 2.0, 3.0]}, "`bound` must be a scalar or have shape"),
    ({"values": [1.0, np.nan]}, "`values` must be finite"),
    ({"values": np.ones((2, 1))}, r"`values` must have shape \(F,\) or \(F, l, r\)"),
    ({"inputs": ["a", "b"]}, "`inputs` must name 1 signal"),
    ({"dt": 2.0}, "must not exceed pi/dt"),
    ({"note": 1}, "`note` must be text", InputTypeError),
    ({"bound": rid.Bound(1.0, joint="column")}, "a disc for every value"),
    of=lambda **options: rid.TangentialResponse(**({"omega": [1.0, 2.0], "values": [1.0, 2.0]} | options)),
)


def test_directions_have_the_inputs_of_the_response():
    with pytest.raises(InputError, match=r"`right` must have shape .* with the 1 inputs of the response"):
        rid.FrequencyResponse([1.0], [1.0]).tangential(right=[1.0, 2.0])
