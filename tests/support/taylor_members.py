"""Shared by the tests: taylor members."""

import numpy as np
from scipy.signal import lfilter

import robustid as rid

DT, EPS = 0.01, np.finfo(float).eps


def polynomials(zeros):
    """Rising coefficients (P, Q) of the real Blaschke product P/Q with these zeros and their conjugates."""
    above = np.real(np.poly(np.concatenate([zeros, np.conj(zeros)])))[::-1]
    return above, above[::-1]


def random_member(rng, degree=6, reach=1.0):
    """P/Q in the unit ball of the disc: a Blaschke product of zeros in |zeta| < reach, or a mean of two with a factor."""
    radii, turns = reach * np.sqrt(rng.uniform(0, 1, (2, degree // 2))), rng.uniform(0, np.pi, (2, degree // 2))
    (a, b), (c, d) = map(polynomials, radii * np.exp(1j * turns))
    if rng.uniform() < 0.5:
        return a, b
    t = rng.uniform(0, 1)
    return t * np.convolve(a, d) + (1 - t) * np.convolve(c, b), np.convolve(b, d)


def at(member, zeta):
    return np.polyval(member[0][::-1], zeta) / np.polyval(member[1][::-1], zeta)


def taylor(member, count):
    return lfilter(*member, np.eye(1, count)[0])


def random_experiments(rng, samples=40):
    omega = np.sort(rng.uniform(0, np.pi / DT, 6))
    frf = rid.FrequencyResponse(omega, np.zeros(6), bound=rng.uniform(0.01, 1, 6), dt=DT)
    records = [
        rid.TimeRecord(
            rng.standard_normal(samples), np.zeros(samples), dt=DT, bound=rng.uniform(0.01, 1, samples), initial=initial
        )
        for initial in ("rest", "periodic", "free")
    ]
    return [frf], records


def wide_problem(rng, slowest):
    """A problem of all kinds of samples, and the bounds of these: that of the free record with what its past can do."""
    frequency, time = random_experiments(rng)
    prior = rid.Prior(gain_bound=rng.uniform(0.1, 10), decay_rate=rng.uniform(slowest, 1.3))
    widths = np.concatenate([f.bound[:, 0, 0] for f in frequency] + [t.bound[:, 0] for t in time])
    past = np.abs(time[2].u).max() * prior.gain_bound * prior.decay_rate ** -np.arange(40.0)
    widths[-40:] += past / (prior.decay_rate - 1)
    return rid.MixedProblem(frequency=frequency, time=time, prior=prior), widths


def shares_of_tails(problem, widths, rows, member, inside, rounding):
    """Parts of the tails that a member leaves beside its coefficients, at most, in lines and in each record: never above 1."""
    values = responses(problem, member) / widths
    rest = np.abs(values - rows.E @ inside)
    assert np.all(rest <= rows.tail * (1 + 1e-9) + rounding * np.abs(values).max())
    ratio = rest / np.where(rows.tail > 0, rows.tail, np.inf)
    return [ratio[part].max() for part in (slice(0, 6), slice(6, 46), slice(46, 86), slice(86, 126))]


def responses(problem, member):
    """K member(z/rho) at all samples of the problem, from its definition; the record with free start as if from rest."""
    K, rho = problem.prior.gain_bound, problem.prior.decay_rate
    out = [K * at(member, np.exp(-1j * f.omega * DT) / rho) for f in problem.frequency]
    for record in problem.time:
        u = record.u[:, 0]
        if record.initial == "periodic":
            H = K * at(member, np.exp(-2j * np.pi * np.arange(u.size // 2 + 1) / u.size) / rho)
            out.append(np.fft.irfft(np.fft.rfft(u) * H, u.size))
        else:
            g = K * taylor(member, u.size) * rho ** -np.arange(u.size, dtype=float)
            out.append(np.convolve(u, g)[: u.size])
    return np.concatenate(out)
