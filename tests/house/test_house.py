"""The shape of the package: rooms import only backwards, every public name is documented, nothing heavy at import."""

import ast
import functools
import pathlib
import re
import subprocess
import sys

import robustid
from support.source_trees import nodes, tree

ROOT = pathlib.Path(robustid.__file__).parent
ROOMS = [
    *("core", "data", "formats", "estimation", "bases", "identification", "fitting"),
    *("reduction", "passivity", "guarantees", "controllers", "advice", "report", "app"),
]
OPEN = ("_version", "errors", "figures", "spellings")  # import no room
FILES = sorted(ROOT.rglob("*.py"))
NAMES = {".".join(("robustid", *path.relative_to(ROOT).with_suffix("").parts)): path for path in FILES}
NEVER = 10**6  # lines
MODULES = {name.removesuffix(".__init__"): path for name, path in NAMES.items()}


@functools.cache
def names_bound(face):
    """What a face re-exports."""
    return {
        alias.asname or alias.name
        for node in tree(MODULES[face]).body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }


@functools.cache
def imported(name):
    """Every module that a module imports, anywhere in it; `from package import module` is the module."""
    found = set()
    for node in nodes(MODULES[name]):
        if isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                is_module = inner in MODULES and (alias.name not in names_bound(node.module) or node.module == name)
                found.add(inner if is_module else node.module)
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return found


def reached(start, arrows):
    seen, todo = set(), [start]
    while todo:
        new = arrows[todo.pop()] - seen
        seen |= new
        todo += new
    return seen


def room_of(module):
    parts = module.split(".")
    return parts[1] if len(parts) > 1 else ""


def test_rooms_import_only_backwards_and_through_the_face_of_a_room():
    for name, path in MODULES.items():
        room = room_of(name)
        if room not in ROOMS:
            continue
        for module in imported(name):
            if module.split(".")[0] != "robustid" or room_of(module) in OPEN:
                continue
            other = room_of(module)
            assert other in ROOMS, f"{path} imports {module}"
            assert ROOMS.index(other) <= ROOMS.index(room), f"{path} imports {module}"
            is_face = MODULES[module].name == "__init__.py"
            assert other == room or is_face, f"{path} reaches past the face of {other}: {module}"


def test_no_file_is_part_of_an_import_circle():
    arrows = {name: {m for m in imported(name) if m in MODULES and m != name} for name, path in MODULES.items()}
    circles = {name for name in arrows if name in reached(name, arrows)}
    assert not circles, f"these import each other, directly or through others: {sorted(circles)}"


def test_only_the_solver_knows_cvxpy_and_the_formulation_and_the_certificates_know_no_solver():
    blind = ("robustid.identification.formulation", "robustid.identification.certificate")
    blind += ("robustid.identification.exact_evaluation", "robustid.identification.residuals")
    blind += ("robustid.passivity.passivity_certificate", "robustid.passivity.exact_matrices")
    solvers = ("robustid.identification.solver",)
    solvers += ("robustid.passivity.passive_fit", "robustid.passivity.passivity_search")
    for name, path in MODULES.items():
        modules = imported(name)
        if not name.startswith((*solvers, "robustid.report", "robustid.app.cli")):  # versions
            assert "cvxpy" not in {module.split(".")[0] for module in modules}, path
        if name.startswith(blind):
            assert not any(module.startswith(solvers) for module in modules), path


def test_no_assert_and_no_print_in_the_library():
    for path in MODULES.values():
        for node in nodes(path):
            assert not isinstance(node, ast.Assert), f"{path}, line {node.lineno}"
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                assert node.func.id not in ("print", "eval", "exec"), f"{path}, line {node.lineno}"


def test_public_names_are_sorted_and_documented():
    assert dir(robustid) == sorted(dir(robustid))
    for name in dir(robustid):
        value = getattr(robustid, name)
        if callable(value):
            assert value.__doc__, name
            assert value.__doc__.strip().splitlines()[0].strip(), name


def test_importing_loads_nothing_heavy():
    heavy = ["control", "cvxpy", "matplotlib", "plotly", "typer", "h5py", "scipy.signal"]
    code = f"import robustid, sys; print([m for m in {heavy} if m in sys.modules])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"


def test_optimised_python_behaves_the_same(capsys):
    """The proof of a margin, and a refusal; the model would import three times as much, which -O compiles anew."""
    code = (
        "import robustid as rid\n"
        "from robustid.identification import prove_margin\n"
        "from robustid.identification.formulation import formulate\n"
        "record = rid.TimeRecord([1.0, 0.0], [0.5, 0.7], dt=1.0, bound=1e-3)\n"
        "for rho in (1.01, 1.0):\n"
        "    try:\n"
        "        prior = rid.Prior(gain_bound=1.0, decay_rate=rho)\n"
        "        data = formulate(rid.MixedProblem(time=record, prior=prior), accuracy=1e-4).data\n"
        "        print(repr(prove_margin(data, 'structured', 1e-4)[0].margin))\n"
        "    except rid.InputError as error:\n"
        "        print(error)\n"
    )
    exec(code, {})
    expected = capsys.readouterr().out
    assert "decay_rate" in expected
    optimised = subprocess.run([sys.executable, "-O", "-c", code], capture_output=True, text=True, check=True)
    assert optimised.stdout == expected


def test_docstrings_begin_with_a_verb_or_a_noun_phrase_and_say_the_field_s_words():
    for path in MODULES.values():
        for node in nodes(path):
            if isinstance(node, ast.FunctionDef | ast.ClassDef | ast.Module) and (said := ast.get_docstring(node)):
                place = f"{path}, {getattr(node, 'name', 'module')}"
                assert not re.match(r"(What|Whether|Of|How|Where|Which|That|Those|When)\b", said), place
                assert not re.search(r"\b(nearly|channels?|guaranteed_margin)\b", said), place


def test_every_cited_source_is_in_the_bibliography():
    known = {line.split("{")[1].rstrip(",\n") for line in (ROOT / "references.bib").open() if line.startswith("@")}
    for path in FILES:
        for key in re.findall(r"`([a-z]+(?:19|20)\d\d)`", path.read_text(encoding="utf-8")):
            assert key in known, f"{path} cites {key}"


@functools.cache
def puts_the_tests_on_the_path(path):
    """The line of a benchmark from which on the helpers of the tests are found; `NEVER` where they are not."""
    return min(
        (
            node.lineno
            for node in ast.walk(tree(path))
            if (isinstance(node, ast.Constant) and node.value == "tests")
            or (isinstance(node, ast.ImportFrom) and gives(path.with_name(f"{node.module}.py")))
        ),
        default=NEVER,
    )


def gives(path):
    return path.is_file() and puts_the_tests_on_the_path(path) < NEVER


def test_every_benchmark_finds_the_helpers_of_the_tests():
    """Its command is run as it stands in its first lines, from the root, where the tests are on no path."""
    for path in sorted((ROOT.parent / "benchmarks").glob("*.py")):
        wanted = [
            node.lineno
            for node in ast.walk(tree(path))
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("support")
        ]
        assert not wanted or puts_the_tests_on_the_path(path) < min(wanted), path.name
