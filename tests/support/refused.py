"""Shared by the tests: calls that are refused, one a line."""

import pytest

import robustid as rid


def refused(words, call, /, *arguments, error=rid.InputError, **options):
    """The call is answered by a sentence that has these words."""
    with pytest.raises(error, match=words):
        call(*arguments, **options)
