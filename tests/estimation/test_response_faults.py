"""Lines of a response against their neighbours: which are off, where, by how much, and what undoes it; and clean ones."""

import dataclasses

import numpy as np
import pytest

import robustid as rid
from robustid.data import FaultKind
from robustid.errors import InputError
from robustid.estimation.frf import response_alone
from robustid.estimation.outlying_lines import related
from robustid.prepare import correct, response_faults
from support.cases import slow
from support.fault_plants import simulated

HZ = 2 * np.pi


def plant(omega, *, half_width=0.4):
    """Three modes, half-widths in line spacings of 1 rad/s, and a slow one."""
    s = 1j * omega
    modes = [(37.3, 1.0), (81.6, -0.7), (150.2, 0.5)]
    return 0.3 / (1 + s / 30) + sum(gain * w / (s**2 + 2 * half_width * s + w**2) for w, gain in modes)


def response(seed=0, *, lines=200, noise=1e-3, half_width=0.4, bounds=4.0, unit=1.0):
    """Noise of a standard deviation, and a bound that is so many times as large."""
    rng, omega = np.random.default_rng(seed), np.arange(1.0, lines + 1)
    error = noise * (rng.standard_normal(lines) + 1j * rng.standard_normal(lines)) / np.sqrt(2)
    return rid.FrequencyResponse(
        omega, unit * (plant(omega, half_width=half_width) + error), bound=unit * bounds * noise
    )


def changed(frf, lines, by):
    values = frf.values.copy()
    values[lines] += by
    return dataclasses.replace(frf, values=values)


def test_a_line_that_is_off_is_named_with_its_place_and_size_and_leaving_it_out_undoes_it():
    frf = response()
    (fault,) = response_faults(changed(frf, 120, 0.1))
    assert fault.kind == "outlier"
    assert fault.size == pytest.approx(25, rel=0.1)  # 0.1 over the bound of 0.004
    rest = correct(changed(frf, 120, 0.1), fault.correction)
    assert response_faults(rest) == ()
    assert np.array_equal(rest.omega, np.delete(frf.omega, 120))


@pytest.mark.parametrize("below", [False, True])
def test_magnitudes_below_one_were_no_plain_numbers(below):
    """So many decibels of a plain number, which is 0 or more, are a factor of 1 or more."""
    omega = np.arange(1.0, 201)
    number = plant(omega, half_width=2)
    values = 10 ** ((-1 if below else 1) * 40 * np.abs(number) / np.abs(number).max() / 20)
    frf = rid.FrequencyResponse(omega, values * np.exp(1j * np.angle(number)))
    assert ("magnitude linear" in [fault.correction for fault in response_faults(frf)]) is not below


def many_modes(seed, *, lines=1200, apart=75.0, small=1.0):
    """More modes than a model of 20 poles holds; of the errors of one line in ten the bound is `small` times too small."""
    rng, omega = np.random.default_rng(seed), np.arange(1.0, lines + 1)
    modes = [(w, rng.uniform(0.5, 1) * (-1) ** k) for k, w in enumerate(np.arange(apart / 2, lines, apart))]
    s = 1j * omega
    values = sum(gain * w / (s**2 + 4 * s + w**2) for w, gain in modes)
    error = 1e-4 * (rng.standard_normal(lines) + 1j * rng.standard_normal(lines)) / np.sqrt(2)
    error[rng.random(lines) < 0.1] *= small
    return rid.FrequencyResponse(omega, values + error, bound=4e-4)


@pytest.mark.parametrize("seed", [0, *map(slow, range(1, 6))])
def test_of_a_long_response_a_seam_and_bounds_that_are_too_small_are_told(seed):
    clean = many_modes(seed)
    assert response_faults(clean) == ()
    late = np.exp(-0.5j * clean.omega[700:, None, None] / clean.omega[700])
    (fault,) = response_faults(changed(clean, slice(700, None), (late - 1) * clean.values[700:]))
    assert fault.kind == "seam"
    assert f"between {clean.freq_hz[699]:.5g} Hz and {clean.freq_hz[700]:.5g} Hz" in fault.words
    assert FaultKind.SMALL_BOUND in [fault.kind for fault in response_faults(many_modes(seed, small=4.0))]


def test_lines_beside_each_other_and_at_the_ends_do_not_hide_each_other():
    lines = [0, 60, 66, 110, 111, 199]
    wrong = changed(response(), lines, 0.2 * np.array([1, 1j, -1, -1j, 1, 1])[:, None, None])
    (fault,) = response_faults(wrong)
    rest = correct(wrong, fault.correction)
    assert np.array_equal(rest.omega, np.delete(response().omega, lines))


def test_an_entry_of_a_matrix_that_is_off_is_named_by_its_signals():
    frf = rid.FrequencyResponse(
        response().omega, np.concatenate([response(k).values for k in range(4)], axis=1).reshape(-1, 2, 2), bound=4e-3
    )
    values = frf.values.copy()
    values[120, 1, 0] += 0.1
    (fault,) = response_faults(dataclasses.replace(frf, values=values))
    assert fault.where == f"{frf.outputs[1].name} / {frf.inputs[0].name}"


def test_lines_that_were_not_measured_and_filled_with_zeros_are_all_left_out():
    frf, lines = response(), [3, 50, 77, 130]
    values = frf.values.copy()
    values[lines] = 0
    (fault,) = response_faults(dataclasses.replace(frf, values=values))
    rest = correct(dataclasses.replace(frf, values=values), fault.correction)
    assert np.array_equal(rest.omega, np.delete(frf.omega, lines))


@pytest.mark.parametrize("seeds", [3, pytest.param(20, marks=pytest.mark.slow)])
def test_a_mode_that_two_lines_see_is_no_outlier_and_one_on_a_single_line_is_suspect(seeds):
    wide = [response_faults(response(seed, half_width=0.3)) for seed in range(seeds)]
    assert not any(wide)
    # Half-widths of 1/250 of the spacing: flanks of a fifth of the noise, and of 20 times.
    frf = response()
    narrow = 1 / (1j * (frf.omega - 110) + 0.004)
    assert not response_faults(dataclasses.replace(frf, values=frf.values + 2e-2 * narrow[:, None, None]))
    (fault,) = response_faults(dataclasses.replace(frf, values=frf.values + 2e-4 * narrow[:, None, None]))
    assert fault.kind == "outlier"
    assert fault.correction == f"leave out {110 / HZ:.5g}"


def test_a_jump_between_two_parts_of_the_axis_is_named_with_its_factor():
    for factor in (1.3, np.exp(0.4j)):
        frf = response()
        values = frf.values.copy()
        values[110:] *= factor
        (fault,) = response_faults(dataclasses.replace(frf, values=values))
        assert fault.kind == "seam"
        assert fault.size == pytest.approx(abs(factor - 1), rel=0.1)


def test_lines_that_nothing_excited_are_left_out_by_the_correction():
    frf, rng = response(), np.random.default_rng(1)
    values = frf.values.copy()
    values[160:] = 0.05 * (rng.standard_normal((40, 1, 1)) + 1j * rng.standard_normal((40, 1, 1)))
    (fault,) = response_faults(wrong := dataclasses.replace(frf, values=values))
    assert fault.kind == "noise only"
    assert fault.size == pytest.approx(40, abs=1)
    rest = correct(wrong, fault.correction)
    assert abs(rest.omega.size - 160) <= 1
    (fault,) = response_faults(
        wrong := dataclasses.replace(frf, values=np.concatenate([values[160:], frf.values[40:]]))
    )
    assert correct(wrong, fault.correction).omega.size == pytest.approx(160, abs=1)
    # A bound that is as large as they are says it.
    honest = dataclasses.replace(frf, values=values, bound=np.where(frf.omega > 160, 0.2, 4e-3))
    assert response_faults(honest) == ()


def test_repeated_frequency_points_contradict_each_other():
    frf = response()
    omega, values = (
        np.insert(frf.omega, 90, frf.omega[90]),
        np.insert(frf.values.ravel(), 90, frf.values[90, 0, 0] + 0.05),
    )
    (fault,) = response_faults(repeated := rid.FrequencyResponse(omega, values, bound=4e-3))
    assert fault.kind == "outlier"
    assert fault.size == pytest.approx(0.05 / 8e-3, rel=0.01)
    assert np.array_equal(correct(repeated, fault.correction).omega, np.delete(frf.omega, 90))
    same = np.insert(frf.values.ravel(), 90, frf.values[90, 0, 0])
    assert response_faults(rid.FrequencyResponse(omega, same, bound=4e-3)) == ()


def uneven(seed):
    """Errors up to six times as large at the second mode, as distortion is: 2 to 3 of the bounds there, which do not know it."""
    frf, rng = response(seed), np.random.default_rng([seed, 1])
    error = rng.standard_normal(frf.omega.size) + 1j * rng.standard_normal(frf.omega.size)
    error *= 6e-3 / np.sqrt(2) / (1 + ((frf.omega - 81.6) / 20) ** 2)
    return changed(frf, slice(None), error[:, None, None])


def test_two_responses_one_after_the_other_are_told_as_that():
    """Every frequency twice, no line of which is left; or few others, without which nothing is left to go on with."""
    omega = np.linspace(1, 50, 30)
    first = 1 / (1 - (omega / 20) ** 2 + 0.04j * omega / 20)
    for extra in (0, 3, 40):
        w, values = (
            np.concatenate([omega, omega, 60.0 + np.arange(extra)]),
            np.concatenate([first, 3 * first, np.ones(extra)]),
        )
        (found,) = rid.prepare.response_faults(rid.FrequencyResponse(w, values))
        assert found.kind == "outlier"
        assert ("several responses in one file" in found.words) == (extra < 30)
        assert bool(found.correction) == (extra > 30)


def test_two_responses_in_one_are_told_where_they_made_the_bound():
    """Their differences widened the bound that was taken from them, and were called noise."""
    frf, rng = response(), np.random.default_rng(3)
    omega, bound = (
        np.tile(frf.omega, 2),
        rid.Bound(0.5 * np.ones(2 * frf.omega.size), kind="confidence", probability=0.95),
    )

    def joined(factor, noise=0.0):
        error = noise * (rng.standard_normal(omega.size) + 1j * rng.standard_normal(omega.size))
        values = np.concatenate([frf.values.ravel(), factor * frf.values.ravel()])
        return response_faults(rid.FrequencyResponse(omega, values + error, bound=bound))

    (found,) = joined(1.3)
    assert "several responses in one file" in found.words
    assert found.size == pytest.approx(0.6 / 2.3)
    assert not found.correction
    assert joined(1.0, 0.02) == ()


def test_a_line_that_stands_there_twice_is_no_missing_mode():
    frf = response()
    omega = np.insert(frf.omega, 90, frf.omega[90])
    values = np.insert(frf.values.ravel(), 90, frf.values[90, 0, 0] + 0.05)
    bound = rid.Bound(0.04 * np.ones(omega.size), kind="confidence", probability=0.95)
    (fault,) = response_faults(repeated := rid.FrequencyResponse(omega, values, bound=bound))
    assert fault.words.startswith("repeated frequency points contradict each other")
    assert "a mode" not in fault.evidence
    assert np.array_equal(correct(repeated, fault.correction).omega, np.delete(frf.omega, 90))


@pytest.mark.parametrize("seeds", [1, slow(40)])
def test_where_all_lines_scatter_more_none_of_them_is_off(seeds):
    """Lines of the mirror at its resonance were told so, which other excitations of it do not show."""
    for seed in range(seeds):
        assert FaultKind.OUTLIER not in {fault.kind for fault in response_faults(uneven(seed))}
        found = response_faults(changed(uneven(seed), 72, 0.1))
        assert FaultKind.OUTLIER in {fault.kind for fault in found}


def test_units_do_not_matter():
    (expected,) = response_faults(changed(response(), 120, 0.1))
    for unit in (2.0**-60, 2.0**60):
        frf = changed(response(unit=unit), 120, 0.1 * unit)
        (fault,) = response_faults(frf)
        assert str(fault) == str(expected)
        faster = rid.FrequencyResponse(2.0**60 * frf.omega, frf.values, bound=frf.bound)
        assert response_faults(faster)[0].size == fault.size


def test_an_error_within_the_bound_is_none_and_without_a_bound_the_scatter_decides():
    assert response_faults(changed(response(bounds=200), 120, 0.1)) == ()
    frf = changed(response(), 120, 0.1).with_bound(None)
    (fault,) = response_faults(frf)
    assert fault.kind == "outlier"


@pytest.mark.parametrize("seeds", [4, slow(60)])
def test_clean_responses_are_told_of_nothing(seeds):
    """Noise that is even or in part of the response, half-widths from a third of the line spacing, few lines and many."""
    told = 0
    for seed in range(seeds):
        rng = np.random.default_rng([seed, 5])
        lines = int(rng.choice([20, 60, 160, 200]))
        frf = response(
            seed, lines=lines, noise=float(rng.choice([1e-5, 1e-3, 1e-2])), half_width=float(rng.uniform(0.3, 2))
        )
        told += bool(response_faults(frf))
    assert told == 0


def test_errors_of_overlapping_windows_are_alike_and_a_clear_jump_in_them_is_named():
    """They step from one window to the next: only a jump of a bound and more is one."""
    heater = simulated("heater")
    frf = response_alone(heater.random)
    assert related(frf)
    assert not related(heater.response)
    assert not related(response())  # without a covariance nobody can tell
    assert response_faults(frf) == ()
    values = frf.values.copy()
    values[frf.omega.size // 2 :] *= 1.3
    assert FaultKind.SEAM in {fault.kind for fault in response_faults(dataclasses.replace(frf, values=values))}


def test_few_lines_and_what_is_missing_say_nothing():
    assert response_faults(response().select(slice(0, 12))) == ()
    bound = np.full(200, 4e-3)
    bound[120] = np.inf
    frf = dataclasses.replace(changed(response(), 120, 5.0), bound=bound)
    assert response_faults(frf) == ()


def test_leaving_out_names_the_frequency_points_and_refuses_what_is_not_there():
    frf = rid.FrequencyResponse(HZ * np.array([16.978, 20.0, 25.0]), [1.0, 2.0, 3.0])
    assert correct(frf, "leave out 16.978 25").freq_hz == pytest.approx([20.0])
    assert correct(frf, "leave out 16.9779").freq_hz == pytest.approx([20.0, 25.0])
    assert correct(frf, "leave out above 20").freq_hz == pytest.approx([16.978, 20.0])
    assert correct(frf, "leave out below 20").freq_hz == pytest.approx([20.0, 25.0])
    for words in (
        "leave out 17",
        "leave out",
        "leave out x",
        "leave out above",
        "leave out above 1",
        "leave out below 30",
    ):
        with pytest.raises(InputError):
            correct(frf, words)


def of_many_modes(seed, *, damping):
    """Twenty modes over two decades, lines 2.1 % apart: noise of .3 %, a bound of 1.2 %."""
    rng, omega = np.random.default_rng(seed), np.geomspace(0.8, 120, 240)
    own, gain = np.exp(rng.uniform(0, np.log(100), 20)), rng.standard_normal(20)
    values = np.sum(gain * own / (own**2 - omega[:, None] ** 2 + 2j * damping * own * omega[:, None]), axis=1)
    error = rng.standard_normal(omega.size) + 1j * rng.standard_normal(omega.size)
    return rid.FrequencyResponse(omega, values * (1 + 0.003 / np.sqrt(2) * error), bound=0.012 * np.abs(values))


@pytest.mark.parametrize("seeds", [range(1), slow(range(1, 6))])
@pytest.mark.parametrize("damping", [0.003, slow(0.01)])
def test_modes_as_narrow_as_the_lines_are_apart_are_no_noise(damping, seeds):
    """They look like it in their part of the axis: 5 of 6 were told that their bounds are too small.

    Nor are values up to 250 taken for decibels: the largest alone would be all that a model has to follow.
    """
    for seed in seeds:
        frf = of_many_modes(seed, damping=damping)
        large = correct(frf, f"times {250 / np.abs(frf.values).max():.6g}")
        assert response_faults(large if damping == 0.003 else frf) == ()


def test_bounds_that_are_too_small_beside_narrow_modes_are_told():
    small = of_many_modes(0, damping=0.03)
    (fault,) = response_faults(small.with_bound(rid.Bound(0.03 * small.bound.outer_radius, kind="hard"), ""))
    assert fault.kind == "small bound"


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_faults_of_narrow_modes_are_the_same_in_any_unit(seed):
    frf = of_many_modes(seed, damping=0.003)
    assert response_faults(frf) == response_faults(correct(frf, f"times {250 / np.abs(frf.values).max():.6g}")) == ()


def test_of_points_that_were_chosen_out_of_a_judged_response_nothing_is_told():
    omega = np.linspace(1.0, 20.0, 60)
    wrong = rid.FrequencyResponse(omega, np.conj(1 / (100 - omega**2 + 0.2j * omega)))
    assert response_faults(wrong)
    judged = dataclasses.replace(wrong, judged=True).select(slice(None, None, 2))
    assert judged.judged
    assert not response_faults(judged)
