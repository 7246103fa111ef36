"""Models with a proof: robust identification of lightly damped machines from time and frequency data.

Read and measure:     look, load, save, datasets, FrequencyResponse, TimeRecord, TangentialResponse, Bound, estimate_frf,
                      estimate_bound; robustid.prepare: excitations, faults and corrections, delays, drifts, noise floors
Ask:                  kautz, integrators, Prior, MixedProblem, identify, validate; PositiveReal, NegativeImaginary, BoundedReal
                      for passive plants
Choose:               suggest_kautz, suggest_prior, suggest_next, diagnose; robustid.advise: classes, roll-off, scaling, poles
What is guaranteed:   band, contradiction, worst_case_error, family, coverage, refute; robustid.guarantee: poles in boxes, tubes,
                      weights, stability margins
Plants in a loop:     Loop, loop_from_data, loop_bounds, reduce_plant, interconnection; robustid.prepare.loop_response
Controllers:          design_controller: of fixed structure, for every plant of a band; robustid.design: PID, Notch, LowPass, Limits
Fit:                  fit_mfd, fit_records, RigidBody; robustid.fits: orders, modes, exact conditions, covariance
Small models:         reduce_within_bounds, balanced_truncation, to_continuous, prove_passive; robustid.passive: the nearest one
See and keep:         plot, write_report, show_progress; run and identify_reduced for the whole way in one call
What goes wrong:      errors, InputError, RobustIdError, Status

Every name has a docstring with an example: help(robustid.identify). On the command line: robustid demo, robustid --help.
"""

from typing import Any

import lazy_loader

# The public names stand in __init__.pyi, each loaded on first use. There is no __all__: help(robustid) would print all their help.
_found, __dir__, _NAMES = lazy_loader.attach_stub(__name__, __file__)
_GROUPS = ("prepare", "advise", "guarantee", "fits", "passive", "design", "datasets", "errors")

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
    "ucover": "guarantee.uncertainty_weight",
    "uss": "guarantee.uncertainty_weight",
    "robstab": "guarantee.robust_stability_margin",
    "margin": "guarantee.robust_stability_margin",
    "pidtune": "design_controller",
    "looptune": "design_controller",
    "systune": "design_controller",
    "hinfstruct": "design_controller",
    "hinfsyn": "design_controller",
    "controller": "design_controller",
    "gapmetric": "guarantee.nu_gap",
    "ncfmargin": "guarantee.ncf_margin",
    "rncf": "guarantee.coprime",
    "lncf": "guarantee.coprime",
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
    "enforce_passivity": "passive.make_passive",
    "compare": "validate",
    "resid": "validate",
    "bounds": "worst_case_error",
}


def __getattr__(name: str) -> Any:
    """Load a public name; of another, say which one is meant."""
    try:
        return _found(name)
    except AttributeError:
        if name.startswith("_"):  # asked for by programs, of every module that they look at
            raise

        import difflib

        known = {one: f"{group}.{one}" for group in _GROUPS for one in _found(group).__all__}
        known |= {one: one for one in _NAMES}
        near = difflib.get_close_matches(name, known, 1, 0.75)
        meant = known.get(name) or _MEANT.get(name) or (known[near[0]] if near else None)
        hint = f"; robustid.{meant} is what you look for" if meant else "; help(robustid) lists them by task"
        raise AttributeError(f"robustid has no {name!r}{hint}") from None
