"""Pages: text of strangers, JSON, nothing fetched."""

import base64
import zlib

import pytest

import robustid as rid
from robustid.report import render_report
from robustid.report.html import packed
from support.report_pages import NASTY, NASTY_NAMES, Page, check_escaped, problem

pytestmark = pytest.mark.quick


def test_text_of_strangers_is_escaped():
    result = rid.identify(problem(**NASTY_NAMES, note=f"from {NASTY} & co"))
    models = {"</script><b>model</b>": rid.datasets.flexible_structure().truth}
    title = "He said \"no\" & 'yes' {{ 7 * 7 }} <h1>"
    page = Page(render_report(result, title=title, models=models))
    check_escaped(page)
    assert sum(tag == "h1" for tag, _ in page.tags) == 1
    for text in (NASTY, "</script>", "y\"'&", "<img src=x onerror=alert(2)>", title, "</script><b>model</b>"):
        assert text in page.text  # shown as it stands


def test_packed_text_can_not_end_its_script_element():
    text = "</script> <!-- & </SCRIPT>"
    assert not set("<>&") & set(packed(text))
    assert zlib.decompress(base64.b64decode(packed(text))).decode() == text


def test_page_needs_nothing_else(consistent_page):
    page = Page(consistent_page)
    for tag, attrs in page.tags:
        assert tag not in ("iframe", "object", "embed", "img")
        assert not attrs.get("src")
        assert attrs.get("href", "data:,") == "data:,"
    policy = next(a["content"] for t, a in page.tags if t == "meta" and "http-equiv" in a)
    assert "default-src 'none'" in policy
    assert "http" not in policy
    assert "showSendToCloud: false" in page.scripts[-1]
