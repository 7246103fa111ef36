"""The smallest truncated model that still keeps every sample within its bound."""

from __future__ import annotations

import dataclasses
import enum

import numpy as np
import scipy.linalg

from robustid.errors import InputTypeError
from robustid.identification import Identification
from robustid.identification.verification import largest_ratio
from robustid.reduction.balanced import Reduction, balanced_truncation


class SearchStatus(enum.Enum):
    """What the search found; the value is the user's sentence."""

    WITHIN = "every sample stays within its bound"
    INFLATED = "every sample stays within its bound times the margin of the data, which contradict the class"
    UNREDUCED = "no truncated model keeps every sample within its bound; the model is the one identified"


def reduce_within_bounds(identification: Identification) -> Reduction:
    """The smallest order r for which a truncated model keeps every |residual| within its bound.

    Candidates of every order, from the smallest: the parametric part as it is with the non-parametric part G truncated, and
    the whole model truncated. G is truncated in the scaled variable, ``phi(zeta)`` in place of ``G(z) = K phi(z/rho)``, which keeps
    the poles inside 1/rho. Each candidate is evaluated at every sample. The bound is the one that the identified model
    keeps: max(1, margin) times the bound of the data.

    Parameters
    ----------
    identification : Identification

    Returns
    -------
    Reduction
        ``margin`` is the largest |residual|/bound of the model, ``tried`` the pairs (order, smallest such ratio at that
        order), `hankel` the Hankel singular values of the identified model's stable part, `bounds` their a-priori error bounds.

    Notes
    -----
    Truncation alone: no refinement of what it gives, so that a still smaller model may exist.

    Examples
    --------
    >>> import robustid as rid
    >>> data = rid.flexible_structure(seed=0)
    >>> basis = rid.kautz(data.modes[:, 0], data.modes[:, 1], dt=0.01, delay=1)
    >>> prior = rid.Prior(gain_bound=0.2, decay_rate=1.1)
    >>> problem = rid.MixedProblem(frequency=data.frequency, time=data.time, prior=prior, parametric=basis)
    >>> small = rid.reduce_within_bounds(rid.identify(problem, objective="gain"))
    >>> small.order, small.margin <= 1
    (4, True)
    """
    if not isinstance(identification, Identification):
        raise InputTypeError(f"`identification` must be the result of identify(); got {type(identification).__name__}")
    full = identification.model
    limit = max(1.0, identification.margin) * (1 + 1e-5)
    whole = balanced_truncation(full, order=full.nstates, unstable="keep")
    tried = []
    status = SearchStatus.WITHIN if identification.consistent else SearchStatus.INFLATED
    for order in range(full.nstates):
        candidates = [(largest_ratio(identification.problem, r.model), r) for r in _candidates(identification, order)]
        if not candidates:
            continue
        margin, found = min(candidates, key=lambda pair: pair[0])
        tried.append((order, margin))
        if margin <= limit:
            break
    else:
        margin, found, status = largest_ratio(identification.problem, full), whole, SearchStatus.UNREDUCED
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


def _candidates(identification: Identification, order: int) -> list[Reduction]:
    """The truncated models of one order, each with its a-priori error bound."""
    full, basis = identification.model, identification.problem.parametric
    kept = 0 if basis is None else basis.states
    models = []
    if basis is None or not basis.has_integrator or order >= kept:
        models.append(balanced_truncation(full, order=order, unstable="keep"))
    if basis is not None and order >= kept:
        models.append(_parametric_kept(identification, order - kept))
    return models


def _parametric_kept(identification: Identification, order: int) -> Reduction:
    """The parametric part with G truncated to `order` states in the scaled variable, where its error bound holds too."""
    import control

    full, rho = identification.model, identification.prior.decay_rate
    n = full.nstates - identification.problem.parametric.states
    A, B, C = full.A[:n, :n], full.B[:n], full.C[:, :n]
    scaled = control.StateSpace(A * rho, B, C * rho, full.D, full.dt)
    small = balanced_truncation(scaled, order=min(order, n))
    a, b, c = (np.asarray(getattr(small.model, name)) for name in "ABC")
    A = scipy.linalg.block_diag(a / rho, full.A[n:, n:])
    B, C = np.vstack([b, full.B[n:]]), np.hstack([c / rho, full.C[:, n:]])
    model = control.ss(A, B, C, full.D, full.dt, inputs=full.input_labels, outputs=full.output_labels, name="reduced")
    return dataclasses.replace(small, model=model)
