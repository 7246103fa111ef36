"""Sentences are for people: no code reads the text of an exception."""

import ast
import collections
import pathlib

import robustid
from support.source_trees import nodes

ROOT = pathlib.Path(robustid.__file__).parent

SHORTENED = ["formats/table.py: said"]  # the first line of what foreign libraries say, for a sentence of ours
READS = {
    *("startswith", "endswith", "split", "rsplit", "splitlines", "partition", "rpartition", "removeprefix"),
    *("removesuffix", "replace", "find", "rfind", "index", "rindex", "count", "lower", "upper", "strip"),
}
MATCHES = {"search", "match", "fullmatch", "sub", "subn", "findall", "finditer", "split", "loads"}
ERROR, TEXT = "error", "text"


class Reader(ast.NodeVisitor):
    """Follows errors and their texts through a function, and into the functions that are given them."""

    def __init__(self, known):
        self.known, self.passed, self.found = dict(known), [], []

    def kind(self, node):
        """Error, text of one, or None."""
        if isinstance(node, ast.Name):
            return self.known.get(node.id)
        if isinstance(node, ast.Attribute):
            return TEXT if node.attr == "args" and self.kind(node.value) == ERROR else None
        if isinstance(node, ast.JoinedStr):
            parts = [part.value for part in node.values if isinstance(part, ast.FormattedValue)]
            return TEXT if any(map(self.kind, parts)) else None
        if isinstance(node, ast.Call):
            named = isinstance(node.func, ast.Name) and node.func.id in ("str", "repr")
            if named and node.args and self.kind(node.args[0]):
                return TEXT
            own = isinstance(node.func, ast.Attribute) and node.func.attr == "said"
            return TEXT if own and self.kind(node.func.value) == ERROR else None
        return self.kind(node.value) if isinstance(node, ast.Subscript) else None

    def visit_ExceptHandler(self, node):
        if node.name:
            self.known[node.name] = ERROR
        self.generic_visit(node)

    def visit_Assign(self, node):
        for target in node.targets:
            if isinstance(target, ast.Name) and (kind := self.kind(node.value)):
                self.known[target.id] = kind
        self.generic_visit(node)

    def visit_Call(self, node):
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        given = [(place, self.kind(one)) for place, one in enumerate(node.args)]
        given += [(one.arg, self.kind(one.value)) for one in node.keywords]
        self.passed += [(name, place, kind) for place, kind in given if kind]
        own = isinstance(node.func, ast.Attribute) and self.kind(node.func.value) == TEXT
        if (own and name in READS) or (name in MATCHES and TEXT in dict(given).values()):
            self.found.append(node.lineno)
        self.generic_visit(node)

    def visit_Compare(self, node):
        if TEXT in map(self.kind, [node.left, *node.comparators]):
            self.found.append(node.lineno)
        self.generic_visit(node)

    def visit_Subscript(self, node):
        inner = node.value
        if self.kind(inner) == TEXT and not (isinstance(inner, ast.Attribute) and inner.attr == "args"):
            self.found.append(node.lineno)
        self.generic_visit(node)


def parameters(function, told):
    """What the parameters are known to be: by their annotations, and by what calls hand over, by place or by name."""
    known = {}
    places = [arg.arg for arg in (*function.args.posonlyargs, *function.args.args) if arg.arg not in ("self", "cls")]
    for arg in (*function.args.args, *function.args.kwonlyargs):
        if arg.annotation is not None and ast.unparse(arg.annotation).endswith(("Error", "Exception")):
            known[arg.arg] = ERROR
    known |= {place: kind for place, kind in told.items() if isinstance(place, str)}
    return known | {
        places[place]: kind for place, kind in told.items() if isinstance(place, int) and place < len(places)
    }


def readers(sources):
    """Where the text of an exception is read, "file: function", in the nodes of files."""
    named, ours = collections.defaultdict(list), collections.defaultdict(set)
    for name, source in sources.items():
        for node in source:
            if isinstance(node, ast.FunctionDef):  # those inside of others too
                named[node.name].append((name, node))
            elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith("robustid"):
                ours[name] |= {alias.name for alias in node.names}
    caught = {
        name: [one.lineno for one in source if isinstance(one, ast.ExceptHandler)] for name, source in sources.items()
    }
    handed = collections.defaultdict(dict)  # to a function: kind by place or name of a parameter
    todo, found = [one for same in named.values() for one in same], set()
    while todo:
        name, function = todo.pop()
        known = parameters(function, handed[function])
        if not known and not any(function.lineno < line <= function.end_lineno for line in caught[name]):
            continue
        reader = Reader(known)
        for line in function.body:
            reader.visit(line)
        if reader.found:
            found.add(f"{name}: {function.name}")
        for called, place, kind in reader.passed:
            for file, other in named[called]:
                if (file == name or called in ours[name]) and place not in handed[other]:
                    handed[other][place] = kind
                    todo.append((file, other))
    return sorted(found)


def test_no_code_reads_the_text_of_an_exception():
    files = {str(path.relative_to(ROOT)): path for path in ROOT.rglob("*.py")}
    assert readers({name: nodes(path) for name, path in files.items()}) == SHORTENED
    assert [name for name, path in files.items() if "getMessage" in path.read_text(encoding="utf-8")] == []


def test_what_reads_a_text_is_seen():
    def seen(*lines):
        body = "\n        ".join(lines)
        source = f"def f():\n    try:\n        g()\n    except E as error:\n        {body}\n" + OTHERS
        return readers({"a.py": tuple(ast.walk(ast.parse(source)))})

    OTHERS = "def g(x, text=None):\n    return re.sub('a', 'b', text)\ndef h(x):\n    return 'a' in str(x)\n"
    assert seen("raise E(f'place: {error}') from None") == []
    assert seen("log.info('%s', error)", "x = str(error)", "raise E(x)") == []
    assert seen("if 'hash' in str(error):", "    raise") == ["a.py: f"]
    assert seen("x = str(error)", "return x.split('. ')[0]") == ["a.py: f"]
    assert seen("return error.args[0].replace('`', '')") == ["a.py: f"]
    assert seen("return re.sub('a', 'b', f'{error}')") == ["a.py: f"]
    assert seen("return PATTERN.search(str(error))") == ["a.py: f"]
    assert seen("return g(1, str(error))") == seen("return g(1, text=str(error))") == ["a.py: g"]
    assert seen("return h(error)") == ["a.py: h"]
