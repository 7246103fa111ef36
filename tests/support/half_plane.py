"""Truths and independent judges of continuous classes: analytic in Re s > -decay, with a gain bound there."""

import control
import cvxpy as cp
import numpy as np


def pick(points, decay):
    """The Gram matrix 1/(s_i + conj(s_j) + 2 decay) of points on the imaginary axis."""
    return 1 / (points[:, None] + points.conj() + 2 * decay)


def smallest_gain(omega, values, decay):
    """The least K of an interpolant with real coefficients: Pick's theorem with the conjugate points."""
    points, wanted = 1j * np.concatenate([omega, -omega]), np.concatenate([values, values.conj()])
    gram = pick(points, decay)
    root = np.linalg.inv(np.linalg.cholesky(gram))
    return np.sqrt(np.linalg.eigvalsh(root @ (np.outer(wanted, wanted.conj()) * gram) @ root.conj().T)[-1])


def judged_margin(omega, values, bounds, gain, decay):
    """The margin by a general solver, from the Pick matrix of the points and their conjugates, in real coordinates.

    Values and bounds (F, p, p): K^2 gram - W gram W' >= 0, with W the values on the diagonal and gram that of every entry.
    """
    (count, size, _), none = values.shape, np.zeros(values.shape[1:])
    one = np.eye(count) / np.sqrt(2)
    turn = np.block([[one, one], [-1j * one, 1j * one]])
    gram = (turn @ pick(1j * np.concatenate([omega, -omega]), decay) @ turn.conj().T).real
    root = np.kron(np.linalg.cholesky(gram), np.eye(size))  # as it stands the condition costs the solver five digits
    parts = [[cp.Variable((size, size)) for _ in range(count)] for _ in range(2)]
    u, v = (cp.bmat([[part[i] if i == j else none for j in range(count)] for i in range(count)]) for part in parts)
    both, s = np.linalg.inv(root) @ cp.bmat([[u, -v], [v, u]]) @ root / gain, cp.Variable()
    block = cp.bmat([[np.eye(2 * count * size), both], [both.T, np.eye(2 * count * size)]])
    limits = [block >> 0]
    for k, i, j in np.ndindex(values.shape):
        away = cp.hstack([parts[0][k][i, j] - values[k, i, j].real, parts[1][k][i, j] - values[k, i, j].imag])
        limits.append(cp.norm(away) <= s * bounds[k, i, j])
    return cp.Problem(cp.Minimize(s), limits).solve(solver="CLARABEL")


def edge_truth(rng, gain, decay, order, size):
    """A real model with modulus `gain` on the whole line Re s = -decay: a Blaschke product of that half plane."""
    model = control.ss([], [], [], [[gain * rng.choice([-1.0, 1.0])]])
    for _ in range(order):
        a = size * rng.uniform(0.05, 1.5)  # zero at s = a - decay, pole at -a - decay
        if rng.random() < 0.5:
            model = model * control.ss(control.tf([1, decay - a], [1, decay + a]))
        else:
            b = size * rng.uniform(0.2, 2)
            down, up = (
                np.poly([-decay + a + 1j * b, -decay + a - 1j * b]).real,
                [1, 2 * (decay + a), (decay + a) ** 2 + b**2],
            )
            model = model * control.ss(control.tf(down, up))
    return model
