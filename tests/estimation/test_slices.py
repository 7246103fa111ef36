"""Parts of measured records, one input and one output of them: no fault is told that these machines do not have."""

import numpy as np
import pytest

import robustid as rid
from robustid.data import FaultKind
from support.cases import slow
from support.measured import realdata

pytestmark = realdata
# What is there: mains and few steps of a converter on the beam, and an accelerometer that drifts below 1 Hz (by 17 % of the rms of
# one slice, 16 deviations); a machine that was measured in a loop; a dryer that warms up (7.5 deviations over the whole record, up
# in both halves); entries that one of several inputs hides, where it alone is kept; settings that slices lose.
THERE = {
    "two_mass": {
        FaultKind.JUMP,
        FaultKind.SPIKE,
        FaultKind.UNSTATED_PERIOD,
        FaultKind.NOISE_ONLY,
        FaultKind.SMALL_BOUND,  # samples 24501 to 27852: off by up to 7 bounds between 4 and 11 Hz, and by up to 31
    },
    "beam_ring": {FaultKind.TONE, FaultKind.QUANTISED, FaultKind.UNSTATED_PERIOD, FaultKind.DRIFT},
    "fsm": {FaultKind.NO_RESPONSE},
    "fsm_200mV/test": {FaultKind.NO_RESPONSE},
    "cdplayer": {FaultKind.FEEDBACK, FaultKind.NO_RESPONSE},
    "hairdryer": {FaultKind.DRIFT},
}
# Set, samples, output, input, every so many samples; and what was told of it before. In the suite one of every kind of fault.
ONCE = [
    ("beam_ring", (32156, 36475), 0, 1, 2),  # exchanged, and tones: modes that ring on from the sweep before
    ("beam_ring", (90165, 91007), 1, 1, 4),  # early
    slow(("two_mass", (8330, 8878), 0, 0, 2), id="two_mass-8330-0"),  # a seam, where a resonance is between two lines
    slow(("two_mass", (18200, 18660), 1, 0, 1), id="two_mass-18200-1"),  # early
    ("two_mass", (253, 3821), 1, 0, 4),  # feedback, where an input was decimated
    ("fsm", (10861, 11321), 2, 1, 2),  # a tone at a mode
    slow(("fsm_200mV/test", (8555, 15115), 2, 2, 4), id="fsm_200mV/test-8555-2"),  # feedback, after decimation
    ("cdplayer", (227, 913), 0, 0, 1),  # a seam of less than a bound
    slow(("fsm", (10861, 11321), 1, 1, 1), id="fsm-10861-1"),  # a line off by less than its bound and those beside it
    ("fsm", (1316, 2018), 2, 2, 1),  # such a line, whose own small bound was taken for one of those beside it
    slow(
        ("fsm", (9914, 10864), 1, 2, 2), id="fsm-9914-1"
    ),  # a wrong sign of the phase, by 17 lines of overlapping windows
    slow(
        ("beam_ring", (34367, 34714), 1, 1, 2), id="beam_ring-34367-1"
    ),  # decibels, where no line says more than its bound
    slow(("fsm_200mV/test", (4372, 7635), 1, 1, 4), id="fsm_200mV/test-4372-1"),  # decibels, of magnitudes below 1
    slow(
        ("two_mass", (25774, 27911), 1, 0, 1), id="two_mass-25774-1"
    ),  # feedback, where lines of the multisine begin at 11 Hz
    slow(("two_mass", (15085, 18871), 1, 0, 1), id="two_mass-15085-1"),  # varying: fewer poles found for both halves
    slow(("two_mass", (29155, 37141), 0, 0, 1), id="two_mass-29155-0"),  # lost samples, by such a search
    ("cdplayer", (174, 631), 0, 1, 1),  # a clock, by such a search
    slow(("two_mass", (24590, 46892), 1, 0, 1), id="two_mass-24590-1"),  # late, where shorter delays leave less
    slow(("cdplayer", (118, 774), 0, 0, 1), id="cdplayer-118-0"),  # a seam of less than the bounds of both windows
    (
        "cdplayer",
        (867, 1274),
        1,
        1,
        1,
    ),  # a wrong sign of the phase, by as many unknowns as overlapping windows tell numbers
    ("cdplayer", (1248, 1583), 1, 1, 1),  # decibels, of which one value makes all others small
    slow(("two_mass", (10925, 49538), 1, 0, 1), id="two_mass-10925-1"),  # early, where one search found no poles
    slow(("beam_ring", (50769, 63439), 0, 0, 1), id="beam_ring-50769-0"),  # early, of a sweep
    ("cdplayer", (653, 1093), 1, 0, 1),  # a drift that is the answer to one of the input
    slow(("beam_ring", (20019, 86493), 1, 0, 1), id="beam_ring-20019-1"),  # stuck, in a quiet part of the sweep
]


def faults(name, samples, output, input, every):
    records = rid.datasets.load(name)
    one = records if isinstance(records, rid.TimeRecord) else records[0]
    inside = slice(*samples)
    part = rid.TimeRecord(one.u[inside, input], one.y[inside, output], dt=one.dt, initial="free")
    frf = rid.estimate_frf(part if every == 1 else rid.prepare.decimate(part, every))
    return [*frf.faults, *rid.prepare.response_faults(frf)]


def told(*slice_):
    """Kinds of faults of a slice."""
    return {fault.kind for fault in faults(*slice_)}


@pytest.mark.parametrize("slice_", ONCE, ids=lambda slice_: f"{slice_[0]}-{slice_[1][0]}-{slice_[2]}")
def test_of_what_was_told_before_only_what_is_there_is_left(slice_):
    assert told(*slice_) <= THERE[slice_[0]]


def test_the_first_mode_of_the_beam_rings_and_is_no_tone():
    """It was the larger one of two tones, of 23 % of the rms; the mains are of 3 %."""
    (tone,) = faults("beam_ring", (85629, 90157), 1, 1, 1)
    assert tone.kind is FaultKind.TONE
    assert tone.size < 0.05


@pytest.mark.slow
@pytest.mark.parametrize("seed", [7, 8])
def test_of_a_hundred_slices_at_most_two_are_told_of_a_fault_that_is_not_there(seed):
    wrong = []
    for k in range(100):
        rng = np.random.default_rng([seed, k])
        name = str(rng.choice(list(THERE)))
        records = rid.datasets.load(name)
        one = records if isinstance(records, rid.TimeRecord) else records[0]
        length = int(np.exp(rng.uniform(np.log(300), np.log(len(one.u)))))
        start = int(rng.integers(0, len(one.u) - length + 1))
        every = int(rng.choice([1, 1, 2, 4, 8]))
        every = every if length // every >= 150 else 1
        where = int(rng.integers(one.y.shape[1])), int(rng.integers(one.u.shape[1]))
        try:
            found = told(name, (start, start + length), *where, every)
        except rid.InputError:  # its input rests
            continue
        if not found <= THERE[name]:
            wrong.append((name, start, length, *where, every, found))
    assert len(wrong) <= 2, wrong
