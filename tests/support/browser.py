"""Shared by the tests: browser."""

from __future__ import annotations

import html
import re
import shutil
import subprocess
from pathlib import Path
from typing import NamedTuple

CHROMIUM = shutil.which("chromium")


_FLAGS = (
    "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking"
    " --disable-component-update --disable-sync --enable-logging=stderr --v=0 --virtual-time-budget=20000 --dump-dom"
)


def opened(page: Path, profile: Path, *flags: str) -> tuple[str, list[str]]:
    """The document after its scripts ran, and what they wrote to the console."""
    command = [str(CHROMIUM), *_FLAGS.split(), *flags, f"--user-data-dir={profile}", page.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    return done.stdout, [line for line in done.stderr.splitlines() if "CONSOLE" in line]


class Shown(NamedTuple):
    """A page as a browser shows it: its document without the scripts, what they wrote to the console, its width and what it
    would scroll.
    """

    dom: str
    console: list[str]
    client: int
    scroll: int


def framed(page: Path, width: int, folder: Path) -> Shown:
    """A page in a frame of this width: the window of a headless browser has a least width of its own."""
    frame = folder / "frame.html"
    frame.write_text(
        f'<iframe src="{page.as_uri()}" width="{width}" height="800" style="border:0"></iframe><script>'
        'onload = () => setTimeout(() => { const page = document.querySelector("iframe").contentDocument.documentElement;'
        ' document.title = page.clientWidth + " " + page.scrollWidth;'
        ' page.querySelectorAll("script").forEach((script) => script.remove());'
        ' const copy = document.createElement("pre"); copy.textContent = page.outerHTML; document.body.append(copy);'
        " }, 3000)</script>",
        encoding="utf-8",
    )
    dom, console = opened(frame, folder / "profile", "--allow-file-access-from-files")
    client, scroll = re.search(r"<title>(\d+) (\d+)</title>", dom).groups()  # type: ignore[union-attr]
    copy = dom[dom.index("<pre>") + 5 : dom.rindex("</pre>")]
    return Shown(html.unescape(copy), console, int(client), int(scroll))


def plots(dom: str) -> dict[str, str]:
    """The markup of each plot by its id."""
    parts = re.split(r'<figure class="plot[^"]*" id="([^"]+)"', dom)
    return {name: part.split("</figure>")[0] for name, part in zip(parts[1::2], parts[2::2], strict=True)}
