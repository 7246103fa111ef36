"""Shared by the tests: a browser that is driven, over the pipe of its DevTools protocol."""

import base64
import json
import os
import select
import subprocess
import sys
import time
from typing import Any

from support.browser import CHROMIUM

_FLAGS = (
    "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking"
    " --disable-component-update --disable-sync --disable-default-apps --hide-scrollbars --remote-debugging-pipe"
)
_LONG = 60.0  # seconds


class Browser:
    """One page of a browser: commands are sent, and every event is kept.

    Attributes
    ----------
    events : list of (method, parameters)
    """

    def __init__(self, profile, width=1280, height=1000):
        to_browser, self._write = os.pipe()
        self._read, from_browser = os.pipe()
        # The browser reads commands from descriptor 3 and writes to 4.
        apart = f"a, b = (fcntl.fcntl(one, fcntl.F_DUPFD, 10) for one in ({to_browser}, {from_browser}))"
        wire = f"import fcntl, os; {apart}; os.dup2(a, 3); os.dup2(b, 4)"
        command = [str(CHROMIUM), *_FLAGS.split(), f"--user-data-dir={profile}", "about:blank"]
        self._process = subprocess.Popen(
            [sys.executable, "-S", "-c", f"{wire}; os.execv({command[0]!r}, {command!r})"],
            pass_fds=(to_browser, from_browser),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(to_browser)
        os.close(from_browser)
        self.events: list[tuple[str, dict[str, Any]]] = []
        self._rest, self._count, self._session = b"", 0, None
        pages = self.call("Target.getTargets")["targetInfos"]
        page = next(one["targetId"] for one in pages if one["type"] == "page")
        self._session = self.call("Target.attachToTarget", targetId=page, flatten=True)["sessionId"]
        for domain in ("Page", "Network", "Runtime", "Log"):
            self.call(f"{domain}.enable")
        self.resize(width, height)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._process.kill()
        self._process.wait()
        os.close(self._write)
        os.close(self._read)

    def call(self, method, **parameters):
        """Send a command, and return its result."""
        found = self._answered(method, **parameters)
        assert "error" not in found, found
        return found["result"]

    def _answered(self, method, **parameters):
        """Send a command, and return its answer; of one that could not be done, as between two pages, an error."""
        self._count += 1
        message = {"id": self._count, "method": method, "params": parameters}
        if self._session is not None:
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        while True:
            found = self._message()
            if found.get("id") == self._count:
                return found
            self.events.append((found.get("method", ""), found.get("params", {})))

    def _message(self):
        until = time.monotonic() + _LONG
        while b"\0" not in self._rest:
            assert select.select([self._read], [], [], max(until - time.monotonic(), 0))[0], "the browser is silent"
            part = os.read(self._read, 1 << 20)
            assert part, "the browser has ended"
            self._rest += part
        first, self._rest = self._rest.split(b"\0", 1)
        return json.loads(first)

    def resize(self, width, height):
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)

    def open(self, address):
        self.call("Page.navigate", url=address)

    def value(self, script):
        """The value of an expression in the page."""
        found = self.call("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def wait(self, script, seconds=_LONG):
        """The value of an expression as soon as it is true; errors on the way count as false."""
        until, found = time.monotonic() + seconds, None
        while time.monotonic() < until:
            found = self._answered("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
            result = found.get("result", {"exceptionDetails": found})
            if "exceptionDetails" not in result and result["result"].get("value"):
                return result["result"]["value"]
            time.sleep(0.05)
        raise AssertionError(f"never true: {script}; last: {found}")

    def drag(self, start, end, steps=8, *, release=True):
        """Press the mouse at a place, move it to another one, and let go."""
        self._mouse("mouseMoved", *start)
        self._mouse("mousePressed", *start)
        for k in range(1, steps + 1):
            self._mouse("mouseMoved", *(a + (b - a) * k / steps for a, b in zip(start, end, strict=True)))
        if release:
            self.release(end)

    def release(self, place):
        """Let the mouse go."""
        self._mouse("mouseReleased", *place)

    def _mouse(self, kind, x, y):
        button = "none" if kind == "mouseMoved" else "left"
        pressed = {} if kind != "mouseMoved" else {"buttons": 1}
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button=button, clickCount=1, **pressed)

    def press(self, key, code, text=""):
        """Press a key and let go."""
        for kind in ("keyDown", "keyUp"):
            more = {"text": text} if text and kind == "keyDown" else {}
            self.call("Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode=code, **more)

    def write(self, selector, text):
        """Replace the text of a field, and press Enter."""
        self.value(
            f"(() => {{ const one = document.querySelector({json.dumps(selector)}); one.focus(); one.select(); }})()"
        )
        self.call("Input.insertText", text=text)
        self.press("Enter", 13, "\r")

    def picture(self, path):
        """A picture of the whole page."""
        size = self.call("Page.getLayoutMetrics")["cssContentSize"]
        clip = {"x": 0, "y": 0, "width": size["width"], "height": size["height"], "scale": 1}
        data = self.call("Page.captureScreenshot", clip=clip, captureBeyondViewport=True)["data"]
        path.write_bytes(base64.b64decode(data))

    @property
    def addresses(self):
        """Every address that was asked for."""
        return [found["request"]["url"] for method, found in self.events if method == "Network.requestWillBeSent"]

    @property
    def complaints(self):
        """Errors and warnings of the console."""
        found = [str(p) for m, p in self.events if m == "Runtime.exceptionThrown"]
        found += [
            str(p) for m, p in self.events if m == "Runtime.consoleAPICalled" and p["type"] in ("error", "warning")
        ]
        return found + [str(p) for m, p in self.events if m == "Log.entryAdded" and p["entry"]["level"] == "error"]
