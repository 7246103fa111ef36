"""The functions in which systems are described: interpolation bases and parametric bases."""

from robustid.bases.function import Function, FunctionKind
from robustid.bases.input_normal import (
    InputNormalPair,
    input_normal_pair,
    line_section,
    nodes_pair,
    shift_pair,
    solve_stein,
    stein_powers,
)
from robustid.bases.parametric import ParametricBasis, as_basis, integrators, kautz, stack_bases
from robustid.bases.passive_modes import passive_modes
from robustid.bases.sections import Sections

__all__ = [
    "Function",
    "FunctionKind",
    "InputNormalPair",
    "ParametricBasis",
    "Sections",
    "as_basis",
    "input_normal_pair",
    "integrators",
    "kautz",
    "line_section",
    "nodes_pair",
    "passive_modes",
    "shift_pair",
    "solve_stein",
    "stack_bases",
    "stein_powers",
]
