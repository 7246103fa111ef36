"""The page of a controller that is tuned, in a real browser: a slider, a field, undo, the proof, a file."""

import pytest

import robustid as rid
from robustid.app.explore.tuning import Tuning
from support.browser import CHROMIUM
from support.explored import served, until
from support.one_design import small_design

pytest.importorskip("dash")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs the browser `chromium` on the path")

VERDICT = "document.querySelector('#verdict').textContent"


def field(name):
    return f"document.querySelector('#tune-{name}').value"


def test_a_gain_is_dragged_and_the_worst_cases_follow(tmp_path, monkeypatch):
    from support.driven import Browser

    monkeypatch.chdir(tmp_path)
    with served(Tuning.of(small_design())) as server, Browser(tmp_path / "profile") as browser:
        tuner = server._pages.workers[0]  # the state behind the page
        browser.open(server.address)
        browser.wait(f"{VERDICT}.startsWith('All limits are kept at')")
        browser.wait("document.querySelectorAll('#plane .scatterlayer path').length > 2")
        browser.value("document.querySelector('#tune-gain-slider').focus()")
        for _ in range(5):
            browser.press("ArrowRight", 39)
        browser.wait(f"Number({field('gain')}) > 1.04")
        until(lambda: tuner.look.sections.gain > 1.04)
        browser.write("#tune-gain", "1.6")  # as far as fifty steps of the slider
        browser.wait(f"{VERDICT}.includes('Exceeded: sensitivity peak')")
        browser.wait("document.querySelectorAll('#tables tr.over').length >= 1")
        browser.value("document.querySelector('#back').click()")
        browser.wait(f"{VERDICT}.startsWith('All limits are kept at')")
        assert browser.value(field("gain")) == "1"
        browser.write("#tune-0-kp", "-0.3")  # a gain may be negative
        until(lambda: tuner.look.sections.numbers["0-kp"] == -0.3)
        browser.value("document.querySelector('#undo').click()")
        browser.wait(f"{field('0-kp')} === '0.38'")
        until(lambda: tuner.look.sections.numbers == tuner.tuning.start.numbers)
        browser.value("document.querySelector('#redo').click()")
        until(lambda: tuner.look.sections.numbers["0-kp"] == -0.3)
        browser.value("document.querySelector('#undo').click()")
        until(lambda: tuner.look.sections.numbers == tuner.tuning.start.numbers)
        browser.value("document.querySelector('#prove').click()")
        browser.wait(f"{VERDICT}.startsWith('PROVED')")
        browser.value("document.querySelector('#write').click()")
        browser.wait("document.querySelector('#written').textContent.startsWith('Written: tuned.npz')")
        unnamed = (
            "[...document.querySelectorAll('input')].filter((one) => one.labels.length !== 1).map((one) => one.id)"
        )
        assert browser.value(unnamed) == []
        browser.resize(360, 800)
        browser.wait("document.querySelector('#picture .main-svg').clientWidth < 360")
        assert browser.value("document.documentElement.scrollWidth") <= 360
        assert browser.complaints == []
        assert all(address.startswith(server.address.split("?")[0]) for address in browser.addresses)
    assert rid.load("tuned.npz").nstates == 1
