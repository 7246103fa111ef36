"""Runs and commands with several inputs and outputs: the whole matrix unless an entry is asked for."""

import tomllib

import numpy as np
import pytest

import robustid as rid
from robustid.core import responses
from robustid.identification import largest_ratio
from support.matrix_lines import HZ, damping_of, measured
from support.measured import needs
from support.run_files import EXAMPLES, QUICK, ask

SCALING = [[2.0, 1.0], [1.0, 0.5]]


@pytest.mark.usefixtures("unreduced", "unpaged")
def test_a_matrix_is_run_whole_and_again_from_its_own_file(folder):
    """Modes, prior and scaling are left to the program; the file that it writes says them and gives the same."""
    truth, _, frf = measured(bound=0.02, count=8)
    rid.save("two.npz", frf)
    first = rid.run(ask(folder, {"frequency": [{"file": "two.npz"}]}, QUICK), "first")
    stated = tomllib.loads((folder / "first" / "run.toml").read_text(encoding="utf-8"))
    assert np.shape(stated["prior"]["scaling"]) == (2, 2)
    assert np.array(first.identification.problem.prior.scaling) == pytest.approx(np.array(stated["prior"]["scaling"]))
    assert np.array(stated["modes"]["hz"]) == pytest.approx(HZ[:2], rel=0.03)
    assert first.consistent
    assert first.model.D.shape == (2, 2)
    assert largest_ratio(first.identification.problem, truth) <= 1
    assert any("all 32 samples" in words for words in first.findings)
    second = rid.run(folder / "first" / "run.toml", "second")
    assert second.identification.margin == first.identification.margin
    assert second.findings == first.findings


@pytest.mark.slow  # quick: the file and the commands, and Python with its error below
def test_the_whole_way_of_a_matrix_in_python(request):
    truth, basis, frf = measured(count=10)
    prior = rid.Prior(gain_bound=0.1, decay_rate=1.2, scaling=SCALING)
    modes = list(zip(HZ, damping_of(truth), strict=False))
    found = rid.identify_reduced(frf, modes=modes, prior=prior, inflate=1.5, worst_case=False)
    assert found.identification.problem.prior == prior
    assert found.reduction.order <= 4
    np.testing.assert_allclose(found.identification.problem.frequency[0].bound, 1.5 * frf.bound)
    request.getfixturevalue("unreduced")
    same = rid.identify_reduced(rid.MixedProblem(frequency=frf, prior=prior, parametric=basis), worst_case=False)
    assert f"scaling = {SCALING}" in same.run_file.text()


@pytest.mark.usefixtures("unreduced", "unsharpened")
def test_commands_take_the_whole_matrix(folder, run):
    _, _, frf = measured(count=6)
    rid.save("two.npz", frf)
    modes = ["--mode", "4:0.03", "--mode", "9:0.03", "--gain", "0.1", "--decay-rate", "1.2"]
    code, out, err = run(["identify", "--frequency", "two.npz", *modes])
    assert code in (0, 3), err
    assert "all of 2 outputs and 2 inputs" in out
    found = rid.load("result")
    np.testing.assert_array_equal(found.problem.frequency[0].values, frf.values)
    assert found.model.D.shape == (2, 2)


@pytest.mark.usefixtures("unreduced")
def test_the_error_of_a_matrix_is_said_with_its_entry(folder):
    _, basis, frf = measured(count=4)
    prior = rid.Prior(gain_bound=0.1, decay_rate=1.3)
    problem = rid.MixedProblem(frequency=frf.with_bound(2 * frf.bound), prior=prior, parametric=basis)
    found = rid.identify_reduced(problem, omega=[60.0], directions=4)
    _, i, j = np.unravel_index(np.argmax(found.error.upper), (1, 2, 2))
    (words,) = (finding for finding in found.findings if "Every consistent system" in finding)
    assert f"(largest at 9.5493 Hz (y{i + 1} / u{j + 1}))" in words


@pytest.mark.slow
def test_a_run_covers_the_box_of_the_poles_of_a_matrix(folder):
    truth, _, frf = measured(count=20)
    rid.save("two.npz", frf)
    modes = {"hz": HZ[:2].tolist(), "damping": damping_of(truth).tolist(), "delay": 1}
    for name, part in (("hz", 1e-3), ("damping", 1e-2)):
        modes[f"{name}_interval"] = [[one * (1 - part), one * (1 + part)] for one in modes[name]]
    asked = {"frequency": [{"file": "two.npz"}], "modes": modes, "worst_case": {"over_poles": True, "at_hz": [5.0]}}
    found = rid.run(ask(folder, asked), "out")
    assert any("With the poles anywhere in the pole-uncertainty box: within" in words for words in found.findings)
    band = found.over_poles
    off = responses(truth, band.omega * 0.01) - band.nominal
    assert np.all(np.abs(off) <= band.upper)
    assert "Every entry" in (folder / "out" / "report.html").read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.realdata
def test_the_beam_from_its_example(tmp_path):
    needs("beam_ring/symexc_1.mat")
    result = rid.run(EXAMPLES / "beam_ring.toml", tmp_path / "out")
    assert result.consistent
    hz = result.run_file.modes.hz
    assert np.array(hz) == pytest.approx([11.2, 22.6, 28.1, 33.2, 58.3, 65.4], abs=0.1)
    assert result.model.D.shape == (2, 2)
    assert result.reduction.order <= 20
    assert np.all(np.abs(result.model.poles()) < 1)
    assert largest_ratio(result.identification.problem, result.model) <= 1
    assert result.error.certified
    assert np.all(result.error.lower >= 0.9 * result.error.upper)
    assert (tmp_path / "out" / "report.html").is_file()
