"""Names and kinds of the functions of a parametric basis."""

from __future__ import annotations

import dataclasses
import enum


class FunctionKind(enum.StrEnum):
    """Kind of a parametric function."""

    GIVEN = "given"  # by a state-space system
    MODE = "mode"
    INTEGRATOR = "integrator"
    PASSIVE = "passive mode"  # non-negative combinations of them are positive real
    CONSTANT = "constant of the class"  # its coefficient is fixed


@dataclasses.dataclass(frozen=True)
class Function:
    """A parametric function: its label, its kind, and its longer name for reports where it has one."""

    label: str
    kind: FunctionKind = FunctionKind.GIVEN
    words: str = ""

    @property
    def name(self) -> str:
        """Name for reports.

        Examples
        --------
        >>> import robustid as rid
        >>> [function.name for function in rid.kautz(100.0, 0.1, dt=0.01).functions]
        ['mode at 15.92 Hz, real part', 'mode at 15.92 Hz, imaginary part']
        """
        return self.words or self.label

    @classmethod
    def of(cls, value: Function | str) -> Function:
        """The function itself, or that which a label names."""
        return cls(value) if isinstance(value, str) else value
