"""Feed the checker of proofs with broken files until a time is over: it must never crash, nor accept what fractions do not confirm.

    python benchmarks/fuzz_proofs.py SECONDS [SEED]

Several changes at once, in a build with the sanitizers of addresses and undefined behaviour.
"""

from __future__ import annotations

import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import robustid as rid
from robustid.guarantees import proof_text
from support.proof_judge import judged
from support.proof_loops import small_proofs
from support.proofs import SANITIZED, SOURCE, mutated, problem

QUIET = {"ASAN_OPTIONS": "detect_leaks=0"}
# One process for each file, but the program is started once for a whole batch.
BATCH = """
#include <sys/wait.h>
#include <unistd.h>
#define main checked
#include "SOURCE"
#undef main
int main(int count, char **names) {
    for (int k = 1; k < count; k++) {
        int status;
        fflush(stdout);
        pid_t child = fork();
        if (!child) {
            char *own[] = {names[0], names[k], NULL};
            if (!freopen("/dev/null", "w", stdout)) _exit(99);
            _exit(checked(2, own));
        }
        if (child < 0 || waitpid(child, &status, 0) < 0) return 98;
        printf("%d\\n", WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status));
    }
    return 0;
}
"""
SIZE = 500


def main(seconds: float, seed: int) -> None:
    """Print how many files were tried, by exit status."""
    rng, counts, end = random.Random(seed), dict.fromkeys((0, 1, 2), 0), time.monotonic() + seconds
    posed = [problem(one, 4, off=off, samples=samples) for one in (1, 2) for off in (0.0, 3.0) for samples in (0, 8)]
    bands = [rid.band(one, omega=one.frequency[0].omega[1:2]) for one in posed if rid.identify(one).consistent]
    texts = [*map(proof_text, bands), *(proof_text(rid.identify(one)) for one in posed), *small_proofs()]
    with tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as name:
        folder = Path(name)
        program, source = folder / "batch", folder / "batch.c"
        source.write_text(BATCH.replace("SOURCE", str(SOURCE)))
        subprocess.run(["cc", "-std=gnu11", *SANITIZED, "-o", str(program), str(source), "-lgmp"], check=True)
        while time.monotonic() < end:
            batch = [_broken(rng.choice(texts), rng) for _ in range(SIZE)]
            paths = [folder / f"{k}.json" for k in range(SIZE)]
            for path, text in zip(paths, batch, strict=True):
                path.write_text(text)
            done = subprocess.run([str(program), *map(str, paths)], capture_output=True, text=True, env=QUIET)
            for text, status in zip(batch, map(int, done.stdout.split()), strict=True):
                if status not in counts or (status == 0 and not judged(text)):
                    Path("fuzz_proofs_found.json").write_text(text)
                    raise SystemExit(f"status {status}, kept in fuzz_proofs_found.json: {done.stderr}")
                counts[status] += 1
    print(f"{sum(counts.values())} files: {counts[0]} proved, {counts[1]} not proved, {counts[2]} not readable")


def _broken(text: str, rng: random.Random) -> str:
    for _ in range(rng.choice([1, 1, 2, 3, 8])):
        text = mutated(text, rng)
    return text


if __name__ == "__main__":
    main(float(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0)
