"""The infinite problem as a finite one: functions, rows, the map X(x), in one of four forms."""

from robustid.identification.entries import SINGLE, Entries
from robustid.identification.formulation.assembly import bounded_points, initial_state, measured_entries
from robustid.identification.formulation.base import Formulation
from robustid.identification.formulation.choice import FORMS, formulate, formulate_in, formulate_over, lightest
from robustid.identification.formulation.classical import ClassicalFormulation
from robustid.identification.formulation.columns import DenseDesign
from robustid.identification.formulation.convex import Candidate, ConvexData
from robustid.identification.formulation.exact import QUICK_EXACT, ExactFormulation
from robustid.identification.formulation.no_ball import NoBall
from robustid.identification.formulation.parametric_rows import ToldApart, told_apart_functions
from robustid.identification.formulation.parts import Part, parts_of
from robustid.identification.formulation.rows import Rows, check_equations
from robustid.identification.formulation.sarason import SarasonMap
from robustid.identification.formulation.sections import SectionsFormulation
from robustid.identification.formulation.taylor import TaylorFormulation

__all__ = [
    "FORMS",
    "QUICK_EXACT",
    "SINGLE",
    "Candidate",
    "ClassicalFormulation",
    "ConvexData",
    "DenseDesign",
    "Entries",
    "ExactFormulation",
    "Formulation",
    "NoBall",
    "Part",
    "Rows",
    "SarasonMap",
    "SectionsFormulation",
    "TaylorFormulation",
    "ToldApart",
    "bounded_points",
    "check_equations",
    "formulate",
    "formulate_in",
    "formulate_over",
    "initial_state",
    "lightest",
    "measured_entries",
    "parts_of",
    "told_apart_functions",
]
