"""Judges of structured uncertainties: perturbations of a structure that make a loop singular, found by search."""

import numpy as np


def project(direction, bound):
    """The Delta of a structure (p, q) with the largest Re tr(Delta* G): every block of rank one and of its full size."""
    ny, nu = direction.shape
    p, q = bound.shape
    delta = np.zeros_like(direction)
    for i in range(p):
        for j in range(q):
            block = np.ix_(*(range(n) if k == 1 else [at] for n, k, at in ((ny, p, i), (nu, q, j))))
            u, _, v = np.linalg.svd(direction[block], full_matrices=False)
            delta[block] = bound[i, j] * np.outer(u[:, 0], v[0])
    return delta


def destabilising(loop, bound, rng, tries=20, steps=60):
    """A Delta of the structure with a large real eigenvalue 1/t of -Delta M, and t: I + t Delta M is singular.

    A power iteration: the spectral radius of Delta M doesn't fall along the gradient of its eigenvalue.
    """
    ny = loop.shape[1]
    best = 0.0, None
    for _ in range(tries):
        delta = project(rng.normal(size=loop.T.shape) + 1j * rng.normal(size=loop.T.shape), bound)
        for _ in range(steps):
            values, vectors = np.linalg.eig(delta @ loop)
            k = int(np.argmax(np.abs(values)))
            if abs(values[k]) > best[0]:
                best = abs(values[k]), delta * -np.exp(-1j * np.angle(values[k]))
            right, left = vectors[:, k], np.linalg.pinv(vectors)[k].conj()
            # d lambda = left* dDelta M right/(left* right), turned so that lambda grows.
            turn = np.exp(1j * np.angle(values[k]))
            delta = project(turn * np.outer(left, np.conj(loop @ right)), bound)
    radius, delta = best
    assert np.linalg.cond(np.eye(ny) + delta @ loop / radius) > 1e8
    return delta, 1 / radius
