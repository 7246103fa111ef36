"""SK steps in other bases: the same fraction where rounding allows it, condition numbers confirmed in 60 digits."""

import dataclasses

import mpmath as mp
import numpy as np
import pytest

from robustid.fitting import FractionProblem, Weight, retract, sk_step
from support.example_runs import load
from support.mfd_systems import noisy, random_modal_system
from support.refusals import refused

bases = load("shared/polynomial_bases")
BASES, conditioning, sk_in_basis = bases.BASES, bases.conditioning, bases.sk_in_basis
OTHERS = BASES[:3]


def case(seed, outputs, inputs, order, *, lines=80, band_hz=(5.0, 50.0), dt=None, feedthrough=False, spare=0):
    """A problem on noisy data (order + spare sought where order is there) and the identity to start from."""
    frequency = 2 * np.pi * np.geomspace(band_hz[0] / 2, band_hz[1] * 1.2, lines)
    options = {"band_hz": band_hz, "damping": (0.02, 0.1), "dt": dt, "feedthrough": feedthrough}
    system = random_modal_system(seed, outputs, inputs, order // 2, **options)
    truth = system.response(1j * frequency if dt is None else np.exp(1j * frequency * dt))
    values = noisy(np.random.default_rng([seed, 2]), truth)
    problem = FractionProblem(frequency, values, order + spare, Weight.relative(values), dt=dt, feedthrough=feedthrough)
    return problem, truth, np.broadcast_to(np.eye(inputs), (lines, inputs, inputs))


def difference(one, other):
    """Largest relative difference of D and N, line by line."""
    both = [np.concatenate([part.denominators, part.numerators], axis=1) for part in (one, other)]
    return np.max(np.linalg.norm(both[0] - both[1], axis=(1, 2)) / np.linalg.norm(both[1], axis=(1, 2)))


@pytest.mark.parametrize("basis", OTHERS)
@pytest.mark.parametrize(
    "changes",
    [{}, {"dt": 0.004}, {"feedthrough": True}, {"spare": 1}],
    ids=["continuous", "discrete", "feedthrough", "unequal degrees"],
)
def test_every_basis_gives_the_same_fraction(basis, changes):
    """Order 4, 2x2, two steps: 3 seeds of 3 within 1e-9 of the orthonormal basis."""
    for seed in range(3):
        problem, _, start = case(seed, 2, 2, 4, **changes)
        one, other = sk_step(problem, start)[0], sk_in_basis(problem, start, basis)[0]
        assert difference(other, one) <= 1e-9
        one = sk_step(problem, one.denominators)[0]
        assert difference(sk_in_basis(problem, other.denominators, basis)[0], one) <= 1e-9


def exact_condition(problem, old, basis):
    """Of a single-channel problem, in 60 digits: eigenvalues of the sums that make up the normal matrix."""
    with mp.workdps(60):
        s = [mp.mpc(0, w) for w in problem.omega]
        if basis == "scaled":
            s = [x / max(problem.omega) for x in s]
        degree = int(problem.limits.max())
        functions = [[x**j for x in s] for j in range(degree + 1)]
        if basis == "scalar":
            functions = gram_schmidt(functions)
        left = [[w * p / d for w, p, d in data(problem, old)], [-w / d for w, _, d in data(problem, old)]]
        columns = [
            [m * f for m, f in zip(part, functions[j], strict=True)]
            for part, top in zip(left, problem.limits, strict=True)
            for j in range(top + 1)
        ]
        if basis != "monomial":
            columns = [[x / mp.sqrt(inner(column, column)) for x in column] for column in columns]
        values = mp.eigsy(mp.matrix([[inner(a, b) for b in columns] for a in columns]), eigvals_only=True)
        return float(max(values) / min(values))


def data(problem, old):
    for w, p, d in zip(problem.weight.entries.ravel(), problem.values.ravel(), old.ravel(), strict=True):
        yield mp.mpf(w), mp.mpc(p), mp.mpc(d)


def inner(a, b):
    return mp.fsum(mp.re(mp.conj(x) * y) for x, y in zip(a, b, strict=True))


def gram_schmidt(functions):
    out = []
    for f in functions:
        for q in out:
            c = inner(q, f)
            f = [x - c * y for x, y in zip(f, q, strict=True)]
        length = mp.sqrt(inner(f, f))
        out.append([x / length for x in f])
    return out


@pytest.mark.parametrize("seeds", [1, pytest.param(2, marks=pytest.mark.slow)])
@pytest.mark.parametrize(("basis", "least"), [("monomial", 1e30), ("scaled", 1e3), ("scalar", 1e3)])
def test_condition_against_60_digits(basis, least, seeds):
    """Single channel, order 8, first and second step, all seeds: within 1e-6."""
    for seed in range(seeds):
        problem, _, old = case(seed, 1, 1, 8, lines=40)
        for _ in range(2):
            fraction, condition = sk_in_basis(problem, old, basis)
            assert condition == pytest.approx(exact_condition(problem, old, basis), rel=1e-6)
            assert condition >= least
            old = fraction.denominators


def test_only_the_orthonormal_basis_keeps_condition_one():
    """2x2, order 16, 1000:1 band, near the solution: the others have 1e4 at least; 3 seeds of 3."""
    for seed in range(3):
        problem, truth, start = case(seed, 2, 2, 16, lines=200, band_hz=(1.0, 1000.0))
        start = retract(problem, truth, start, steps=4).denominators
        found = {basis: conditioning(problem, start, steps=3, basis=basis) for basis in BASES}
        assert np.all(found["orthonormal"] - 1 <= 1e-12)
        for basis in OTHERS:
            assert found[basis].shape == (3,)
            assert np.all(found[basis] >= 1e4)
        assert np.all(found["monomial"] >= 1e20 * found["scaled"])


def test_conditioning_follows_the_solutions_of_its_own_basis():
    problem, _, start = case(0, 2, 2, 4)
    first, one = sk_in_basis(problem, start, "scalar")
    _, two = sk_in_basis(problem, first.denominators, "scalar")
    assert np.array_equal(conditioning(problem, start, steps=2, basis="scalar"), [one, two])


def test_overflow_goes_on_as_nan():
    """Degree 100 at 1e5 rad/s is beyond the largest double; powers of s over its largest value are not."""
    problem, _, start = case(0, 1, 1, 4, lines=120, band_hz=(1e4, 2e4), spare=96)
    assert np.all(np.isnan(conditioning(problem, start, steps=3, basis="monomial")))
    fraction, condition = sk_in_basis(problem, start, "monomial")
    assert np.all(np.isnan(fraction.numerators))
    assert np.isnan(condition)
    assert np.isfinite(sk_in_basis(problem, start, "scaled")[1])


def test_singular_start_goes_on_as_nan():
    problem, _, start = case(0, 2, 2, 4)
    assert np.all(np.isnan(conditioning(problem, 0 * start, steps=2, basis="scaled")))


@pytest.mark.parametrize("basis", OTHERS)
def test_an_output_that_nobody_weighs_makes_the_matrix_singular(basis):
    problem, _, start = case(0, 2, 2, 4)
    problem = dataclasses.replace(problem, weight=problem.weight.scaled(np.broadcast_to([[[1], [0]]], (80, 2, 2))))
    fraction, condition = sk_in_basis(problem, start, basis)
    assert condition == np.inf
    assert np.all(np.isnan(fraction.denominators))


def test_bad_input():
    problem, _, start = case(0, 1, 1, 2)
    refused("basis", sk_in_basis, problem, start, "chebyshev")
    refused("steps", conditioning, problem, start, steps=0, basis="scaled")
