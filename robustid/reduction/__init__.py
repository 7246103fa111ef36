"""Smaller models: balanced truncation with its bound, the smallest inside all bounds, the continuous model behind a sampled one."""

from robustid.reduction.balanced import (
    Reduction,
    ReductionStatus,
    balanced_truncation,
    balanced_truncations,
    hankel_singular_values,
)
from robustid.reduction.controller_model import controller_model
from robustid.reduction.doubtful_modes import DoubtfulMode, without_doubtful_modes
from robustid.reduction.error_norm import PeakError, hinf_error, hinf_norm
from robustid.reduction.gramians import MOST_DOUBT, Parts, doubtful_distance, gramian_factors, is_stable
from robustid.reduction.inverse_hold import ContinuousModel, to_continuous
from robustid.reduction.largest_gain import LargestGain, Modes, Values, modes_of, turned
from robustid.reduction.loop_from_data import any_loop, loop_from_data, with_auxiliary
from robustid.reduction.model_worth import ModelWorth, model_worth_having
from robustid.reduction.plant import PlantReduction, plant_of, reduce_plant
from robustid.reduction.response_comparison import why_not_compared
from robustid.reduction.within_bounds import SearchStatus, reduce_within_bounds

__all__ = [
    "MOST_DOUBT",
    "ContinuousModel",
    "DoubtfulMode",
    "LargestGain",
    "ModelWorth",
    "Modes",
    "Parts",
    "PeakError",
    "PlantReduction",
    "Reduction",
    "ReductionStatus",
    "SearchStatus",
    "Values",
    "any_loop",
    "balanced_truncation",
    "balanced_truncations",
    "controller_model",
    "doubtful_distance",
    "gramian_factors",
    "hankel_singular_values",
    "hinf_error",
    "hinf_norm",
    "is_stable",
    "loop_from_data",
    "model_worth_having",
    "modes_of",
    "plant_of",
    "reduce_plant",
    "reduce_within_bounds",
    "to_continuous",
    "turned",
    "why_not_compared",
    "with_auxiliary",
    "without_doubtful_modes",
]
