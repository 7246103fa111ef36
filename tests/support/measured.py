"""Tests that want measured data: marked as such, and skipped where the data are not at hand."""

import os

import pytest

from robustid.errors import DatasetNotFoundError
from robustid.formats import datasets

realdata = [
    pytest.mark.realdata,
    pytest.mark.skipif(not os.environ.get("ROBUSTID_DATA"), reason="ROBUSTID_DATA names no folder of measured data"),
]


def needs(name):
    """Skip the test where this file of a published data set is missing; else its path."""
    try:
        return datasets.find(name)
    except DatasetNotFoundError as missing:
        pytest.skip(str(missing))
