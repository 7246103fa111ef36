"""Pages: text of strangers, JSON, nothing fetched."""

from __future__ import annotations

import base64
import re
import zlib
from typing import Any

import pytest

import robustid as rid
from robustid.report import render_report
from robustid.report.html import packed
from support.report_pages import NASTY, Page, problem

pytestmark = pytest.mark.quick


def test_text_of_strangers_is_escaped() -> None:
    names = {"inputs": [(NASTY, "</script>")], "outputs": [("y\"'&", "<img src=x onerror=alert(2)>")]}
    result = rid.identify(problem(**names, note=f"from {NASTY} & co"))
    models = {"</script><b>model</b>": rid.flexible_structure().truth}
    title = "He said \"no\" & 'yes' {{ 7 * 7 }} <h1>"
    page = Page(render_report(result, title=title, models=models))
    assert len(page.scripts) == 3
    assert not any("alert(1)" in script for script in (page.scripts[0], page.scripts[2]))
    assert [tag for tag, _ in page.tags if tag in ("img", "b")].count("img") == 0
    assert sum(tag == "h1" for tag, _ in page.tags) == 1
    for text in (NASTY, "</script>", "y\"'&", "<img src=x onerror=alert(2)>", title, "</script><b>model</b>"):
        assert text in page.text  # shown as it stands
    # In plotly's labels, which read a subset of HTML, no tag is left but our own line break.
    for label in _labels(page.figures):
        assert not re.search(r"<(?!br>)", label), label


def test_packed_text_can_not_end_its_script_element() -> None:
    text = "</script> <!-- & </SCRIPT>"
    assert not set("<>&") & set(packed(text))
    assert zlib.decompress(base64.b64decode(packed(text))).decode() == text


def _labels(value: Any) -> list[str]:
    if isinstance(value, dict):
        return [text for item in value.values() for text in _labels(item)]
    if isinstance(value, list):
        return [text for item in value for text in _labels(item)]
    return [value] if isinstance(value, str) else []


def test_page_needs_nothing_else(consistent: rid.Identification) -> None:
    page = Page(render_report(consistent))
    for tag, attrs in page.tags:
        assert tag not in ("iframe", "object", "embed", "img")
        assert not attrs.get("src")
        assert attrs.get("href", "data:,") == "data:,"
    policy = next(a["content"] for t, a in page.tags if t == "meta" and "http-equiv" in a)
    assert "default-src 'none'" in policy
    assert "http" not in policy
    assert "showSendToCloud: false" in page.scripts[-1]
