"""A measured frequency response with what follows from it, computed once: levels, singular values, spectra of the records."""

from __future__ import annotations

import dataclasses
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from robustid.data import FrequencyResponse, TimeRecord, as_records, variances
from robustid.errors import InputError, InputTypeError

_SAME_STEP = 1e-6


class Spectrum(NamedTuple):
    """Amplitudes of one signal: of the sine at every spectral line of the whole record, 0 left out."""

    freq_hz: np.ndarray  # (K,)
    amplitude: np.ndarray  # (K,) root mean square over the records
    excited: np.ndarray  # (K,) whether it is a frequency point of the response


@dataclasses.dataclass(frozen=True, eq=False)
class ResponseView:
    """A frequency response, with the records that it was estimated from.

    Parameters
    ----------
    frf : FrequencyResponse
    records : TimeRecord or sequence of TimeRecord, optional
        Show what was excited.

    Raises
    ------
    InputError, InputTypeError
        Records with other signals or another sample time, or of different lengths.

    Examples
    --------
    >>> import robustid as rid
    >>> view = ResponseView(rid.FrequencyResponse([10.0, 20.0], [1 - 0.1j, 0.01j], bound=0.02, outputs=["x [m]"]))
    >>> view.entry(0, 0), view.silent.ravel().tolist()
    ('x [m] / u', [False, True])
    """

    frf: FrequencyResponse
    records: Any = None

    def __post_init__(self) -> None:
        if not isinstance(self.frf, FrequencyResponse):
            raise InputTypeError(f"`frf` must be a FrequencyResponse; got {type(self.frf).__name__}")
        object.__setattr__(self, "records", _checked(self.records, self.frf))

    @property
    def ny(self) -> int:
        """Number of outputs."""
        return len(self.frf.outputs)

    @property
    def nu(self) -> int:
        """Number of inputs."""
        return len(self.frf.inputs)

    def entry(self, output: int, input: int) -> str:
        """Name of an entry, "displacement [mm] / force [N]"."""
        return f"{self.frf.outputs[output]} / {self.frf.inputs[input]}"

    @cached_property
    def size(self) -> np.ndarray:
        """|G|, (F, ny, nu); NaN where it was not measured."""
        return np.where(self.frf.missing, np.nan, np.abs(self.frf.values))

    @cached_property
    def measured(self) -> np.ndarray:
        """Number of frequency points at which each entry was measured, (ny, nu)."""
        return np.sum(~self.frf.missing, axis=0)

    @cached_property
    def complete(self) -> np.ndarray:
        """Frequency points at which every entry was measured, (F,) bool."""
        return np.all(~self.frf.missing, axis=(1, 2))

    @property
    def radius(self) -> np.ndarray | None:
        """Radius of the disc around each value; infinite where it was not measured."""
        return None if self.frf.bound is None else self.frf.bound.outer_radius

    @cached_property
    def silent(self) -> np.ndarray:
        """Samples that say nothing, (F, ny, nu) bool: their disc holds 0."""
        return np.zeros(self.size.shape, bool) if self.radius is None else self.radius >= self.size

    @cached_property
    def levels(self) -> dict[str, np.ndarray]:
        """Standard deviations (F, ny, nu) that are known, by their names."""
        frf, found = self.frf, {}
        if frf.noise is not None:
            found["σ of the noise"] = frf.noise
        elif frf.covariance is not None:
            found["σ of the response"] = np.sqrt(np.maximum(variances(frf.covariance, self.size.shape), 0))
        if frf.distortion is not None:
            found["σ of the distortion"] = frf.distortion
        return found

    def relative(self, level: np.ndarray) -> np.ndarray:
        """Median over the measured points of a level relative to the response, (ny, nu); NaN where the response is zero."""
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = level / self.size
        ratio[self.size == 0] = np.inf  # a median over all points: zeros count as large
        middle = self.median(ratio)
        return np.where(np.isfinite(middle), middle, np.nan)

    def median(self, array: np.ndarray) -> np.ndarray:
        """Median over the points at which each entry was measured, (ny, nu); NaN for an entry without one."""
        middle = np.full(self.measured.shape, np.nan)
        for place in np.argwhere(self.measured):
            i, j = map(int, place)
            middle[i, j] = np.median(array[~self.frf.missing[:, i, j], i, j])
        return middle

    @cached_property
    def singular_values(self) -> np.ndarray:
        """Singular values at every `complete` point, largest first: complex mode indicator function, (F, min(ny, nu))."""
        return np.linalg.svd(self.frf.values[self.complete], compute_uv=False)

    @cached_property
    def singular_bound(self) -> np.ndarray | None:
        """Distance that each of them can have from its true one, (F,): |E| <= R entry by entry has ||E|| <= ||R||."""
        return None if self.radius is None else np.linalg.norm(self.radius[self.complete], 2, axis=(1, 2))

    def spectrum(self, side: str, index: int) -> Spectrum:
        """Spectrum of an input ("u") or output ("y") of the records."""
        signals = np.stack([getattr(record, side)[:, index] for record in self.records])
        samples = signals.shape[1]
        power = np.mean(np.abs(np.fft.rfft(signals, axis=1)) ** 2, axis=0)
        amplitude = 2 * np.sqrt(power) / samples
        if samples % 2 == 0:
            amplitude[-1] /= 2
        step = 1 / (samples * self.records[0].dt)
        excited = np.zeros(amplitude.size, bool)
        excited[np.rint(self.frf.freq_hz / step).astype(int).clip(0, amplitude.size - 1)] = True
        return Spectrum(step * np.arange(1, amplitude.size), amplitude[1:], excited[1:])


def _checked(records: Any, frf: FrequencyResponse) -> tuple[TimeRecord, ...]:
    listed = [] if records is None else as_records("records", records)
    for k, record in enumerate(listed):
        shape, wanted = (len(record.outputs), len(record.inputs)), (len(frf.outputs), len(frf.inputs))
        if shape != wanted:
            raise InputError(
                f"`records` must have the {wanted[0]} outputs and {wanted[1]} inputs of the response; got {shape[0]} and"
                f" {shape[1]} (number {k})"
            )
        if frf.dt is None or abs(record.dt - frf.dt) > _SAME_STEP * frf.dt:
            here = "continuous time" if frf.dt is None else f"dt = {frf.dt:g} s"
            raise InputError(
                f"`records` must have the sample time of the response, {here}; got {record.dt:g} s (number {k})"
            )
        if len(record.u) != len(listed[0].u):
            raise InputError(
                f"`records` must all have one length; got {len(listed[0].u)} and {len(record.u)} samples (number {k})"
            )
    return tuple(listed)
