"""Matrices in powers of an all-pass function: what is left out, margins against the exact form, and what follows from them."""

import numpy as np
import pytest

import robustid as rid
from robustid.identification.formulation import formulate_in
from robustid.identification.formulation.section_choice import shortest_sections
from support.cases import slow
from support.matrix_plants import random_matrix_problem, response
from support.problems import identified
from support.sections_of_lines import CIRCLE, coordinates

BASIS = rid.kautz([0.8], [0.1], dt=1.0, delay=1)
ACCURACY = 1e-3


def few_lines(seed, p, q, lines=8, **options):
    return random_matrix_problem(seed, p, q, lines, rho=1.15, bound=0.02, **options)


@pytest.mark.parametrize(("shape", "seeds"), [((2, 3), 1), *(slow(shape, 4) for shape in ((2, 2), (2, 3), (3, 1)))])
def test_the_remainder_of_plants_of_the_class_is_below_the_tail(shape, seeds):
    """In the largest singular value, at the samples and elsewhere; the coefficients are in the ball."""
    largest = 0.0
    for seed in range(seeds):
        problem, truth = few_lines(seed, *shape, factor=1.0)
        sections = shortest_sections(problem, 0.1)
        posed = formulate_in(problem, sections)
        values = response(truth, -np.angle(CIRCLE), 1 / problem.prior.decay_rate) / problem.prior.gain_bound
        x = np.array([[coordinates(values[:, i, j], sections) for j in range(shape[1])] for i in range(shape[0])])
        assert posed.sarason.norm(x.ravel()) <= 1 + 1e-9
        angles = np.concatenate([problem.frequency[0].omega, np.linspace(0, np.pi, 60)])
        rest = response(truth, angles) - np.einsum("fn,ijn->fij", posed.values(angles), x)
        size, tail = np.linalg.norm(rest, 2, axis=(1, 2)), posed.response_tail(angles)
        assert np.all(size <= tail * (1 + 1e-9))
        largest = max(largest, float((size / tail).max()))
    assert largest >= 0.1


@pytest.mark.parametrize(
    ("seed", "shape", "options"),
    [
        (0, (2, 1), {}),
        *(
            slow(seed, shape, options)
            for seed, (shape, options) in enumerate(
                [
                    ((2, 2), {}),
                    ((2, 2), {"factor": 0.4}),
                    ((2, 2), {"symmetric": True}),
                    ((2, 3), {"parametric": BASIS}),
                    ((3, 1), {"factor": 0.4, "parametric": BASIS}),
                ]
            )
        ),
    ],
)
def test_the_margin_is_that_of_the_exact_form(seed, shape, options):
    problem, truth = few_lines(seed, *shape, **options)
    exact, result = (identified(problem, form=form, accuracy=ACCURACY) for form in ("orthonormal", "sections"))
    assert result.formulation.repeated.repeats > 1
    assert "an entry of an all-pass section" in result.formulation.description
    assert max(exact.margin_lower, result.margin_lower) <= min(exact.margin, result.margin) + 1e-9
    assert result.margin - result.margin_lower <= ACCURACY * max(1, result.margin)
    assert exact.consistent == result.consistent
    if result.consistent and "factor" not in options:
        omega = problem.frequency[0].omega[[2]] + 0.01
        error = rid.worst_case_error(result, omega=omega, rtol=0.2)
        assert np.all(np.abs(response(truth, omega) - error.nominal) <= error.upper)
        assert error.certified
