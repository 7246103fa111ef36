"""Random problems with a known truth, their answers, and the same in other units."""

import dataclasses

import control
import numpy as np
import scipy.signal

import robustid as rid
from robustid.bases import ParametricBasis
from support.cases import slow

CASES = ("time", "frequency", "mixed", "parametric")
MIXED_IS_SLOW = ["time", "frequency", slow("mixed"), "parametric"]


def small_part(rng, gain, decay_rate):
    """A random G of the class as (numerator, denominator) in the delay: poles outside |z| < rho, |G| <= K there."""
    poles = decay_rate * rng.uniform(1.15, 2.0, 2) * np.exp(1j * rng.uniform(0.2, 3.0, 2))
    denominator = np.real(np.poly(np.concatenate([poles, poles.conj()])))[::-1]  # rising powers of z
    denominator /= denominator[0]
    numerator = rng.standard_normal(4)
    z = decay_rate * np.exp(1j * np.linspace(0, np.pi, 4000))
    peak = np.abs(np.polyval(numerator[::-1], z) / np.polyval(denominator[::-1], z)).max()
    return numerator * gain * rng.uniform(0.3, 0.9) / (peak * 1.001), denominator


@dataclasses.dataclass(frozen=True)
class Truth:
    """The plant behind a random problem: G as numerator and denominator in the delay, the basis and its weights."""

    numerator: np.ndarray
    denominator: np.ndarray
    basis: ParametricBasis | None
    weights: np.ndarray | None

    def response(self, angle):
        z = np.exp(-1j * np.asarray(angle))
        F = np.polyval(self.numerator[::-1], z) / np.polyval(self.denominator[::-1], z)
        return F if self.basis is None else F + self.basis.response(angle) @ self.weights

    def impulse(self, count):
        f = scipy.signal.lfilter(self.numerator, self.denominator, np.eye(1, count)[0])
        return f if self.basis is None else f + self.basis.impulse(count) @ self.weights


def random_problem(seed, case, coefficients, **options):
    """The problem of `random_experiment`."""
    return random_experiment(seed, case, coefficients, **options)[0]


def random_experiment(seed, case, coefficients, *, noise=0.9, gain=1.0, spread=1.0):
    """A problem of about so many coefficients, and its truth: inside the bounds for `noise` <= 1 (`spread` scales them)."""
    rng = np.random.default_rng([seed, CASES.index(case)])
    dt, rho = 0.01, rng.uniform(1.02, 1.3)
    numerator, denominator = small_part(rng, gain, rho)
    basis = weights = None
    if case == "parametric":
        basis = rid.kautz(2 * np.pi * rng.uniform(5, 30), rng.uniform(0.003, 0.05), dt=dt, delay=1)
        weights = rng.standard_normal(2) * gain * 3
    truth = Truth(numerator, denominator, basis, weights)
    lines = {"time": 0, "frequency": coefficients // 2}.get(case, coefficients // 4)
    samples = coefficients - 2 * lines
    frequency = time = None
    if lines:
        angle = np.sort(rng.uniform(0.05, 3.0, lines))
        F = truth.response(angle)
        bound = spread * gain * rng.uniform(0.01, 0.1, lines)
        error = noise * bound * np.sqrt(rng.uniform(0, 1, lines)) * np.exp(2j * np.pi * rng.uniform(0, 1, lines))
        frequency = rid.FrequencyResponse(angle / dt, F + error, bound=bound, dt=dt)
    if samples:
        u = np.sign(rng.standard_normal(samples)) + 0.3 * rng.standard_normal(samples)
        f = truth.impulse(samples)
        bound = spread * gain * rng.uniform(0.02, 0.2, samples)
        y = np.convolve(u, f)[:samples] + noise * bound * rng.uniform(-1, 1, samples)
        time = rid.TimeRecord(u, y, dt=dt, bound=bound)
    prior = rid.Prior(gain_bound=gain, decay_rate=rho)
    return rid.MixedProblem(frequency=frequency, time=time, prior=prior, parametric=basis), truth


def identified(problem, **options):
    """The answer to a problem, every check of which holds."""
    result = rid.identify(problem, **options)
    assert result.verification.passed, result.summary()
    return result


def in_units(problem, size, bound=None):
    """The same problem where one unit is `size` of others; its bounds in that or in other units."""
    bound = size if bound is None else bound
    ends, gain = problem.parameter_bounds, size * problem.prior.gain_bound
    return dataclasses.replace(
        problem,
        frequency=[dataclasses.replace(f, values=size * f.values, bound=f.bound * bound) for f in problem.frequency],
        time=[dataclasses.replace(t, y=size * t.y, bound=t.bound * bound) for t in problem.time],
        prior=dataclasses.replace(problem.prior, gain_bound=gain),
        parameter_bounds=None if ends is None else size * ends,
    )


def truth_of(seed, case):
    """The truth behind `random_problem`: impulse response of (count), frequency response of (omega, rad/s)."""
    truth = random_experiment(seed, case, 8)[1]
    return truth.impulse, lambda omega: truth.response(np.asarray(omega) * 0.01)


def rigid_structure():
    """A double integrator, and what it and the simulated structure make together; dt = 0.01 s."""
    rigid = control.ss([[1, 0.01], [0, 1]], [[0.5e-4], [0.01]], [[1, 0]], [[0]], 0.01)
    return rigid, control.ss(rigid + rid.datasets.flexible_structure(seed=1).truth)
