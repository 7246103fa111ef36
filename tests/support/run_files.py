"""Run files for tests: parts of their content, and how they are written."""

from pathlib import Path

import robustid as rid
from robustid.app.run import sequence
from robustid.app.run.toml import write_toml
from robustid.guarantees import band_result
from robustid.guarantees.refinement import joined_bands

EXAMPLES = Path(__file__).parents[2] / "examples"
DATA = {"frequency": [{"file": "frf.csv"}], "record": [{"file": "step.csv", "use": "samples"}]}
CLASS = {"modes": {"hz": [9.0, 17.67], "damping": [0.1, 0.004]}, "prior": {"gain_bound": 0.2, "decay_rate": 1.1}}
QUICK = {"worst_case": {"compute": False}}
SHORT = {"worst_case": {"at_hz": [5.0, 17.0], "directions": 4}}


def ask(folder, *parts, name="ask.toml"):
    content = {}
    for part in parts:
        content |= part
    (folder / name).write_text(write_toml(content), encoding="utf-8")
    return folder / name


def only_identify(monkeypatch):
    """No step beside the identification: no band, no diagnosis, nothing that data with faults are held against."""
    for step in "proved", "proved_if_wider", "diagnosed", "refined", "seen_between", "without_doubtful", "_refuted":
        monkeypatch.setattr(sequence, step, lambda *_: None)


def search_nothing(monkeypatch):
    """Bands without sums of one direction each, alone or between polygons: as true, and wider."""
    monkeypatch.setattr(band_result, "directed_bands", lambda bands, budget: ())
    monkeypatch.setattr(
        band_result, "joined_bands", lambda bands, directed, polygons, _: joined_bands(bands, directed, polygons, None)
    )


def keep_discs(monkeypatch):
    """The band of discs, without polygons that take seconds: for tests of what is done with a band."""
    for step in "refined", "sharpened", "narrowed":
        monkeypatch.setattr(sequence, step, lambda *_: None)


def keep_whole(monkeypatch):
    """The identified model in place of a search for a smaller one, compared with no fits."""

    def whole(identification, rigid_body, **_):
        return rid.balanced_truncation(identification.model, order=identification.order, unstable="keep")

    monkeypatch.setattr(sequence, "reduce_within_bounds", whole)
    monkeypatch.setattr(sequence, "why_not_compared", lambda *_: "not here")
