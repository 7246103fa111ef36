"""Guarantees of passive classes: truths at their edge are inside, at frequencies and between them."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.identification import verify_margin_exactly
from support.cases import slow
from support.pairwise import every_one
from support.passive import passive_edge


def inside(truth, found, error):
    away = np.moveaxis(truth(1j * error.omega), 0, 2) - found.model(1j * error.omega).reshape(*found.model.D.shape, -1)
    return np.all(np.abs(np.moveaxis(away, 2, 0)) <= error.upper * (1 + 1e-9))


CASES = [(seed, kind, ports) for seed in range(50) for kind in ("positive", "bounded", "negative") for ports in (1, 2)]
QUICK = [*((0, kind, 1) for kind in ("positive", "bounded", "negative")), (0, "bounded", 2)]


@pytest.mark.parametrize(("seed", "kind", "ports"), [c if c in QUICK else slow(*c) for c in CASES])
def test_truths_at_the_edge_are_inside(seed, kind, ports):
    truth, problem = passive_edge(seed, kind, ports)
    found = rid.identify(problem).require()
    grid = np.array([0.7, 20.0])
    error = rid.worst_case_error(found, omega=grid, directions=4, rtol=0.2)
    assert inside(truth, found, error)
    assert np.all(error.lower <= error.upper)
    assert error.verify()


@pytest.mark.parametrize(
    ("kind", "ports"), [("positive", 1), *(slow(*c) for c in (("positive", 2), ("negative", 1), ("negative", 2)))]
)
def test_the_bound_between_the_frequency_points(kind, ports, tmp_path):
    truth, problem = passive_edge(4, kind, ports)
    found = rid.identify(problem).require()
    error = rid.worst_case_error(found, omega=[1.0], directions=4, rtol=0.3)
    circle = error.on_circle(1.0, everywhere=True, time_limit=20)
    assert circle.edges[-1] == np.inf
    assert circle.bound[-1] == np.inf  # nothing bounds a positive-real function there
    assert error.circle_supported
    top = problem.frequency[0].omega.max()
    w = np.linspace(circle.edges[0], 0.999 * top, 700)
    away = np.moveaxis(truth(1j * w), 0, 2) - found.model(1j * w).reshape(*found.model.D.shape, -1)
    size = np.linalg.norm(np.moveaxis(away, 2, 0), 2, axis=(1, 2))
    cell = np.searchsorted(circle.edges, w, side="right") - 1
    assert np.all(size <= circle.bound[cell])
    if ports == 1:  # of matrices the time is over before
        assert np.median(circle.bound[cell]) < 10 * np.median(size)
    error.save(tmp_path / "bound.json")
    assert rid.load(tmp_path / "bound.json").verify()


@pytest.mark.parametrize(("kind", "ports"), every_one(["positive", "bounded", "negative"], [1, 2]))
def test_certificates_in_ball_arithmetic(kind, ports):
    pytest.importorskip("flint")
    _, problem = passive_edge(1, kind, ports)
    error = rid.worst_case_error(rid.identify(problem), omega=[0.7], directions=4, rtol=0.3)
    checked = [claim.verify(exact=True) for claim in error.claims()]
    assert len(checked) >= 4 * ports
    assert all(checked)


@pytest.mark.parametrize("kind", ["positive", "bounded", "negative"])
def test_a_refutation_in_ball_arithmetic(kind):
    """Values that no function of the class has: their margin above 1 is proved, and a larger one is not."""
    pytest.importorskip("flint")
    _, problem = passive_edge(2, kind, 1)
    (frf,) = problem.frequency
    wrong = dataclasses.replace(frf, values=-frf.values if kind != "bounded" else 1.5 * frf.values / np.abs(frf.values))
    found = rid.identify(dataclasses.replace(problem, frequency=wrong))
    assert found.margin_lower > 1
    data, proof = found.formulation.data, found.certificate
    assert verify_margin_exactly(proof, data.rows, data.sarason)
    object.__setattr__(proof, "value", proof.value * (1 + 1e-6))
    assert not verify_margin_exactly(proof, data.rows, data.sarason)
