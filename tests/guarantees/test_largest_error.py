"""The largest error of a band, between the frequencies that were asked for too."""

import functools
import re

import numpy as np

import robustid as rid
from robustid.guarantees import largest_error
from robustid.report import at_most, render_report
from robustid.report.proved_band import band_sentence

DT = 0.01
BETWEEN = np.union1d(np.linspace(1e-3, np.pi / DT, 1201), np.linspace(98, 104, 601))  # and densely around the mode


@functools.cache
def sharp():
    """A band around a light mode between frequency points, asked for at a few of them."""
    omega = np.linspace(5.0, 300.0, 30)
    modes = rid.kautz([101.0], [0.004], dt=DT, delay=1)
    z = np.exp(1j * omega * DT)
    pole = np.exp((-0.004 + 1j) * 101.0 * DT)
    values = 0.02 / ((z - pole) * (z - pole.conj())) + 0.1 / (z - 0.5)
    frf = rid.FrequencyResponse(omega, values, bound=0.02, dt=DT)
    result = rid.identify(
        rid.MixedProblem(frequency=frf, parametric=modes, prior=rid.Prior(gain_bound=0.5, decay_rate=1.2))
    )
    model = rid.balanced_truncation(result.model, order=4).model
    return result, rid.band(result, model=model, omega=np.linspace(10.0, 290.0, 5))


def test_what_is_said_of_every_frequency_bounds_what_lies_between_those_asked_for():
    """It was the largest at these, which the band itself exceeded between them: by 1.56 of a swept beam, 1.65 of a crystal."""
    result, band = sharp()
    most, at = largest_error(band)
    assert np.linalg.norm(band.error_at(np.array([at]))[0], 2) >= 0.99 * most  # where it is said to be
    assert np.linalg.norm(band.error_at(BETWEEN), 2, axis=(1, 2)).max() <= most
    assert band.sigma_upper.max() <= most == band.hinf
    said = float(re.findall(r"is within (\S+) of", band.summary())[0])
    assert said >= most * (1 - 1e-3)
    page = render_report(result, band=band)
    stated = float(re.findall(r"has a response within (\S+) of the model", page)[0])
    assert most <= stated <= 1.001 * most


def test_open_ranges_are_left_out():
    """Where the box of a mode reaches undamped poles nothing is bounded; beside it the error is largest."""
    result, _ = sharp()
    box = np.array([[100.0, 102.0]]), np.array([[1e-9, 0.02]])
    band = rid.band(result.problem, box=box).with_model(result.model)
    between = BETWEEN[~band.is_open(BETWEEN)]
    assert band.open_ranges
    assert np.isinf(band.hinf)
    assert np.isfinite(largest_error(band).value)
    assert band.error_at(between).max() <= largest_error(band).value


def test_where_the_largest_error_is_beyond_the_data_that_among_them_is_said_too():
    """Between their lines as well; far above them the class alone bounds the error."""
    omega, truth = np.linspace(20.0, 40.0, 15), 0.1 / (np.exp(1j * np.linspace(20.0, 40.0, 15) * DT) - 0.5)
    frf = rid.FrequencyResponse(omega, truth, bound=0.01, dt=DT)
    result = rid.identify(rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=0.5, decay_rate=1.2)))
    band, ends = rid.band(result), (20.0, 40.0)
    beyond, among = largest_error(band), largest_error(band, ends)
    assert beyond.omega > 40
    assert 20 <= among.omega <= 40
    largest = band.error_at(np.linspace(*ends, 2001)).max()
    assert largest <= among.value <= 1.1 * largest < beyond.value
    said = re.findall(r"beyond the data \(in their range at most (\S+)\)", render_report(result, band=band))
    assert {float(one) for one in said} == {float(at_most(among.value))}
    assert "beyond the data" not in band_sentence(*sharp())
