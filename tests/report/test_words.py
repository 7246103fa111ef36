"""Numbers and names as they are written."""

import decimal

import numpy as np
import pytest

from robustid.report import at_least, at_most
from robustid.report.words import number

pytestmark = pytest.mark.quick


@pytest.mark.parametrize(
    ("value", "text"), [(0.0, "0"), (-1.5, "−1.5"), (1e-7, "1×10⁻⁷"), (123456.0, "1.235×10⁵"), (-np.inf, "−∞")]
)
def test_number(value, text):
    assert number(value) == text


def read(text):
    """A number of the page, exactly."""
    raised = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
    mantissa, _, power = text.replace("−", "-").partition("×10")
    return decimal.Decimal(f"{mantissa}e{power.translate(raised) or 0}")


@pytest.mark.parametrize("value", [0.190549, 12345.678, -0.0012344999, 5.43211e-9, -7e-300, 0.05, 0.0])
def test_printed_ends_hold_too(value):
    exact = decimal.Decimal(value)
    low, high = read(at_least(value)), read(at_most(value))
    assert low <= exact <= high
    assert float(high - low) <= 1e-3 * abs(value)
