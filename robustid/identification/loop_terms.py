r"""Terms of a loop's equation in a record, filtered by left factors of the controller, :math:`C = \tilde D^{-1} \tilde N`.

.. math:: e = \tilde D u + \tilde N y - \tilde D r + G (E + L G)^k x_0

The last part, that of the unknown state in which the controller began, is projected out of everything.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from robustid.core import (
    Complex,
    Real,
    StateMatrices,
    bilinear_in_s,
    bilinear_in_z,
    mirroring_feedback,
    poles_of,
    response_at,
    simulate,
)
from robustid.errors import InputError

# What is added is r at the input, C r at the reference, or -C r at the output.
LAWS = {"input": "r - C y", "reference": "C (r - y)", "output": "-C (y + r)"}
OPENED = {
    "y": "from r to y",
    "u": "from r to u",
    "sensitivity": "from an error of y to y",
}  # responses of which R follows
_BLIND = 1e-9  # of its largest value: a controller that does so little tells nothing
SHIFTS = 5  # samples by which terms are moved at most
_NOTHING = 1e-12  # relative
_EDGE = 1e-6  # distance of a pole from the unit circle that is rounding
_SLOWEST = 0.3  # decay within a sample beyond which no pole of the controller is moved


class Signals(NamedTuple):
    """Samples of a record, time first."""

    u: Real
    y: Real
    r: Real
    periodic: bool

    def balance(self, place: str) -> tuple[Real, Real]:
        """Known side and what the controller sees, ``known = -C seen``, with r at a place."""
        if place == "input":
            return self.u - self.r, self.y
        return self.u, self.y - self.r if place == "reference" else self.y + self.r

    def every(self, step: int, first: int) -> Signals:
        """One sample of so many."""
        return Signals(self.u[first::step], self.y[first::step], self.r[first::step], False)


class Observer(NamedTuple):
    """Left factors of a controller: an observer of its state, whose innovation is the filtered error of its equation."""

    controller: StateMatrices
    gain: Real

    @classmethod
    def of(cls, controller: StateMatrices, decay: float) -> Observer:
        """Factors of a decay within a sample: slower poles are mirrored at half of it.

        InputError: if a slow pole does not show in the output.
        """
        dual = controller.transposed()
        return cls(controller, mirroring_feedback(dual, 1.0, min(decay / 2, _SLOWEST)).T)

    @property
    def states(self) -> Real:
        """``E + L G``."""
        return self.controller.A + self.gain @ self.controller.C

    @property
    def inputs(self) -> StateMatrices:
        r""":math:`\tilde D`."""
        return StateMatrices(self.states, self.gain, self.controller.C, np.eye(len(self.controller.C)))

    @property
    def outputs(self) -> StateMatrices:
        r""":math:`\tilde N`."""
        _, F, G, H = self.controller
        return StateMatrices(self.states, F + self.gain @ H, G, H)

    def free(self, samples: int) -> Real:
        """Answers to unit states at the first sample, (T, nu, n)."""
        found, state = np.empty((samples, *self.controller.C.shape)), np.eye(len(self.states))
        for k in range(samples):
            found[k] = self.controller.C @ state
            state = self.states @ state
        return found

    def skipping(self, known: Real, seen: Real, skipped: NDArray[np.bool_]) -> tuple[Real, Real]:
        """Innovation of ``known = -C seen``, (T, nu), where what is skipped corrects nothing and is 0, and its free answers."""
        E, F, G, H = self.controller
        answers, pushes = known + seen @ H.T, seen @ F.T
        state = np.hstack([np.zeros((len(E), 1)), np.eye(len(E))])
        found = np.empty((*known.shape, state.shape[1]))
        for k, (answer, push, ignored) in enumerate(zip(answers, pushes, skipped, strict=True)):
            now: Real = G @ state
            now[:, 0] += answer
            now[ignored] = 0.0
            found[k] = now
            state = E @ state + self.gain @ now
            state[:, 0] += push
        return found[:, :, 0], found[:, :, 1:]


def answer(system: StateMatrices, signals: Real, *, periodic: bool) -> Real:
    """Answer in periodic steady state or from zero initial conditions, (T, outputs)."""
    if not periodic:
        return simulate(system, signals)[0]
    lines = np.fft.rfft(signals, axis=0)
    points = np.exp(2j * np.pi * np.arange(len(lines)) / len(signals))
    answers = response_at(system, points) @ lines[:, :, None]
    return np.asarray(np.fft.irfft(answers[:, :, 0], len(signals), axis=0), dtype=float)


def separately(system: StateMatrices, signals: Real, *, periodic: bool) -> list[Real]:
    """Answers to each of the inputs alone, in periodic steady state or from zero initial conditions."""
    A, B, C, D = system
    if periodic:
        lines = np.fft.rfft(signals, axis=0)
        values = response_at(system, np.exp(2j * np.pi * np.arange(len(lines)) / len(signals)))
        return [
            np.fft.irfft(values[:, :, j] * lines[:, j, None], len(signals), axis=0) for j in range(signals.shape[1])
        ]
    return [simulate(StateMatrices(A, B[:, [j]], C, D[:, [j]]), signals[:, [j]])[0] for j in range(signals.shape[1])]


class Terms:
    """Terms of the equation, each of one signal, (T, nu); a residual that is compared is one vector."""

    def __init__(self, observer: Observer, signals: Signals, place: str) -> None:
        self.observer, self.signals, self.place = observer, signals, place
        periodic = signals.periodic
        self.a = separately(observer.inputs, signals.u, periodic=periodic)
        self.b = separately(observer.outputs, signals.y, periodic=periodic)
        self.c = self.excited(place)
        self.error = total([*self.a, *self.b, *self.c])
        sizes = [np.sqrt(np.mean(total(part) ** 2, axis=0)) for part in (self.a, self.b, self.c)]
        self.sizes: Real = np.max(sizes, axis=0)
        self.sizes[self.sizes == 0] = 1.0
        samples = len(signals.u)
        self.kept = slice(None) if periodic else slice(SHIFTS, samples - SHIFTS)
        free = np.zeros((samples, self.error.shape[1], 0)) if periodic else observer.free(samples)
        self._free = span(self.columns(free))
        self.count = max(1, len(self._free) - self._free.shape[1])

    def excited(self, place: str) -> list[Real]:
        """Terms of the excitation, one a signal, with r at a place."""
        system = self.observer.inputs if place == "input" else self.observer.outputs
        sign = 1.0 if place == "output" else -1.0
        return [sign * one for one in separately(system, self.signals.r, periodic=self.signals.periodic)]

    def left(self, error: Real) -> Real:
        """An error without what a free state explains, in parts of the signals, in one vector."""
        flat = self.columns(error[:, :, None])[:, 0]
        return flat - self._free @ (self._free.T @ flat)

    def columns(self, errors: Real) -> Real:
        """Errors (T, nu, n) where they are compared, in parts of the signals, each in one column."""
        kept = (errors / self.sizes[:, None])[self.kept]
        return kept.reshape(kept.shape[0] * kept.shape[1], kept.shape[2])

    def moved(self, term: Real, shift: int) -> Real:
        """A term some samples later; what comes in at an end is not compared."""
        return np.roll(term, shift, axis=0)

    def energy(self, left: Real) -> float:
        """Mean square."""
        return float(left @ left) / self.count


def span(columns: Real) -> Real:
    """Orthonormal basis of columns."""
    basis, levels, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(basis[:, levels > _NOTHING * levels.max(initial=0.0)], dtype=float)


def total(parts: Sequence[Real]) -> Real:
    """Sum of terms."""
    return np.sum(np.stack(list(parts)), axis=0)


def resampled(controller: StateMatrices, ratio: float) -> Iterator[StateMatrices]:
    """The controller as discretised with `ratio` times the sample time, with hold or by Tustin's rule, where it can be."""
    E, F, G, H = controller
    n, m = F.shape
    if not n:
        return
    both = np.block([[E, F], [np.zeros((m, n)), np.eye(m)]])
    if np.all(np.abs(poles_of(E)) > 1e-6):
        power = np.asarray(scipy.linalg.fractional_matrix_power(both, ratio), dtype=complex)
        if np.all(np.isfinite(power)) and np.abs(np.imag(power)).max() < 1e-8 * np.abs(power).max():
            yield StateMatrices(np.real(power)[:n, :n], np.real(power)[:n, n:], G, H)
    if np.all(np.abs(poles_of(E) + 1) > 1e-6):
        image = bilinear_in_s(controller, 1.0)
        if np.all(np.abs(poles_of(image.A) - 2 / ratio) > 1e-6):
            yield bilinear_in_z(image, ratio)


def controller_output(controller: StateMatrices, y: Real, *, periodic: bool) -> Real:
    """C y from zero initial conditions, or in periodic steady state, where the mean of an integrator is 0.

    InputError: a controller with a pole beyond the unit circle.
    """
    poles = poles_of(controller.A)
    if not periodic:
        if np.abs(poles).max(initial=0.0) > 1 + _EDGE:
            raise InputError(
                "`record` needs its reference: the controller is not stable, and noise of y would grow in C y"
            )
        return simulate(controller, y)[0]
    lines = np.fft.rfft(y, axis=0)
    points = np.exp(2j * np.pi * np.arange(len(lines)) / len(y))
    near = np.any(np.abs(points[:, None] - poles) < _EDGE, axis=1)
    answers = np.zeros((len(lines), len(controller.C)), dtype=complex)
    answers[~near] = (response_at(controller, points[~near]) @ lines[~near, :, None])[:, :, 0]
    return np.asarray(np.fft.irfft(answers, len(y), axis=0), dtype=float)


def opened_by(M: Complex, back: Complex, nu: int, of: str) -> tuple[Complex, Complex, Complex]:
    """Left, own and right at each frequency, so that R is ``left (G right - own)`` of a response G of `OPENED`."""
    numerator, denominator = (M[:, :nu, nu:], back[:, :nu, nu:]), (M[:, nu:, nu:], back[:, :nu, :nu])
    if of == "sensitivity":
        right = _undone(numerator[1], columns=False)
        return -_inverse(denominator[0]), denominator[0] @ back[:, nu:, nu:] @ right, right
    right = _inverse(denominator[1])
    if of == "y":
        return _inverse(denominator[0]), M[:, nu:, :nu], right
    return _undone(numerator[0], columns=True), M[:, :nu, :nu], right


def _inverse(factor: Complex) -> Complex:
    return np.asarray(np.linalg.inv(factor), dtype=np.complex128)


def _undone(factor: Complex, *, columns: bool) -> Complex:
    """The inverse of a factor of the controller at each frequency: of all that enters it, or that leaves it."""
    levels: Real = np.asarray(np.linalg.svd(factor, compute_uv=False), dtype=float)
    enough = factor.shape[1] >= factor.shape[2] if columns else factor.shape[1] <= factor.shape[2]
    if not enough or np.any(levels[:, -1] <= _BLIND * np.max(levels)):
        raise InputError(
            "`frf` must tell R, and what the controller does not pass on is not in it: at some frequency it has no gain, or it has"
            ' other numbers of inputs and outputs. Give the response from r to y, of="y"'
        )
    return np.asarray(np.linalg.pinv(factor), dtype=np.complex128)
