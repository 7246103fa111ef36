"""The page in a real browser: a mode is dragged until the data are consistent, and the run file gives the same margin."""

from pathlib import Path

import pytest

import robustid as rid
from robustid.app.explore.views import View
from support.browser import CHROMIUM
from support.cases import slow
from support.explored import served, session, until

pytest.importorskip("dash")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs the browser `chromium` on the path")

VERDICT = "document.querySelector('#verdict').textContent"
PIXEL = """(() => {{ const one = document.querySelector('#picture .js-plotly-plot'), axis = one._fullLayout.xaxis,
  line = document.querySelector('#picture .shapelayer path').getBoundingClientRect();
  return [one.getBoundingClientRect().x + axis._offset + axis.l2p(Math.log10({hz})), line.y + line.height * {part}]; }})()"""
LEGEND = "[...document.querySelectorAll('#picture .legendtext')].map((one) => one.textContent)"
DRAWN = "(({x, width}) => x + width / 2)(document.querySelector('#picture .shapelayer path').getBoundingClientRect())"


def field(name):
    return f"document.querySelector('#{name}').value"


def place(browser, hz, part):
    return tuple(browser.value(PIXEL.format(hz=hz, part=part)))


@pytest.mark.parametrize("rest", [False, slow(True)])
def test_a_mode_is_dragged_until_the_data_are_consistent(tmp_path, monkeypatch, rest):
    """A run file gives the same; nothing is asked of another machine. The rest of the page: a brush, a slider by its keys."""
    from support.driven import Browser

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("robustid.app.explore.worker._THIN", 9)  # a third of the frequencies
    monkeypatch.setattr("robustid.app.explore.worker._KNOTS", 60)
    one = session(tmp_path, hz=7.0)
    views = [View("this plant", lambda _: one), View("another plant", lambda _: one)]
    with served(one, views) as server, Browser(tmp_path / "profile") as browser:
        browser.open(server.address)
        browser.wait(f"{VERDICT}.startsWith('Inconsistent, margin')")
        browser.wait("document.querySelector('#picture .shapelayer path')")
        browser.drag(place(browser, 7, 0.7), place(browser, 9, 0.7), release=False)
        browser.wait(f"{LEGEND}.includes('proved band, poles taken as exact')")  # while the line is held
        # The picture is a new one, and the line is still held.
        browser.wait(f"Math.abs({DRAWN} - {place(browser, 9, 0.7)[0]}) < 3")
        browser.release(place(browser, 9, 0.7))
        browser.wait(f"{VERDICT}.startsWith('Consistent, margin')")
        assert abs(float(browser.value(field("hz-0"))) - 9) < 0.1
        worker = server._pages.workers[0]  # the state behind the page
        if rest:
            rest_of_the_page(browser, worker)
        until(lambda: worker.found.choice.hz[0] > 8 and worker.found.identification is not None)
        browser.value("document.querySelector('#write').click()")
        browser.wait("document.querySelector('#written').textContent.startsWith('Written: explored.toml')")
        if rest:
            other_page(browser)
        browser.resize(360, 800)
        browser.wait("document.querySelector('#picture .main-svg').clientWidth < 360")
        assert browser.value("document.documentElement.scrollWidth") <= 360
        check_names(browser)
        assert browser.complaints == []
        assert all(address.startswith(server.address.split("?")[0]) for address in browser.addresses)
        margin = worker.found.identification.margin
    assert rid.run("explored.toml", "out").identification.margin == margin
    assert Path("out/report.html").exists()


def rest_of_the_page(browser, worker):
    """Steps back and forth, a mode that is added and removed, a choice that is kept, a brush, a slider by its keys."""
    browser.value("document.querySelector('#undo').click()")
    browser.wait(f"{field('hz-0')} === '7'")
    browser.value("document.querySelector('#redo').click()")
    browser.wait(f"Math.abs({field('hz-0')} - 9) < 0.1")
    browser.wait(f"{VERDICT}.startsWith('Consistent, margin')")
    until(lambda: worker.found.choice.hz[0] > 8 and worker.found.identification is not None)
    browser.write("#damping-1", "-1")
    browser.wait("document.querySelector('#trouble').textContent.startsWith('Mode 2, damping ratio')")
    browser.value("document.querySelector('#undo').click()")
    browser.wait(f"{field('damping-1')} === '0.004'")
    browser.wait("document.querySelector('#trouble').textContent === ''")
    browser.value("document.querySelector('#add').click()")
    browser.wait("document.querySelectorAll('fieldset[id]:not([hidden])').length === 3")
    until(lambda: len(worker.found.choice.hz) == 3)
    added = worker.found.choice.hz[2]
    browser.wait("document.querySelector('#picture .js-plotly-plot').layout.shapes.length === 3")
    assert float(browser.value(field("hz-2"))) == added
    assert browser.value("document.querySelector('#hz-2-slider').value") == "500"  # around the new frequency
    browser.value("document.querySelector('#remove-2').click()")
    browser.wait("document.querySelector('#mode-2').hidden")
    until(lambda: len(worker.found.choice.hz) == 2)
    browser.wait("document.querySelector('#picture .js-plotly-plot').layout.shapes.length === 2")
    browser.wait(f"{VERDICT}.startsWith('Consistent, margin')")
    until(lambda: worker.found.identification is not None)
    browser.value("document.querySelector('#keep').click()")
    browser.wait("document.querySelectorAll('#kept tbody tr').length === 6")
    browser.wait(f"{LEGEND}.includes('kept choice: proved band')")
    browser.drag(place(browser, 15, 0.5), place(browser, 16.9, 0.6))  # over the point at 16 Hz
    browser.wait(f"{field('left-out')} === '16'")
    browser.value("document.querySelector('#gain-slider').focus()")
    browser.press("ArrowRight", 39)
    browser.wait(f"{field('gain')} === '0.201851'")
    until(lambda: worker.found.choice.gain_bound == 0.201851 and worker.found.choice.left_out_hz == (16.0,))
    until(lambda: worker.found.identification is not None)
    assert browser.value("document.querySelector('#gain-slider').getAttribute('aria-valuetext')") == "0.201851"


def other_page(browser):
    """Another page is chosen, and what this one stated is there again afterwards."""
    chosen = "(() => {{ const one = document.querySelector('#views'); one.value = '{}'; {} }})()"
    change = "one.dispatchEvent(new Event('change', {bubbles: true}))"
    browser.value(chosen.format("/1/", change))
    browser.wait("location.pathname === '/1/' && !!document.querySelector('#gain')")
    browser.wait(f"{VERDICT}.startsWith('Inconsistent, margin')")
    assert browser.value(field("views")) == "/1/"
    browser.value(chosen.format("/", change))
    browser.wait("location.pathname === '/' && !!document.querySelector('#gain')")
    assert [browser.value(field(name)) for name in ("gain", "left-out")] == ["0.201851", "16"]
    browser.wait("document.querySelector('#picture .shapelayer path')")


def check_names(browser):
    """Every field has a label of its own, and every part that is no field a name."""
    unnamed = "[...document.querySelectorAll('input, progress')].filter((one) => one.labels.length !== 1).map((one) => one.id)"
    assert browser.value(unnamed) == []
    assert browser.value("document.documentElement.lang") == "en"
    assert browser.value("document.querySelector('[role=img]').getAttribute('aria-label').length") > 100
