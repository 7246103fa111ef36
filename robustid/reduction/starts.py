"""Poles from which the models of one order are refined."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import scipy.linalg

from robustid.errors import InputError
from robustid.identification import Identification
from robustid.mfd.subspace import subspace_estimate
from robustid.reduction.balanced import balanced_truncations
from robustid.reduction.minimax import orthonormal_columns
from robustid.reduction.refinement import Fit, moved, pole_columns, pole_functions
from robustid.reduction.sample_map import SampleMap

_SK_STEPS = 10
RICH = 24  # states of the truncated model that stands for the data of SK steps
_MOST_LINES = 1500  # of a subspace estimate: beyond, every so many lines
_DAMPINGS = (0.003, 0.03, 0.3)
_ANGLES = 48

Family = Callable[[int], "np.ndarray | None"]

_INSIDE = 1 - 1e-9  # a pole on the circle has no function that decays


def truncations(identification: Identification, integrators: int) -> list[Family]:
    """Number of stable poles to the poles of truncated models: the whole model; the parametric part kept, the rest truncated."""
    full, basis = identification.model, identification.problem.parametric
    whole = balanced_truncations(full)

    def of_whole(n: int) -> np.ndarray | None:
        if n + integrators > full.nstates:
            return None
        try:
            return without_integrators(whole(n + integrators).model.poles(), integrators)
        except InputError:  # fewer than the unstable states
            return None

    families: list[Family] = [of_whole]
    if basis is not None and basis.states > integrators:
        families.append(_parametric_kept(identification, integrators))
    return families


def _parametric_kept(identification: Identification, integrators: int) -> Family:
    """In the scaled variable, phi(zeta) in place of G(z) = K phi(z/rho), which keeps the poles inside 1/rho."""
    import control

    full, rho, basis = identification.model, identification.prior.decay_rate, identification.problem.parametric
    n = full.nstates - basis.states
    A, B, C = full.A[:n, :n], full.B[:n], full.C[:, :n]
    short = balanced_truncations(control.StateSpace(A * rho, B, C * rho, full.D, full.dt))
    kept = without_integrators(basis.poles, integrators)

    def of_rest(count: int) -> np.ndarray | None:
        left = count - kept.size
        return None if not 0 <= left <= n else np.concatenate([kept, short(left).model.poles() / rho])

    return of_rest


def without_integrators(poles: np.ndarray, count: int) -> np.ndarray:
    """The poles without the `count` nearest to z = 1."""
    return poles[np.argsort(np.abs(poles - 1))[count:]]


def truncated(fit: Fit, count: int) -> np.ndarray:
    """Poles of the balanced truncation of a fit's stable part."""
    import control

    model = control.StateSpace(fit.A, fit.x[:, None], fit.c[None], 0.0, 1.0)
    return balanced_truncations(model)(count).model.poles()


def from_lines(identification: Identification, count: int) -> np.ndarray | None:
    """Poles of a subspace estimate from the frequency lines; None where they are too few."""
    problem = identification.problem
    if not problem.frequency or not count:
        return None
    points = np.concatenate([np.exp(1j * f.omega * problem.dt) for f in problem.frequency])
    values, bound = (np.concatenate([getattr(f, n)[:, 0, 0] for f in problem.frequency]) for n in ("values", "bound"))
    thin = slice(None, None, -(-points.size // _MOST_LINES))
    try:
        estimate = subspace_estimate(
            values[thin, None, None],
            points[thin],
            count,
            weight=1 / bound[thin],
            block_rows=None,
            feedthrough=True,
            domain="z",
        )
    except (InputError, np.linalg.LinAlgError):
        return None
    return np.linalg.eigvals(estimate.A)


def spread(samples: SampleMap, count: int) -> np.ndarray:
    """Damped pairs over the band of the samples, and a real pole for an odd count."""
    low, high = samples.band
    angles = np.geomspace(low, high, count // 2 + 2)[1:-1]
    pairs = np.exp((-0.05 + 1j) * np.minimum(angles, 3.0))
    return np.concatenate([pairs, pairs.conj(), np.full(count % 2, np.exp(-low))])


def sanathanan_koerner(samples: SampleMap, target: Fit, count: int) -> np.ndarray:
    """Poles of |sigma G - num| at its smallest, repeated with the new poles; G is a richer model at the samples."""
    poles = spread(samples, count)
    right = samples.real(samples.y - target.error - samples.fixed[:, 1:] @ target.fixed[1:])
    for _ in range(_SK_STEPS if count else 0):
        A, c, _ = pole_functions(poles)
        numerators = np.hstack([samples.columns(A, c, samples.signals()), samples.fixed[:, :1]])
        G = samples.real(np.hstack([numerators, pole_columns(samples, A, c, target.outputs)]))
        U, V = orthonormal_columns(G)
        poles = reflected(moved(A, c, (V @ (U.T @ right))[-count:]))
    return poles


def reflected(poles: np.ndarray) -> np.ndarray:
    """Unstable poles reflected at the circle, those on it drawn inside."""
    size = np.maximum(np.abs(poles), np.finfo(float).tiny)
    return poles * (np.minimum(np.where(size > 1, 1 / size, size), _INSIDE) / size)


def grown(samples: SampleMap, fit: Fit, count: int) -> Iterator[np.ndarray]:
    """The poles of a fit with the further pair that helps least squares most, one of each damping; or with a real pole."""
    missing = count - fit.c.size
    low, high = samples.band
    if missing == 2:
        angles = np.geomspace(low / 2, min(high, 3.1), _ANGLES)
        kinds = [np.exp((-z + 1j * np.sqrt(1 - z * z)) * angles) for z in _DAMPINGS]
    else:
        kinds = [np.exp(-np.geomspace(low / 10, 3.0, _ANGLES)).astype(complex)]
    A, c, _ = pole_functions(fit.poles)
    base = np.hstack([samples.columns(A, c, samples.signals()), samples.fixed])
    U, _ = orthonormal_columns(samples.real(base))
    rest = samples.real(samples.y)
    rest = rest - U @ (U.T @ rest)
    for candidates in kinds:
        best = max(candidates, key=lambda pole: _gain(samples, U, rest, pole))
        yield np.concatenate([fit.poles, [best, best.conjugate()][:missing]])


def _gain(samples: SampleMap, U: np.ndarray, rest: np.ndarray, pole: complex) -> float:
    A, c, _ = pole_functions(np.array([pole, pole.conjugate()] if pole.imag else [pole]))
    more = samples.real(samples.columns(A, c, samples.signals()))
    Q, _ = orthonormal_columns(more - U @ (U.T @ more))
    return float(np.linalg.norm(Q.T @ rest))


def statespace(fit: Fit, integrators: int, like: Any) -> Any:
    """The model of a fit, poles at z = 1 exact, with the channels of another model."""
    import control

    chain = np.eye(integrators) + np.eye(integrators, k=-1)
    A = scipy.linalg.block_diag(fit.A, chain)
    B = np.concatenate([fit.x, np.eye(1, integrators)[0]])[:, None]
    C = np.concatenate([fit.c, fit.fixed[1 : 1 + integrators]])[None]
    labels = {"inputs": like.input_labels, "outputs": like.output_labels, "name": "reduced"}
    return control.StateSpace(A, B, C, fit.fixed[0], like.dt, remove_useless_states=False, **labels)
