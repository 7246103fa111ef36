"""The 13x4 stage of order 40: what modal structure gains at points that were not measured, and what it costs.

Run: OPENBLAS_NUM_THREADS=1 python benchmarks/modal_stage.py [--seeds 3]. Three rigid-body and 17 flexible modes (µm over A), 300
frequency points, noise of 1 % of every entry and 0.02 µm/A, known to all; the truth with modes of real shapes (proportional
damping) and of complex ones. Every fit from a cold start, processor time; errors against the truth between the measured
frequencies.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "examples"))
from shared.modal_stage import between, measured, relative_error, stage

import robustid as rid
from robustid.core import response_at
from robustid.fitting import subspace_estimate

FITS = {
    "unconstrained": {},
    "rigid body": {"rigid_body": 3},
    "modal": {"rigid_body": 3, "modal": True},
    "proportional": {"rigid_body": 3, "modal": rid.fits.Modal("proportional")},
}


def largest_second(model):
    """Largest second singular value of the flexible modes' residues, over the first."""
    _, V = np.linalg.eig(model.A[:-6, :-6])
    left, right = model.C[:, :-6] @ V, np.linalg.solve(V, model.B[:-6].astype(complex))
    sizes = np.linalg.svd(np.einsum("ik,kj->kij", left, right), compute_uv=False)
    return float(np.max(sizes[:, 1] / sizes[:, 0]))


def subspace(frf, weight, order):
    start = time.process_time()
    found = subspace_estimate(frf.values, 1j * frf.omega, order, weight=weight.entries)
    return found, time.process_time() - start


def rows(plant, seed):
    """Name, error, CPU seconds and remarks of every method."""
    frf, weight = measured(plant, seed)
    omega = between(frf.omega)
    wanted = plant.response(omega)
    found, seconds = subspace(frf, weight, plant.order)
    error = relative_error(response_at((found.A, found.B, found.C, found.D), 1j * omega), wanted)
    yield "subspace", error, seconds, ""
    for name, options in FITS.items():
        start = time.process_time()
        fit = rid.fit_mfd(frf, order=plant.order, weight=weight, **options)
        seconds = time.process_time() - start
        remark = f"cost {fit.cost:8.0f}, {fit.status.name.lower()}"
        if fit.history:
            remark += f", kappa - 1 {fit.condition_numbers.max() - 1:.0e}"
        if "modal" in options:
            remark += f"; rank one to {largest_second(fit.model):.0e}, rigid {np.abs(fit.poles[-6:]).max():.0f}"
        yield name, relative_error(fit.fraction.response(omega), wanted), seconds, remark


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=3)
    seeds = parser.parse_args(argv).seeds
    subspace(*measured(stage(), 0, low=5, high=15), 2)  # what is imported at the first call isn't measured
    for general in (False, True):
        print(f"\ntruth with {'complex' if general else 'real'} shapes, noise of {300 * 52} in the cost")
        print(f"{'seed':>4}  {'fit':14}{'error':>10}{'/ subspace':>12}{'/ free':>8}{'CPU s':>8}")
        held = []
        for seed in range(seeds):
            first: dict[str, float] = {}
            for name, error, seconds, remark in rows(stage(general=general), seed):
                first[name] = error
                free = error / first.get("unconstrained", np.nan)
                ratio = error / first["subspace"]
                print(f"{seed:4}  {name:14}{error:10.2e}{ratio:12.3f}{free:8.3f}{seconds:8.1f}  {remark}", flush=True)
            names = ("modal",) if general else ("modal", "proportional")
            held += [first[name] < first["unconstrained"] for name in names]
        print(f"structure that is true below the unconstrained fit: {sum(held)} of {len(held)}")


if __name__ == "__main__":
    main()
