"""Inverses of measured responses: bounds against brute force, covariances against draws, refusals."""

import numpy as np
import pytest

import robustid as rid


def test_the_inverse_of_every_response_within_its_bound_is_within_that_of_the_inverse():
    rng, largest = np.random.default_rng(7), 0.0
    for size in (1, 2, 3):
        Z = rng.normal(size=(50, size, size)) + 1j * rng.normal(size=(50, size, size)) + 3 * np.eye(size)
        bound = 0.1 * rng.uniform(0.1, 1.0, Z.shape)
        found = rid.prepare.inverse_response(rid.FrequencyResponse(np.arange(1.0, 51.0), Z, bound=bound))
        np.testing.assert_allclose(found.values @ Z, np.broadcast_to(np.eye(size), Z.shape), atol=1e-12)
        for _ in range(300):
            E = bound * np.exp(2j * np.pi * rng.random(Z.shape))
            ratio = np.abs(np.linalg.inv(Z + E) - found.values) / np.asarray(found.bound)
            largest = max(largest, ratio.max())
    assert 0.8 < largest <= 1


def test_the_covariance_of_an_inverse_is_that_of_many_draws():
    rng = np.random.default_rng(8)
    Z, root = rng.normal(size=(2, 2)) + 2j * np.eye(2), 1e-3 * (rng.normal(size=(4, 4)) + 1j * rng.normal(size=(4, 4)))
    frf = rid.FrequencyResponse([1.0], Z[None], covariance=(root @ root.conj().T)[None], dof=9)
    found = rid.prepare.inverse_response(frf)
    draws = root @ (rng.normal(size=(4, 20000)) + 1j * rng.normal(size=(4, 20000))) / np.sqrt(2)
    errors = np.linalg.inv(Z + draws.T.reshape(-1, 2, 2).swapaxes(1, 2)) - found.values[0]
    vectors = errors.swapaxes(1, 2).reshape(-1, 4)
    np.testing.assert_allclose(
        vectors.T @ vectors.conj() / 20000, found.covariance[0], atol=0.05 * np.abs(found.covariance).max()
    )
    assert found.dof == 9


def test_names_and_kinds_of_an_inverse():
    bound = rid.Bound(0.1, kind="confidence", probability=0.95)
    frf = rid.FrequencyResponse([1.0, 2.0], [2.0, 3.0], bound=bound, inputs=["i [A]"], outputs=["v [V]"], note="sweep")
    found = rid.prepare.inverse_response(frf)
    assert [str(one.name) for one in (*found.inputs, *found.outputs)] == ["v", "i"]
    assert (found.bound.kind, found.bound.probability) == ("confidence", 0.95)
    assert "sweep" in found.note


@pytest.mark.parametrize(
    ("values_", "bound", "words"),
    [
        (np.ones((1, 2, 1)), None, "as many outputs as inputs"),
        (np.ones((1, 2, 2)), None, "singular at"),
        (np.eye(2)[None] + 0j, 0.6, "allow a singular response"),
    ],
)
def test_responses_without_an_inverse_are_refused(values_, bound, words):
    with pytest.raises(rid.InputError, match=words):
        rid.prepare.inverse_response(rid.FrequencyResponse([1.0], values_, bound=bound))
