"""Diagnostics test tools of LIGO (diaggui), XML: transfer functions between measured signals."""

from __future__ import annotations

import base64
import binascii
import re
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from robustid.errors import FileFormatError, Remedy
from robustid.formats.table import Table, said

MARK = b"LIGO_LW"
_ENTITY = re.compile(rb"<!ENTITY", re.IGNORECASE)
_EVEN, _LISTED = 0, 3  # subtypes of B/A: frequencies as a first one and a step, or before the values
_NUMBER = re.compile(r"\[(\d{1,6})\]")


class _Transfer(NamedTuple):
    """The responses of signals B to a signal A."""

    source: str
    channels: list[str]
    hz: np.ndarray
    values: np.ndarray  # (channels, F)


def read_diagnostics(path: Path) -> Table:
    """Transfer functions, input the signal that was driven; of others every one by the names of its signals."""
    content = path.read_bytes()
    if _ENTITY.search(content):
        raise FileFormatError(
            f"{path.name} declares entities, which such files never have; is it a file of LIGO's tools?"
        )
    try:
        root = ElementTree.fromstring(content)
        nodes = [node for node in root.iter("LIGO_LW") if node.get("Type") == "TransferFunction"]
        read = [transfer for node in nodes if (transfer := _transfer(node)) is not None]
    except (ElementTree.ParseError, binascii.Error, ValueError, KeyError, TypeError, IndexError) as error:
        raise FileFormatError(
            f"{path.name} can't be read as XML of LIGO's tools ({said(error)}); is it cut off?"
        ) from None
    if not read:
        raise FileFormatError(
            f"{path.name} has no transfer functions: spectra don't say a response by themselves. Export the transfer function as"
            " text, or measure by swept sine"
        )
    table = Table(path, {}, how="XML of LIGO's diagnostics test tools, transfer functions")
    for transfer in read:
        table.columns[f"{transfer.source} f [Hz]"] = transfer.hz
        for channel, values in zip(transfer.channels, transfer.values, strict=True):
            if channel != transfer.source:
                table.columns[f"{channel} / {transfer.source}"] = values
    driven = [transfer for transfer in read if transfer.source in _driven(root)] if len(read) > 1 else read
    first = read[0]
    if len(driven) != 1:
        names = ", ".join(transfer.source for transfer in read)
        other = next(channel for channel in first.channels if channel != first.source)
        error = FileFormatError(
            f"the file has responses to {names}, and none or several of them were driven: name one, such as ",
            Remedy({"fields": {"freq_hz": f"{first.source} f [Hz]", "values": f"{other} / {first.source}"}}),
            place=path.name,
        )
        table.columns.update(freq_hz=error, values=error)
        return table
    _fill(table, driven[0])
    return table


def _fill(table: Table, driven: _Transfer) -> None:
    """The usual arrays: the responses of all other signals."""
    kept = [k for k, channel in enumerate(driven.channels) if channel != driven.source]
    there = driven.hz > 0  # a sweep that was stopped is filled up with zeros
    table.columns["freq_hz"] = driven.hz[there]
    table.columns["values"] = driven.values[kept][:, there].T[:, :, None]
    table.facts["frequency"] = {"outputs": [driven.channels[k] for k in kept], "inputs": [driven.source]}


def _driven(root: ElementTree.Element) -> set[str]:
    """Signals that the test drives."""
    params = [node for node in root.iter("Param") if (node.get("Name") or "").startswith(("Stimulus", "TestChannel"))]
    texts = {node.get("Name") or "": (node.text or "").strip() for node in params}
    return {text for name, text in texts.items() if name.startswith("StimulusChannel")
            and texts.get(name.replace("Channel", "Active"), "true") == "true"}  # fmt: skip


def _transfer(node: ElementTree.Element) -> _Transfer | None:
    """The responses of one result; None where it holds a coherence, or none that is known."""
    params = {child.get("Name") or "": (child.text or "").strip() for child in node.findall("Param")}
    kind = int(params["Subtype"])
    array = node.find("Array")
    if kind not in (_EVEN, _LISTED) or array is None:
        return None
    stream = array.find("Stream")
    if stream is None or "base64" not in (stream.get("Encoding") or ""):
        raise ValueError("an array is not in base64")
    order = ">" if "BigEndian" in (stream.get("Encoding") or "") else "<"
    numbers = np.frombuffer(base64.b64decode(stream.text or ""), f"{order}c8").astype(complex)
    points, rows = int(params["N"]), int(params["M"])
    if numbers.size != points * (rows + (kind == _LISTED)):
        raise ValueError(f"an array of {numbers.size} numbers for {rows} channels and {points} frequencies")
    if kind == _LISTED:
        hz, numbers = np.real(numbers[:points]), numbers[points:]
    else:
        hz = float(params["f0"]) + float(params["df"]) * np.arange(points)
    places = {name: _NUMBER.search(name) for name in params if name.startswith("ChannelB")}
    names = {int(place[1]) if place else 0: params[name] for name, place in places.items()}
    return _Transfer(params["ChannelA"], [names[k] for k in range(rows)], hz, numbers.reshape(rows, points))
