"""Records that are proposed for columns whose names don't say what is what."""

import numpy as np
import pytest

import robustid as rid

COLUMNS = {
    "F1 (N),F2 (N),v1 (m/s),v2 (m/s)": (["F1 (N)", "F2 (N)"], ["v1 (m/s)", "v2 (m/s)"]),
    "F1 (N),F2 (N),v1 (m/s)": (["F1 (N)", "F2 (N)"], "v1 (m/s)"),
    "force (N),a1 (g),a2 (g)": ("force (N)", ["a1 (g)", "a2 (g)"]),
    "ch1,ch2,ch3": ("ch1", "ch2"),
    "torque,w_motor,w_load": ("torque", ["w_motor", "w_load"]),
    "valve1 (%),valve2 (%),flow (l/min),temperature (K)": (
        ["valve1 (%)", "valve2 (%)"],
        ["flow (l/min)", "temperature (K)"],
    ),
}


@pytest.mark.parametrize("names", COLUMNS)
def test_numbered_columns_of_two_kinds_are_inputs_and_outputs(tmp_path, names):
    """Of a gantry the second force was proposed as the output of the first."""
    path, count = tmp_path / "run.csv", names.count(",") + 1
    values = np.column_stack([np.arange(60) * 0.01, np.random.default_rng(0).standard_normal((60, count))])
    np.savetxt(path, values, delimiter=",", header=f"t (s),{names}", comments="", fmt="%.6g")
    fields = rid.look(path).arguments["fields"]
    assert (fields["u"], fields["y"]) == COLUMNS[names]
