"""Small models beside output-error fits: simulated over the records that the data come from, from their best initial states."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg

from robustid.core import Budget, Frozen, Real, freeze
from robustid.data import FrequencyResponse, TimeRecord
from robustid.errors import InputError
from robustid.fitting import RecordFit, fit_records
from robustid.identification import validate
from robustid.reduction.drawn_inside import Bounds, as_known, drawn_inside

if TYPE_CHECKING:
    import control

AS_WELL = 1.05  # of the root mean square error: differences that don't matter
_FIRST = 0.7  # of a record, to which fits are judged by the rest of it
_PREDICTS = 1.1  # of the smallest error there: what the fit of the right order may have
_AT_REST = 0.1  # of the deviation of an output, below which its first sample may be that of a machine at rest
_IN_VAIN = 4  # orders above that of least description length that are tried: two modes more
_MOST = 20000  # samples in all: longer records are for spectra


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Simulated(Frozen):
    """Simulations of the records, each from the initial state that fits it best."""

    # 100 (1 - rms error/rms output) (ny,), the worst of all records
    fits: Real  # of the recommended model
    before: Real  # of the one that was chosen without the records
    best: Real  # of the best fit of records (and response) among orders that the samples justify
    best_order: int
    samples: int  # in all records
    worse: bool  # the error of the recommended model is more than 5 % above that of the best fit

    def __post_init__(self) -> None:
        self._set(**{name: freeze(getattr(self, name)) for name in ("fits", "before", "best")})

    def __repr__(self) -> str:
        return f"<Simulated: {percent(self.fits)} of {self.samples} samples; best fit {percent(self.best)}>"

    def summary(self) -> str:
        """In words."""
        text = (
            f"Simulated over the {self.samples} samples of the records it fits {percent(self.fits)}; the best output-error fit,"
            f" of order {self.best_order}, {percent(self.best)}."
        )
        if not np.array_equal(self.fits, self.before):
            text += f" The model that was best at the frequency points alone fits them {percent(self.before)}."
        if self.worse:
            text += " No model inside all bounds was found that simulates the records about as well."
        return text


def percent(values: Real) -> str:
    """Fits of the outputs in words."""
    return ", ".join(f"{value:.1f}" for value in values) + " %"


class Simulations:
    """Records that the data of a problem come from, fits of them of several (rising) orders, and the error of any model over
    them. No order is fitted that is far above the best one and the `carried` one of the response. A response is fitted beside
    them, with the bounds as they were measured.
    """

    def __init__(
        self,
        records: Sequence[TimeRecord],
        frf: FrequencyResponse | None,
        orders: Sequence[int],
        feedthrough: bool,
        budget: Budget,
        *,
        carried: int = 0,
    ):
        self.records, self.offset = list(records), all(record.bound is None for record in records)
        self.frf = None if frf is None else as_known(frf)
        self.feedthrough, self.budget = feedthrough, budget
        self.samples = sum(len(record.u) for record in records)
        self.fits: dict[int, RecordFit] = {}
        self._length: dict[int, float] = {}
        for k, order in enumerate(orders):
            if (fit := self._fit(order)) is not None:
                self.fits[order], self._length[order] = fit, self._description_length(fit)
            budget.tell(k + 1, len(orders))
            if budget.over or (self._length and order >= max(self._shortest + _IN_VAIN, carried)):
                break

    @property
    def _shortest(self) -> int:
        """Order of least description length."""
        return min(self._length, key=self._length.__getitem__)

    def _description_length(self, fit: RecordFit) -> float:
        """Description length of the records by a fit, but for a constant; the state that each begins with is unknown, too."""
        outputs, inputs = self.records[0].y.shape[1], self.records[0].u.shape[1]
        count, level = self.samples * outputs, max(self.error(fit.model), np.finfo(float).tiny)
        return 2 * count * math.log(level) + fit.order * (outputs + inputs + len(self.records)) * math.log(count)

    def _fit(
        self,
        order: int,
        start: control.StateSpace | None = None,
        points: FrequencyResponse | None = None,
        records: Sequence[TimeRecord] | None = None,
    ) -> RecordFit | None:
        """Fit of records, and of frequency points, where there are any."""
        try:
            return fit_records(
                self.records if records is None else records,
                order=order,
                frf=self.frf if points is None else points,
                feedthrough=self.feedthrough,
                offset=self.offset,
                start=start,
                time_limit=self.budget.seconds,
            )
        except (InputError, np.linalg.LinAlgError):  # too few samples for so many states
            return None

    def quality(self, model: control.StateSpace) -> Real:
        """Fit of every output in per cent, (ny,), the worst of all records."""
        return np.min(100 * self._fit_of(model, self.records), axis=0)

    def _fit_of(self, model: control.StateSpace, records: Sequence[TimeRecord]) -> Real:
        """1 - rms error/rms output of every record and output; with the constant that fits best where none is bounded."""
        if not self.offset:
            return np.array([validate(model, record).fit for record in records])
        return np.array([_fit_with_constant(model, record) for record in records])

    def error(self, model: control.StateSpace, records: Sequence[TimeRecord] | None = None) -> float:
        """Root mean square over outputs and records of the error relative to the output; infinite where it can't be simulated."""
        try:
            return float(np.sqrt(np.mean(np.square(1 - self._fit_of(model, records or self.records)))))
        except InputError:
            return math.inf

    def carried(self) -> int:
        """Order that the records carry: of least description length, or a lower one that predicts their ends as well. Coloured
        noise makes the description length choose too many states; so fits to the first part of every record are judged by the
        rest of it.
        """
        most = self._shortest
        ends = self._errors_at_ends([order for order in self.fits if order <= most])
        if most not in ends:
            return most
        return min(order for order, error in ends.items() if error <= _PREDICTS * min(ends.values()))

    def _errors_at_ends(self, orders: Sequence[int]) -> dict[int, float]:
        """Error over the end of every record of the fit to what comes before; of some orders only where time is up."""
        if any(record.bound is not None or record.initial != "free" for record in self.records):
            return {}  # a part of them would have another past
        first = [_part(record, slice(None, int(_FIRST * len(record.u)))) for record in self.records]
        last = [_part(record, slice(int(_FIRST * len(record.u)), None)) for record in self.records]
        found: dict[int, float] = {}
        for order in orders:
            if self.budget.over:
                break
            fit = self._fit(order, self.fits[order].model, records=first)
            found[order] = math.inf if fit is None else self.error(fit.model, last)
        return found

    def drawn_inside(self, order: int, bounds: Bounds) -> Iterator[control.StateSpace]:
        """The fit of an order, and fits with more weight where the one before lies outside a bound (`drawn_inside`)."""

        def fitted(points: FrequencyResponse, start: control.StateSpace) -> control.StateSpace | None:
            fit = self._fit(order, start, points)
            return None if fit is None else fit.model

        yield from drawn_inside(self.fits[order].model, self.frf, fitted, bounds, self.budget)


def _part(record: TimeRecord, samples: slice) -> TimeRecord:
    return dataclasses.replace(record, u=record.u[samples], y=record.y[samples], reference=None)


def _fit_with_constant(model: control.StateSpace, record: TimeRecord) -> Real:
    """The fit of every output but for a constant, and for a free response where the initial state is unknown."""
    if record.initial == "free":
        # with states that keep their value, one added to every output: offsets, where the initial state is fitted
        import control

        ny = model.noutputs
        A = scipy.linalg.block_diag(model.A, np.eye(ny))
        B, C = np.vstack([model.B, np.zeros((ny, model.ninputs))]), np.hstack([model.C, np.eye(ny)])
        return validate(control.StateSpace(A, B, C, model.D, model.dt, remove_useless_states=False), record).fit
    found = validate(model, record)
    left = np.linalg.norm(found.residuals - found.residuals.mean(axis=0), axis=0)
    size = np.linalg.norm(record.y - record.y.mean(axis=0), axis=0)
    return 1 - left / np.maximum(size, np.finfo(float).tiny)


def in_operation(record: TimeRecord) -> TimeRecord:
    """The record from an unknown state, if what it says of its beginning, rest, can't be: an output that is not near 0 there.

    A machine at rest has an output of 0 but for its feed-through; one in operation, as most processes are, its operating point.
    A bound would be about a record from rest: such a record is left as it is.
    """
    if record.initial != "rest" or record.bound is not None:
        return record
    away = np.abs(record.y[0]) > _AT_REST * np.std(record.y, axis=0)
    return dataclasses.replace(record, initial="free") if np.any(away) and np.any(record.u[0] != 0) else record


def with_transients(records: Sequence[TimeRecord]) -> list[TimeRecord]:
    """Keep the records (`in_operation`) that say more than their spectrum, with transients; none where they are too long."""
    found = [in_operation(record) for record in records if record.initial != "periodic"]
    return found if sum(len(record.u) for record in found) <= _MOST else []
