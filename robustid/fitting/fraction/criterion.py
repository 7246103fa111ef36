"""The criterion of a fit: sum over the frequency points of |W(k) vec(P_o - P)|^2."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from robustid.core import Frozen, as_array, as_float, freeze
from robustid.errors import InputError

# Eigenvalues of a covariance below this part of the largest one are rounding, not information.
SINGULAR = 1e-13


@dataclasses.dataclass(frozen=True, eq=False)
class Weight(Frozen):
    """Weight of the residual, point by point: ``W(k) vec(R) = matrix (vec(entries o (output R input)))``.

    vec stacks columns; o is the entrywise (Schur) product. The weight multiplies the residual, not its square. Parts
    left out are identities: a general weight has `matrix` alone, a separable one `output` and `input` alone.

    Parameters
    ----------
    entries : (F, ny, nu) array
        Factor per frequency point and entry, >= 0 (0 masks the entry). It gives the weight its shape.
    output : (F, ny, ny) array, optional
    input : (F, nu, nu) array, optional
    matrix : (F, ny*nu, ny*nu) array, optional
    note : str, optional
        Where the weight comes from, for reports.

    Raises
    ------
    InputError
        On wrong shapes, NaN, negative entries, or when everything is masked.

    Notes
    -----
    Source: `voorhoeve2016` equations (2)-(5).

    Examples
    --------
    >>> import numpy as np
    >>> weight = Weight.relative(np.full((2, 1, 1), 4.0))
    >>> weight.apply(np.full((2, 1, 1), 2.0))
    array([[0.5], [0.5]])
    """

    entries: np.ndarray
    _: dataclasses.KW_ONLY
    output: np.ndarray | None = None
    input: np.ndarray | None = None
    matrix: np.ndarray | None = None
    note: str = ""

    def __post_init__(self) -> None:
        entries = as_array("entries", self.entries, ndim=3)
        lines, ny, nu = entries.shape
        if np.any(entries < 0):
            raise InputError(f"`entries` of a weight must be >= 0 (0 masks an entry); got {entries.min():g}")
        if not np.any(entries):
            raise InputError(
                "the weight is zero everywhere: no frequency point is left to fit; zeros mask single entries"
            )
        parts: dict[str, np.ndarray | None] = {"entries": freeze(entries)}
        for name, size in (("output", ny), ("input", nu), ("matrix", ny * nu)):
            value = getattr(self, name)
            if value is not None:
                value = as_array(name, value, dtype=complex)
                if value.shape not in ((size, size), (lines, size, size)):
                    raise InputError(
                        f"`{name}` must have shape (F, {size}, {size}) with F = {lines}; got {value.shape}"
                    )
                value = freeze(np.broadcast_to(value, (lines, size, size)))
            parts[name] = value
        self._set(**parts)

    @property
    def shape(self) -> tuple[int, int, int]:
        """(F, ny, nu)."""
        return self.entries.shape  # type: ignore[return-value]

    @property
    def entrywise(self) -> np.ndarray:
        """Weight of a residual in one entry alone, (F, ny, nu): the lengths of the columns of W(k)."""
        _, ny, nu = self.shape
        out = np.empty(self.shape)
        for i, j in np.ndindex(ny, nu):
            one = np.zeros((ny, nu))
            one[i, j] = 1.0
            out[:, i, j] = np.linalg.norm(self.apply(np.broadcast_to(one, self.shape)), axis=1)
        return out

    @property
    def size(self) -> np.ndarray:
        """A number per frequency point (F,): root mean square of the residual's weights."""
        columns = self.entrywise.transpose(0, 2, 1).reshape(self.shape[0], -1)
        return np.sqrt(np.mean(columns**2, axis=1))

    def apply(self, residuals: np.ndarray) -> np.ndarray:
        """W(k) vec(R(k)) for R of shape (F, ny, nu): (F, ny*nu)."""
        weighted = residuals
        if self.output is not None:
            weighted = self.output @ weighted
        if self.input is not None:
            weighted = weighted @ self.input
        return self._finish((self.entries * weighted).transpose(0, 2, 1)[..., None])[..., 0]

    def apply_all(self, changes: np.ndarray) -> np.ndarray:
        """W(k) vec(R_t(k)) for T residuals at once, (F, ny, nu, T): (F, ny*nu, T)."""
        if self.output is not None:
            changes = np.einsum("kab,kbjt->kajt", self.output, changes, optimize=True)
        if self.input is not None:
            changes = np.einsum("kijt,kjl->kilt", changes, self.input, optimize=True)
        return self._finish((self.entries[..., None] * changes).transpose(0, 2, 1, 3))

    @property
    def entries_only(self) -> bool:
        """True where the weight is one number an entry, so that outputs don't mix."""
        return self.output is None and self.input is None and self.matrix is None

    def linearised(self, inverse: np.ndarray, left: np.ndarray) -> np.ndarray:
        """``W(k) (inverse^T kron left)``, the columns that a linearisation needs, without forming Kronecker products.

        Parameters
        ----------
        inverse : (F, nu, c) complex array
            D^{-1}, transposed: ``inverse[k, :, j]`` is row j of D^{-1}.
        left : (F, ny, d) complex array
            [P -I].

        Returns
        -------
        (F, ny*nu, c*d) complex array
            Column ``j*d + i`` belongs to entry (i, j) of the unknown, columns stacked.
        """
        if self.output is not None:
            left = self.output @ left
        if self.input is not None:
            inverse = self.input.transpose(0, 2, 1) @ inverse
        # axes: point, input c and output a of the residual; column j and row i of the unknown
        outer = inverse[:, :, None, :, None] * left[:, None, :, None, :]
        outer *= self.entries.transpose(0, 2, 1)[..., None, None]
        return self._finish(outer)

    def _finish(self, stack: np.ndarray) -> np.ndarray:
        """Merge the axes (F, nu, ny, ...) to (F, nu*ny, columns) and apply the general part."""
        lines, ny, nu = self.shape
        merged = stack.reshape(lines, nu * ny, -1)
        return merged if self.matrix is None else self.matrix @ merged

    def transposed(self) -> Weight:
        """The weight of transposed residuals: what a left fraction of P sees as right fraction of P^T."""
        _, ny, nu = self.shape
        swap = np.arange(ny * nu).reshape(nu, ny).T.ravel()  # vec(R^T) = vec(R)[swap]
        return Weight(
            self.entries.transpose(0, 2, 1),
            output=None if self.input is None else self.input.transpose(0, 2, 1),
            input=None if self.output is None else self.output.transpose(0, 2, 1),
            matrix=None if self.matrix is None else self.matrix[:, swap][:, :, swap],
            note=self.note,
        )

    def stacked(self) -> Weight:
        """The weight of residuals as one column, entry (i, j) in row i*nu + j: what a fraction of shared poles sees."""
        lines, ny, nu = self.shape
        swap = np.arange(ny * nu).reshape(nu, ny).T.ravel()  # the rows of R one after the other = vec(R)[swap]
        entries, matrix = self.entries.reshape(lines, -1, 1), self.matrix
        if self.output is not None or self.input is not None:
            every = np.eye(ny * nu).reshape(ny * nu, nu, ny).transpose(2, 1, 0)
            matrix = self.apply_all(np.broadcast_to(every, (lines, *every.shape)))
            entries = np.broadcast_to(np.any(entries, axis=1, keepdims=True), entries.shape).astype(float)
        return Weight(entries, matrix=None if matrix is None else matrix[:, swap][:, :, swap], note=self.note)

    def select(self, points: np.ndarray | slice) -> Weight:
        """The weight at some frequency points: indices, a mask or a slice."""
        output, input_, matrix = (
            None if part is None else part[points] for part in (self.output, self.input, self.matrix)
        )
        return dataclasses.replace(self, entries=self.entries[points], output=output, input=input_, matrix=matrix)

    def scaled(self, factors: ArrayLike) -> Weight:
        """Multiplied by a factor >= 0 per frequency point (F,), or per point and entry (F, ny, nu); 0 or False masks.

        Per-entry factors act on the entries themselves and are refused where a general matrix follows.
        """
        factors = as_array("factors", factors)
        if factors.shape == self.shape[:1]:
            factors = factors[:, None, None]
        elif factors.shape != self.shape:
            raise InputError(f"`factors` must have shape (F,) = {self.shape[:1]} or {self.shape}; got {factors.shape}")
        elif self.matrix is not None:
            raise InputError(
                "`factors` per entry don't combine with a general weight matrix; give one factor per frequency point"
            )
        return dataclasses.replace(self, entries=self.entries * factors)

    def banded(self, omega: np.ndarray, bands: Iterable[tuple[float, float, float]]) -> Weight:
        """Multiplied by ``factor`` where ``low <= omega <= high``, for every (low, high, factor); rad/s."""
        omega = as_array("omega", omega, ndim=1)
        factors = np.ones(omega.size)
        for low, high, factor in bands:
            low, high, factor = as_float("bands", low), as_float("bands", high), as_float("bands", factor)
            inside = (omega >= low) & (omega <= high)
            if not np.any(inside):
                raise InputError(f"`bands`: no frequency point lies between {low:g} and {high:g} rad/s")
            factors[inside] *= factor
        return self.scaled(factors)

    @classmethod
    def relative(cls, values: ArrayLike) -> Weight:
        """1/|P| per entry: every entry counts with its relative error, so that no mode is lost below a higher one."""
        size = np.abs(as_array("values", values, dtype=complex, ndim=3))
        if np.any(size == 0):
            k, i, j = np.argwhere(size == 0)[0]
            raise InputError(
                f"`values` has a zero at frequency point {k}, entry ({i}, {j}): a relative weight is infinite there;"
                " give a covariance or a weight, mask dead entries, leave dead signals out"
            )
        return cls(1.0 / size)

    @classmethod
    def from_covariance(cls, covariance: ArrayLike, ny: int, nu: int) -> Weight:
        """Inverse square root of the covariance (F, ny*nu, ny*nu) of vec(P): sample maximum likelihood.

        Hermitian square root; any other one gives the same criterion.
        """
        covariance = as_array("covariance", covariance, dtype=complex, ndim=3)
        if covariance.shape[1:] != (ny * nu, ny * nu):
            raise InputError(f"`covariance` must have shape (F, {ny * nu}, {ny * nu}); got {covariance.shape}")
        lines = covariance.shape[0]
        hermitian = (covariance + covariance.conj().transpose(0, 2, 1)) / 2
        # Correlations rather than the covariance: entries of very different size stay exact.
        spread = np.sqrt(np.maximum(np.real(np.diagonal(hermitian, axis1=1, axis2=2)), 0.0))
        scale = np.where(spread > 0, spread, 1.0)
        values, vectors = np.linalg.eigh(hermitian / (scale[:, :, None] * scale[:, None, :]))
        bad = np.flatnonzero((values[:, 0] <= SINGULAR * values[:, -1]) | np.any(spread <= 0, axis=1))
        if bad.size:
            raise InputError(
                f"`covariance` must be positive definite; at frequency point {bad[0]} it isn't ({bad.size} of {lines})."
                " An estimate needs more periods or realisations than entries; else use its diagonal, or leave the"
                " weight of a fit out, which shrinks it"
            )
        root = (vectors / np.sqrt(values)[:, None, :]) @ vectors.conj().transpose(0, 2, 1)
        return cls(np.ones((lines, ny, nu)), matrix=root / scale[:, None, :])
