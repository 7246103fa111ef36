"""A simulated experiment whose truth is known."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from robustid.core import Frozen, as_array, as_count, as_positive, freeze
from robustid.data.frequency_response import FrequencyResponse
from robustid.data.time_record import TimeRecord
from robustid.errors import InputError

if TYPE_CHECKING:
    import control

# frequency [Hz] and damping ratio of each mode
_MODES = ((9.0, 0.1), (17.67, 0.004))
# Static gain of each mode at each output. The modes are orthogonal in the masses, m1 g11 g12 + m2 g21 g22 = 0: at the first
# mass, about 100 times the second here, the light mode all but vanishes.
_GAINS = {"y1": (0.9605, -0.0005), "y2": (0.9, 0.0594)}


@dataclasses.dataclass(frozen=True, eq=False)
class SimulatedExperiment(Frozen):
    """Measurements of a simulated plant, and the plant.

    Parameters
    ----------
    frequency : FrequencyResponse
        Samples of the frequency response with their bound.
    time : TimeRecord
        Step response with its bound.
    truth : control.StateSpace
        The discrete-time plant; every sample lies within its bound of it.
    modes : (n, 2) array
        Natural frequency in rad/s and damping ratio of each mode.
    """

    frequency: FrequencyResponse
    time: TimeRecord
    truth: control.StateSpace
    modes: np.ndarray

    def __post_init__(self) -> None:
        self._set(modes=freeze(as_array("modes", self.modes, ndim=2)))


def flexible_structure(
    *,
    seed: int = 0,
    lines: int = 11,
    samples: int = 20,
    bound: float = 0.03,
    dt: float = 0.01,
    extra_hz: Sequence[float] = (),
    output: str = "y2",
) -> SimulatedExperiment:
    """Simulate step and frequency data of a mass–beam structure with two modes, one very lightly damped.

    ``G(s) = Σ_i g_i w_i² / (s² + 2 d_i w_i s + w_i²)`` behind a zero-order hold: modes at 9 Hz (d = 0.1,
    static gain g = 0.9) and 17.67 Hz (d = 0.004, g = 0.0594). These give a static gain of 0.96 and, with
    `dt` = 0.01, a peak of 7.1 at the light mode. That is the second mass; at the first one (`output` = "y1", g = 0.9605 and
    -0.0005) the light mode reaches 0.06 and is next to invisible.

    Parameters
    ----------
    seed : int
        Of the measurement errors. The same seed gives the same errors of step and frequency points, whatever `extra_hz`.
    lines : int
        Number of frequencies, equally spaced from 1 to 21 Hz (11: every 2 Hz).
    samples : int
        Length of the step response, unit step from zero initial conditions.
    bound : float
        Bound on the errors in mm/N (frequency: uniform in the disc) and mm (time: uniform in the interval).
    dt : float
        Sample time in s.
    extra_hz : sequence of float
        Further frequencies in Hz, such as a fine grid around the light mode.
    output : {"y1", "y2"}
        The mass whose displacement is measured.

    Returns
    -------
    SimulatedExperiment
        With `frequency`, `time`, `truth` and `modes`.

    Raises
    ------
    InputError
        Counts below 1, bound or dt not positive, a frequency above the Nyquist frequency, another output.

    Notes
    -----
    Frequencies, data and the light damping follow the experiment of `inanc2001`; the damping of the first
    mode and the gains are chosen here. Assumes zero initial conditions.

    Examples
    --------
    >>> from robustid.data import flexible_structure
    >>> experiment = flexible_structure()
    >>> experiment.frequency.freq_hz
    array([ 1.,  3.,  5.,  7.,  9., 11., 13., 15., 17., 19., 21.])
    >>> experiment.truth.nstates
    4
    """
    import control

    dt, bound = as_positive("dt", dt), as_positive("bound", bound)
    lines, samples = as_count("lines", lines, least=1), as_count("samples", samples, least=1)
    extra = as_array("extra_hz", extra_hz, ndim=1)
    hz = np.concatenate([np.linspace(1.0, 21.0, lines), extra])
    if hz.max() * dt > 0.5:
        raise InputError(f"`dt` = {dt:g} s allows frequencies up to {0.5 / dt:g} Hz; got {hz.max():g} Hz")
    if output not in _GAINS:
        raise InputError(f"`output` must be one of {tuple(_GAINS)}; got {output!r}")
    omega = 2 * np.pi * hz
    truth = _plant(dt, _GAINS[output])
    rng = np.random.default_rng(seed)
    errors = rng.uniform(-bound, bound, samples)
    y = control.step_response(truth, dt * np.arange(samples)).y[0, 0] if samples > 1 else np.zeros(1)
    radius, angle = np.sqrt(rng.uniform(size=lines)), rng.uniform(0, 2 * np.pi, lines)
    radius = np.concatenate([radius, np.sqrt(rng.uniform(size=extra.size))])
    angle = np.concatenate([angle, rng.uniform(0, 2 * np.pi, extra.size)])
    # A hair inside: rounding must not put a sample of the truth outside its disc.
    disc = (1 - 1e-9) * bound * radius * np.exp(1j * angle)
    values = truth(np.exp(1j * omega * dt))
    inputs, outputs = [("force", "N")], [("displacement", "mm")]
    note = "simulated errors, uniform within the bound"
    return SimulatedExperiment(
        frequency=FrequencyResponse(
            omega, values + disc, bound=bound, dt=dt, note=note, inputs=inputs, outputs=outputs
        ),
        time=TimeRecord(
            np.ones(samples), y + (1 - 1e-9) * errors, bound=bound, dt=dt, note=note, inputs=inputs, outputs=outputs
        ),
        truth=truth,
        modes=np.array([(2 * np.pi * f, d) for f, d in _MODES]),
    )


def _plant(dt: float, gains: tuple[float, ...]) -> control.StateSpace:
    import control

    a, b, c = np.zeros((4, 4)), np.zeros((4, 1)), np.zeros((1, 4))
    for k, ((hz, damping), gain) in enumerate(zip(_MODES, gains, strict=True)):
        w, i = 2 * np.pi * hz, 2 * k
        # States scaled to displacement and velocity/w: entries of one size.
        a[i : i + 2, i : i + 2] = [[0, w], [-w, -2 * damping * w]]
        b[i + 1, 0] = w
        c[0, i] = gain
    names = {"inputs": ["force"], "outputs": ["displacement"], "name": "flexible structure"}
    return control.ss(control.c2d(control.ss(a, b, c, 0), dt, "zoh"), **names)
