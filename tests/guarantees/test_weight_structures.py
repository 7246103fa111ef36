"""Weights of structured uncertainties, what they cover, and which of them costs the least."""

import itertools

import control
import numpy as np
import pytest

import robustid as rid
from robustid.guarantees import magnitude_weight, robust_stability_margin, structured_weight, structured_weights
from robustid.guarantees.cells import STRUCTURES, implied, log_volume, shape_of
from support.cases import slow
from support.pairwise import every_one
from support.weights import modulus, random_model, values_of

EDGES = np.linspace(0, np.pi, 13) / 0.1


@pytest.fixture
def rng():
    return np.random.default_rng(8)


def drawn_bounds(rng, size):
    """Bounds of all structures that one set of errors keeps, and the errors, (C, N, ny, nu)."""
    errors = rng.normal(size=(12, 50, *size)) + 1j * rng.normal(size=(12, 50, *size))
    errors = errors * np.exp(rng.normal(size=(12, 1, *size)))
    return {name: sizes_of(errors, shape_of(name, size)).max(axis=1) for name in STRUCTURES}, errors


def sizes_of(errors, shape):
    """Largest singular value of every block of matrices (..., ny, nu)."""
    parts = [[np.linalg.norm(block, 2, axis=(-2, -1)) for block in row] for row in blocks_of(errors, shape)]
    return np.moveaxis(np.array(parts), (0, 1), (-2, -1))


def blocks_of(matrices, shape):
    rows = np.split(matrices, shape[0], axis=-2)
    return [np.split(row, shape[1], axis=-1) for row in rows]


@pytest.mark.parametrize(("structure", "size"), every_one(STRUCTURES, [((2, 2),), ((2, 3),), ((1, 2),)]))
def test_bounds_that_follow_from_others_hold(rng, structure, size):
    bounds, errors = drawn_bounds(rng, size)
    own = sizes_of(errors, shape_of(structure, size))
    for count in (1, 2, 4):
        for names in itertools.combinations(STRUCTURES, count):
            found = implied(tuple(bounds[name] for name in names), structure, size)
            assert found.shape == bounds[structure].shape
            assert np.all(own <= found[:, None] * (1 + 1e-12))
            if structure in names:
                assert np.all(found <= bounds[structure])


@pytest.mark.parametrize("structure", ["output", "input", *(slow(s) for s in ("full", "entry"))])
def test_both_sides_give_every_error_within_the_bounds(rng, structure):
    nominal = random_model(rng, 2, 3)
    bounds, errors = drawn_bounds(rng, (2, 3))
    given = bounds["entry"]
    weight = structured_weight(nominal, EDGES, given, structure=structure)
    shape = shape_of(structure, (2, 3))
    assert weight.certified
    assert weight.bound.shape == (12, *shape)
    middles = (EDGES[1:] + EDGES[:-1]) / 2
    sizes = np.stack([modulus(one, middles) for one in weight.weights], axis=1).reshape(12, *shape)
    assert np.all(sizes >= weight.bound)
    # The Delta of every error: its blocks divided by their weights, none larger than 1.
    left, right = values_of(weight.left, middles), values_of(weight.right, middles)
    rows, columns = map(sum, zip(*weight.blocks, strict=True))
    models = [values_of(one.model, middles)[:, 0, 0] for one in weight.weights]
    for error in np.moveaxis(errors, 1, 0)[:10]:
        delta, row, column = np.zeros((12, rows, columns), dtype=complex), 0, 0
        for block, model in zip(itertools.chain(*blocks_of(error, shape)), models, strict=True):
            m, n = block.shape[1:]
            delta[:, row : row + m, column : column + n] = block / model[:, None, None]
            row, column = row + m, column + n
        assert np.linalg.norm(delta, 2, axis=(1, 2)).max() <= 1 + 1e-9
        np.testing.assert_allclose(left @ delta @ right, error, rtol=1e-9, atol=1e-9)
    # No weight is longer than one of its bound alone, and a side holds each as often as its block has signals there.
    alone = [magnitude_weight(EDGES, block, dt=0.1).order for block in weight.bound.reshape(12, -1).T]
    assert weight.order == sum(alone)
    assert weight.left.nstates + weight.right.nstates == weight.order * min(weight.blocks[0])


def test_for_synthesis_and_as_arrays(rng):
    nominal = random_model(rng, 2, 2)
    weight = structured_weight(nominal, EDGES, drawn_bounds(rng, (2, 2))[0]["entry"], structure="output", order=1)
    plant = weight.to_control()
    assert plant.blocks == ((1, 2), (1, 2))
    omega = np.linspace(0.1, 30, 20)
    for continuous, discrete in ((plant.nominal, nominal), (plant.left, weight.left), (plant.right, weight.right)):
        assert continuous.dt == 0
        there = np.stack([continuous(20j * np.tan(0.05 * w), squeeze=False) for w in omega])
        np.testing.assert_allclose(there, values_of(discrete, omega), rtol=1e-9, atol=1e-12)
    assert plant.controller(control.ss(-1.0, 1.0, 1.0, 0.0)).dt == 0.1
    found = weight.arrays()
    rebuilt = control.ss(*(found[f"left_{part}"] for part in "ABCD"), 0.1)
    np.testing.assert_array_equal(values_of(rebuilt, omega), values_of(weight.left, omega))
    assert found["bound"].shape == (12, 2, 1)
    assert found["blocks"].tolist() == [[1, 2], [1, 2]]
    assert repr(weight) == f"<StructuredWeight: output, 2 weights of order {weight.order} in all>"


@pytest.mark.parametrize("size", [(1, 1), (2, 2), slow((1, 3))])
def test_the_size_of_a_set_against_a_count_of_points(rng, size):
    """Of 50 000 matrices drawn from a cube around it, the part in the set, for every structure."""
    for structure in STRUCTURES:
        shape = shape_of(structure, size)
        bound = rng.uniform(0.8, 1.2, shape)
        side = 1.3
        points = rng.uniform(-side, side, (50_000, 2, *size))
        inside = np.all(sizes_of(points[:, 0] + 1j * points[:, 1], shape) <= bound, axis=(1, 2)).mean()
        volume = inside * (2 * side) ** (2 * size[0] * size[1])
        found = np.exp(2 * size[0] * size[1] * log_volume(bound[None], size)[0])
        assert found == pytest.approx(volume, rel=5 / np.sqrt(50_000 * inside))


def test_the_structure_that_costs_the_least(rng):
    """Errors of one input: the whole matrix costs most; of a full matrix that is known by its norm: the entries cost most."""
    nominal = random_model(rng, 2, 2)
    one_input = np.tile([[1.0, 0.02], [1.0, 0.02]], (12, 1, 1))
    order = [one.structure for one in structured_weights(nominal, EDGES, one_input)]
    assert order.index("entry") == 0
    assert order.index("input") == 1
    whole = structured_weights(nominal, EDGES, np.ones(12))
    assert whole[0].structure == "full"
    assert whole[0].radius < 0.8 * whole[-1].radius
    # A controller that hears the second output alone: what happens at the first one costs nothing.
    gain = control.ss([], [], [], 0.1 * np.array([[0.0, 1.0], [0.0, 0.2]]), 0.1)
    found = structured_weights(nominal, EDGES, one_input, controller=gain)
    margins = [one.margin.margin for one in found]
    assert max(margins) <= 1.01 * margins[0]
    for one in found:
        assert one.margin.margin == robust_stability_margin(nominal, gain, EDGES, one.bound).margin
        assert one.margin.margin <= robust_stability_margin(nominal, gain, EDGES, one_input).margin * 1.001
    # Entries and inputs cost the same here, by two weights less.
    near = [one for one in found if one.margin.margin > 0.995 * max(margins)]
    assert [one.order for one in near] == sorted(one.order for one in near)


def test_a_single_input_and_output_have_one_structure(rng):
    (found,) = structured_weights(random_model(rng, 1, 1), EDGES, np.ones(12))
    assert found.structure == "full"
    two = structured_weights(random_model(rng, 1, 2), EDGES, np.ones(12))
    assert [one.structure for one in two] == ["full", "entry"]


@pytest.mark.parametrize(
    ("bound", "options", "words"),
    [
        (np.ones((12, 2, 2)), {"structure": "diagonal"}, "`structure` must be one of .*got 'diagonal'"),
        (np.ones((12, 3, 2)), {"structure": "entry"}, r"`bound` must have shape \(12,\) or .*got \(12, 3, 2\)"),
        ((np.ones(12), np.full((12, 1, 1), 2.0)), {"structure": "full"}, "one bound of each structure; got full, full"),
        (np.ones(12), {"structure": "full", "tightness": 0.5}, "`tightness` must be above 1"),
        (np.full(12, np.nan), {"structure": "full"}, "`bound` must be finite"),
    ],
)
def test_bad_input_gets_a_sentence(rng, bound, options, words):
    with pytest.raises(rid.InputError, match=words):
        structured_weight(random_model(rng, 2, 2), EDGES, bound, **options)


def test_a_controller_that_does_not_fit_gets_a_sentence(rng):
    nominal = random_model(rng, 2, 2)
    for controller, words in (
        (control.ss([], [], [], np.ones((2, 3)), 0.1), "`controller` must have 2 inputs and 2 outputs"),
        (control.ss(0.5, np.ones((1, 2)), np.ones((2, 1)), 0, 0.2), r"sample time of `nominal`, 0\.1 s; got dt = 0\.2"),
    ):
        with pytest.raises(rid.InputError, match=words):
            structured_weights(nominal, EDGES, np.ones(12), controller=controller)
