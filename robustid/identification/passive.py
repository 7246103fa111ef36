"""Passive classes in a problem: what the data must be for them, and the constant about which a positive-real class is posed."""

from __future__ import annotations

import dataclasses
from typing import Any, Protocol

import numpy as np

from robustid.bases import Function, FunctionKind, ParametricBasis, as_basis, stack_bases
from robustid.core import Complex, Plane, Real, StateMatrices, hz_words
from robustid.data import FrequencyResponse, TangentialResponse
from robustid.errors import InputError
from robustid.identification.entries import Entries
from robustid.identification.prior import Prior
from robustid.identification.region import Region
from robustid.identification.weighting import Weighting

_GENEROUS = 100.0  # bounds by which data may be off before the coefficients of passive modes feel it
_TOGETHER = 250_000  # pairs of an arc and a point whose distances are computed at once
_LOUD = 2.0  # magnitude of most values at which they are no scattering parameters


class _Posed(Protocol):
    """Parts of a problem (which imports this file) that are read here."""

    @property
    def prior(self) -> Any: ...
    @property
    def frequency(self) -> tuple[FrequencyResponse, ...]: ...
    @property
    def parametric(self) -> Any: ...
    @property
    def parameter_bounds(self) -> Any: ...
    @property
    def functions(self) -> int: ...
    @property
    def entries(self) -> Entries: ...
    @property
    def plane(self) -> Plane: ...
    @property
    def region(self) -> Region: ...
    @property
    def weighting(self) -> Weighting: ...


def check_passive(
    prior: Prior,
    entries: Entries,
    frequency: tuple[FrequencyResponse | TangentialResponse, ...],
    time: tuple[object, ...],
) -> None:
    """Refuse data of another kind than passive classes are about: time records, samples along directions, other inputs than
    outputs.
    """
    name = type(prior).__name__
    if entries.outputs != entries.inputs:
        raise InputError(
            f"`prior` is a {name} class, for as many inputs as outputs at the same ports; got {entries.outputs} outputs and"
            f" {entries.inputs} inputs"
        )
    if any(np.any(frf.omega == 0) for frf in frequency) and prior.passive == "negative imaginary":
        raise InputError(
            f"`frequency` has a point at omega = 0, of which a {name} class says nothing: s F vanishes there; leave it out"
        )
    if not prior.positive_real:
        return
    if time or not all(isinstance(one, FrequencyResponse) for one in frequency):
        raise InputError(
            f"`prior` is a {name} class, which takes frequency responses of all ports only; make one of the records first"
            " (estimate_frf)"
        )


def centred(problem: _Posed) -> tuple[Prior, ParametricBasis, Real]:
    """The class with its scale, and the constant (K - slack) I as the parametric part: F = it + K g, 1 + g positive real.

    Of negative-imaginary plants both are divided by s. Refuses free coefficients: with them the plant is not passive.
    """
    prior, frequency, entries = problem.prior, problem.frequency, problem.entries
    modes = _passive_modes(problem)
    if not any(f.bound.used.all(axis=(1, 2)).any() for f in frequency):
        raise InputError(
            f"`frequency` has no point at which every entry of the matrix was measured; a {type(prior).__name__} class is bounded"
            " by the whole matrix at one frequency at least"
        )
    if prior.gain_bound is None:
        size = max(float(np.abs(positive_values(f, problem)[f.bound.used]).max()) for f in frequency)
        prior = dataclasses.replace(prior, gain_bound=size if size > 0 else 1.0)
    constant = StateMatrices(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.ones((1, 1)))
    if not problem.weighting.trivial:
        constant = problem.weighting.own.states
    A, B, C, D = constant
    basis = ParametricBasis(
        A, B, C, D, problem.plane.dt, (Function(FunctionKind.CONSTANT.value, FunctionKind.CONSTANT),)
    )
    centre: Real = (prior.gain_bound + prior.least) * np.eye(entries.outputs)
    ends = np.stack([centre, centre], axis=-1)[None]
    ends = ends[:, 0, 0] if entries.single else ends
    if modes is None:
        return prior, basis, ends
    highest = _highest(as_basis(modes, problem.plane), frequency, problem)
    low_high = (
        np.column_stack([np.zeros(len(highest)), highest[:, 0]]) if entries.single else _around_semidefinite(highest)
    )
    return prior, stack_bases([modes, basis]), np.concatenate([low_high, ends])


def _around_semidefinite(highest: Real) -> Real:
    """Intervals (m, p, p, 2) that hold all positive semidefinite matrices with diagonals up to (m, p)."""
    largest = np.sqrt(highest[:, :, None] * highest[:, None, :])
    lowest = -largest
    lowest[:, np.arange(highest.shape[1]), np.arange(highest.shape[1])] = 0.0
    return np.stack([lowest, largest], axis=-1)


def _passive_modes(problem: _Posed) -> ParametricBasis | None:
    """The positive-real modes that were given, in s, without the constant of the class; None for none."""
    given, name = problem.parametric, type(problem.prior).__name__
    if given is None:
        return None
    basis = as_basis(given, problem.plane).in_s()
    if basis.functions[-1].kind is FunctionKind.CONSTANT:
        if basis.size == 1:
            return None
        basis = dataclasses.replace(basis, C=basis.C[:-1], D=basis.D[:-1], functions=basis.functions[:-1])
    elif problem.parameter_bounds is not None:
        raise InputError(
            f"`parameter_bounds` has no place beside a {name} class: the coefficients of passive modes lie between 0 and what the"
            " real part of the data leaves to them; leave it out"
        )
    if any(function.kind is not FunctionKind.PASSIVE for function in basis.functions) or not problem.weighting.trivial:
        raise InputError(
            f"`parametric` can't be joined with a {name} class: modes with free coefficients make it say nothing. Give"
            " passive_modes(omega, damping) to a PositiveReal class, or leave it out and choose a `decay` below the smallest"
            " damping times frequency of the modes, in rad/s"
        )
    return basis


def _highest(modes: ParametricBasis, frequency: tuple[FrequencyResponse, ...], problem: _Posed) -> Real:
    """Largest coefficients (m, p) at every port with which the data, within 100 of their bounds, leave a real part to the rest."""
    highest = np.full((modes.size, problem.entries.outputs), np.inf)
    for frf in frequency:
        used = frf.bound.used.all(axis=(1, 2))
        functions: Real = np.real(modes.response(problem.plane.angles(frf.omega[used])))
        real = np.real(np.diagonal(frf.values[used], axis1=1, axis2=2))
        left = real + _GENEROUS * error_sizes(frf, problem)[used, None] - problem.prior.least
        with np.errstate(divide="ignore", invalid="ignore"):
            most = np.where(functions[:, :, None] > 0, np.maximum(left, 0.0)[:, None] / functions[:, :, None], np.inf)
        highest = np.minimum(highest, most.min(axis=0, initial=np.inf))
    return highest


def check_gain(problem: _Posed, what: str) -> None:
    """Refuse a positive-real class where something rests on a gain bound."""
    if problem.prior.positive_real:
        raise InputError(
            f"`prior` is a PositiveReal class, which has no gain bound, and {what} needs one; state a Prior(gain_bound=...) for it"
        )


def modes_reach(frf: FrequencyResponse, problem: _Posed) -> Real:
    """Largest magnitude of the modes of a passive class at every frequency point, (F,)."""
    count = problem.functions
    if not count:
        return np.zeros(len(frf.omega))
    sizes: Real = np.abs(problem.parametric.response(problem.plane.angles(frf.omega))[:, :count])
    highest: Real = problem.parameter_bounds[:count, ..., 1].reshape(count, *problem.entries.shape)
    return sizes @ np.linalg.norm(highest, 2, axis=(1, 2))


def class_value(problem: _Posed, low: Real, high: Real) -> Real:
    """Bound of the norm of every consistent G on each of many arcs of angles, before its weight.

    K for the ball; of positive-real H = F + slack, |H| <= |Im W_i| + (1 + d)/(1 - d) Re W_i with the numbers of `class_size`.
    """
    prior = problem.prior
    if not prior.positive_real:
        return np.full(low.size, prior.gain_bound)
    values = max(float(np.linalg.norm(positive_values(f, problem), 2, axis=(1, 2)).max()) for f in problem.frequency)
    errors = max(
        float(error_sizes(f, problem)[f.bound.used.all(axis=(1, 2))].max(initial=0.0)) for f in problem.frequency
    )
    return (class_size(problem, low, high) / 2 + values + errors + abs(prior.gain_bound) + 2 * abs(prior.least)) * (
        1 + 1e-9
    )


def class_size(problem: _Posed, low: Real, high: Real) -> Real:
    r"""The K for which `Region.bend` bounds the curvature of every consistent G on arcs of angles, an arc each, entry by entry.

    That of the ball; of positive-real H = F + slack, where in the Herglotz formula |H^(n)| <= 2 n! Re H/((1-|zeta|)^n (1+|zeta|)),
    twice the largest Re H: at most Re y_i + bound_i + slack at a frequency point, and elsewhere by Harnack's inequality

    .. math:: \mathrm{Re}\, H(\zeta) \le \frac{1 + d}{1 - d}\, \mathrm{Re}\, H(\zeta_i), \quad
              d = \left|\frac{\zeta - \zeta_i}{1 - \bar\zeta_i \zeta}\right|.
    """
    prior, region = problem.prior, problem.region
    if not prior.positive_real:
        return np.full(low.size, prior.gain_bound)
    best = np.full(low.size, np.inf)
    for frf in problem.frequency:
        sizes, points = _real_parts(frf, problem)
        for part in np.array_split(np.arange(low.size), 1 + low.size * points.size // _TOGETHER):
            ends = region.points(np.stack([low[part], high[part]]))[..., None]
            far = np.abs((ends - points) / (1 - points.conj() * ends)).max(axis=0)
            with np.errstate(divide="ignore"):
                most = ((1 + far) / (1 - far) * (sizes - prior.least)).min(axis=1, initial=np.inf)
            best[part] = np.minimum(best[part], most)
    return 2 * best * (1 + 1e-6)


def _real_parts(frf: FrequencyResponse, problem: _Posed) -> tuple[Real, Complex]:
    """Bound of the norm of the Hermitian part of F at the points where the whole matrix was measured, and their zeta."""
    whole = frf.bound.used.all(axis=(1, 2))
    values = positive_values(frf, problem)[whole]
    hermitian = (values + values.conj().transpose(0, 2, 1)) / 2
    sizes = np.linalg.norm(hermitian, 2, axis=(1, 2)) + error_sizes(frf, problem)[whole]
    if not problem.entries.single:  # the intervals of the modes hold matrices that are not positive semidefinite
        sizes = sizes + modes_reach(frf, problem)[whole]
    return sizes, problem.region.points(problem.plane.angles(frf.omega[whole]))


def positive_values(frf: FrequencyResponse, problem: _Posed) -> Complex:
    """The values (F, p, p) of the positive-real function at the frequency points: of a displacement the velocity."""
    weighting = problem.weighting
    return (
        frf.values
        if weighting.trivial
        else frf.values / weighting.values(problem.plane.angles(frf.omega))[:, None, None]
    )


def error_sizes(frf: FrequencyResponse, problem: _Posed) -> Real:
    """Frobenius norm of the largest errors that the bounds allow `positive_values` at every frequency point, (F,)."""
    radius = np.asarray(frf.bound.radius)
    if frf.bound.tilt is not None:
        radius = radius / (1 - np.abs(frf.bound.tilt))
    sizes: Real = np.linalg.norm(radius, axis=(1, 2))
    weighting = problem.weighting
    return sizes if weighting.trivial else sizes / weighting.sizes(problem.plane.angles(frf.omega))


def contradictions(problem: _Posed) -> tuple[str, ...]:
    """Sentences on how data contradict a passive class at single frequency points, or that they do it only together."""
    found = [(size, float(frf.omega[k])) for frf in problem.frequency for k, size in _excess(frf, problem)]
    if not found:
        return (
            "No frequency point contradicts the class by itself: what contradicts it is how the response changes between them."
            " Is the decay of the class at most the smallest real part of the poles of the plant, in magnitude; is a delay left in"
            " it?",
        )
    size, omega = max(found)
    points = sum(int(frf.bound.used.all(axis=(1, 2)).sum()) for frf in problem.frequency)
    single, slack = problem.entries.single, -problem.prior.least
    what, limit = "the magnitude" if single else "the largest singular value", "above 1"
    if problem.prior.positive_real:
        what = "the real part" if single else "an eigenvalue of the Hermitian part"
        limit = f"below {-slack:g}" if slack else "below 0"
    words = (
        f"The data are not passive at {len(found)} of {points} frequency points by themselves, most at"
        f" {hz_words(omega / (2 * np.pi))}: {what} is {limit} by {size:.3g} more than its bound."
    )
    return (words, *_hints(problem))


def _hints(problem: _Posed) -> list[str]:
    """Sentences on what the numbers look like, where it is not what a passive class is about."""
    values: Complex = np.concatenate([frf.values[frf.bound.used] for frf in problem.frequency])
    if not np.any(values.imag):
        return ["All values are real: are they magnitudes, in decibels perhaps, without their phase?"]
    if not problem.prior.positive_real and np.median(np.abs(values)) > _LOUD:
        return [
            f"Half of the values exceed {_LOUD:g}: are they impedances? With the reference resistance R of the ports the scattering"
            " parameters are (Z - R)/(Z + R), of matrices (Z - R)(Z + R)^-1."
        ]
    return []


def _excess(frf: FrequencyResponse, problem: _Posed) -> list[tuple[int, float]]:
    """Frequency points at which the whole matrix was measured and contradicts the class, with how far beyond the bounds."""
    found: list[tuple[int, float]] = []
    prior, values, errors = problem.prior, frf.values, error_sizes(frf, problem)
    if prior.positive_real:
        values = positive_values(frf, problem)
    for k in np.flatnonzero(frf.bound.used.all(axis=(1, 2))).tolist():
        W = values[k]
        if prior.positive_real:
            off = -float(np.linalg.eigvalsh((W + W.conj().T) / 2)[0]) + prior.least
        else:
            off = float(np.linalg.norm(W, 2)) - 1.0
        if off > errors[k]:
            found.append((k, off - float(errors[k])))
    return found
