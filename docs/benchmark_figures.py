"""Extension of Sphinx: figures of the page of benchmarks, drawn from the tables that scripts printed into `benchmarks/README.md`.

A table that isn't there, or has other columns, ends the build: a figure never shows other numbers than the last run.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parent
PRINTED = DOCS.parent / "benchmarks/README.md"
FOLDER = DOCS / "gallery/benchmarks"
BLUE, ORANGE, GREEN, GREY, PINK = "#0072b2", "#d55e00", "#009e73", "#777777", "#cc79a7"


def setup(app: Any) -> dict[str, Any]:
    """Draw before anything is read."""
    app.connect("config-inited", lambda app, config: draw_all())
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def draw_all() -> None:
    """All figures, for paper and screen."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    FOLDER.mkdir(parents=True, exist_ok=True)
    style = {
        "font.size": 9,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.grid": True,
        "axes.axisbelow": True,
        "grid.color": "#dddddd",
    }
    with plt.rc_context(style | {"svg.hashsalt": "robustid", "svg.fonttype": "none"}):
        for name, draw in FIGURES.items():
            figure, axes = plt.subplots(figsize=(7.2, 4.0), layout="constrained")
            draw(axes)
            figure.savefig(FOLDER / f"{name}.svg", metadata={"Date": None})
            plt.close(figure)


def table(section: str, heading: str) -> list[str]:
    """Lines below the line of a section that begins with `heading`, up to an empty one."""
    text = PRINTED.read_text()
    start = text.index(f"## `{section}`")
    lines = text[start:].split("\n## ", 1)[0].splitlines()
    first = next((k for k, line in enumerate(lines) if line.startswith(heading)), None)
    if first is None:
        raise ValueError(f"benchmarks/README.md: no table {heading!r} in {section}")
    rest = lines[first + 1 :]
    end = next((k for k, line in enumerate(rest) if not line.strip() or line.startswith("```")), len(rest))
    return rest[:end]


def margins(axes: Any) -> None:
    """Time of a margin against its size, beside general solvers."""
    rows = [line.split() for line in table("solver_scaling.py", "margin of n Taylor")[1:]]
    sizes, ours = [int(row[0]) for row in rows], [float(row[1]) for row in rows]
    axes.loglog(sizes, ours, "o-", color=BLUE, label="robustid")
    for column, (name, color) in enumerate([("Clarabel", ORANGE), ("SCS", GREEN), ("CVXOPT", GREY), ("SDPA", PINK)], 4):
        known = [k for k, row in enumerate(rows) if re.fullmatch(r"[\d.]+", row[column])]
        axes.loglog(
            [sizes[k] for k in known], [ours[k] * float(rows[k][column]) for k in known], "s--", color=color, label=name
        )
    axes.set_xticks(sizes, sizes, minor=False)
    axes.minorticks_off()
    axes.set(xlabel="Taylor coefficients", ylabel="time [s]")
    axes.legend(frameon=False, ncols=2)


def fits(axes: Any) -> None:
    """Error of fits with noise, at the number of states that each has."""
    groups = [("4x4, 40 states, 1 % noise", "4x4"), ("single channel, 20 states, 1 % noise", "one channel")]
    names, sizes, colors = [], [], []
    for heading, short in groups:
        for line in table("matrix_fractions.py", heading)[1:]:
            found = re.match(r"(.+?)\s{2,}(\d+)\s+(\S+)\s", line)
            names.append(f"{found[1].split()[1]}, {found[2]} states ({short})")
            sizes.append(float(found[3]))
            colors.append(BLUE if found[1].startswith("robustid") else ORANGE if "Vector" in found[1] else GREEN)
    axes.barh(range(len(names)), sizes, color=colors)
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    axes.set(xscale="log", xlim=(1e-4, 1), xlabel="error to the truth, root mean square of relative errors")


def passive_models(axes: Any) -> None:
    """Error of models that are proved to be passive, over that of the unconstrained vector fit of as many poles."""
    rows = [re.match(r"(\S.*?)\s{2,}(\d+)\s+(.*)", line) for line in table("passivity.py", "network  ")]
    names, ours, enforced = [], [], []
    for row in rows:
        fields = row[3].split()
        names.append(f"{row[1]}, {row[2]} poles")
        enforced.append(float(fields[2]) / float(fields[0]))
        ours.append(float(fields[8]))
    places = range(len(names))
    axes.plot(ours, places, "o", color=BLUE, label="robustid, proved passive")
    axes.plot(enforced, places, "s", color=ORANGE, label="scikit-rf, passivity enforced (mostly not passive)")
    axes.set_yticks(places, names)
    axes.invert_yaxis()
    axes.set(xscale="log", xlabel="error over that of the fit without passivity")
    axes.axvline(1, color=GREY, lw=1)
    axes.legend(frameon=False, loc="upper right")


def controllers(axes: Any) -> None:
    """Level that is proved in polygons, and in discs about the same centres, over that within a weight above them."""
    names, discs, polygons, machine = [], [], [], ""
    for line in table("controllers.py", "the centres of the band, in polygons"):
        if not line.startswith("    "):
            machine = line.split(":")[0].strip()
        elif machine != "simulated lag":  # of which a weight leaves next to nothing
            ratios = re.findall(r"\(([\d.]+)\)", line)
            names.append(f"{re.sub(', (?:even periods|300 mV)', '', machine)}: {re.match(r' +(.+?) {2,}', line)[1]}")
            discs.append(float(ratios[1]))
            polygons.append(float(ratios[2]))
    places = range(len(names))
    axes.barh(places, polygons, color=BLUE, label="in polygons")
    axes.barh(places, discs, color=ORANGE, height=0.4, label="in discs")
    axes.set_yticks(places, names)
    axes.invert_yaxis()
    axes.axvline(1, color=GREY, lw=1)
    axes.set(xlabel="proved bandwidth (beam: attenuation) over that with a weight", xlim=(0, 3.4))
    axes.legend(loc="lower right", framealpha=1)


FIGURES = {"margins": margins, "fits": fits, "passive": passive_models, "controllers": controllers}
