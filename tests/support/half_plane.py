"""Truths and an independent judge of continuous classes: analytic in Re s > -decay, with a gain bound there."""

import control
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
