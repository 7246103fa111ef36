"""The infinite problem as a finite one: functions, rows, the map X(x)."""

from robustid.identification.formulation.assembly import initial_state, measured_entries
from robustid.identification.formulation.entries import SINGLE, Entries
from robustid.identification.formulation.functions import line_tails
from robustid.identification.formulation.rows import Rows, measurement_rows
from robustid.identification.formulation.sarason import SarasonMap

__all__ = [
    "SINGLE",
    "Entries",
    "Rows",
    "SarasonMap",
    "initial_state",
    "line_tails",
    "measured_entries",
    "measurement_rows",
]
