"""Models with a proof: robust identification of lightly damped machines from time and frequency data.

Read and measure:     look, load, save, FrequencyResponse, TimeRecord, Bound, estimate_frf, multisine, record_faults,
                      response_faults, correct, datasets
Ask:                  kautz, Prior, MixedProblem, identify; PositiveReal, NegativeImaginary, BoundedReal for passive plants
Choose:               suggest_kautz, suggest_prior, suggest_class; diagnose where data contradict the class
What is guaranteed:   band, worst_case_error, worst_case_over_poles, response_tube, coverage, family, robust_stability_margin,
                      uncertainty_weight, structured_weights, contradiction, refute
Fit:                  fit_mfd, suggest_order, RigidBody, Modal, mode_table, fit_covariance, fit_records
Small models:         reduce_within_bounds, balanced_truncation, make_passive, to_continuous
See and keep:         plot, write_report, save; run and identify_reduced for the whole way in one call

Every name has a docstring with an example: help(robustid.identify). On the command line: robustid demo, robustid --help.
"""

import importlib
from typing import Any

import lazy_loader

# The public names stand in __init__.pyi, by room; each is loaded on first use.
_found, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

# Names that engineers type, of other programs or of parts of this one.
_MEANT = {
    "bode": "plot.bode",
    "nyquist": "plot.nyquist",
    "residuals": "plot.residuals",
    "vectfit": "fit_mfd",
    "vector_fitting": "fit_mfd",
    "tfest": "fit_mfd",
    "ssest": "fit_mfd",
    "n4sid": "fit_mfd",
    "fit": "fit_mfd",
    "oe": "fit_records",
    "arx": "fit_records",
    "etfe": "estimate_frf",
    "spa": "estimate_frf",
    "tfestimate": "estimate_frf",
    "frf": "estimate_frf",
    "FRD": "FrequencyResponse",
    "frd": "FrequencyResponse",
    "idfrd": "FrequencyResponse",
    "iddata": "TimeRecord",
    "ucover": "uncertainty_weight",
    "uss": "uncertainty_weight",
    "robstab": "robust_stability_margin",
    "margin": "robust_stability_margin",
    "reduce": "reduce_within_bounds",
    "balred": "balanced_truncation",
    "hsvd": "balanced_truncation",
    "d2c": "to_continuous",
    "read": "load",
    "open": "load",
    "read_csv": "load",
    "load_model": "load",
    "write": "save",
    "save_model": "save",
    "export": "save",
    "help_me": "diagnose",
    "why": "diagnose",
    "modes": "kautz",
    "poles": "kautz",
    "Kautz": "kautz",
    "enforce_passivity": "make_passive",
    "compare": "validate",
    "resid": "validate",
    "bounds": "worst_case_error",
}


def __getattr__(name: str) -> Any:
    """Load a public name; of another, say which one is meant."""
    try:
        found = _found(name)
    except AttributeError:
        import difflib

        meant = _MEANT.get(name) or next(iter(difflib.get_close_matches(name, __all__, 1, 0.75)), None)
        hint = f"; robustid.{meant} is what you look for" if meant else "; help(robustid) lists them by task"
        raise AttributeError(f"robustid has no {name!r}{hint}") from None
    if (
        name in __all__
    ):  # whatever is made with it can be saved: the files of measurements are registered by a room behind theirs
        importlib.import_module("robustid.formats")
    return found
