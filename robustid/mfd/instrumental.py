"""Instrumental variables: Sanathanan-Koerner's equations seen by the gradient of the model, condition number one."""

from __future__ import annotations

from robustid.mfd.biorthonormal_polynomials import BiorthonormalPolynomials, biorthonormal_polynomials
from robustid.mfd.node_fraction import NodeFraction
from robustid.mfd.problem import FractionProblem


def iv_step(problem: FractionProblem, fraction: NodeFraction) -> tuple[NodeFraction, float]:
    """One instrumental-variable step, whose fixed points are the stationary points of the criterion.

    ``Re sum_k (J_k psi(xi_k))^H A_k x(xi_k) = 0`` for x = vec([D; N]) and all polynomials psi of its free degrees, with
    ``A = W (D_old^{-T} kron [P_o -I])`` and ``J = W (D_old^{-T} kron [P_old -I])``. At x = x_old, A x is the residual
    and J psi (but for the sign) the change of the model along psi: the equations are those of a vanishing gradient.

    Parameters
    ----------
    problem : FractionProblem
    fraction : NodeFraction
        D_old and N_old, in the form of the problem. Constraints and rigid-body modes of the problem are not looked at.

    Returns
    -------
    fraction : NodeFraction
    condition : float
        Of the matrix of the equations.

    Raises
    ------
    BreakdownError
        When the pair of bases does not exist (see `biorthonormal_polynomials`); numpy's LinAlgError, of which it is
        one, when D_old is singular on a line.

    Notes
    -----
    It is no descent method and need not converge: keep the best fraction met. Source: `vanherpen2014`, `voorhoeve2016`.

    Examples
    --------
    >>> import numpy as np
    >>> from robustid.mfd import Weight
    >>> from robustid.mfd.steps import gauss_newton_direction, sk_step
    >>> omega = np.linspace(1, 9, 40)
    >>> values = ((1 + 0.1 * np.cos(9 * omega)) / ((1j * omega) ** 2 + 0.2j * omega + 16))[:, None, None]
    >>> problem = FractionProblem(omega, values, 2, Weight.relative(values))
    >>> fraction, _ = sk_step(problem, np.ones((40, 1, 1)))
    >>> for _ in range(20):
    ...     fraction, condition = iv_step(problem, fraction)
    >>> gauss_newton_direction(problem, fraction).slope < 1e-8, condition - 1 < 1e-12
    (True, True)
    """
    pair = instrumental_pair(problem, fraction)
    solution = pair.monic(problem.leading)
    return problem.split(pair.evaluate(pair.xi, *solution[:3])), pair.condition


def instrumental_pair(problem: FractionProblem, fraction: NodeFraction) -> BiorthonormalPolynomials:
    """Polynomials bi-orthonormal for ``W(k) (D^{-T} kron [P_o -I])`` and, as tests, the same with the model's P."""
    trial, test = (
        problem.regressor(fraction.denominators, response) for response in (problem.values, fraction.response)
    )
    return biorthonormal_polynomials(trial, test, problem.xi, problem.limits)
