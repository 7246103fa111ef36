"""Files for other programs: MATLAB, C, filters of control rooms, JSON, tables, universal files."""

from robustid.app.exports.by_ending import exported

__all__ = ["exported"]
