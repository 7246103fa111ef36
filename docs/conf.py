"""The site: `python -m sphinx -W docs site`, offline. The reference is made from the front door, the gallery from examples."""

import re
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
ROOT = Path(__file__).parents[1]

project = "robustid"
copyright = "the robustid developers"
version = release = re.search(r'"(.*)"', (ROOT / "robustid/_version.py").read_text())[1]

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "numpydoc",
    "gallery",
    "benchmark_figures",
    "offline_math",
]
html_math_renderer = "mathml"
exclude_patterns = ["_build", "*.md", "gallery_source"]
default_role = None
templates_path = ["templates"]
autosummary_generate = True
autodoc_typehints = "none"
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False
nitpicky = False

html_theme = "pydata_sphinx_theme"
html_title = "robustid"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
html_theme_options = {
    "navigation_with_keys": True,
    "header_links_before_dropdown": 8,
    "navbar_align": "left",
    "show_toc_level": 2,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "navbar_end": ["theme-switcher"],
    "navbar_persistent": ["search-button"],
}
# Pages without others below them: a sidebar would be empty.
html_sidebars = {page: [] for page in ("index", "start", "coming_from", "genindex", "search")}


def write_reference() -> None:
    """Pages of the reference: the public names by room, as the front door loads them."""
    source, folder = (ROOT / "robustid/__init__.pyi").read_text(), Path(__file__).parent / "reference"
    folder.mkdir(exist_ok=True)
    found = re.findall(r"^from \.(\w+)[\w.]* import (\w+) as", source, flags=re.M)
    unknown = {room for room, _ in found} - {room for rooms in ROOMS.values() for room in rooms} - {"_version"}
    if unknown:
        raise ValueError(f"rooms without a page in the reference: {', '.join(sorted(unknown))}")
    for title, rooms in ROOMS.items():
        names = sorted({name for room, name in found if room in rooms} - {*MODULES}, key=str.lower)
        listed = "\n   ".join(f"~robustid.{one}" for one in names)
        text = f"{title}\n{'=' * len(title)}\n\n.. autosummary::\n   :toctree: generated\n\n   {listed}\n"
        write_changed(folder / f"{rooms[0]}.rst", text)
    for group, title in GROUPS.items():
        listed = "\n   ".join(f"~robustid.{group}.{one}" for one in group_names(group))
        text = f"{title}\n{'=' * len(title)}\n\n.. autosummary::\n   :toctree: generated\n\n   {listed}\n"
        write_changed(folder / f"{group}.rst", text)
    write_changed(folder / "index.rst", reference_index(folder))


def reference_index(folder: Path) -> str:
    """All names on one page: a line each, by task."""
    pages = [*(rooms[0] for rooms in ROOMS.values()), *GROUPS]
    lines = ["Reference", "=========", "", "Every public name, by task: ``import robustid as rid``.", ""]
    lines += [".. toctree::", "   :hidden:", "   :maxdepth: 1", "", *(f"   {page}" for page in pages), ""]
    for page in pages:
        title, _, rest = (folder / f"{page}.rst").read_text().partition("\n")
        names = re.findall(r"^   (~robustid\S+)$", rest, flags=re.M)
        lines += [
            title,
            "-" * len(title),
            "",
            ".. autosummary::",
            "   :nosignatures:",
            "",
            *(f"   {name}" for name in names),
            "",
        ]
    return "\n".join(lines)


def group_names(group: str) -> list[str]:
    """Names that a group of the front door holds."""
    return re.findall(r'^    "(\w+)",$', (ROOT / f"robustid/{group}.py").read_text(), flags=re.M)


def write_changed(path: Path, text: str) -> None:
    """Leave files alone that are the same: what depends on them isn't built again."""
    if not path.exists() or path.read_text() != text:
        path.write_text(text)


GROUPS = {
    "prepare": "robustid.prepare: before records are used",
    "advise": "robustid.advise: choices",
    "guarantee": "robustid.guarantee: boxes, tubes, weights, margins",
    "fits": "robustid.fits: structure and results of fits",
    "passive": "robustid.passive: passive models",
    "design": "robustid.design: controllers",
}
MODULES = ("errors", "datasets", "plot")
ROOMS = {
    "Measurements and their bounds": ("data", "formats", "estimation", "core"),
    "The class, the question and its answer": ("identification", "bases"),
    "Guarantees": ("guarantees",),
    "Controllers": ("controllers",),
    "Matrix fractions": ("fitting",),
    "Small models": ("reduction", "passivity"),
    "Choices, causes, the next measurement": ("advice",),
    "Files, the whole way, reports": ("app", "report"),
    "Errors": ("errors",),
}
write_reference()


def escaped(app, what, name, obj, options, lines) -> None:
    """Bars in docstrings are absolute values, never substitutions; outside of literals and mathematics."""
    indent = None
    for k, line in enumerate(lines):
        inner = len(line) - len(line.lstrip())
        if indent is not None and line.strip() and inner <= indent:
            indent = None
        if line.lstrip().startswith(".. math::"):
            indent = inner
        if indent is None and not line.lstrip().startswith((">>>", "...")):
            parts = line.split("``")
            parts[::2] = [part.replace("|", r"\|") for part in parts[::2]]
            lines[k] = "``".join(parts)


def setup(app) -> None:
    """Before numpydoc, which arranges the sections."""
    app.connect("autodoc-process-docstring", escaped, priority=100)
