"""Passive models of measured networks: fits, passive fits with proof, and vector fitting with and without enforced passivity.

Run: OPENBLAS_NUM_THREADS=1 python benchmarks/passivity.py (scikit-rf needed; its two-ports and one-port; 2 minutes of one core).
All have the same number of shared poles; errors are root mean squares over entries and lines. "passive" of scikit-rf is its own
test's word, of this library a proof in exact numbers. With --sizes also the time of proofs and passive fits against order.
"""

import argparse
import contextlib
import io
import time
import warnings
from pathlib import Path

import control
import numpy as np
import skrf
from skrf.vectorFitting import VectorFitting

import robustid as rid

FILES = {
    "ring slot.s2p": (1, 2, 3, 4),
    "ring slot measured.s1p": (2, 4, 6, 8),
    "ntwk1.s2p": (1, 2, 3),
    "wr2p2,line.s2p": (2, 4),
}


def rms(values, wanted):
    """Root mean square of a difference."""
    return np.sqrt(np.mean(np.abs(values - wanted) ** 2))


def vector_fit(network, pairs):
    """Error, passive or not, error and passive or not after enforcement, and processor time of both."""
    fit, ports, start = VectorFitting(network), network.nports, time.process_time()

    def error():
        values = [[fit.get_model_response(i, j, network.f) for j in range(ports)] for i in range(ports)]
        return rms(np.moveaxis(np.array(values), 2, 0), network.s)

    with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        fit.vector_fit(n_poles_real=0, n_poles_cmplx=pairs)
        fitted, middle = error(), time.process_time()
        try:
            passive = fit.is_passive()
            if not passive:
                fit.passivity_enforce()
            return fitted, passive, error(), fit.is_passive(), middle - start, time.process_time() - middle
        except Exception as problem:  # scikit-rf inverts D - I, which lossless networks have
            return fitted, str(problem), np.nan, "-", middle - start, time.process_time() - middle


def compare(name, pairs):
    """One line of the table."""
    network = skrf.Network(str(Path(skrf.__file__).parent / "data" / name))
    network = network[np.flatnonzero(network.f > 0)[0] :] if np.any(network.f <= 0) else network
    peer = vector_fit(network, pairs)
    data = rid.FrequencyResponse(2 * np.pi * network.f, network.s)
    fit = rid.fit_mfd(data, order=2 * pairs, form="shared", feedthrough=True, weight=np.ones(network.s.shape))
    middle = time.process_time()
    passive = rid.passive.make_passive(fit.model, response=data)
    end = time.process_time()
    errors = [rms(np.array([model(2j * np.pi * hz).reshape(network.s.shape[1:]) for hz in network.f]), network.s)
              for model in (fit.model, passive.model)]  # fmt: skip
    print(
        f"{name:24}{2 * pairs:6d}{peer[0]:10.2e}{peer[1]!s:>8.8}{peer[2]:10.2e}{peer[3]!s:>8.8}{peer[5]:7.1f}"
        f"{errors[0]:10.2e}{errors[1]:10.2e}{passive.passivity.holds!s:>7}{errors[1] / peer[0]:8.3f}{end - middle:7.1f}",
        flush=True,
    )


def line(states, rng):
    """A random lossy two-port in scattering form, by its modes."""
    w = np.sort(rng.uniform(1, 100, states // 2))
    A, B = np.zeros((states, states)), np.zeros((states, 2))
    for k, omega in enumerate(w):
        A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[0, 1], [-(omega**2), -0.02 * omega]]
        B[2 * k + 1] = rng.standard_normal(2)
    inverse = np.linalg.inv(1.1 * np.eye(2))
    C, root = B.T, np.sqrt(2)
    return control.StateSpace(A - B @ inverse @ C, root * B @ inverse, root * inverse @ C, -0.9 * inverse, 0)


def sizes():
    """Processor time of proofs against the number of states."""
    print("\nproofs of lossy two-ports\n  states   margin    CPU s")
    for states in (20, 60, 100, 200, 300):
        model = line(states, np.random.default_rng(0))
        start = time.process_time()
        proof = rid.prove_passive(model)
        print(
            f"{states:8d}{proof.margin:9.2g}{time.process_time() - start:9.1f}  {proof.status.name.lower()}", flush=True
        )


def main():
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", action="store_true")
    arguments = parser.parse_args()
    print(f"{'':30}{'vector fitting':>18}{'enforced passive':>25}{'fit_mfd':>10}{'make_passive':>32}")
    print(f"{'network':24}{'poles':>6}{'error':>10}{'passive':>8}{'error':>10}{'passive':>8}{'CPU s':>7}"
          f"{'error':>10}{'error':>10}{'proof':>7}{'/ v.f.':>8}{'CPU s':>7}")  # fmt: skip
    for name, all_pairs in FILES.items():
        for pairs in all_pairs:
            compare(name, pairs)
    if arguments.sizes:
        sizes()


if __name__ == "__main__":
    main()
