"""Shared by the tests: browser."""

import html
import re
import shutil
import subprocess
from typing import NamedTuple

CHROMIUM = shutil.which("chromium")
_FLAGS = (
    "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking"
    " --disable-component-update --disable-sync --enable-logging=stderr --v=0 --virtual-time-budget=20000 --dump-dom"
)


def opened(page, profile, *flags):
    """The document after its scripts ran, and what they wrote to the console."""
    command = [str(CHROMIUM), *_FLAGS.split(), *flags, f"--user-data-dir={profile}", page.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    return done.stdout, [line for line in done.stderr.splitlines() if "CONSOLE" in line]


class Shown(NamedTuple):
    """A page as a browser shows it: its document without the scripts, its width and what it would scroll."""

    dom: str
    client: int
    scroll: int


def framed(pages, folder):
    """Pages in frames of these widths, and what was written to the console; one browser for all, which takes a second to start.

    In frames, since the window of a headless browser has a least width of its own.
    """
    frame = folder / "frame.html"
    frame.write_text(
        "".join(
            f'<iframe src="{page.as_uri()}" width="{width}" height="800" style="border:0"></iframe>'
            for page, width in pages.items()
        )
        + '<script>onload = () => { document.querySelectorAll("iframe").forEach((one) => {'
        " one.contentDocument.querySelectorAll('details').forEach((part) => { part.open = true; }); });"
        ' setTimeout(() => document.querySelectorAll("iframe").forEach((one) => {'
        " const page = one.contentDocument.documentElement, copy = document.createElement('pre');"
        ' copy.title = page.clientWidth + " " + page.scrollWidth;'
        ' page.querySelectorAll("script").forEach((script) => script.remove());'
        " copy.textContent = page.outerHTML; document.body.append(copy);"
        " }), 3000); }</script>",
        encoding="utf-8",
    )
    dom, console = opened(frame, folder / "profile", "--allow-file-access-from-files")
    copies = re.findall(r'<pre title="(\d+) (\d+)">(.*?)</pre>', dom, re.S)
    return [Shown(html.unescape(copy), int(client), int(scroll)) for client, scroll, copy in copies], console


def plots(dom):
    """The markup of each plot by its id."""
    parts = re.split(r'<figure class="plot[^"]*" id="([^"]+)"', dom)
    return {name: part.split("</figure>")[0] for name, part in zip(parts[1::2], parts[2::2], strict=True)}
