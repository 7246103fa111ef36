"""Plants and problems that several recorded problems share; all made here, from seeds."""

from __future__ import annotations

import control
import numpy as np

import robustid as rid

HZ, DT = 2 * np.pi, 0.01
HIGH = HZ * np.geomspace(4, 1200, 80)  # rad/s, of the 2 x 2 structure


def structure(*, lines=6, samples=6, time=True, extra_hz=(17.5, 17.67, 17.8), hz=17.67, **prior):
    """The mass-beam structure with a pair of functions for each mode; `hz` moves the light one."""
    data = rid.datasets.flexible_structure(seed=0, lines=lines, samples=samples, extra_hz=extra_hz)
    basis = rid.kautz(HZ * np.array([9.0, hz]), [0.1, 0.004], dt=DT, delay=1)
    prior = rid.Prior(**({"gain_bound": 0.2, "decay_rate": 1.1} | prior))
    return rid.MixedProblem(frequency=data.frequency, time=data.time if time else None, prior=prior, parametric=basis)


def matrix_basis(modes=1):
    return rid.kautz(HZ * np.array([6.0, 17.0])[:modes], np.array([0.01, 0.02])[:modes], dt=DT)


def matrix_plant(symmetric=False, modes=1):
    """Residues (2 modes, 2, 2) of `matrix_basis`, and the gain of a first-order rest."""
    rng = np.random.default_rng(1)
    residues = rng.standard_normal((2 * modes, 2, 2))
    rest = rng.standard_normal((2, 2))
    if symmetric:
        residues, rest = residues + residues.swapaxes(1, 2), rest + rest.T
    return residues, 0.2 * rest / np.linalg.norm(rest, 2)


def matrix_response(*, lines=7, noise=0.05, symmetric=False, modes=1):
    """Of the 2 x 2 plant, with errors of at most 0.6 of their bounds."""
    residues, rest = matrix_plant(symmetric, modes)
    omega = HZ * np.linspace(1.0, 45.0, lines)
    values = np.tensordot(matrix_basis(modes).response(omega * DT), residues, 1)
    values = values + rest / (1 - 0.5 * np.exp(-1j * omega * DT))[:, None, None]
    rng = np.random.default_rng(2)
    error = 0.6 * rng.uniform(size=values.shape) * np.exp(1j * rng.uniform(0, HZ, values.shape))
    return rid.FrequencyResponse(
        omega, values + noise * error, bound=noise, dt=DT, inputs=["force [N]", "torque [Nm]"], outputs=["x [m]", "phi"]
    )


def matrix_record(samples=10):
    """Of the 2 x 2 plant from rest; of the first output the first half is used."""
    residues, rest = matrix_plant()
    rng = np.random.default_rng(3)
    u = rng.standard_normal((samples, 2))
    pulses = np.tensordot(matrix_basis().impulse(samples), residues, 1)
    pulses = pulses + rest * 0.5 ** np.arange(samples)[:, None, None]
    y = np.stack([sum(pulses[k - j] @ u[j] for j in range(k + 1)) for k in range(samples)])
    bound = np.full(y.shape, 0.05)
    bound[samples // 2 :, 0] = np.inf
    return rid.TimeRecord(u, y + 0.03 * rng.uniform(-1, 1, y.shape), dt=DT, bound=bound)


def matrix_problem(frequency, time=None, **options):
    prior = options.pop("prior", rid.Prior(gain_bound=0.5, decay_rate=1.15))
    return rid.MixedProblem(frequency=frequency, time=time, prior=prior, parametric=matrix_basis(), **options)


def compliance(omega):
    """Modes at 3 and 17.67 Hz of a continuous plant, and a static remainder."""
    s = 1j * np.asarray(omega)
    return 0.03 + sum(
        size * w**2 / (s**2 + 2 * damping * w * s + w**2)
        for w, damping, size in ((HZ * 3.0, 0.02, 1.0), (HZ * 17.67, 0.01, 0.2))
    )


def compliance_problem(lines=12, **prior):
    omega = HZ * np.unique(np.concatenate([np.linspace(1.0, 25.0, lines), [2.9, 3.1, 17.5, 17.8]]))
    values, rng = compliance(omega), np.random.default_rng(1)
    bound = 0.015 * np.abs(values)
    values = values + bound * np.sqrt(rng.random(omega.size)) * np.exp(1j * HZ * rng.random(omega.size))
    frf = rid.FrequencyResponse(omega, values, bound=bound)
    basis = rid.kautz(HZ * np.array([3.0, 17.67]), [0.02, 0.01], dt=0)
    return rid.MixedProblem(
        frequency=frf, prior=rid.Prior(**({"gain_bound": 0.2, "decay": 20.0} | prior)), parametric=basis
    )


def mobility(omega):
    """(F,): two modes c s/(s^2 + 2 d w s + w^2), positive real."""
    s = 1j * np.asarray(omega)
    return sum(c * s / (s**2 + 2 * d * w * s + w**2) for w, d, c in ((HZ * 31.0, 0.06, 0.8), (HZ * 52.0, 0.05, 0.6)))


def mobility_response(lines=10, turn=0):
    """With errors of at most 1 % of the median; times (j omega)^-`turn`: 1 gives the compliance."""
    omega = HZ * np.linspace(20, 62, lines)
    values, rng = mobility(omega), np.random.default_rng(1)
    bound = 0.01 * float(np.median(np.abs(values)))
    values = values + bound * np.exp(1j * HZ * rng.random(lines))
    by = (1j * omega) ** turn
    return rid.FrequencyResponse(omega, values / by, bound=1.0001 * bound / np.abs(by))


def modal_system(seed=1, outputs=2, inputs=2, modes=3, band_hz=(5.0, 1000.0)):
    """A continuous structure with rank-one modes, log-uniform in the band."""
    rng = np.random.default_rng(seed)
    omega = HZ * np.sort(np.exp(rng.uniform(*np.log(band_hz), modes)))
    damping = np.exp(rng.uniform(np.log(0.005), np.log(0.02), modes))
    A, B, C = np.zeros((2 * modes, 2 * modes)), np.zeros((2 * modes, inputs)), np.zeros((outputs, 2 * modes))
    for k, (w, d) in enumerate(zip(omega, damping, strict=True)):
        A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[0, 1], [-(w**2), -2 * d * w]]
        B[2 * k + 1], C[:, 2 * k] = w**2 * rng.standard_normal(inputs), rng.standard_normal(outputs)
    return control.StateSpace(A, B, C, np.zeros((outputs, inputs)), 0)


def noisy(model, omega, level=0.01, seed=0, **names):
    """The response of a model with circular noise in proportion to each entry."""
    points = np.exp(1j * omega * model.dt) if model.dt else 1j * omega
    values = np.moveaxis(model(points, squeeze=False), -1, 0)
    e = np.random.default_rng(seed).standard_normal((2, *values.shape)) / np.sqrt(2)
    return rid.FrequencyResponse(omega, values * (1 + level * (e[0] + 1j * e[1])), dt=model.dt or None, **names)


def foster(ports=2, modes=3, damping=0.05, resistance=0.2):
    """Sum of modes r r' s/(s^2 + 2 d w s + w^2), and a resistance at every port: positive real."""
    rng = np.random.default_rng(0)
    omega = np.geomspace(1.0, 100.0, modes) * rng.uniform(0.9, 1.1, modes)
    A, B = np.zeros((2 * modes, 2 * modes)), np.zeros((2 * modes, ports))
    for k, w in enumerate(omega):
        A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[0, 1], [-(w**2), -2 * damping * w]]
        B[2 * k + 1] = rng.standard_normal(ports)
    return control.StateSpace(A, B, B.T, resistance * np.eye(ports), 0)


def scattering(impedance):
    """(Z - 1)(Z + 1)^-1."""
    Z, eye = impedance, np.eye(impedance.noutputs)
    inverse = np.linalg.inv(Z.D + eye)
    A, B, C = Z.A - Z.B @ inverse @ Z.C, np.sqrt(2) * Z.B @ inverse, np.sqrt(2) * inverse @ Z.C
    return control.StateSpace(A, B, C, (Z.D - eye) @ inverse, 0)


def driven(samples=200, seed=0, initial="free", level=0.02):
    """A record of a discrete 2 x 2 plant of order 3 with a start and noise."""
    rng = np.random.default_rng(seed)
    A = 0.98 * np.array([[0.9, 0.3, 0], [-0.3, 0.9, 0], [0, 0, 0.7]])
    B, C = np.random.default_rng(7).standard_normal((3, 2)), np.random.default_rng(8).standard_normal((2, 3))
    u, state, y = rng.standard_normal((samples, 2)), np.array([3.0, -2.0, 1.0]) * (initial == "free"), []
    for sample in u:
        y.append(C @ state)
        state = A @ state + B @ sample
    y = np.array(y)
    return rid.TimeRecord(u, y + level * np.abs(y).max() * rng.standard_normal(y.shape), dt=0.1, initial=initial)
