"""Excitations to play: multisines with chosen spectral lines and small crest factor, orthogonal over the inputs."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from robustid.core import Frozen, Progress, Savable, as_array, as_count, as_flag, as_positive, counted, freeze, hz_span
from robustid.data.multisines import chosen_lines, given_lines, low_crest_phases, random_phases, synthesise
from robustid.errors import InputError

Spectrum = ArrayLike | Callable[[np.ndarray], ArrayLike]


@dataclasses.dataclass(frozen=True, eq=False)
class Excitation(Frozen, Savable):
    """Periodic signals to play: one period of every input in every experiment.

    Parameters
    ----------
    u : (E, N, nu) array
        Experiments, samples of one period, inputs; sample instants `dt` apart, held in between. With nu inputs, each nu
        experiments in a row make one realisation.
    dt : float
        Sample time in s.
    lines : (F,) array of int
        Excited spectral lines k of the DFT, at ``k/(N*dt)`` Hz: what `estimate_frf` takes as its `lines`.
    periods : int
        How often `signal` and the saved file repeat the period.
    seed : int
        Of the random phases, to make the same again.

    Examples
    --------
    >>> from robustid.data import multisine
    >>> multisine(band_hz=(1, 50), period=1000, dt=0.001, inputs=2)
    <Excitation: 2 experiments, 2 inputs, 50 spectral lines from 1 to 50 Hz, 1 x 1000 samples, dt=0.001 s>
    """

    u: np.ndarray
    _: dataclasses.KW_ONLY
    dt: float
    lines: np.ndarray
    periods: int = 1
    seed: int = 0

    def __post_init__(self) -> None:
        u = as_array("u", self.u, ndim=3)
        if 0 in u.shape or u.shape[0] % u.shape[2]:
            raise InputError(
                "`u` must have shape (experiments, samples, inputs), with a multiple of `inputs` experiments; got"
                f" {u.shape}"
            )
        self._set(
            u=freeze(u),
            dt=as_positive("dt", self.dt),
            lines=freeze(given_lines(self.lines, u.shape[1])),
            periods=as_count("periods", self.periods, least=1),
            seed=as_count("seed", self.seed),
        )

    def __repr__(self) -> str:
        experiments, period, inputs = self.u.shape
        band = f"{counted(self.lines.size, 'spectral line')} from {hz_span(self.freq_hz[0], self.freq_hz[-1], 4)}"
        return (
            f"<Excitation: {counted(experiments, 'experiment')}, {counted(inputs, 'input')}, {band},"
            f" {self.periods} x {period} samples, dt={self.dt:.6g} s>"
        )

    @property
    def period(self) -> int:
        """Samples of one period: what `estimate_frf` takes as its `period`."""
        return self.u.shape[1]

    @property
    def freq_hz(self) -> np.ndarray:
        """Frequencies of the lines in Hz, (F,)."""
        return self.lines / (self.period * self.dt)

    @property
    def rms(self) -> np.ndarray:
        """Root mean square of every signal, (E, nu); the same in all experiments."""
        return np.sqrt(np.mean(self.u**2, axis=1))

    @property
    def crest_factors(self) -> np.ndarray:
        """Largest |u| over rms of every signal, (E, nu), of the samples."""
        return np.abs(self.u).max(axis=1) / self.rms

    def signal(self, experiment: int) -> np.ndarray:
        """Input signals of one experiment: (periods*period, nu)."""
        if not 0 <= as_count("experiment", experiment) < len(self.u):
            raise InputError(f"`experiment` must be from 0 to {len(self.u) - 1}; got {experiment}")
        return np.tile(self.u[experiment], (self.periods, 1))


def multisine(
    *,
    period: int,
    dt: float,
    band_hz: Sequence[float] | None = None,
    lines: ArrayLike | None = None,
    spacing: str = "all",
    lines_per_decade: int = 20,
    spectrum: Spectrum | None = None,
    inputs: int = 1,
    realisations: int = 1,
    periods: int = 1,
    amplitude: ArrayLike | None = None,
    rms: ArrayLike | None = None,
    minimise_crest: bool = True,
    seed: int = 0,
    progress: Progress | None = None,
) -> Excitation:
    """Design random-phase multisines: chosen spectral lines only, small crest factor, orthogonal over the inputs.

    ``u_i(n) = sum_k A_ik cos(2 pi k n/period + phi_ik + theta_ie)`` in experiment e = 1..nu, with random phases phi and
    ``exp(j theta)`` a Hadamard matrix (nu = 1, 2, 4, 8, ...) or the DFT matrix: at every line the nu x nu matrix of
    spectra is ``diag(A_ik/2 exp(j phi_ik))`` times sqrt(nu) times a unitary matrix.

    Parameters
    ----------
    period : int
        Samples of one period; the spectral lines are 1/(period*dt) Hz apart.
    dt : float
        Sample time in s.
    band_hz : (low, high), optional
        Lines between these frequencies in Hz, edges included. This or `lines`.
    lines : sequence of int, optional
        Spectral lines of the DFT, ascending, between 0 and period/2, both excluded.
    spacing : {"all", "odd", "random-odd", "log"}
        Spectral lines in the band: all; the odd ones, so that even nonlinear distortion falls between them; the odd ones
        with one in every four left out at random, where odd distortion shows; or the nearest to equal spacing on a
        logarithmic axis.
    lines_per_decade : int
        For ``spacing="log"``.
    spectrum : (F,) or (F, nu) array, or callable, optional
        Relative amplitudes of the lines, positive; a callable is given the frequencies (F,) in Hz. Default: flat.
    inputs : int
        Number of inputs nu. There are as many experiments in every realisation.
    realisations : int
        Sets of nu experiments with other random phases, to see nonlinear distortion.
    periods : int
        To play in every experiment; have one or more to spare, for the transient.
    amplitude : float or (nu,) array, optional
        Largest |u| of every input over all experiments; default 1.
    rms : float or (nu,) array, optional
        Root mean square of every input, in place of `amplitude`.
    minimise_crest : bool
        False keeps the phases purely random (almost Gaussian signals, crest factors of 3 to 4).
    seed : int
        Seed of the phases and of the lines left out. More realisations with the same seed keep the first ones, up to scale.
    progress : callable (text, done, count), optional
        Told how many signals of how many have their phases.

    Returns
    -------
    Excitation
        With `u`, `lines`, `period`, `crest_factors`, `.signal(experiment)` and `.save("play.csv")`.

    Raises
    ------
    InputError
        No line in the band, lines at 0 or Nyquist or beyond, wrong shapes, both or neither of two alternatives.

    Notes
    -----
    Crest factors are of the samples, which is what a zero-order hold plays. For many flat lines, all or odd: about 1.4 with
    1, 2, 4, 8, ... inputs, where the experiments differ in signs only; 1.6 with other numbers, where a few rotations of
    the same phases must be small together; above 2 with logarithmic spacing. Never worse than Schroeder's phases.

    White noise of standard deviation sigma on an output, F flat lines and P periods leave a standard deviation of
    ``sigma/rms sqrt(2 F/(nu P period))`` on every entry of the response: fewer lines or more samples, smaller errors.

    Assumes nothing on the plant. Source: `dobrowiecki2006` (orthogonal sets), `guillaume1991` (crest factor),
    `pintelon2012` (chapters 2 to 4: lines and realisations).

    Examples
    --------
    >>> import numpy as np
    >>> from robustid.data import multisine
    >>> play = multisine(band_hz=(1, 31), period=1000, dt=0.001, inputs=2, realisations=3, amplitude=[0.5, 2.0])
    >>> play.u.shape, np.abs(play.u).max(axis=(0, 1))
    ((6, 1000, 2), array([0.5, 2. ]))
    >>> bool(np.all(play.crest_factors < 1.5))
    True
    """
    dt, period = as_positive("dt", dt), as_count("period", period, least=3)
    nu, count = as_count("inputs", inputs, least=1), as_count("realisations", realisations, least=1)
    seed, minimise_crest = as_count("seed", seed), as_flag("minimise_crest", minimise_crest)
    chosen = chosen_lines(band_hz, lines, spacing, lines_per_decade, period, dt, seed)
    shape = _spectrum(spectrum, chosen / (period * dt), nu)
    if amplitude is not None and rms is not None:
        raise InputError("`amplitude` and `rms` both set the size of the signals; give one of them")
    given = ("amplitude", 1.0 if amplitude is None else amplitude) if rms is None else ("rms", rms)
    size = _per_input(*given, nu)
    angles = _rotations(nu)
    u = np.empty((count, nu, period, nu))  # realisation, experiment, sample, input
    words = "choosing phases" + " for a small crest factor" * minimise_crest
    if progress is not None:
        progress(words, 0, 0)
    for i in range(nu):
        turns = np.unique(np.round(angles[:, i] % np.pi, 9))  # a sign leaves the peak as it is
        for realisation in range(count):
            if progress is not None:
                progress(words, i * count + realisation, nu * count)
            rng = np.random.default_rng([seed, 1, realisation, i])
            if minimise_crest:
                phases = low_crest_phases(rng, shape[:, i], chosen, period, turns)
            else:
                phases = random_phases(rng, chosen.size)
            u[realisation, :, :, i] = synthesise(phases + angles[:, i, None], shape[:, i], chosen, period)
    if rms is None:
        u *= size / np.abs(u).max(axis=(0, 1, 2))
    else:
        u *= size / np.sqrt(0.5 * np.sum(shape**2, axis=0))
    return Excitation(u.reshape(-1, period, nu), dt=dt, lines=chosen, periods=periods, seed=seed)


def _rotations(nu: int) -> np.ndarray:
    """Angles of an nu x nu matrix with entries of modulus 1 and orthogonal rows: (experiment, input)."""
    if nu & (nu - 1) == 0:
        from scipy.linalg import hadamard

        return np.where(hadamard(nu) > 0, 0.0, np.pi)
    return 2 * np.pi * (np.outer(np.arange(nu), np.arange(nu)) % nu) / nu


def _spectrum(spectrum: Spectrum | None, freq_hz: np.ndarray, nu: int) -> np.ndarray:
    """Relative amplitudes (F, nu), the largest of every input 1."""
    if spectrum is None:
        return np.ones((freq_hz.size, nu))
    values = as_array("spectrum", spectrum(freq_hz) if callable(spectrum) else spectrum)
    if values.shape not in ((freq_hz.size,), (freq_hz.size, nu)):
        raise InputError(
            f"`spectrum` must have shape (F,) or (F, inputs) with F = {freq_hz.size} spectral lines; got {values.shape}"
        )
    if np.any(values <= 0):
        raise InputError(
            f"`spectrum` must be positive; got {values.min():g}. Leave spectral lines without excitation out of `lines`"
        )
    values = values.reshape(freq_hz.size, -1)
    return np.broadcast_to(values / values.max(axis=0), (freq_hz.size, nu))


def _per_input(name: str, value: ArrayLike, nu: int) -> np.ndarray:
    array = as_array(name, value)
    if array.shape not in ((), (nu,)):
        raise InputError(f"`{name}` must be one number or one for each of {nu} inputs; got shape {array.shape}")
    if np.any(array <= 0):
        raise InputError(f"`{name}` must be positive; got {array.min():g}")
    return np.broadcast_to(array, (nu,))
