"""Shared by the tests: forging."""

import json

import numpy as np
import pytest

import robustid as rid
from robustid.core import digest


def forge(path, change):
    """Change the arrays and bind the text to them again, as an author of forgeries would."""
    with np.load(path.with_suffix(".npz")) as archive:
        arrays = {name: archive[name] for name in archive.files}
    arrays |= change(arrays)
    np.savez(path.with_suffix(".npz"), **arrays)
    text = path.with_suffix(".json")
    text.write_text(json.dumps(json.loads(text.read_text()) | {"digest": digest(arrays)}))


def lower(name, by=1e-6):
    return lambda arrays: {name: arrays[name] - by * np.abs(arrays[name]).max()}


def damage_is_named(path, suffix, word):
    """One of the two files of a result cut off, then gone: each has its sentence."""
    target = path.with_suffix(suffix)
    target.write_bytes(target.read_bytes()[:100])
    with pytest.raises(rid.errors.FileFormatError, match=word):
        rid.load(path)
    target.unlink()
    with pytest.raises(rid.errors.FileFormatError, match="missing"):
        rid.load(path)
