"""Choices: classes, roll-off, scaling, weights, better poles, and what a result hangs on."""

from robustid.advice import improve_kautz, prior_weight, sensitivity, suggest_class, suggest_roll_off, suggest_scaling
from robustid.core import explain

__all__ = ["improve_kautz", "prior_weight", "sensitivity", "suggest_class", "suggest_roll_off", "suggest_scaling"]

explain(__name__, __all__)
