"""The documents for those who pick the code up name what is there."""

import ast
import re
from pathlib import Path

import pytest

from support.source_trees import nodes

ROOT = Path(__file__).parents[2]
ROWS = [
    (names, files)
    for line in (ROOT / "docs" / "notation.md").read_text(encoding="utf-8").splitlines()
    if line.startswith("|") and "robustid/" in line
    for names, files in [re.split(r"(?<!\\)\|", line)[3:5]]
]


def defined(path):
    """Every name that a file defines: classes, functions, attributes of classes, with and without the class."""
    out = set()
    for node in nodes(path):
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            out.add(node.name)
        if isinstance(node, ast.ClassDef):
            for inner in node.body:
                name = getattr(inner, "name", getattr(getattr(inner, "target", None), "id", None))
                out |= {name, f"{node.name}.{name}"}
    return out


@pytest.mark.parametrize(("names", "files"), ROWS, ids=[names.strip() for names, _ in ROWS])
def test_notation_names_what_stands_in_the_file(names, files):
    known = set()
    for file in re.findall(r"`([^`]+)`", files):
        assert (ROOT / file).is_file(), file
        known |= defined(ROOT / file)
    for name in re.findall(r"`([\w.]+)", names):
        assert name in known, name


def test_the_architecture_names_folders_that_exist():
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    for path in re.findall(r"`(robustid/[\w/.]*|tests/[\w/]*|docs/[\w/.]*|benchmarks/[\w/.]*)`", text):
        assert (ROOT / path).exists(), path
