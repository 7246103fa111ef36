"""From the file of an instrument to the page by one command: loudspeaker, grid, filter, hammer test, bearing, stage."""

import control
import numpy as np
import pytest

import robustid as rid
from robustid.core import StateMatrices, closed_loop, response_at, simulate
from support import instrument_files as instruments

pytestmark = pytest.mark.slow
RNG = np.random.default_rng(4)


def measured(values):
    """With an error of a part of a hundred, so that its bound can be taken from the scatter."""
    noise = RNG.standard_normal(values.shape) + 1j * RNG.standard_normal(values.shape)
    return values * (1 + 2e-3 * noise / np.sqrt(2))


def woofer(use):
    hz = np.logspace(np.log10(20e3), 1, 200)
    w = 2j * np.pi * hz
    use.setattr(instruments, "HZ", hz)
    use.setattr(instruments, "SPEAKER", measured(6.2 + 4e-4 * w + 600 * w / (w**2 + 20 * w + 350**2)))
    return instruments.zma()


def grid(use):
    hz = np.logspace(np.log10(2000), 0.7, 60)
    w, pole = 2j * np.pi * hz, 2 * np.pi * 400
    peak = w / (w**2 + 0.06 * pole * w + pole**2)
    Z = [[0.4 + 1e-3 * w + 40 * peak, -0.3 - 8 * peak], [0.3 + 8 * peak, 0.45 + 1.1e-3 * w + 38 * peak]]
    use.setattr(instruments, "HZ", hz)
    use.setattr(instruments, "MATRIX", measured(np.stack(Z)))
    return instruments.dq_parts()


def battery(use):
    hz = np.logspace(4, -1, 51)
    w = 2j * np.pi * hz  # an inductance, and two relaxations far apart: modes that a class could hold are none
    use.setattr(instruments, "HZ", hz)
    use.setattr(instruments, "CELL", measured(0.0125 + 2e-7 * w + 0.02 / (1 + 0.05 * w) + 0.004 / (1 + 3e-4 * w)))
    return instruments.ec_lab()


def band_pass(use):
    hz = np.linspace(2.2e9, 2.7e9, 101)
    w, pole = 2j * np.pi * hz, 2 * np.pi * 2.45e9
    through = 0.02 * pole * w / (w**2 + 0.024 * pole * w + pole**2)
    use.setattr(instruments, "HZ_RADIO", hz)
    use.setattr(instruments, "S", measured(np.stack([[1 - through, through], [through, 1 - through]])))
    return instruments.rohde_schwarz()


@pytest.mark.parametrize(
    ("name", "make", "read", "shown"),
    [
        ("peis.mpt", battery, "51 frequency points, 0.1 to 10000 Hz, voltage [V] / current [A], continuous", "[Ω]"),
        ("woofer.zma", woofer, "200 frequency points, 10 to 20000 Hz, voltage [V] / current [A], continuous", "[Ω]"),
        ("grid.csv", grid, "v_d [V], v_q [V] / i_d [A], i_q [A], all of 2 outputs and 2 inputs", "singular value [Ω]"),
        ("filter.csv", band_pass, "101 frequency points, 2200 to 2700 MHz, b2 / a1, continuous", "b2 / a1"),
    ],
)
def test_one_command_leads_to_the_page(files, run, undrawn, monkeypatch, name, make, read, shown):
    (files / name).write_bytes(make(monkeypatch))
    code, out, errors = run(["identify", "--frequency", name, "--report", "page.html"])
    assert code == 0, errors
    assert read in " ".join(out.split())
    assert shown in (files / "page.html").read_text(encoding="utf-8")


def plate():
    """Accelerances of a free plate under a hammer, by H1 over five hits with an exponential window; and their coherence."""
    rate, samples, hz = 2048.0, 4096, (214.3, 312.8, 498.1)
    time, freq = np.arange(samples) / rate, np.fft.rfftfreq(samples, 1 / rate)
    w, rng = 2j * np.pi * freq, np.random.default_rng(11)
    shapes = rng.uniform(-1, 1, (3, 3))
    poles = 2 * np.pi * np.array(hz)
    parts = w**2 / (w**2 + 0.008 * poles[:, None] * w + poles[:, None] ** 2)
    G = 0.5 + np.einsum("ki,k,kf->if", shapes, 2 * shapes[:, 1], parts)
    force, cross, answer = np.zeros(freq.size), np.zeros((3, freq.size), complex), np.zeros((3, freq.size))
    for _ in range(5):
        width = 7e-4 * (1 + 0.1 * rng.standard_normal())
        hit = 300 * np.where((time > 0.01) & (time < 0.01 + width), np.sin(np.pi * (time - 0.01) / width) ** 2, 0)
        X = np.fft.rfft((hit + 0.02 * rng.standard_normal(samples)) * (time < 0.013))
        Y = [np.fft.rfft((np.fft.irfft(one * np.fft.rfft(hit), samples) + 0.1 * rng.standard_normal(samples)) * np.exp(-time / 0.6))
             for one in G]  # fmt: skip
        force += np.abs(X) ** 2
        cross += np.array(Y) * X.conj()
        answer += np.abs(Y) ** 2
    used = (freq >= 20) & (freq <= 800)
    return freq[used], (cross / force).T[used], (np.abs(cross) ** 2 / (force * answer)).T[used], G.T[used]


def test_a_hammer_test_in_a_universal_file_or_in_columns(files, run, undrawn):
    hz, values, coherence, _ = plate()
    (files / "plate.uff").write_bytes(instruments.hammer_test(hz, values, coherence))
    (files / "plate.csv").write_bytes(instruments.accelerance(hz, values[:, 1] / 9.80665, coherence[:, 1]))
    for name, unit in (("plate.uff", "m/s^2/N"), ("plate.csv", "g/N")):
        code, _, errors = run(["identify", "--frequency", name, "-o", name[-3:], "--report", f"{name}.html"])
        assert code == 0, errors
        assert unit in (files / f"{name}.html").read_text(encoding="utf-8")
    found = [rid.load(f"{one}.npz") for one in ("uff", "csv")]
    assert [one.consistent for one in found] == [True, True]
    assert found[0].problem.prior.scaling is not None  # of three responses


def test_a_magnetic_bearing_is_measured_in_its_loop(files, run, undrawn):
    dt, s = 1e-4, control.tf("s")
    rotor = 1e6 * (60 / (2 * s**2 - 2e5) + 12 / (s**2 + 0.008 * 5152 * s + 5152**2)) / (1 + s / 9425)
    plant = control.c2d(control.ss(rotor), dt)
    controller = control.c2d(control.ss(0.008 * (1 + 2e-3 * s) / (1 + 1e-4 * s)), dt, method="bilinear")
    hz = np.logspace(1, np.log10(4000), 201)
    values = response_at(StateMatrices.of(control.feedback(plant, controller)), np.exp(2j * np.pi * hz * dt))[:, 0, 0]
    (files / "bearing.csv").write_bytes(instruments.gain_and_phase(hz, measured(values)))
    rid.save(files / "controller.npz", controller)
    asked = ["identify", "--frequency", "bearing.csv", "--loop", "controller.npz", "--report", "page.html"]
    code, _, errors = run(asked)
    assert (code, "dt=0.0001" in errors) == (2, True)  # it has no sample time, and the loop has one
    code, out, errors = run([*asked, "--dt", str(dt)])
    assert code == 0, errors
    assert "Stable with every consistent plant" in (files / "page.html").read_text(encoding="utf-8")
    between = np.exp(2j * np.pi * np.linspace(1, 4999, 20000) * dt)  # the mode is narrower than the steps of the sweep
    loop = plant(between) * controller(between)  # each by itself: the states of the product are scaled too badly
    true = 1 / (1 + loop)
    said = float(out.split("sensitivity is at most")[1].split()[0])
    assert np.abs(true).max() < said < 1.01 * np.abs(true).max()  # of zone A, as the machine is


def test_a_stage_that_is_free_to_move_is_given_its_integrators(files, run, undrawn):
    dt, s, rng = 2e-4, control.tf("s"), np.random.default_rng(7)
    modes = 0.3 / (12 * (s**2 + 31.3 * s + 1954**2)) - 0.6 / (12 * (s**2 + 10.3 * s + 860.8**2))
    plant, bandwidth = control.c2d(control.ss(1e6 * (1 / (12 * s**2) + modes)), dt), 157.0
    lead = (1 + 3 * s / bandwidth) / (1 + s / (3 * bandwidth)) / (1 + s / (12 * bandwidth))
    controller = control.c2d(control.ss(4e-6 * bandwidth**2 * lead), dt, "tustin")
    spectrum = np.zeros(2501, complex)
    spectrum[3:2000:3] = np.exp(2j * np.pi * rng.random(666))  # every third line: it repeats between two samples
    r = np.tile(np.fft.irfft(spectrum, 5000), 8)
    r *= 20 / r.std()
    signals = np.column_stack([r, 2e-4 * rng.standard_normal(r.size)])
    found = simulate(closed_loop(StateMatrices.of(plant), StateMatrices.of(controller)), signals)[0]
    (files / "stage.csv").write_bytes(instruments.motion_record(dt, r, found[:, 0], found[:, 1].round(4)))
    fields = {"time": "time [s]", "u": "force [N]", "y": "position [um]", "reference": "excitation [N]"}
    assert any(fault.size == 5000 for fault in rid.look("stage.csv", fields=fields).faults)
    named = [part for role in ("u=force", "y=position", "reference=excitation") for part in ("--time-field", role)]
    assert run(["frf", "stage.csv", *named, "--period", "5000", "-o", "frf.npz"])[0] == 0
    code, _, errors = run(["identify", "--frequency", "frf.npz", "-o", "model", "--report", "page.html"])
    assert code == 0, errors
    model = rid.load("model.npz")
    assert model.problem.parametric.has_integrator
    assert "um/N" in (files / "page.html").read_text(encoding="utf-8")
