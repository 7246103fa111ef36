"""Shared by the tests: forging."""

import json

import numpy as np

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
