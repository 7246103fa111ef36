"""From the file of an instrument to the page by one command: a loudspeaker, a grid, a filter."""

import numpy as np
import pytest

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
