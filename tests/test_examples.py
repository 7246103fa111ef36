"""The examples as their users run them, and the claims that they print."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from robustid.data import datasets
from robustid.errors import DatasetNotFoundError

FOLDER = Path(__file__).parent.parent / "examples"


def load(name):
    spec = importlib.util.spec_from_file_location(name, FOLDER / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def check_files(folder, pictures):
    for name in pictures:
        assert (folder / name).read_bytes().startswith(b"\x89PNG")
    assert sorted(p.name for p in folder.glob("*.png")) == sorted(pictures)


def test_flexible_structure(tmp_path, capsys):
    load("flexible_structure").main(["--out", str(tmp_path)])
    stems = ("no_mode", "the_light_mode", "both_modes")
    check_files(tmp_path, [f"{kind}_{stem}.png" for kind in ("response", "residuals") for stem in stems])
    assert "<html" in (tmp_path / "report.html").read_text(encoding="utf-8")[:2000].lower()
    printed = capsys.readouterr().out
    rows = {
        name: line.split()
        for name in ("no mode", "the light mode", "both modes")
        for line in printed.splitlines()
        if line.startswith(name)
    }
    # order after reduction and error of the full model, counted from the end of the row
    orders = {name: int(row[-4]) for name, row in rows.items()}
    errors = {name: float(row[-3]) for name, row in rows.items()}
    assert orders["both modes"] < orders["the light mode"]
    assert 10 * errors["both modes"] < errors["the light mode"] < errors["no mode"]


def test_conditioning(tmp_path, capsys):
    example = load("conditioning")
    example.main(["--out", str(tmp_path)])
    check_files(tmp_path, ["conditioning.png"])
    assert "Lemma 1 is exact" in capsys.readouterr().out
    for count in example.COUNTS:
        for rho in (1.02, 1.1):
            paper, orthonormal = example.conditions(example.roots_of_unity(count), rho)
            np.testing.assert_allclose(paper, rho ** (2 * (count - 1)), rtol=1e-8)
            assert orthonormal - 1 < 1e-12
    assert example.conditions(example.measured_band(40), 1.1)[0] > 1000 * 1.1**78


def test_motor_torsion_without_data_says_where_to_get_them(tmp_path, capsys, monkeypatch):
    monkeypatch.delenv("ROBUSTID_DATA", raising=False)
    load("motor_torsion").main(["--out", str(tmp_path)])
    printed = capsys.readouterr().out
    assert "HoriFujimotoLab/FdiTools" in printed
    assert "ROBUSTID_DATA" in printed
    assert list(tmp_path.iterdir()) == []


@pytest.mark.realdata
def test_motor_torsion(tmp_path, capsys):
    try:
        datasets.find("two_mass/MultisineTypeA.mat")
    except DatasetNotFoundError as missing:
        pytest.skip(str(missing))
    load("motor_torsion").main(["--out", str(tmp_path)])
    check_files(tmp_path, ["response.png", "time.png", "residuals.png"])
    assert (tmp_path / "report.html").exists()
    printed = capsys.readouterr().out
    assert "inconsistent: proved" in printed
    assert "status     consistent" in printed
    assert "FAILED" not in printed
    assert "What can be said: a model of order " in printed
