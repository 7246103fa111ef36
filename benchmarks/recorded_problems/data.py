"""Measurements: responses and bounds from records, delays, corrections, excitations, files."""

from __future__ import annotations

import numpy as np

import robustid as rid

from .plants import DT, HZ, driven, matrix_record, matrix_response, modal_system, noisy, structure
from .registry import of, problem

PERIOD = 100


def played():
    return rid.prepare.multisine(band_hz=(1, 40), dt=DT, period=PERIOD, inputs=2, realisations=2, minimise_crest=False)


def periodic_records(periods=4, noise=0.02):
    """Of one mode at 10 Hz in a 2 x 2 plant, in steady state, with noise."""
    play, rng, records = played(), np.random.default_rng(0), []
    s = 1j * HZ * play.freq_hz
    mode = (HZ * 10) ** 2 / (s**2 + 0.4 * HZ * s + (HZ * 10) ** 2)
    gain = mode[:, None, None] * np.array([[2.0, 1.0], [0.05, -1.0]])
    for u in play.u:
        spectrum = np.fft.rfft(u, axis=0)
        spectrum[play.lines] = np.einsum("fij,fj->fi", gain, spectrum[play.lines])
        y = np.tile(np.fft.irfft(spectrum, PERIOD, axis=0), (periods, 1))
        y = y + noise * rng.standard_normal(y.shape)
        records.append(rid.TimeRecord(np.tile(u, (periods, 1)), y, dt=DT, initial="periodic"))
    return play, records


@problem(quick=True)
def frf_periodic(_):
    play, records = periodic_records()
    found = rid.estimate_frf(records, method="periodic", period=PERIOD, lines=play.lines)
    later = rid.estimate_frf(records, method="periodic", period=PERIOD, lines=play.lines, about="next record")
    return {"mean": found, "about": found.bound.about, "next": later.bound}


@problem()
def frf_local_and_welch(_):
    record = driven(600)
    found = {method: rid.estimate_frf(record, method=method) for method in ("local", "welch")}
    return found | {"faults": rid.prepare.record_faults(record)}


@problem()
def frf_nonlinear(_):
    found = rid.estimate_frf(rid.prepare.nonlinear_records("backlash", 2, noise=0.01, spacing="odd"))
    return of(found, "omega values bound noise distortion faults note")


@problem(quick=True)
def bounds_of_data(_):
    frf = noisy(modal_system(modes=3, outputs=1, inputs=1, band_hz=(10, 150)), HZ * np.linspace(2, 200, 150), 0.03)
    scatter = rid.estimate_bound(frf)
    still = rid.TimeRecord(np.zeros((64, 1)), np.random.default_rng(3).standard_normal((64, 2)), dt=DT)
    floor = rid.prepare.bounds_from_noise_floor(still)
    record = rid.TimeRecord(np.ones(8), np.ones((8, 2)), dt=DT)
    return {
        "scatter": scatter.bound,
        "said": scatter.bound.words(scatter.note),
        "record": rid.estimate_bound(periodic_records()[1][0]).bound,
        "floor": of(floor, "deviation mean level factor"),
        "bounded": floor.bound_record(record),
    }


@problem(quick=True)
def records_prepared(_):
    record = driven(120)
    drifting = rid.TimeRecord(record.u, record.y + 0.01 * record.time[:, None], dt=record.dt, initial="free")
    return {
        "decimate": rid.prepare.decimate(driven(300), 2),
        "mean": rid.prepare.detrend(drifting),
        "linear": rid.prepare.detrend(drifting, kind="linear"),
        "faults": rid.prepare.record_faults(drifting),
        "rate": rid.prepare.sample_time(record.time),
    }


@problem()
def delays(_):
    model = modal_system(modes=2, outputs=1, inputs=1, band_hz=(10, 150))
    omega = HZ * np.linspace(2, 350, 120)
    frf = noisy(model, omega, 0.01)
    late = rid.FrequencyResponse(omega, frf.values * np.exp(-0.002j * omega)[:, None, None])
    delay = rid.prepare.estimate_delay(late)
    sampled = model.sample(1e-3)
    put = rid.prepare.with_delay(sampled, 0.0023)
    return {
        "delay": of(delay, "seconds deviation order misfit searched"),
        "faults": rid.prepare.response_faults(late),
        "taken out": late.without_delay(0.002).values,
        "put back": put.model,
    }


@problem(quick=True, near=("odd/",))
def excitations(_):
    plain = rid.prepare.multisine(
        period=128, dt=DT, band_hz=(1, 40), spacing="odd", inputs=2, realisations=1, periods=2
    )
    logarithmic = rid.prepare.multisine(
        period=200, dt=DT, band_hz=(1, 40), spacing="log", rms=0.5, seed=2, minimise_crest=False
    )
    return {
        name: of(one, "u lines crest_factors rms freq_hz") for name, one in {"odd": plain, "log": logarithmic}.items()
    }


@problem(quick=True)
def files_of_data(folder):
    """What is saved comes back, from every kind of file."""
    frf, record = matrix_response(lines=5), matrix_record(6)
    found = {}
    for kind in ("csv", "npz", "mat"):
        for name, thing in {"frf": frf, "record": record}.items():
            path = folder / f"{name}.{kind}"
            rid.save(path, thing)
            found[f"{name}.{kind}"] = rid.load(path)
    found["text"] = (folder / "frf.csv").read_text()
    foreign = np.column_stack([frf.freq_hz, np.abs(frf.values[:, 0, 0]), np.degrees(np.angle(frf.values[:, 0, 0]))])
    np.savetxt(
        folder / "foreign.csv", foreign, delimiter=",", header="Frequency [Hz],Magnitude,Phase [deg]", comments=""
    )
    found["foreign"] = rid.load(folder / "foreign.csv", bound=0.1)
    found["look"] = str(rid.look(folder / "foreign.csv"))
    return found


@problem(quick=True)
def simulated_structure(_):
    data = rid.datasets.flexible_structure(seed=3, lines=5, samples=6)
    asked = structure()
    return {
        "data": [data.frequency, data.time, data.truth, data.modes],
        "parametric": asked.parametric.response([0.1, 1.0]),
    }


@problem(quick=True)
def files_of_others(folder):
    """Kinds of files that other programs write: HDF5, universal files, excitations, MATLAB's models."""
    import h5py
    import scipy.io

    frf, record = matrix_response(lines=5), matrix_record(6)
    with h5py.File(folder / "bench.h5", "w") as file:
        file["omega"], file["values"], file["dt"] = frf.omega, frf.values, DT
    rid.save(folder / "frf.unv", frf)
    played().save(folder / "play.csv")
    played().save(folder / "play.npz")
    scipy.io.savemat(folder / "model.mat", {"num": [1.0, 0.5], "den": [1.0, 0.3, 0.1], "Ts": 0.1})
    scipy.io.savemat(folder / "struct.mat", {"bench": {"frequency": frf.freq_hz, "response": frf.values, "Ts": DT}})
    plays = [rid.load(folder / f"play.{kind}") for kind in ("csv", "npz")]
    return {
        "hdf5": rid.load(folder / "bench.h5", bound=0.1),
        "universal": rid.load(folder / "frf.unv", dt=DT),
        "model": rid.load(folder / "model.mat"),
        "struct": str(rid.look(folder / "struct.mat")),
        "plays": [of(one, "lines crest_factors dt") for one in plays],
        "window": record.window(0.01, 0.04),
        "entry": rid.TimeRecord(record.u * [1, 0], record.y, dt=DT).entry(0, 0),
        "control": rid.FrequencyResponse.from_control(frf.to_control()).values,
        "column": frf.with_column_bound(0.1).bound,
    }


@problem(quick=True)
def noise_floor_of_response(_):
    play, records = periodic_records()
    frf = rid.estimate_frf(records, method="periodic", period=PERIOD, lines=play.lines)
    still = rid.TimeRecord(np.zeros((800, 2)), 0.02 * np.random.default_rng(9).standard_normal((800, 2)), dt=DT)
    return {"bound": rid.prepare.bounds_from_noise_floor(still).bound_response(frf, records, period=PERIOD).bound}
