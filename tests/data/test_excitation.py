"""Multisines against their definition, brute force, and the plant they are to find."""

import pickle
import re

import numpy as np
import pytest

import robustid as rid
from robustid.core import simulate
from robustid.data.multisines import log_norm, low_crest_phases, random_phases, schroeder_phases, synthesise
from robustid.errors import FileFormatError, InputError, InputTypeError
from robustid.estimation import response_alone
from robustid.formats import load_excitation
from support.cases import seeds, slow
from support.mimo_data import real_poles
from support.pairwise import every_one
from support.refusals import refusals

DT = 0.01
BAND = {"band_hz": (1, 31), "period": 1000, "dt": 0.001}


def spectra(play):
    """Amplitudes of the cosines: (realisations, lines 0..Nyquist, inputs, experiments)."""
    nu, period = play.u.shape[2], play.period
    blocks = play.u.reshape(-1, nu, period, nu).transpose(0, 2, 3, 1)
    return np.fft.rfft(blocks, axis=1) * 2 / period


def crest(phases, amplitude, lines, period):
    u = synthesise(phases, amplitude, lines, period)
    return np.abs(u).max() / np.sqrt(np.mean(u**2))


def test_synthesis_is_the_sum_of_cosines():
    lines, amplitude, phases = np.array([1, 4, 6]), np.array([1.0, 0.5, 2.0]), np.array([0.3, -1.0, 2.0])
    n = np.arange(15)
    u = sum(a * np.cos(2 * np.pi * k * n / 15 + p) for a, k, p in zip(amplitude, lines, phases, strict=True))
    np.testing.assert_allclose(synthesise(phases, amplitude, lines, 15), u, atol=1e-14)


@pytest.mark.parametrize(("p", "rotations"), every_one([1, 2, 16, 512], [[0.0], [0.0, 2 * np.pi / 3, 4 * np.pi / 3]]))
def test_objective_and_gradient_by_brute_force(p, rotations):
    rng, lines, rotations = np.random.default_rng(p), np.array([1, 3, 4, 9]), np.array(rotations)
    amplitude, phases = rng.uniform(0.2, 2, 4), rng.uniform(0, 6, 4)
    given = (amplitude, lines, 64, rotations, p)
    value, gradient = log_norm(phases, *given)
    u = synthesise(phases + rotations[:, None], amplitude, lines, 64)
    peak = np.abs(u).max()
    assert value == pytest.approx(np.log(peak * np.mean((u / peak) ** (2 * p)) ** (1 / (2 * p))), abs=1e-12)
    step = 1e-6
    differences = [
        (log_norm(phases + step * e, *given)[0] - log_norm(phases - step * e, *given)[0]) / (2 * step)
        for e in np.eye(4)
    ]
    np.testing.assert_allclose(gradient, differences, atol=2e-8)


@pytest.mark.parametrize("lines", [*(slow(each) for each in ([1, 2], [1, 3], [1, 2, 3])), [2, 5], [1, 3, 7]])
def test_few_lines_reach_the_best_of_all_phases(lines):
    """All phases on a grid; a shift in time makes one of them free, so one is held at 0."""
    lines, amplitude, period = np.array(lines), np.ones(len(lines)), 420
    grid = np.linspace(0, 2 * np.pi, 180 if len(lines) < 3 else 120, endpoint=False)
    free = np.stack(np.meshgrid(*[grid] * (len(lines) - 1), indexing="ij"), axis=-1).reshape(-1, len(lines) - 1)
    phases = np.column_stack([np.zeros(len(free)), free])
    best = np.abs(synthesise(phases, amplitude, lines, period)).max(axis=1).min()
    found = [low_crest_phases(np.random.default_rng(s), amplitude, lines, period, np.zeros(1)) for s in range(8)]
    peaks = [np.abs(synthesise(phase, amplitude, lines, period)).max() for phase in found]
    assert min(peaks) <= best * 1.003


@pytest.mark.parametrize("seed", seeds(4, 25))
def test_crest_is_never_worse_than_schroeder_or_random(seed):
    rng = np.random.default_rng(seed)
    count, period = int(rng.integers(1, 40)), int(rng.integers(122, 600))
    lines, amplitude = np.sort(rng.choice(np.arange(1, 60), count, replace=False)), rng.uniform(0.3, 1, count)
    phases = low_crest_phases(np.random.default_rng(seed), amplitude, lines, period, np.zeros(1))
    others = [schroeder_phases(amplitude), random_phases(np.random.default_rng(seed), count)]
    assert crest(phases, amplitude, lines, period) <= min(crest(o, amplitude, lines, period) for o in others)


def test_crest_of_31_flat_harmonics():
    """Schroeder's is 1.78 here; the literature's best values lie at 1.4."""
    play = rid.prepare.multisine(**BAND, realisations=5)
    lines = np.arange(1, 32)
    np.testing.assert_array_equal(play.lines, lines)
    assert crest(schroeder_phases(np.ones(31)), np.ones(31), lines, 1000) > 1.7
    assert play.crest_factors.max() < 1.5
    assert np.median(play.crest_factors) < 1.42
    # purely random phases are what it is an improvement on
    assert rid.prepare.multisine(**BAND, realisations=5, minimise_crest=False).crest_factors.min() > 1.8


def test_schroeder_phases_of_a_flat_spectrum():
    """Their closed form, -pi k (k - 1)/F."""
    k = np.arange(1, 11)
    np.testing.assert_allclose(schroeder_phases(np.ones(10)), -np.pi * k * (k - 1) / 10, atol=1e-13)


@pytest.mark.parametrize("nu", [slow(k) if k in (2, 5, 6, 7, 8) else k for k in range(1, 9)])
def test_spectra_are_as_asked_and_orthogonal(nu):
    lines, rng = np.array([1, 2, 5, 11, 30, 49]), np.random.default_rng(nu)
    shape, rms = rng.uniform(0.5, 2, (6, nu)), rng.uniform(0.5, 2, nu)
    play = rid.prepare.multisine(lines=lines, period=100, dt=DT, inputs=nu, realisations=2, spectrum=shape, rms=rms)
    assert play.u.shape == (2 * nu, 100, nu)
    matrices = spectra(play)
    assert np.abs(np.delete(matrices, lines, axis=1)).max() < 1e-13
    amplitude = shape * rms / np.sqrt(0.5 * np.sum(shape**2, axis=0))
    np.testing.assert_allclose(play.rms, np.tile(rms, (2 * nu, 1)), rtol=1e-13)
    for block in matrices:
        unitary = block[lines] / amplitude[:, :, None] / np.sqrt(nu)
        np.testing.assert_allclose(unitary @ unitary.conj().swapaxes(1, 2), np.tile(np.eye(nu), (6, 1, 1)), atol=1e-12)
        np.testing.assert_allclose(np.abs(block[lines]), amplitude[:, :, None] * np.ones(nu), rtol=1e-12)


@pytest.mark.parametrize(("nu", "limit"), [(2, 1.5), *(slow(*each) for each in ((3, 1.7), (4, 1.5), (5, 1.7)))])
def test_crest_of_orthogonal_sets(nu, limit):
    play = rid.prepare.multisine(band_hz=(1, 31), period=500, dt=0.002, inputs=nu)
    assert play.crest_factors.max() < limit
    np.testing.assert_allclose(np.abs(play.u).max(axis=(0, 1)), 1, rtol=1e-15)


def test_lines_of_a_band():
    def chosen(**options):
        return rid.prepare.multisine(**{**BAND, "minimise_crest": False, **options}).lines

    np.testing.assert_array_equal(chosen(band_hz=(2.0, 7.5)), np.arange(2, 8))
    # edges that are lines in decimal, though not in binary
    np.testing.assert_array_equal(chosen(band_hz=(0.3, 0.7), period=10_000), np.arange(3, 8))
    np.testing.assert_array_equal(chosen(band_hz=(0.1, 499.99), period=1000), np.arange(1, 500))
    np.testing.assert_array_equal(chosen(band_hz=(0.1, 499.99), period=999), np.arange(1, 500))
    np.testing.assert_array_equal(chosen(band_hz=(2, 8), spacing="odd"), [3, 5, 7])
    # 10 points per decade: neighbours a factor 1.2589 apart, rounded
    np.testing.assert_array_equal(
        chosen(band_hz=(1, 100), spacing="log", lines_per_decade=10),
        [1, 2, 3, 4, 5, 6, 8, 10, 13, 16, 20, 25, 32, 40, 50, 63, 79, 100],
    )
    # both edges, whatever lies between
    np.testing.assert_array_equal(chosen(band_hz=(3, 50), spacing="log", lines_per_decade=4), [3, 5, 9, 16, 28, 50])
    np.testing.assert_array_equal(chosen(band_hz=(10, 11), spacing="log", lines_per_decade=4), [10, 11])
    np.testing.assert_array_equal(chosen(band_hz=(5, 5), spacing="log"), [5])


def test_random_odd_lines_leave_one_in_four_for_detection():
    design = {"band_hz": (1, 401), "period": 1000, "dt": 0.001, "spacing": "random-odd", "minimise_crest": False}
    grids = [rid.prepare.multisine(**design, seed=seed).lines for seed in range(20)]
    odd, left_out = np.arange(1, 402, 2), []
    for lines in grids:
        assert np.all(np.isin(lines, odd))
        missing = np.flatnonzero(~np.isin(odd, lines))
        np.testing.assert_array_equal(missing // 4, np.arange(50))
        left_out.append(missing % 4)
    # 1000 draws of four equally likely places: four sigma of sqrt(1000*3/16)
    assert np.all(np.abs(np.bincount(np.ravel(left_out)) - 250) < 4 * np.sqrt(1000 * 3 / 16))


def test_spectrum_as_array_or_callable():
    """A callable is given Hz."""
    options = {"lines": [2, 4, 8], "period": 200, "dt": DT}
    by_hand = rid.prepare.multisine(**options, spectrum=[1, 0.5, 0.25])
    np.testing.assert_array_equal(rid.prepare.multisine(**options, spectrum=lambda hz: 1 / hz).u, by_hand.u)
    np.testing.assert_allclose(
        np.abs(spectra(by_hand)[0, [2, 4, 8], 0, 0]) / np.abs(spectra(by_hand)[0, 2, 0, 0]), [1, 0.5, 0.25], rtol=1e-12
    )


def test_the_seed_makes_the_signals_and_realisations_differ():
    options = {"band_hz": (1, 31), "period": 250, "dt": 0.004, "inputs": 2, "rms": 1.0}
    first = rid.prepare.multisine(**options, realisations=2, seed=7)
    np.testing.assert_array_equal(rid.prepare.multisine(**options, realisations=2, seed=7).u, first.u)
    np.testing.assert_array_equal(rid.prepare.multisine(**options, realisations=1, seed=7).u, first.u[:2])
    others = rid.prepare.multisine(**options, realisations=2, seed=8)
    signals = np.concatenate([first.u[::2], others.u[::2]]).transpose(0, 2, 1).reshape(-1, 250)
    # largest correlation over all shifts: 1 for the same signal, shifted
    spectrum = np.fft.rfft(signals)
    shifted = np.fft.irfft(spectrum[:, None] * spectrum.conj()[None], axis=-1) / 250
    pairs = np.abs(shifted).max(axis=-1)[~np.eye(len(signals), dtype=bool)]
    assert pairs.max() < 0.8


@pytest.mark.parametrize(("power", "period"), [(60, 250), slow(-60, 1000), slow(60, 1000)])
def test_units_do_not_matter(power, period):
    scale, options = 2.0**power, {**BAND, "inputs": 2, "period": period, "dt": 1 / period}
    play = rid.prepare.multisine(**options)
    np.testing.assert_array_equal(rid.prepare.multisine(**options, amplitude=scale).u, scale * play.u)
    np.testing.assert_array_equal(rid.prepare.multisine(**options, spectrum=np.full(31, scale)).u, play.u)
    slow = rid.prepare.multisine(**{**options, "dt": scale / period, "band_hz": (1 / scale, 31 / scale)})
    np.testing.assert_array_equal(slow.u, play.u)
    np.testing.assert_array_equal(slow.freq_hz * scale, play.freq_hz)


def test_signals_to_play():
    play = rid.prepare.multisine(**BAND, inputs=2, realisations=2, periods=3, minimise_crest=False)
    assert play.signal(3).shape == (3000, 2)
    np.testing.assert_array_equal(play.signal(3), np.concatenate([play.u[3]] * 3))
    with pytest.raises(InputError, match="`experiment` must be from 0 to 3; got 4"):
        play.signal(4)
    again = pickle.loads(pickle.dumps(play))
    np.testing.assert_array_equal(again.u, play.u)
    with pytest.raises(ValueError, match="read-only"):
        again.u[0, 0, 0] = 1


def played(model, play):
    """The records of all experiments: one period more is played, and dropped with its transient."""
    for e in range(len(play.u)):
        u = np.concatenate([play.u[e], play.signal(e)])
        y = simulate(model, u)[0]
        yield rid.TimeRecord(u[play.period :], y[play.period :], dt=play.dt, initial="periodic")


@pytest.mark.parametrize("nu", [2, 3])
def test_what_was_played_finds_the_plant(nu, tmp_path):
    """Through a file, as in a laboratory: design, save, play, record, read the lines back, estimate."""
    design = {"band_hz": (2, 40), "period": 100, "dt": DT, "inputs": nu, "periods": 2, "spacing": "odd"}
    rid.prepare.multisine(**design).save(tmp_path / "play.csv")
    play = rid.load(tmp_path / "play.csv")
    records = list(played(real_poles(5, 2, nu), play))
    frf = rid.estimate_frf(records, period=play.period, lines=play.lines)
    np.testing.assert_allclose(frf.freq_hz, play.freq_hz, rtol=1e-15)
    truth = [real_poles(5, 2, nu)(np.exp(1j * w * DT)) for w in frf.omega]
    np.testing.assert_allclose(frf.values, truth, atol=1e-11)
    # without telling the lines, they are found
    np.testing.assert_array_equal(rid.estimate_frf(records, period=play.period).omega, frf.omega)


@pytest.mark.parametrize(("nu", "seeds"), [slow(1, 100), (2, 10), slow(2, 50)])
def test_accuracy_is_that_of_the_formula(nu, seeds):
    """sigma/rms sqrt(2 F/(nu P period)): 2 nu F entries and 100 seeds (50 of two inputs) make the mean square known to 2 %."""
    sigma, periods, count = 0.1, 2, 25
    play = rid.prepare.multisine(band_hz=(1, 25), period=100, dt=DT, inputs=nu, periods=periods, rms=2.0)
    clean = list(played(real_poles(5, 2, nu), play))
    truth = response_alone(clean, period=100, lines=play.lines).values
    rng, errors = np.random.default_rng(1), []
    for _ in range(seeds):
        noisy = [rid.TimeRecord(r.u, r.y + sigma * rng.standard_normal(r.y.shape), dt=DT) for r in clean]
        errors.append(response_alone(noisy, period=100, lines=play.lines).values - truth)
    stated = sigma / 2.0 * np.sqrt(2 * count / (nu * periods * 100))
    # four sigma
    assert np.mean(np.abs(errors) ** 2) / stated**2 == pytest.approx(1, abs=4 / np.sqrt(np.size(errors)))


@pytest.mark.parametrize("suffix", [".csv", ".npz", ".CSV"])
def test_files_come_back_exactly(suffix, tmp_path):
    design = {"band_hz": (0.1, 1), "period": 1000, "dt": 0.1 / 3, "inputs": 2, "minimise_crest": False}
    play = rid.prepare.multisine(**design, realisations=2, periods=3, seed=4)
    path = tmp_path / f"play{suffix}"
    play.save(path)
    again = rid.load(path)
    np.testing.assert_array_equal(again.u, play.u)
    np.testing.assert_array_equal(again.lines, play.lines)
    assert (again.dt, again.period, again.periods, again.seed) == (play.dt, 1000, 3, 4)


def test_the_csv_is_what_a_player_needs(tmp_path):
    play = rid.prepare.multisine(lines=[1, 3], period=10, dt=0.5, inputs=2, periods=2)
    play.save(tmp_path / "play.csv")
    lines = (tmp_path / "play.csv").read_text().splitlines()
    assert lines[0].startswith('# robustid.excitation {"dt": 0.5, "periods": 2')
    assert lines[1] == "time,u1_exp1,u2_exp1,u1_exp2,u2_exp2"
    table = np.loadtxt(lines[2:], delimiter=",")
    assert table.shape == (20, 5)
    np.testing.assert_array_equal(table[:, 0], 0.5 * np.arange(20))
    np.testing.assert_array_equal(table[:, 3:], play.signal(1))
    again = rid.load(tmp_path / "play.csv")  # the general reader does not take it for a measurement
    assert again.period == 10


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda text: text.split("\n", 1)[1], "its first line doesn't describe one"),
        (lambda text: text.replace("u2_exp2", "u3_exp2"), "its columns are not time, u1_exp1"),
        (lambda text: "\n".join(text.splitlines()[:-3]), "17 samples where it describes 2 periods of 10"),
        (lambda text: text.replace('"lines"', '"rows"'), "parts are missing"),
        (lambda text: text.replace("{", "[", 1), "parts are missing"),
        (lambda text: text.replace('"period": 10', '"period": "x"'), "describes 2 periods of x"),
        (lambda text: text.replace('"period": 10', '"period": 5').replace('"periods": 2', '"periods": 4'), "not equal"),
        (lambda text: text.replace("[1, 3]", "[1, 30]"), "`lines` must be whole numbers from 1 to 4"),
        (lambda text: re.sub(r"\n(0\.5|5\.5),[^,]*", r"\n\1,nan", text), "`u` must be finite; got nan"),
        (lambda text: text.replace("\n0.5,", "\n0.5,x"), "is not a number"),
        (lambda text: "time,u,y\n0,1,2\n1,1,2\n", "parts are missing"),
        (lambda text: "", "is empty"),
    ],
)
def test_other_files_are_refused(change, sentence, tmp_path):
    path = tmp_path / "play.csv"
    rid.prepare.multisine(lines=[1, 3], period=10, dt=0.5, inputs=2, periods=2).save(path)
    path.write_text(change(path.read_text()))
    with pytest.raises(FileFormatError, match=sentence):
        load_excitation(path)


def test_other_arrays_are_refused(tmp_path):
    np.savez(tmp_path / "other.npz", u=np.ones((2, 10, 2)), dt=0.1)
    with pytest.raises(FileFormatError, match=r"other\.npz is not an excitation .*parts are missing"):
        load_excitation(tmp_path / "other.npz")
    with pytest.raises(InputError, match="there is no such file"):
        load_excitation(tmp_path / "none.csv")
    with pytest.raises(InputError, match=r"`path` must end in \.csv or \.npz"):
        rid.prepare.multisine(**BAND).save(tmp_path / "play.mat")
    assert not (tmp_path / "play.mat").exists()


test_multisine_refuses = refusals(
    ({"band_hz": None}, "`band_hz` and `lines` both say .* give one of them"),
    ({"lines": [1, 2]}, "`band_hz` and `lines` both say .* give one of them"),
    ({"band_hz": (5,)}, r"`band_hz` must be \(low, high\) with 0 < low <= high < 500 Hz"),
    ({"band_hz": (0, 10)}, r"`band_hz` must be .* got \(0, 10\)"),
    ({"band_hz": (10, 5)}, r"`band_hz` must be .* got \(10, 5\)"),
    ({"band_hz": (10, 500)}, r"`band_hz` must be .* < 500 Hz, half the sampling rate; got \(10, 500\)"),
    ({"band_hz": (1.2, 1.8)}, r"holds no spectral line: they are multiples of 1 Hz, 1/\(period\*dt\)"),
    ({"band_hz": (4, 4), "spacing": "odd"}, "holds no odd spectral line"),
    ({"band_hz": "wide"}, "`band_hz` must be an array of numbers", InputTypeError),
    ({"spacing": "even"}, "`spacing` must be one of all, odd, random-odd, log; got 'even'"),
    ({"band_hz": None, "lines": [1], "spacing": "odd"}, "`spacing` = 'odd' chooses lines in a band"),
    ({"spacing": "log", "lines_per_decade": 0}, "`lines_per_decade` must be at least 1"),
    ({"band_hz": None, "lines": [0, 1]}, "`lines` must be whole numbers from 1 to 499"),
    ({"band_hz": None, "lines": [500]}, "between 0 and Nyquist for a period of 1000 samples"),
    ({"band_hz": None, "lines": [1.5]}, "`lines` must be whole numbers"),
    ({"band_hz": None, "lines": []}, "`lines` must be whole numbers"),
    ({"band_hz": None, "lines": [3, 2]}, r"`lines` must ascend, each line once; got \[3, 2\]"),
    ({"period": 0.5}, "`period` must be an integer", InputTypeError),
    ({"period": 2}, "`period` must be at least 3; got 2"),
    ({"dt": 0}, "`dt` must be positive"),
    ({"inputs": 0}, "`inputs` must be at least 1"),
    ({"realisations": 0}, "`realisations` must be at least 1"),
    ({"periods": 0}, "`periods` must be at least 1"),
    ({"seed": -1}, "`seed` must be at least 0"),
    ({"amplitude": 0}, "`amplitude` must be positive; got 0"),
    ({"amplitude": [1, 2]}, r"`amplitude` must be one number or one for each of 1 inputs; got shape \(2,\)"),
    ({"rms": [1, 2]}, "`rms` must be one number"),
    ({"amplitude": 1, "rms": 1}, "`amplitude` and `rms` both set the size"),
    ({"spectrum": [1, 2]}, r"must have shape \(F,\) or \(F, inputs\) with F = 31 spectral lines; got \(2,\)"),
    ({"spectrum": np.zeros(31)}, "`spectrum` must be positive; got 0"),
    ({"spectrum": lambda hz: hz * np.nan}, "`spectrum` must be finite"),
    of=lambda **options: rid.prepare.multisine(**{**BAND, "minimise_crest": False, **options}),
)

test_excitation_refuses_other_shapes = refusals(
    *((lambda shape=shape: rid.data.Excitation(np.ones(shape), dt=0.1, lines=[1]), "`u` must have")
      for shape in [(3, 10, 2), (10, 2), (0, 10, 2)]),
)  # fmt: skip
