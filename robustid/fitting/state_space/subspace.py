"""Frequency-domain subspace estimate: a state-space model straight from frequency-response samples, without a start."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import scipy.linalg

from robustid.core import Budget, Frozen, as_array, as_count, as_flag, freeze, one_thread, real_rows, response_at
from robustid.errors import InputError
from robustid.fitting.fraction.householder import triangle
from robustid.fitting.state_space.given_poles import Samples, band, fit_inputs, reflected

# |z| = 1 and Re(s) = 0 hold up to the rounding of exp(1j*omega*dt) and of the caller's own scaling.
_ON_CURVE = 1e-9
_MUCH = 1e9  # products that an estimate of so many block rows takes: then poles are spread in one way only


@dataclasses.dataclass(frozen=True, eq=False)
class SubspaceEstimate(Frozen):
    """State-space matrices of P(xi) = C (xi I - A)^{-1} B + D with the singular values that show the order."""

    A: np.ndarray  # in real Schur form; xi = s (A in rad/s) or xi = z
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    # (r,) of the noise-whitened data, falling: a gap after the n-th says that the data hold n states; where the
    # weight is the inverse standard deviation, noise alone gives values near 1, at most about 1 + sqrt(r/(2 F nu))
    singular_values: np.ndarray
    residual: float  # root mean square of weight * (values - P) over the entries with weight

    def __post_init__(self) -> None:
        self._set(**{name: freeze(getattr(self, name)) for name in ("A", "B", "C", "D", "singular_values")})

    def response(self, points: np.ndarray) -> np.ndarray:
        """P at complex `points` (F,), shape (F, ny, nu)."""
        return response_at((self.A, self.B, self.C, self.D), points)


@one_thread()
def subspace_estimate(
    frf_values: np.ndarray,
    points: np.ndarray,
    order: int,
    *,
    weight: np.ndarray | None = None,
    block_rows: int | None = None,
    feedthrough: bool = False,
    domain: str = "s",
    stable: bool = True,
    budget: Budget | None = None,
) -> SubspaceEstimate:
    """A state-space model of given order from samples on any grid, by one singular value decomposition.

    With X(xi) = (xi I - A)^{-1} B and any function f, f(xi) P(xi) = C f(A) X(xi) + (a combination of few known
    functions of xi). So the rows f_j(xi_k) P(xi_k), freed of the known functions by projection, have the range
    of the generalised observability matrix [C f_1(A); ...; C f_i(A)], and xi f = (combination of f) gives A.

    `points` are 1j*omega or exp(1j*omega*dt), on any grid, in any order. `weight`, (F,) or (F, ny, nu), multiplies the
    residual: best the inverse standard deviation of each entry, by default relative to the Frobenius norm at each point, so
    that modes far below the highest peak count as much. `block_rows` is the number i of functions f_j; by default
    ``max(6*order/ny, order)`` and half of it are tried. A comes in the variable xi itself, not from an inverse bilinear
    map, so that D = 0 costs nothing else. With `stable` unstable poles are reflected at the stability boundary, B and D
    fitted anew; without, only where that fits better.

    Assumes noise independent between entries and points with standard deviation ``1/weight``; the estimate is then
    consistent, but not efficient: a start for a maximum-likelihood fit.

    Source: `mckelvey1996`, Algorithm 2 (weighted, non-uniform grid), with z^j replaced by orthonormal rational functions
    whose poles are spread over the band. One repeated pole is the usual bilinear map; on 20 noisy SISO systems of order 20
    its largest error was 2.7e-2, against 7e-3. Four ways of spreading the poles are tried, a heuristic choice, and the
    smallest residual wins.

    Examples
    --------
    >>> import numpy as np
    >>> s = 1j * np.geomspace(1.0, 100.0, 60)
    >>> estimate = subspace_estimate((1 / (s**2 + 0.2 * s + 25))[:, None, None], s, 2)
    >>> np.round(np.poly(estimate.A), 9)
    array([ 1. ,  0.2, 25. ])
    >>> estimate.residual < 1e-12
    True
    """
    data = _checked(frf_values, points, weight, domain)
    order = as_count("order", order, least=1)
    feedthrough, stable = as_flag("feedthrough", feedthrough), as_flag("stable", stable)
    # A power of two, so that a change of the unit of time by one changes nothing but exponents.
    scale = 2.0 ** round(math.log2(np.median(band(data.points, "s")))) if domain == "s" else 1.0
    data = data._replace(points=data.points / scale)
    best, leading = None, 0
    for rows in _block_row_sizes(data, order, block_rows):
        choices = pole_choices(data.points, rows - 1, domain)
        much = best is not None and data.values.size * data.values.shape[1] * rows**2 > _MUCH
        for number in [leading] if much else range(len(choices)):  # the one that was best with half as many rows
            if best is not None and budget is not None and budget.over:
                return best
            dynamics, outputs, singular_values = _dynamics(data, order, choices[number])
            T, Z = scipy.linalg.schur(dynamics, output="real")[:2]
            C, inside = outputs @ Z, reflected(T, data.points, domain)
            for A in [inside] if stable or np.array_equal(inside, T) else [inside, T]:
                B, D, residual = fit_inputs(data, A, C, feedthrough)
                if math.isfinite(residual) and (best is None or residual < best.residual):
                    best, leading = SubspaceEstimate(A * scale, B * scale, C, D, singular_values, residual), number
    if best is None:
        raise InputError("`points` coincide with poles of the estimate, where no response is finite; set `stable`")
    return best


def _dynamics(data: Samples, order: int, poles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, C and the singular values, by the weighted projection of `mckelvey1996`."""
    deviation, column = _noise(data.weight)
    used = np.any(column > 0, axis=1)
    values, deviation, column = data.values[used], deviation[used], column[used]
    ny, nu = values.shape[1:]
    f, S, T = rational_krylov(data.points[used], np.sqrt(np.mean(column**2, axis=1)), poles, data.domain)
    rows = f.shape[1]
    parts: list[np.ndarray] = []
    for j in range(nu):
        weighted = column[:, j, None] * f
        span = real_rows(weighted)  # what the input adds lies in the span of f
        Q = span if nu == 1 else np.linalg.qr(span)[0]  # of one input f is orthonormal in its weight
        part = real_rows((weighted[:, :, None] * values[:, None, :, j]).reshape(-1, rows * ny))
        parts.append(triangle(part - Q @ (Q.T @ part)))
    R = triangle(np.concatenate(parts)).reshape(-1, rows, ny)
    factors: list[np.ndarray] = []
    for o in range(ny):  # the noise has covariance L L' in the rows of output o: whiten, and colour back afterwards
        noise = real_rows(np.concatenate([(column[:, j] * deviation[:, o, j])[:, None] * f for j in range(nu)]))
        L = triangle(noise).T
        factors.append(L)
        R[:, :, o] = scipy.linalg.solve_triangular(L, R[:, :, o].T, lower=True).T
    _, singular_values, Vt = np.linalg.svd(R.reshape(-1, rows * ny), full_matrices=False)
    white = Vt[:order].T.reshape(rows, ny, order)
    observed = np.stack([L @ white[:, o] for o, L in enumerate(factors)], axis=1)
    # observed = [C f_j(A)]: the pencil xi f S = f T holds for A as well.
    left, right = (np.tensordot(M.T, observed, axes=1).reshape(-1, order) for M in (S, T))
    A = np.linalg.lstsq(left, right, rcond=None)[0]
    return A, observed[0] / f[0, 0].real, singular_values  # f_0 is constant


def _noise(weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Standard deviation of each entry, and a weight per point and input (0 where an entry of the column is unused): the
    inverse rms deviation of the column. An entry with a tiny deviation (in an antiresonance) must not lift its whole column,
    which an average of the weights would do (measured: twice the error).
    """
    with np.errstate(divide="ignore"):
        column = 1 / np.sqrt(np.mean((1 / weight) ** 2, axis=1))
    deviation = np.divide(1.0, weight, out=np.zeros_like(weight), where=weight > 0)
    return deviation, column


def _block_row_sizes(data: Samples, order: int, block_rows: int | None) -> list[int]:
    """Numbers of functions to try, within what the data allow."""
    ny, nu = data.values.shape[1:]
    points = data.points[np.any(_noise(data.weight)[1] > 0, axis=1)]
    lines = np.unique(np.real(points) + 1j * np.abs(np.imag(points))).size
    least = math.ceil(order / ny) + 1
    most = min(lines, 2 * lines * nu // (ny + nu))
    if not lines:
        raise InputError(
            "`weight` leaves no frequency point at which all outputs of an input count, and the estimate needs such points; mask"
            " fewer entries, or give fit_mfd a `start`"
        )
    if most < least:
        raise InputError(
            f"`order` = {order} is too large for {lines} different frequency points with weight of a {ny}x{nu} response;"
            f" at most {max(most - 1, 0) * ny}. Measure more points or lower `order`"
        )
    if block_rows is None:
        wanted = max(math.ceil(6 * order / ny), order, 10)
        return sorted({min(max(size, least), most) for size in (wanted, wanted // 2)})
    count = as_count("block_rows", block_rows)
    if not least <= count <= most:
        raise InputError(f"`block_rows` must be between {least} and {most} for these data and `order`; got {count}")
    return [count]


def _checked(values: np.ndarray, points: np.ndarray, weight: np.ndarray | None, domain: str) -> Samples:
    if domain not in ("s", "z"):
        raise InputError(f'`domain` must be "s" or "z"; got {domain!r}')
    points = as_array("points", points, dtype=complex, ndim=1)
    values = as_array("frf_values", values, dtype=complex, ndim=3)
    if values.shape[0] != points.size or 0 in values.shape:
        raise InputError(
            f"`frf_values` must have shape (F, ny, nu) with F = {points.size} from `points`; got {values.shape}"
        )
    off = np.abs(np.real(points)) / max(np.abs(points).max(), 1e-300) if domain == "s" else np.abs(np.abs(points) - 1)
    if np.max(off) > _ON_CURVE:
        where, curve = int(np.argmax(off)), "1j*omega" if domain == "s" else "exp(1j*omega*dt)"
        raise InputError(f"`points` must be {curve} for domain {domain!r}; got {points[where]:g} at index {where}")
    if band(points, domain).size == 0:
        raise InputError("`points` has no frequency between zero and the Nyquist frequency; give at least one")
    return Samples(values, points, _as_weight(weight, values), domain)


def _as_weight(weight: np.ndarray | None, values: np.ndarray) -> np.ndarray:
    """The weight in the shape of the values; relative by default."""
    if weight is None:
        size = np.linalg.norm(values, axis=(1, 2))
        if not np.any(size):
            raise InputError("`frf_values` are all zero; there is nothing to fit")
        # A point of zeros has no relative weight; the floor keeps it from being the only one that counts.
        weight = 1 / np.maximum(size, 1e-12 * size.max())
    array = as_array("weight", weight)
    if array.shape == values.shape[:1]:
        array = array[:, None, None]
    elif array.shape != values.shape:
        raise InputError(f"`weight` must have shape {values.shape[:1]} or {values.shape}; got {array.shape}")
    if np.any(array < 0) or not np.any(array):
        raise InputError(f"`weight` must be >= 0 and not all zero; got a smallest value of {array.min():g}")
    return np.array(np.broadcast_to(array, values.shape))


def pole_choices(points: np.ndarray, count: int, domain: str) -> list[np.ndarray]:
    """Ways of spreading `count` real poles over the band, falling (measured better than rising)."""
    lines = band(points, domain)
    low, high = float(np.min(lines)), float(np.max(lines))
    log, lin = np.geomspace(high, low, count), np.linspace(high, low, count)
    choices: list[np.ndarray] = [log, np.sqrt(log * lin), lin, np.full(count, np.sqrt(low * high))]
    if domain == "s":
        return choices
    bilinear = [np.tan(choice / 2) for choice in choices]  # to the real pole whose Cayley map has the same frequency
    return [(1 - pole) / (1 + pole) for pole in bilinear]


def rational_krylov(
    points: np.ndarray, weight: np.ndarray, poles: np.ndarray, domain: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rational functions f (F, i), orthonormal in ``Re sum_k weight_k^2 conj(f_k) g_k``, the first one constant, and S, T (i,
    i-1) with xi * f S = f T. Each new one starts as an all-pass times the last, (pole + s)/(pole - s) with pole > 0 or (z -
    pole)/(1 - pole z) with |pole| < 1. f(A) exists for stable A.
    """
    # The all-pass times the last has the modulus of the last one at every point, and its pole lies where the last one, like a
    # Szegő polynomial, has no zero, so that no step can be lost.
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
