"""Results of a sweep of fits over the order: costs, information criteria and a stabilisation diagram."""

from __future__ import annotations

import dataclasses
import math
from functools import cached_property
from typing import NamedTuple

import numpy as np

from robustid.core import Frozen, Unfinished, exponents_of, freeze
from robustid.figures import Drawable
from robustid.fitting.fraction.fraction_iteration import FitStatus
from robustid.fitting.matrix_fraction import MatrixFraction
from robustid.fitting.state_space.state_descent import suspicious

_SAME_FREQUENCY, _SAME_DAMPING = 0.01, 0.05
# Where no order leaves noise alone: an order whose error at withheld points is larger than the smallest by at most this part.
_AS_GOOD = 0.25
_INSIDE = 1.05  # of a bound: least squares don't minimise the largest residual


class StabilisationMark(NamedTuple):
    """One mark of a stabilisation diagram."""

    order: int
    frequency: float  # |s|, rad/s
    damping: float  # -Re(s)/|s|; negative for an unstable pole
    kind: str  # against the next lower order: "stable", "frequency", "damping" or "new"


@dataclasses.dataclass(frozen=True, eq=False)
class OrderSweep(Frozen, Drawable):
    """Fits over the order, with what each costs and which one the data carry.

    Attributes
    ----------
    fits : dict of int to MatrixFraction
        By rising order. With ``stable=False`` no cost lies above that of a lower order by more than 1e-6 of it; stable
        fits may cost more where the best one is unstable.
    failures : dict of int to str
        Orders that could not be fitted, with the message.
    parameters : (n,) int array
        Free coefficients p: order*(ny + nu), ny*nu more with feed-through, less what constraints forbid.
    equations : int
        Real equations N: twice the number of complex samples with weight.
    noise_known : bool
        Whether the weight came from the covariance of the data.
    singular_values : (r,) array
        Of the subspace estimate, falling.
    noise_edge : float
        Noise alone keeps the singular values below this.
    withheld : (n,) array
        Weighted rms error at frequency points that were withheld, relative to the data there; nan where it wasn't judged.
    outside : (n,) array
        Largest ratio of what the fit leaves to the bound of the data; nan where they have none.
    unresolved : (n,) int array
        Number of poles whose damping the frequency points don't resolve.
    hint : str
        What the residuals of the order suggested ask for; empty where they ask for nothing.
    interrupted : bool
        Whether Ctrl-C ended the sweep, so that the suggestion is among the orders finished before.
    """

    fits: dict[int, MatrixFraction]
    failures: dict[int, str]
    parameters: np.ndarray
    equations: int
    noise_known: bool
    singular_values: np.ndarray
    noise_edge: float
    withheld: np.ndarray
    outside: np.ndarray
    unresolved: np.ndarray
    hint: str = ""
    interrupted: bool = False

    def __post_init__(self) -> None:
        self._set(
            fits=dict(sorted(self.fits.items())),
            failures=dict(sorted(self.failures.items())),
            parameters=freeze(self.parameters),
            singular_values=freeze(self.singular_values),
            withheld=freeze(self.withheld),
            outside=freeze(self.outside),
            unresolved=freeze(self.unresolved),
        )

    @property
    def unfinished(self) -> Unfinished | None:
        """The orders that Ctrl-C left out; None where it ended none."""
        return Unfinished((), interrupted=True, run="the sweep over the order") if self.interrupted else None

    @property
    def orders(self) -> np.ndarray:
        """Orders that were fitted, (n,)."""
        return np.array(list(self.fits))

    @property
    def costs(self) -> np.ndarray:
        """``V = sum_k |W(k) vec(P_k - model)|^2``, (n,)."""
        return np.array([fit.cost for fit in self.fits.values()])

    @property
    def levels(self) -> np.ndarray:
        """``sqrt(2 V/(N - p))``, (n,): 1 where the weight is the inverse of the noise and the model leaves nothing."""
        freedom = self.equations - self.parameters
        return np.sqrt(2 * self.costs / np.where(freedom > 0, freedom, np.nan))

    @property
    def mdl(self) -> np.ndarray:
        """Minimum description length, (n,): ``-2 ln L + p ln N``."""
        return self._deviance + self.parameters * math.log(self.equations)

    @property
    def aic(self) -> np.ndarray:
        """Akaike's criterion, (n,): ``-2 ln L + 2 p``."""
        return self._deviance + 2 * self.parameters

    @property
    def suggested(self) -> int:
        """The order of the smallest MDL; a lower one where the bounds, or what withheld points show, ask for no more."""
        return self._choice[0]

    @property
    def reason(self) -> str:
        """Why this order, as a clause: "has the smallest MDL …"."""
        return self.restraint or "has the smallest MDL"

    @property
    def restraint(self) -> str:
        """Why an order below that of the smallest MDL, as a clause; empty where it is that."""
        return self._choice[1]

    @cached_property
    def _choice(self) -> tuple[int, str]:
        allowed = self._allowed
        best = allowed[np.argmin(self.mdl[allowed])]
        inside = [k for k in allowed[allowed <= best] if self.outside[k] <= _INSIDE]
        if inside:
            words = "is the smallest that leaves no more of the data than the stated bounds"
            return int(self.orders[inside[0]]), words if inside[0] < best else ""
        judged = allowed[np.isfinite(self.withheld[allowed])]
        if judged.size and not self._white(int(best)):
            least = float(np.min(self.withheld[judged]))
            first = judged[self.withheld[judged] <= (1 + _AS_GOOD) * least][0]
            if first < best:
                words = (
                    f"is the smallest within {100 * _AS_GOOD:.0f} % of the best error at withheld frequency points"
                    f" ({100 * self.withheld[first]:.3g} % against {100 * least:.3g} %; no order leaves noise alone)"
                )
                return int(self.orders[first]), words
        return int(self.orders[best]), ""

    @property
    def _allowed(self) -> np.ndarray:
        """Indices of the orders that the data can carry: enough equations, every mode resolved; all where none is."""
        carried = self.parameters <= self.equations / 2
        for mask in (carried & (self.unresolved == 0), carried):
            if np.any(mask):
                return np.flatnonzero(mask)
        return np.arange(self.parameters.size)

    def _white(self, k: int) -> bool:
        """Tell whether the residual of an order is noise: neighbouring frequency points are independent."""
        fit = self.fits[int(self.orders[k])]
        return not suspicious(fit.problem, fit.nodes.response, FitStatus.STATIONARY)

    @property
    def subspace_order(self) -> int:
        """Number of singular values above the noise."""
        return int(np.sum(self.singular_values > self.noise_edge))

    @property
    def poles(self) -> dict[int, np.ndarray]:
        """Poles of every order, in s (rad/s) or z."""
        return {order: fit.fraction.poles for order, fit in self.fits.items()}

    @property
    def stabilisation(self) -> tuple[StabilisationMark, ...]:
        """Every pole with Im(s) > 0, compared with those of the next lower order.

        "stable": one of them has the frequency within 1 % and the damping within 5 %; "frequency": only the
        frequency; "damping": only the damping of the nearest one; else "new", as all poles of the lowest order are.
        """
        rows: list[StabilisationMark] = []
        last = np.zeros(0, dtype=complex)
        for order, fit in self.fits.items():
            poles, dt = fit.fraction.poles.astype(complex), fit.fraction.dt
            poles = exponents_of(poles[poles != 0], dt)
            poles = poles[np.imag(poles) > 0]
            here = poles[np.argsort(np.abs(poles))]
            rows += [StabilisationMark(order, abs(s), -s.real / abs(s), stability_kind(s, last)) for s in here.tolist()]
            last = here
        return tuple(rows)

    @property
    def _deviance(self) -> np.ndarray:
        """-2 ln L up to a constant."""
        if self.noise_known:
            return 2 * self.costs
        # The logarithm of a cost that is rounding would reward every order above the true one.
        rounding = next(iter(self.fits.values())).problem.rounding
        return self.equations * np.log(np.maximum(self.costs, rounding) / self.equations)

    def __repr__(self) -> str:
        orders = f"{len(self.fits)} orders from {min(self.fits)} to {max(self.fits)}"
        failed = f", {len(self.failures)} failed" if self.failures else ""
        failed += ", interrupted" if self.interrupted else ""
        return f"<OrderSweep: {orders}{failed}; suggested {self.suggested}>"

    def summary(self) -> str:
        """A table with one line per order, then the suggestion."""
        lines = [" order  parameters        cost     level    MDL-min    AIC-min  withheld  poles"]
        mdl, aic = self.mdl - self.mdl.min(), self.aic - self.aic.min()
        columns = zip(
            self.fits.items(), self.parameters, self.levels, mdl, aic, self.withheld, self.unresolved, strict=True
        )
        for (order, fit), count, level, more_mdl, more_aic, withheld, unresolved in columns:
            poles = ("stable" if fit.stable else "unstable") + (f", {unresolved} not resolved" if unresolved else "")
            error = f"{100 * withheld:8.3g} %" if np.isfinite(withheld) else f"{'-':>10}"
            text = f"{order:6d}{count:12d}{fit.cost:12.5g}{level:10.4g}{more_mdl:11.5g}{more_aic:11.5g}{error}  {poles}"
            lines.append(text + ("  <" if order == self.suggested else ""))
        lines += [f"{order:6d}  failed: {message}" for order, message in self.failures.items()]
        noise = "known from the covariance" if self.noise_known else "of unknown level"
        lines.append(
            f"order {self.suggested} {self.reason} (noise {noise});"
            f" {self.subspace_order} singular values of the subspace estimate lie above the noise"
        )
        if len(self.fits) > 1 and self.suggested == self.orders[-1]:
            lines.append("it is the largest order tried: give larger `orders`")
        if self.interrupted:
            lines.append("interrupted: the other orders were not tried")
        if self.hint:
            lines.append(self.hint)
        return "\n".join(lines)


def stability_kind(pole: complex, last: np.ndarray) -> str:
    """The kind of a `StabilisationMark`, of a pole against those of the next lower order."""
    if not last.size:
        return "new"
    size, damping = abs(pole), -pole.real / abs(pole)
    same_frequency = np.abs(np.abs(last) - size) <= _SAME_FREQUENCY * size
    same_damping = np.abs(-np.real(last) / np.abs(last) - damping) <= _SAME_DAMPING * abs(damping)
    if np.any(same_frequency & same_damping):
        return "stable"
    if np.any(same_frequency):
        return "frequency"
    return "damping" if same_damping[np.argmin(np.abs(last - pole))] else "new"
