"""The site built twice from the same tree: the same pages, and no address of another machine in them."""

import itertools
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from support.browser import CHROMIUM
from support.contrast import least_contrast
from support.driven import Browser

DOCS = Path(__file__).parents[2] / "docs"
TIMES = re.compile(rb"\b\d+(\.\d+)? ?(s|seconds|ms)\b")
# What a page loads from elsewhere; links to click on are none of it.
LOADED = re.compile(
    r"""(?:<script[^>]*\bsrc|<img[^>]*\bsrc|<link[^>]*rel="stylesheet"[^>]*\bhref)=["']https?://[^"']+"""
)


def build(folder):
    nowhere, trees = "http://127.0.0.1:9", folder.parent / f"{folder.name}_trees"
    environment = os.environ | {"ROBUSTID_GALLERY": "conditioning", "https_proxy": nowhere, "http_proxy": nowhere}
    command = [sys.executable, *["-m", "sphinx", "-q", "-W", "-E", "-d"], str(trees), str(DOCS), str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    files = [path for path in folder.rglob("*") if path.is_file()]
    skipped = (".buildinfo", "environment.pickle")
    return {path.relative_to(folder): path.read_bytes() for path in files if path.name not in skipped}


def check_shown(folder, pages, profile):
    """All text stands out in both themes, and nothing is wider than a phone."""
    with Browser(profile, width=390) as browser:
        for path in pages:
            browser.open((folder / path).as_uri())
            browser.wait(f"document.readyState === 'complete' && location.href.endsWith('{path.as_posix()}')")
            assert browser.value("document.documentElement.scrollWidth") <= 390, path
            for theme in ("light", "dark"):
                browser.value(f"document.documentElement.dataset.theme = '{theme}'")
                ratio, text = least_contrast(browser)
                assert ratio >= 1, (path, theme, text)


@pytest.mark.slow
def test_two_builds_are_the_same_and_load_nothing_from_elsewhere(tmp_path):
    pytest.importorskip("sphinx")
    one, other = build(tmp_path / "one"), build(tmp_path / "other")
    assert one.keys() == other.keys()
    differ = [str(path) for path in one if TIMES.sub(b"T", one[path]) != TIMES.sub(b"T", other[path])]
    assert not differ
    pages = [path for path in one if path.suffix == ".html" and path.parts[0] != "_static"]
    assert len(pages) > 100
    if CHROMIUM is not None:
        check_shown(tmp_path / "one", pages, tmp_path / "profile")
    for path in pages:
        text = one[path].decode()
        assert re.search(r'<html[^>]* lang="en"', text), path
        assert len(re.findall(r"<title>[^<]+</title>", text)) == 1, path
        levels = [
            int(level) for level in re.findall(r"<h([1-6])\b", text.split("<article", 1)[-1].split("</article>")[0])
        ]
        assert levels[:1] == [1] or path.name in ("search.html", "genindex.html"), (path, levels)
        assert all(below <= above + 1 for above, below in itertools.pairwise(levels)), (path, levels)
        assert not (found := LOADED.findall(one[path].decode())), (path, found[:3])
        assert b"<img" not in one[path] or all(b"alt=" in tag for tag in re.findall(rb"<img[^>]*>", one[path])), path
