"""Extension of Sphinx: a page for every example, with its words, its figures, what it printed, and its code.

Examples are programs with options, run as users run them: each in a process of its own with --out, at most 90 seconds on one core.
What takes longer, or needs measured data that are not there, shows what was recorded in `recorded/`, with command and date:
`python docs/gallery.py NAME...` records (all that need it without names; ROBUSTID_DATA set). ROBUSTID_GALLERY names the examples
that are run, with commas between them; all by default, and "none" for none.
"""

from __future__ import annotations

import datetime
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parent
EXAMPLES = DOCS.parent / "examples"
LIMIT = 90  # seconds of one core
RECORDED = DOCS / "recorded"
LARGEST, MOST = 150_000, 2  # bytes of a recorded picture, and pictures of an example


def setup(app: Any) -> dict[str, Any]:
    """Write the pages before anything is read."""
    app.connect("config-inited", lambda app, config: write_gallery())
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def write_gallery() -> None:
    """Pages and their index."""
    folder = DOCS / "gallery"
    folder.mkdir(exist_ok=True)
    names = sorted(path.stem for path in EXAMPLES.glob("*.py"))
    asked = os.environ.get("ROBUSTID_GALLERY", ",".join(names)).split(",")
    with ThreadPoolExecutor(2) as pool:  # each waits for a process
        ran = dict(
            zip(names, pool.map(lambda name: run(name, folder / name) if name in asked else None, names), strict=True)
        )
    for name in names:
        (folder / f"{name}.rst").write_text(page(name, ran[name], folder / name))
    listed = "\n   ".join(names)
    (folder / "index.rst").write_text(
        "Gallery\n=======\n\nPrograms that run as they stand, with what they draw and print.\n\n.. toctree::\n   :maxdepth: 1\n\n"
        f"   {listed}\n"
    )


def record(names: list[str]) -> None:
    """Write what examples print, and their first pictures, for pages that are built where they can't run."""
    for name in names:
        folder = RECORDED / name
        printed = run(name, folder, None)
        if printed is None:
            sys.exit(f"{name} failed; are the measured data there (ROBUSTID_DATA)?")
        pictures = [path for path in sorted(folder.glob("*.png")) if path.stat().st_size <= LARGEST]
        for path in folder.iterdir():
            if path.is_dir():
                shutil.rmtree(path)
            elif path not in pictures[:MOST]:
                path.unlink()
        (folder / "printed.txt").write_text(printed)
        about = {
            "command": f"python examples/{name}.py",
            "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
            "example": _digest(name),
        }
        (folder / "about.json").write_text(json.dumps(about, indent=1) + "\n")
        print(f"{name}: recorded, {len(pictures[:MOST])} pictures")


def needs_record(name: str) -> bool:
    """Return whether an example reads measured data, or takes longer than a page has."""
    return "rid.datasets" in (EXAMPLES / f"{name}.py").read_text() or (RECORDED / name).exists()


def recorded(name: str) -> tuple[str, str] | None:
    """Sentence on a record and what was printed, its pictures beside the page; None where there is none."""
    folder = RECORDED / name
    if not (folder / "about.json").exists():
        return None
    about = json.loads((folder / "about.json").read_text())
    shown = DOCS / "gallery" / name
    shutil.rmtree(shown, ignore_errors=True)
    shutil.copytree(folder, shown)
    said = f"Recorded on {about['date']} by ``{about['command']}``, not run when this page was built."
    if about["example"] != _digest(name):
        said += " The program has changed since."
    return said, (folder / "printed.txt").read_text()


def _digest(name: str) -> str:
    return hashlib.sha256((EXAMPLES / f"{name}.py").read_bytes()).hexdigest()[:16]


def run(name: str, out: Path, limit: float | None = 2 * LIMIT) -> str | None:
    """Return what an example printed, its figures being in `out`; None where it failed or took too long."""
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    command = [sys.executable, str(EXAMPLES / f"{name}.py"), "--out", str(out)]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "COLUMNS": "100"}
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=limit, env=environment, cwd=out, check=False
        )
    except subprocess.TimeoutExpired:
        return None
    return done.stdout.replace(str(out), "FOLDER") if done.returncode == 0 else None


def page(name: str, printed: str | None, out: Path) -> str:
    """The page of an example as reStructuredText."""
    source = (EXAMPLES / f"{name}.py").read_text()
    said = re.match(r'"""(.*?)"""', source, re.S)[1].strip()
    first, _, rest = said.partition("\n\n")
    short = name.replace("_", " ").capitalize()
    lines = [f".. _example-{name}:", "", short, "=" * len(short), "", " ".join(first.split()), ""]
    lines += [paragraph + "\n" for paragraph in paragraphs(rest)]
    if printed is None and (kept := recorded(name)) is not None:
        said, printed = kept
        lines += [said, ""]
    elif printed is None:
        lines += ["*Not run when this page was built: it needs measured data, or more time than a page has.*", ""]
    for picture in sorted(out.glob("*.png")) if printed is not None else []:
        words = picture.stem.replace("_", " ")
        lines += [f".. image:: {name}/{picture.name}", f"   :alt: {short}: {words}", "   :width: 100%", ""]
    if printed:
        lines += ["What it prints", "--------------", "", ".. code-block:: text", ""]
        lines += [f"   {line}" for line in printed.rstrip().splitlines()] + [""]
    lines += [
        "The program",
        "-----------",
        "",
        f".. literalinclude:: ../../examples/{name}.py",
        "   :language: python",
        "",
    ]
    return "\n".join(lines)


def paragraphs(text: str) -> list[str]:
    """Paragraphs of a docstring; lines with their own breaks stay as they are."""
    found = []
    for block in re.split(r"\n\s*\n|\n(?=(?:Run|Data): )", text.strip()):
        if block.startswith(("Run:", "Command", "    ")):
            command = block.removeprefix("Run:").strip()
            found.append(f"Run: ``{' '.join(command.split())}``" if command else "")
        elif block:
            found.append(re.sub(r"(?<!`)`([^`]+)`(?!`)", r"``\1``", block).replace("*", r"\*").replace("|", r"\|"))
    return [one for one in found if one]


if __name__ == "__main__":
    everything = sorted(path.stem for path in EXAMPLES.glob("*.py"))
    record(sys.argv[1:] or [name for name in everything if needs_record(name)])
