"""Objects of MATLAB classes in v5 files: the properties that are stored, by the names of structures.

Classes are MathWorks' own; what of them is in a file is numbers, texts and cells of the "subsystem", an unnamed variable behind
all others, with a table of classes, names and references. It isn't published; it is read here as the free readers of such files
know it (github foreverallama/matio). Models of the Control System Toolbox hold their numbers in an inner object ``Data_``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import cast

import numpy as np

from robustid.core import Record

REFERENCE = 0xDD000000  # first number of an array that stands for objects
_HEADER = 10  # numbers: version, count of names, beginnings of eight regions
_NAME, _CELL, _FLAG = 0, 1, 2  # kinds of a property: a name, a cell, the number itself
_FIRST_CELL = 2  # behind the table and an empty cell
_MOST = 2000  # objects that are followed in one file
# Names of structures for the stored ones, whose last letter may be "_".
_NAMES = {"Response": "ResponseData", "FreqUnits": "FrequencyUnit", "FreqUnit": "FrequencyUnit", "Delay.Input": "InputDelay",
          "Delay.Output": "OutputDelay", "Delay.IO": "IODelay"}  # fmt: skip
_INNER = ("Data", "lti")  # what stands in these belongs to the object itself
_DEFAULTS: dict[str, Record] = {
    "frd": {"FrequencyUnit": ["rad/TimeUnit"], "TimeUnit": ["seconds"]},
    "idfrd": {"FrequencyUnit": ["rad/TimeUnit"], "TimeUnit": ["seconds"]},
}  # properties that have their default aren't stored


class Subsystem:
    """Properties of the objects of a file, by their numbers.

    `cells` are those of the variable: the table, an empty one, values of properties, and at the end the defaults of every
    class. ValueError, IndexError: a table that doesn't fit together.
    """

    def __init__(self, cells: Sequence[object], order: str) -> None:
        table = np.ascontiguousarray(cells[0]).reshape(-1).view(np.uint8).tobytes()
        header = np.frombuffer(table, f"{order}u4", _HEADER)
        begins = [int(at) for at in header[2:]]
        if sorted(begins) != begins or begins[0] < 4 * _HEADER or begins[-1] > len(table):
            raise ValueError("the regions of the table of objects overlap")
        words = table[4 * _HEADER : begins[0]].split(b"\0")[: int(header[1])]
        self.names = [word.decode("utf-8", "replace") for word in words]
        region = [np.frombuffer(table[a:b], f"{order}u4") for a, b in pairwise(begins)]
        self.classes = [self._name(int(row[1])) for row in region[0].reshape(-1, 4)]
        self.objects = region[2].reshape(-1, 6)
        self.saved, self.plain = _blocks(region[1]), _blocks(region[3])
        self.cells, self.followed = cells, 0

    def _name(self, index: int) -> str:
        return self.names[index - 1] if index else ""

    def properties(self, number: int) -> Record:
        """The stored properties of an object, those of objects in it included."""
        self.followed += 1
        if not 0 < number < len(self.objects) or self.followed > _MOST:
            raise ValueError("an object refers to none, or to too many")
        kind, _, _, saved, plain, _ = (int(value) for value in self.objects[number])
        found: Record = dict(_DEFAULTS.get(self.classes[kind].rpartition(".")[2], {}))
        for name, how, value in self.saved[saved] if saved else self.plain[plain]:
            found[self._name(name)] = self._value(how, value)
        return found

    def _value(self, how: int, value: int) -> object:
        if how == _NAME:
            return [self._name(value)]
        return self.of_reference(self.cells[_FIRST_CELL + value]) if how == _CELL else np.array([[value]])

    def of_reference(self, value: object) -> object:
        """The properties of the object that an array of numbers stands for; several are a tuple; anything else as it is."""
        if not isinstance(value, np.ndarray):
            return value
        array = cast("np.ndarray", value)
        numbers: list[int] = array.ravel(order="F").tolist() if array.dtype.kind == "u" and array.size > 3 else [0]
        if numbers[0] != REFERENCE:
            return array
        ids = numbers[2 + numbers[1] : -1]
        return self.properties(ids[0]) if len(ids) == 1 else tuple(self.properties(one) for one in ids)


def _blocks(words: np.ndarray) -> list[list[tuple[int, int, int]]]:
    """Lists of name, kind and value; each is as long as it says, filled up to an even count."""
    found: list[list[tuple[int, int, int]]] = []
    at = 0
    while at < len(words):
        count = int(words[at])
        rows = words[at + 1 : at + 1 + 3 * count].reshape(-1, 3)
        if len(rows) != count:
            raise ValueError("a list of properties is cut off")
        found.append([(int(a), int(b), int(c)) for a, b, c in rows])
        at += 1 + 3 * count + (1 + 3 * count) % 2
    return found


def plain(properties: Mapping[str, object]) -> Record:
    """The same by the names that structures have: inner objects opened, cells of one thing replaced by it."""
    found: Record = {}
    for name, value in properties.items():
        name = name.removesuffix("_")
        while isinstance(value, tuple) and len(cast("tuple[object, ...]", value)) == 1:
            value = cast("tuple[object, ...]", value)[0]
        if isinstance(value, Mapping):
            inner = plain(cast("Mapping[str, object]", value))
            if name in _INNER:
                found = {**found, **inner}
            else:
                found.update({_NAMES.get(f"{name}.{key}", f"{name}.{key}"): one for key, one in inner.items()})
        else:
            found[_NAMES.get(name, name)] = value
    return found
