"""The experiment of Inanc et al. (2001): its data, the example's classes, and the smallest orders that the issue claims."""

import dataclasses

import control
import numpy as np
import pytest

import robustid as rid
from support.cases import slow
from support.example_runs import load

example = load("inanc2001")
MIXED = {m.modes: m for m in example.METHODS if m.samples and m.lines and m.relax == 1}  # (), the light mode, both
SEEDS = 20


def ratios(data, model):
    """|error|/bound of every step sample and every line, by python-control alone."""
    record, frf = data.time, data.frequency
    step = control.forced_response(model, record.time, record.u[:, 0]).outputs
    lines = model(np.exp(1j * frf.omega * frf.dt))
    return np.abs(record.y[:, 0] - step) / example.BOUND, np.abs(frf.values[:, 0, 0] - lines) / example.BOUND


@pytest.mark.parametrize("output", ["y1", "y2"])
def test_the_truth_is_inside_every_bound_of_both_outputs(output):
    for seed in range(3):
        data = example.measure(seed, output)
        step, lines = ratios(data, data.truth)
        assert step.size == 100
        assert lines.size == 90
        assert max(step.max(), lines.max()) <= 1
        assert min(step.max(), lines.max()) > 0.9  # the bounds are those of the errors
    static, peak = (abs(data.truth(np.exp(0.02j * np.pi * hz))) for hz in (0, 17.67))
    assert static == pytest.approx(0.96, abs=1e-3)
    assert peak == pytest.approx({"y1": 0.31, "y2": 7.1}[output], rel=0.01)


def test_the_outputs_share_their_poles_and_have_errors_of_their_own():
    one, two = (example.measure(0, output) for output in ("y1", "y2"))
    np.testing.assert_array_equal(one.truth.A, two.truth.A)
    errors = [d.time.y[:, 0] - control.step_response(d.truth, d.time.time).outputs for d in (one, two)]
    assert abs(np.corrcoef(errors)[0, 1]) < 0.5
    with pytest.raises(rid.InputError, match="'y1', 'y2'"):
        rid.datasets.flexible_structure(output="y3")


@pytest.mark.parametrize("every", [3, slow(1)])
def test_every_method_uses_as_much_and_the_truth_is_in_its_class(every):
    """42 coefficients each; the largest |G| of the truth by its power series, which shares nothing with the example."""
    for method in example.METHODS[::every]:
        data = example.measure(0, method.output)
        lines = example.used_lines(data, method)
        assert method.samples + 2 * lines.size == 42
        np.testing.assert_allclose(data.frequency.freq_hz[lines], np.linspace(1, 21, lines.size), rtol=1e-12)
        problem, least = example.state_problem(data, method)
        K, rho = problem.prior.gain_bound, problem.prior.decay_rate
        largest = example.gain_of_truth(data, method, rho)
        assert least < largest <= K or largest == 0
        # Every mode's step response is a constant plus a real part of c a^k: fitted to the truth's, differenced, weighted, summed.
        w, d = data.modes.T
        a = np.exp((-d + 1j * np.sqrt(1 - d**2)) * w * 0.01)[:, None]
        columns = [part(a ** np.arange(200)) for part in (np.real, np.imag)]
        step = control.step_response(data.truth, 0.01 * np.arange(200)).outputs
        weights = np.linalg.lstsq(np.vstack([np.ones(200), *columns]).T, step, rcond=None)[0][1:].reshape(2, 2)
        k = np.arange(1, 12000)
        pulses = weights[0][:, None] * (a**k - a ** (k - 1)).real + weights[1][:, None] * (a**k - a ** (k - 1)).imag
        rest = np.delete(pulses, list(method.modes), axis=0).sum(axis=0) * rho**k if largest else np.zeros(1)
        assert largest == pytest.approx(np.abs(np.fft.rfft(rest, 2**18)).max(), rel=1e-4)


@pytest.mark.parametrize("only_both", [True, slow(False)])
def test_the_guaranteed_error_holds_for_the_truth(monkeypatch, only_both):
    monkeypatch.setattr(example, "WORST_HZ", np.array([6.5, 17.67]))
    data = example.measure(1)
    for modes in (example.BOTH,) if only_both else ((), example.BOTH):
        method = MIXED[modes]
        result = rid.identify(example.state_problem(data, method)[0]).require()
        error = rid.worst_case_error(result, omega=2 * np.pi * example.WORST_HZ, directions=4)
        off = np.abs(data.truth(np.exp(1j * error.omega * 0.01)) - error.nominal)
        assert np.all(off <= error.upper.ravel())
        assert (error.upper.max() < 1) == (modes == example.BOTH)  # only there it is worth having


def test_errors_at_unused_samples_are_of_the_others():
    data = example.measure(0)
    for method in example.METHODS:
        step, lines = example.unused_errors(data, method, data.truth)
        assert step.size + method.samples == 100
        assert lines.size + method.lines == 90
        both = ratios(data, data.truth)
        np.testing.assert_allclose(step, both[0][method.samples :], atol=1e-9)
        assert set(np.round(lines, 9)) <= set(np.round(both[1], 9))


def test_the_square_wave_in_steady_state():
    """Against a simulation from rest over 200 periods; read as a step, the class that knows both modes refutes it."""
    data, method = example.measure(2), MIXED[example.BOTH]
    periodic, as_step = example.square_wave(data, method.samples)
    u = np.tile(periodic.u[:, 0], 200)
    late = control.forced_response(data.truth, 0.01 * np.arange(u.size), u).outputs[-50:]
    error = np.abs(periodic.y[:, 0] - late)
    assert error[: method.samples].max() <= example.BOUND
    assert error[method.samples :].max() < 1e-6
    problem = example.state_problem(data, method)[0]
    refuted, kept = (rid.identify(dataclasses.replace(problem, time=r)) for r in (as_step, periodic))
    assert refuted.margin_lower > 3
    assert refuted.status is rid.Status.INCONSISTENT
    assert kept.consistent
    # Without a parametric part nobody notices.
    assert rid.identify(dataclasses.replace(example.state_problem(data, MIXED[()])[0], time=as_step)).consistent


def smallest_order(seed, method):
    """Order of the smallest model, whose samples are checked here."""
    data = example.measure(seed)
    result = rid.identify(example.state_problem(data, method)[0])
    small = rid.reduce_within_bounds(result)
    step, lines = ratios(data, small.model)
    worst = max(step[: method.samples].max(initial=0), lines[example.used_lines(data, method)].max(initial=0))
    assert worst <= 1 + 1e-5
    assert worst == pytest.approx(small.margin, abs=1e-6)
    assert np.abs(small.model.poles()).max() < 1
    assert small.model.nstates == small.order
    return small.order


@pytest.mark.parametrize(
    ("modes", "seeds", "least"),
    [slow(example.BOTH, 1, 1), slow((), SEEDS, 18), slow(example.LIGHT, SEEDS, 19), slow(example.BOTH, SEEDS, 19)],
)
def test_no_more_than_the_true_order(modes, seeds, least):
    orders = [smallest_order(seed, MIXED[modes]) for seed in range(seeds)]
    assert sum(order <= 4 for order in orders) >= least, orders


def tables(printed, methods):
    """The numbers of the three tables of methods: method to one list from all of them."""
    found = {m: [] for m in methods}
    for part in printed.split("\n\n")[:3]:
        rows = [line for line in part.splitlines() if any(f" {m.output} " in line for m in methods)]
        for m, row in zip(methods, rows, strict=True):
            name, numbers = row.removesuffix(m.paper).split(f" {m.output} ")
            assert name.strip() == m.name
            found[m].append([float(number) for number in numbers.split()])
    return found


def run_example(run):
    printed = run(example, [*(f"figure{k}.png" for k in (4, 5, 6, 7)), "guaranteed.png"])
    table = tables(printed, example.METHODS)
    for (*_, K, least, truth, _, _, order, truncated), (small, margin, *rms), guaranteed in table.values():
        assert small <= truncated <= order
        assert least <= truth <= K
        assert 0 < margin <= 1
        assert min(*rms, *guaranteed) > 0
    return table


@pytest.mark.slow  # the example itself runs beside the suite
def test_the_example(run, monkeypatch):
    """One output, two frequencies of the worst case: enough for what it claims."""
    monkeypatch.setattr(example, "WORST_HZ", np.array([10.5, 17.67]))
    y2 = [m for m in example.METHODS if m.output == "y2" and m.relax == 1]
    monkeypatch.setattr(example, "METHODS", [m for m in y2 if m.modes != example.LIGHT])
    table = run_example(run)
    _, (order, *_), best = table.pop(MIXED[example.BOTH])
    assert order <= 4
    for _, _, others in table.values():
        assert others[0] > 30 * best[0]  # guaranteed: next to nothing, in the middle between the samples too
        assert others[4] > 10 * best[4]
    _, (_, _, _, *lines), _ = table[example.TIME]
    assert lines[0] > 10  # time data alone miss the peak
    _, (_, _, step, *_), _ = table[example.LINES_ALONE]
    assert step > 10  # lines alone miss the step response


@pytest.mark.slow
def test_the_whole_example(run):
    run_example(run)
