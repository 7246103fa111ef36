"""Shared by the tests: mimo data."""

import dataclasses

import control
import numpy as np

import robustid as rid

DT = 0.01


def complex_normal(rng, *shape):
    return rng.standard_normal(shape) + 1j * rng.standard_normal(shape)


def positive_definite(rng, lines, size):
    root = complex_normal(rng, lines, size, size) + np.eye(size)
    return root @ root.conj().swapaxes(1, 2)


def response(seed, joint="entry", lines=5, ny=3, nu=2, missing=False):
    """With a bound of that kind, covariance and names."""
    rng = np.random.default_rng([seed, lines, ny, nu])
    frf = rid.FrequencyResponse(
        np.sort(rng.uniform(0, np.pi / DT, lines)),
        complex_normal(rng, lines, ny, nu),
        covariance=positive_definite(rng, lines, ny * nu),
        dt=DT,
        inputs=[f"force {j} [N]" for j in range(nu)],
        outputs=[f"place {i} [m]" for i in range(ny)],
        note="known",
    )
    if joint == "matrix":
        return frf.with_ellipsoid(2.0)
    bound = rng.uniform(0.1, 1.0, frf.values.shape)
    values = frf.values.copy()
    if missing:
        gone = rng.uniform(size=bound.shape) < 0.3
        gone[0, 0, 0], gone[1, 0, 0] = True, False
        bound[gone], values[gone] = np.inf, np.nan
    return dataclasses.replace(frf, values=values, bound=rid.Bound(bound, joint=joint))


def real_poles(seed, ny, nu, poles=(0.5, 0.3, -0.4), dt=DT):
    """A plant of three real poles and a feed-through."""
    rng = np.random.default_rng(seed)
    B, C, D = rng.standard_normal((3, nu)), rng.standard_normal((ny, 3)), rng.standard_normal((ny, nu))
    return control.ss(np.diag(poles), B, C, D, dt)


def same(one, other):
    """Assert that two data are equal to the last bit, and of one class."""
    assert type(one) is type(other)
    for field in dataclasses.fields(one):
        a, b = getattr(one, field.name), getattr(other, field.name)
        if isinstance(a, rid.Bound):
            same(a, b)
        elif isinstance(a, np.ndarray):
            assert (a.shape, a.tobytes()) == (b.shape, b.tobytes()), field.name
        else:
            assert a == b, field.name


KINDS = [("entry", False), ("entry", True), ("column", False), ("column", True), ("matrix", False)]
