"""Orthonormal rational functions on a frequency grid, with the pencil that multiplies them by s or z."""

from __future__ import annotations

import numpy as np


def band(points: np.ndarray, domain: str) -> np.ndarray:
    """The frequencies of the lines, rad/s or rad/sample, without zero and Nyquist."""
    frequency = np.abs(np.imag(points)) if domain == "s" else np.abs(np.angle(points))
    return frequency[(frequency > 0) & ((domain == "s") | (frequency < np.pi * (1 - 1e-9)))]


def pole_choices(points: np.ndarray, count: int, domain: str) -> list[np.ndarray]:
    """Ways of spreading `count` real poles over the band, falling (measured better than rising)."""
    lines = band(points, domain)
    low, high = np.min(lines), np.max(lines)
    log, lin = np.geomspace(high, low, count), np.linspace(high, low, count)
    choices = [log, np.sqrt(log * lin), lin, np.full(count, np.sqrt(low * high))]
    if domain == "s":
        return choices
    bilinear = [np.tan(choice / 2) for choice in choices]  # to the real pole whose Cayley map has the same frequency
    return [(1 - pole) / (1 + pole) for pole in bilinear]


def rational_krylov(
    points: np.ndarray, weight: np.ndarray, poles: np.ndarray, domain: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rational functions f (F, i), orthonormal under the weight, and S, T (i, i-1) with xi * f S = f T.

    Real inner product Re sum_k weight_k^2 conj(f_k) g_k; the first function is constant. Each new one starts as an
    all-pass times the last, (pole + s)/(pole - s) with pole > 0 or (z - pole)/(1 - pole z) with |pole| < 1: it has the
    modulus of the last one on every line, and its pole lies where the last one, like a Szegő polynomial, has no zero,
    so that no step can be lost. f(A) exists for stable A.
    """
    count = len(poles) + 1
    Q = np.zeros((len(points), count), dtype=complex)
    S, T = np.zeros((2, count, count - 1))
    Q[:, 0] = weight / np.linalg.norm(weight)
    for j, pole in enumerate(poles):
        numerator, denominator = (pole + points, pole - points) if domain == "s" else (points - pole, 1 - pole * points)
        v = numerator / denominator * Q[:, j]
        h = np.zeros(count)
        for _ in range(2):  # twice is enough
            step = (v.conj() @ Q[:, : j + 1]).real
            v -= Q[:, : j + 1] @ step
            h[: j + 1] += step
        h[j + 1] = np.linalg.norm(v)
        Q[:, j + 1] = v / h[j + 1]
        e = np.eye(count)[j]
        if domain == "s":  # (pole - s) f h = (pole + s) f e
            S[:, j], T[:, j] = h + e, pole * (h - e)
        else:  # (1 - pole z) f h = (z - pole) f e
            S[:, j], T[:, j] = e + pole * h, h + pole * e
    return Q / weight[:, None], S, T


def triangle(matrix: np.ndarray) -> np.ndarray:
    """R of the QR factorisation."""
    return np.asarray(np.linalg.qr(matrix, mode="r"))


def real_rows(matrix: np.ndarray) -> np.ndarray:
    """Real parts over imaginary parts: the real inner product of complex columns."""
    return np.concatenate([np.real(matrix), np.imag(matrix)])
