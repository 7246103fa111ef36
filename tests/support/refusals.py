"""What is refused, and in which words: one call, or a table of them."""

import functools

import pytest

from robustid.errors import InputError


def refusals(*rows, of=None):
    """A test for every row (what, sentence) or (what, sentence, class of the error), which is InputError elsewhere.

    `what` is called, or given to `of`: keywords as a dictionary, arguments as a tuple, or the one argument.
    """

    def called(what):
        if of is None:
            return what
        if isinstance(what, dict):
            return functools.partial(of, **what)
        return functools.partial(of, *what if isinstance(what, tuple) else (what,))

    def test(call, sentence, error):
        with pytest.raises(error, match=sentence):
            call()

    cases = [
        pytest.param(called(what), sentence, *error or [InputError], id=sentence) for what, sentence, *error in rows
    ]
    return pytest.mark.parametrize(("call", "sentence", "error"), cases)(test)


def refused(words, call, /, *arguments, error=InputError, **options):
    """The call is answered by a sentence that has these words."""
    with pytest.raises(error, match=words):
        call(*arguments, **options)
