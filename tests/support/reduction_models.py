"""Shared by the tests: reduction models."""

import control
import numpy as np
import pytest
import scipy.linalg as sla

SLICOT = {"build": 48, "CDplayer": 120, "iss1R": 270, "beam": 348}
SMALL_MODELS = pytest.mark.parametrize(
    "benchmark_model",
    [pytest.param(k, marks=pytest.mark.slow) if k in ("beam", "iss1R") else k for k in SLICOT],
    indirect=True,
)


def response(a, b, c, d, points):
    """Judge of its own: one dense solve a point."""
    pencil = points[:, None, None] * np.eye(a.shape[0]) - a
    return d + c @ np.linalg.solve(pencil, np.broadcast_to(b, (points.size, *b.shape)))


def points_of(model, lines=40):
    """On the stability boundary: at the frequency of every pole and between them."""
    poles = model.poles()
    if model.dt == 0:
        speeds = np.abs(poles)
        between = np.geomspace(speeds.min() / 10, speeds.max() * 10, lines)
        return 1j * np.concatenate([[0.0], np.abs(poles.imag), between])
    return np.exp(1j * np.concatenate([np.abs(np.angle(poles)), np.linspace(0, np.pi, lines)]))


def gap(one, two, points):
    """Largest singular value of the difference, over the points."""
    values = [response(m.A, m.B, m.C, m.D, points) for m in (one, two)]
    return np.max(np.linalg.norm(values[0] - values[1], 2, axis=(1, 2)))


def peak(model, points):
    return np.max(np.linalg.norm(response(model.A, model.B, model.C, model.D, points), 2, axis=(1, 2)))


def random_model(rng, *, discrete, states=None):
    """Modes of damping 1e-4..0.5 and real poles, in random coordinates."""
    modes, reals = (int(rng.integers(1, 5)), int(rng.integers(0, 4))) if states is None else (states // 2, states % 2)
    blocks = []
    for _ in range(modes):
        omega, zeta = 10 ** rng.uniform(-1, 1), 10 ** rng.uniform(-4, -0.3)
        blocks.append(omega * np.array([[-zeta, np.sqrt(1 - zeta**2)], [-np.sqrt(1 - zeta**2), -zeta]]))
    blocks += [np.array([[-(10 ** rng.uniform(-1, 1))]]) for _ in range(reals)]
    a = sla.block_diag(*blocks)
    a = sla.expm(0.2 * a) if discrete else a
    n, ny, nu = a.shape[0], *rng.integers(1, 4, 2)
    q = np.linalg.qr(rng.standard_normal((n, n)))[0]
    b, c, d = rng.standard_normal((n, nu)), rng.standard_normal((ny, n)), rng.standard_normal((ny, nu))
    return control.StateSpace(q @ a @ q.T, q @ b, c @ q.T, d, 0.2 if discrete else 0)


def mode(zeta, omega):
    """Unit static gain; Hankel singular values (sqrt(1 + zeta^2) ± zeta) / (4 zeta), whatever omega."""
    model = control.ss([[0, 1], [-(omega**2), -2 * zeta * omega]], [[0], [omega**2]], [[1, 0]], 0)
    return model, np.sqrt(1 + zeta**2) / (4 * zeta) + np.array([0.25, -0.25])


def flexible(modes, channels, seed):
    """Lightly damped modes over three decades, damping 3e-4 to 1e-2, in random coordinates."""
    rng = np.random.default_rng(seed)
    omega, zeta = np.geomspace(1, 1e3, modes), 10 ** rng.uniform(-3.5, -2, modes)
    a = sla.block_diag(*(w * np.array([[-z, 1], [-1, -z]]) for w, z in zip(omega, zeta, strict=True)))
    b, c = rng.standard_normal((2 * modes, channels)), rng.standard_normal((channels, 2 * modes))
    q = np.linalg.qr(rng.standard_normal((2 * modes, 2 * modes)))[0]
    return control.StateSpace(q @ a @ q.T, q @ b, c @ q.T, 0, 0)
