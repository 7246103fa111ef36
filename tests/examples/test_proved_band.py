"""The bands of the example hold the plant, and the one over the box is the wider one where it matters."""

import re

import numpy as np
import pytest

from support.example_runs import check_files, load


@pytest.mark.usefixtures("undrawn")
def test_the_bands_hold_the_plant(tmp_path, capsys, monkeypatch):
    example = load("proved_band")
    monkeypatch.setattr(example, "SHOWN_HZ", np.array([0.0, 50.0, 76.5, 77.0, 77.5, 200.0, 500.0]))
    exact, over = example.main(["--out", str(tmp_path)]).values()
    check_files(tmp_path, ["proved_band.png"])
    printed = capsys.readouterr().out
    assert printed.count("the plant is inside") == 2
    assert printed.count("evaluated again: all discs hold") == 2
    assert "NOT ALL" not in printed
    for fitted, low, high, true in re.findall(r"fitted ([\d.]+).* leave ([\d.]+) to ([\d.]+).*true ([\d.]+)", printed):
        assert float(low) < float(fitted) < float(high)
        assert float(low) < float(true) < float(high)
    peak = 3
    assert exact.radius[peak] < over.radius[peak] < 2 * exact.radius[peak]
    # Nothing between the frequency points is left out, nor above them.
    assert over.hinf >= over.upper[peak, 0, 0]
    assert over.hinf < 0.1 * np.abs(over.centre[peak, 0, 0])
