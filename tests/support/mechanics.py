"""Mechanical systems with known modes: masses on springs in modal coordinates, measured with noise."""

import dataclasses

import numpy as np

import robustid as rid
from robustid.fitting.state_space.block_model import BlockModel

OMEGA = 2 * np.pi * np.linspace(2, 450, 160)
BETWEEN = 2 * np.pi * np.linspace(3.3, 440, 411)  # none of OMEGA


@dataclasses.dataclass(frozen=True)
class Mechanical:
    """``sum_k s^q c_k b_k'/(s^2 + 2 zeta omega s + omega^2) + C_r B_r/s^2 + D``, of complex shapes with conjugates; its samples."""

    frequency: np.ndarray
    damping: np.ndarray
    shapes: np.ndarray  # (ny, modes)
    drives: np.ndarray  # (modes, nu)
    rigid: tuple  # C_r, B_r
    power: int = 0
    dt: float | None = None
    D: float = 0.0

    @property
    def order(self):
        return 2 * (self.frequency.size + len(self.rigid[1]))

    def response(self, omega):
        p = self.frequency * (-self.damping + 1j * np.sqrt(1 - self.damping**2))
        R = self.shapes.T[:, :, None] * self.drives[:, None, :] * (p**self.power / (2j * p.imag))[:, None, None]
        s = 1j * omega
        if self.dt is None:
            terms, low = 1 / (s[:, None] - np.append(p, p.conj())), 1 / s**2
        else:
            z, p2 = np.exp(s * self.dt), np.append(p, p.conj())
            terms = (np.exp(p2 * self.dt) - 1) / p2 / (z[:, None] - np.exp(p2 * self.dt))
            low = self.dt**2 * (z + 1) / (2 * (z - 1) ** 2)
        through = self.D + (self.power == 2) * (self.shapes @ self.drives).real
        both = np.concatenate([R, R.conj()])
        return np.tensordot(terms, both, 1) + low[:, None, None] * (self.rigid[0] @ self.rigid[1]) + through


def mechanical(seed, ny, nu, modes, *, rigid=0, symmetric=False, general=False, power=0, dt=None, through=False):
    """Frequencies in 12 to 400 Hz, apart by at least a tenth, damping 0.3 to 3 %, shapes normal."""
    rng = np.random.default_rng(seed)
    frequency = 2 * np.pi * np.geomspace(12, 400, modes) * np.exp(rng.uniform(-0.1, 0.1, modes))
    shapes, drives = rng.standard_normal((ny, modes)), rng.standard_normal((modes, nu))
    if general:
        shapes = shapes + 0.4j * rng.standard_normal(shapes.shape)
        drives = drives + 0.4j * rng.standard_normal(drives.shape)
    left, right = rng.standard_normal((ny, rigid)), 100 * rng.standard_normal((rigid, nu))
    D = 0.01 * rng.standard_normal((ny, nu)) / frequency[0] if through else np.zeros((ny, nu))
    shapes = shapes * frequency ** (1 - power)
    if symmetric:
        drives, shapes = drives * np.sqrt(frequency ** (1 - power))[:, None], None
        shapes, left, D = drives.T, right.T / 100, D + D.T
    return Mechanical(
        frequency, rng.uniform(0.003, 0.03, modes), shapes, drives, (left, right), power=power, dt=dt, D=D
    )


def measured(system, seed, level, omega=OMEGA):
    """The response with relative noise, independent between entries."""
    values, rng = system.response(omega), np.random.default_rng([seed, 7])
    noise = (rng.standard_normal(values.shape) + 1j * rng.standard_normal(values.shape)) / np.sqrt(2)
    return rid.FrequencyResponse(omega, values * (1 + level * noise), dt=system.dt)


def unscaled(model, step):
    """The moved model without the normalisation of blocks, which changes C as well."""
    normalised, BlockModel.normalised = BlockModel.normalised, lambda self: self
    try:
        return model.moved(step)
    finally:
        BlockModel.normalised = normalised


def check_tangent(tangent, response, h=1e-6):
    """Columns of a tangent (F, ny, nu, coordinates) are central differences of response(step)."""
    for k, column in enumerate(np.moveaxis(tangent, 3, 0)):
        there, back = (response(sign * h * np.eye(tangent.shape[3])[k]) for sign in (1, -1))
        assert np.allclose(column, (there - back) / (2 * h), rtol=1e-6, atol=1e-7 * np.abs(column).max())


def check_symmetric_tangent(model, xi, moved):
    """C moves with the poles and the inputs, its coefficients held: a symmetric response, and its tangent."""
    gains = np.random.default_rng(4).standard_normal(len(model.tied_outputs()))

    def response(model):
        return np.tensordot(gains, model.tied_outputs(), 1) @ model.states(xi)

    values, states, C = response(model), model.states(xi), np.tensordot(gains, model.tied_outputs(), 1)
    assert np.allclose(values, values.transpose(0, 2, 1), rtol=1e-13, atol=1e-13 * np.abs(values).max())
    tangent = model.tied_changes(states, C, model.tangent(xi, states, C))
    check_tangent(tangent, lambda step: response(moved(step)))
