"""Matrices at the very edge of the class: gain exactly K everywhere on its circle, every error as large as its bound."""

import numpy as np

import robustid as rid

SHAPES = (2, 2), (2, 3), (3, 2)


def inner(rng, p, q, zeta):
    """U diag(b_k(zeta)) V with Blaschke factors b_k and orthonormal columns and rows: of norm 1 wherever |zeta| = 1, (F, p, q)."""
    rank = min(p, q)
    U, V = (np.linalg.qr(rng.standard_normal((size, rank)))[0] for size in (p, q))
    zeros = rng.uniform(-0.9, 0.9, (2, rank))
    factors = np.prod([(zeta[:, None] - a) / (1 - a * zeta[:, None]) for a in zeros], axis=0)
    return np.einsum("ik,fk,jk->fij", U, factors, V)


def edge_problem(seed, away=(0.0, 0.0), size=1.0):
    """(problem, truth at angles, residues): 2x2, 2x3 and 3x2, one mode of free residues, and an inner function times K.

    The true pole is up to the relative distances `away`, in frequency and damping, from the one of the problem, often all of it.
    """
    rng = np.random.default_rng(seed)
    (p, q), rho, gain, bound = SHAPES[seed % 3], rng.uniform(1.1, 1.4), rng.uniform(0.5, 2), 0.1
    mode = np.array([rng.uniform(0.5, 1.5), 0.03])
    residues, state = size * rng.standard_normal((2, p, q)), rng.bit_generator.state
    offset = np.clip(np.random.default_rng([seed, 1]).uniform(-2, 2, 2), -1, 1) * away
    true, middle = (rid.kautz(*one[:, None], dt=1.0, delay=1) for one in (mode * (1 + offset), mode))

    def truth(angles):
        again = np.random.default_rng()
        again.bit_generator.state = state
        rest = gain * inner(again, p, q, np.exp(-1j * angles) / rho)
        return rest + np.tensordot(true.response(angles), residues, 1)

    lines = np.sort(rng.uniform(0.1, 3.0, 8))
    values = truth(lines)
    values = values + bound * np.exp(2j * np.pi * rng.random(values.shape))
    frf = rid.FrequencyResponse(lines, values, bound=bound * (1 + 1e-9), dt=1.0)
    prior = rid.Prior(gain_bound=gain, decay_rate=rho)
    return rid.MixedProblem(frequency=frf, prior=prior, parametric=middle), truth, residues
