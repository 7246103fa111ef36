"""Logs of simulations and of robots: structures with time, instants since 1970 that scatter, titles with their own separators."""

import h5py
import numpy as np
import pytest
import scipy.io

import robustid as rid
from support.matlab_files import write_text

RNG = np.random.default_rng(7)
COUNT, DT = 400, 0.004
T, U, Y = np.arange(COUNT) * DT, RNG.standard_normal(COUNT), RNG.standard_normal(COUNT)
FIELDS = [("values", object), ("dimensions", object), ("label", object)]


def signals(*rows):
    found = np.empty((1, len(rows)), FIELDS)
    for k, (values, label) in enumerate(rows):
        found[0, k] = values[:, None], 1.0, label
    return found


def in_v5(path, name, rows):
    scipy.io.savemat(path, {name: {"time": T[:, None], "signals": signals(*rows), "blockName": "m/To Workspace"}})


def in_v73(path, name, rows):
    """As MATLAB does: of an array of structures every field is an array of references, without a class of its own."""
    with h5py.File(path, "w", userblock_size=512) as file:
        top, store = file.create_group(name), file.create_group("#refs#")
        inner = top.create_group("signals")
        for group in (top, inner):
            group.attrs["MATLAB_class"] = np.bytes_("struct")
        top.create_dataset("time", data=T[None]).attrs["MATLAB_class"] = np.bytes_("double")
        for field in ("values", "label"):
            items = np.empty((len(rows), 1), h5py.ref_dtype)
            for k, (values, label) in enumerate(rows):
                if field == "label":
                    items[k, 0] = write_text(store, f"{k}{field}", label).ref
                else:
                    data = store.create_dataset(f"{k}{field}", data=values[None])
                    data.attrs["MATLAB_class"] = np.bytes_("double")
                    items[k, 0] = data.ref
            inner.create_dataset(field, data=items, dtype=h5py.ref_dtype)
    with open(path, "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64")


@pytest.mark.parametrize("write", [in_v5, in_v73])
def test_signals_of_a_structure_with_time_have_the_names_of_their_labels(tmp_path, write):
    path = tmp_path / "log.mat"
    write(path, "logs", [(U, "torque"), (Y, "angle")])
    found = rid.look(path)
    assert found.arguments["fields"] == {"time": "time", "u": "torque", "y": "angle"}
    record = rid.load(path, **found.arguments)
    assert np.array_equal(record.u[:, 0], U)
    assert np.array_equal(record.y[:, 0], Y)
    assert record.dt == pytest.approx(DT)


def test_signals_that_were_logged_alone_are_named_by_their_variables(tmp_path):
    path = tmp_path / "log.mat"
    alone = {
        name: {"time": T[:, None], "signals": {"values": v[:, None], "label": ""}} for name, v in (("u", U), ("y", Y))
    }
    scipy.io.savemat(path, alone)
    record = rid.load(path)
    assert np.array_equal(record.y[:, 0], Y)
    assert [record.inputs[0].name, record.outputs[0].name] == ["u", "y"]


@pytest.mark.parametrize(("part", "step"), [(1e-3, 4.0), (1e-6, 4e3), (1e-9, 4e6)])
def test_instants_that_count_parts_of_a_second_since_1970_are_such(tmp_path, part, step):
    """Those of a robot scatter by a two hundredth of a step, by what its computer has to do."""
    late = np.round(2 * RNG.standard_normal(COUNT) * step / 400).clip(-step / 25, step / 25)
    instants = (np.int64(1764500000 / part) + np.arange(COUNT) * int(step) + late).astype(np.int64)
    rows = [f"{t},{u:.6f},{y:.6f}" for t, u, y in zip(instants, U, Y, strict=True)]
    (tmp_path / "log.csv").write_text("\n".join(["%time,/joint/effort,/joint/position", *rows]))
    found = rid.look(tmp_path / "log.csv")
    assert found.arguments["fields"] == {"time": "time", "u": "/joint/effort", "y": "/joint/position"}
    assert rid.load(tmp_path / "log.csv", **found.arguments).dt == pytest.approx(DT, rel=1e-4)


def test_titles_with_separators_above_numbers_between_spaces(tmp_path):
    """A program for loudspeakers writes so."""
    hz = np.geomspace(20.0, 2e4, 60)
    rows = [
        f"{f:.4f} {level:.4f} {phase:.4f}" for f, level, phase in zip(hz, 20 * np.log10(hz), -hz / 200, strict=True)
    ]
    (tmp_path / "box.txt").write_text("\n".join(["* Measured", "* Freq(Hz), SPL(dB), Phase(degrees)", *rows]))
    frf = rid.load(tmp_path / "box.txt")
    assert frf.values[:, 0, 0] == pytest.approx(hz * np.exp(-1j * np.radians(hz / 200)), rel=1e-4)
