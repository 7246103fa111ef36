"""Results of guarantees, and further ones: poles in boxes, tubes, weights, stability margins, distances."""

from robustid.core import explain
from robustid.guarantees import (
    Band,
    Contradiction,
    CoprimeFactors,
    Family,
    Interconnection,
    LoopBounds,
    LoopDistance,
    LoopMargins,
    Member,
    UnstablePlant,
    WorstCaseError,
    coprime,
    diameter,
    ncf_margin,
    nu_gap,
    response_tube,
    robust_stability_margin,
    structured_weight,
    structured_weights,
    uncertainty_weight,
    worst_case_over_poles,
)

__all__ = [
    "Band",
    "Contradiction",
    "CoprimeFactors",
    "Family",
    "Interconnection",
    "LoopBounds",
    "LoopDistance",
    "LoopMargins",
    "Member",
    "UnstablePlant",
    "WorstCaseError",
    "coprime",
    "diameter",
    "ncf_margin",
    "nu_gap",
    "response_tube",
    "robust_stability_margin",
    "structured_weight",
    "structured_weights",
    "uncertainty_weight",
    "worst_case_over_poles",
]

explain(__name__, __all__)
