"""Answers of commands and tools, each held to the schema that is published."""

import json

import pytest

from robustid.app.answers.form import schema


def checked(found):
    """An answer that its schema allows."""
    jsonschema = pytest.importorskip("jsonschema")
    jsonschema.Draft202012Validator(schema()).validate(found)
    return found


def answered(outcome):
    """The answer on stdout of a command, with its exit code."""
    code, out, _ = outcome
    found = checked(json.loads(out))
    assert found["exit_code"] == code
    return found
