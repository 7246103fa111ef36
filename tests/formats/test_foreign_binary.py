"""Arrays in binary files as other programs write them: read right, or refused with the arguments that then read them right."""

import h5py
import numpy as np
import pytest

from robustid import load
from robustid.app.run.reading import in_options, in_run_file
from robustid.errors import InputError
from robustid.formats import datasets
from support.foreign_files import (
    DT,
    HZ,
    Function,
    G,
    U,
    Y,
    followed,
    matlab4,
    matlab5,
    npy,
    same_record,
    same_response,
    uff58,
)
from support.matlab_files import write73

pytestmark = pytest.mark.quick

T = DT * np.arange(8)
COLUMNS = np.column_stack([U, Y])
# More samples than signals by far, as a matrix of signals has.
LONG = np.random.default_rng(11).standard_normal((40, 3, 2, 2))
EVEN = np.arange(1.0, 9.0)


def same_even(frf):
    np.testing.assert_array_equal(frf.values[:, 0, 0], G)
    np.testing.assert_allclose(frf.freq_hz, EVEN, rtol=1e-14)


def hdf5(path):
    with h5py.File(path, "w") as file:
        file.attrs["fs"] = 1 / DT
        file["run/drive"], file["run/sensor"] = U, Y
        file["run/drive"].attrs["units"] = "V"


def universal(*functions, **options):
    return lambda path: uff58(path, functions, **options)


def frequencies(node, values, **changes):
    return Function(4, (node, 3), (1, 3), 1.0, 1.0, values, **changes)


def signal(node, values, **changes):
    return Function(1, (node, 1), (0, 0), 0.0, DT, values, **changes)


IDDATA = {"OutputData": Y[:, None], "InputData": U[:, None], "Ts": DT, "TimeUnit": "seconds"}


def one_first(records):
    assert len(records) == 2
    np.testing.assert_array_equal(records[1].y, np.concatenate([LONG[:, :, 1, 0], LONG[:, :, 1, 1]]))
    assert (records[0].initial, records[0].dt) == ("periodic", 1.0)


def both(values):
    return lambda record: np.testing.assert_array_equal(np.column_stack([record.u, record.y]), values)


CASES = {
    "rig.npy": (lambda p: npy(p, np.tile(COLUMNS, (2, 1))), {"fields": {"u": "[:,0]", "y": "[:,1]"}, "dt": 1.0},
                both(np.tile(COLUMNS, (2, 1)))),
    "fortran.npy": (lambda p: npy(p, LONG[:, :2, 0, 0].copy(), fortran=True),
                    {"fields": {"u": "[:,0]", "y": "[:,1]"}, "dt": 1.0}, both(LONG[:, :2, 0, 0])),
    "u_runs.npy": (lambda p: (npy(p, LONG), npy(p.with_name("y_runs.npy"), LONG)),
                   {"fields": {"u": "[:]", "y": "y_runs.npy"}, "axes": "time,signal,realisation,period", "dt": 1.0}, one_first),
    "response.npy": (lambda p: npy(p, G),
                     {"fields": {"values": "[:]"}, "start": 1.0, "step": 1.0, "frequency_unit": "Hz"}, same_even),
    "structured.npy": (lambda p: np.save(p, np.rec.fromarrays([T, U, Y], names="t,u,y")), {}, same_record),
    "rate.npz": (lambda p: np.savez(p, input=U, output=Y, fs=1 / DT), {}, same_record),
    "matrix.npz": (lambda p: np.savez(p, x=LONG[:, :, 0, 0]),
                   {"fields": {"u": "x[:,0]", "y": "x[:,1]"}, "dt": 1.0}, both(LONG[:, :2, 0, 0])),
    "matrix.mat": (lambda p: matlab5(p, {"rig": LONG[:, :2, 0, 0]}),
                   {"fields": {"u": "rig[:,0]", "y": "rig[:,1]"}, "dt": 1.0}, both(LONG[:, :2, 0, 0])),
    "rows.mat": (lambda p: matlab5(p, {"rig": LONG[:, :2, 0, 0].T}),
                 {"fields": {"u": "rig[0,:]", "y": "rig[1,:]"}, "dt": 1.0}, both(LONG[:, :2, 0, 0])),
    "signals first.mat": (lambda p: matlab5(p, {"u": U, "y": np.stack([Y] * 3), "dt": DT}), {"axes": "signal,time"}, same_record),
    "four.mat": (lambda p: matlab4(p, {"rig": LONG[:, :2, 0, 0]}),
                 {"fields": {"u": "rig[:,0]", "y": "rig[:,1]"}, "dt": 1.0}, both(LONG[:, :2, 0, 0])),
    "seven.mat": (lambda p: write73(p, {"rig": LONG[:, :2, 0, 0]}, ""),
                  {"fields": {"u": "rig[:,0]", "y": "rig[:,1]"}, "dt": 1.0}, both(LONG[:, :2, 0, 0])),
    "values.mat": (lambda p: matlab5(p, {"inputvalues": U[:, None], "outputvalues": Y[:, None], "times": T}), {}, same_record),
    "struct.mat": (lambda p: matlab5(p, {"d": {"u": U[:, None], "y": Y[:, None], "Ts": DT}}),
                   {}, same_record),
    "iddata.mat": (lambda p: matlab5(p, {"s": IDDATA}), {}, same_record),
    "times.mat": (lambda p: matlab5(p, {"t": T, "force": U, "acc": Y}),
                  {"fields": {"time": "t", "u": "force", "y": "acc"}}, same_record),
    "complex.mat": (lambda p: matlab4(p, {"omega": 2 * np.pi * HZ, "G": G}), {}, same_response),
    "axes.mat": (lambda p: write73(p, {"G": np.stack([G, 2 * G])[:, None], "omega": 2 * np.pi * HZ}, ""),
                 {"axes": "output,input,frequency"}, same_response),
    "groups.h5": (hdf5, {"fields": {"u": "run.drive [V]", "y": "run.sensor"}}, same_record),
    "ascii.uff": (universal(frequencies(1, G)), {}, same_even),
    "binary.unv": (universal(frequencies(1, G), binary=True), {}, same_even),
    "listed.uff": (universal(frequencies(1, G), frequencies(1, 2 * G)), {"fields": {"freq_hz": "1.x", "values": "1.y"}}, same_even),
    "force.uff": (universal(signal(1, U, quantity=13), signal(2, Y)), {}, same_record),
    "signals.uff": (universal(signal(1, U, quantity=0), signal(2, Y, quantity=0), binary=True),
                    {"fields": {"time": "time", "u": "1X+", "y": "2X+"}}, same_record),
    "runs.uff": (universal(signal(1, U), signal(1, Y)), {"fields": {"time": "1.x", "u": "1.y", "y": "2.y"}}, same_record),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_foreign_binary_files(tmp_path, name):
    if name.endswith((".uff", ".unv")):
        pytest.importorskip("pyuff")
    write, options, check = CASES[name]
    write(tmp_path / name)
    check(followed(tmp_path / name, options))


CD = [f"cdplayer[:,{k}]" for k in range(4)]
AXES = "time,signal,realisation,period"
MEASURED = [
    ("daisy/hairdryer.mat", "hairdryer", {"fields": {"u": "hairdryer[:,0]", "y": "hairdryer[:,1]"}, "dt": 1.0}),
    ("daisy/cdplayer.mat", "cdplayer", {"fields": {"u": CD[:2], "y": CD[2:]}, "dt": 1.0}),
    (
        "fsm_cubespec/u_300mV_test.npy",
        "fsm/test",
        {"fields": {"u": "[:]", "y": "y_300mV_test.npy"}, "axes": AXES, "dt": 1.0},
    ),
    ("two_mass/MultisineTypeA.mat", None, {"fields": {"time": "time", "u": "iq_adx", "y": "iq_refx"}}),
    ("beam_ring/symexc_1.mat", None, {"dt": 0.001}),
]


@pytest.mark.realdata
@pytest.mark.parametrize(("name", "known", "options"), MEASURED)
def test_measured_files_lead_to_the_arguments_that_read_them(name, known, options):
    found = followed(datasets.fetch(name), options)
    if known:
        known = datasets.load(known)
        pairs = zip(found, known, strict=True) if isinstance(known, list) else [(found, known)]
        for mine, theirs in pairs:
            np.testing.assert_array_equal(mine.u, theirs.u)
            np.testing.assert_array_equal(mine.y, theirs.y)
    else:
        assert found.u.shape[0] in (50_000, 120_001)


def test_sentences_are_written_for_the_one_who_reads_them(tmp_path):
    """The line of a refusal as options of the command line, and as keys of a run file."""
    matlab5(tmp_path / "rig.mat", {"rig": LONG[:, :2, 0, 0]})
    with pytest.raises(InputError) as refused:
        load(tmp_path / "rig.mat")
    options = refused.value.said({}, lambda remedy: in_options(remedy, "time"))
    assert "--time-field 'u=rig[:,0]' --time-field 'y=rig[:,1]' --dt 1.0" in options
    assert '`fields = { u = "rig[:,0]", y = "rig[:,1]" }; dt = 1.0`' in refused.value.said({}, in_run_file)
