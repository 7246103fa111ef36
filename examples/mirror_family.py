"""Measured data: a fine steering mirror at two amplitudes as one family, and a band that records which nobody used keep to.

The piezos aren't linear: at two thirds of the voltage the mirror is another plant, and every record of random phases shows a
slightly different one. Each amplitude is a member with its own data and proof, bounded for the next record; the band of the
family holds both. It is tested against all records of both, those that were kept out too, at lines that were used and at
others. The poles are those of the whole machine: the nine entries together show modes that one of them, bounded for the next
record, does not tell apart.
Data: github merijnfloren/fsm-benchmark-data (CC BY 4.0; Floren et al., ISMA-USD 2024), downloaded once, or from the folder
that ROBUSTID_DATA names.
Run: python mirror_family.py --out folder (30 s of computation, and 50 s an entry of the diagonal; --entries 0 1 2 for all three,
--frequencies 16 for a fifth of the band)
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

import robustid as rid
from robustid.errors import DatasetNotFoundError

VOLTS = {0.2: "fsm_200mV", 0.3: "fsm"}
PERIOD = 8192
THINNED = 16  # every so manieth line shows the modes
MODES, DELAY = 14, 1  # up to 3.2 kHz, as many as `suggest_kautz` finds at 300 mV in the mean of all entries; samples
USED, BOUNDED = 56, 80  # lines in the identification, and frequencies of the band: the others test what is between
DECAY = 1.1
DIRECTIONS, RTOL = 6, 0.4


def responses():
    """By voltage: the mean of the training records; these bounded for the next one; their two blocks alone; the block kept out."""
    mean, training, blocks, tests = {}, {}, {}, {}
    for volts, name in VOLTS.items():
        train, test = rid.datasets.load(f"{name}/train"), rid.datasets.load(f"{name}/test")
        training[volts] = rid.estimate_frf(train, period=PERIOD, about="next record")
        mean[volts], first, second, tests[volts] = (
            rid.estimate_frf(block, period=PERIOD) for block in (train, train[:3], train[3:], test)
        )
        blocks[volts] = [first, second]
    return mean, training, blocks, tests


def one_entry(of_volts, entry):
    """The same, of one entry of the diagonal."""
    return {
        volts: [frf.entry(entry, entry) for frf in of] if isinstance(of, list) else of.entry(entry, entry)
        for volts, of in of_volts.items()
    }


def chosen_lines(frf, modes):
    """Three lines at every mode and others over the whole band; then frequencies between them, where nothing was used."""
    hz, width = modes.omega[:, None] / (2 * np.pi), modes.damping[:, None] * np.array([-1.5, 0.0, 1.5])
    near = np.searchsorted(frf.freq_hz, (hz * (1 + width)).ravel()).clip(0, frf.omega.size - 1)
    wide = np.linspace(20, frf.omega.size - 20, USED - np.unique(near).size).astype(int)
    used = np.union1d(near, wide)
    middles = (used[1:] + used[:-1]) // 2
    between = middles[np.linspace(0, middles.size - 1, BOUNDED - used.size).astype(int)]
    return used, np.union1d(used, between)


def suggested(mean):
    """By voltage the modes of all entries: they are softer where the mirror moves more."""
    modes = {}
    for volts, frf in mean.items():
        modes[volts] = rid.suggest_kautz(frf.select(slice(None, None, THINNED)), modes=MODES, delay=DELAY)
        print(f"{1000 * volts:g} mV: modes at {', '.join(f'{hz:.4g}' for hz in modes[volts].omega / (2 * np.pi))} Hz")
    return modes


def family_of(training, modes, used, bounded):
    """One member a voltage, each with its own poles, all in one class; and their family."""
    first = training[max(training)]
    prior = rid.Prior(gain_bound=2 * float(np.median(np.abs(first.values))), decay_rate=DECAY)
    members = []
    for volts, frf in training.items():
        problem = rid.MixedProblem(frequency=frf.select(used), prior=prior, parametric=modes[volts].basis)
        result = rid.identify(problem)
        print(f"   {1000 * volts:g} mV: {result.status.name.lower()}, margin {result.margin:.3f}")
        members.append(rid.guarantee.Member(result, f"{1000 * volts:g} mV", amplitude=volts))
    omega = first.omega[bounded]
    return rid.family(members, omega=omega, directions=DIRECTIONS, rtol=RTOL, interval=(0.15, 0.3))


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="folder for pictures and pages (default: a temporary one)")
    parser.add_argument("--entries", type=int, nargs="+", default=[0], choices=range(3), help="entries of the diagonal")
    parser.add_argument("--frequencies", type=int, default=BOUNDED, help=f"of the band, at most (default: {BOUNDED})")
    arguments = parser.parse_args(argv)
    try:
        mean, *measured = responses()
    except DatasetNotFoundError as missing:
        print(f"This example needs measured data. {missing}")
        return
    out = arguments.out or Path(tempfile.mkdtemp(prefix="robustid-"))
    out.mkdir(parents=True, exist_ok=True)
    modes = suggested(mean)
    for entry in arguments.entries:
        training, blocks, tests = (one_entry(of_volts, entry) for of_volts in measured)
        first = training[0.3]
        print(f"\nEntry {entry + 1}, {entry + 1} of 3 x 3, {first.omega.size} lines. {first.bound.about}")
        used, bounded = chosen_lines(first, modes[0.3])
        every = -(-bounded.size // arguments.frequencies)
        bounded = np.union1d(used[::every], np.setdiff1d(bounded, used)[::every])
        family = family_of(training, modes, used, bounded)
        print(family.summary())
        size = np.abs(family.nominal)
        for words, part in (("used lines", used), ("between them", np.setdiff1d(bounded, used))):
            mine = np.isin(bounded, part)
            print(
                f"   band at {words}: {100 * np.median(family.upper[mine, 0, 0] / size[mine]):.3g} % of the response (median)"
            )
        for volts, used_blocks in blocks.items():
            share = rid.coverage(family, used_blocks).share
            print(
                f"   {1000 * volts:g} mV: {100 * share:.4g} % of the samples of both blocks that were used are inside, one by one"
            )
        withheld = rid.coverage(family, list(tests.values()), names=[f"test, {1000 * volts:g} mV" for volts in tests])
        print(f"   {withheld.verdict}")
        family.plot().savefig(out / f"band_{entry + 1}.png", dpi=110)
        rid.plot.schedule(family).savefig(out / f"amplitude_{entry + 1}.png", dpi=110)
        rid.write_report(family, out / f"family_{entry + 1}.html", withheld=withheld, title="Mirror at two amplitudes")
    print(f"\nPictures and pages: {out}")


if __name__ == "__main__":
    main()
