"""The smallest truncated model that still keeps every sample within its bound."""

from __future__ import annotations

import dataclasses
import enum
import logging
from collections.abc import Callable

import numpy as np
import scipy.linalg

from robustid.errors import InputTypeError, SizeError, SolverError
from robustid.identification import Identification, identify
from robustid.identification.residuals import largest_ratio
from robustid.reduction.balanced import Reduction, balanced_truncations

_log = logging.getLogger("robustid")

# The nuclear norm goes to a general semidefinite solver: two seconds at this size, half a minute at 64.
_LARGEST_NUCLEAR = 44


class SearchStatus(enum.Enum):
    """What the search found; the value is the user's sentence."""

    WITHIN = "every sample stays within its bound"
    INFLATED = "every sample stays within its bound times the margin of the data, which contradict the class"
    UNREDUCED = "no truncated model keeps every sample within its bound; the model is the one identified"


def reduce_within_bounds(identification: Identification) -> Reduction:
    """The smallest order r for which a truncated model keeps every |residual| within its bound.

    Candidates of every order, from the smallest: the parametric part as it is with the non-parametric part G truncated, and the
    whole model truncated; of this identification and, since the centre of the consistent set is rarely the easiest model to
    reduce, of those with the objectives "gain" and "order" too. G is truncated in the scaled variable, ``phi(zeta)`` in place of
    ``G(z) = K phi(z/rho)``, which keeps the poles inside 1/rho. Each candidate is evaluated at every sample. The bound is the one
    that the identified model keeps: max(1, margin) times the bound of the data.

    Parameters
    ----------
    identification : Identification

    Returns
    -------
    Reduction
        ``margin`` is the largest |residual|/bound of the model, ``tried`` the pairs (order, smallest such ratio found at that
        order); `hankel` are the Hankel singular values of the identified model's stable part, `bounds` their a-priori error
        bounds, `bound` the one between the identified and the reduced model (inf where it came from another objective).

    Notes
    -----
    Truncation alone: no refinement of what it gives, so that a still smaller model may exist. Objective "order" is left out above
    44 coefficients, and the search ends when nothing but the parametric part is left.

    Examples
    --------
    >>> import robustid as rid
    >>> data = rid.flexible_structure(seed=0)
    >>> basis = rid.kautz(data.modes[:, 0], data.modes[:, 1], dt=0.01, delay=1)
    >>> prior = rid.Prior(gain_bound=0.2, decay_rate=1.1)
    >>> problem = rid.MixedProblem(frequency=data.frequency, time=data.time, prior=prior, parametric=basis)
    >>> small = rid.reduce_within_bounds(rid.identify(problem))
    >>> small.order, small.margin <= 1
    (4, True)
    """
    if not isinstance(identification, Identification):
        raise InputTypeError(f"`identification` must be the result of identify(); got {type(identification).__name__}")
    basis = identification.problem.parametric
    least = 0 if basis is None else basis.states
    best = _smallest(identification, identification.order)
    for objective in _objectives(identification):
        if best.order <= least:
            break
        other = _of_objective(identification, objective)
        if other is None:
            continue
        found = _smallest(other, best.order - 1)
        merged = _merge(best.tried, found.tried)
        if found.status is not SearchStatus.UNREDUCED and found.order < best.order:
            # Held against the identified model: its Hankel singular values, and no a-priori bound between the two.
            best = dataclasses.replace(found, hankel=best.hankel, bounds=best.bounds, bound=np.inf)
        best = dataclasses.replace(best, tried=tuple(pair for pair in merged if pair[0] <= best.order))
    return best


def _objectives(identification: Identification) -> list[str]:
    quick = identification.problem.coefficients <= _LARGEST_NUCLEAR
    return [name for name in ("gain", "order") if name != identification.objective and (quick or name != "order")]


def _of_objective(identification: Identification, objective: str) -> Identification | None:
    """The same problem identified with another objective; None where no solver manages."""
    _log.info("looking for a smaller model: objective %s", objective)
    try:
        return identify(identification.problem, objective=objective, accuracy=identification.accuracy)
    except (SizeError, SolverError) as failure:
        _log.warning("objective %s: %s", objective, failure)
        return None


def _merge(first: tuple, second: tuple) -> list[tuple[int, float]]:
    smallest: dict[int, float] = {}
    for order, margin in (*first, *second):
        smallest[order] = min(margin, smallest.get(order, np.inf))
    return sorted(smallest.items())


def _smallest(identification: Identification, largest: int) -> Reduction:
    """The smallest order up to `largest` within the bounds, of one identification."""
    full, problem = identification.model, identification.problem
    limit = max(1.0, identification.margin) * (1 + 1e-5)
    families = _families(identification)
    whole = balanced_truncations(full)(full.nstates)
    status = SearchStatus.WITHIN if identification.consistent else SearchStatus.INFLATED
    tried = []
    for order in range(min(largest + 1, full.nstates)):
        candidates = [family(order) for family in families]
        pairs = [(largest_ratio(problem, r.model), r) for r in candidates if r is not None]
        if not pairs:
            continue
        margin, found = min(pairs, key=lambda pair: pair[0])
        tried.append((order, margin))
        if margin <= limit:
            break
    else:
        # Its own free responses, not refitted ones: the residuals that identify verified.
        margin, found, status = (
            max(float(r.ratio.max()) for r in identification.residuals),
            whole,
            SearchStatus.UNREDUCED,
        )
        tried.append((full.nstates, margin))
    return dataclasses.replace(
        found,
        order=found.model.nstates,
        hankel=whole.hankel,
        bounds=whole.bounds,
        status=status,
        margin=margin,
        tried=tuple(tried),
    )


def _families(identification: Identification) -> list[Callable[[int], Reduction | None]]:
    """Order to candidate, None where there is none: the whole model, and G alone, truncated."""
    full, basis = identification.model, identification.problem.parametric
    whole = balanced_truncations(full)
    held = 0 if basis is None or not basis.has_integrator else int(np.sum(np.isinf(whole(full.nstates).bounds)))
    families: list[Callable[[int], Reduction | None]] = [lambda order: whole(order) if order >= held else None]
    if basis is not None:
        families.append(_parametric_kept(identification))
    return families


def _parametric_kept(identification: Identification) -> Callable[[int], Reduction | None]:
    """The parametric part with G truncated to the remaining states in the scaled variable, where its error bound holds too."""
    import control

    full, rho = identification.model, identification.prior.decay_rate
    kept = identification.problem.parametric.states
    n = full.nstates - kept
    truncate = balanced_truncations(
        control.StateSpace(full.A[:n, :n] * rho, full.B[:n], full.C[:, :n] * rho, full.D, full.dt)
    )

    def candidate(order: int) -> Reduction | None:
        if order < kept:
            return None
        small = truncate(order - kept)
        a, b, c = (np.asarray(getattr(small.model, name)) for name in "ABC")
        A = scipy.linalg.block_diag(a / rho, full.A[n:, n:])
        B, C = np.vstack([b, full.B[n:]]), np.hstack([c / rho, full.C[:, n:]])
        labels = {"inputs": full.input_labels, "outputs": full.output_labels, "name": "reduced"}
        return dataclasses.replace(small, model=control.ss(A, B, C, full.D, full.dt, **labels))

    return candidate
