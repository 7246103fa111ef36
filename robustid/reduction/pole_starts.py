"""Functions from which the models of one order are refined: poles, and with several signals on either side their directions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg

from robustid.core import Real, StateMatrices
from robustid.data import FrequencyResponse
from robustid.errors import InputError
from robustid.fitting import subspace_estimate
from robustid.identification import Identification
from robustid.reduction.balanced import Reduction, balanced_truncations
from robustid.reduction.sample_fits import Fit, Functions, Pair, Poles, moved, pole_columns, pole_functions, with_poles
from robustid.reduction.sample_map import SampleMap, Samples
from robustid.reduction.smallest_maximum import orthonormal_columns

if TYPE_CHECKING:
    import control

_SK_STEPS = 10
RICH = 24  # states of the truncated model that stands for the data of SK steps
_MOST_LINES = 1500  # points of a subspace estimate: beyond, every so many
_DAMPINGS = (0.003, 0.03, 0.3)
_ANGLES = 48

Family = Callable[[int], "Pair | None"]

_REAL = 1e-12  # imaginary part of a real pole, from rounding
_INSIDE = 1 - 1e-9  # a pole on the circle has no function that decays


def truncations(
    identification: Identification, samples: SampleMap, truncated: Callable[[int], Reduction]
) -> list[Family]:
    """Number of stable poles to the functions of truncated models: of the whole model; of one with the parametric part kept."""
    full, basis = identification.model, identification.problem.parametric
    chains = samples.integrators * samples.heads

    def of_whole(n: int) -> Pair | None:
        if n + chains > full.nstates:
            return None
        try:
            model = truncated(n + chains).model
        except InputError:  # fewer than the unstable states
            return None
        return _without_chains(of_model(model.A, model.B, model.C, samples), samples.integrators)

    families: list[Family] = [of_whole]
    if basis is not None and basis.states > samples.integrators:
        kept = _parametric_kept if samples.heads == 1 else _rank_one
        families.append(kept(identification, samples))
    return families


def of_model(A: Real, B: Real, C: Real, samples: SampleMap) -> Pair:
    """The functions of a model, seen from its heads."""
    return Pair(A.T, B.T) if samples.flipped else Pair(A, C)


def for_one(poles: Poles) -> Pair:
    """The functions of these poles for one head; unstable ones are reflected."""
    return pole_functions(reflected(poles))


def _without_chains(pair: Pair, integrators: int) -> Pair:
    """Without the invariant subspace of the poles nearest to z = 1, `integrators` for every head."""
    kept = without_integrators(pair.poles, integrators * pair.C.shape[0])
    if pair.C.shape[0] == 1:
        return for_one(kept)
    if not integrators:
        return pair
    near = np.abs(kept - 1).min(initial=np.inf) * (1 - 1e-9)

    def leads(real: float, imag: float = 0.0) -> bool:
        return abs(complex(real, imag) - 1) >= near

    schur, basis, size = scipy.linalg.schur(pair.A, sort=leads)
    return Pair(schur[:size, :size], pair.C @ basis[:, :size])


def _parametric_kept(identification: Identification, samples: SampleMap) -> Family:
    """Functions truncated in the variable of the unit disc, phi(zeta) in place of G: poles stay where those of the class lie."""
    import control

    full, region, basis = identification.model, identification.problem.region, identification.problem.parametric
    n = full.nstates - basis.states
    A, B, C = full.A[:n, :n], full.B[:n], full.C[:, :n]
    series = region.series(StateMatrices(A, B, C, full.D))
    short = balanced_truncations(control.StateSpace(*series, full.dt, remove_useless_states=False))
    kept = without_integrators(basis.poles, samples.integrators)

    def of_rest(count: int) -> Pair | None:
        left = count - kept.size
        if not 0 <= left <= n:
            return None
        return for_one(np.concatenate([kept, region.poles_in_z(short(left).model.poles())]))

    return of_rest


def _rank_one(identification: Identification, samples: SampleMap) -> Family:
    """The parametric modes, those with the largest Hankel singular values first, each with the best residue of rank one."""
    dt = identification.problem.dt
    found: list[tuple[float, Pair]] = []
    for mode in identification.modes:
        pole = np.exp((-mode.damping + 1j * np.sqrt(1 - mode.damping**2)) * mode.omega * dt)
        left, values, _ = np.linalg.svd(
            samples.weights[:, None] * (mode.residue.T if samples.flipped else mode.residue)
        )
        if abs(pole) >= 1:
            continue  # an integrator
        found.append((values[0] / (1 - abs(pole) ** 2), mode_pair(pole, left[:, 0] / samples.weights)))
    found.sort(key=lambda item: -item[0])
    pairs = [pair for size, pair in found if size > 0]

    def of_modes(n: int) -> Pair | None:
        counts = np.cumsum([0, *(pair.A.shape[0] for pair in pairs)])
        return joined(*pairs[: int(np.flatnonzero(counts == n)[0])]) if n and n in counts else None

    return of_modes


def mode_pair(pole: complex, direction: Samples) -> Pair:
    """The functions of a pole (and its conjugate) with one direction at the heads."""
    if abs(pole.imag) <= _REAL:
        return Pair(np.array([[pole.real]]), np.real(direction)[:, None])
    a = np.array([[pole.real, -pole.imag], [pole.imag, pole.real]])
    return Pair(a, np.stack([np.real(direction), -np.imag(direction)], axis=1))


def joined(*pairs: Pair) -> Pair:
    """All their functions."""
    return Pair(scipy.linalg.block_diag(*(pair.A for pair in pairs)), np.hstack([pair.C for pair in pairs]))


def without_integrators(poles: Poles, count: int) -> Poles:
    """The poles without the `count` nearest to z = 1."""
    return poles[np.argsort(np.abs(poles - 1))[count:]]


def truncated(samples: SampleMap, fit: Fit, count: int) -> Pair:
    """The functions of the balanced truncation of a fit's stable part."""
    import control

    model = control.StateSpace(fit.pair.A, fit.X, fit.pair.C, np.zeros((samples.heads, samples.tails)), 1.0)
    short = balanced_truncations(model)(count).model
    return for_one(short.poles()) if samples.heads == 1 else Pair(short.A, short.C)


def from_lines(identification: Identification, samples: SampleMap, count: int) -> Pair | None:
    """The functions of a subspace estimate from the frequency points; None where they are too few."""
    problem = identification.problem
    lines = [f for f in problem.frequency if isinstance(f, FrequencyResponse)]
    if not lines or not count:
        return None
    points = np.concatenate([np.exp(1j * f.omega * problem.dt) for f in lines])
    values, bound = (np.concatenate([getattr(f, n) for f in lines]) for n in ("values", "bound"))
    thin = slice(None, None, -(-points.size // _MOST_LINES))
    try:
        found = subspace_estimate(
            np.where(np.isfinite(bound), values, 0.0)[thin],
            points[thin],
            count,
            weight=1 / bound[thin],
            block_rows=None,
            feedthrough=True,
            domain="z",
        )
    except (InputError, np.linalg.LinAlgError):
        return None
    pair = of_model(found.A, found.B, found.C, samples)
    return for_one(pair.poles) if samples.heads == 1 else pair


def spread(samples: SampleMap, count: int) -> Poles:
    """Damped pairs over the band of the samples, and a real pole for an odd count."""
    low, high = samples.band
    angles = np.geomspace(low, high, count // 2 + 2)[1:-1]
    pairs = np.exp((-0.05 + 1j) * np.minimum(angles, 3.0))
    return np.concatenate([pairs, pairs.conj(), np.full(count % 2, np.exp(-low))])


def spread_functions(samples: SampleMap, count: int) -> Pair:
    """`spread` for every head, as equally as it goes: the observability indices of almost all models."""
    h = samples.heads
    parts = [pole_functions(spread(samples, count // h + (i < count % h))) for i in range(h)]
    if h == 1:
        return parts[0]
    units = np.diag(1 / samples.weights)
    return joined(*(Pair(part.A, units[:, i : i + 1] * part.C) for i, part in enumerate(parts)))


def sanathanan_koerner(samples: SampleMap, target: Fit, count: int) -> Pair:
    """The functions of |Sigma G - N| at its smallest, repeated with the new ones; G is a richer model at the samples."""
    pair, h = spread_functions(samples, count), samples.heads
    kept = samples.outputs * samples.inputs
    right = samples.real(samples.y - target.error - samples.fixed[:, kept:] @ target.fixed[kept:])
    for _ in range(_SK_STEPS if count else 0):
        linear = np.hstack([samples.columns(samples.states(pair.A, pair.C)), samples.fixed[:, :kept]])
        G = samples.real(np.hstack([linear, pole_columns(samples, pair, target.outputs)]))
        U, V = orthonormal_columns(G)
        d = (V @ (U.T @ right))[-count * h :].reshape(h, count).T
        pair = with_poles(moved(pair, d), reflected)
        pair = for_one(pair.poles) if h == 1 else pair
    return pair


def reflected(poles: Poles) -> Poles:
    """Unstable poles reflected at the circle, those on it drawn inside."""
    size = np.maximum(np.abs(poles), np.finfo(float).tiny)
    return poles * (np.minimum(np.where(size > 1, 1 / size, size), _INSIDE) / size)


def grown(samples: SampleMap, fit: Fit, count: int) -> Iterator[Pair]:
    """The functions of a fit with the further pair that helps least squares most, one of each damping; or with a real pole."""
    missing = count - fit.pair.A.shape[0]
    low, high = samples.band
    if missing == 2:
        angles = np.geomspace(low / 2, min(high, 3.1), _ANGLES)
        kinds = [np.exp((-z + 1j * np.sqrt(1 - z * z)) * angles) for z in _DAMPINGS]
    else:
        kinds = [np.exp(-np.geomspace(low / 10, 3.0, _ANGLES)).astype(complex)]
    U, _ = Functions(samples, fit.pair).basis
    rest = samples.real(samples.y)
    rest = rest - U @ (U.T @ rest)
    for candidates in kinds:
        best = max(candidates, key=lambda pole: float(np.linalg.norm(_removed(samples, U, rest, pole)[1])))
        if samples.heads == 1:
            yield pole_functions(np.concatenate([fit.poles, [best, best.conjugate()][:missing]]))
        else:
            yield joined(fit.pair, mode_pair(best, _direction(samples, U, rest, best)))


def _one_pole(pole: complex) -> Pair:
    """The functions of a pole and its conjugate, for one head."""
    return pole_functions(np.array([pole, pole.conjugate()] if pole.imag else [pole]))


def _removed(samples: SampleMap, U: Real, rest: Real, pole: complex) -> tuple[Real, Real]:
    """The V and g of which V g are the coefficients of a further pole of full rank, |g| the length that it removes."""
    one = _one_pole(pole)
    h = samples.heads
    A = np.asarray(np.kron(np.eye(h), one.A), dtype=float)
    C = np.asarray(np.kron(np.diag(1 / samples.weights), one.C), dtype=float) if h > 1 else one.C
    more = samples.real(samples.columns(samples.states(A, C)))
    Q, V = orthonormal_columns(more - U @ (U.T @ more))
    return V, Q.T @ rest


def _direction(samples: SampleMap, U: Real, rest: Real, pole: complex) -> Samples:
    """The direction at the heads of the best part of rank one of a further pole."""
    one, (V, gain) = _one_pole(pole), _removed(samples, U, rest, pole)
    h, m = samples.heads, one.A.shape[0]
    # Heads and tails of the coefficients; their residues at the pole are these times one complex number each.
    X = (V @ gain).reshape(samples.tails, h, m) / samples.weights[:, None]
    values, vectors = np.linalg.eig(one.A)
    k = int(np.argmin(np.abs(values - pole)))
    residues = np.einsum("jhm,m->hj", X, np.linalg.inv(vectors)[k])
    left = np.linalg.svd(samples.weights[:, None] * residues)[0][:, 0]
    return left / samples.weights


def integrals(samples: SampleMap, fit: Fit) -> Real:
    """Coefficients (count, ny, nu) of 1/(z - 1), 1/(z - 1)^2, ... in a fit."""
    count, entries = samples.integrators, samples.outputs * samples.inputs
    return fit.fixed[entries : entries * (1 + count)].reshape(count, samples.outputs, samples.inputs)


def statespace(samples: SampleMap, fit: Fit, like: control.StateSpace) -> control.StateSpace:
    """The model of a fit, poles at z = 1 exact, with the signals of another model."""
    import control

    h, count, entries = samples.heads, samples.integrators, samples.outputs * samples.inputs
    chain = np.eye(count) + np.eye(count, k=1)
    D = fit.fixed[:entries].reshape(samples.outputs, samples.inputs)
    gains = integrals(samples, fit)
    gains = gains.swapaxes(1, 2) if samples.flipped else gains
    A = scipy.linalg.block_diag(fit.pair.A, np.kron(chain, np.eye(h)))
    B = np.vstack([fit.X, gains.reshape(count * h, samples.tails)])
    C = np.hstack([fit.pair.C, np.kron(np.eye(1, count), np.eye(h))])
    labels = {"inputs": like.input_labels, "outputs": like.output_labels, "name": "reduced"}
    parts = (A.T, C.T, B.T) if samples.flipped else (A, B, C)
    return control.StateSpace(*parts, D, like.dt, remove_useless_states=False, **labels)
