"""Files for other programs: MATLAB, C, filters of control rooms, JSON, tables, universal files."""

from robustid.app.exports.by_ending import exported
from robustid.app.exports.controller_source import write_controller_c

__all__ = ["exported", "write_controller_c"]
