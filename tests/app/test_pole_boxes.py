"""Runs of continuous data with the poles anywhere in their box, and what is said where no box is covered."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.app.run import findings
from robustid.app.run.settings import Modes
from support.run_files import ask

OMEGA, DAMPING = np.array([40.0, 70.0]), np.array([0.02, 0.03])


@pytest.fixture(scope="module")
def response():
    """Two modes and a fast pole, without a sample time."""
    rng, omega = np.random.default_rng(0), np.linspace(20, 100, 25)
    s = 1j * omega
    values = sum(w**2 / (s**2 + 2 * d * w * s + w**2) for w, d in zip(OMEGA, DAMPING, strict=True)) + 30 / (s + 300)
    noise = 0.02 * (rng.standard_normal(25) + 1j * rng.standard_normal(25)) / np.sqrt(2)
    return rid.FrequencyResponse(omega, values + noise, bound=0.06)


def ran(folder, response, **worst_case):
    """A run of the response with a stated class."""
    rid.save(folder / "frf.csv", response)
    sections = {
        "frequency": [{"file": "frf.csv"}],
        "prior": {"gain_bound": 2.0, "decay": 60.0},
        "worst_case": worst_case,
    }
    return rid.run(ask(folder, sections), folder / "out")


@pytest.mark.slow
@pytest.mark.usefixtures("unreduced")
def test_a_run_of_continuous_data_covers_the_box_of_its_poles(tmp_path, response):
    found = ran(tmp_path, response, over_poles=True, at_hz=[6.0], directions=3, time_limit=2.0)
    assert found.consistent
    assert found.over_poles.certified
    assert any("With the poles anywhere in the pole-uncertainty box: within" in sentence for sentence in found.findings)
    assert "its poles anywhere in the box" in (tmp_path / "out" / "report.html").read_text()
    assert found.band.polygons is found.over_poles
    assert any("stand on exact poles and are not part of the curve" in sentence for sentence in found.findings)
    np.testing.assert_array_equal(rid.load(tmp_path / "out" / "band").upper, found.band.upper)


@pytest.mark.usefixtures("unreduced", "unpaged")
def test_by_default_polygons_cover_the_box_of_poles_that_the_data_leave(tmp_path, response):
    found = ran(tmp_path, response, at_hz=[6.37])
    assert found.band.box is not None
    assert found.error is None  # a sweep at the poles as they were taken says nothing of the others in the box
    assert found.band.polygons is found.over_poles
    np.testing.assert_allclose(found.over_poles.omega / (2 * np.pi), found.run_file.worst_case.at_hz)
    for (low, high), (least, most) in zip(found.band.box[0], found.over_poles.box.omega, strict=True):
        assert least <= low <= high <= most
    assert found.band.certified


@pytest.mark.slow
@pytest.mark.usefixtures("unreduced")
def test_a_sweep_at_exact_poles_is_no_part_of_the_band_over_their_box(tmp_path, response):
    found = ran(tmp_path, response, at_hz=[6.37, 11.14], directions=16, circle=True)
    assert found.band.box is not None
    assert found.band.polygons is None
    assert np.any(found.error.upper < found.band.error_at(found.error.omega))  # it would have lowered it
    assert "stand on exact poles and are not part of the curve" in (tmp_path / "out" / "report.html").read_text()


@pytest.fixture(scope="module")
def result(response):
    basis, prior = rid.kautz(OMEGA, DAMPING, dt=0), rid.Prior(gain_bound=2.0, decay=60.0)
    return rid.identify(rid.MixedProblem(frequency=response, prior=prior, parametric=basis))


def test_the_box_is_named_where_it_can_be_covered(result):
    hz = tuple((OMEGA / (2 * np.pi)).tolist())
    box = {"hz_interval": tuple((0.99 * f, 1.01 * f) for f in hz), "damping_interval": ((0.01, 0.03), (0.02, 0.04))}
    modes = Modes(hz=hz, damping=tuple(DAMPING.tolist()), **box)
    assert "over_poles = true in [worst_case] covers it" in findings.pole_words(result, modes)
    assert "over_poles" not in findings.pole_words(result, dataclasses.replace(modes, hz_interval=None))
    twice = rid.kautz(OMEGA, DAMPING, dt=0, repeat=2)
    doubled = rid.identify(dataclasses.replace(result.problem, parametric=twice))
    assert "over_poles" not in findings.pole_words(doubled, modes)
    real = findings.pole_words(result, dataclasses.replace(modes, damping=(0.02, 1.0)))
    assert "real poles were chosen" in real
    assert "over_poles" not in real


def test_a_mode_whose_box_is_too_wide_is_named(result):
    box = OMEGA[:, None] * [[0.9999, 1.0001], [0.9, 1.1]], DAMPING[:, None] * [0.99, 1.01]
    band = rid.guarantee.worst_case_over_poles(result, *box, omega=[25.0, 70.0], directions=4, cells=1)
    assert np.isfinite(band.sigma_upper[0])
    assert band.sigma_upper[1] == np.inf
    assert band.too_wide == "mode 2"
    assert "(mode 2) is too wide there" in band.summary()
    words = findings.box_words(band)
    assert "of the small model at 1 of 2 frequencies" in words
    assert "the box of mode 2 is too wide" in words
    assert "∞" not in words
