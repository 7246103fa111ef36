"""Recorded numbers of small problems of all kinds, compared with what the package gives now: proof that none moved.

Run: python benchmarks/recorded.py record [NAME ...]       # replaces benchmarks/recorded/NAME.json
     python benchmarks/recorded.py compare [NAME ...]      # exit code 1 where something differs
     python benchmarks/recorded.py compare --limit 1e-6    # on another machine, whose libraries round otherwise
--quick: those that the suite runs every time.

Each problem is a function in `recorded_problems/` that returns named numbers, arrays and texts. One machine gives the
same bits: a value passes if it is identical, or where the problem names it as `near`, within 1e-9. Differences are
relative to the largest number of the array (to 1e-6 where that is smaller: so small are rounding errors). With a limit
texts are the same to the letter apart from numbers with a decimal point or an exponent: those within one unit of their
last digit, or both below 1e-6, are rounded otherwise; further ones are compared like numbers. Texts are kept without
what belongs to one run: folder, versions, dates, digests, seconds and the lines of progress.
"""

import argparse
import contextlib
import json
import os
import re
import sys
import tempfile
import time
import warnings
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: the same sums in the same order
os.environ.setdefault("OPENBLAS_CORETYPE", "Haswell")  # on processors with wider instructions too
os.environ.setdefault("MPLBACKEND", "Agg")
sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parent)]  # the package beside this file

import numpy as np  # noqa: E402
from recorded_problems import PROBLEMS  # noqa: E402
from recorded_problems.registry import table_of  # noqa: E402

FOLDER = Path(__file__).parent / "recorded"
NEAR = 1e-9
_SMALL = 1e-6  # numbers below are compared as parts of it
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+(?:e[-+]?\d+)?|e[-+]?\d+)")
_SUPERSCRIPTS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")


def computed(name):
    """The table of a problem, made in an empty folder, as JSON gives it back."""
    with tempfile.TemporaryDirectory() as place, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # they are recorded where they are said
        folder = Path(place).resolve()
        with contextlib.chdir(folder):
            table = table_of(PROBLEMS[name].function(folder), folder)
    return json.loads(json.dumps(table))


def path_of(name):
    return FOLDER / f"{name}.json"


def write(name, table):
    """One value a line; floats are printed so that they come back to the bit."""
    lines = (
        f"{json.dumps(key)}:{json.dumps(value, separators=(',', ':'), ensure_ascii=False)}"
        for key, value in table.items()
    )
    path_of(name).write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


def differences(name):
    """{value: difference}: 0 is identical, inf where two values don't compare or one side has none."""
    old, new = json.loads(path_of(name).read_text(encoding="utf-8")), computed(name)
    return {key: difference(old[key], new[key]) if key in old and key in new else np.inf for key in old | new}


def failures(name, found, limit=0.0):
    """Sentences, one for every difference above its limit."""
    sentences = []
    for key, away in found.items():
        near, loose = (any(part in key for part in parts) for parts in (PROBLEMS[name].near, PROBLEMS[name].loose))
        if away > (max(limit, NEAR) if near else limit) and not (loose and limit):
            sentences.append(f"{key}: {'differs' if np.isinf(away) else f'relative difference {away:.2g}'}")
    return sentences


def difference(old, new):
    """0 where two values are identical; else how far they are apart; inf where they don't compare."""
    if type(old) is not type(new):
        return np.inf
    if isinstance(old, dict):
        same = old["shape"] == new["shape"] and len(old["values"]) == len(new["values"])
        return _apart(old["values"], new["values"]) if same else np.inf
    if isinstance(old, float):
        return _apart([old], [new])
    if isinstance(old, str):
        return _text_apart(old, new)
    return 0.0 if old == new else np.inf


def _apart(old, new):
    """Largest difference over the largest number; what is not finite is the same in both."""
    old, new = np.array(old, float), np.array(new, float)
    if np.array_equal(old, new, equal_nan=True):
        return 0.0
    finite = np.isfinite(old)
    if not np.array_equal(old[~finite], new[~finite], equal_nan=True) or not np.all(np.isfinite(new[finite])):
        return np.inf
    old, new = old[finite], new[finite]
    return float(np.abs(old - new).max() / max(np.abs(old).max(), _SMALL))


def _text_apart(old, new):
    """0 if two texts are the same, inf if words or whole numbers differ, else the distance of their numbers."""
    if old == new:
        return 0.0
    old, new = (
        re.sub("×10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)", lambda m: "e" + m[1].translate(_SUPERSCRIPTS), text) for text in (old, new)
    )
    if _words(old) != _words(new):
        return np.inf
    pairs = zip(_NUMBER.findall(old), _NUMBER.findall(new), strict=True)
    return max((_number_apart(*pair) for pair in pairs), default=NEAR / 2)


def _words(text):
    """Without numbers, and without the blanks that fill a table up to its width."""
    return re.sub(r"[ ─]+", " ", _NUMBER.sub("#", text))


def _number_apart(old, new):
    """Distance of two printed numbers beyond one unit of the last digit of the longer one; none of two small ones."""
    a, b, unit = float(old), float(new), min(_unit(old), _unit(new))
    beyond = 0.0 if max(abs(a), abs(b)) < _SMALL else max(abs(a - b) - 1.01 * unit, 0.0)
    return max(beyond / max(abs(a), _SMALL), NEAR / 2)


def _unit(number):
    mantissa, _, exponent = number.partition("e")
    return 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))


def record(names):
    FOLDER.mkdir(exist_ok=True)
    for name in names:
        start = time.process_time()
        table = computed(name)
        write(name, table)
        print(f"{name:28}{len(table):6} values{time.process_time() - start:8.2f} s", flush=True)
    size = sum(path.stat().st_size for path in FOLDER.glob("*.json"))
    print(f"{len(names)} problems recorded; {size / 1e3:.0f} kB in all")
    return 0


def compare(names, limit):
    """One line a problem, its differences below it, and a total."""
    total, failed = np.zeros(4, int), 0
    for name in names:
        start = time.process_time()
        try:
            found = differences(name)
        except Exception as error:  # what a change broke is a difference
            found = {f"raised {type(error).__name__}: {error}": np.inf}
        away, wrong = np.array(list(found.values())), failures(name, found, limit)
        counts = np.array([away.size, np.sum(away == 0), np.sum((away > 0) & (away <= NEAR)), len(wrong)])
        total, failed = total + counts, failed + bool(wrong)
        print(_line(name, counts), f"{time.process_time() - start:7.2f} s", flush=True)
        for sentence in wrong or [f"{key}: {one:.2g}" for key, one in found.items() if one]:
            print(f"    {sentence}")
    print(_line(f"{len(names)} problems, {failed} differ", total))
    return int(failed > 0)


def _line(name, counts):
    values, same, near, wrong = counts
    return f"{name:28}{values:6} values,{same:6} identical,{near:5} within {NEAR:.0e},{wrong:5} differ"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("record", "compare"))
    parser.add_argument("names", nargs="*", metavar="NAME", help="problems; default: all")
    parser.add_argument("--quick", action="store_true", help="those that the suite runs every time")
    parser.add_argument(
        "--limit", type=float, default=0.0, help="relative difference that passes everywhere; default: 0"
    )
    asked = parser.parse_intermixed_args()
    if unknown := set(asked.names) - set(PROBLEMS):
        parser.error(f"no problem is called {', '.join(sorted(unknown))}; there are {', '.join(PROBLEMS)}")
    names = asked.names or [name for name, one in PROBLEMS.items() if one.quick or not asked.quick]
    return record(names) if asked.what == "record" else compare(names, asked.limit)


if __name__ == "__main__":
    sys.exit(main())
