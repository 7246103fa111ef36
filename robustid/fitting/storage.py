"""Registers the fits that can be saved: of what is loaded, the cost and the realisation are evaluated anew."""

from __future__ import annotations

import numpy as np

from robustid.core import keep, stored
from robustid.fitting.fraction.conditions import Condition, ResponseCondition, RigidModes
from robustid.fitting.fraction.criterion import Weight
from robustid.fitting.fraction.fraction_iteration import FitStatus, FitStep
from robustid.fitting.fraction.fraction_model import FractionModel
from robustid.fitting.fraction.fraction_problem import FractionProblem
from robustid.fitting.fraction.node_fraction import Held, NodeFraction
from robustid.fitting.fraction.vector_polynomials import VectorPolynomials
from robustid.fitting.matrix_fraction import MatrixFraction
from robustid.fitting.modal.modal_structure import Modal
from robustid.fitting.records.record_fit import RecordFit

_SAME = 1e-6  # relative difference of a cost or response that was saved from the one evaluated again


def check_fit(fit: MatrixFraction) -> None:
    """Refuse a fit whose cost or state space is not that of its fraction."""
    problem = fit.problem
    response = fit.fraction.fitted(fit.fraction.response(problem.omega))
    again, rounding = problem.cost(fit.nodes), problem.rounding
    if fit.modal is not None:  # of the exact modes, from which the fraction was formed
        again = float(np.linalg.norm(problem.residual(response))) ** 2
    if not abs(again - fit.cost) <= _SAME * again + rounding:
        raise ValueError(f"its cost is {again:.6g}, and not {fit.cost:.6g}")
    size = float(np.linalg.norm(fit.nodes.response))
    if not np.linalg.norm(response - fit.nodes.response) <= (_SAME + fit.fraction.error) * size:
        raise ValueError("its state-space model is not that of its fraction")


def check_record_fit(fit: RecordFit) -> None:
    """Refuse a fit of records whose cost is not that of its outputs, simulated again."""
    again = sum(
        float(np.sum(((one.y - simulated) * fit.weight) ** 2))
        for one, simulated in zip(fit.records, fit.simulated, strict=True)
    )
    size = sum(float(np.sum((one.y * fit.weight) ** 2)) for one in fit.records)
    if not abs(again - fit.record_cost) <= _SAME * again + _SAME**2 * size:
        raise ValueError(f"its cost is {again:.6g}, and not {fit.record_cost:.6g}")


stored(Condition, FitStatus, FitStep, FractionModel, FractionProblem, Held, Modal, NodeFraction)
stored(ResponseCondition, RigidModes, VectorPolynomials, Weight)
keep(MatrixFraction, "matrix fraction", words="fit", verify=check_fit)
keep(RecordFit, "fit of records", verify=check_record_fit)
