"""Identifications with several inputs and outputs that are worth a page: two light modes of rank one, noise in its bounds."""

import numpy as np

import robustid as rid

DT = 0.01
HZ = 2 * np.pi


def response_of(model, omega):
    """(F, ny, nu), from control."""
    return np.moveaxis(np.reshape(model(np.exp(1j * omega * DT)), (model.noutputs, model.ninputs, -1)), -1, 0)


def plant(ny, nu, seed=1, modes=2):
    """Basis of the modes, their residue matrices (m, ny, nu), and the matrix of a first-order part."""
    rng = np.random.default_rng(seed)
    basis = rid.kautz(HZ * np.array([6.0, 17.0])[:modes], np.array([0.01, 0.02])[:modes], dt=DT)
    shapes = [np.outer(rng.standard_normal(ny), rng.standard_normal(nu)) for _ in range(2)]
    residues = np.stack([rng.standard_normal() * shapes[k // 2] for k in range(basis.size)])
    rest = rng.standard_normal((ny, nu))
    return basis, residues, 0.2 * rest / np.linalg.norm(rest, 2)


def measured(ny=2, nu=2, *, lines=12, noise=0.05, modes=2, seed=1, **names):
    """A response with errors of at most 0.6 of their bounds."""
    basis, residues, rest = plant(ny, nu, seed, modes)
    omega = HZ * np.linspace(1.0, 45.0, lines)
    values = np.tensordot(basis.response(omega * DT), residues, 1)
    values = values + rest / (1 - 0.5 * np.exp(-1j * omega * DT))[:, None, None]
    rng = np.random.default_rng(seed + 1)
    error = 0.6 * rng.uniform(size=values.shape) * np.exp(1j * rng.uniform(0, HZ, values.shape))
    return rid.FrequencyResponse(omega, values + noise * error, bound=noise, dt=DT, **names)


def record(seed=1, samples=20):
    """Of the 2 x 2 plant from rest; of the first output the first half is used."""
    basis, residues, rest = plant(2, 2, seed)
    rng = np.random.default_rng(seed + 2)
    u = rng.standard_normal((samples, 2))
    pulses = np.tensordot(basis.impulse(samples), residues, 1) + rest * 0.5 ** np.arange(samples)[:, None, None]
    y = np.stack([sum(pulses[k - j] @ u[j] for j in range(k + 1)) for k in range(samples)])
    bound = np.full(y.shape, 0.05)
    bound[samples // 2 :, 0] = np.inf
    return rid.TimeRecord(u, y + 0.03 * rng.uniform(-1, 1, y.shape), dt=DT, bound=bound)


def problem(frequency=None, time=None, **options):
    prior = options.pop("prior", rid.Prior(gain_bound=0.5, decay_rate=1.15))
    basis = plant(1, 1, modes=options.pop("modes", 2))[0]
    return rid.MixedProblem(frequency=frequency, time=time, prior=prior, parametric=basis, **options)


def with_values(frf, place, value, bound=None):
    """Some values changed, or missing (an infinite bound)."""
    values, radius = np.array(frf.values), np.array(frf.bound)
    values[place] = value
    if bound is not None:
        radius[place] = bound
    return rid.FrequencyResponse(
        frf.omega,
        values,
        bound=rid.Bound(radius, joint=frf.bound.joint),
        dt=frf.dt,
        inputs=frf.inputs,
        outputs=frf.outputs,
    )
