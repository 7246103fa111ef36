"""Structured covers against drawn errors: none is larger than its bound, and the bound is almost reached."""

import control
import numpy as np
import pytest

from robustid.core import responses
from robustid.guarantees import norm_of_bounds, robust_stability_margin, uncertainty_weight
from robustid.guarantees.covers import cover_bound
from support.cases import seeds
from support.refusals import refused

DT = 0.1
EDGES = np.linspace(0, np.pi / DT, 41)


def plant(scale=1.0):
    """Two by two, far from singular; its second output in other units."""
    A = np.array([[0.5, 0.2], [-0.2, 0.4]])
    C = np.array([[0.2, 0.1], [0.0, 0.3 * scale]])
    return control.ss(A, np.eye(2), C, np.diag([1.0, 0.8 * scale]), DT)


def entries(seed, scale=1.0):
    sizes = np.random.default_rng(seed).uniform(0.02, 0.15, (EDGES.size - 1, 2, 2))
    return sizes * np.array([[1.0], [scale]])


def drawn(seed, size, count):
    """Errors with entries at most so large, (count, cells, ny, nu): on the bound, any phase; some of rank one."""
    rng = np.random.default_rng(seed)
    phase = rng.uniform(0, 2 * np.pi, (count, *size.shape))
    phase[::2] = phase[::2, :, :1, :1] + phase[::2, :, 1:, :1] * [[0], [1]] + phase[::2, :, :1, 1:] * [[0, 1]]
    return size * np.exp(1j * phase)


def uncertainty(kind, F0, E):
    """What the kinds say, by their definitions."""
    inverse = np.linalg.inv(F0)
    return {
        "additive": E,
        "multiplicative": E @ inverse,
        "input_multiplicative": inverse @ E,
        "inverse": F0 @ np.linalg.inv(F0 + E) - np.eye(2),
    }[kind]


@pytest.mark.parametrize("kind", ["additive", "multiplicative", "input_multiplicative", "inverse"])
@pytest.mark.parametrize("seed", seeds(1, 3))
def test_no_error_has_a_larger_uncertainty(kind, seed):
    nominal, size = plant(), entries(seed)
    bound = cover_bound(nominal, EDGES, norm_of_bounds(size), size, kind)
    rng = np.random.default_rng(seed + 10)
    reached = np.zeros(bound.size)
    for _ in range(5):
        omega = EDGES[:-1] + np.diff(EDGES) * rng.uniform(0, 1, bound.size)
        F0 = responses(nominal, omega * DT)
        found = np.linalg.norm(uncertainty(kind, F0, drawn(seed, size, 40)), 2, axis=(2, 3)).max(axis=0)
        assert np.all(found <= bound)
        reached = np.maximum(reached, found)
    assert np.median(reached / bound) > 0.75


def test_of_one_input_and_one_output_it_is_the_ratio():
    nominal = plant()[0, 0]
    size = np.full(EDGES.size - 1, 0.1)
    for kind in ("multiplicative", "input_multiplicative"):
        bound = cover_bound(nominal, EDGES, size, size[:, None, None], kind)
        assert bound == pytest.approx(uncertainty_weight(nominal, EDGES, size, kind=kind).bound, rel=0.05)
    inverse = cover_bound(nominal, EDGES, size, size[:, None, None], "inverse")
    assert inverse == pytest.approx(bound / (1 - bound), rel=1e-6)


def test_entries_beat_the_smallest_singular_value_where_units_differ():
    """Of outputs in other units, the smallest singular value says nothing of the error at the inputs; the entries do."""
    wide, plain = (
        cover_bound(plant(s), EDGES, norm_of_bounds(entries(0, s)), entries(0, s), "input_multiplicative")
        for s in (2.0**-30, 1.0)
    )
    assert np.all(plain <= wide * (1 + 1e-9))  # where the units are alike, the better of the two bounds counts
    assert np.all(wide <= 1.1 * plain)


def test_what_nothing_bounds_is_refused():
    nominal, size = plant(), entries(0)
    zero, norm = control.ss([], [], [], np.ones((2, 2)), DT), norm_of_bounds(size)
    column = nominal[:, 0], EDGES, size[:, 0, 0], size[:, :, :1]
    refused("`kind` must be one of", cover_bound, nominal, EDGES, norm, size, "divisive")
    refused("as many inputs as outputs", cover_bound, *column, "multiplicative")
    refused("kind 'inverse' is unbounded", cover_bound, nominal, EDGES, 9 * norm, 9 * size, "inverse")
    refused("is not relative to anything", cover_bound, zero, EDGES, norm, size, "multiplicative")


@pytest.mark.parametrize("static", [True, False])
def test_the_margin_at_the_inputs_is_that_of_the_loop_opened_there(static):
    """The smallest 1/(b |T_u|) on a fine grid, T_u = K F (I + K F)^-1; and drawn plants at 99 % of it are stable."""
    nominal = plant()
    K = np.array([[0.3, -0.1], [0.2, 0.25]])
    controller = control.ss([], [], [], K) if static else control.ss(0.3, [[1.0, 0.0]], [[0.1], [0.0]], K, DT)
    bound = np.linspace(0.5, 0.2, EDGES.size - 1)
    found = robust_stability_margin(nominal, controller, EDGES, bound, kind="input_multiplicative")
    omega = np.linspace(0, np.pi / DT, 4001)[:-1]
    F0 = responses(nominal, omega * DT)
    Kw = responses(controller if not static else control.ss([], [], [], K, DT), omega * DT)
    T = Kw @ F0 @ np.linalg.inv(np.eye(2) + Kw @ F0)
    sizes = bound[np.searchsorted(EDGES, omega, side="right") - 1] * np.linalg.norm(T, 2, axis=(1, 2))
    assert found.margin == pytest.approx(1 / sizes.max(), rel=2e-3)
    assert found.margin <= 1 / sizes.max()
    rng = np.random.default_rng(1)
    for _ in range(20):
        delta = np.linalg.qr(rng.standard_normal((2, 2)))[0] * 0.99 * found.margin * bound.min()
        loop = nominal * control.ss([], [], [], np.eye(2) + delta, DT) * controller
        assert np.all(np.abs(np.linalg.eigvals(control.feedback(loop, np.eye(2)).A)) < 1)
