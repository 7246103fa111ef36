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
    "v_d,v_q,i_d,i_q": (["v_d", "v_q"], ["i_d", "i_q"]),
    "angle (rad),torque (Nm)": ("torque (Nm)", "angle (rad)"),
    "x1,x2,F1 (N),F2 (N)": (["F1 (N)", "F2 (N)"], ["x1", "x2"]),
    "position,motor_current": ("motor_current", "position"),
}
LOOPS = {
    "reference,current (A),gap (mm)": ("reference", "current (A)", "gap (mm)"),
    "pos_ref,pos,torque": ("pos_ref", "torque", "pos"),
    "x desired,y desired,Fx (N),Fy (N),x (m),y (m)": (
        ["x desired", "y desired"],
        ["Fx (N)", "Fy (N)"],
        ["x (m)", "y (m)"],
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


@pytest.mark.parametrize("names", LOOPS)
def test_what_is_wanted_of_a_machine_is_the_reference_of_its_loop(tmp_path, names):
    """The reference was proposed as the input of the current, without the gap."""
    path, count = tmp_path / "run.csv", names.count(",") + 1
    values = np.column_stack([np.arange(60) * 0.01, np.random.default_rng(0).standard_normal((60, count))])
    np.savetxt(path, values, delimiter=",", header=f"t (s),{names}", comments="", fmt="%.6g")
    fields = rid.look(path).arguments["fields"]
    assert (fields["reference"], fields["u"], fields["y"]) == LOOPS[names]
