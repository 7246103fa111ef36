"""Writing a page: what belongs to which result, and what a failure leaves."""

from __future__ import annotations

from typing import Any

import pytest

import robustid as rid
from robustid.report import plot, write_report

pytestmark = pytest.mark.quick


def test_a_failing_write_leaves_the_old_file(simple: rid.Identification, tmp_path: Any, monkeypatch: Any) -> None:
    path = tmp_path / "report.html"
    path.write_text("old")
    with pytest.raises(rid.InputError, match="models"):
        write_report(simple, path, models={"late": rid.flexible_structure().truth})  # another dt
    assert path.read_text() == "old"

    def interrupted(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("os.replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_report(simple, path)
    monkeypatch.undo()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
    write_report(simple, path)
    assert "Inconsistent" in path.read_text()


def test_misuse_is_named(simple: rid.Identification, consistent: rid.Identification, tmp_path: Any) -> None:
    import control

    with pytest.raises(rid.errors.InputTypeError, match="`models` must map names"):
        plot.poles(simple, models=[consistent.model])  # type: ignore[arg-type]
    with pytest.raises(rid.errors.InputTypeError, match="names"):
        plot.poles(simple, models={1: consistent.model})  # type: ignore[dict-item]
    with pytest.raises(rid.errors.InputTypeError, match=r"models\['a'\].*StateSpace"):
        plot.residuals(simple, models={"a": control.tf(1, [1, 0.5], 0.1)})
    with pytest.raises(rid.InputError, match="1 output and 1 input"):
        plot.time_response(simple, models={"a": control.ss(0.5, [[1, 1]], 1, 0, 0.1)})
    with pytest.raises(rid.InputError, match=r"dt = 0.1 s.*control\.sample_system"):
        plot.bode(simple, models={"a": control.ss(-1.0, 1, 1, 0)})
    with pytest.raises(rid.errors.InputTypeError, match="`title` must be text"):
        write_report(simple, tmp_path / "a.html", title=3)  # type: ignore[arg-type]
    with pytest.raises(
        rid.errors.InputTypeError,
        match="`identification` must be of class Identification, Matrix",
    ):
        write_report(simple.model, tmp_path / "a.html")
    with pytest.raises(rid.InputError, match="folder"):
        write_report(simple, tmp_path)
    assert list(tmp_path.iterdir()) == []
