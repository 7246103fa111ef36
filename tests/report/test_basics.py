"""What everybody needs of a page: contrast of its colours, a language, words for its pictures, headings in order."""

import itertools
import pathlib
import re

import pytest

import robustid as rid
from support.browser import CHROMIUM
from support.contrast import least_contrast
from support.driven import Browser

TEMPLATE = (pathlib.Path(rid.__file__).parent / "report/document.html.j2").read_text(encoding="utf-8")
WHITE = "#ffffff"


def luminance(colour):
    digits = colour.lstrip("#")
    digits = digits if len(digits) == 6 else "".join(2 * digit for digit in digits)
    parts = [int(digits[k : k + 2], 16) / 255 for k in (0, 2, 4)]
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one, other):
    """Ratio of WCAG 2: from 1 to 21; text needs 4.5."""
    light, dark = sorted((luminance(one), luminance(other)), reverse=True)
    return (light + 0.05) / (dark + 0.05)


def named(name):
    return re.search(rf"--{name}: (#[0-9a-f]{{6}})", TEMPLATE)[1]


def test_the_ratio_is_that_of_the_standard():
    assert contrast("#000", WHITE) == pytest.approx(21)
    assert contrast("#777777", WHITE) == pytest.approx(4.48, abs=0.005)


def test_text_stands_out_from_what_is_behind_it():
    pairs = [(named(text), behind) for text in ("ink", "soft") for behind in (WHITE, named("tint"))]
    verdicts = re.findall(r"\.(\w+) \{ background: (#\w+);[^}]*\} \.\1 strong \{ color: (#\w+); \}", TEMPLATE)
    assert len(verdicts) >= 5
    pairs += [(text, behind) for _, behind, text in verdicts]
    pairs += [(named("ink"), behind) for _, behind, _ in verdicts]
    pairs += [(named("soft"), behind) for _, behind, _ in verdicts]
    pairs += [(colour, WHITE) for colour in re.findall(r"\.(?:yes|no) \{ color: (#\w+)", TEMPLATE)]
    assert min(contrast(*pair) for pair in pairs) >= 4.5
    assert contrast(named("accent"), WHITE) >= 3  # of lines and of the mark of what has the focus


def test_a_page_has_a_language_headings_in_order_and_words_for_pictures(static_page):
    page = static_page
    assert '<html lang="en">' in page
    assert 'name="viewport"' in page
    levels = [int(level) for level in re.findall(r"<h([1-6])\b", page)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(after <= before + 1 for before, after in itertools.pairwise(levels))
    pictures = re.findall(r"<img[^>]*>", page)
    assert pictures
    assert all(re.search(r'alt="[^"]{10,}"', picture) for picture in pictures)
    assert ":focus-visible" in page


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="needs the browser `chromium` on the path")
def test_all_text_stands_out_as_a_browser_shows_it(static_page, tmp_path):
    page = tmp_path / "page.html"
    grey = tmp_path / "grey.html"
    page.write_text(static_page, encoding="utf-8")
    grey.write_text("<p style='color: #777777'>grey</p>", encoding="utf-8")
    with Browser(tmp_path / "profile", width=390) as browser:
        browser.open(grey.as_uri())
        browser.wait("document.readyState === 'complete' && document.querySelector('p') !== null")
        assert least_contrast(browser) == (pytest.approx(4.48 / 4.5, abs=0.002), "grey")
        browser.open(page.as_uri())
        browser.wait("document.readyState === 'complete' && document.querySelector('footer') !== null")
        browser.value("document.querySelectorAll('details').forEach((part) => { part.open = true; })")
        ratio, text = least_contrast(browser)
        assert ratio >= 1, text
        assert browser.value("document.documentElement.scrollWidth") == 390
