"""Faults of the catalogue in records: samples, tones, drifts, excitation, clocks, feedback."""

import numpy as np
import scipy.signal

from support.fault_catalogue import Faulty, changed, fault, first, output
from support.fault_plants import answer

# --- samples of one signal ------------------------------------------------------------------------------------------------------


@fault("spike", "periodic random", "spike", (8.0, 0.5, 0.01))
def _spike(clean, given, size, rng):
    """One sample, so many times the largest value off."""
    at = int(rng.integers(len(given[0].y) // 4, 3 * len(given[0].y) // 4))
    return first(given, lambda r: output(r, lambda y: y + size * np.abs(y).max() * (np.arange(y.size) == at)))


@fault("spikes", "periodic random", "spike", (3.0, 0.4, 0.005))
def _spikes(clean, given, size, rng):
    """One sample in 500."""

    def struck(y):
        at = rng.choice(y.size, max(y.size // 500, 2), replace=False)
        y = y.copy()
        y[at] += size * np.abs(y).max() * rng.choice([-1, 1], at.size)
        return y

    return first(given, lambda r: output(r, struck))


@fault("wrap-around", "periodic random", "wrapped", (0.7, 0.97, 2.0))
def _wrapped(clean, given, size, rng):
    """Two's complement: beyond so much of the largest value about the mean, the other end of the range."""

    def turned(y):
        centre = y.mean()
        range_ = size * np.abs(y - centre).max()
        return (y - centre + range_) % (2 * range_) - range_ + centre

    return [output(r, turned) for r in given]


@fault("saturated output", "periodic random", "saturated", (0.6, 0.97, 2.0))
def _saturated(clean, given, size, rng):
    def clipped(y):
        centre, range_ = y.mean(), size * np.abs(y - y.mean()).max()
        return np.clip(y, centre - range_, centre + range_)

    return [output(r, clipped) for r in given]


@fault("stuck sensor", "periodic random", "stuck", (120, 22, 2))
def _stuck(clean, given, size, rng):
    """The output keeps its value for so many samples."""

    def kept(y):
        start = int(rng.integers(y.size // 4, y.size // 2))
        y = y.copy()
        y[start : start + size] = y[start]
        return y

    return first(given, lambda r: output(r, kept))


@fault("zeros", "periodic random", "lost samples, stuck", (60, 6, None))
def _zeros(clean, given, size, rng):
    """Packets that never came, filled with zeros: ten of so many samples."""

    def filled(y):
        y = y.copy() + 3 * y.std()
        for start in rng.choice(y.size // 100 - 1, 10, replace=False) * 100:
            y[start : start + size] = 0
        return y

    return first(given, lambda r: output(r, filled))


@fault("held samples", "periodic random", "lost samples, stuck", (30, 4, None))
def _held(clean, given, size, rng):
    """Packets that never came, filled with the last value: twenty of so many samples."""

    def filled(y):
        y = y.copy()
        for start in rng.choice(np.arange(1, y.size // 100 - 1), 20, replace=False) * 100:
            y[start : start + size] = y[start - 1]
        return y

    return first(given, lambda r: output(r, filled))


@fault("output of a lower rate", "periodic random", "held", (5, 2, None))
def _slower(clean, given, size, rng):
    """An output taken at one of so many samples, and held."""
    return [output(r, lambda y: np.repeat(y[::size], size)[: y.size]) for r in given]


@fault("lost packet", "periodic random", "lost samples, late, wrong period", (25, 2, None))
def _dropped(clean, given, size, rng):
    """Output samples that are missing in the middle of the record: what follows comes early."""

    def short(y):
        at = y.size // 2
        return np.concatenate([y[:at], y[at + size :], y[at - size : at]])

    return first(given, lambda r: output(r, short))


@fault("coarse quantiser", "periodic random", "quantised", (6, 60, 2000))
def _quantised(clean, given, size, rng):
    """So many steps over the range."""
    return [output(r, lambda y: np.round(y * size / np.ptp(y)) * np.ptp(y) / size) for r in given]


@fault("dead channel", "periodic random", "constant", (0.0, None, None))
def _dead(clean, given, size, rng):
    return [output(r, lambda y: 0 * y + 1.3) for r in given]


@fault("unstable plant", "random", "unstable", (12.0, 5.0, None))
def _unstable(clean, given, size, rng):
    """An oscillation that the input moves, and that grows by exp(size) over the record, where nothing holds the plant."""
    angle = float(np.exp(rng.uniform(*np.log([0.02, 0.5]))))

    def grown(r):
        pole = np.exp(size / len(r.u) + 1j * angle)
        drive = r.u[:, 0] / r.u[:, 0].std()
        more = scipy.signal.lfilter([0.0, 0.1], np.poly([pole, pole.conj()]).real, drive)
        return output(r, lambda y: y + y.std() * more)

    return [grown(r) for r in given]


@fault("noise of an open input", "periodic random", "no response", (0.0, 0.02, None))
def _open(clean, given, size, rng):
    """A sensor that is not connected: noise of the usual level, and so much of the answer."""
    return [output(r, lambda y: size * y + y.std() * rng.standard_normal(y.size)) for r in given]


@fault("clipped input", "periodic", "saturated, noisy input", (0.6, 0.97, 2.0))
def _clipped_input(clean, given, size, rng):
    """An amplifier at its end: the measured input is clipped, what was played is not."""
    if clean.plant is None:
        return None
    found = []
    for one in given:
        u = np.clip(one.u, -size * np.abs(one.u).max(), size * np.abs(one.u).max())
        y = answer(clean.plant, np.tile(u, (2, 1)))[len(u) :]
        y = y + clean.noise * rng.standard_normal(y.shape)
        found.append(changed(one, u=u, y=y, reference=one.u))
    return found


# --- tones, drifts, operating points --------------------------------------------------------------------------------------------


def _tone(clean, hz, size, harmonics=(1.0,)):
    def added(one):
        t = one.dt * np.arange(len(one.y))
        wave = sum(a * np.sin(2 * np.pi * hz * (k + 1) * t + k) for k, a in enumerate(harmonics))
        return output(one, lambda y: y + size * y.std() * wave)

    return added


def _tone_hz(clean, synchronous):
    """A frequency inside the band, whole multiples of the line spacing or not."""
    line = 1 / (clean.period * clean.dt)
    middle = round(0.35 * clean.response.freq_hz[-1] / line) * line
    return middle if synchronous else middle + 0.37 * line


@fault("hum", "periodic random", "tone", (0.5, 0.02, 1e-4))
def _hum(clean, given, size, rng):
    return [_tone(clean, _tone_hz(clean, False), size, (1.0, 0.3, 0.5))(r) for r in given]


@fault("synchronous hum", "periodic", "tone, outlier", (0.5, 0.03, 1e-4))
def _synchronous_hum(clean, given, size, rng):
    """Periodic with the excitation, the same phase in all periods."""
    return [_tone(clean, _tone_hz(clean, True), size)(r) for r in given]


@fault("hum between the lines", "periodic", "tone", (0.5, 0.02, 1e-4))
def _between(clean, given, size, rng):
    """Beside the band of the excitation, as an aliased tone is."""
    top = clean.response.freq_hz[-1]
    return [_tone(clean, min(1.2 * top, 0.45 / clean.dt), size)(r) for r in given]


@fault("drift", "periodic random", "drift, offset", (3.0, 0.3, 1e-3))
def _drifting(clean, given, size, rng):
    return [output(r, lambda y: y + size * y.std() * np.linspace(-1, 1, y.size)) for r in given]


@fault("jump of the level", "periodic random", "offset, jump", (4.0, 0.3, 1e-3))
def _level(clean, given, size, rng):
    """A sensor that slipped in the middle."""
    return first(given, lambda r: output(r, lambda y: y + size * y.std() * (np.arange(y.size) > 0.45 * y.size)))


@fault("operating point", "random", "offset", (20.0, 1.0, 0.01), ("detrend",))
def _operating(clean, given, size, rng):
    """Input and output about a point of operation from which nothing is counted."""
    if clean.plant is None:
        return None
    return [changed(r, u=r.u + size, y=r.y + 0.7 * size * r.y.std(), initial="rest") for r in given]


@fault("transient", "periodic", "transient", (1.0, 0.1, 0.0))
def _transient(clean, given, size, rng):
    """Recorded from rest and called periodic: so much of the first period is the transient's."""
    if clean.plant is None:
        return None
    found = []
    for one in given:
        settled = answer(clean.plant, np.tile(one.u, (2, 1)))
        begun = settled[: len(one.u)] - settled[len(one.u) :]
        found.append(changed(one, y=one.y + size * begun))
    return found


# --- excitation, clocks, channels -----------------------------------------------------------------------------------------------


@fault("wrong period", "periodic", "wrong period", (0.9, 0.998, None))
def _wrong_period(clean, given, size, rng):
    return Faulty(tuple(changed(r, initial="free") for r in given), int(size * clean.period))


@fault("unstated period", "periodic", "unstated period", (0.0, None, None))
def _unstated(clean, given, size, rng):
    return Faulty(tuple(changed(r, initial="free") for r in given), None)


@fault("noisy input", "periodic", "noisy input", (0.3, 0.05, 1e-4))
def _noisy_input(clean, given, size, rng):
    return [changed(r, u=r.u + size * r.u.std() * rng.standard_normal(r.u.shape)) for r in given]


@fault("exchanged columns", "periodic random", "exchanged, feedback", (0.0, None, None), ("exchange",))
def _columns(clean, given, size, rng):
    return None if given[0].y.shape[1] > 1 else [changed(r, u=r.y, y=r.u) for r in given]


@fault("late channel", "periodic random", "late", (40, 3, None), ("advance", "delay"))
def _late(clean, given, size, rng):
    """One output comes late by so many samples."""
    return [_shifted(r, size) for r in given]


@fault("early channel", "periodic random", "late", (10, 2, None), ("delay", "advance"))
def _early(clean, given, size, rng):
    """One output comes before its input: no causal plant does."""
    return [_shifted(r, -size) for r in given]


def _shifted(one, late):
    """The first output later than the others: round the ends of a periodic record, else of a part of the record."""
    moved = output(one, lambda y: np.roll(y, late))
    if one.initial == "periodic":
        return moved
    kept = slice(max(late, 0), len(one.u) + min(late, 0))
    return changed(moved, u=moved.u[kept], y=moved.y[kept])


@fault("clocks apart", "periodic random", "clock, varying", (1e-3, 1e-4, 1e-7))
def _clocks(clean, given, size, rng):
    """The output is sampled by another clock, so much slower."""

    def resampled(y):
        at = np.arange(y.size) * (1 - size)
        return np.interp(at, np.arange(y.size), y)

    return [output(r, resampled) for r in given]


@fault("jitter", "periodic random", "jitter, noisy, distorted", (1.0, 0.1, 1e-3))
def _jitter(clean, given, size, rng):
    """Sample instants off by so much of a sample, rms."""

    def shaken(y):
        at = np.arange(y.size) + size * rng.standard_normal(y.size)
        return np.interp(at, np.arange(y.size), y)

    return [output(r, shaken) for r in given]


@fault("feedback without reference", "periodic random", "feedback", (1.0, 0.2, 0.0))
def _feedback(clean, given, size, rng):
    """The loop is closed by a gain, noise in it, and the input is what was measured."""
    if clean.plant is None or clean.plant.ninputs > 1:
        return None
    peak = np.abs(clean.response.values).max()
    gain, (A, B, C) = size * 0.5 / peak, (np.asarray(getattr(clean.plant, name)) for name in "ABC")
    level = 5 * clean.noise
    found = []
    for one in given:
        r, x = np.tile(one.u, (2, 1)).ravel(), np.zeros(len(A))
        e = scipy.signal.lfilter([1.0], [1.0, -0.9], level * rng.standard_normal(r.size))
        u, y = np.empty(r.size), np.empty(r.size)
        for k in range(r.size):
            y[k] = C[0] @ x + e[k]
            u[k] = r[k] - gain * y[k]
            x = A @ x + B[:, 0] * u[k]
        half = len(one.u)
        found.append(changed(one, u=u[half:], y=y[half:], initial="periodic" if one.initial == "periodic" else "free"))
    return found
