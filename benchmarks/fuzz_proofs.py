"""Feed the checker of proofs with broken files: it must never crash, nor accept what fractions do not confirm.

    python benchmarks/fuzz_proofs.py COUNT [SEED [EVERY]]

Several changes at once, in a build with the sanitizers of addresses and undefined behaviour (`fuzz_proofs.c`, which makes the
files and includes the checker). Every accepted file that was not met before goes to the judge in exact fractions; with EVERY
one of so many does, since the judge takes three quarters of the time.
"""

from __future__ import annotations

import hashlib
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import IO, cast

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import robustid as rid
from robustid.guarantees import proof_text
from support.proof_judge import judged
from support.proof_kinds import first_of, proofs_in_continuous_time, proofs_over_boxes
from support.proof_loops import by_hand, polynomials, small_proofs
from support.proofs import SANITIZED, problem

SOURCE = Path(__file__).with_suffix(".c")
_SMALL = 40_000
WATCHED = {"ASAN_OPTIONS": "detect_leaks=0:quarantine_size_mb=4:allocator_may_return_null=1:hard_rss_limit_mb=2000"}


def proofs() -> list[str]:
    """Small proofs of every kind, with records and without."""
    # The last one is false: 1 - 4/z + 4/z^2 + F/20 has two zeros outside of the circle, which only the turns around 0 show.
    texts = [*small_proofs(), by_hand("loop", polynomials([1, -4, 4], [0.05, 0, 0], [1, -0.5, 0]), 9.0, gain=0.5)]
    for seed in (1, 2):
        for samples in (0, 2):
            texts.append(proof_text(rid.identify(problem(seed, 2, off=3.0, samples=samples))))
            found = rid.identify(problem(seed, 2, samples=samples))
            omega = found.problem.frequency[0].omega[1:]
            bounds = rid.worst_case_error(found, omega=1.01 * omega, directions=3)
            texts += [proof_text(found), first_of(proof_text(bounds)), proof_text(rid.band(found.problem, omega=omega))]
    # Boxes of poles and continuous time: small files, so that most changes touch what is new in them.
    more = [*proofs_over_boxes(1), *proofs_in_continuous_time(1)]
    return texts + [one for one in more if len(one) < _SMALL]


def main(count: int, seed: int = 0, every: int = 1) -> int:
    """Print how many files were tried, by the answer, and how many of those accepted are true; keep those that are not."""
    began, met, true, wrong = time.monotonic(), set[bytes](), 0, 0
    with tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as name:
        program, paths = Path(name) / "fuzz", []
        subprocess.run(["cc", "-std=gnu11", *SANITIZED, "-o", str(program), str(SOURCE), "-lgmp"], check=True)
        for k, text in enumerate(proofs()):
            paths.append(Path(name) / f"{k}.json")
            paths[-1].write_text(text)
        asked = [str(program), str(count), str(seed), *map(str, paths)]
        with subprocess.Popen(asked, stdout=subprocess.PIPE, env=WATCHED) as running:
            stream = cast(IO[bytes], running.stdout)
            while (line := stream.readline().split()) and line[0] == b"a":
                text = stream.read(int(line[1]))
                key = hashlib.sha256(text).digest()
                if key in met:
                    continue
                met.add(key)
                if len(met) % every:
                    continue
                if judged(text.decode("latin-1")):
                    true += 1
                else:
                    wrong += 1
                    Path(f"fuzz_proofs_accepted_{wrong}.json").write_bytes(text)
    if running.returncode:
        return running.returncode
    proved, refused, unreadable, twice, slowest, memory = map(int, line[1:])
    print(f"{count} files: {proved} proved, {refused} not proved, {unreadable} not readable; no crash")
    print(f"{len(met)} different files proved, {true + wrong} of them judged: {true} true in fractions, {wrong} not")
    print(f"{twice} files read in a process of their own: the same answers")
    took = time.monotonic() - began
    print(f"longest file {slowest / 1e6:.2f} s, memory of a batch at most {memory / 1024:.0f} MB; {took:.0f} s")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:4])))
