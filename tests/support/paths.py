"""What the tests of the structured interior-point method share."""

import numpy as np


def triple(pair):
    """(N, 3) real vectors."""
    return np.stack([pair[0], pair[1].real, pair[1].imag], axis=1)


def arrow(pair):
    """(N, 3, 3): the matrix of the product from the left."""
    a, b = pair[0], np.stack([pair[1].real, pair[1].imag], axis=1)
    out = a[:, None, None] * np.eye(3)
    out[:, 0, 1:] = out[:, 1:, 0] = b
    return out


def times(matrices, pair):
    return np.einsum("kab,kb->ka", matrices, triple(pair))


def dense_scaling(s, z):
    """W by scaling s and z to determinant 1 and the geometric mean in the Jordan algebra: W = P(q)^(1/2), P(q) z = s.

    q = P(s^1/2) (P(s^1/2) z)^(-1/2), all by eigenvalues, and P(a) = 2 L(a)^2 - L(a^2): another way than the library's.
    """

    def power(v, exponent):
        norm = np.linalg.norm(v[1:])
        along = v[1:] / norm if norm else np.array([1.0, 0.0])
        high, low = (v[0] + norm) ** exponent, (v[0] - norm) ** exponent
        return np.concatenate([[(high + low) / 2], (high - low) / 2 * along])

    def left(v):
        out = v[0] * np.eye(3)
        out[0, 1:] = out[1:, 0] = v[1:]
        return out

    def quadratic(v):
        return 2 * left(v) @ left(v) - left(left(v) @ v)

    out = []
    for a, b in zip(triple(s), triple(z), strict=True):
        P = quadratic(power(a, 0.5))
        q = P @ power(P @ b, -0.5)
        out.append(quadratic(power(q, 0.5)))
    return np.array(out)
