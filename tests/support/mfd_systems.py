"""Random lightly damped structures with rank-one modes, and their exact response by a formula without state space."""

import dataclasses

import numpy as np

import robustid as rid
from robustid.fitting import FractionProblem, Weight

OMEGA = 2 * np.pi * np.geomspace(4, 1200, 300)  # of `problem_of`


@dataclasses.dataclass(frozen=True)
class ModalSystem:
    """P(s) = sum_m gain_m w_m^2 shape_m drive_m' / (s^2 + 2 damping_m w_m s + w_m^2) + D; order 2*modes.

    With `dt` the modes are impulse-invariant: each partial fraction r/(s - p) becomes r*dt/(z - exp(p*dt)).
    """

    frequency: np.ndarray  # w, rad/s
    damping: np.ndarray
    shape: np.ndarray  # (ny, modes)
    drive: np.ndarray  # (modes, nu)
    D: np.ndarray
    dt: float | None = None

    @property
    def order(self):
        return 2 * len(self.frequency)

    @property
    def poles(self):
        """All poles (2*modes,), in s or z, complex pairs one after the other."""
        upper = self.frequency * (-self.damping + 1j * np.sqrt(1 - self.damping**2))
        s = np.stack([upper, upper.conj()], axis=1).ravel()
        return s if self.dt is None else np.exp(s * self.dt)

    def arrays(self):
        """Real modal (A, B, C, D)."""
        modes = len(self.frequency)
        A, B = np.zeros((2 * modes, 2 * modes)), np.zeros((2 * modes, self.drive.shape[1]))
        C = np.zeros((self.shape.shape[0], 2 * modes))
        for m, pole in enumerate(self.poles[::2]):
            # w^2/((s-p)(s-p*)) = w^2/(2j Im p) (1/(s-p) - 1/(s-p*)) = Im p/((Re-s)^2 + Im^2) * w^2/Im p
            k = slice(2 * m, 2 * m + 2)
            A[k, k] = [[pole.real, pole.imag], [-pole.imag, pole.real]]
            B[2 * m + 1] = self.drive[m]
            C[:, 2 * m] = self.shape[:, m] * self.residue[m]
        return A, B, C, self.D

    @property
    def residue(self):
        """r of r/(2j) (1/(s-p) - 1/(s-p*)), real."""
        damped = self.frequency * np.sqrt(1 - self.damping**2)
        return self.frequency**2 / damped * (1.0 if self.dt is None else self.dt)

    def response(self, points):
        """P at complex points s or z, (F, ny, nu)."""
        p = self.poles[::2]
        xi = np.asarray(points)[:, None]
        modal = self.residue * (1 / (xi - p) - 1 / (xi - p.conj())) / 2j
        return (self.shape * modal[:, None, :]) @ self.drive + self.D


def random_modal_system(
    seed,
    outputs,
    inputs,
    modes,
    *,
    band_hz=(5.0, 1000.0),
    damping=(0.005, 0.02),
    spread_db=0.0,
    feedthrough=False,
    dt=None,
):
    """Modes log-uniform over the band and the damping range, random rank-one shapes, static gains over `spread_db`."""
    rng = np.random.default_rng(seed)
    frequency = 2 * np.pi * np.sort(np.exp(rng.uniform(*np.log(band_hz), modes)))
    zeta = np.exp(rng.uniform(*np.log(damping), modes))
    gain = 10 ** (-rng.uniform(0, 1, modes) * spread_db / 20)
    shape = rng.standard_normal((outputs, modes)) * gain
    drive = rng.standard_normal((modes, inputs))
    D = rng.standard_normal((outputs, inputs)) if feedthrough else np.zeros((outputs, inputs))
    return ModalSystem(frequency, zeta, shape, drive, D, dt)


def noisy(rng, values, level=0.01):
    """Circular complex noise, independent between entries, of standard deviation level * |entry|."""
    noise = rng.standard_normal(values.shape) + 1j * rng.standard_normal(values.shape)
    return values * (1 + level * noise / np.sqrt(2))


def relative_error(estimate, truth):
    """sqrt(mean_k (|estimate_k - truth_k|_2 / |truth_k|_2)^2)."""
    ratio = np.linalg.norm(estimate - truth, 2, axis=(1, 2)) / np.linalg.norm(truth, 2, axis=(1, 2))
    return float(np.sqrt(np.mean(ratio**2)))


def by_control(model, omega):
    """Response (F, ny, nu) of a model, by python-control."""
    points = np.exp(1j * omega * model.dt) if model.dt else 1j * omega
    return np.moveaxis(model(points, squeeze=False), -1, 0)


def gaussian(rng, *shape):
    """Complex numbers with independent real and imaginary parts."""
    return rng.normal(size=shape) + 1j * rng.normal(size=shape)


def poles_and_residues(seed, ny, nu, order, lines=150, dt=None, feedthrough=False):
    """A random system by partial fractions: (omega, response, the response at any points s or z)."""
    rng = np.random.default_rng(seed)
    omega = np.sort(rng.uniform(1, 3000, lines))
    pairs = order // 2
    upper = -rng.uniform(1, 60, pairs) + 1j * rng.uniform(100, 2500, pairs)
    poles = np.concatenate([upper, upper.conj(), -rng.uniform(1, 60, order - 2 * pairs)])
    shapes, drives = gaussian(rng, ny, pairs), gaussian(rng, pairs, nu)
    real = order - 2 * pairs
    shapes = np.hstack([shapes, shapes.conj(), rng.normal(size=(ny, real))])
    drives = np.vstack([drives, drives.conj(), rng.normal(size=(real, nu))])
    constant = rng.normal(size=(ny, nu)) * feedthrough * (0.01 if dt is None else 1.0)
    poles = poles if dt is None else np.exp(poles * dt)

    def response(points):
        return (shapes / (np.asarray(points)[:, None, None] - poles)) @ drives + constant

    return omega, response(1j * omega if dt is None else np.exp(1j * omega * dt)), response


def stand_in(seed, modes=40, lines=1000, noise=0.05):
    """Many light modes at 1 kHz, 4 outputs, 2 inputs: no order below 2*modes is right. The response to fit; the truth between its
    points."""
    rng = np.random.default_rng(seed)
    hz, damping = np.sort(rng.uniform(8, 480, modes)), rng.uniform(0.003, 0.03, modes)
    omega = 2 * np.pi * np.linspace(2, 495, 2 * lines)
    z, values = np.exp(1e-3j * omega), np.zeros((2 * lines, 4, 2), dtype=complex)
    for w, zeta in zip(2 * np.pi * hz, damping, strict=True):
        pole = np.exp((-zeta + 1j * np.sqrt(1 - zeta**2)) * w * 1e-3)
        residue = np.outer(rng.standard_normal(4), rng.standard_normal(2)) * (1 - abs(pole))
        residue = residue * np.exp(1j * rng.uniform(-0.1, 0.1))
        values += residue / (z - pole)[:, None, None] + residue.conj() / (z - pole.conj())[:, None, None]
    e = rng.standard_normal((2, *values.shape)) / np.sqrt(2)
    measured = values + noise * np.abs(values) * (e[0] + 1j * e[1])
    return rid.FrequencyResponse(omega[::2], measured[::2], dt=1e-3), rid.FrequencyResponse(
        omega[1::2], values[1::2], dt=1e-3
    )


def problem_of(seed, outputs, inputs, modes, *, level=0.01, omega=OMEGA, **options):
    """A problem with noisy data of a random structure, and the response without noise."""
    system = random_modal_system(seed, outputs, inputs, modes)
    truth = system.response(1j * omega)
    values = noisy(np.random.default_rng([seed, 2]), truth, level) if level else truth
    return FractionProblem(omega, values, system.order, Weight(1 / np.abs(truth)), **options), truth


def identity(problem):
    """Denominators I at every frequency point."""
    lines, nu = problem.omega.size, problem.values.shape[2]
    return np.broadcast_to(np.eye(nu), (lines, nu, nu))
