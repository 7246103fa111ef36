"""Random problems with a known truth, and a judge that shares no formula with the library."""

import dataclasses

import control
import numpy as np
import scipy.signal

import robustid as rid
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
    basis: rid.bases.ParametricBasis | None
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


def judge_margin(problem, whitening=None):
    """The margin from Theorem 1 of Inanc et al. as printed: complex nodes with their conjugates, M0, and Clarabel.

    Shares neither basis nor reduction to real form with the library; one frequency and one time experiment at most. Ellipses
    are given by `whitening` (F, 2, 2): |W_k (Re e_k, Im e_k)| <= s.
    """
    import cvxpy as cp

    K, rho, dt = problem.prior.gain_bound, problem.prior.decay_rate, problem.dt
    frf = problem.frequency[0] if problem.frequency else None
    record = problem.time[0] if problem.time else None
    z = np.exp(-1j * frf.omega * dt) if frf else np.zeros(0)
    z, lines = np.concatenate([z, z.conj()]), z.size
    samples = record.u.shape[0] if record else 0
    k = np.arange(samples)
    Q = 1 / (1 - np.outer(z.conj(), z) * rho**-2.0)
    S = z.conj()[:, None] ** k * rho ** (-2.0 * k)
    M0 = np.block([[Q, S], [S.conj().T, np.diag(rho ** (-2.0 * k))]])
    root = np.linalg.cholesky(M0).conj().T  # M0 = root^H root
    back = np.linalg.inv(root)
    s, p = cp.Variable(), cp.Variable(0 if problem.parametric is None else problem.parametric.size)
    limits, terms = [], []
    size = 2 * lines + samples
    if lines:
        re, im = cp.Variable(lines), cp.Variable(lines)
        unit = np.eye(size)
        for i in range(lines):
            a, b = np.outer(unit[i], unit[i]), np.outer(unit[lines + i], unit[lines + i])
            terms += [(re[i], a + b), (im[i], 1j * a - 1j * b)]
        F = [re, im]
        if problem.parametric is not None:
            P = problem.parametric.response(frf.omega * dt)
            F = [re + P.real @ p, im + P.imag @ p]
        y = frf.values[:, 0, 0]
        W = np.eye(2) / frf.bound if whitening is None else whitening
        e = (y.real - F[0], y.imag - F[1])
        parts = [cp.multiply(W[:, i, 0], e[0]) + cp.multiply(W[:, i, 1], e[1]) for i in (0, 1)]
        limits.append(cp.norm(cp.vstack(parts), 2, axis=0) <= s)
    if samples:
        g = cp.Variable(samples)
        for j in range(samples):
            shift = np.zeros((size, size))
            shift[2 * lines :, 2 * lines :] = np.eye(samples, k=j)
            terms.append((g[j], shift))
        U = np.array([[record.u[i - j, 0] if i >= j else 0.0 for j in range(samples)] for i in range(samples)])
        f = g if problem.parametric is None else g + problem.parametric.impulse(samples) @ p
        limits.append(cp.abs((record.y[:, 0] - U @ f) / record.bound[:, 0]) <= s)
    if problem.parameter_bounds is not None:
        low, high = problem.parameter_bounds.T
        held = np.isfinite(low)
        limits += [p[held] >= low[held], p[held] <= high[held]] if held.any() else []
    # ||root X back|| <= K, in real form.
    X = 0
    for unknown, pattern in terms:
        full = root @ pattern @ back
        X = X + unknown * np.block([[full.real, -full.imag], [full.imag, full.real]])
    limits.append(cp.sigma_max(X) <= K)
    program = cp.Problem(cp.Minimize(s), limits)
    program.solve(solver="CLARABEL", tol_gap_abs=1e-9, tol_gap_rel=1e-9, tol_feas=1e-9, accept_unknown=True)
    return float(s.value)


def truth_of(seed, case):
    """The truth behind `random_problem`: impulse response of (count), frequency response of (omega, rad/s)."""
    truth = random_experiment(seed, case, 8)[1]
    return truth.impulse, lambda omega: truth.response(np.asarray(omega) * 0.01)


def rigid_structure():
    """A double integrator, and what it and the simulated structure make together; dt = 0.01 s."""
    rigid = control.ss([[1, 0.01], [0, 1]], [[0.5e-4], [0.01]], [[1, 0]], [[0]], 0.01)
    return rigid, control.ss(rigid + rid.datasets.flexible_structure(seed=1).truth)
