"""The pages of the site: every block of code runs as printed."""

import doctest
from pathlib import Path

import pytest

from support.cases import slow
from support.run_files import search_nothing

DOCS = Path(__file__).parents[2] / "docs"
PAGES = sorted(
    page.relative_to(DOCS).as_posix()
    for page in DOCS.glob("**/*.rst")
    if ">>> " in page.read_text(encoding="utf-8") and page.parts[len(DOCS.parts)] not in ("reference", "gallery")
)


@pytest.mark.parametrize("page", PAGES)
@pytest.mark.parametrize("whole", [False, slow(True)], ids=["quick", "whole"])
def test_code_of_a_page_runs_as_printed(page, whole, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if not whole:
        search_nothing(monkeypatch)
    found = doctest.testfile(
        str(DOCS / page),
        module_relative=False,
        encoding="utf-8",
        optionflags=doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS,
    )
    assert found.attempted > 0
    assert found.failed == 0


def test_there_are_twelve_recipes():
    recipes = [page for page in PAGES if page.startswith("howto/")]
    assert len(recipes) >= 12
    index = (DOCS / "howto/index.rst").read_text(encoding="utf-8")
    assert all(Path(page).stem in index for page in recipes)
