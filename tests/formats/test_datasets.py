"""The simulated structure against its stated properties, and the measured data that others published."""

import copy
import dataclasses
import hashlib
import os
import pathlib

import control
import numpy as np
import pooch
import pytest
import scipy.io

from robustid.data import flexible_structure
from robustid.errors import DatasetNotFoundError, FileFormatError, InputError, InputTypeError, RobustIdError
from robustid.estimation import estimate_frf
from robustid.formats import datasets
from support.measured import realdata
from support.refusals import refusals, refused

TWO_MASS = "two_mass/MultisineTypeA.mat"


def continuous_response(omega):
    """The two modes in s, written out."""
    s, total = 1j * omega, 0
    for hz, damping, gain in ((9.0, 0.1, 0.9), (17.67, 0.004, 0.0594)):
        w = 2 * np.pi * hz
        total = total + gain * w**2 / (s**2 + 2 * damping * w * s + w**2)
    return total


def test_truth_is_the_zero_order_hold_of_the_stated_modes():
    dt, truth = 0.01, flexible_structure().truth
    assert truth.dt == dt
    for hz in (0.5, 9.0, 17.67, 30.0):
        w = 2 * np.pi * hz
        # the hold's sum over its aliases: (1 - 1/z) sum_k G(s_k) / (s_k dt), s_k = j(w + 2 pi k/dt)
        aliases = w + 2 * np.pi * np.arange(-20000, 20001) / dt
        sampled = (1 - np.exp(-1j * w * dt)) * np.sum(continuous_response(aliases) / (1j * aliases * dt))
        assert complex(truth(np.exp(1j * w * dt))) == pytest.approx(sampled, rel=1e-9)


def test_modes_peak_and_static_gain():
    experiment = flexible_structure()
    poles = np.log(np.linalg.eigvals(experiment.truth.A)) / 0.01
    found = sorted({(round(abs(p), 9), round(-p.real / abs(p), 9)) for p in poles})
    np.testing.assert_allclose(found, experiment.modes, rtol=1e-6)
    np.testing.assert_allclose(experiment.modes, [[2 * np.pi * 9, 0.1], [2 * np.pi * 17.67, 0.004]])
    omega = 2 * np.pi * np.linspace(17.4, 17.9, 2001)
    assert np.max(control.frequency_response(experiment.truth, omega).magnitude) == pytest.approx(7.1, abs=0.01)
    assert control.dcgain(experiment.truth) == pytest.approx(0.9594)


@pytest.mark.parametrize("bound", [0.03, 0.03 * 2.0**30])
def test_every_sample_lies_within_its_bound_of_the_truth(bound):
    """And the errors fill the bounds: 100 seeds, 1100 lines and 2000 samples."""
    truth, disc, interval = flexible_structure().truth, [], []
    step, x = [], np.zeros((4, 1))
    for _ in range(20):
        step.append((truth.C @ x)[0, 0])
        x = truth.A @ x + truth.B
    for seed in range(100):
        experiment = flexible_structure(seed=seed, bound=bound)
        frf, record = experiment.frequency, experiment.time
        values = control.frequency_response(truth, frf.omega).frdata[0, 0]
        disc.append(np.abs(frf.values[:, 0, 0] - values) / bound)
        interval.append((record.y[:, 0] - step) / bound)
    rounding = 1e-13 / bound
    assert np.max(disc) <= 1 + rounding
    assert np.max(np.abs(interval)) <= 1 + rounding
    if bound == 0.03:
        # uniform in the disc: P(|e| < r) = r^2; in the interval: P(|e| < r) = r; 4 sigma
        assert np.mean(np.array(disc) < 0.5) == pytest.approx(0.25, abs=4 * np.sqrt(0.25 * 0.75 / 1100))
        assert np.mean(np.abs(interval) < 0.5) == pytest.approx(0.5, abs=4 * np.sqrt(0.25 / 2000))


def test_default_data():
    experiment = flexible_structure()
    np.testing.assert_allclose(experiment.frequency.freq_hz, np.arange(1, 22, 2))
    assert np.all(experiment.frequency.bound == 0.03)
    assert np.all(experiment.time.bound == 0.03)
    assert experiment.time.u.ravel().tolist() == [1.0] * 20
    assert experiment.time.initial == "rest"
    assert str(experiment.time.outputs[0]) == "displacement [mm]"
    assert str(experiment.frequency.inputs[0]) == "force [N]"


def test_more_lines_leave_the_other_data_as_they_are():
    few, many = flexible_structure(seed=4), flexible_structure(seed=4, extra_hz=[17.2, 17.67])
    np.testing.assert_array_equal(few.time.y, many.time.y)
    kept = np.isin(many.frequency.omega, few.frequency.omega)
    np.testing.assert_array_equal(many.frequency.values[kept], few.frequency.values)
    assert many.frequency.omega.size == 13
    assert not np.array_equal(few.time.y, flexible_structure(seed=5).time.y)


def test_a_copy_of_the_experiment_is_equal_and_read_only():
    experiment = flexible_structure(samples=1, lines=1)
    again = copy.deepcopy(experiment)
    np.testing.assert_array_equal(again.frequency.values, experiment.frequency.values)
    np.testing.assert_array_equal(again.truth.A, experiment.truth.A)
    with pytest.raises(ValueError, match="read-only"):
        again.modes[0, 0] = 0


test_flexible_structure_refuses = refusals(
    ({"lines": 0}, "`lines` must be at least 1; got 0"),
    ({"samples": 0}, "`samples` must be at least 1; got 0"),
    ({"samples": 2.5}, "`samples` must be an integer", InputTypeError),
    ({"bound": 0}, "`bound` must be positive; got 0"),
    ({"dt": -1}, "`dt` must be positive; got -1"),
    ({"dt": 0.03}, r"`dt` = 0\.03 s allows frequencies up to 16\.6667 Hz; got 21 Hz"),
    ({"extra_hz": [51]}, "allows frequencies up to 50 Hz; got 51 Hz"),
    ({"extra_hz": 17.0}, "`extra_hz` must have 1 dimension"),
    of=flexible_structure,
)


# --- published data


def test_every_known_file_has_an_origin_a_licence_and_a_checksum():
    assert TWO_MASS in datasets.DATASETS
    for name, known in datasets.DATASETS.items():
        assert "@" in known.origin, name
        assert known.licence
        assert len(bytes.fromhex(known.sha256)) == 32
    assert len({known.sha256 for known in datasets.DATASETS.values()}) == len(datasets.DATASETS)


def test_absent_files_say_where_to_get_them(monkeypatch, tmp_path):
    monkeypatch.delenv("ROBUSTID_DATA", raising=False)
    sentence = r"names, not set now: get it from .*HoriFujimotoLab/FdiTools @5925fae7.*\(MIT\).*set ROBUSTID"
    with pytest.raises(DatasetNotFoundError, match=sentence) as caught:
        datasets.find(TWO_MASS)
    assert isinstance(caught.value, RobustIdError)
    assert isinstance(caught.value, FileNotFoundError)
    monkeypatch.setenv("ROBUSTID_DATA", str(tmp_path))
    refused(r"is not in .*: get it from", datasets.load, TWO_MASS, error=DatasetNotFoundError)
    refused(r"`name` must be one of .* got 'three_mass'", datasets.load, "three_mass")


def test_a_changed_file_is_found_out(monkeypatch, tmp_path):
    monkeypatch.setenv("ROBUSTID_DATA", str(tmp_path))
    path = tmp_path / TWO_MASS
    path.parent.mkdir()
    path.write_bytes(b"something else")
    assert datasets.find(TWO_MASS) == path
    with pytest.raises(FileFormatError, match=r"differs from the published file \(SHA-256\)"):
        datasets.find(TWO_MASS, verify=True)
    known_as(monkeypatch, b"something else")
    assert datasets.find(TWO_MASS, verify=True) == path


class TestMeasured:
    pytestmark = realdata

    @pytest.mark.parametrize("name", sorted(datasets.DATASETS))
    def test_checksums(self, name):
        if not pathlib.Path(os.environ["ROBUSTID_DATA"], name).is_file():
            pytest.skip(f"{name} is not in the folder that ROBUSTID_DATA names")
        assert datasets.find(name, verify=True).name == pathlib.Path(name).name

    def test_torsion_of_the_two_mass_bench(self):
        """Read from the file: a peak of 0.026 at 77 Hz, 0.001 at 11 Hz, 240 lines from 11 to 250 Hz."""
        record = datasets.load(TWO_MASS)
        assert record.u.shape == (50000, 1)
        assert [c.name for c in record.outputs] == ["theta_mx", "theta_my"]
        torsion = dataclasses.replace(record, y=record.y.sum(axis=1), outputs=["torsion [rad]"])
        frf = estimate_frf(torsion, period=2500)
        np.testing.assert_allclose(frf.freq_hz, np.arange(11, 251))
        gain = np.abs(frf.values[:, 0, 0])
        assert frf.freq_hz[np.argmax(gain)] == 77
        assert gain.max() == pytest.approx(0.026, rel=0.01)
        assert gain[0] == pytest.approx(0.001, rel=0.02)
        assert "left out (transient)" in frf.note

    def test_beam_ring_is_the_symmetric_and_the_antisymmetric_sweep(self):
        records = datasets.load("beam_ring")
        for record, name, sign in zip(records, ("symexc_1", "asymexc_1"), (1, -1), strict=True):
            assert sign * np.mean(record.u[:, 0] * record.u[:, 1]) > 0
            alone = datasets.load(f"beam_ring/{name}.mat")
            assert alone.u.shape == alone.y.shape == (120001, 2)
            assert alone.dt == 1e-3

    def test_two_mass_by_its_short_name(self):
        assert datasets.load("two_mass", dt=0.5).dt == 0.5
        np.testing.assert_array_equal(datasets.load("two_mass").y, datasets.load(TWO_MASS).y)

    @pytest.mark.parametrize(("name", "channels", "samples"), [("cdplayer", 2, 2048), ("hairdryer", 1, 1000)])
    def test_short_records(self, name, channels, samples):
        """Inputs are the first columns of the only matrix; the record starts in the middle of the experiment."""
        record = datasets.load(name)
        assert record.u.shape == record.y.shape == (samples, channels)
        assert record.initial == "free"
        table = scipy.io.loadmat(datasets.find(f"daisy/{name}.mat"))[name]
        np.testing.assert_array_equal(np.hstack([record.u, record.y]), table)

    @pytest.mark.parametrize(("part", "realisations"), [("train", 6), ("test", 3)])
    def test_mirror_records_keep_their_periods(self, part, realisations):
        records = datasets.load(f"fsm/{part}")
        assert len(records) == realisations
        u, y = (np.load(datasets.find(f"fsm_cubespec/{signal}_300mV_{part}.npy")) for signal in "uy")
        for k, record in enumerate(records):
            assert record.u.shape == record.y.shape == (2 * 8192, 3)
            assert (record.initial, 1 / record.dt) == ("periodic", 6400)
            for period in (0, 1):
                np.testing.assert_array_equal(record.y[period * 8192 :][:8192], y[:, :, k, period])
                np.testing.assert_array_equal(record.u[period * 8192 :][:8192], u[:, :, k, period])
        with pytest.raises(InputError, match="is read in one way; leave out dt"):
            datasets.load(f"fsm/{part}", dt=1)

    @pytest.mark.parametrize(
        ("name", "states", "size", "damping"),
        [("CDplayer", 120, 2, 0.01), ("iss1R", 270, 3, 0.005), ("beam", 348, 1, 0.0103), ("build", 48, 1, 0.023)],
    )
    def test_models(self, name, states, size, damping):
        """Facts that stand beside the files."""
        model = datasets.load(name)
        poles = np.linalg.eigvals(model.A)
        assert (model.nstates, model.D.shape, model.dt) == (states, (size, size), 0)
        assert not np.any(model.D)
        assert poles.real.max() < 0
        assert np.min(-poles.real / np.abs(poles)) == pytest.approx(damping, rel=0.03)
        assert datasets.load(f"slicot/{name}.mat").nstates == states

    def test_one_array_is_no_record(self):
        with pytest.raises(InputError, match="is no record of one experiment; load 'fsm/train'"):
            datasets.load("fsm_cubespec/u_300mV_test.npy")


def network(monkeypatch, tmp_path, contents):
    """Stand in for the network, with these contents at every address; the list of addresses that will be asked for."""
    asked = []

    def get(self, url, output_file, pooch, check_only=False):
        asked.append(url)
        with open(output_file, "wb") if isinstance(output_file, str) else output_file as file:
            file.write(contents)

    monkeypatch.delenv("ROBUSTID_DATA", raising=False)
    monkeypatch.setattr(pooch, "os_cache", lambda project: tmp_path / project)
    monkeypatch.setattr(pooch.HTTPDownloader, "__call__", get)
    return asked


URL = "https://raw.githubusercontent.com/HoriFujimotoLab/FdiTools/5925fae7/Examples/private/MultisineTypeA.mat"


def known_as(monkeypatch, contents):
    sha256 = hashlib.sha256(contents).hexdigest()
    monkeypatch.setitem(datasets.DATASETS, TWO_MASS, dataclasses.replace(datasets.DATASETS[TWO_MASS], sha256=sha256))


def test_download_once_verified_and_with_its_licence_said(monkeypatch, tmp_path, caplog):
    asked = network(monkeypatch, tmp_path, b"measured")
    known_as(monkeypatch, b"measured")
    with caplog.at_level("INFO", logger="robustid"):
        path = datasets.fetch(TWO_MASS)
    assert path == tmp_path / "robustid" / TWO_MASS
    assert path.read_bytes() == b"measured"
    assert "licence: MIT" in caplog.text
    assert "cite: Hori-Fujimoto Lab" in caplog.text
    assert datasets.fetch(TWO_MASS) == path
    assert asked == [URL]
    # damaged in the cache: fetched again
    path.write_bytes(b"damaged")
    assert datasets.fetch(TWO_MASS).read_bytes() == b"measured"
    assert asked == [URL, URL]


def test_the_folder_of_the_user_goes_first(monkeypatch, tmp_path):
    asked = network(monkeypatch, tmp_path, b"measured")
    known_as(monkeypatch, b"measured")
    monkeypatch.setenv("ROBUSTID_DATA", str(tmp_path / "mine"))
    (tmp_path / "mine" / "two_mass").mkdir(parents=True)
    (tmp_path / "mine" / TWO_MASS).write_bytes(b"mine")
    assert datasets.fetch(TWO_MASS).read_bytes() == b"mine"
    assert asked == []
    (tmp_path / "mine" / TWO_MASS).unlink()
    assert datasets.fetch(TWO_MASS).read_bytes() == b"measured"


def test_another_file_than_the_published_one_is_refused(monkeypatch, tmp_path):
    network(monkeypatch, tmp_path, b"something else")
    with pytest.raises(FileFormatError, match=r"what came from https.* isn't the published file \(SHA-256\)"):
        datasets.fetch(TWO_MASS)
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


def test_an_origin_out_of_reach_says_where_to_get_the_file(monkeypatch):
    monkeypatch.delenv("ROBUSTID_DATA", raising=False)
    sentence = "not set now: get it from github HoriFujimotoLab.*The download from https.* failed: tests don't download"
    with pytest.raises(DatasetNotFoundError, match=sentence):
        datasets.load("two_mass")


def test_every_name_is_described():
    for name in (*datasets.NAMES, *datasets.DATASETS):
        text = datasets.describe(name)
        assert all(word in text for word in (name, "origin: github", "licence: ", "cite: "))
    with pytest.raises(InputError, match="must be one of"):
        datasets.describe("three_mass")
