"""Smaller models: balanced truncation with its bound, passivity with its proof, the continuous model behind a sampled one."""

from robustid.reduction.balanced import Reduction, ReductionStatus, balanced_truncation, hankel_singular_values
from robustid.reduction.continuous import ContinuousModel, to_continuous
from robustid.reduction.doubtful import DoubtfulMode, without_doubtful_modes
from robustid.reduction.error_norm import PeakError, hinf_error
from robustid.reduction.gramians import doubtful_distance
from robustid.reduction.passive_models import PassiveModel, PassiveStatus, make_passive, reduce_passive
from robustid.reduction.passivity import Passivity, PassivityStatus, prove_passive
from robustid.reduction.passivity_certificate import PassivityCertificate
from robustid.reduction.within_bounds import SearchStatus, reduce_within_bounds
from robustid.reduction.worth import ModelWorth, model_worth_having, why_not_compared

__all__ = [
    "ContinuousModel",
    "DoubtfulMode",
    "ModelWorth",
    "PassiveModel",
    "PassiveStatus",
    "Passivity",
    "PassivityCertificate",
    "PassivityStatus",
    "PeakError",
    "Reduction",
    "ReductionStatus",
    "SearchStatus",
    "balanced_truncation",
    "doubtful_distance",
    "hankel_singular_values",
    "hinf_error",
    "make_passive",
    "model_worth_having",
    "prove_passive",
    "reduce_passive",
    "reduce_within_bounds",
    "to_continuous",
    "why_not_compared",
    "without_doubtful_modes",
]
