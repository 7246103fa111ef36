"""Inverse zero-order hold: known continuous models come back, what has none is refused."""

import control
import numpy as np
import pytest
import scipy.linalg as sla

from robustid.errors import InputError, InputTypeError
from robustid.reduction import to_continuous
from support.reduction_models import response as response_of
from support.refusals import refusals


def response(model, omega):
    return response_of(model.A, model.B, model.C, model.D, 1j * omega)


def sampled(rng, *, dt=0.1):
    """A random continuous model with all modes below Nyquist, and its zero-order hold."""
    blocks = []
    for _ in range(rng.integers(1, 6)):
        omega, zeta = rng.uniform(0.01, 0.95) * np.pi / dt, 10 ** rng.uniform(-5, -0.3)
        blocks.append(omega * np.array([[-zeta, np.sqrt(1 - zeta**2)], [-np.sqrt(1 - zeta**2), -zeta]]))
    blocks += [np.array([[-(10 ** rng.uniform(-2, 1))]]) for _ in range(rng.integers(0, 3))]
    a = sla.block_diag(*blocks)
    n, ny, nu = a.shape[0], *rng.integers(1, 4, 2)
    q = np.linalg.qr(rng.standard_normal((n, n)))[0]
    b, c, d = rng.standard_normal((n, nu)), rng.standard_normal((ny, n)), rng.standard_normal((ny, nu))
    model = control.StateSpace(q @ a @ q.T, q @ b, c @ q.T, d, 0)
    return model, control.sample_system(model, dt, method="zoh")


@pytest.mark.parametrize("models", [15, pytest.param(150, marks=pytest.mark.slow)])
def test_random_models_come_back(models):
    # Damping down to 1e-5, modes up to 0.95 of Nyquist. The error is that of rounding A: at most
    # 21 eps / (distance of the nearest pole to the circle).
    omega = np.geomspace(0.01, 300, 200)
    for seed in range(models):
        model, discrete = sampled(np.random.default_rng(seed))
        result = to_continuous(discrete)
        assert result.model.dt == 0
        assert result.error < 100 * np.finfo(float).eps / np.min(1 - np.abs(discrete.poles()))
        values = response(model, omega)
        np.testing.assert_allclose(response(result.model, omega), values, atol=1e-8 * np.max(np.abs(values)))


def test_first_order_in_closed_form():
    result = to_continuous(control.ss([[np.exp(-0.2)]], [[1 - np.exp(-0.2)]], [[3.0]], 0.5, 0.1))
    np.testing.assert_allclose([result.model.A[0, 0], result.model.B[0, 0]], [-2, 2], rtol=1e-14)
    assert (result.model.C[0, 0], result.model.D[0, 0]) == (3.0, 0.5)


def test_rigid_body_in_any_coordinates():
    # Force to position: x'' = u/m. A double pole at z = 1, moved by rounding to a pair near it.
    dt, mass = 1e-3, 7.0
    a, b = np.array([[1, dt], [0, 1]]), np.array([[dt**2 / 2], [dt]]) / mass
    omega = np.geomspace(1, 1000, 50)
    for seed in range(50):
        t = np.random.default_rng(seed).standard_normal((2, 2))
        if np.linalg.cond(t) > 10:
            continue
        c = np.linalg.solve(t.T, [1.0, 0.0])[None]
        model = control.StateSpace(t @ a @ np.linalg.inv(t), t @ b, c, 0, dt)
        result = to_continuous(model)
        np.testing.assert_allclose(response(result.model, omega)[:, 0, 0], -1 / (mass * omega**2), rtol=1e-7)
    result = to_continuous(control.StateSpace(a, b, [[1.0, 0.0]], 0, dt))
    np.testing.assert_allclose(result.model.A, [[0, 1], [0, 0]], atol=1e-13)
    np.testing.assert_allclose(result.model.B, [[0], [1 / mass]], atol=1e-15)


def test_fast_modes_fold_below_nyquist():
    # 60 rad/s at dt = 0.1 is beyond pi/dt = 31.4: the logarithm finds its image, and the samples agree.
    fast = control.ss([[-0.5, 60.0], [-60.0, -0.5]], [[0.0], [1.0]], [[1.0, 0.0]], 0)
    result = to_continuous(control.sample_system(fast, 0.1))
    assert np.max(np.abs(result.model.poles().imag)) == pytest.approx(2 * np.pi / 0.1 - 60)
    assert result.error < 1e-12


def test_error_is_that_of_the_returned_numbers():
    # An independent zero-order hold of what was returned is as near as the result claims.
    for seed in range(40):
        _, discrete = sampled(np.random.default_rng(seed))
        result = to_continuous(discrete)
        back = control.sample_system(result.model, discrete.dt, method="zoh")
        points = np.exp(1j * np.concatenate([np.linspace(0, np.pi, 100), np.abs(np.angle(discrete.poles()))]))
        one, two = discrete(points, squeeze=False), back(points, squeeze=False)
        assert np.max(np.abs(one - two)) <= (10 * result.error + 1e-10) * np.max(np.abs(one))


def test_units_change_nothing():
    for seed in range(10):
        _, discrete = sampled(np.random.default_rng(seed))
        plain = to_continuous(discrete)
        for scale in (2.0**-60, 2.0**60):
            louder = control.StateSpace(discrete.A, discrete.B * scale, discrete.C, discrete.D * scale, discrete.dt)
            other = to_continuous(louder)
            np.testing.assert_array_equal(other.model.B, plain.model.B * scale)
            assert other.error == pytest.approx(plain.error, rel=1e-6)
            slower = control.StateSpace(discrete.A, discrete.B, discrete.C, discrete.D, discrete.dt * scale)
            other = to_continuous(slower)
            np.testing.assert_array_equal(other.model.A, plain.model.A / scale)
            np.testing.assert_array_equal(other.model.B, plain.model.B / scale)


def test_names_of_the_channels_survive():
    model = control.ss([[0.5]], [[1.0]], [[1.0]], 0, 0.1, inputs=["current"], outputs=["torsion"])
    result = to_continuous(model).model
    assert (result.input_labels, result.output_labels) == (["current"], ["torsion"])


def test_static_gain():
    result = to_continuous(control.StateSpace([], [], [], [[2.0]], 0.1))
    assert result.model.nstates == 0
    assert result.error == 0


@pytest.mark.parametrize("delay", [2, 3, 5, 12])
def test_delays_are_refused_in_any_coordinates(delay):
    # Rounding spreads the poles at zero over a circle of radius eps ** (1 / delay): no logarithm is right.
    for seed in range(10):
        rng = np.random.default_rng(seed)
        a = sla.block_diag(np.eye(delay, k=-1), 0.98 * np.array([[0.8, 0.6], [-0.6, 0.8]]))
        n = delay + 2
        q = np.linalg.qr(rng.standard_normal((n, n)))[0]
        b, c = q @ rng.standard_normal((n, 1)), rng.standard_normal((1, n)) @ q.T
        model = control.StateSpace(q @ a @ q.T, b, c, 0, 0.1)
        with pytest.raises(InputError, match="balanced_truncation"):
            to_continuous(model)


ROTATION = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))[0]
TURNED = ROTATION @ np.diag([0.9, -0.3, 0.5]) @ ROTATION.T


test_bad_input_is_named = refusals(
    (control.StateSpace([[-0.5]], [[1]], [[1]], 0, 0.1), "5 Hz.*negative real axis.*balanced_truncation"),
    (control.StateSpace([[0.0]], [[1]], [[1]], 0, 0.1), "z = 0.*balanced_truncation"),
    (control.StateSpace([[1e-17, 0], [0, 0.9]], [[1], [1]], [[1, 1]], 0, 0.1), "balanced_truncation"),
    (control.StateSpace([[0, 1], [0, 0]], [[0], [1]], [[1, 0]], 0, 0.1), "z = 0"),
    (control.StateSpace(TURNED, [[1], [1], [1]], [[1, 1, 1]], 0, 0.1), "negative real axis"),
    (control.StateSpace([[-0.5]], [[1]], [[1]], 0, 0), "must be discrete"),
    (control.StateSpace([[0.5]], [[1]], [[1]], 0, True), "sample time"),
    (control.StateSpace([[0.5]], [[1]], [[1]], 0, None), "dt = None"),
    (control.StateSpace([[0.5]], [[np.inf]], [[1]], 0, 0.1), "matrix B"),
    (control.tf([1], [1, 0.5], 0.1), "negative real axis"),
    ([[0.5]], "must be a control.StateSpace or TransferFunction", InputTypeError),
    of=to_continuous,
)
