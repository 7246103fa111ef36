"""What a bound is about: mean or next record, from how many excitations, and that this is said and kept."""

import numpy as np
import pytest

import robustid as rid
from robustid.errors import InputError
from robustid.report import render_report

PERIOD, DT = 128, 0.01


def records(count, *, periods=4, lines="all", scatter=0.0, noise=0.01, seed=0):
    """A plant of gain 2 whose output holds something else in every realisation, at the excited lines and between them."""
    design = {"band_hz": (3, 40), "period": PERIOD, "dt": DT, "spacing": lines, "minimise_crest": False, "rms": 1.0}
    play = rid.prepare.multisine(**design, realisations=count, seed=seed)
    rng = np.random.default_rng(seed)
    made = []
    for u in play.u:
        y = np.tile(2 * u + scatter * rng.standard_normal(u.shape), (periods, 1))
        y += noise * rng.standard_normal(y.shape)
        made.append(rid.TimeRecord(np.tile(u, (periods, 1)), y, dt=DT, initial="periodic"))
    return made


def test_words_and_lead_say_what_a_bound_is_about():
    one = rid.Bound(0.1, kind="confidence", probability=0.95, excitations=1)
    assert one.words() == "confidence bound of the mean response, 95 % jointly, from one excitation"
    assert "variation of the plant was not measured" in one.about
    several = rid.Bound(0.1, kind="tolerance", probability=0.9, excitations=3)
    assert several.words() == "tolerance bound of the next record, 90 % jointly, from 3 independent excitations"
    assert several.about == "This is about the response in the next record, judged by 3 independent excitations."
    assert rid.Bound(0.1).about == rid.Bound(0.1, kind="confidence", probability=0.95).about == ""
    assert "noise without excitation" in rid.Bound(0.1, kind="noise_floor", excitations=2).about
    for count in (1, 3):
        changing = rid.Bound(0.1, kind="confidence", probability=0.9, excitations=count, caveats=("changing",)).about
        assert changing.endswith(
            "Halves of the measurement differ beyond chance: the plant changed, and the bound holds what they differ by."
        )


def test_the_bound_of_the_next_record_knows_what_changes():
    made = records(6, scatter=0.2)
    mean, following = (rid.estimate_frf(made, period=PERIOD, about=about) for about in ("mean", "next record"))
    np.testing.assert_array_equal(mean.values, following.values)
    # Variances 1/6 and 1 + 1/6 of what changes from record to record; the noise is 1/400 of it.
    np.testing.assert_allclose(following.bound / mean.bound, np.sqrt(7), rtol=0.02)
    assert (mean.bound.kind, following.bound.kind, mean.bound.excitations) == ("confidence", "tolerance", 6)
    # Five of a line alone; what its neighbours add is counted from how well they tell its variance, not taken for certain.
    assert mean.bound.dof > 1.5 * 5
    said = "tolerance bound of the next record, 95 % jointly, from 6 independent excitations"
    assert following.bound.words().startswith(said)


def test_where_nothing_changes_the_next_record_is_as_sure_as_noise_allows():
    """Six realisations without distortion: their own scatter is noise, and would be 2.6 times as wide; less than half of that."""
    made = records(6, noise=0.1)
    mean, following = (rid.estimate_frf(made, period=PERIOD, about=about) for about in ("mean", "next record"))
    assert "no distortion seen" in mean.note
    assert 1 < np.median(following.bound / mean.bound) < 1 + (np.sqrt(7) - 1) / 2


def test_one_excitation_says_nothing_of_the_next_record():
    """All lines up to the edge of the axis are excited: nothing shows distortion."""
    play = rid.prepare.multisine(lines=np.arange(1, PERIOD // 2), period=PERIOD, dt=DT)
    u = np.tile(play.u[0], (4, 1))
    y = u + 0.01 * np.random.default_rng(0).standard_normal(u.shape)
    record = rid.TimeRecord(u, y, dt=DT, initial="periodic")
    assert rid.estimate_frf(record, period=PERIOD).bound.excitations == 1
    with pytest.raises(InputError, match='`about` = "next record": one excitation does not show what changes'):
        rid.estimate_frf(record, period=PERIOD, about="next record")
    with pytest.raises(InputError, match='`about` = "next record"'):
        rid.estimate_frf(record, method="local", about="next record")
    with pytest.raises(InputError, match="`about` must be one of \\('mean', 'next record'\\); got 'median'"):
        rid.estimate_frf(record, period=PERIOD, about="median")


def test_whatever_rests_on_one_excitation_says_so_first():
    frf = rid.estimate_frf(records(1, lines="odd", scatter=0.2), period=PERIOD).select([0, 5, 11])
    result = rid.identify(rid.MixedProblem(frequency=frf, prior=rid.Prior(gain_bound=4.0, decay_rate=1.5)))
    said = "variation of the plant was not measured"
    assert said in result.summary().splitlines()[2]
    error = rid.worst_case_error(result, omega=[100.0], directions=4)
    page = render_report(result, worst_case=error)
    assert page.index(said) < page.index("Consistency margin</h2>")
    assert page.count(said) >= 2  # above everything, and before the guarantee
    assert said in render_report(frf)
    assert any(said in words for words in rid.identify_reduced(frf, modes=[], worst_case=False).findings[:2])
