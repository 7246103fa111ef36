"""Truths and independent judges of passive classes: positive real and bounded real in Re s > -decay."""

import contextlib

import cvxpy as cp
import numpy as np
import pytest

import robustid as rid


def reactance(rng, ports, decay, terms, size=6.0, loss=0.0):
    """A function of s that is positive real in Re s > -decay, of terms c s/(s^2 + w^2) and c/s there; lossless without `loss`."""
    where, parts = size * rng.uniform(0.1, 1.6, terms), [_residue(rng, ports) for _ in range(terms)]
    first, skew = _residue(rng, ports), np.triu(rng.standard_normal((ports, ports)), 1)

    def at(s):
        t = np.asarray(s, complex)[:, None, None] + decay + loss
        total = first / t + (skew - skew.T)
        for w, c in zip(where, parts, strict=True):
            total = total + c * t / (t**2 + w**2)
        return total

    return at


def scattering(function, delay=0.0, decay=0.0):
    """(F - I)(F + I)^-1 exp(-delay (s + decay)): bounded real where F is positive real, all-pass where it is lossless."""

    def at(s):
        F, one = function(s), np.eye(function(np.array([1.0])).shape[1])
        return (F - one) @ np.linalg.inv(F + one) * np.exp(-delay * (np.asarray(s) + decay))[:, None, None]

    return at


def passive_edge(seed, kind, ports):
    """A truth at the edge of its class, lossless or nearly so, and data with noise at the ends of their bounds."""
    rng = np.random.default_rng(seed)
    decay, omega = float(rng.uniform(0.5, 2)), np.sort(rng.uniform(0.2, 10, 7 if ports == 1 else 4))
    loss = float(rng.choice([0.0, 1e-3, 0.3]))
    truth, prior = reactance(rng, ports, decay, int(rng.integers(1, 4)), loss=loss), rid.PositiveReal(decay=decay)
    if kind == "bounded":
        truth, prior = scattering(truth, float(rng.choice([0.0, 0.2])), decay), rid.BoundedReal(decay=decay)
    if kind == "negative":
        velocity, prior = truth, rid.NegativeImaginary(decay=decay)

        def truth(s):
            return velocity(s) / np.asarray(s)[:, None, None]

    values = truth(1j * omega)
    bound = 0.02 * np.abs(values).max()
    noise = bound * np.exp(2j * np.pi * rng.random(values.shape))
    frf = rid.FrequencyResponse(omega, values + noise, bound=bound * (1 + 1e-3))
    return truth, rid.MixedProblem(frequency=frf, prior=prior)


def _residue(rng, ports):
    factor = rng.standard_normal((ports, 1 + (rng.random() < 0.3)))
    return factor @ factor.T


def smallest_factor(omega, values, bound, decay, *, slack=0.0, bounded=False, modes=None, ends=None):
    """The least s with |error| <= s bound, by Pick's matrix inequality through a general solver.

    With the conjugate points, in the real basis of the pairs, which makes diag(W, conj W) the real [Re W, -Im W; Im W, Re W].
    `modes` (F, m) are values of functions with coefficients that are positive semidefinite, or in the intervals `ends`
    (m, p, p, 2).
    """
    points = 1j * np.concatenate([omega, -omega])
    (count, ports), one = values.shape[:2], np.eye(omega.size)
    turn = np.vstack([np.hstack([one, one]), np.hstack([-1j * one, 1j * one])]) / np.sqrt(2)
    gram = (turn @ (1 / (points[:, None] + points.conj() + 2 * decay)) @ turn.conj().T).real
    factor = cp.Variable()
    parts = [[cp.Variable((ports, ports)) for _ in range(count)] for _ in range(2)]
    real, imag = (
        [part(value) + error for value, error in zip(values, errors, strict=True)]
        for part, errors in zip((np.real, np.imag), parts, strict=True)
    )
    count = 0 if modes is None else modes.shape[1]
    share = [cp.Variable((ports, ports), PSD=ends is None) for _ in range(count)]
    if modes is not None:
        real, imag = (
            [
                entry - sum(float(part(value)) * one for value, one in zip(row, share, strict=True))
                for entry, row in zip(entries, modes, strict=True)
            ]
            for part, entries in ((np.real, real), (np.imag, imag))
        )
    W = cp.bmat([[_diagonal(real), -_diagonal(imag)], [_diagonal(imag), _diagonal(real)]])
    gram = np.kron(gram, np.eye(ports))
    L = np.linalg.cholesky(gram)  # orthonormal coordinates: as it stands the Pick matrix costs digits
    root = np.linalg.inv(L)
    if bounded:
        X, unit = root @ W @ L, np.eye(len(L))
        M = cp.bmat([[unit, X], [X.T, unit]])
    else:
        M = root @ (W @ gram + gram @ W.T + 2 * slack * gram) @ root.T
    inside = [
        cp.norm(cp.vstack([cp.vec(e, order="C"), cp.vec(f, order="C")]), axis=0) <= factor * radius.ravel()
        for e, f, radius in zip(*parts, bound, strict=True)
    ]
    if ends is not None:
        inside += [low <= one for low, one in zip(ends[..., 0], share, strict=True)]
        inside += [one <= high for one, high in zip(share, ends[..., 1], strict=True)]
    problem = cp.Problem(cp.Minimize(factor), [(M + M.T) / 2 >> 0, *inside])
    for digits in (1e-9, 1e-8, 1e-7, 1e-6):  # not every problem gives as many
        with contextlib.suppress(cp.SolverError):
            problem.solve(solver="CLARABEL", tol_gap_abs=digits, tol_gap_rel=digits, tol_feas=digits)
            break
    if factor.value is None:
        pytest.skip("the general solver ends without a number")
    return float(factor.value)


def _diagonal(blocks):
    zero = np.zeros(blocks[0].shape)
    return cp.bmat([[one if i == k else zero for k in range(len(blocks))] for i, one in enumerate(blocks)])
