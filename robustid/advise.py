"""Choices: classes, roll-off, scaling, weights, better poles, modes of several setups, and what a result hangs on."""

from robustid.advice import (
    CommonModes,
    common_modes,
    improve_kautz,
    moved_modes,
    prior_weight,
    sensitivity,
    suggest_class,
    suggest_roll_off,
    suggest_scaling,
)
from robustid.core import explain

__all__ = [
    "CommonModes",
    "common_modes",
    "improve_kautz",
    "moved_modes",
    "prior_weight",
    "sensitivity",
    "suggest_class",
    "suggest_roll_off",
    "suggest_scaling",
]

explain(__name__, __all__)
