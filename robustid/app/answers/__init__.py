"""Answers for other programs, printed by commands with --json and returned by the tools of robustid serve."""
