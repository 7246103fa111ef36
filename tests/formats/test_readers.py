"""Damaged and hostile files of every format: a sentence or valid data, never a foreign traceback, a hang or a huge allocation."""

import itertools
import json
import os
import struct
import subprocess
import sys
import zipfile
import zlib

import h5py
import numpy as np
import pytest
import scipy.io
import scipy.sparse

from robustid import load
from robustid.data import FrequencyResponse, TimeRecord, save
from robustid.errors import FileFormatError, InputError, RobustIdError
from robustid.formats.matlab import read_matlab4
from support.data_files import full_frf, full_record
from support.exchange_files import TIME, S, matrix, signal, touchstone
from support.exchange_files import write as write_universal
from support.foreign_files import Function, uff58
from support.instrument_files import diagnostics, ec_lab, gamry
from support.matlab_files import FRD, write5, write73
from support.matlab_objects import Thing, write_objects
from support.mimo_data import same

SAMPLES = len(TIME)


def plain_hdf5(path):
    with h5py.File(path, "w") as file:
        file.attrs["dt"] = 0.5
        file.create_dataset("u", data=np.arange(40.0), compression="gzip")
        file["y"] = np.arange(40.0)


def german(path):
    """Semicolons, decimal commas, units in a line of their own, letters of Latin-1."""
    numbers = "".join(f"{k},5;-{k},25;{10 * k},125\n" for k in range(1, 30))
    path.write_bytes(f"Pr\xfcfstand 3\nFrequenz;Betrag;Phase\nHz;dB;\xb0\n{numbers}".encode("latin-1"))


FORTY = {"u": np.arange(40.0), "y": np.arange(40.0), "dt": 1.0}
ZEROS = {"u": np.zeros(400), "y": np.zeros(400), "dt": 1.0}
LISTED = Function(4, (1, 3), (1, 3), 1.0, 0.5, np.arange(20) + 1j)
PLAIN = {"Response": FRD["ResponseData"], "Frequency": FRD["Frequency"], "FreqUnits": "Hz"}
FORMATS = {
    "axes.npy": lambda p: np.save(p, np.arange(240.0).reshape(20, 2, 3, 2)),
    "german.txt": german,
    "listed.uff": lambda p: uff58(p, [LISTED, LISTED]),
    "plain.npy": lambda p: np.save(p, np.arange(80.0).reshape(40, 2)),
    "frf.npz": lambda p: save(p, full_frf()),
    "record.npz": lambda p: save(p, full_record()),
    "small.npz": lambda p: np.savez_compressed(p, **ZEROS),
    "frf.csv": lambda p: save(p, full_frf()),
    "record.csv": lambda p: save(p, full_record()),
    "frf.mat": lambda p: save(p, full_frf()),
    "small.mat": lambda p: scipy.io.savemat(p, ZEROS, do_compression=True),
    "struct.mat": lambda p: write5(p, FRD),
    "struct73.mat": lambda p: write73(p, FRD),
    "plain73.mat": lambda p: write73(p, FORTY, ""),
    "old.mat": lambda p: scipy.io.savemat(p, FORTY, format="4"),
    "plain.h5": plain_hdf5,
    "frf.uff": lambda p: write_universal(p, matrix()),
    "binary.uff": lambda p: write_universal(p, [signal(1, 12, binary=1), signal(2, 13, binary=1)]),
    "net.s2p": lambda p: touchstone(p, S, "GHz", "db"),
    "peis.mpt": lambda p: p.write_bytes(ec_lab()),
    "EISPOT.DTA": lambda p: p.write_bytes(gamry()),
    "sweep.xml": lambda p: p.write_bytes(diagnostics()),
    "objects.mat": lambda p: write_objects(p, {"G": Thing("frd", {"Data_": Thing("ltipack.frddata", PLAIN)})}),
}
GIVEN = {
    "plain.npy": {"fields": {"u": "[:,0]", "y": "[:,1]"}, "dt": 0.5},
    "axes.npy": {"fields": {"u": "[:]", "y": "[:]"}, "axes": "time,signal,realisation,period", "dt": 0.5},
    "german.txt": {"fields": {"omega": "Frequenz [Hz]", "magnitude_db": "Betrag [dB]", "phase_deg": "Phase [°]"}},
    "listed.uff": {"fields": {"freq_hz": "2.x", "values": "2.y"}},
}
LEAST_REFUSED = {".s2p": 20, ".txt": 20, ".mpt": 20, ".DTA": 30}  # whole lines are a shorter file


def outcome(path):
    """Valid data or one of our sentences; anything else goes through."""
    try:
        data = load(path, **GIVEN.get(path.name, {}))
    except RobustIdError as error:
        said = str(error)
    else:
        assert isinstance(data[0] if isinstance(data, list) else data, FrequencyResponse | TimeRecord)
        return data
    assert 20 < len(said) < 3000
    return None


@pytest.mark.parametrize("count", [10, pytest.param(200, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", FORMATS)
def test_damaged_files(tmp_path, name, count):
    """Cut at 40 places; of the damages three quarters flipped bytes, the others stretches of zeros or of 0xff: seeded, most of them
    in the first kilobyte.
    """
    path, rng = tmp_path / name, np.random.default_rng(sum(name.encode()))
    FORMATS[name](path)
    content, whole = path.read_bytes(), outcome(path)
    assert whole is not None
    refused = 0
    for size in np.linspace(0, len(content) - 1, 40).astype(int):
        path.write_bytes(content[:size])
        again = outcome(path)
        refused += again is None
        if again is not None and path.suffix not in LEAST_REFUSED and not isinstance(again, list):
            same(again, whole)  # never other data
    assert refused >= LEAST_REFUSED.get(path.suffix, 35)
    near = min(len(content), 1024)
    for k in range(count):
        damaged = bytearray(content)
        at = int(rng.integers(near if k % 3 else len(content)))
        if k < 3 * count // 4:
            damaged[at] ^= int(rng.integers(1, 256))
        else:
            damaged[at : at + 8] = (b"\xff" if k % 2 else b"\0") * len(damaged[at : at + 8])
        path.write_bytes(damaged)
        outcome(path)


@pytest.mark.parametrize("name", ["frf.npz", "frf.csv", "frf.mat"])
def test_hostile_descriptions(tmp_path, name):
    """Every value of the description that `save` wrote, replaced by what it shouldn't be."""
    save(tmp_path / name, full_frf())
    meta = description(tmp_path / name)
    values = [None, -1, 1e300, 10**30, "x", [], {}, [[]], [10**9], [-5, -5], [10**9] * 3, {"omega": [10**12]}, True]
    for key, value in itertools.product(meta, values):
        with_description(tmp_path / name, {**meta, key: value})
        outcome(tmp_path / name)
    for value in (10**9, -1, "x", None, [1] * 200, [10**9] * 20):
        with_description(tmp_path / name, {**meta, "shapes": {**meta["shapes"], "values": value}})
        outcome(tmp_path / name)
    with_description(tmp_path / name, "[" * 100_000)
    assert outcome(tmp_path / name) is None


def description(path):
    if path.suffix == ".npz":
        return json.loads(str(np.load(path)["robustid"]))
    if path.suffix == ".csv":
        return json.loads(path.read_text().splitlines()[0].removeprefix("# robustid "))
    return json.loads(str(scipy.io.loadmat(path)["robustid"][0]))


def with_description(path, meta):
    text = meta if isinstance(meta, str) else json.dumps(meta)
    if path.suffix == ".npz":
        np.savez(path, **{**np.load(path), "robustid": np.array(text)})
    elif path.suffix == ".csv":
        path.write_text("\n".join([f"# robustid {text}", *path.read_text().splitlines()[1:]]))
    else:
        content = {name: value for name, value in scipy.io.loadmat(path).items() if not name.startswith("__")}
        scipy.io.savemat(path, {**content, "robustid": text})


# --- sizes that are declared and not there


def vast_npz(path):
    """The header of an array claims 8 TB."""
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }"
    header += b" " * (64 - (len(header) + 11) % 64) + b"\n"
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("u.npy", b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + bytes(64))


def bomb_npz(path):
    """1.2 GB of zeros in 5 MB."""
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as file,
        file.open("u.npy", "w", force_zip64=True) as item,
    ):
        np.lib.format.write_array_header_1_0(item, {"descr": "<f8", "fortran_order": False, "shape": (9 * 2**24,)})
        for _ in range(9 * 2**7):
            item.write(bytes(2**20))


def vast_mat(path):
    scipy.io.savemat(path, {"u": np.arange(20.0)})
    content = bytearray(path.read_bytes())
    content[132:136] = struct.pack("<I", 4_000_000_000)
    path.write_bytes(content)


def vast_compressed_mat(path):
    inner = zlib.compress(struct.pack("<II", 14, 4_000_000_000) + bytes(200))
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + struct.pack("<II", 15, len(inner)) + inner)


def vast_hdf5(path):
    with h5py.File(path, "w") as file:
        file.create_dataset("u", shape=(10**12,), dtype=float, chunks=(1024,))


def vast_npy(path):
    np.save(path, np.zeros(64))
    path.write_bytes(path.read_bytes().replace(b"(64,), }            ", b"(64000000000000,), }"))


VAST = {
    "vast.npy": vast_npy,
    "vast4.mat": lambda path: path.write_bytes(struct.pack("<5i", 0, 2**31 - 1, 2**31 - 1, 0, 2) + b"u\0"),
    "vast.npz": vast_npz,
    "bomb.npz": bomb_npz,
    "vast.mat": vast_mat,
    "squeezed.mat": vast_compressed_mat,
    "vast.h5": vast_hdf5,
}


@pytest.mark.parametrize("name", [pytest.param(k, marks=pytest.mark.slow) if k == "bomb.npz" else k for k in VAST])
def test_declared_sizes_are_refused_before_anything_is_allocated(tmp_path, name):
    VAST[name](tmp_path / name)
    with pytest.raises(FileFormatError, match="declares"):
        load(tmp_path / name)


def test_matrices_before_v5_are_those_that_scipy_reads(tmp_path):
    """Every kind of number, complex too, beside a text and a sparse matrix; and with the bytes in the other order."""
    content = {name: np.arange(6.0).reshape(2, 3).astype(name) for name in ("f8", "f4", "i4", "i2", "u2", "u1")}
    content |= {"z": np.array([[1 + 2j, 3 - 4j]]), "note": "text", "s": scipy.sparse.csc_array(np.eye(3)), "dt": 0.1}
    scipy.io.savemat(tmp_path / "all.mat", content, format="4")
    expected, found = scipy.io.loadmat(tmp_path / "all.mat"), read_matlab4(tmp_path / "all.mat").columns
    assert set(found) == set(content) - {"note", "s"}
    for name, values in found.items():
        np.testing.assert_array_equal(values, expected[name])
        assert values.dtype == expected[name].dtype.newbyteorder("=")
    turned = struct.pack(">5i", 1000, 2, 1, 1, 2) + b"x\0" + np.array([1.0, 2.0, 3.0, 4.0], ">f8").tobytes()
    (tmp_path / "turned.mat").write_bytes(turned)
    np.testing.assert_array_equal(read_matlab4(tmp_path / "turned.mat").columns["x"], [[1 + 3j], [2 + 4j]])


def test_a_line_without_end_is_refused(tmp_path):
    path = tmp_path / "line.csv"
    path.write_text("time,u,y\n" + "1" * 2**24)
    with pytest.raises(FileFormatError, match="line 2 is longer than 16777216 characters"):
        load(path)


@pytest.mark.parametrize("suffix", [".csv", ".npz", ".mat", ".h5"])
def test_gaps_are_found_with_their_place(tmp_path, suffix):
    path, y = tmp_path / f"gap{suffix}", np.arange(10.0)
    y[[3, 7]] = np.nan
    columns = {"time": np.arange(10.0), "u": np.arange(10.0), "y": y}
    if suffix == ".csv":
        np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
    elif suffix == ".npz":
        np.savez(path, **columns)
    elif suffix == ".mat":
        scipy.io.savemat(path, columns)
    else:
        with h5py.File(path, "w") as file:
            file.update(columns)
    with pytest.raises(InputError, match=r"'y' has no value in 2 of 10 samples, the first is sample 3"):
        load(path)


_LONG = """
import resource, sys
import numpy as np
from robustid import TimeRecord, load
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
record = load(sys.argv[1])
after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
print(record.u.shape[0], record.y.sum(), (after - before) / 1024)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="memory of a process as Linux counts it")
@pytest.mark.parametrize("suffix", [".csv", *(pytest.param(one, marks=pytest.mark.slow) for one in (".npz", ".mat"))])
def test_memory_of_a_long_record_is_a_few_times_its_numbers(tmp_path, suffix):
    """100 000 samples of 4 channels are 3.2 MB: five times in memory at most 30 MB, text with lists of cells took 150."""
    rng, samples = np.random.default_rng(0), 100_000
    data = TimeRecord(rng.standard_normal((samples, 2)), rng.standard_normal((samples, 2)).round(3), dt=0.5)
    save(tmp_path / f"long{suffix}", data)
    command = [sys.executable, "-c", _LONG, str(tmp_path / f"long{suffix}")]
    printed = subprocess.run(command, check=True, capture_output=True, text=True, env=os.environ).stdout.split()
    assert int(printed[0]) == samples
    assert float(printed[1]) == pytest.approx(data.y.sum(), rel=1e-9)
    assert float(printed[2]) < 60
