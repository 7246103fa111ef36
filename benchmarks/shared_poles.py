"""Poles that all entries share: fit_mfd(form="shared") against vector fitting, and the time of fits of many entries.

Run: OPENBLAS_NUM_THREADS=1 python benchmarks/shared_poles.py [--seeds 3]. A simulated network: random pole pairs of damping
0.3 to 3 % between 2 and 99 Hz, residues of full rank, a direct term; 0.1 % noise, of the level of the whole response (which both
are told: unit weights) or of every sample (fit_mfd weighs relatively by default; vector fitting has unit weights only). scikit-rf,
where it is installed, with both its ways of spreading the first poles; the better one counts. Processor time.
"""

import argparse
import time
import warnings

import numpy as np

import robustid as rid

try:
    import skrf
    from skrf.vectorFitting import VectorFitting
except ImportError:
    skrf = None

NOISE = 1e-3


def network(seed, ny, nu, pairs, lines, *, relative):
    """Frequency points, the true response, and a FrequencyResponse."""
    rng = np.random.default_rng(seed)
    omega = 2 * np.pi * np.linspace(1, 100, lines)
    natural, damping = 2 * np.pi * np.sort(rng.uniform(2, 99, pairs)), rng.uniform(0.003, 0.03, pairs)
    poles = natural * (-damping + 1j * np.sqrt(1 - damping**2))
    R = rng.standard_normal((2, pairs, ny, nu)).T @ [1, 1j]
    R = R.T * (natural * damping)[:, None, None]
    s = 1j * omega[:, None]
    truth = np.tensordot(1 / (s - poles), R, 1) + np.tensordot(1 / (s - poles.conj()), R.conj(), 1)
    truth = truth + 0.1 * rng.standard_normal((ny, nu))
    size = NOISE * (np.abs(truth) if relative else np.sqrt(np.mean(np.abs(truth) ** 2)))
    noise = rng.standard_normal((2, lines, ny, nu)) / np.sqrt(2)
    covariance = None if relative else np.broadcast_to(size**2 * np.eye(ny * nu), (lines, ny * nu, ny * nu))
    return omega, truth, rid.FrequencyResponse(omega, truth + size * (noise[0] + 1j * noise[1]), covariance=covariance)


def ours(frf, poles, form="shared"):
    start = time.process_time()
    fit = rid.fit_mfd(frf, order=poles, form=form, feedthrough=True)
    return fit.fraction.response(frf.omega), len(fit.poles), time.process_time() - start, fit.status.name.lower()


def vector_fitting(frf, poles, spacing):
    fit = VectorFitting(skrf.Network(f=frf.omega / (2 * np.pi), s=frf.values, z0=50, f_unit="hz"))
    start = time.process_time()
    fit.vector_fit(0, poles // 2, init_pole_spacing=spacing, fit_constant=True, fit_proportional=False)
    seconds = time.process_time() - start
    count = range(frf.values.shape[1])
    response = [[fit.get_model_response(i, j, frf.omega / (2 * np.pi)) for j in count] for i in count]
    return np.moveaxis(response, -1, 0), int(np.sum(1 + (fit.poles.imag != 0))), seconds, spacing


def against_vector_fitting(seeds):
    print(f"6x6 network, 50 pole pairs, 300 lines, {NOISE:.1%} noise, seeds {seeds}: error against the truth")
    print(f"{'noise':>16}{'seed':>6}{'method':>12}{'poles':>7}{'error':>10}{'CPU s':>8}")
    for relative in (False, True):
        for seed in range(seeds):
            _, truth, frf = network(seed, 6, 6, 50, 300, relative=relative)
            runs = {"fit_mfd": [ours(frf, 100)]}
            if skrf is not None:
                runs["scikit-rf"] = [vector_fitting(frf, 100, spacing) for spacing in ("lin", "log")]
            for method, found in runs.items():
                scale = np.abs(truth) if relative else np.sqrt(np.mean(np.abs(truth) ** 2))
                errors = [np.sqrt(np.mean((np.abs(run[0] - truth) / scale) ** 2)) for run in found]
                best = int(np.argmin(errors))
                _, poles, seconds, how = found[best]
                kind = "of every sample" if relative else "of the level"
                print(f"{kind:>16}{seed:6}{method:>12}{poles:7}{errors[best]:10.2e}{seconds:8.1f}  {how}", flush=True)


def times():
    print("\ntime of a fit, noise of the level")
    print(f"{'response':>10}{'lines':>7}{'poles':>7}{'form':>8}{'error / noise':>15}{'CPU s':>8}")
    cases = [
        (1, 1, 30, 300),
        (28, 2, 20, 400),
        (13, 4, 40, 400),
        (2, 2, 40, 300),
        (4, 4, 40, 300),
        (8, 8, 40, 300),
        (20, 20, 40, 300),
    ]
    ours(network(0, 1, 1, 2, 50, relative=False)[2], 4)  # what is imported at the first fit isn't measured
    for ny, nu, order, lines in cases:
        _, truth, frf = network(0, ny, nu, order // 2, lines, relative=False)
        response, poles, seconds, how = ours(frf, order)
        error = np.linalg.norm(response - truth) / np.linalg.norm(frf.values - truth)
        print(f"{f'{ny}x{nu}':>10}{lines:7}{poles:7}{'shared':>8}{error:15.2f}{seconds:8.2f}  {how}", flush=True)


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=3)
    arguments = parser.parse_args(argv)
    warnings.simplefilter("ignore")  # vector fitting says so when it stops at its iteration limit
    times()
    against_vector_fitting(arguments.seeds)


if __name__ == "__main__":
    main()
