"""Calls that Python refuses, explained: arguments that need their name, and names that are no arguments."""

from __future__ import annotations

import difflib
import functools
import inspect
import sys
from collections.abc import Callable, Iterable
from types import CodeType, FunctionType
from typing import Any, NamedTuple, cast

from robustid.errors import InputTypeError

_LONG = 30  # letters of a value that is said


class _Arguments(NamedTuple):
    """Names of the arguments of a function: those taken by their place, all of them, and whether it takes any others."""

    placed: int
    names: tuple[str, ...]
    known: frozenset[str]
    any_placed: bool
    any_named: bool


@functools.cache
def _arguments(code: CodeType) -> _Arguments:
    names = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
    takes = bool(code.co_flags & inspect.CO_VARARGS), bool(code.co_flags & inspect.CO_VARKEYWORDS)
    return _Arguments(code.co_argcount, names, frozenset(names), *takes)


def check_call(name: str, function: FunctionType, given: tuple[object, ...], named: dict[str, object]) -> None:
    """Refuse a call that the function would refuse for arguments without a name, or for names that it has not."""
    own = _arguments(function.__code__)
    if len(given) > own.placed and not own.any_placed:
        raise InputTypeError(_unnamed(name, function, own, given, named))
    if not own.any_named and not named.keys() <= own.known:
        unknown = min(named.keys() - own.known)
        names = [one for one in own.names if one not in ("self", "cls", "_")]
        near = difflib.get_close_matches(unknown, names, 1, 0.6)
        hint = f"do you mean `{near[0]}`? " if near else ""
        raise InputTypeError(f"`{unknown}` is no argument of {name}; {hint}It has {', '.join(names)}")


def _unnamed(
    name: str, function: FunctionType, own: _Arguments, given: tuple[object, ...], named: dict[str, object]
) -> str:
    """Say which names the arguments beyond the places most likely have: those first that are needed."""
    itself = own.names[:1] in (("self",), ("cls",))  # of a method, which nobody writes
    free = [one for one in own.names[own.placed :] if one not in named]
    free.sort(key=lambda one: one in (function.__kwdefaults__ or {}))
    taken = own.placed - itself
    got = f"got {len(given) - itself} arguments without a name, where {taken} {'is' if taken == 1 else 'are'} taken"
    if not free:
        return f"{name} takes fewer arguments; {got}"
    said = ", ".join(f"{one}={_short(value)}" for one, value in zip(free, given[own.placed :], strict=False))
    others = f". Its other names: {', '.join(free[1:])}" if free[1:] else ""
    return f"`{free[0]}` is given by its name: {name}({'..., ' if taken else ''}{said}); {got}{others}"


def _short(value: object) -> str:
    text = repr(value) if isinstance(value, bool | int | float | complex | str) else "..."
    return text if len(text) <= _LONG else "..."


def explained(function: Callable[..., Any], name: str) -> Callable[..., Any]:
    """Return a function whose wrong calls are explained."""
    inner = inspect.unwrap(function)
    if not isinstance(inner, FunctionType):
        return function

    @functools.wraps(function)
    def called(*given: Any, **named: Any) -> Any:
        check_call(name, inner, given, named)
        return function(*given, **named)

    return called


def explain(module: str, names: Iterable[str]) -> None:
    """Explain wrong calls of everything in a module that users call."""
    namespace = vars(sys.modules[module])
    for name in names:
        namespace[name] = open_to_users(namespace[name], name)


def open_to_users(thing: Any, name: str) -> Any:
    """Return a function whose wrong calls are explained, or the class with such a constructor; everything else as it is."""
    if isinstance(thing, FunctionType):
        found: Any = explained(thing, name)
        cast("Any", thing).explained = found.explained = found  # where pickle finds it for other processes
        found.__qualname__ = f"{thing.__qualname__}.explained"
        return found
    own = vars(thing).get("__init__") if isinstance(thing, type) else None
    if isinstance(own, FunctionType) and not hasattr(own, "__wrapped__"):
        cast("Any", thing).__init__ = explained(own, name)
    return thing


def explain_methods(cls: type) -> None:
    """Explain wrong calls of the methods of a class that take arguments by name only."""
    for name, method in list(vars(cls).items()):
        own: Any = method
        bound = isinstance(method, classmethod | staticmethod)
        inner: Any = own.__func__ if bound else own
        if name.startswith("_") or not isinstance(inner, FunctionType):
            continue
        if inspect.unwrap(inner).__code__.co_kwonlyargcount:
            again = explained(inner, name)
            setattr(cls, name, type(own)(again) if bound else again)
