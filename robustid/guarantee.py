"""Results of guarantees, and further ones: poles in boxes, tubes, weights, stability margins."""

from robustid.guarantees import (
    Band,
    Contradiction,
    CoprimeFactors,
    Family,
    Interconnection,
    LoopDistance,
    Member,
    WorstCaseError,
    diameter,
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
    "LoopDistance",
    "Member",
    "WorstCaseError",
    "diameter",
    "response_tube",
    "robust_stability_margin",
    "structured_weight",
    "structured_weights",
    "uncertainty_weight",
    "worst_case_over_poles",
]
