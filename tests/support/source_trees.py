"""Parsed source files of the package, each once: on first use, as every worker collects all tests and one runs them."""

import ast
import functools


@functools.cache
def tree(path):
    return ast.parse(path.read_text(encoding="utf-8"))


@functools.cache
def nodes(path):
    """All nodes of a file."""
    return tuple(ast.walk(tree(path)))
