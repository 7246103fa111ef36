"""The claims of the examples of designed controllers; their true plants and withheld records judge them."""

import control
import numpy as np
import pytest

from support.example_runs import load
from support.measured import needs


def peak_of(plant, law):
    """Largest size of the closed loop's poles, and of S at 10^4 frequencies."""
    omega = np.linspace(0, np.pi / law.dt, 10_001)[1:]
    z = np.exp(1j * omega * law.dt)
    return np.abs(control.feedback(plant, law).poles()).max(), np.abs(1 / (1 + plant(z) * law(z))).max()


@pytest.fixture
def run_with_result(run):
    """What an example prints, and the design that it returns."""

    def ran(example, *options):
        found, main = [], example.main
        example.main = lambda argv: found.append(main(argv))
        return run(example, ["controller.png"], *options), found[0]

    return ran


@pytest.mark.slow
@pytest.mark.realdata
def test_controller_motor(run_with_result):
    """Two stretches of the record have one controller, and the one that was withheld does not contradict its peak."""
    needs("two_mass/MultisineTypeA.mat")
    example = load("controller_motor")
    printed, design = run_with_result(example)
    assert design.status.name == "PROVED"
    assert len(design.proofs) == 2
    assert all(proof.peaks["sensitivity"].value <= example.PEAK for proof in design.proofs)
    assert all(proof.margins.gain[1] >= example.GAIN_MARGIN for proof in design.proofs)
    assert design.level > 2 * np.pi * 30
    assert "certainly above it at 0.0%" in printed


@pytest.mark.slow
def test_controller_levitation(run_with_result):
    """The unstable machine keeps its peaks, and loses its error under load."""
    printed, design = run_with_result(load("controller_levitation"))
    assert design.status.name == "PROVED"
    rows = {
        line.split()[0]: line.split()[1::2] for line in printed.splitlines() if line.startswith(("ran ", "designed "))
    }
    ran, new = (np.array(rows[name], float) for name in ("ran", "designed"))
    assert new[-1] <= ran[-1]  # peak of S
    assert np.all(new[:3] < ran[:3])
    size, peak = peak_of(load("levitation").machine(), design.controller)
    assert size < 1
    assert peak <= design.limits.sensitivity_peak


@pytest.mark.slow
def test_controller_stage(run_with_result):
    """True plants of the positions that were measured are stable with their peak, and the bandwidth is that of all of them."""
    example = load("controller_stage")
    _, design = run_with_result(example)
    assert design.status.name == "PROVED"
    assert design.level > 2 * 2 * np.pi * example.SLOW_HZ
    for position in example.POSITIONS:
        plant = example.stage(position)
        size, peak = peak_of(plant, design.controller)
        assert size < 1
        assert peak <= example.PEAK
        omega = np.geomspace(1.0, design.level, 2000)
        z = np.exp(1j * omega * example.DT)
        assert np.abs(plant(z) * design.controller(z)).min() >= 1


@pytest.mark.slow
@pytest.mark.realdata
@pytest.mark.parametrize(("options", "least"), [((), 1), (("--notches",), 10)])  # Hz
def test_controller_mirror(run_with_result, options, least):
    """Three axes are proved together, and withheld records keep the peak."""
    needs("fsm_cubespec/u_300mV_train.npy")
    example = load("controller_mirror")
    printed, design = run_with_result(example, *options)
    assert design.status.name == "PROVED"
    assert design.proofs[0].peaks["sensitivity"].value <= example.PEAK
    assert design.level > 2 * np.pi * least  # the static gain is known to a half
    assert float(printed.split("largest |S|")[1].split()[0]) <= example.PEAK
