"""Changes of a class that diagnose() tries, one respect at a time, and of the data of a passive one."""

from __future__ import annotations

import dataclasses
import logging

import numpy as np

from robustid.advice.causes import Cause, Kind, corrected, correction_change, mode_of, modes_of
from robustid.advice.kautz import further_mode, suggest_kautz
from robustid.bases import ParametricBasis, as_basis, integrators, kautz
from robustid.core import hz_words
from robustid.data import FrequencyResponse
from robustid.errors import InputError
from robustid.identification import MixedProblem

_log = logging.getLogger("robustid")
_RISEN = 2.0  # times the median: a response that rises towards low frequencies
_UNWEIGHTED = "a bound that does not fall with the frequency"

# What a response may be in the place of that of a passive plant.
_TURNED = (
    ("conjugate", "the phase with the opposite sign (exp(-j omega t))"),
    ("negate", "the response with the opposite sign"),
    ("differentiate", "the response times j omega (of a displacement the velocity)"),
    ("integrate", "the response over j omega (of an acceleration the velocity, of a velocity the displacement)"),
)


def changes_of(problem: MixedProblem) -> list[Cause]:
    """The class changed in one respect at a time."""
    rate = problem.prior.rate
    changes = _other_data(problem) if problem.prior.physical else [*_more_modes(problem), *_larger_gains(problem)]
    slower, name = (1 + (rate - 1) / 2, "rho - 1 halved") if problem.dt else (rate / 2, "decay halved")
    key = "decay_rate" if problem.dt else "decay"
    python, option = f"Prior({key}={slower:.6g}, ...)", f"--{key.replace('_', '-')} {slower:.6g}"
    posed = problem.with_prior(rate=slower)
    changes.append(Cause("the decay that was stated is too fast", python, option, posed, Kind.DECAY, name))
    if problem.prior.weighted:
        posed = problem.with_prior(roll_off=None, corner=None, weight=None)
        words = "the response doesn't fall as fast as the weight of the class"
        changes.append(
            Cause(words, "Prior(...) without its weight", "without --roll-off", posed, Kind.OTHER, _UNWEIGHTED)
        )
    if problem.parameter_bounds is not None and not problem.prior.physical:
        posed = dataclasses.replace(problem, parameter_bounds=None)
        words = "a coefficient is outside its interval"
        changes.append(
            Cause(words, "parameter_bounds=None", "", posed, Kind.INTERVALS, "coefficients without intervals")
        )
    return changes


def found_modes(problem: MixedProblem) -> Cause | None:
    """The modes that the response shows, in place of those that were stated; None where it shows none."""
    lines = [frf for frf in problem.frequency if isinstance(frf, FrequencyResponse)]
    if not lines or problem.prior.physical or not modes_of(problem):
        return None
    try:
        found = suggest_kautz(lines[0], delay=int(problem.dt > 0))
        if found.basis is None:
            return None
        posed = dataclasses.replace(problem, parametric=found.basis, parameter_bounds=None)
    except InputError as error:
        _log.info("modes of the response: left out (%s)", error)
        return None
    pairs = list(zip(found.omega, found.damping, strict=True))
    places = ", ".join(f"{hz_words(at / (2 * np.pi), 4)} with damping {ratio:.2g}" for at, ratio in pairs)
    numbers = [", ".join(f"{value:.6g}" for value in values) for values in (found.omega, found.damping)]
    python = f"rid.kautz([{numbers[0]}], [{numbers[1]}], ...)"
    cause = f"the modes are others than stated: {places}"
    return Cause(cause, python, mode_options(posed), posed, Kind.OTHER, f"the modes that the response shows, {places}")


def _larger_gains(problem: MixedProblem) -> list[Cause]:
    """A larger gain bound."""
    changes: list[Cause] = []
    for factor in (2, 10):
        K = factor * problem.prior.gain_bound
        words, python = "the gain bound K is too small", f"Prior(gain_bound={K:.4g}, ...)"
        posed = problem.with_prior(gain_bound=K)
        changes.append(Cause(words, python, f"--gain {K:.4g}", posed, Kind.OTHER, f"K times {factor}"))
    return changes


def _more_modes(problem: MixedProblem) -> list[Cause]:
    """The pairs repeated, and one more."""
    changes: list[Cause] = []
    if (terms := _further_terms(problem)) is not None:
        count = 1 + max(count for _, count in modes_of(problem))
        words = "the poles of the modes are not quite where they were stated"
        python, posed = f"rid.kautz(..., repeat={count})", _with_functions(problem, terms)
        changes.append(Cause(words, python, f"--repeat {count}", posed, Kind.POLES, "each pair repeated once more"))
    if (pair := _missing_pair(problem)) is not None:
        (at, damping), basis = pair
        hz = at / (2 * np.pi)
        where = f"at {hz_words(hz, 4)} with damping {damping:.2g}"
        python = f"parametric=[..., rid.kautz({at:.6g}, {damping:.3g}, ...)]"
        option = f"--mode {hz:.6g}:{damping:.3g} beside those that are there"
        posed = _with_functions(problem, basis)
        changes.append(
            Cause(f"a mode is missing, {where}", python, option, posed, Kind.MODE, f"one more pair, {where}")
        )
    return changes + [_with_integrators(problem, count) for count in missing_integrators(problem)]


def missing_integrators(problem: MixedProblem) -> tuple[int, ...]:
    """Numbers of integrators to try: none where there are some, or the response doesn't rise towards low frequencies."""
    basis = problem.parametric
    lines = [f for f in problem.frequency if isinstance(f, FrequencyResponse)]
    if not lines or (basis is not None and basis.has_integrator) or 0 in lines[0].omega:
        return ()
    size = np.linalg.norm(lines[0].values.reshape(lines[0].omega.size, -1), axis=1)
    lowest = size[: max(1, size.size // 10)]
    return (1, 2) if float(lowest.mean()) > _RISEN * float(np.median(size)) else ()


def _with_integrators(problem: MixedProblem, count: int) -> Cause:
    kind = ("an integrator", "a rigid body")[count - 1]
    words = f"{kind} is missing: {count} pole{'s' * (count > 1)} at {problem.plane.standstill}"
    posed = _with_functions(problem, integrators(count, dt=problem.dt))
    python = f"parametric=[..., rid.integrators({count}, dt={problem.dt:g})]"
    return Cause(words, python, f"--integrators {count}", posed, Kind.POLES, f"{kind} beside it")


def _other_data(problem: MixedProblem) -> list[Cause]:
    """Data as they may have been measured in the place of those of a passive plant: another sign, phase, or derivative."""
    turns = (0, 1, 3) if problem.prior.passive == "negative imaginary" else (0, 1, 2, 3)
    changes: list[Cause] = []
    for correction, cause in (_TURNED[k] for k in (turns if problem.prior.positive_real else (0,))):
        try:
            changed = corrected(problem, correction)
        except InputError as error:  # a frequency 0
            _log.info("%s: left out (%s)", correction, error)
            continue
        changes.append(Cause(cause, *correction_change(correction), changed, Kind.DATA, cause))
    return changes


def mode_options(problem: MixedProblem) -> str:
    """The modes of a problem as options of the program."""
    found: list[str] = []
    for pole, _ in modes_of(problem):
        omega, damping = mode_of(pole, problem.plane)
        found.append(f"--mode {omega.item() / (2 * np.pi):.6g}:{damping.item():.4g}")
    return " ".join(found)


def _with_functions(problem: MixedProblem, basis: ParametricBasis) -> MixedProblem:
    parts = (basis,) if problem.parametric is None else (problem.parametric, basis)
    bounds = problem.parameter_bounds
    if bounds is not None:
        free = np.broadcast_to([-np.inf, np.inf], (basis.size, *bounds.shape[1:]))
        bounds = np.concatenate([bounds, free])
    return dataclasses.replace(problem, parametric=parts, parameter_bounds=bounds)


def _further_terms(problem: MixedProblem) -> ParametricBasis | None:
    """The next derivative terms k^j a^k of every complex pole pair of the parametric part."""
    parts: list[ParametricBasis] = []
    for pole, count in modes_of(problem):
        chain = kautz(*mode_of(pole, problem.plane), dt=problem.dt, repeat=count + 1, delay=int(problem.dt > 0))
        parts.append(dataclasses.replace(chain, C=chain.C[-2:], D=chain.D[-2:], functions=chain.functions[-2:]))
    return as_basis(parts, problem.plane) if parts else None


def _missing_pair(problem: MixedProblem) -> tuple[tuple[float, float], ParametricBasis] | None:
    """The pair that the frequency points ask for most, beside those that are there."""
    lines = [f for f in problem.frequency if isinstance(f, FrequencyResponse)]
    if not lines:
        return None
    omega, value, bound = (
        np.concatenate(parts) for parts in zip(*((f.omega, f.values, f.bound.outer_radius) for f in lines), strict=True)
    )
    poles = np.concatenate([pole for pole, _ in modes_of(problem)] or [np.zeros(0, complex)])
    if 2 * omega.size < 4 * (poles.size + 1) + 4:
        return None
    data = FrequencyResponse(omega, value, bound=bound, dt=problem.dt or None)
    new = further_mode(data, *mode_of(poles, problem.plane))
    return new, kautz(*new, dt=problem.dt, delay=int(problem.dt > 0))
