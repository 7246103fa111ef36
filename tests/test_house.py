"""The shape of the package: rooms import only backwards, every public name is documented, nothing heavy at import."""

import ast
import pathlib
import subprocess
import sys

import pytest

import robustid

ROOT = pathlib.Path(robustid.__file__).parent
ROOMS = [
    "data",
    "bases",
    "interpolation",
    "solve",
    "identification",
    "mfd",
    "reduction",
    "certify",
    "advice",
    "report",
]
OPEN = ("_arrays", "_files", "_version", "errors")
FILES = sorted(ROOT.rglob("*.py"))


def imported(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def test_rooms_import_only_backwards():
    for path in FILES:
        room = path.relative_to(ROOT).parts[0]
        if room not in ROOMS:
            continue
        for module in imported(path):
            parts = module.split(".")
            if parts[0] != "robustid":
                continue
            assert len(parts) > 1, f"{path} imports the front door"
            if parts[1] in OPEN:
                continue
            assert parts[1] in ROOMS, f"{path} imports {module}"
            assert ROOMS.index(parts[1]) <= ROOMS.index(room), f"{path} imports {module}"


def test_only_the_solve_room_knows_cvxpy_and_interpolation_knows_no_solver():
    for path in FILES:
        room = path.relative_to(ROOT).parts[0]
        heads = {module.split(".")[0] for module in imported(path)}
        if room not in ("solve", "report", "cli.py"):  # a report names the versions
            assert "cvxpy" not in heads, path
        if room == "interpolation":
            assert not any(module.startswith("robustid.solve") for module in imported(path))


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_assert_and_no_print_in_the_library(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        assert not isinstance(node, ast.Assert), f"line {node.lineno}"
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            assert node.func.id not in ("print", "eval", "exec"), f"line {node.lineno}"


def test_public_names_are_sorted_and_documented():
    assert robustid.__all__ == sorted(robustid.__all__)
    for name in robustid.__all__:
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
    code = (
        "import robustid as rid\n"
        "record = rid.TimeRecord([1.0, 0.0], [0.5, 0.7], dt=1.0, bound=1e-3)\n"
        "for rho in (1.01, 1.0):\n"
        "    try:\n"
        "        prior = rid.Prior(gain_bound=1.0, decay_rate=rho)\n"
        "        print(repr(rid.identify(rid.MixedProblem(time=record, prior=prior)).margin))\n"
        "    except rid.InputError as error:\n"
        "        print(error)\n"
    )
    exec(code, {})
    expected = capsys.readouterr().out
    assert "decay_rate" in expected
    optimised = subprocess.run([sys.executable, "-O", "-c", code], capture_output=True, text=True, check=True)
    assert optimised.stdout == expected


def test_every_cited_source_is_in_the_bibliography():
    known = {line.split("{")[1].rstrip(",\n") for line in (ROOT / "references.bib").open() if line.startswith("@")}
    import re

    for path in FILES:
        for key in re.findall(r"`([a-z]+(?:19|20)\d\d)`", path.read_text(encoding="utf-8")):
            assert key in known, f"{path} cites {key}"
