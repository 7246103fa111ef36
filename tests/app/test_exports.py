"""Files for other programs, each read again by an independent reader: a parser of MATLAB's text, json, gcc, formulas of filters."""

import csv
import ctypes
import json
import re
import shutil
import subprocess

import control
import numpy as np
import pytest
import scipy.io

import robustid as rid
from robustid.errors import InputError

DATA = rid.datasets.flexible_structure()
OMEGA = np.concatenate([np.geomspace(1, 310, 60), DATA.modes[:, 0]])


def random_model(seed, outputs, inputs, modes=4, dt=0.01):
    """Lightly damped modes, a real pole and a feed-through, in coordinates that show none of it."""
    rng = np.random.default_rng(seed)
    A = np.zeros((2 * modes + 1, 2 * modes + 1))
    for k in range(modes):
        pole = np.exp(2j * np.pi * (k + 1) ** 1.7 * 3 * dt - 10.0 ** rng.uniform(-3, -1))
        A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[pole.real, -pole.imag], [pole.imag, pole.real]]
    A[-1, -1] = 0.7
    T = rng.standard_normal(A.shape) + 3 * np.eye(len(A))
    B, C = rng.standard_normal((len(A), inputs)), rng.standard_normal((outputs, len(A)))
    return control.ss(T @ A @ np.linalg.inv(T), T @ B, C @ np.linalg.inv(T), rng.standard_normal((outputs, inputs)), dt)


def response(A, B, C, D, x):
    return np.array([C @ np.linalg.solve(one * np.eye(len(A)) - A, B) + D for one in x])


def same(found, model, omega=OMEGA, tol=1e-12):
    x = np.exp(1j * omega * model.dt) if model.dt else 1j * omega
    wanted = response(*(np.asarray(getattr(model, part)) for part in "ABCD"), x)
    assert np.abs(found(x) - wanted).max() <= tol * np.abs(wanted).max()


def matlab_matrices(text):
    """Matrices of a script: NAME_A = [ ... ];"""
    found = {}
    for name, body in re.findall(r"^(\w+) = \[(.*?)\];", text, re.S | re.M):
        found[name] = np.array([[float(cell) for cell in row.split()] for row in body.split(";")])
    return found


@pytest.mark.parametrize("size", [(1, 1), (2, 3)])
def test_matlab_scripts_and_json_hold_the_same_model(size, tmp_path):
    model = random_model(0, *size)
    rid.save(tmp_path / "stage 2.m", model)
    text = (tmp_path / "stage 2.m").read_text()
    found = matlab_matrices(text)
    same(lambda x: response(*(found[f"stage_2_{part}"] for part in "ABCD"), x), model)
    assert "stage_2 = ss(stage_2_A, stage_2_B, stage_2_C, stage_2_D, 0.01);" in text
    rid.save(tmp_path / "model.json", model)
    read = json.loads((tmp_path / "model.json").read_text())
    same(lambda x: response(*(np.array(read[part]) for part in "ABCD"), x), model)
    assert read["dt"] == 0.01
    rid.save(tmp_path / "model.mat", model)
    stored = scipy.io.loadmat(tmp_path / "model.mat")
    same(lambda x: response(*(stored[part] for part in "ABCD"), x), model)


def test_matlab_scripts_keep_names_and_units_apart(tmp_path):
    named = control.ss(-1.0, [[1.0, 2.0]], 1.0, 0.0, inputs=["force [N]", "ref's current"], outputs=["x [mm]"])
    rid.save(tmp_path / "named.m", named)
    lines = (tmp_path / "named.m").read_text().splitlines()[-4:]
    assert lines == [
        "named.InputName = {'force', 'ref''s current'};",
        "named.InputUnit = {'N', ''};",
        "named.OutputName = {'x'};",
        "named.OutputUnit = {'mm'};",
    ]
    rid.save(tmp_path / "plain.m", control.ss(-1.0, 1.0, 1.0, 0.0))
    assert (tmp_path / "plain.m").read_text().endswith("plain.InputName = {'u[0]'};\nplain.OutputName = {'y[0]'};\n")


def test_an_uncertain_plant_is_written_for_matlab(tmp_path):
    edges, bound = np.array([1.0, 30.0, 100.0, np.pi / 0.01]), np.array([0.01, 0.04, 0.5])
    weight = rid.guarantee.uncertainty_weight(DATA.truth, edges, bound)
    rid.save(tmp_path / "plant.m", weight)
    text = (tmp_path / "plant.m").read_text()
    found = matlab_matrices(text)
    same(lambda x: response(*(found[f"plant_nominal_{part}"] for part in "ABCD"), x), DATA.truth)
    same(lambda x: response(*(found[f"plant_weight_{part}"] for part in "ABCD"), x), weight.model)
    assert "Delta = ultidyn('Delta', [1 1]);" in text
    assert "plant = plant_nominal + plant_weight*Delta;" in text
    with pytest.raises(InputError, match=r"must end in \.m for a UncertaintyWeight"):
        rid.save(tmp_path / "plant.xyz", weight)


def test_sections_and_roots_have_the_response_of_the_model(tmp_path):
    for k, model in enumerate([DATA.truth, random_model(1, 1, 1)]):
        rid.save(tmp_path / f"{k}.sos", model)
        rows = np.loadtxt(tmp_path / f"{k}.sos", ndmin=2)

        def sections(x, rows=rows):
            z = 1 / x[:, None] ** np.arange(3)
            return np.prod((z @ rows[:, :3].T) / (z @ rows[:, 3:].T), axis=1)[:, None, None]

        same(sections, model)
    plant = control.ss([[0, 1, 0], [-900, -0.6, 0], [1, 0, 0]], [[0], [1], [0]], [[2.0, 0.3, 5.0]], 0)
    rid.save(tmp_path / "plant.zpk", plant)
    body = re.search(r"zpk\(\[(.*?)\], \[(.*?)\], (.*?), \"n\"\)", (tmp_path / "plant.zpk").read_text())
    zeros, poles = (
        [complex(root.strip().replace("i*", "1j*").split("1j*")[0] + "0j") if "i*" not in root else _complex(root)
         for root in part.split(";") if root.strip()]
        for part in body.groups()[:2]
    )  # fmt: skip

    def formula(s):
        f = s.imag / (2 * np.pi)
        value = np.full(f.size, float(body[3]), complex)
        for roots, power in ((zeros, 1), (poles, -1)):
            for root in roots:
                value *= (1j * f if root == 0 else 1 + 1j * f / root) ** power
        return value[:, None, None]

    same(formula, plant)
    assert 0 in poles


def _complex(text):
    real, sign, imag = re.fullmatch(r"(.*?\d)([+-])i\*(.*)", text.strip()).groups()
    return complex(float(real), float(sign + imag))


def compiled(header, folder, name, *flags):
    """The step function of a header, compiled with gcc -O2."""
    kind = "float" if flags else "double"
    states, inputs, outputs = (int(re.search(rf"#define \w+_{word} (\d+)", header.read_text())[1])
                               for word in ("STATES", "INPUTS", "OUTPUTS"))  # fmt: skip
    source = folder / "run.c"
    source.write_text(
        f'#include "{header.name}"\n'
        f"void run(const {kind} *u, {kind} *y, int n) {{ {name}_state s = {{{{0}}}}; int k;\n"
        f" for (k = 0; k < n; k++) {name}_step(&s, u + {inputs} * k, y + {outputs} * k); }}\n"
    )
    library = folder / f"lib{kind}.so"
    command = ["gcc", "-O2", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", *flags, str(source), "-o", str(library)]
    subprocess.run(command, check=True, cwd=folder, capture_output=True)
    return ctypes.CDLL(str(library)).run, np.dtype(np.float32 if flags else np.float64), outputs, states


def filtered(run, u):
    call, kind, outputs, _ = run
    u = np.ascontiguousarray(u, dtype=kind)
    y = np.zeros((len(u), outputs), dtype=kind)
    pointer = ctypes.POINTER(ctypes.c_float if kind == np.float32 else ctypes.c_double)
    call(u.ctypes.data_as(pointer), y.ctypes.data_as(pointer), len(u))
    return y


@pytest.mark.skipif(shutil.which("gcc") is None, reason="needs the compiler gcc on the path")
@pytest.mark.parametrize("size", [pytest.param((1, 1), marks=pytest.mark.slow), (2, 3)])
def test_a_c_header_compiled_with_gcc_equals_the_model_on_100000_samples(size, tmp_path):
    model = random_model(2, *size)
    rid.save(tmp_path / "stage.h", model)
    text = (tmp_path / "stage.h").read_text()
    u = np.random.default_rng(0).standard_normal((100_000, size[1]))
    A, B, C, D = (np.asarray(getattr(model, part)) for part in "ABCD")
    x, wanted = np.zeros(len(A)), np.zeros((len(u), size[0]))
    for k, now in enumerate(u):
        wanted[k] = C @ x + D @ now
        x = A @ x + B @ now
    largest = np.abs(wanted).max()
    double = filtered(compiled(tmp_path / "stage.h", tmp_path, "stage"), u)
    assert np.abs(double - wanted).max() <= 1e-11 * largest
    single = filtered(compiled(tmp_path / "stage.h", tmp_path, "stage", "-DSTAGE_SINGLE"), u)
    said = [
        float(word) for word in re.findall(r"by at most ([\d.e+-]+) of it, in single precision by ([\d.e+-]+)", text)[0]
    ]
    assert said[0] < 1e-11
    assert 1e-9 < said[1] < 1e-3
    assert 1e-9 * largest < np.abs(single - wanted).max() <= 100 * said[1] * largest


def test_responses_as_universal_files_and_tables(tmp_path, consistent_error):
    values = np.random.default_rng(0).standard_normal((9, 2, 2, 2)) @ [1, 1j]
    frf = rid.FrequencyResponse(np.arange(1.0, 10.0), values, inputs=["a [N]", "b [N]"], outputs=["x [m]", "y [m]"])
    rid.save(tmp_path / "frf.uff", frf)
    sets = (tmp_path / "frf.uff").read_bytes().split(b"    58b")[1:]
    assert len(sets) == 4
    for k, (i, j) in enumerate(np.ndindex(2, 2)):
        body = sets[k].split(b"\n", 12)[12]  # of a data set 58b: 12 lines of text, then numbers
        numbers = np.frombuffer(body[: 9 * 3 * 8], dtype="<f8").reshape(9, 3)
        assert numbers[:, 0].tolist() == frf.freq_hz.tolist()
        assert (numbers[:, 1] + 1j * numbers[:, 2]).tolist() == values[:, i, j].tolist()
    pyuff = pytest.importorskip("pyuff")
    again = pyuff.UFF(str(tmp_path / "frf.uff")).read_sets()
    assert [(one["func_type"], one["rsp_node"], one["ref_node"]) for one in again] == [
        (4, i + 1, j + 1) for i, j in np.ndindex(2, 2)
    ]
    assert all((one["data"] == values[:, one["rsp_node"] - 1, one["ref_node"] - 1]).all() for one in again)
    assert again[0]["ordinate_axis_units_lab"].strip() == "m"
    assert (rid.load(tmp_path / "frf.uff").values == values).all()
    rid.save(tmp_path / "poles.csv", DATA.truth)
    rows = list(csv.DictReader((tmp_path / "poles.csv").open()))
    np.testing.assert_allclose([float(row["frequency [Hz]"]) for row in rows[::2]], [9.0, 17.67], rtol=1e-9)
    rid.save(tmp_path / "bounds.csv", consistent_error)
    rows = list(csv.DictReader((tmp_path / "bounds.csv").open()))
    assert [float(row["guaranteed error"]) for row in rows] == consistent_error.upper.ravel().tolist()
    rid.save(tmp_path / "verdict.csv", consistent_error.identification)
    told = dict(csv.reader((tmp_path / "verdict.csv").open()))
    assert told["status"].startswith("consistent")
    assert float(told["margin, reached"]) == consistent_error.identification.margin


@pytest.fixture(scope="module")
def consistent_error():
    basis = rid.kautz(DATA.modes[:, 0], DATA.modes[:, 1], dt=0.01, delay=1)
    data = rid.datasets.flexible_structure(lines=5)
    posed = rid.MixedProblem(
        frequency=data.frequency, parametric=basis, prior=rid.Prior(gain_bound=0.2, decay_rate=1.1)
    )
    return rid.worst_case_error(rid.identify(posed), omega=[30.0, 60.0], directions=3)


def test_what_cannot_be_written_is_said(tmp_path):
    continuous = control.ss([[-1.0]], [[1.0]], [[1.0]], 0)
    for name, model, words in (
        ("a.h", continuous, "a C header is of a discrete model"),
        ("a.sos", continuous, "second-order sections are of discrete models"),
        ("a.zpk", DATA.truth, "zeros and poles in Hz are of continuous models"),
        ("a.sos", random_model(0, 2, 2), "one input and one output; this model is 2x2"),
        ("a.xyz", DATA.truth, r"must end in \.npz, \.mat, \.m, \.json, \.h, \.sos, \.zpk, \.csv"),
        (
            "a.h",
            control.ss(np.eye(3) + np.eye(3, k=1), np.ones((3, 1)), np.ones((1, 3)), 0, 1.0),
            "lie so close together",
        ),
    ):
        with pytest.raises(InputError, match=words):
            rid.save(tmp_path / name, model)
    assert list(tmp_path.iterdir()) == []
