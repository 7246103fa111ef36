"""Numbers and names as they are written."""

import decimal

import numpy as np
import pytest

from robustid.core import Signal
from robustid.report import at_least, at_most
from robustid.report.fit_charts import with_deviation
from robustid.report.words import HZ, at_frequencies, at_hz, number, quotient, title

pytestmark = pytest.mark.quick


@pytest.mark.parametrize(
    ("value", "text"),
    [
        *((0.0, "0"), (-1.5, "−1.5"), (1e-7, "1×10⁻⁷"), (123456.0, "1.235×10⁵"), (17.67321, "17.67")),
        *((-np.inf, "−∞"), (np.inf, "∞"), (np.nan, "–")),
    ],
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


def test_values_have_as_many_digits_as_their_deviation_leaves():
    found = with_deviation(635.12345, 0.0213), with_deviation(0.0123456, 4e-5), with_deviation(17.67, float("nan"))
    assert found == ("635.123 ± 0.021", "0.012346 ± 0.000040", "17.67")
    assert number(5.2e-7, 2) == "5.2×10⁻⁷"


def test_frequencies_are_said_in_hz():
    assert at_frequencies(np.array([HZ, 3 * HZ])) == "at 2 frequencies from 1 to 3 Hz"
    assert at_frequencies(np.array([2 * HZ])) == "at 2 Hz"
    said = at_hz(np.array([1.0, 2.5]), "{} ± {}", np.array([3.0, 4.0]), np.array([0.1, 0.2]))
    assert said == ("1 Hz: 3 ± 0.1", "2.5 Hz: 4 ± 0.2")


def test_headings_name_the_signals():
    assert title("Fit", [Signal("x", "m")], [Signal("u", "N")]) == "Fit of x [m] / u [N]"
    assert title("Fit", [Signal("x", "m")], [Signal("a"), Signal("b")]) == "Fit from a, b to x"


def test_units_of_quotients():
    pairs = [("V", "A"), ("A", "V"), ("mm", "N"), ("", "N"), ("V", ""), ("", "")]
    assert [quotient(*pair) for pair in pairs] == ["Ω", "S", "mm/N", "1/N", "V", ""]
