"""Parts of a measured response matrix: single entries, some outputs and inputs, and its columns as a table."""

from __future__ import annotations

from typing import Any, ClassVar, Self

import numpy as np

from robustid.core import Complex, Tabular
from robustid.data.frequency_points import FrequencyPoints, in_parts, signal_index, signal_indices
from robustid.errors import InputError

LEVELS = ("noise", "distortion", "changed")  # standard deviations
ENTRIES = ("values", *LEVELS, "doubt")  # one number per frequency point and entry of the matrix


class ResponseParts(FrequencyPoints, Tabular):
    """Base of a response matrix, of which outputs, inputs and frequency points can be chosen."""

    INDEX: ClassVar[str] = "frequency [Hz]"
    inputs: Any
    outputs: Any
    coherence: Any
    covariance: Any

    def entry(self, output: int | str = 0, input: int | str = 0) -> Self:
        """One entry of the matrix, by index or name of its signals, still with shape (F, 1, 1), and its own bound."""
        i, j = signal_index("output", output, self.outputs), signal_index("input", input, self.inputs)
        return self._entries([i], [j])

    def __getitem__(self, points: Any) -> Self:
        """Some frequency points, outputs and inputs: ``frf[10:50]``, ``frf[:, "angle"]``, ``frf[:, [0, 1], "current"]``."""
        wanted, outputs, inputs = in_parts(points)
        rows, columns = signal_indices("output", outputs, self.outputs), signal_indices("input", inputs, self.inputs)
        whole = rows == list(range(len(self.outputs))) and columns == list(range(len(self.inputs)))
        return (self if whole else self._entries(rows, columns)).select(wanted)

    def _entries(self, rows: list[int], columns: list[int]) -> Self:
        """Some entries, each with the bound that is left to it alone."""
        place = np.array(rows)[:, None], np.array(columns)
        flat = (place[0] + len(self.outputs) * place[1]).T.ravel()
        if np.all(self.missing[:, *place]):
            names = [
                ", ".join(side[k].name for k in some) for side, some in ((self.outputs, rows), (self.inputs, columns))
            ]
            raise InputError(
                f"`output` = {names[0]!r}, `input` = {names[1]!r}: this entry was measured at no frequency point"
            )
        return self._with(
            bound=None if self.bound is None else self.bound.entries(*place),
            **{name: array[:, *place] for name in ENTRIES if (array := getattr(self, name)) is not None},
            coherence=None if self.coherence is None else self.coherence[:, rows],
            covariance=None if self.covariance is None else self.covariance[:, flat[:, None], flat],
            inputs=tuple(self.inputs[j] for j in columns),
            outputs=tuple(self.outputs[i] for i in rows),
        )

    def table(self) -> dict[str, np.ndarray]:
        """Frequency, real and imaginary part, and bound of every entry, by name."""
        found = {self.INDEX: self.freq_hz}
        for i, j in np.ndindex(self.values.shape[1:]):
            of = "" if self.values[0].size == 1 else f" {self.outputs[i].name}/{self.inputs[j].name}"
            value: Complex = self.values[:, i, j]
            found |= {f"real{of}": value.real, f"imag{of}": value.imag}
            found |= {} if self.bound is None else {f"bound{of}": self.bound.radius[:, i, j]}
        return found
