"""The lemmas behind proof files: Coq accepts them, and they rest on nothing but the real numbers of its library."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

LEMMAS = Path(__file__).parents[2] / "proof" / "lemmas.v"
REALS = {
    "ClassicalDedekindReals.sig_not_dec",
    "ClassicalDedekindReals.sig_forall_dec",
    "FunctionalExtensionality.functional_extensionality_dep",
    "Classical_Prop.classic",
}
GAPS = (
    r"\b(Axioms?|Parameters?|Conjectures?|Admitted|admit|give_up|Abort|Unset|bypass_check|Require(?! Import Reals))\b"
)


def code() -> str:
    return re.sub(r"\(\*.*?\*\)", "", LEMMAS.read_text(), flags=re.DOTALL)


def test_nothing_is_assumed_outside_a_section() -> None:
    depth = 0
    assert not re.findall(GAPS, code())
    for line in code().splitlines():
        depth += line.startswith("Section ") - line.startswith("End ")
        assert depth or not re.match(r"\s*(Variable|Hypothes[ie]s|Context)", line), line
    assert depth == 0


def test_every_theorem_is_asked_for_its_axioms() -> None:
    asked = re.search(r"Definition proved := \((.*?)\)\.\s*Print Assumptions proved\.\s*\Z", code(), re.DOTALL)
    assert asked
    assert re.findall(r"^Theorem (\w+)", code(), re.MULTILINE) == re.findall(r"@(\w+)", asked[1])


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("coqc") is None, reason="needs the proof assistant Coq: `coqc` on the path")
def test_coq_proves_the_lemmas_from_the_axioms_of_the_reals(tmp_path: Path) -> None:
    source = shutil.copy(LEMMAS, tmp_path)
    done = subprocess.run(["coqc", "-q", source], capture_output=True, text=True, cwd=tmp_path, check=False)
    assert done.returncode == 0, done.stderr
    assert set(re.findall(r"^([\w.]+)\s*:", done.stdout, re.MULTILINE)) == {"Axioms", *REALS}
