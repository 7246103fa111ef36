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

from PIL import Image

DOCS = Path(__file__).parent
EXAMPLES = DOCS.parent / "examples"
LIMIT = 90  # seconds of one core
RECORDED = DOCS / "recorded"
LARGEST, MOST = 150_000, 2  # bytes of a recorded picture, and pictures of an example
TITLES = {
    "Measured machines": {
        "motor_torsion": "A motor bench: from records to a bound",
        "torsion_margin": "The motor bench: margin with every consistent plant",
        "steering_mirror": "A steering mirror: three inputs, three outputs",
        "mirror_family": "The mirror at two amplitudes",
        "beam_mimo": "A beam and a mirror by their modes",
        "beam_damping": "A beam damped, provably",
        "short_records": "A hair dryer and a CD player from short records",
        "converters": "Two converters: is their connection stable?",
    },
    "Controllers": {
        "controller_motor": "The motor bench: PID with notch and low-pass",
        "controller_mirror": "The mirror: one loop to each axis",
        "controller_stage": "A wafer stage: one controller at all positions",
        "controller_levitation": "A levitated mass: integral action",
        "levitation": "A levitated mass: a gain that would crash it",
    },
    "Guarantees": {
        "flexible_structure": "Three classes for one structure",
        "worst_case": "Guaranteed bands around two models",
        "proved_band": "A band that is proved in milliseconds",
        "continuous_time": "Continuous time beside the sampled plant",
        "passive_beam": "A gap in the data, bridged by passivity",
        "passive_network": "A network: passive model, Touchstone, SPICE",
        "inanc2001": "The paper of Inanc et al., again",
    },
    "Fits and small models": {
        "wafer_stage": "A wafer stage with exact rigid-body modes",
        "modal_stage": "A stage of order 40 by its modes",
        "voorhoeve2016": "The paper of Voorhoeve et al., again",
        "model_reduction": "Model reduction: error against order",
        "conditioning": "Condition numbers, and what they cost",
    },
}


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
    (folder / "index.rst").write_text(index(folder))


def index(folder: Path) -> str:
    """The page of all examples: by subject, with a picture, a title and a sentence each."""
    lines = ["Gallery", "=======", "", "Programs that run as they stand, with what they draw and print.", ""]
    listed = [f"   {name}" for names in TITLES.values() for name in names]
    lines += [".. toctree::", "   :hidden:", "   :maxdepth: 1", "", *listed, ""]
    for subject, names in TITLES.items():
        lines += [subject, "-" * len(subject), "", ".. container:: gallery-cards", ""]
        for name, title in names.items():
            pictures = sorted((folder / name).glob("*.png"))
            lines += ["   .. container:: gallery-card", ""]
            if pictures:
                lines += [f"      .. image:: {name}/{pictures[0].name}", f"         :alt: {title}"]
                lines += [f"         :target: {name}.html", "         :loading: lazy", ""]
            lines += [f"      :doc:`{title} <{name}>`", "", f"      {plain(first_sentence(name))}", ""]
    return "\n".join(lines)


def first_sentence(name: str) -> str:
    """The first paragraph of what an example says of itself."""
    said = re.match(r'"""(.*?)"""', (EXAMPLES / f"{name}.py").read_text(), re.S)[1].strip()
    return " ".join(said.partition("\n\n")[0].split())


def title_of(name: str) -> str:
    """The title of an example; each has its place in the table."""
    for names in TITLES.values():
        if name in names:
            return names[name]
    raise KeyError(f"examples/{name}.py has no title in docs/gallery.py: TITLES")


def record(names: list[str]) -> None:
    """Write what examples print, and their first pictures, for pages that are built where they can't run."""
    for name in names:
        folder = RECORDED / name
        printed = run(name, folder, None)
        if printed is None:
            sys.exit(f"{name} failed; are the measured data there (ROBUSTID_DATA)?")
        for path in folder.glob("*.png"):
            in_few_colours(path)
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


def in_few_colours(path: Path) -> None:
    """Write a picture that is too large again with 256 colours, which is enough for curves and text."""
    if path.stat().st_size > LARGEST:
        picture = Image.open(path).convert("RGB").quantize(256, method=Image.Quantize.MAXCOVERAGE)
        picture.save(path, optimize=True)


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
    short = title_of(name)
    lines = [f".. _example-{name}:", "", short, "=" * len(short), "", plain(" ".join(first.split())), ""]
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
            found.append(plain(block))
    return [one for one in found if one]


def plain(text: str) -> str:
    """Text of a docstring as reStructuredText: what stands in back quotes is code, stars and bars are themselves."""
    return re.sub(r"(?<!`)`([^`]+)`(?!`)", r"``\1``", text).replace("*", r"\*").replace("|", r"\|")


if __name__ == "__main__":
    everything = sorted(path.stem for path in EXAMPLES.glob("*.py"))
    record(sys.argv[1:] or [name for name in everything if needs_record(name)])
