"""Parsed source files of the package, each once: on first use, as every worker collects all tests and one runs them."""

import ast
import functools
import gc


@functools.cache
def tree(path):
    return ast.parse(path.read_text(encoding="utf-8"))


@functools.cache
def nodes(path):
    """All nodes of a file; as they stay, no collection of garbage goes through them."""
    gc.disable()
    found = tuple(ast.walk(tree(path)))
    gc.freeze()
    gc.enable()
    return found
