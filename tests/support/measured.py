"""Shared by the tests: measured."""

import os

import pytest

realdata = [
    pytest.mark.realdata,
    pytest.mark.skipif(not os.environ.get("ROBUSTID_DATA"), reason="ROBUSTID_DATA names no folder of measured data"),
]
