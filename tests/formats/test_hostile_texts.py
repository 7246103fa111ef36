"""Hostile tables of text, addresses and models: a sentence or data, in time and memory that grow with the file."""

import time

import numpy as np
import pytest

from robustid import load
from robustid.errors import InputError, RobustIdError
from robustid.formats import contents
from robustid.formats.addresses import axis_names, parse, taken
from support.cases import slow
from support.foreign_files import matlab5

LONG = 300_000
TEXTS = {
    "spaces in a name": "a" + " " * LONG + "b,u,y\n0,1,2\n1,2,3\n",
    "spaces in a cell": "t,u,y\n0,1" + " " * LONG + "x,2\n1,2,3\n",
    "digits": "t,u,y\n0," + "1" * LONG + ",2\n1,2,3\n",
    "digits and a letter": "t,u,y\n0," + "1" * LONG + "j),2\n1,2,3\n",
    "brackets": "[" * LONG + ",u,y\n0,1,2\n",
    "colons": "x[" + ":" * LONG + ",u,y\n0,1,2\n",
    "signs": "t,u,y\n" + "+-" * LONG + ",1,2\n0,1,2\n",
    "separators": ("," * LONG + "\n") * 3,
    "marks of every kind": "\t;|, \n" * (LONG // 5),
    "quotes": 't,u,y\n"' + '""' * LONG + "\n0,1,2\n",
    "equal names": "u," * 3_000 + "u\n" + "1," * 3_000 + "1\n",
    "many names": ",".join(f"a{k}" for k in range(3_000)) + "\n" + "1," * 2_999 + "1\n",
    "remarks": "# u\n" * (LONG // 4),
    "lines of one": "1\n" * (LONG // 8),
    "decibels": "Freq.\tV\n1.0\t(9.0e99dB,1.0e99°)\n2.0\t(1.0dB,1.0e400°)\n3.0\t(1.0e400dB,1.0°)\n",
    "units": "u,y\n" + "[" * 1000 + "," + "(" * 1000 + "\n1,2\n",
}


def refusal(call, *arguments, **options):
    """The sentence of one of our errors, "" where there is none."""
    try:
        call(*arguments, **options)
    except RobustIdError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("name", TEXTS)
def test_texts_take_time_in_proportion_to_their_length(tmp_path, name):
    """A few seconds would do for any of them, 0.3 to 0.6 MB long; what is quadratic in the length takes minutes."""
    path = tmp_path / "hostile.csv"
    path.write_text(TEXTS[name])
    before = time.process_time()
    for call in (contents, load, lambda p: load(p, fields={"u": "[:,0]", "y": "[:,1]"}, dt=1.0)):
        assert len(refusal(call, path)) < 6000
    assert time.process_time() - before < 10


@pytest.mark.parametrize("count", [50, slow(150)])
def test_random_tables_are_read_or_refused(tmp_path, count):
    """Cells and separators in any order, seeded, in one file of two mostly numbers: nothing but our own errors."""
    rng, path, refused = np.random.default_rng(5), tmp_path / "random.txt", 0
    numbers = ["1", "2.5", "-3e-2", "0.5", "7", "-1"]
    others = ["1,5", "1+2i", "nan", "t", "u [V]", "Hz", '"', "#", "%", "*", "[", "(", ":", "", "é", "\x0b"]
    for k in range(count):
        marks = rng.choice([",", ";", "\t", " ", "|"], 1 if k % 2 else 3)
        strange = 0.02 if k % 2 else 0.5
        lines = [
            "".join(f"{rng.choice(others if rng.random() < strange else numbers)}{rng.choice(marks)}" for _ in range(3))
            for _ in range(int(rng.integers(1, 12)))
        ]
        path.write_text("\n".join(lines), encoding=str(rng.choice(["utf-8", "utf-16"])))
        for options in ({}, {"fields": {"u": "[:,0]", "y": "[:,-1]"}, "dt": 1.0}, {"decimal": ","}):
            refused += refusal(load, path, **options) != ""
    assert 2 * count < refused < 2.8 * count


def test_random_addresses_and_axes():
    """Every text is a part of the array, as NumPy takes it, or refused."""
    rng, array = np.random.default_rng(6), np.arange(24.0).reshape(4, 3, 2)
    letters = [*"x[]:,.-+0123 9", "...", "time", "signal"]
    read = 0
    for _ in range(4000):
        text = "".join(rng.choice(letters, int(rng.integers(1, 12))))
        try:
            address = parse(f"x[{text}]")
            read += address is not None and taken("x", address.parts, array).size > 0
            axis_names(text)
        except InputError:
            continue
    assert read > 200
    assert parse("x" + "[" * LONG) is None
    assert parse("x" + " " * 2000 + "[") is None


@pytest.mark.parametrize(
    ("variables", "sentence"),
    [
        ({"z": np.zeros((0, 1)), "p": -np.ones((10**5, 1)), "k": 1.0}, "too large; at most 2000"),
        ({"num": [[1.0]], "den": np.ones((1, 10**5))}, "too large; at most 2000"),
        ({"num": [[1.0]], "den": np.zeros((1, 3))}, "the denominator is zero"),
        ({"num": np.ones((1, 3)), "den": [[1.0]]}, "a model is proper"),
        ({"z": [[np.inf]], "p": [[-1.0]], "k": 1.0}, "must be finite"),
    ],
)
def test_models_that_cannot_be(tmp_path, variables, sentence):
    with pytest.raises(RobustIdError, match=sentence):
        load(matlab5(tmp_path / "g.mat", variables))
