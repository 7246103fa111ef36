"""Balanced truncation beside its peers: seconds, error and stability, on the SLICOT models and on 1000 lightly damped states.

Peers: slycot's ab09ad itself, `control.balred` (which calls it), and pyMOR's BTReductor; what is missing is skipped.
Run: pip install slycot pymor, then OPENBLAS_NUM_THREADS=1 python benchmarks/model_reduction.py (--states 200: quicker).
Models are taken from the folder that ROBUSTID_DATA names. Processor seconds, since other work on the machine doesn't count in them.
"""

import argparse
import contextlib
import logging
import sys
import time
from pathlib import Path

import control
import numpy as np
import scipy.linalg as sla

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
import robustid as rid
from robustid.errors import DatasetNotFoundError
from robustid.reduction import hinf_error
from support.reduction_models import flexible

ORDERS = {"build": (10, 20), "CDplayer": (10, 30), "iss1R": (10, 40), "beam": (10, 30)}


def ours(model, order):
    return rid.balanced_truncation(model, order=order).model


def slycot_peer(model, order):
    import slycot

    n, m, p = model.nstates, model.ninputs, model.noutputs
    out = slycot.ab09ad("C", "B", "N", n, m, p, model.A.copy(), model.B.copy(), model.C.copy(), nr=order, tol=0.0)
    return control.StateSpace(*out[1:4], model.D, 0)


def control_peer(model, order):
    return control.balred(model, order, method="truncate")


def pymor_peer(model, order):
    from pymor.models.iosys import LTIModel
    from pymor.reductors.bt import BTReductor

    reduced = BTReductor(LTIModel.from_matrices(model.A, model.B, model.C, model.D)).reduce(order)
    a, b, c, d, e = reduced.to_matrices()
    d = np.zeros((c.shape[0], b.shape[1])) if d is None else d
    return control.StateSpace(
        a if e is None else np.linalg.solve(e, a), b if e is None else np.linalg.solve(e, b), c, d, 0
    )


PEERS = {"robustid": ours, "slycot ab09ad": slycot_peer, "control.balred": control_peer, "pyMOR": pymor_peer}


def row(name, model, order, error, first):
    """One peer: seconds, ratio to the first, error and whether it is stable; returns the seconds."""
    start = time.process_time()
    try:
        reduced = PEERS[name](model, order)
    except ImportError as missing:
        print(f"  {name:16}{order:6d}   skipped: {missing}", flush=True)
        return None
    except Exception as failure:
        print(f"  {name:16}{order:6d}   failed: {str(failure)[:80]}", flush=True)
        return None
    seconds = time.process_time() - start
    stable = np.max(reduced.poles().real) < 0
    value = f"{error(reduced):12.4e}" if stable else f"{'':12}"
    ratio = "" if first is None else f"{seconds / first:8.2f}"
    print(f"  {name:16}{order:6d}{seconds:9.2f}{ratio:>8}{value}{'' if stable else '  unstable'}", flush=True)
    return seconds


def table(title, model, orders, error):
    print(f"\n{title}\n  {'':16}{'order':>6}{'CPU s':>9}{'ratio':>8}{'error':>12}")
    for order in orders:
        first = None
        for name in PEERS:
            seconds = row(name, model, order, error, first)
            first = first or seconds
        print(f"  {'a-priori bound':16}{order:6d}{'':17}{rid.balanced_truncation(model, order=order).bound:12.4e}")


def on_lines(model, lines=60):
    """The largest error at lines on and between modes: the norm of a thousand states takes minutes."""
    poles = np.sort(np.abs(model.poles()))
    omega = np.concatenate([[0.0], poles[:: max(1, poles.size // lines)]])
    triangular, basis = sla.schur(model.A, output="complex")
    b, c, eye = basis.conj().T @ model.B, model.C @ basis, np.eye(model.nstates)
    values = [c @ sla.solve_triangular(1j * w * eye - triangular, b) + model.D for w in omega]

    def error(reduced):
        given = reduced(1j * omega, squeeze=False)
        return max(np.linalg.norm(value - given[:, :, k], 2) for k, value in enumerate(values))

    return error


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--states", type=int, default=1000, help="of the large model")
    parser.add_argument("--large-only", action="store_true", help="leave the SLICOT models out")
    arguments = parser.parse_args(argv)
    with contextlib.suppress(ImportError):
        import pymor.core.logger

        pymor.core.logger.set_log_levels({"pymor": "ERROR"})
    logging.disable(logging.WARNING)
    ours(flexible(10, 4, seed=0), 4)  # imports
    large = flexible(arguments.states // 2, 4, seed=0)
    table(f"{arguments.states} states, 4 x 4; error at lines", large, (arguments.states // 5,), on_lines(large))
    for name, orders in {} if arguments.large_only else ORDERS.items():
        try:
            model = rid.datasets.load(name)
        except DatasetNotFoundError as missing:
            print(f"{missing}")
            return
        table(
            f"{name}: {model.nstates} states; H-infinity error",
            model,
            orders,
            lambda r, m=model: hinf_error(m, r).value,
        )


if __name__ == "__main__":
    main()
