"""RecordFit: a model of records, with the states that they began with."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from robustid.core import Frozen, Real, Savable, StateMatrices, counted, freeze, labels_of, simulate
from robustid.data import TimeRecord
from robustid.figures import Modes
from robustid.fitting.fraction.fraction_iteration import FitStatus, FitStep

if TYPE_CHECKING:
    import control


@dataclasses.dataclass(frozen=True, eq=False)
class RecordFit(Frozen, Modes, Savable):
    """A model fitted to records as output error, with the state that every record began with.

    Attributes
    ----------
    records : tuple of TimeRecord
        As they were fitted: without the delay.
    A, B, C, D : (n, n), (n, nu), (ny, n), (ny, nu) arrays
        Discrete, A in blocks of at most two poles. The plant without the `delay`.
    initial_states : tuple of (n,) array
        At the first sample of every record.
    offsets : (E, ny) array
        Constant that is added to the outputs of every record; zero where none was asked for.
    weight : (ny,) array
        Inverse of the residual's level of every output, in which the records' residuals were weighted.
    cost : float
        Sum of the squares of the weighted residuals, of the records over all samples, and of the frequency response.
    record_cost : float
        The records' part of it.
    status : FitStatus
    history : tuple of FitStep
        From the start that was the best; `FitStep.cost` is in the weights of its time, which change twice or more.
    delay : float
        In s; `model` is the plant without it.

    See Also
    --------
    robustid.validate : holds the fit against another record, from the initial state that the record tells or that fits best.
    """

    records: tuple[TimeRecord, ...]
    A: Real
    B: Real
    C: Real
    D: Real
    initial_states: tuple[Real, ...]
    offsets: Real
    weight: Real
    cost: float
    record_cost: float
    status: FitStatus
    history: tuple[FitStep, ...]
    delay: float = 0.0

    def __post_init__(self) -> None:
        self._set(
            **{name: freeze(getattr(self, name)) for name in ("A", "B", "C", "D", "offsets", "weight")},
            records=tuple(self.records),
            initial_states=tuple(freeze(state) for state in self.initial_states),
            history=tuple(self.history),
        )

    @property
    def matrices(self) -> StateMatrices:
        """A, B, C, D."""
        return StateMatrices(self.A, self.B, self.C, self.D)

    @property
    def dt(self) -> float:
        """Sample time in s."""
        return self.records[0].dt

    @property
    def order(self) -> int:
        """Number of states."""
        return len(self.A)

    @property
    def model(self) -> control.StateSpace:
        """The `control.StateSpace`."""
        import control

        inputs, outputs = labels_of(self.records[0].inputs, "u"), labels_of(self.records[0].outputs, "y")
        return control.ss(*self.matrices, self.dt, inputs=inputs, outputs=outputs)

    def to_control(self) -> control.StateSpace:
        """`model`, for those who look for this name on every object that python-control understands."""
        return self.model

    @property
    def poles(self) -> NDArray[np.complex128]:
        """Poles in z, (order,)."""
        return np.linalg.eigvals(self.A).astype(np.complex128)

    @property
    def stable(self) -> bool:
        """True if every pole lies inside the unit circle."""
        return bool(np.all(np.abs(self.poles) < 1))

    @property
    def simulated(self) -> tuple[Real, ...]:
        """Outputs (T, ny) of the model for every record, from its initial state and with its offset."""
        model = self.model
        return tuple(
            simulate(model, record.u, state)[0] + offset
            for record, state, offset in zip(self.records, self.initial_states, self.offsets, strict=True)
        )

    @property
    def fit_percent(self) -> Real:
        """``100 (1 - |y - yhat|/|y - mean(y)|)`` of every record and output, (E, ny), of the simulated outputs."""
        out = np.empty(self.offsets.shape)
        for number, (record, y) in enumerate(zip(self.records, self.simulated, strict=True)):
            left = np.linalg.norm(record.y - y, axis=0)
            size = np.linalg.norm(record.y - record.y.mean(axis=0), axis=0)
            with np.errstate(divide="ignore", invalid="ignore"):
                out[number] = np.where(left == 0, 100.0, 100 * (1 - left / size))
        return out

    def __repr__(self) -> str:
        fit = ", ".join(f"{value:.1f}" for value in self.fit_percent.mean(axis=0)[:8])
        count = len(self.records)
        return (
            f"<RecordFit: order {self.order}, {len(self.C)}x{self.B.shape[1]}, dt={self.dt:.6g} s,"
            f" {'stable' if self.stable else 'unstable'}; fit {fit} % of {count} record{'s' * (count > 1)},"
            f" {self.status.name.lower()} after {counted(len(self.history), 'step')}>"
        )
