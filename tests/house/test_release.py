"""Readiness for a release: one version, what the wheel holds, an import without warnings; in full, an empty environment."""

import json
import os
import pathlib
import re
import subprocess
import sys
import tomllib
import venv
import zipfile

import pytest

import robustid

TREE = pathlib.Path(__file__).parents[2]
NEEDED = ("py.typed", "__init__.pyi", "references.bib", "report/document.html.j2")


def test_the_version_stands_in_one_place_and_what_cites_it_agrees():
    stated = re.findall(r"^version: (\S+)$", (TREE / "CITATION.cff").read_text(encoding="utf-8"), re.M)
    assert stated == [robustid.__version__]
    assert 'dynamic = ["version"]' in (TREE / "pyproject.toml").read_text(encoding="utf-8")


def test_the_recipe_of_the_conda_package_asks_for_what_the_wheel_asks():
    recipe = (TREE / "packaging/recipe.yaml").read_text(encoding="utf-8")
    project = tomllib.loads((TREE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert f'version: "{robustid.__version__}"' in recipe
    assert [f"{name} = {place}" for name, place in project["scripts"].items()] == re.findall(
        r"^      - (.+)$", recipe.split("entry_points:\n")[1].split("\n\n")[0], re.M
    )
    stated = re.findall(r"^    - ([\w.-]+) (>=\S+)$", recipe.split("  run:\n")[1], re.M)
    asked = [re.fullmatch(r"([\w.-]+)(>=\S+)", one).groups() for one in project["dependencies"]]
    names = {"matplotlib": "matplotlib-base"}  # conda's name of the part without a window
    assert stated == [
        ("python", project["requires-python"]),
        *((names.get(name, name), least) for name, least in asked),
    ]


@pytest.mark.slow
def test_the_recipe_is_rendered_by_its_tool_offline():
    tool = pytest.importorskip("rattler_build")
    (found,) = tool.Stage0Recipe.from_file(str(TREE / "packaging/recipe.yaml")).render(tool.VariantConfig())
    assert found.recipe.to_dict()["package"] == {"name": "robustid", "version": robustid.__version__}


def test_an_import_warns_of_nothing():
    done = subprocess.run([sys.executable, "-W", "error", "-c", "import robustid"], capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (0, b"")


@pytest.mark.slow
def test_wheel_and_source_install_into_an_empty_environment(tmp_path):
    """Both are built, hold all that is read at run time, and a run of the demo works in a folder of its own."""
    pytest.importorskip("build")
    subprocess.run([sys.executable, "-m", "build", "-q", "--outdir", str(tmp_path), str(TREE)], check=True)
    (wheel,) = tmp_path.glob("*.whl")
    (source,) = tmp_path.glob("*.tar.gz")
    names = zipfile.ZipFile(wheel).namelist()
    bare = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}  # it may name this tree
    assert all(f"robustid/{name}" in names for name in NEEDED)
    assert not [name for name in names if name.startswith(("tests", "docs"))]
    for package in (wheel, source):
        home = tmp_path / package.suffix.strip(".")
        venv.create(home, with_pip=True)
        python = str(home / "bin" / "python")
        subprocess.run([python, "-m", "pip", "install", "-q", str(package)], check=True)
        code = "import robustid, json; print(json.dumps([robustid.__version__, robustid.__file__]))"
        said = subprocess.run(
            [python, "-W", "error", "-c", code], capture_output=True, check=True, cwd=tmp_path, env=bare
        )
        version, place = json.loads(said.stdout)
        assert version == robustid.__version__
        assert pathlib.Path(place).is_relative_to(home)
        subprocess.run(
            [python, "-m", "robustid", "demo", "-o", f"demo-{home.name}"], check=True, cwd=tmp_path, env=bare
        )
        assert (tmp_path / f"demo-{home.name}" / "report.html").exists()
