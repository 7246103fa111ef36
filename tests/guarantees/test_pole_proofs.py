"""The proofs of a band over poles: they hold, survive a file, and are worth nothing once they are forged."""

import contextlib
import dataclasses
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import robustid as rid
from robustid.core import load_saved
from support.forging import forge, lower, scaled, some_sides
from support.structure import about_structure


def identified(seed=0):
    data = rid.datasets.flexible_structure(seed=seed, lines=8, samples=2, extra_hz=[17.4, 17.6, 17.7, 17.9])
    return rid.identify(about_structure(data, 0.1, 1.3)), data.modes


def banded(**options):
    result, modes = identified()
    box = modes[:, :1] * [1 - 0.002 / 3, 1.002], modes[:, 1:] * [0.9, 1 + 0.1 / 3]
    return rid.guarantee.worst_case_over_poles(result, *box, omega=[0.0, 30.0], directions=4, cells=4, **options)


@pytest.fixture(scope="module")
def computed():
    return banded()


@pytest.fixture
def saved(computed, tmp_path):
    computed.save(tmp_path / "band")
    return tmp_path / "band"


def test_the_proofs_hold(computed):
    claims = list(computed.claims())
    assert len(computed.kept) >= 2
    assert len(computed.refuted) >= 1
    assert computed.certified
    assert len(claims) == computed.claim_count == 6 * len(computed.kept) + len(computed.refuted)
    assert len({claim.name for claim in claims}) == len(claims)
    assert all(claim.verify() for claim in claims)


def test_the_proofs_hold_in_ball_arithmetic(computed):
    pytest.importorskip("flint", reason="python-flint is not installed: robustid[exact]")
    assert computed.verify(exact=True)


def test_poles_as_stated_are_proved_in_ball_arithmetic_too():
    pytest.importorskip("flint", reason="python-flint is not installed: robustid[exact]")
    error = rid.worst_case_error(identified()[0], omega=[30.0], directions=4)
    assert error.verify(exact=True)
    (value,) = error.values
    tighter = dataclasses.replace(value, support=value.support - 1e-9)
    assert not dataclasses.replace(error, values=(tighter,)).verify(exact=True)
    open_ = dataclasses.replace(value, directions=value.directions[:3], support=value.support[:3])
    assert not dataclasses.replace(error, values=(open_,)).verify()


def same(band, again):
    for name in ("omega", "upper", "magnitude"):
        assert np.array_equal(getattr(again, name), getattr(band, name))
    assert again.summary() == band.summary()
    assert [c.ends.tolist() for c in again.cells] == [c.ends.tolist() for c in band.cells]


def test_round_trip_is_exact_and_verifies_again(computed, saved):
    again = rid.load(saved.with_suffix(".json"))
    same(computed, again)
    assert again.certified
    assert again.claim_count == computed.claim_count
    with pytest.raises(
        rid.errors.FileFormatError, match="kind: error over a pole-uncertainty box; needed is: worst-case error"
    ):
        load_saved(saved, "worst-case error")


@pytest.mark.slow
def test_another_nominal_survives(tmp_path):
    result, _ = identified()
    small = rid.balanced_truncation(result.model, order=4).model
    band = banded(model=small)
    band.save(tmp_path / "band")
    again = rid.load(tmp_path / "band")
    same(band, again)
    assert again.certified
    assert np.array_equal(again.model.A, small.A)


def with_supports(band, by):
    """The band with every side of the polygons of its first cell moved by a part of it, outwards if that is positive."""
    first, *others = band.kept
    values = [dataclasses.replace(v, support=v.support + by * np.abs(v.support)) for v in first.values]
    return dataclasses.replace(band, kept=(dataclasses.replace(first, values=tuple(values)), *others))


def test_polygons_tighter_than_the_proofs_fail_and_wider_ones_hold(computed):
    """Bounds are not stated by themselves: they follow from the polygons."""
    wider, tighter = with_supports(computed, 0.1), with_supports(computed, -1e-4)
    assert np.all(wider.upper >= computed.upper)
    assert np.all(wider.magnitude[:, 1] >= computed.magnitude[:, 1])
    assert wider.verify()
    assert not tighter.verify()
    assert not dataclasses.replace(computed, omega=computed.omega[:1]).verify()


def test_cells_that_leave_out_a_part_of_the_box_fail(computed):
    kept, refuted = computed.kept, computed.refuted
    assert not dataclasses.replace(computed, kept=kept[1:]).covered
    assert not dataclasses.replace(computed, refuted=refuted[1:]).verify()
    assert not dataclasses.replace(computed, kept=()).verify()
    wide = computed.box.omega * [[0.9999, 1.0], [1.0, 1.0]]
    assert not dataclasses.replace(computed, box=dataclasses.replace(computed.box, omega=wide)).verify()


def test_smaller_amplitudes_than_are_stated_fail(computed):
    first, *others = computed.kept
    less = dataclasses.replace(first.cell, amplitude=0.99 * first.cell.amplitude)
    assert not dataclasses.replace(computed, kept=(dataclasses.replace(first, cell=less), *others)).verify()


def about(band, **changes):
    """The same band, of the same answer to another problem."""
    result = band.identification
    formulation = dataclasses.replace(result.formulation, problem=dataclasses.replace(result.problem, **changes))
    return dataclasses.replace(band, identification=dataclasses.replace(result, formulation=formulation))


def test_another_identification_fails(computed):
    assert not dataclasses.replace(computed, identification=identified(1)[0]).verify()
    # Nothing but the data differ: the certificates themselves do not hold.
    other = about(computed, frequency=identified(1)[0].problem.frequency)
    assert other.covered
    assert not all(claim.verify() for claim in other.claims())
    # Without poles there is no box.
    assert not about(other, parametric=None).verify()


def test_a_cell_without_values_has_no_bound(computed):
    first, *others = computed.kept
    open_ = dataclasses.replace(computed, kept=(dataclasses.replace(first, values=()), *others))
    assert np.all(np.isinf(open_.upper))
    np.testing.assert_array_equal(open_.magnitude, np.broadcast_to([0.0, np.inf], computed.magnitude.shape))
    assert open_.verify()


def test_what_no_data_speak_of_is_not_refuted(computed):
    """Halves of the box with amplitudes so large, which is more than is proved, that every line is left out."""
    problem = computed.identification.problem
    halves = [dataclasses.replace(half, amplitude=np.inf * half.amplitude) for half in computed.box.split(problem, 0)]
    assert all(half.relaxed(problem) is None for half in halves)
    band = dataclasses.replace(computed, refuted=(), kept=())
    kept = [dataclasses.replace(computed.kept[0], cell=half, values=()) for half in halves]
    assert dataclasses.replace(band, kept=tuple(kept)).verify()
    claimed = dataclasses.replace(computed.refuted[0], cell=halves[1])
    forged = dataclasses.replace(band, kept=(kept[0],), refuted=(claimed,))
    assert forged.covered
    assert not forged.verify()


def test_open_polygons_prove_nothing(computed):
    """Two of the four sides at 30 rad/s: an interval of the real axis, where values are complex."""
    first, *others = computed.kept
    cell = dataclasses.replace(first, values=(first.values[0], some_sides(first.values[1], [0, 2])))
    assert not dataclasses.replace(computed, kept=(cell, *others)).verify()


def moved(name, mode, end, by):
    def change(arrays):
        ends = arrays[name].copy()
        ends[mode, end] += by * np.ptp(ends[mode])
        return {name: ends}

    return change


VALUES = "kept/0/values/"
FORGERIES = {
    "frequency": lambda a: {"omega": a["omega"] + np.array([0.0, 1.0])},
    "frequency of a cell": lambda a: {VALUES + "omega": a[VALUES + "omega"] + np.array([0.0, 1.0])},
    "support": lower(VALUES + "support"),
    "stated value": lower(VALUES + "certificates/value"),
    "multipliers of a bound": scaled(VALUES + "certificates/samples", 1.001),
    "factors": scaled(VALUES + "certificates/factors", 0.999),
    "level": scaled(VALUES + "certificates/level", 0.5),
    "fewer certificates": lambda a: {VALUES + "certificates/rank": a[VALUES + "certificates/rank"][:-1]},
    "multipliers of a refutation": scaled("refuted/0/certificate/samples", 1.001),
    "matrix of a refutation": scaled("refuted/0/certificate/ball", 0.999),
    "fewer frequencies": lambda a: {"omega": a["omega"][:1]},
    "fewer modes": lambda a: {"kept/0/cell/ends/0": a["kept/0/cell/ends/0"][:1]},
    "fewer multipliers": lambda a: {"refuted/0/certificate/samples": a["refuted/0/certificate/samples"][:-1]},
    "end of a cell": moved("kept/0/cell/ends/0", 1, 0, 1e-6),
    "other end of a cell": moved("kept/0/cell/ends/0", 1, 1, 1e-6),
    "end of a refuted cell": moved("refuted/0/cell/ends/1", 1, 1, -1e-6),
    "end of the box": moved("box/ends/1", 0, 1, 1e-6),
    "not a number": lambda a: {"kept/0/cell/ends/0": a["kept/0/cell/ends/0"] * np.nan},
    "data": lambda a: {
        "identification/problem/frequency/0/values": a["identification/problem/frequency/0/values"] * 1.01
    },
    "amplitudes": scaled("kept/0/cell/amplitudes/0/multipliers", 0.9),
    "centres of amplitudes": scaled("kept/0/cell/amplitudes/0/about", 1.1),
    "points of amplitudes": lambda a: {
        "kept/0/cell/amplitudes/0/points": a["kept/0/cell/amplitudes/0/points"][:, ::-1]
    },
}


@pytest.mark.parametrize("name", FORGERIES)
def test_a_forgery_is_refused_or_does_not_verify(saved, name):
    forge(saved, FORGERIES[name])
    with contextlib.suppress(rid.errors.FileFormatError):
        assert not rid.load(saved).verify()


def stated(value):
    return lambda record: record["refuted"][0]["certificate"].update(value=value)


TEXTS = {
    "nothing kept": lambda record: record.update(kept=[]),
    "the first kept again": lambda record: record.update(kept=2 * record["kept"][:1]),
    "less kept": lambda record: record["kept"].pop(),
    "nothing refuted": lambda record: record.update(refuted=[]),
    "delay": lambda record: record.update(delay=0),
    "number of cells": lambda record: record.update(kept=99),
    "value of a refutation": lambda record: stated(1.01 * record["refuted"][0]["certificate"]["value"])(record),
    "value that refutes nothing": stated(1.0),
    "value that is no number": stated(np.nan),
    "value of another type": stated("1.5"),
}


@pytest.mark.parametrize("name", TEXTS)
def test_forged_text_is_refused_or_does_not_verify(saved, name):
    forge(saved, text=TEXTS[name])
    with contextlib.suppress(rid.errors.FileFormatError):
        assert not rid.load(saved).verify()


def test_an_interrupted_band_goes_on_from_its_folder(computed, tmp_path):
    calls = []

    def interrupt(text, done, count):
        calls.append((done, count))
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        banded(progress=interrupt, resume=tmp_path)
    total = 2 * len(computed.kept)
    assert calls == [(1, total), (2, total), (3, total)]
    done = {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*.npz")}
    assert len(done) == 3
    calls.clear()
    with ThreadPoolExecutor(1) as executor:
        again = banded(progress=lambda text, *at: calls.append(at), resume=tmp_path, executor=executor)
    assert calls[0] == (2, total)
    assert calls[-1] == (total, total)
    same(computed, again)
    assert {p: p.stat().st_mtime_ns for p in done} == done
