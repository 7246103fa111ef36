"""Feed the checker of proofs with broken files until a time is over: it must never crash, nor accept what fractions do not confirm.

    python benchmarks/fuzz_proofs.py SECONDS [SEED]

Several changes at once, in a build with the sanitizers of addresses and undefined behaviour.
"""

from __future__ import annotations

import random
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import robustid as rid
from robustid.guarantees import proof_text
from support.proof_judge import judged
from support.proofs import SANITIZED, asked, band_of, built, mutated, problem


def main(seconds: float, seed: int) -> None:
    """Print how many files were tried, by exit status."""
    rng, counts, end = random.Random(seed), dict.fromkeys((0, 1, 2), 0), time.monotonic() + seconds
    systems = (rid.identify(problem(one, off=off)) for one in (1, 2) for off in (0.0, 3.0))
    texts = [band_of(1, frequencies=1)[1], *map(proof_text, systems)]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        program = built(folder, *SANITIZED)
        while time.monotonic() < end:
            text = rng.choice(texts)
            for _ in range(rng.choice([1, 1, 2, 3, 8])):
                text = mutated(text, rng)
            status, said = asked(program, text, folder)
            if status not in counts or (status == 0 and not judged(text)):
                Path("fuzz_proofs_found.json").write_text(text)
                raise SystemExit(f"status {status}, kept in fuzz_proofs_found.json: {said}")
            counts[status] += 1
    print(f"{sum(counts.values())} files: {counts[0]} proved, {counts[1]} not proved, {counts[2]} not readable")


if __name__ == "__main__":
    main(float(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0)
