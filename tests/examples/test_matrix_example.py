"""The example of measured plants with several channels, and what it prints."""

import re

import pytest

from support.example_runs import load
from support.measured import needs


@pytest.mark.slow
@pytest.mark.realdata
@pytest.mark.parametrize(
    ("options", "file"), [([], "beam_ring/symexc_1.mat"), (["--fsm"], "fsm_cubespec/u_300mV_train.npy")]
)
def test_measured_plants(tmp_path, run, options, file):
    needs(file)
    printed = run(load("beam_mimo"), ["response.png", "residuals.png"], *options)
    assert (tmp_path / "report.html").exists()
    assert "status     consistent" in printed
    assert "FAILED" not in printed
    assert ("inconsistent: proved" in printed) == (not options)  # the beam is not linear down to its noise
    table = printed.split("shape of the outputs\n")[1].split("\n\n")[0].splitlines()
    rows = [[float(number) for number in line.split()[:4]] for line in table]
    if not options:
        assert [round(row[0], 1) for row in rows] == [11.2, 22.6, 28.1, 33.2, 58.3, 65.4]
        assert max(row[3] for row in rows) < 0.05  # residues of rank one, almost
    found = re.search(r"at .* Hz \(index .*\); (\d+) outside", printed)
    lines = int(re.search(r"(\d+) frequency points that were not used", printed)[1])
    assert int(found[1]) < 0.02 * lines * (9 if options else 4)
