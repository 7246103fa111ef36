"""Shared by the tests: cli runs."""

from support import command_line


def run(arguments, capsys, monkeypatch):
    return command_line.main(arguments, capsys, monkeypatch)
