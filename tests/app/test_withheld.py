"""What a run keeps out by default, and what it says where that contradicts the band."""

import json

import numpy as np
import pytest

import robustid as rid
from robustid.app.run.kept_out import looked_at, split, split_points
from robustid.app.run.run_file import RunFile
from robustid.app.run.settings import Withheld
from robustid.app.run.sources import Estimate
from robustid.core import ZPlane
from support.cases import slow
from support.families import DT, truth

PERIOD = 40
LINES = np.arange(1, 19)


def record(seed, gain=1.0, periods=2, noise=1e-3):
    """A multisine of its own phases through a plant of some gain, in steady state."""
    rng = np.random.default_rng(seed)
    spectrum = np.zeros(PERIOD // 2 + 1, complex)
    spectrum[LINES] = np.exp(2j * np.pi * rng.uniform(0, 1, LINES.size))
    response = truth(gain, 2 * np.pi * np.arange(PERIOD // 2 + 1) / (PERIOD * DT))
    u, y = (np.tile(np.fft.irfft(s, PERIOD) * PERIOD / 2, periods) for s in (spectrum, spectrum * response))
    return rid.TimeRecord(u, y + noise * rng.standard_normal(y.size), dt=DT, initial="periodic")


def asking(**keys):
    return RunFile(estimate=Estimate(period=PERIOD, method="periodic"), withheld=Withheld(**keys))


@pytest.mark.parametrize(("count", "kept"), [(1, 0), (2, 0), (3, 1), (4, 2), (7, 3)])
def test_half_of_the_records_are_kept_out(count, kept):
    records = [record(k) for k in range(count)]
    run, found = split(asking(), records)
    assert run.withheld.records == kept == len(found.withheld)
    assert [r is one for r, one in zip(found.used, records, strict=False)] == [True] * (count - kept)
    for frf, one in zip(found.withheld, records[count - kept :], strict=True):
        assert np.array_equal(frf.values, rid.estimate_frf(one, period=PERIOD).values)


def test_of_a_single_record_the_last_periods():
    run, found = split(asking(), [record(0, periods=8)])
    assert (run.withheld.periods, found.kind) == (2, "periods")
    assert found.used[0].u.shape[0] == 6 * PERIOD
    assert len(found.withheld) == 1
    assert split(asking(periods=0), [record(0, periods=8)])[1].withheld == ()


def test_stated_numbers_are_kept_and_checked():
    records = [record(k) for k in range(4)]
    assert len(split(asking(records=1), records)[1].withheld) == 1
    assert split(asking(records=0), records)[1].used == records
    with pytest.raises(rid.InputError, match="there are 4 blocks of records, and one at least must be used"):
        split(asking(records=4), records)
    with pytest.raises(rid.InputError, match="the record has 8 of them, and two at least"):
        split(asking(periods=7), [record(0, periods=8)])


def test_dense_frequency_points_are_kept_out():
    frf = rid.FrequencyResponse(np.arange(1.0, 61), np.ones(60), bound=0.1, dt=0.01)
    run, used, out = split_points(asking(), frf)
    assert run.withheld.every == 4
    assert (used.omega.size, out.omega.size) == (45, 15)
    assert split_points(asking(), frf.select(slice(59)))[2] is None
    assert split_points(asking(every=2), frf)[2].omega.size == 30


def test_the_band_is_bounded_at_withheld_frequencies_next_to_the_poles():
    frf = rid.FrequencyResponse(np.arange(1.0, 101), np.ones(100), bound=0.1, dt=0.01)
    grid = looked_at(np.array([0.5]), [0.9 * np.exp(0.4243j)], ZPlane(0.01), [frf])
    assert 0.5 in grid
    assert {1.0, 42.0, 100.0} <= set(grid.tolist())
    assert grid.size == 14


def run_of(folder, gains, **sections):
    lines = []
    for k, gain in enumerate(gains):
        rid.save(folder / f"{k}.npz", record(k, gain))
        lines += [f'[[record]]\nfile = "{k}.npz"\ninitial = "periodic"']
    content = {
        "estimate": {"period": PERIOD},
        "modes": {"hz": []},
        "prior": {"gain_bound": 3.0, "decay_rate": 2.0},
        "worst_case": {"directions": 4, "at_hz": [3 / (PERIOD * DT)]},
    } | sections
    for section, keys in content.items():
        lines += [f"[{section}]", *(f"{key} = {json.dumps(value)}" for key, value in keys.items())]
    (folder / "ask.toml").write_text("\n".join(lines))
    return rid.run(folder / "ask.toml", folder / "out")


@pytest.mark.usefixtures("unreduced")
@pytest.mark.parametrize("twice", [False, slow(True)])
def test_records_of_one_plant_do_not_contradict_and_give_a_probability(tmp_path, twice, request):
    """Twice: its run file gives it again."""
    found = run_of(tmp_path, [1.0] * 4)
    assert found.run_file.withheld.records == 2
    assert not found.contradicted
    assert found.withheld.next_record.probability == 2 / 3
    assert "with probability at least 2/3" in found.summary()
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert found.withheld.judgement.value == "not tested"  # of two periods each
    assert "Not tested by withheld data" in page
    assert "a band three times too narrow could not be told from it" in page
    if twice:
        request.getfixturevalue("unpaged")
        again = rid.run(tmp_path / "out" / "run.toml", tmp_path / "again")
        assert again.findings == found.findings


@pytest.mark.usefixtures("unreduced")
def test_another_plant_contradicts_and_is_said_first(tmp_path):
    found = run_of(tmp_path, [1.0, 1.0, 1.3], withheld={"records": 1})
    assert found.consistent
    assert found.contradicted
    assert "contradicted by withheld data" in repr(found)
    assert found.findings[0].startswith("Contradicted by withheld data: only ")
    assert found.findings[1].startswith("Needed: a band at least ")
    assert "no probability" in found.findings[2]
    claims = [words for words in found.findings if "every consistent system is within" in words.lower()]
    assert len(claims) == 2
    assert all("not about the machine" in words for words in claims)
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "What is guaranteed" not in page
    assert page.index("Contradicted by withheld data") < page.index("keeps all")
