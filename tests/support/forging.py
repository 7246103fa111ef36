"""Forgeries of what was saved, and of the polygons of a set of values."""

import dataclasses
import functools
import json

import numpy as np

import robustid as rid
from robustid.core import digest
from robustid.guarantees.linear.directed import DirectedBand


def kept(thing, path):
    """What comes back from the files of a thing."""
    thing.save(path)
    return rid.load(path)


def arrays_of(path):
    with np.load(path.with_suffix(".npz")) as archive:
        return {name: archive[name] for name in archive.files}


def forge(path, change=lambda _: {}, text=lambda _: None):
    """Change the arrays and the text, and bind both to each other again, as an author of forgeries would."""
    numbers, words = path.with_suffix(".npz"), path.with_suffix(".json")
    arrays = arrays_of(path)
    arrays |= change(arrays)
    np.savez(numbers, **arrays)
    record = json.loads(words.read_text(encoding="utf-8"))
    del record["digest"]
    text(record)
    words.write_text(json.dumps(record | {"digest": digest(arrays, record)}), encoding="utf-8")


def some_sides(value, pick):
    """A polygon of some of its sides only."""
    ends = {name: getattr(value, name)[pick] for name in ("directions", "support", "points")}
    return dataclasses.replace(value, **ends, certificates=tuple(value.certificates[k] for k in pick))


def lower(name, by=1e-6):
    return lambda arrays: {name: arrays[name] - by * np.abs(arrays[name]).max()}


def scaled(name, by):
    return lambda arrays: {name: arrays[name] * by}


def with_lower_sides(band):
    """A band of directions that states sides lower than its multipliers prove, by a millionth of the largest."""

    class Lower(DirectedBand):
        @functools.cached_property
        def knot_supports(self):
            return band.knot_supports - 1e-6 * np.abs(band.knot_supports).max()

    return Lower(band.sides, band.angles, band.points, band.multipliers)
