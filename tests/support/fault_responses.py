"""Faults of the catalogue in responses, and in a record of a step beside a response."""

import dataclasses

import numpy as np

import robustid as rid
from support.fault_catalogue import changed, fault
from support.fault_plants import recipes, step


def valued(frf, values):
    return dataclasses.replace(frf, values=values, covariance=None)


# --- responses ------------------------------------------------------------------------------------------------------------------


@fault("phase with the wrong sign", "response", "phase sign", (0.0, None, None), ("conjugate",))
def _conjugate(clean, frf, size, rng):
    return valued(frf, frf.values.conj())


@fault("degrees read as radians", "response", "phase unit", (0.0, None, None))
def _degrees(clean, frf, size, rng):
    return valued(frf, np.abs(frf.values) * np.exp(1j * np.degrees(np.angle(frf.values))))


@fault("radians read as degrees", "response", "phase unit", (0.0, None, None), ("phase in radians",))
def _radians(clean, frf, size, rng):
    return valued(frf, np.abs(frf.values) * np.exp(1j * np.radians(np.angle(frf.values))))


@fault("decibels read as numbers", "response", "magnitude unit", (0.0, None, None), ("magnitude in dB",))
def _decibels(clean, frf, size, rng):
    values = 20 * np.log10(np.abs(frf.values) / np.abs(frf.values).min()) + 1
    return dataclasses.replace(valued(frf, values * np.exp(1j * np.angle(frf.values))), bound=0.01 * values)


@fault("numbers read as decibels", "response", "magnitude unit", (0.0, None, None), ("magnitude linear",))
def _linear(clean, frf, size, rng):
    values = 10 ** (np.abs(frf.values) / np.abs(frf.values).max())
    return dataclasses.replace(valued(frf, values * np.exp(1j * np.angle(frf.values))), bound=0.01 * values)


@fault("inverse", "response", "exchanged", (0.0, None, None), ("exchange",))
def _inverse(clean, frf, size, rng):
    if frf.values[0].size > 1:
        return None
    return dataclasses.replace(valued(frf, 1 / frf.values), bound=frf.bound.outer_radius / np.abs(frf.values) ** 2)


@fault("Hz read as rad/s", "response", "frequency unit", (0.0, None, None), ("frequency in Hz",))
def _hz(clean, frf, size, rng):
    return dataclasses.replace(frf, omega=frf.freq_hz)


@fault("rad/s read as Hz", "response", "frequency unit", (0.0, None, None), ("frequency in rad/s",))
def _rad(clean, frf, size, rng):
    inside = 2 * np.pi * frf.omega * clean.dt <= np.pi
    if inside.sum() < 16:
        return None
    part = frf.select(inside)
    return dataclasses.replace(part, omega=2 * np.pi * part.omega)


@fault("one line off", "response", "outlier", (0.5, 0.05, 1e-4), ("leave out",))
def _outlier(clean, frf, size, rng):
    """One line so much too large, in part of the response; where that is more than its bound, if it is so at one in five lines."""
    inside = np.arange(frf.omega.size // 5, 4 * frf.omega.size // 5)
    beyond = (size * np.abs(frf.values) / frf.bound.outer_radius).max(axis=(1, 2))[inside] > 2
    inside = inside[beyond] if beyond.mean() > 0.2 else inside
    at = int(rng.choice(inside))
    values = frf.values.copy()
    values[at] += size * np.abs(values[at])
    return valued(frf, values)


@fault("three lines off", "response", "outlier", (0.5, 0.05, 1e-4), ("leave out",))
def _outliers(clean, frf, size, rng):
    at = rng.choice(np.arange(2, frf.omega.size - 2, 7), 3, replace=False)
    values = frf.values.copy()
    values[at] *= 1 + size * np.exp(2j * np.pi * rng.random((3, *values.shape[1:])))
    return valued(frf, values)


@fault("one entry of a line off", "response", "outlier", (0.5, 0.1, 1e-4), ("leave out",))
def _outlying_entry(clean, frf, size, rng):
    if frf.values[0].size == 1:
        return None
    at, values = int(rng.integers(frf.omega.size // 5, 4 * frf.omega.size // 5)), frf.values.copy()
    values[at, 0, -1] += size * np.abs(values[:, 0, -1]).mean()
    return valued(frf, values)


@fault("a line far off", "response", "outlier", (50.0, None, None), ("leave out",))
def _far(clean, frf, size, rng):
    values = frf.values.copy()
    values[frf.omega.size // 3] *= size
    return valued(frf, values)


@fault("mains in the response", "response", "outlier, tone", (1.0, 0.1, 1e-4), ("leave out",))
def _mains(clean, frf, size, rng):
    """The line at a third of the band and its odd multiples, with an amplitude that doesn't depend on the plant."""
    base = frf.omega[-1] / 7.3
    at = np.unique([int(np.argmin(np.abs(frf.omega - k * base))) for k in (1, 3, 5)])
    values = frf.values.copy()
    values[at] += size * np.median(np.abs(values)) * np.exp(2j * np.pi * rng.random((at.size, 1, 1)))
    return valued(frf, values)


@fault("seam", "response", "seam", (1.3, 1.05, 1.0001))
def _seam(clean, frf, size, rng):
    """Two sweeps joined, the upper one with another gain."""
    values = frf.values.copy()
    values[frf.omega.size // 2 :] *= size
    return valued(frf, values)


@fault("seam of the phase", "response", "seam", (0.5, 0.03, 1e-5))
def _phase_seam(clean, frf, size, rng):
    """The upper sweep with another delay, so many rad at the seam."""
    values, half = frf.values.copy(), frf.omega.size // 2
    values[half:] *= np.exp(-1j * size * frf.omega[half:] / frf.omega[half])[:, None, None]
    return valued(frf, values)


@fault("bound too small", "response", "small bound", (0.03, 0.4, 1.0), ("bound times",))
def _small_bound(clean, frf, size, rng):
    return dataclasses.replace(frf, bound=size * frf.bound.outer_radius)


@fault("values that are zeros", "response", "outlier, not finite", (5, 1, None), ("leave out",))
def _zero_lines(clean, frf, size, rng):
    """Lines that were not measured, filled with zeros."""
    values = frf.values.copy()
    values[rng.choice(frf.omega.size, size, replace=False)] = 0
    return valued(frf, values)


@fault("beyond the excitation", "response", "noise only", (1.5, None, None), ("leave out",))
def _beyond(clean, frf, size, rng):
    """Lines that nothing excited: numbers of any size, with bounds that are as small as those of the others."""
    top, step_ = frf.omega[-1], float(np.median(np.diff(frf.omega)))
    more = np.arange(top + step_, min(size * top, np.pi / clean.dt), step_)
    if more.size < 8:
        return None
    level = np.median(np.abs(frf.values), axis=0)
    noise = level * (
        rng.standard_normal((more.size, *level.shape)) + 1j * rng.standard_normal((more.size, *level.shape))
    )
    radius = frf.bound.outer_radius
    bound = np.concatenate([radius, np.broadcast_to(np.median(radius, axis=0), noise.shape)])
    return rid.FrequencyResponse(
        np.concatenate([frf.omega, more]), np.concatenate([frf.values, noise]), bound=bound, dt=frf.dt
    )


# --- a record of a step beside a response ---------------------------------------------------------------------------------------


@fault("step with the wrong sign", "step", "sign", (0.0, None, None), ("negate",))
def _negative_step(clean, record, size, rng):
    return changed(record, y=-record.y)


@fault("step in another unit", "step", "unit", (1000.0, 1.2, 1.0001), ("times",))
def _unit_step(clean, record, size, rng):
    return changed(record, y=size * record.y, bound=size * record.bound.radius)


@fault("late step", "step", "late", (3, 1, 0), ("advance",))
def _late_step(clean, record, size, rng):
    y = np.concatenate([np.zeros((size, record.y.shape[1])), record.y[: len(record.y) - size]])
    return changed(record, y=y)


@fault("early step", "step", "late", (3, 1, 0), ("delay",))
def _early_step(clean, record, size, rng):
    y = np.concatenate([record.y[size:], np.repeat(record.y[-1:], size, axis=0)])
    return changed(record, y=y)


@fault("milliseconds as seconds", "step", "sample time", (1000.0, None, None), ("time times",))
def _milliseconds(clean, record, size, rng):
    return changed(record, dt=size * record.dt)


@fault("sample time off by two", "step", "sample time", (2.0, 1.02, 1.00001), ("time times",))
def _twice(clean, record, size, rng):
    """The record was made at another rate than is stated; a delay is that many samples shorter."""
    late = {"delay": round(4 / size)} if clean.name == "heater" else {}
    return changed(step(recipes()[clean.name], rng, plant=recipes()[clean.name].faster(size, **late)), dt=record.dt)


@fault("step that doesn't start at rest", "step", "not at rest", (20, 4, 0))
def _not_at_rest(clean, record, size, rng):
    return changed(record, u=record.u[size:], y=record.y[size:], bound=record.bound.radius[size:])


@fault("step about an operating point", "step", "offset", (10.0, 0.3, 1e-4), ("detrend",))
def _step_offset(clean, record, size, rng):
    return changed(record, y=record.y + size * np.abs(record.y).max())


@fault("exchanged columns of a step", "step", "exchanged", (0.0, None, None), ("exchange",))
def _exchanged_step(clean, record, size, rng):
    if record.y.shape[1] > 1:
        return None
    return changed(record, u=record.y, y=record.u, bound=0.01)


@fault("step of another machine", "step", "other plant", (1.4, 1.02, 1.00001))
def _other_step(clean, record, size, rng):
    """A machine that is slower, and 30 % softer."""
    made = step(recipes()[clean.name], rng, plant=recipes()[clean.name].faster(1 / size))
    return changed(made, y=size * made.y)


@fault("step with a spike", "step", "spike, outlier", (3.0, 0.1, 1e-4))
def _step_spike(clean, record, size, rng):
    y = record.y.copy()
    y[int(rng.integers(20, 50)), 0] += size * np.abs(y).max()
    return changed(record, y=y)
