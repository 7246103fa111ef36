"""Shared by the tests: objects of MATLAB classes in v5 files, as the free readers of such files describe them."""

import struct
from typing import NamedTuple

import numpy as np

MAGIC = 0xDD000000


class Thing(NamedTuple):
    """An object: its class, and the properties that are stored."""

    kind: str
    properties: dict


def element(kind, data):
    return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)


def head(code, shape, name, flags=0):
    return (
        element(6, struct.pack("<II", code | flags, 0))
        + element(5, struct.pack(f"<{len(shape)}i", *shape))
        + element(1, name.encode())
    )


def matrix(value, name="", refer=None):
    """A variable: numbers, text, list (a cell), dict (a structure of one), or an object by `refer`."""
    if isinstance(value, Thing):
        numbers = element(6, np.array(refer(value), "<u4").tobytes())
        body = element(6, struct.pack("<II", 17, 0)) + element(1, name.encode()) + element(1, b"MCOS")
        content = element(14, head(13, (6, 1), "") + numbers)
        return element(14, body + element(1, value.kind.encode()) + content)
    if isinstance(value, dict):
        names = b"".join(field.encode().ljust(32, b"\0") for field in value)
        body = head(2, (1, 1), name) + struct.pack("<HHi", 5, 4, 32) + element(1, names)
        return element(14, body + b"".join(matrix(item, "", refer) for item in value.values()))
    if isinstance(value, list):
        return element(14, head(1, (len(value), 1), name) + b"".join(matrix(item, "", refer) for item in value))
    if isinstance(value, str):
        return element(14, head(4, (1, len(value)), name) + element(4, value.encode("utf-16-le")))
    array = np.atleast_2d(np.asarray(value))
    if array.dtype == np.uint8:
        return element(14, head(9, array.shape, name) + element(2, array.tobytes(order="F")))
    flags = 0x0800 if np.iscomplexobj(array) else 0
    body = head(6, array.shape, name, flags) + element(9, array.real.astype("<f8").tobytes(order="F"))
    body += element(9, array.imag.astype("<f8").tobytes(order="F")) if flags else b""
    return element(14, body)


def write_objects(path, variables):
    """A v5 file with objects in its variables, those in cells and in other objects included."""
    names, classes, objects, cells, blocks = [], [], [], [], []

    def index(word):
        if word not in names:
            names.append(word)
        return names.index(word) + 1

    def refer(thing):
        if thing.kind not in classes:
            classes.append(thing.kind)
        objects.append(None)
        place = len(objects)
        rows = []
        for name, value in thing.properties.items():
            cells.append(None)
            at = len(cells) - 1
            cells[at] = matrix(value, "", refer)
            rows.append((index(name), 1, at))
        blocks.append(rows)
        objects[place - 1] = (classes.index(thing.kind) + 1, len(blocks))
        return [MAGIC, 2, 1, 1, place, classes.index(thing.kind) + 1]

    body = b"".join(matrix(value, name, refer) for name, value in variables.items())

    def block(rows):
        words = [len(rows), *(number for row in rows for number in row)]
        return np.array(words + [0] * (len(words) % 2), "<u4").tobytes()

    table = [np.array([[0] * 4, *([0, index(kind), 0, 0] for kind in classes)], "<u4").tobytes(), block([])]
    table += [
        np.array([[0] * 6, *([kind, 0, 0, 0, at, k + 1] for k, (kind, at) in enumerate(objects))], "<u4").tobytes()
    ]
    table += [b"".join(map(block, [[], *blocks])), block([])]
    text = b"".join(name.encode() + b"\0" for name in names)
    text += bytes(-len(text) % 8)
    begins = np.cumsum([40 + len(text), *map(len, table)]).tolist()
    header = struct.pack("<II8I", 4, len(names), *begins, *[begins[-1]] * (8 - len(begins)))
    first = matrix(np.frombuffer(header + text + b"".join(table), np.uint8)[:, None])
    defaults = [np.zeros((1, 0))] * (len(classes) + 1)
    contents = [first, matrix(np.zeros((0, 0))), *cells, *[matrix(defaults)] * 3]
    wrapper = (
        element(6, struct.pack("<II", 17, 0)) + element(1, b"") + element(1, b"MCOS") + element(1, b"FileWrapper__")
    )
    wrapper += element(14, head(1, (len(contents), 1), "") + b"".join(contents))
    names_of = b"MCOS".ljust(8, b"\0")
    inner = head(2, (1, 1), "") + struct.pack("<HHi", 5, 4, 8) + element(1, names_of) + element(14, wrapper)
    subsystem = b"\x00\x01IM" + bytes(4) + element(14, inner)
    system = matrix(np.frombuffer(b"\x00\x01IM" + bytes(4) + subsystem[8:], np.uint8)[None])
    place = struct.pack("<Q", 128 + len(body))
    top = b"MATLAB 5.0 MAT-file, Platform: GLNXA64".ljust(116) + place + struct.pack("<H", 0x0100) + b"IM"
    path.write_bytes(top + body + system)
    return path
