"""State is data, prose is for people: no code reads what was written for them."""

import ast
import pathlib
import re

import pytest

import robustid
from support.source_trees import nodes

ROOT = pathlib.Path(robustid.__file__).parent
PROSE = {"note", "notes", "reason", "reasons", "label", "labels", "message", "sentence", "sentences", "summary"}
MADE = PROSE | {"words", "verdict", "finding", "findings", "heading", "advice", "about"}  # by a property or function
READS = {"startswith", "endswith", "removeprefix", "removesuffix", "replace", "find", "rfind", "index", "count"}
READS |= {"split", "rsplit", "partition", "rpartition"}
PATTERNS = {"match", "fullmatch", "search", "sub", "subn", "split", "findall", "finditer"}


def is_prose(node):
    """A name or attribute for prose, also in brackets, called, indexed, or with a default."""
    match node:
        case ast.Name(id=name):
            return name in PROSE
        case ast.Attribute(attr=name) | ast.Call(func=ast.Name(id=name)) if name.rsplit("_", 1)[-1] in MADE:
            return True
        case ast.BoolOp(values=values):
            return any(map(is_prose, values))
        case ast.Call(func=ast.Name(id="str"), args=args):
            return any(map(is_prose, args))
        case ast.Call(func=inner) | ast.Subscript(value=inner):
            return is_prose(inner)
    return False


def is_phrase(node):
    """A part of a sentence: a constant, or text that is put together, with a letter beside a space; or what names prose."""
    match node:
        case ast.Constant(value=str(text)):
            return bool(re.search(r"[^\W\d_] | [^\W\d_]", text))
        case ast.JoinedStr(values=values):
            return any(isinstance(one, ast.Constant) and " " in str(one.value) for one in values)
    return is_prose(node)


def reads(node):
    """True for an expression that looks into prose: a method, a pattern, `in`, or a comparison with a constant."""
    match node:
        case ast.Call(func=ast.Attribute(attr="replace"), args=[ast.Constant(value=str(one)), _]) if len(one) == 1:
            return False  # a letter is escaped for a medium
        case ast.Call(func=ast.Attribute(value=ast.Name(id="dataclasses"))):
            return False
        case ast.Call(func=ast.Attribute(value=owner, attr=method), args=args):
            return (method in READS and (is_prose(owner) or any(map(is_phrase, args[:1])))) or (
                method in PATTERNS and any(map(is_prose, args))
            )
        case ast.Compare(left=left, ops=[ast.In() | ast.NotIn()], comparators=[right]):
            return is_prose(left) or is_prose(right)
        case ast.Compare(left=left, ops=[ast.Eq() | ast.NotEq()], comparators=[right]):
            return any(
                is_prose(a) and isinstance(b, ast.Constant) and b.value for a, b in ((left, right), (right, left))
            )
    return False


def test_no_code_branches_on_a_sentence():
    found = [
        f"{path.relative_to(ROOT)}, line {node.lineno}: {ast.unparse(node)}"
        for path in sorted(ROOT.rglob("*.py"))
        for node in nodes(path)
        if isinstance(node, ast.Call | ast.Compare) and reads(node)
    ]
    assert not found, "state must be typed, not read from text:\n" + "\n".join(found)


@pytest.mark.parametrize(
    ("code", "bad"),
    [
        ('(run.modes.note or "").startswith(CHOSEN)', True),
        ("any(words in frf.note for words in NOTED)", True),
        ("basis.labels[-1] == 'constant'", True),
        ("PATTERN.search(str(result.message))", True),
        ("found.summary().split(':')", True),
        ("bound.words().replace(' jointly', '')", True),
        ("said(bound).replace(' jointly', '')", True),
        ("said(bound).removeprefix(about(bound))", True),
        ("found.verdict.split(': ', 1)", True),
        ("name.removeprefix(f'{word} of the ')", True),
        ("band_sentence(band).startswith(start)", True),
        ("name.removeprefix('withheld-')", False),
        ("dataclasses.replace(found, note=note)", False),
        ("dataclasses.replace(band_sentence(found), note=note)", False),
        ("""label.replace("'", "''")""", False),
        ("note.splitlines()", False),  # laid out, not read
        ("choice.source is Source.DATA", False),
        ("[label for label in labels]", False),
    ],
)
def test_reading_is_told_from_writing(code, bad):
    assert any(map(reads, ast.walk(ast.parse(code)))) == bad
