"""Controllers as C: compiled with gcc -O2 without a warning, in loops against `control`, at their limits, with any poles."""

import shutil

import control
import numpy as np
import pytest
import scipy.linalg

import robustid as rid
from robustid.app.exports import write_controller_c
from robustid.app.exports.controller_source import anti_windup
from robustid.app.exports.sections import sections
from robustid.core import StateMatrices, simulate
from robustid.design import PID, Limits, LowPass
from robustid.errors import InputError, InputTypeError
from support.command_line import refused, words
from support.design_cases import band_of
from support.drives import Played, built, closed, compiled, drive, linear
from support.loop_candidates import consistent_members

needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="needs the compiler gcc on the path")
SINGLE = "-DDRIVE_SINGLE"
KINDS = {(): float, (SINGLE,): np.float32}


def same_responses(plant, controller, w, folder):
    """Steps of y and u in both precisions, to 1e-6 of the largest value of each."""
    r = np.ones(int(min(60 / w / plant.dt, 100_000)))
    wanted = linear(plant, controller, r)
    for flags in KINDS:
        found = closed(compiled(controller, plant.nstates, folder / f"in{len(flags)}", *flags), plant, r)
        for one, true in zip(found, wanted, strict=True):
            assert np.abs(one - true).max() <= 1e-6 * np.abs(true).max(), flags


@needs_gcc
@pytest.mark.parametrize("seed", [pytest.param(k, marks=[] if k == 3 else pytest.mark.slow) for k in range(25)])
def test_a_loop_with_the_controller_in_c_has_the_steps_of_the_sampled_loop(seed, tmp_path):
    same_responses(*drive(seed), tmp_path)


@needs_gcc
@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 4, 7])
def test_designs_for_all_consistent_plants_run_as_designed(seed, tmp_path):
    plant, band = band_of(seed)
    design = rid.design_controller(band, [PID(filter=150.0), LowPass(150.0, 1)], limits=Limits(sensitivity_peak=2.0))
    (tmp_path / "same").mkdir()
    for name in ("drive.c", "drive.m", "drive.sos"):
        rid.save(tmp_path / name, design)
        rid.save(tmp_path / "same" / name, design.controller)
        assert (tmp_path / name).read_text() == (tmp_path / "same" / name).read_text()
    same_responses(plant, design.controller, design.level, tmp_path)


def sampled(seed, count):
    """A proved design for a band without a direct term, as sampled plants have none, and plants of it."""
    plant, band = band_of(seed)
    nothing = rid.TimeRecord([1.0], [0.0], dt=plant.dt, bound=1e-9)
    problem = rid.MixedProblem(frequency=band.problem.frequency, time=nothing, prior=band.problem.prior)
    design = rid.design_controller(rid.band(problem, model=plant), [PID(filter=150.0), LowPass(150.0, 1)])
    assert design.status.name == "PROVED"
    near = [omega for _, omega in design.shares.values() if np.isfinite(omega)]
    found = consistent_members(rid.identify(problem), count, np.random.default_rng(seed), near)
    return design, [control.ss(one.A, one.B, one.C, 0, one.dt) for one in found]  # D within its 1e-9


@needs_gcc
@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 4, 7])
def test_a_design_in_c_has_the_steps_of_the_library_with_consistent_plants_of_its_band(seed, tmp_path):
    design, plants = sampled(seed, 6)
    for k, plant in enumerate(plants):
        (tmp_path / str(k)).mkdir()
        same_responses(plant, design.controller, design.level, tmp_path / str(k))
        free, limited, _ = limited_steps(plant, design.controller, design.level, k % 2 == 1, tmp_path / str(k))
        assert limited <= free + 0.02


def saturated(seed, folder):
    """Overshoot of the linear step, and of the limited one with anti-windup and without."""
    return limited_steps(*drive(seed), seed % 2 == 1, folder)


def limited_steps(plant, controller, w, single, folder):
    """The same of any loop, in single precision or in double."""
    r = np.ones(int(min(150 / w / plant.dt, 200_000)))
    y, u = linear(plant, controller, r)
    largest, last = np.abs(u).max(), abs(u[-1])
    limit = (
        min(1.2 * last, (last + largest) / 2) if last > 0.01 * largest else 0.3 * largest
    )  # more than standstill takes
    flags = [SINGLE] if single else []
    peaks = [y.max()]
    for changed in (None, ("w[i] = put - wanted;", "w[i] = 0 * (put - wanted);")):
        library = compiled(controller, plant.nstates, folder / f"limited{len(peaks)}", *flags, changed=changed)
        found, put = closed(library, plant, r, limit)
        assert np.isfinite(found).all()
        assert np.isfinite(put).all()
        assert np.abs(put).max() <= limit * (1 + 1e-6)
        assert np.abs(put).max() >= limit * (1 - 1e-6)
        if changed is None:
            tail = len(r) // 10
            assert np.abs(found[-tail:] - y[-tail:]).max() <= 2e-3 * y[-1]
        peaks.append(found.max())
    return np.array(peaks) / y[-1] - 1


@needs_gcc
def test_a_limited_drive_does_not_wind_up(tmp_path):
    free, limited, without = saturated(13, tmp_path)
    assert limited <= free + 0.02
    assert without > free + 0.05  # so that there was something to prevent


@needs_gcc
@pytest.mark.slow
def test_limited_drives_overshoot_no_more_than_free_ones(tmp_path):
    found = []
    for seed in range(20):
        (tmp_path / str(seed)).mkdir()
        found.append(saturated(seed, tmp_path / str(seed)))
    free, limited, without = np.array(found).T
    assert np.all(limited <= free + 0.02)
    assert np.sum(without > free + 0.05) >= 8


def rotated(blocks, seed, outputs=1, inputs=1, direct=True):
    """A system of these blocks in coordinates that show none of them."""
    rng = np.random.default_rng(seed)
    A = scipy.linalg.block_diag(*blocks)
    Q = np.linalg.qr(rng.standard_normal(A.shape))[0]
    B, C = rng.standard_normal((len(A), inputs)), rng.standard_normal((outputs, len(A)))
    return control.ss(Q @ A @ Q.T, Q @ B, C @ Q.T, rng.standard_normal((outputs, inputs)) * direct, 1e-3)


def turn(size, angle):
    return size * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def mixed(gains, turned):
    """PI with low-passes in every entry of which the gain is not zero, between directions of its inputs and outputs."""
    rows = []
    for i, row in enumerate(gains):
        entries = [
            control.ss(
                gain * control.tf([1 + 0.1 * i, 0.01 * k - 0.95], [1, -1], 1e-3) * control.tf([0.2], [1, -0.8], 1e-3)
            )
            for k, gain in enumerate(row)
        ]
        rows.append(control.ss([], [], [], np.ones((1, len(row))), 1e-3) * control.append(*entries))
    copied = control.ss([], [], [], np.kron(np.ones((len(gains), 1)), np.eye(len(gains))), 1e-3)
    sides = [control.ss([], [], [], one, 1e-3) for one in (turned, turned.T)]
    return sides[0] * control.append(*rows) * copied * sides[1]


CASES = {
    "gain": control.ss([], [], [], [[2.5]], 1e-3),
    "integrator": control.ss(control.tf([0.02], [1, -1], 1e-3)),
    "two integrators": control.ss(control.tf([1, -1.9, 0.902], [1, -2, 1], 1e-3)),
    "two integrators in other coordinates": rotated([[[1.0, 1.0], [0.0, 1.0]], 0.5], 1),
    "two integrators side by side": control.ss(np.eye(2), np.ones((2, 1)), [[1.0, 0.5]], 0, 1e-3),
    "past samples": control.ss(control.tf([1, -0.5, 0.25, 2.0], [1, 0, 0, 0], 1e-3)),
    "equal low-passes": control.ss(control.tf([1], np.poly([0.9] * 4), 1e-3)),
    "equal pairs": rotated([turn(0.95, 0.3), turn(0.95, 0.3)], 2),
    "close poles": rotated([0.99, 0.99 + 1e-9, 0.5], 3),
    "undamped pair": rotated([turn(1.0, 0.4), 0.3], 4),
    "alternating": rotated([-1.0, -0.5], 5),
    "unstable": rotated([1.002, 0.2], 6),
    "unstable pair": rotated([turn(1.002, 0.3)], 7, direct=False),
    "2x2 with integrators": control.append(
        control.ss(control.tf([2, -1.9], [1, -1], 1e-3)), control.ss(control.tf([1, -0.8], [1, -1], 1e-3))
    ),
    "2x2 of entries with equal poles": mixed(np.ones((2, 2)), np.eye(2)),
    "2x2 in directions": mixed(np.eye(2), np.linalg.qr(np.random.default_rng(9).standard_normal((2, 2)))[0]),
    "3x2 dense": rotated([1.0, 0.9, turn(0.9, 0.2)], 8, outputs=3, inputs=2),
}
# In open loop a rounded coefficient of a pole on the circle, beside z = 1, turns the state by that much at every sample.
DRIFTING = dict.fromkeys(("undamped pair", "alternating", "unstable pair"), 2000 * float(np.finfo(np.float32).eps))


@needs_gcc
@pytest.mark.parametrize(
    "name", [pytest.param(one, marks=[] if one == "3x2 dense" else pytest.mark.slow) for one in CASES]
)
def test_controllers_of_any_poles_equal_their_states_simulated(name, tmp_path):
    model = CASES[name]
    e = np.random.default_rng(0).standard_normal((2000, model.ninputs))
    wanted = simulate(StateMatrices.of(model), e)[0]
    for flags, kind in KINDS.items():
        library = compiled(model, 1, tmp_path / f"in{len(flags)}", *flags)
        run = Played(library, model, kind)
        first = run(e)
        tolerance = 1e-9 if kind is float else DRIFTING.get(name, 2e-6)
        assert np.abs(first - wanted).max() <= tolerance * np.abs(wanted).max()
        run.reset()
        assert (run(e) == first).all()


@needs_gcc
def test_limits_by_hand_are_followed_and_what_is_added_counts(tmp_path):
    controller = control.ss(control.tf([2.0, -1.9], [1, -1], 1e-3))
    run = Played(compiled(controller, 1, tmp_path), controller)
    none = np.zeros((300, 1))
    assert run(none + 0.1, lower=0.7, upper=0.7)[-1, 0] == 0.7  # by hand, against a control error
    run(none, lower=0.7, upper=0.7)
    np.testing.assert_allclose(run(none), 0.7, rtol=1e-9)  # and on without a bump
    run.reset()
    assert run(none, ahead=3.0, lower=-1.0, upper=2.0)[0, 0] == 2.0
    run.reset()
    assert run(none, ahead=3.0)[0, 0] == 3.0
    run.reset()
    assert run(none + 1, upper=1.5)[-1, 0] == 1.5  # one limit alone
    back = run(none - 0.1, upper=1.5)[:, 0]
    assert np.flatnonzero(back < 1.4)[0] < 5  # at once, after 300 samples at the limit


@needs_gcc
@pytest.mark.slow
@pytest.mark.parametrize("name", ["2x2 with integrators", "2x2 of entries with equal poles", "2x2 in directions"])
def test_outputs_by_hand_are_followed_together(name, tmp_path):
    run = Played(compiled(CASES[name], 1, tmp_path), CASES[name])
    none, hand = np.zeros((3000, 2)), [0.7, -0.3]
    assert (run(none + np.array([0.1, -0.2]), lower=hand, upper=hand) == hand).all()
    run(none, lower=hand, upper=hand)
    np.testing.assert_allclose(run(none), np.tile(hand, (3000, 1)), rtol=1e-9)


@pytest.mark.quick
def test_the_observer_is_the_conditioned_controller_where_its_zeros_are_inside():
    system = StateMatrices.of(control.ss(control.tf([2.0, -1.9], [1, -1], 1e-3)))
    found, compared = sections(system, 1e-3)
    gain, radius = anti_windup(found, compared)
    _, B, _, D = found.matrices
    np.testing.assert_allclose(gain, B / D, rtol=0.02)
    assert radius == pytest.approx(0.95, abs=2e-3)  # its zero
    for seed in range(5):  # zeros anywhere, direct term or none: stable
        model = drive(seed)[1]
        assert anti_windup(*sections(StateMatrices.of(model), model.dt))[1] < 1


@pytest.mark.quick
def test_what_is_no_controller_for_c_is_said(tmp_path):
    pi = control.ss(control.tf([2.0, -1.9], [1, -1], 1e-3))
    row = control.ss([[1.0, 1.0], [0.0, 1.0]], np.eye(2), [[1.0, 0.0]], np.zeros((1, 2)), 1e-3)
    for path, controller, error, sentence in (
        ("a.c", control.ss(control.tf([1], [1, 1])), InputError, "must be discrete"),
        ("a.py", pi, InputError, r"must end in \.c or \.h for a controller in C; got a\.py"),
        ("a.h", rid.datasets, InputTypeError, "must be a ControllerDesign, a control.StateSpace or"),
        ("a.h", row, InputError, "integrators in a row"),
        ("a.h", control.tf([1], np.poly([0.999] * 7), 1e-3), InputError, "would differ by"),
    ):
        with pytest.raises(error, match=sentence):
            write_controller_c(tmp_path / path, controller)
    assert list(tmp_path.iterdir()) == []


@needs_gcc
def test_the_command_writes_controllers_and_models_stay_as_they_were(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rid.save("c.npz", drive(0)[1])
    assert words(["export", "c.npz", "-o", "drive.c"], capsys, monkeypatch)[:2] == (0, "written: drive.c, drive.h")
    built(tmp_path, "drive.c")
    refused(words(["export", "c.npz", "-o", "drive.c"], capsys, monkeypatch), "drive.c exists")
    assert words(["export", "c.npz", "-o", "one file.h", "--controller"], capsys, monkeypatch)[0] == 0
    (tmp_path / "two.c").write_text(
        '#include "one file.h"\nint two(void);\nint two(void) { return ONE_FILE_STATES; }\n'
    )
    (tmp_path / "one.c").write_text('#include "one file.h"\n#include "one file.h"\n')
    built(tmp_path, "one.c", "two.c")
    refused(words(["export", "c.npz", "-o", "c.m", "--controller"], capsys, monkeypatch), "--controller is for C")
    rid.save("plain.h", drive(0)[1])
    assert "sat(" not in (tmp_path / "plain.h").read_text()
