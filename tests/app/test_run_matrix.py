"""Runs, proposals and commands with several inputs and outputs: the whole matrix unless an entry is asked for."""

import dataclasses
import tomllib

import numpy as np
import pytest

import robustid as rid
from robustid.advice import suggest_kautz
from robustid.app import choices, findings
from robustid.app.run_file import RunFile
from robustid.data.io import datasets
from robustid.errors import DatasetNotFoundError
from robustid.identification.residuals import largest_ratio, model_residuals
from support import run_files
from support.command_line import main as command
from support.matrix_lines import DT, HZ, lines, plant
from support.run_files import EXAMPLES, QUICK, ask

folder, unreduced = run_files.folder, run_files.unreduced
SCALING = [[2.0, 1.0], [1.0, 0.5]]


def measured(seed=0, **options):
    rng = np.random.default_rng(seed)
    truth, basis = plant(rng, 2)
    return truth, basis, lines(rng, truth, **options)


@pytest.mark.usefixtures("unreduced")
def test_a_matrix_is_run_whole_and_again_from_its_own_file(folder):
    """Modes, prior and scaling are left to the program; the file that it writes says them and gives the same."""
    truth, _, frf = measured(bound=0.02, count=16)
    rid.save("two.npz", frf)
    first = rid.run(ask(folder, {"frequency": [{"file": "two.npz"}]}, QUICK), "first")
    stated = tomllib.loads((folder / "first" / "run.toml").read_text(encoding="utf-8"))
    assert np.shape(stated["prior"]["scaling"]) == (2, 2)
    assert np.array(first.identification.problem.prior.scaling) == pytest.approx(np.array(stated["prior"]["scaling"]))
    assert np.array(stated["modes"]["hz"]) == pytest.approx(HZ[:2], rel=0.01)
    assert first.consistent
    assert first.model.D.shape == (2, 2)
    assert largest_ratio(first.identification.problem, truth) <= 1
    assert "all 64 samples" in first.findings[1]
    second = rid.run(folder / "first" / "run.toml", "second")
    assert second.identification.margin == first.identification.margin
    assert second.findings == first.findings


def test_the_whole_way_of_a_matrix_in_python():
    truth, basis, frf = measured(count=16)
    prior = rid.Prior(gain_bound=0.1, decay_rate=1.2, scaling=SCALING)
    modes = list(zip(HZ, modes_of(truth), strict=False))
    found = rid.identify_reduced(frf, modes=modes, prior=prior, inflate=1.5, worst_case=False)
    assert found.identification.problem.prior == prior
    assert found.reduction.order <= 4
    np.testing.assert_allclose(found.identification.problem.frequency[0].bound, 1.5 * frf.bound)
    with pytest.raises(rid.InputError, match=r"suggest_class.*one input and one output"):
        rid.advice.suggest_class(frequency=frf)
    same = rid.identify_reduced(rid.MixedProblem(frequency=frf, prior=prior, parametric=basis), worst_case=False)
    assert f"scaling = {SCALING}" in same.run_file.text()


def modes_of(model):
    """Damping ratios of the pairs, by frequency."""
    poles = np.log(model.poles()[model.poles().imag > 0])
    return (-poles.real / np.abs(poles))[np.argsort(np.abs(poles))]


def test_wider_bounds_keep_their_kind():
    """The size of an error in units of the bound is divided by the factor, whatever the bound is."""
    rng = np.random.default_rng(0)
    _, _, frf = measured()
    error = rng.standard_normal(frf.values.shape) + 1j * rng.standard_normal(frf.values.shape)
    root = rng.standard_normal((frf.omega.size, 4, 4)) + 1j * rng.standard_normal((frf.omega.size, 4, 4))
    run = RunFile().changed("identify", inflate=3.0)
    for data in (
        frf,
        dataclasses.replace(frf, tilt=np.full(frf.omega.size, 0.3 + 0.1j)),
        frf.with_column_bound(0.1),
        dataclasses.replace(frf, bound=None, joint="matrix", ellipsoid=root @ root.conj().swapaxes(1, 2)),
    ):
        wide = choices.inflated(data, run)
        assert wide.joint == data.joint
        np.testing.assert_allclose(wide.ratio(error), data.ratio(error) / 3, rtol=1e-9)
        assert "times 3" in wide.note


def test_samples_outside_are_named_with_their_entry():
    truth, basis, frf = measured()
    values = np.array(frf.values)
    values[3, 1, 0] += 7 * 0.05
    problem = rid.MixedProblem(
        frequency=dataclasses.replace(frf, values=values, outputs=["left", "right"], inputs=["a", "b"]),
        prior=rid.Prior(gain_bound=0.1, decay_rate=1.2),
        parametric=basis,
    )
    result = rid.identify(problem)
    words = findings.sample_words(result, truth, 4)
    assert f"leaves 1 of 120 samples outside their bounds: {frf.freq_hz[3]:.5g} Hz (right / a)" in words
    lines_ = problem.frequency[0]
    assert "(right / a)" in findings.unused_words(rid.validate(truth, lines_))
    column = dataclasses.replace(lines_, joint="column")
    assert f"{frf.freq_hz[3]:.5g} Hz (a)" in findings.unused_words(rid.validate(truth, column))
    ratio = max(r.ratio.max() for r in model_residuals(problem, truth))
    assert f"({ratio:.4g} bounds)" in words


def test_modes_are_those_of_all_entries_together():
    """Each mode is seen in another column, at the first line of which it is missing."""
    rng = np.random.default_rng(4)
    truth, _ = plant(rng, 2)
    truth.B[:2, 1] = truth.B[2:, 0] = 0
    frf = lines(rng, truth, bound=0.002, count=60)
    for column, hz in ((0, HZ[1]), (1, HZ[0])):
        alone = suggest_kautz(frf.entry(0, column)).omega / (2 * np.pi)
        assert not np.any(np.abs(alone - hz) < 0.1)
    holes = np.array(frf.bound)
    holes[::7, 0, 0] = np.inf
    found = suggest_kautz(dataclasses.replace(frf, bound=holes, values=np.where(np.isinf(holes), np.nan, frf.values)))
    exact = truth.poles()[truth.poles().imag > 0]
    exact = exact[np.argsort(exact.imag)]
    assert found.omega == pytest.approx(np.abs(np.log(exact)) / DT, rel=1e-3)
    for k, pole in enumerate(np.log(exact)):
        low, high = found.omega_interval[k]
        assert low <= abs(pole) / DT <= high
        low, high = found.damping_interval[k]
        assert low <= -pole.real / abs(pole) <= high


def test_commands_take_the_whole_matrix(folder, capsys, monkeypatch):
    _, _, frf = measured(count=12)
    rid.save("two.npz", frf)
    modes = ["--mode", "4:0.03", "--mode", "9:0.03", "--gain", "0.1", "--decay", "1.2"]
    code, out, err = command(["identify", "--frequency", "two.npz", *modes], capsys, monkeypatch)
    assert code in (0, 3), err
    assert "all of 2 outputs and 2 inputs" in out
    found = rid.load("result")
    np.testing.assert_array_equal(found.problem.frequency[0].values, frf.values)
    assert found.model.D.shape == (2, 2)


def test_remedies_for_a_matrix_that_contradicts_its_class():
    """Without the second mode: a pair is proposed near it, and the data are consistent then."""
    truth, _, frf = measured(count=16)
    omega = np.abs(np.log(truth.poles()[truth.poles().imag > 0])) / DT
    basis = rid.kautz(omega.min(), modes_of(truth)[0], dt=DT, delay=1)
    problem = rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=0.1, decay_rate=1.2), parametric=basis)
    result = rid.identify(problem)
    assert not result.consistent
    found = {trial.change: trial.margin for trial in rid.advice.diagnose(result).trials}
    (more,) = (margin for change, margin in found.items() if change.startswith("one more pair, at 9.0"))
    assert more <= 1 < found["K times 2"]


def test_the_error_of_a_matrix_is_said_with_its_entry(folder):
    _, basis, frf = measured(count=8)
    prior = rid.Prior(gain_bound=0.1, decay_rate=1.3)
    problem = rid.MixedProblem(frequency=frf.with_bound(2 * frf.bound), prior=prior, parametric=basis)
    found = rid.identify_reduced(problem, omega=[60.0], directions=4)
    _, i, j = np.unravel_index(np.argmax(found.error.upper), (1, 2, 2))
    (words,) = (finding for finding in found.findings if "Every consistent system" in finding)
    assert f"(largest at 9.5493 Hz (y{i + 1} / u{j + 1}))" in words
    rid.save("two.npz", frf)
    modes = {"hz": [4.0], "damping": [0.03], "hz_interval": [[3.9, 4.1]], "damping_interval": [[0.02, 0.04]]}
    asked = ask(folder, {"frequency": [{"file": "two.npz"}], "modes": modes, "worst_case": {"over_poles": True}})
    with pytest.raises(rid.InputError, match=r"over_poles = true bounds one entry: add entry = \[output, input\]"):
        rid.run(asked, "out")


@pytest.mark.slow
@pytest.mark.realdata
def test_the_beam_from_its_example(tmp_path):
    try:
        datasets.find("beam_ring/symexc_1.mat")
    except DatasetNotFoundError as missing:
        pytest.skip(str(missing))
    result = rid.run(EXAMPLES / "beam_ring.toml", tmp_path / "out")
    assert result.consistent
    hz = result.run_file.modes.hz
    assert np.array(hz) == pytest.approx([11.2, 22.6, 28.1, 33.2, 58.3, 65.4], abs=0.1)
    assert result.model.D.shape == (2, 2)
    assert result.reduction.order <= 20
    assert np.all(np.abs(result.model.poles()) < 1)
    assert largest_ratio(result.identification.problem, result.model) <= 1
    assert (tmp_path / "out" / "report.html").is_file()
