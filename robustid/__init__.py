"""Models with a proof: robust identification of lightly damped machines from time and frequency data.

Read and measure:     look, load, save, datasets, FrequencyResponse, TimeRecord, TangentialResponse, Bound, estimate_frf,
                      estimate_bound; robustid.prepare: excitations, faults and corrections, delays, drifts, noise floors
Ask:                  kautz, integrators, Prior, MixedProblem, identify, validate, compare; PositiveReal, NegativeImaginary,
                      BoundedReal for passive plants
Choose:               suggest_kautz, suggest_prior, suggest_next, diagnose; robustid.advise: classes, roll-off, scaling, poles
What is guaranteed:   band, worst_case_error, family, coverage, refute, watch; robustid.guarantee: poles in boxes, tubes,
                      weights, stability margins
Plants in a loop:     Loop, loop_bounds, reduce_plant, interconnection; robustid.prepare: loop_response, loop_from_data
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


def __getattr__(name: str) -> Any:
    """Load a public name; of another, say which one is meant."""
    try:
        return _opened(name)
    except AttributeError:
        if name.startswith("_"):  # asked for by programs, of every module that they look at
            raise
        from robustid.spellings import meant

        found = meant(name, _known())
        hint = f"; robustid.{found} is what you look for" if found else "; help(robustid) lists them by task"
        raise AttributeError(f"robustid has no {name!r}{hint}") from None


def _known() -> dict[str, str]:
    """Public names, with those of the groups, and where they are found."""
    found = {one: f"{group}.{one}" for group in _GROUPS for one in _found(group).__all__}
    return found | {one: one for one in _NAMES}


def _opened(name: str) -> Any:
    """Load a public name, once, with its wrong calls explained."""
    found = _found(name)
    if name in _NAMES and name not in _GROUPS:
        import importlib  # rooms look for public names here, and none of them is part of a circle

        globals()[name] = found = importlib.import_module("robustid.core").open_to_users(found, name)
    return found
