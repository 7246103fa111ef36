"""Shared by the tests: other bounds of the same data."""

import dataclasses


def rebound(data, **parts):
    """Return the same data with some parts of their bound (radius, kind, tilt, joint, ...) replaced."""
    return dataclasses.replace(data, bound=dataclasses.replace(data.bound, **parts))
