"""`robustid verify --export` and `--independent`: the proof as a file, and the checker in C beside the package's own checks."""

import json

import numpy as np
import pytest

import robustid as rid
from support import command_line
from support.proof_loops import loop_of
from support.proofs import asked, built, problem

pytestmark = pytest.mark.quick


@pytest.fixture
def saved(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    posed = problem(1)
    rid.identify(posed).save("model")
    omega = posed.frequency[0].omega
    rid.band(posed, omega=np.linspace(omega[0], omega[-1], 4)[1:-1]).save("band")
    return tmp_path


def test_a_proof_is_written_once_and_checked_by_another_program(saved, run, monkeypatch):
    program = built(saved)
    monkeypatch.setenv("ROBUSTID_PROOF", str(program))
    code, out, _ = run(["verify", "band", "--independent", "--export", "proof.json"])
    assert code == 0
    assert "verified   independently, in exact integers: question" in out
    assert out.splitlines()[-2:] == ["checked by this package, and by robustid-proof (independent)", "verified"]
    assert asked(program, (saved / "proof.json").read_text(), saved)[0] == 0
    command_line.refused(run(["verify", "band", "--export", "proof.json"]), "--force")
    code, out, _ = run(["verify", "model", "--independent"])
    assert code == 0
    assert "in exact integers: question" in out
    for given, by in (([], "this package."), (["--independent"], "robustid-proof (independent).")):
        code, out, _ = run(["verify", "band", "--json", *given])
        assert by in json.loads(out)["sentence"]


def test_a_controller_is_checked_by_another_program_with_every_plant_of_its_band(saved, run, monkeypatch):
    monkeypatch.setenv("ROBUSTID_PROOF", str(built(saved)))
    loop_of(5).save("loop")
    code, out, _ = run(["verify", "loop", "--independent", "--export", "proof.json"])
    assert code == 0, out
    assert "in exact integers: question" in out
    assert '"kind": "loop"' in (saved / "proof.json").read_text()


def test_a_checker_that_is_not_there_or_says_no_is_named(saved, run, monkeypatch):
    monkeypatch.setenv("ROBUSTID_PROOF", str(saved / "none"))
    command_line.refused(run(["verify", "model", "--independent"]), "cc -O2 -o robustid-proof")
    liar = saved / "liar"
    for status, said in ((1, "not proved: the discs"), (2, "not readable: nothing")):
        liar.write_text(f"#!/bin/sh\necho question\necho '{said}'\nexit {status}\n")
        liar.chmod(0o755)
        monkeypatch.setenv("ROBUSTID_PROOF", str(liar))
        code, out, err = run(["verify", "model", "--independent"])
        assert code == status
        assert said in out + err
