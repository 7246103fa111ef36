"""A bound is one thing: its kind, its set of errors, what is made from it, its words; and an array where one is expected."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.core import described, made
from robustid.errors import InputTypeError
from support.mimo_data import KINDS, complex_normal, response, same
from support.refusals import refusals, refused

pytestmark = pytest.mark.quick
BOUND = rid.Bound([0.1, 0.2, np.inf])


def test_it_stands_for_its_radius():
    radius = np.array([0.1, 0.2, np.inf])
    for one, two in (
        (np.asarray(BOUND), radius),
        (np.array(BOUND, dtype=complex), radius.astype(complex)),
        (2 * BOUND, 2 * radius),
        (radius - BOUND[0], radius - 0.1),
        (BOUND <= 0.1, radius <= 0.1),
        (np.isfinite(BOUND), np.isfinite(radius)),
        (np.where([True, False, True], BOUND, 1.0), [0.1, 1.0, np.inf]),
        (np.concatenate([BOUND, BOUND]), np.tile(radius, 2)),
        (list(BOUND), radius),
        (BOUND[[True, False, True]], [0.1, np.inf]),
    ):
        assert not isinstance(one, rid.Bound)
        np.testing.assert_array_equal(one, two)
    assert (BOUND.shape, BOUND.ndim, BOUND.size, len(BOUND), BOUND.min()) == ((3,), 1, 3, 3, 0.1)
    assert BOUND.T.tolist() == BOUND.tolist()
    with pytest.raises(AttributeError):
        BOUND.colour  # noqa: B018
    with pytest.raises(TypeError):
        BOUND[0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        BOUND.radius[0] = 1.0


def test_an_array_is_a_hard_bound_and_a_bound_keeps_its_kind():
    parts = {"kind": "confidence", "probability": 0.95, "dof": 9, "excitations": 3, "caveats": ("smeared", "unsteady")}
    kind = rid.Bound(0.1, **parts)
    assert rid.FrequencyResponse([1.0], [1.0], bound=0.1).bound.kind == "hard"
    frf = rid.FrequencyResponse([1.0, 2.0], [1.0, 2.0], bound=kind)
    record = rid.TimeRecord(np.ones(3), np.ones(3), dt=1.0, bound=kind)
    tangential = rid.TangentialResponse([1.0], [1.0], bound=kind)
    of_responses = (frf, frf.select([1]), frf.entry(), frf.tangential(), tangential)
    for data in (*of_responses, record, record.entry(), record.window(1.0)):
        assert {name: getattr(data.bound.inflated(2), name) for name in parts} == parts
        assert {name: getattr(data.bound, name) for name in parts} == parts
        assert np.all(np.isin(data.bound, [0.1, np.inf]))
        assert (data.with_bound(0.3).bound.kind, data.with_bound(0.3).bound.caveats) == ("hard", ())
        assert data.with_bound(kind).bound.kind == "confidence"


test_what_a_bound_refuses = refusals(
    ({"radius": 0.1, "kind": "sure"}, "`kind` of a bound must be one of"),
    ({"radius": 0.1, "probability": 0.9}, "`probability` belongs to a confidence or tolerance bound"),
    ({"radius": 0.1, "kind": "noise_floor", "dof": 3}, "`dof` belongs to a confidence"),
    ({"radius": 0.1, "kind": "confidence", "probability": 95}, "`probability` must be between 0 and 1; got 95"),
    ({"radius": 0.1, "kind": "confidence", "dof": 0}, "`dof` must be positive"),
    ({"radius": [0.1, np.nan]}, "must not contain NaN"),
    ({"radius": -0.1}, "`bound` must be positive"),
    ({}, "`radius` of a bound is missing"),
    ({"radius": 0.1, "excitations": 2}, "`excitations` belongs to an estimated bound"),
    ({"radius": 0.1, "kind": "confidence", "excitations": 0}, "`excitations` must be at least 1; got 0"),
    ({"radius": 0.1, "kind": "tolerance", "excitations": 1.5}, "`excitations` must be an integer", InputTypeError),
    ({"radius": 0.1, "tilt": ["a"]}, "`tilt` must be an array of numbers", InputTypeError),
    of=rid.Bound,
)


@pytest.mark.parametrize("parts", [{"tilt": [0.1]}, {"joint": "column"}])
def test_records_and_directions_have_plain_bounds(parts):
    refused("leave out `tilt`", rid.TimeRecord, [1.0], [1.0], dt=1.0, bound=rid.Bound(0.1, **parts))
    refused("leave out `tilt`", rid.TangentialResponse, [1.0], [1.0], bound=rid.Bound(0.1, **parts))


@pytest.mark.parametrize(("joint", "missing"), KINDS)
def test_inflated_bounds_divide_the_ratio(joint, missing):
    frf = response(2, joint, missing=missing)
    error = complex_normal(np.random.default_rng(2), *frf.values.shape)
    wide = frf.bound.inflated(4.0)
    np.testing.assert_array_equal(wide.ratio(error), frf.bound.ratio(error) / 4)
    assert wide.kind == frf.bound.kind
    assert np.all(frf.bound.tighter_than(wide) == frf.bound.used)
    assert not np.any(wide.tighter_than(frf.bound))
    reach = frf.bound.reach(np.ones((5, 1, 1, 3, 2)))
    np.testing.assert_allclose(wide.reach(np.ones((5, 1, 1, 3, 2))), 4 * reach, rtol=1e-14)


def test_parts_of_a_bound():
    frf = response(3)
    some = frf.values.real > 0
    only = frf.bound.only(some)
    assert np.array_equal(only.missing, ~some)
    assert np.array_equal(only.radius[some], frf.bound.radius[some])
    with pytest.raises(rid.InputError, match="needs every entry"):
        response(3, "matrix").bound.only(some)
    tilted = dataclasses.replace(frf.bound, tilt=np.full(frf.values.shape, 0.5))
    assert np.array_equal(tilted.turned(np.full((5, 1, 1), 1j)).tilt, -tilted.tilt)
    wide = tilted.widened(np.ones(frf.values.shape))
    assert np.array_equal(wide, frf.bound + 1)
    assert np.array_equal(wide.tilt, tilted.tilt)


def test_the_whitened_error_is_at_most_one_inside():
    bound = response(4, "matrix").bound
    for k in range(len(bound)):
        np.testing.assert_allclose(
            bound.whitening[k] @ bound.ellipsoid[k] @ bound.whitening[k].conj().T, np.eye(6), atol=1e-12
        )


def test_words():
    assert rid.Bound(0.1).words("data sheet") == "hard bound: data sheet"
    tolerance = rid.Bound(0.1, kind="tolerance", probability=0.9)
    assert tolerance.words() == "tolerance bound of the next record, 90 % jointly"
    assert tolerance.words("9 frequency points") == f"{tolerance.words()}: 9 frequency points"
    assert repr(BOUND) == "<Bound: hard bound, (3,), 0.1 to 0.2>"
    assert repr(response(1, "matrix").bound).startswith("<Bound: confidence bound, matrix, (5, 3, 2), ")
    assert "share one bound" in response(1, "column").bound.shape_words


@pytest.mark.parametrize(("joint", "missing"), KINDS)
def test_described_and_made_again_it_is_the_same(joint, missing):
    frf, arrays = response(1, joint, missing=missing), {}
    same(made(described(frf, "", arrays), arrays), frf)
