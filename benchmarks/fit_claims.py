"""Three claims about fits: constraints, records with a transient, and a time limit of one second.

Run: OPENBLAS_NUM_THREADS=1 ROBUSTID_DATA=folder python benchmarks/fit_claims.py [constraints] [records] [limit].
constraints: 20 simulated and 23 measured fits with a static gain, a zero or a roll-off, in coordinates of the state space
(the default) and as fractions (method "sk+lm"). records: the first half of CD player and hair dryer fitted, the second half
simulated from the initial state that fits best, in per cent of each output. limit: 50 stand-ins of many shapes and orders.
"""

import argparse
import sys
import time
from pathlib import Path

import control
import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
sys.path.insert(0, str(Path(__file__).parent.parent / "examples"))
import robustid as rid
from robustid.fitting import RollOff, StaticGain, Weight, Zero, subspace_estimate
from support.mfd_systems import noisy, random_modal_system, stand_in

OMEGA = 2 * np.pi * np.geomspace(4, 1200, 150)


def simulated():
    """Label, response, order, constraint; the constraint holds for the truth in every second one."""
    for seed in range(20):
        ny, nu = ((1, 1), (2, 1), (2, 2), (3, 2))[seed % 4]
        system = random_modal_system(seed, ny, nu, 3)
        frf = rid.FrequencyResponse(OMEGA, noisy(np.random.default_rng(seed), system.response(1j * OMEGA), 0.03))
        gain = system.response(np.array([0j]))[0].real
        options = (
            StaticGain(gain),
            RollOff(2),
            StaticGain(1.2 * gain),
            Zero(-50.0 - 200.0 * (seed % 3) * 1j, np.ones(ny)),
        )
        yield f"simulated {seed} {ny}x{nu}", frf, system.order, options[seed // 4 % 4]


def measured():
    """Mirror, beam, bench, CD player and hair dryer, some orders of each."""
    import beam_mimo

    mirror = rid.estimate_frf(rid.datasets.load("fsm/train"), period=8192).select(slice(1, None, 32))
    beam = beam_mimo.beam()[0].select(slice(None, None, 16))
    bench = rid.estimate_frf(rid.datasets.load("two_mass"), period=2500)
    player, dryer = (rid.estimate_frf(rid.datasets.load(name), method="local") for name in ("cdplayer", "hairdryer"))
    for name, frf, orders in (
        ("mirror", mirror, (6, 12)),
        ("beam", beam, (8, 14)),
        ("bench", bench, (4, 6)),
        ("CD player", player, (8, 12)),
        ("hair dryer", dryer.select(slice(None, None, 2)), (4, 6)),
    ):
        gain = np.real(frf.values[0])
        for order in orders:
            yield f"{name} {order}", frf, order, StaticGain(gain)
            yield f"{name} {order}", frf, order, RollOff(1 if order < 12 else 2)
    yield "mirror 12", mirror, 12, Zero(1.0, np.eye(3)[0])
    yield "bench 4", bench, 4, Zero(1.0)
    yield "beam 8", beam, 8, Zero(-1.0, np.eye(2)[0])


def constraints():
    for kind, cases in (("simulated", simulated), ("measured", measured)):
        ratios, speed, count = [], [], 0
        for label, frf, order, constraint in cases():
            found, weight = [], Weight.relative(frf.values)
            for method in ("lm", "sk+lm"):
                begin = time.process_time()
                try:
                    fit = rid.fit_mfd(frf, order=order, weight=weight, constraints=[constraint], method=method)
                    found.append((fit.cost, time.process_time() - begin, fit.stable, fit.status.name))
                except rid.errors.RobustIdError as error:
                    found.append((np.nan, np.nan, False, f"{type(error).__name__}: {str(error)[:60]}"))
            count += 1
            (cost, seconds, stable, status), (old, before, old_stable, old_status) = found
            if stable and old_stable:
                ratios.append(cost / old)
                speed.append(before / seconds)
            print(
                f"{label:<20}{type(constraint).__name__:<11} {cost:11.5g} {seconds:6.2f} s {status:<11}"
                f"{'' if stable else '  UNSTABLE'} fractions {old:11.5g} {before:6.2f} s {old_status}"
                f"{'' if old_stable else '  UNSTABLE'}",
                flush=True,
            )
        print(
            f"{kind}: {count} fits, both stable in {len(ratios)}; cost over that of fractions {min(ratios):.4f} to"
            f" {max(ratios):.4f}, above 1.01 in {sum(ratio > 1.01 for ratio in ratios)}; times faster: median"
            f" {np.median(speed):.1f}, {min(speed):.1f} to {max(speed):.1f}"
        )


def per_cent(model, record):
    """100 (1 - |y - model| / |y - mean|) of every output."""
    return 100 * rid.validate(model, record).fit


def records():
    for name, orders in (("hairdryer", (3, 4, 5, 6)), ("cdplayer", (6, 8, 10))):
        whole = rid.datasets.load(name)
        half = whole.u.shape[0] // 2
        first, second = (
            rid.TimeRecord(whole.u[part], whole.y[part], dt=whole.dt, initial="free")
            for part in (slice(None, half), slice(half, None))
        )
        frf = rid.estimate_frf(first, method="local")
        z = np.exp(1j * frf.omega * frf.dt)
        for order in orders:
            begin = time.process_time()
            own = rid.fit_records(first, order=order, feedthrough=True)
            seconds = time.process_time() - begin
            fit = rid.fit_mfd(frf, order=order, feedthrough=True)
            estimate = subspace_estimate(frf.values, z, order, feedthrough=True, domain="z")
            peer = control.ss(estimate.A, estimate.B, estimate.C, estimate.D, frf.dt)
            numbers = ["/".join(f"{value:.2f}" for value in per_cent(one, second)) for one in (own, fit, peer)]
            print(
                f"{name} order {order}: fit_records {numbers[0]} %, fit_mfd {numbers[1]} %, subspace {numbers[2]} %;"
                f" {seconds:.1f} s CPU",
                flush=True,
            )


def limit():
    late = worse = unstable = 0
    taken = []
    for case in range(50):
        ny, nu = ((1, 1), (2, 1), (2, 2), (4, 2), (2, 4))[case % 5]
        lines, order = 200 + 800 * (case % 7) // 6, 4 + 36 * (case % 11) // 10
        frf = stand_in(case, lines=lines)[0]
        values = frf.values if nu <= 2 else frf.values.transpose(0, 2, 1)
        frf = rid.FrequencyResponse(frf.omega, values[:, :ny, :nu], dt=frf.dt)
        weight = Weight.relative(frf.values)
        z = np.exp(1j * frf.omega * frf.dt)
        peer = subspace_estimate(frf.values, z, order, weight=weight.entries, domain="z")
        cost = float(np.linalg.norm(weight.apply(frf.values - peer.response(z)))) ** 2
        begin = time.monotonic()
        fit = rid.fit_mfd(frf, order=order, weight=weight, time_limit=1.0)
        taken.append(time.monotonic() - begin)
        late += taken[-1] > 1.5
        unstable += not fit.stable
        worse += fit.cost > cost * (1 + 1e-9)
    print(
        f"time_limit=1.0, 50 stand-ins: later than 1.5 s {late} (median {np.median(taken):.2f}, longest {max(taken):.2f} s of wall"
        f" clock), unstable {unstable}, worse than the subspace estimate {worse}"
    )


def main():
    parts = {part.__name__: part for part in (constraints, records, limit)}
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*", default=list(parts), help=", ".join(parts))
    for name in parser.parse_args().parts:
        parts[name]()


if __name__ == "__main__":
    main()
