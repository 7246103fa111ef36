"""The true error of a truncation: closed forms, brute force, and the a-priori bound held against it."""

import control
import mpmath
import numpy as np
import pytest
import scipy.linalg

from robustid.core import StateMatrices
from robustid.errors import InputTypeError
from robustid.reduction import ReductionStatus, balanced_truncation, hinf_error, hinf_norm
from support.cases import slow
from support.pairwise import every_one
from support.reduction_models import SMALL_MODELS, flexible, gap, mode, points_of, random_model, response
from support.refusals import refusals

NOTHING = control.StateSpace([], [], [], [[0.0]])


@pytest.mark.parametrize(("zeta", "omega"), every_one([0.5, 0.02, 1e-4, 1e-7], [1.0, 1e4]))
def test_peak_of_a_mode_has_its_closed_form(zeta, omega):
    model, _ = mode(zeta, omega)
    found = hinf_error(model, NOTHING)
    np.testing.assert_allclose(found.value, 1 / (2 * zeta * np.sqrt(1 - zeta**2)), rtol=1e-6)
    np.testing.assert_allclose(found.omega, omega * np.sqrt(1 - 2 * zeta**2), rtol=1e-5)


@pytest.mark.parametrize("seed", [17, 19])
def test_peak_of_many_lightly_damped_sampled_modes_is_right_to_1e_9(seed):
    """Poles within 1e-6 of the circle, against the sum over the modes in 40 digits."""
    rng = np.random.default_rng([seed, 99])
    n = int(rng.integers(2, 60))
    omega, damping = 10 ** rng.uniform(-1, 2, n), 10 ** rng.uniform(-4, -1, n)
    blocks = [scipy.linalg.expm(0.01 * w * np.array([[-z, 1], [-1, -z]])) for w, z in zip(omega, damping, strict=True)]
    A, B = scipy.linalg.block_diag(*blocks), rng.standard_normal((2 * n, 3))
    C = rng.standard_normal((2, 2 * n))
    found = hinf_norm(StateMatrices(A, B, C, np.zeros((2, 3))), 0.01)
    with mpmath.workdps(40):
        z, total = mpmath.expj(mpmath.mpf(found.omega) * 0.01), mpmath.zeros(2, 3)
        for k, block in enumerate(blocks):
            part = slice(2 * k, 2 * k + 2)
            resolvent = (z * mpmath.eye(2) - mpmath.matrix(block.tolist())) ** -1
            total += mpmath.matrix(C[:, part].tolist()) * resolvent * mpmath.matrix(B[part].tolist())
        exact = max(mpmath.svd_c(total, compute_uv=False))
        assert abs(found.value / exact - 1) < 1e-9


@pytest.mark.parametrize("step", [1e-3, 0.5])
def test_bilinear_image_has_the_same_peak(step):
    model, _ = mode(0.01, 3.0)
    found = hinf_error(control.sample_system(model, step, method="bilinear"), NOTHING)
    np.testing.assert_allclose(found.value, 1 / (0.02 * np.sqrt(1 - 1e-4)), rtol=1e-6)
    np.testing.assert_allclose(np.tan(found.omega * step / 2) * 2 / step, 3 * np.sqrt(1 - 2e-4), rtol=1e-5)


def test_flat_and_static_differences():
    allpass = control.ss([[-1.0]], [[1.0]], [[-2.0]], [[1.0]])
    assert hinf_error(allpass, NOTHING).value == pytest.approx(1, rel=2e-6)
    gain = control.StateSpace([], [], [], [[3.0, 0.0], [0.0, 4.0]])
    assert hinf_error(gain, 0 * gain).value == 4
    assert hinf_error(allpass, allpass).value < 1e-15
    # The supremum may lie at infinity only.
    rising = control.ss([[-1.0]], [[1.0]], [[-1.0]], [[1.0]])
    assert hinf_error(rising, NOTHING) == (1.0, np.inf)


@pytest.mark.parametrize("seeds", [10, slow(25)])
@pytest.mark.parametrize("discrete", [False, True])
def test_error_is_attained_and_nowhere_exceeded(discrete, seeds):
    for seed in range(seeds):
        model = random_model(np.random.default_rng(seed), discrete=discrete)
        reduced = balanced_truncation(model, order=model.nstates // 2).model
        found = hinf_error(model, reduced)
        assert gap(model, reduced, points_of(model, 2000)) <= found.value * (1 + 2e-6)
        if np.isfinite(found.omega):
            point = np.exp(0.2j * found.omega) if discrete else 1j * found.omega
            assert gap(model, reduced, np.array([point])) == pytest.approx(found.value, rel=1e-6)


def test_equal_unstable_parts_cancel_and_others_do_not():
    stable = random_model(np.random.default_rng(2), discrete=False)
    b, c = np.ones((2, stable.ninputs)), np.ones((stable.noutputs, 2))
    rigid = control.StateSpace([[0.0, 1], [0, 0]], b, c, 0 * stable.D)
    small = balanced_truncation(stable + rigid, order=stable.nstates, unstable="keep").model
    alone = balanced_truncation(stable, order=stable.nstates - 2).model
    assert hinf_error(stable + rigid, small).value == pytest.approx(hinf_error(stable, alone).value, rel=1e-5)
    assert hinf_error(stable + rigid, stable).value == np.inf


test_bad_input_is_named = refusals(
    ([[1.0]], "`reduced` must be a control.StateSpace or TransferFunction", InputTypeError),
    (control.ss([[0.5]], [[1.0]], [[1.0]], 0, 0.1), "time base"),
    (control.ss([[-1.0]], [[1.0, 1.0]], [[1.0]], 0), "1 input"),
    of=lambda other: hinf_error(mode(0.1, 1.0)[0], other),
)


def rounding(model, omega):
    """What an error of A by one rounding, eps ||A||, does to the response: eps ||A|| ||C R|| ||R B||, R the resolvent."""
    if not np.isfinite(omega):
        return 0.0
    left = 1j * omega * np.eye(model.nstates) - model.A
    before, after = np.linalg.solve(left.T, model.C.T.astype(complex)), np.linalg.solve(left, model.B.astype(complex))
    return np.finfo(float).eps * np.linalg.norm(model.A, 2) * np.linalg.norm(before, 2) * np.linalg.norm(after, 2)


def check_bound(model, orders, matches):
    """Bound at least the true error, up to the rounding of the two models; the truncation stable."""
    for match in matches:
        for order in orders:
            reduction = balanced_truncation(model, order=order, match=match)
            assert reduction.status in (ReductionStatus.REDUCED, ReductionStatus.FEWER)
            assert np.max(reduction.model.poles().real, initial=-np.inf) < 0
            found = hinf_error(model, reduction.model)
            # What makes up for the static gain is a constant: it takes the rounding at zero to all frequencies.
            points = [found.omega] if match is None else [found.omega, 0.0]
            floor = sum(rounding(one, omega) for one in (model, reduction.model) for omega in points)
            assert found.value <= reduction.bound + floor


@pytest.mark.realdata
@SMALL_MODELS
@pytest.mark.parametrize("every", [False, slow(True)])
def test_bound_holds_for_the_true_error_of_the_benchmark_models(benchmark_model, every):
    # On a grid, every order: test_balanced.py.
    large = benchmark_model.nstates > 200 and not every
    orders = range(benchmark_model.nstates) if every else [12] if large else [1, 20]
    check_bound(benchmark_model, orders, (None,) if large else (None, "static gain"))


@pytest.mark.parametrize(
    ("modes", "orders"), [(60, (1, 7, 40, 99, 119)), slow(500, (1, 2, 10, 50, 101, 200, 400, 700, 998, 999))]
)
def test_lightly_damped_model_with_four_channels(modes, orders):
    model = flexible(modes, 4, seed=0)
    points = points_of(model, 20)
    points = points[:: max(1, points.size // 100)]
    values = response(model.A, model.B, model.C, model.D, points)
    floor = 1e-9 * np.max(np.linalg.norm(values, 2, axis=(1, 2)))
    for order in orders:
        reduction = balanced_truncation(model, order=order)
        small = reduction.model
        assert reduction.order == order
        assert np.max(small.poles().real) < 0
        left = values - response(small.A, small.B, small.C, small.D, points)
        assert np.max(np.linalg.norm(left, 2, axis=(1, 2))) <= reduction.bound + floor
