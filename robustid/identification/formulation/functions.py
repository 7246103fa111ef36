"""The functions that stand for the non-parametric part, their responses, and what they leave out."""

from __future__ import annotations

import dataclasses

import numpy as np
import scipy.linalg

from robustid.bases import InputNormalPair, Sections
from robustid.errors import SizeError
from robustid.identification.prior import Prior
from robustid.identification.problem import MixedProblem


@dataclasses.dataclass(frozen=True)
class ExactFunctions:
    """The functions of an input-normal pair whose nodes are those of the data: no tails."""

    problem: MixedProblem
    pair: InputNormalPair

    @property
    def count(self) -> int:
        """Number of coefficients of an entry."""
        return self.pair.order

    def lines(self, angles: np.ndarray) -> np.ndarray:
        """Values at exp(j angle), (F, n)."""
        problem = self.problem
        prior, at = problem.prior, problem.node_index(angles)
        return prior.gain_bound * self.pair.evaluate(np.exp(-1j * problem.angles[at]) / prior.decay_rate)

    def filtered(self, u: np.ndarray) -> np.ndarray:
        """Responses to the input, (T, n)."""
        prior, times = self.problem.prior, np.arange(u.size)[:, None]
        return filtered_by(u, prior.gain_bound * prior.decay_rate**-times * self.pair.taylor(u.size))

    def line_tail(self, angles: np.ndarray) -> np.ndarray:
        """Nothing is left out."""
        return np.zeros(angles.size)

    def time_tail(self, u: np.ndarray) -> np.ndarray:
        """Of inputs (T, q)."""
        return np.zeros(u.shape[0])


@dataclasses.dataclass(frozen=True)
class TaylorFunctions:
    """The first L delays; the coefficients beyond do what is bounded by the tails."""

    problem: MixedProblem
    length: int

    @property
    def count(self) -> int:
        """Number of coefficients of an entry."""
        return self.length

    @property
    def decay(self) -> np.ndarray:
        """rho^-j, (L,)."""
        return self.problem.prior.decay_rate ** -np.arange(self.length, dtype=float)

    def lines(self, angles: np.ndarray) -> np.ndarray:
        """Values at exp(j angle), (F, L)."""
        return self.problem.prior.gain_bound * self.decay * np.exp(-1j * np.outer(angles, np.arange(self.length)))

    def filtered(self, u: np.ndarray) -> np.ndarray:
        """Responses to the input, (T, L): the input, delayed."""
        delayed = scipy.linalg.toeplitz(u, np.zeros(min(self.length, u.size)))
        padded = np.zeros((u.size, self.length))
        padded[:, : delayed.shape[1]] = delayed
        return self.problem.prior.gain_bound * self.decay * padded

    def line_tail(self, angles: np.ndarray) -> np.ndarray:
        """Largest singular value of the rest on the unit circle: K rho^-L (2/pi) K(1/rho), K the complete elliptic integral."""
        return np.full(angles.size, taylor_tail(self.problem.prior, self.length))

    def time_tail(self, u: np.ndarray) -> np.ndarray:
        """K (sum_{j >= L} ||u_{n-j}||^2 rho^-2j)^(1/2), since the scaled coefficients of a row have norm 1, (T,)."""
        prior, L, count = self.problem.prior, self.length, u.shape[0]
        energy = np.zeros(count)
        if count > L:
            weights = prior.decay_rate ** (-2.0 * np.arange(L, count))
            energy[L:] = np.convolve(np.sum(u**2, axis=1), weights)[: count - L]
        return prior.gain_bound * np.sqrt(energy)


@dataclasses.dataclass(frozen=True)
class RepeatedFunctions:
    """The functions of a repeated section; the rest is theta times a function that is bounded by the tails."""

    problem: MixedProblem
    sections: Sections

    @property
    def count(self) -> int:
        """Number of coefficients of an entry."""
        return self.sections.order

    def lines(self, angles: np.ndarray) -> np.ndarray:
        """Values at exp(j angle), (F, n)."""
        prior = self.problem.prior
        if angles.size * self.sections.order > MOST_STORED:
            raise SizeError(
                f"`problem` has {self.sections.order} coefficients in the form of sections and {angles.size} frequency lines; their"
                f' product may be up to {MOST_STORED:.2g}. Use form="taylor", or thin the data: frf.select(slice(None, None, step))'
            )
        return prior.gain_bound * self.sections.evaluate(np.exp(-1j * angles) / prior.decay_rate)

    def line_tail(self, angles: np.ndarray) -> np.ndarray:
        """K |theta(zeta)| (2/pi) K(1/rho) at zeta = exp(-j angle)/rho, by Cauchy's formula on the circle, (F,).

        With what rounding can do to theta, and to the values of a function of norm 1 (||phi|| <= (1 - |zeta|^2)^(-1/2)).
        """
        prior, sections, eps = self.problem.prior, self.sections, np.finfo(float).eps
        inside = (1 - 1 / prior.decay_rate) * (1 + 1 / prior.decay_rate)  # 1 - |zeta|^2
        size = np.abs(sections.all_pass(np.exp(-1j * angles) / prior.decay_rate)) + 8 * sections.degree * eps / inside
        rounding = 8 * (sections.order + 1 / inside) * eps / np.sqrt(inside)
        return taylor_tail(prior, 0) * size**sections.repeats + prior.gain_bound * rounding

    def filtered(self, u: np.ndarray) -> np.ndarray:
        """Responses to the input, (T, n)."""
        return self._states(u)[0] @ (self.problem.prior.gain_bound * self.sections.pair.symmetry())

    def time_tail(self, u: np.ndarray) -> np.ndarray:
        """K (sum_j ||v_(n-j)||^2 rho^-2j)^(1/2), v the response of theta(z/rho) to u, (T,).

        Sample n is an inner product with h_n = sum_j u_(n-j) rho^-j zeta^j; P_+(conj(theta) h_n) has the coefficients
        v_(n-j) rho^-j. No digits cancel: [A B; c d] is orthogonal, and what its rounding adds is bounded along the way.
        """
        import scipy.signal

        prior, n, total = self.problem.prior, self.sections.order, np.zeros(u.shape[0])
        slow, fast = [1.0, -1 / prior.decay_rate], [1.0, -(prior.decay_rate**-2.0)]
        for one in u.T:
            v = self._states(one)[1]
            energy, size = (np.sqrt(scipy.signal.lfilter([1.0], fast, a**2)) for a in (v, one))
            rounding = 2 * (n + 3) ** 1.5 * np.finfo(float).eps * scipy.signal.lfilter([1.0], slow, size)
            total = np.hypot(total, energy + rounding)
        return prior.gain_bound * total

    def _states(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of theta(z/rho) driven by u: states (T, n) after, and outputs (T,) at, every sample."""
        pair, rho = self.sections.pair, self.problem.prior.decay_rate
        states, outputs, state = np.empty((u.size, pair.order)), np.empty(u.size), np.zeros(pair.order)
        for k, push in enumerate(u):
            outputs[k] = pair.c[0] @ state / rho + pair.d[0, 0] * push
            states[k] = state = pair.A @ state / rho + pair.B[:, 0] * push
        return states, outputs


Functions = ExactFunctions | TaylorFunctions | RepeatedFunctions

MOST_STORED = 4e7  # complex entries of the columns of all lines: 0.6 GB, of which the solver holds a few copies


def taylor_tail(prior: Prior, length: int) -> float:
    """Largest singular value on the unit circle of what a member of the ball has beyond its first L Taylor coefficients.

    tau_L = K rho^-L (2/pi) K(1/rho), K(k) the complete elliptic integral of modulus k: Cauchy's formula on |z| = rho.
    """
    import scipy.special

    rho = prior.decay_rate
    return prior.gain_bound * rho ** -float(length) * 2 / np.pi * float(scipy.special.ellipk(rho**-2))


def line_tails(problem: MixedProblem, sections: Sections, angles: np.ndarray) -> np.ndarray:
    """Largest singular value at exp(j angle) of what a member of the ball has beyond the coefficients, (F,); no scaling."""
    return functions_of(problem, sections).line_tail(angles)


def functions_of(problem: MixedProblem, basis: InputNormalPair | Sections) -> Functions:
    """The kind that the basis asks for."""
    if isinstance(basis, InputNormalPair):
        return ExactFunctions(problem, basis)
    return TaylorFunctions(problem, basis.repeats) if basis.is_shift else RepeatedFunctions(problem, basis)


def filtered_by(u: np.ndarray, impulse: np.ndarray) -> np.ndarray:
    """Responses to u of systems with these impulse responses (T, m), from rest."""
    if u.size <= _SHORT:
        return scipy.linalg.toeplitz(u, np.zeros(u.size)) @ impulse
    return scipy.linalg.matmul_toeplitz((u, np.zeros(u.size)), impulse)


_SHORT = 1000  # above, by FFT: a matrix of all delays takes too much memory
