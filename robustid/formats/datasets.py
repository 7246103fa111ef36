"""Measured data and benchmark models that others published: on this machine, or from their origin."""

from __future__ import annotations

import hashlib
import logging
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from robustid.core import Options, as_flag, explain
from robustid.data import flexible_structure
from robustid.errors import DatasetNotFoundError, FileFormatError, InputError
from robustid.formats.catalogue import BEAM_RING, DAISY, DATASETS, FSM, MODELS, TWO_MASS, Dataset
from robustid.formats.measurement_files import read_file
from robustid.formats.table import said

__all__ = ["DATASETS", "NAMES", "VARIABLE", "Dataset", "describe", "fetch", "find", "flexible_structure", "load"]

VARIABLE = "ROBUSTID_DATA"
_log = logging.getLogger("robustid")
_FSM_STEP = 1 / 6400
# Sample time, inputs, outputs; neither is in the files.
_SHORT = {
    "cdplayer": (1.0, ["actuator 1", "actuator 2"], ["error 1", "error 2"]),
    "hairdryer": (0.08, ["heater [V]"], ["air [V]"]),
}


def find(name: str, *, verify: bool = False) -> Path:
    """Path of a published data file in the folder that the environment variable ROBUSTID_DATA names; nothing is downloaded.

    Parameters
    ----------
    name : str
        A key of `DATASETS`, such as ``"two_mass/MultisineTypeA.mat"``.
    verify : bool
        Compare the file's SHA-256 with the known one.

    Returns
    -------
    pathlib.Path

    Raises
    ------
    InputError
        A name that isn't known.
    DatasetNotFoundError
        The variable isn't set or the file isn't there; the sentence says where to get it, and its licence.
    FileFormatError
        With `verify`: the file differs from the published one.

    Examples
    --------
    >>> from robustid.formats import datasets
    >>> datasets.DATASETS["two_mass/MultisineTypeA.mat"].licence
    'MIT'
    """
    known, verify = _known(name), as_flag("verify", verify)
    path = _local(name)
    if path is None:
        raise DatasetNotFoundError(_where(name, known))
    if verify and hashlib.sha256(path.read_bytes()).hexdigest() != known.sha256:
        raise FileFormatError(
            f"{name} in {os.environ.get(VARIABLE)} differs from the published file (SHA-256); get it again from {known.origin}"
        )
    return path


def fetch(name: str) -> Path:
    """Path of a published data file: in the folder that ROBUSTID_DATA names, else in the user's cache, downloaded once.

    The download comes from the origin at a fixed commit and must have the known SHA-256. Licence and citation go to the log
    ``robustid``; `describe` gives them as text.

    Parameters
    ----------
    name : str
        A key of `DATASETS`.

    Returns
    -------
    pathlib.Path

    Raises
    ------
    InputError
        A name that isn't known.
    DatasetNotFoundError
        Not in the folder, not in the cache, and the origin can't be reached.
    FileFormatError
        What came isn't the published file.
    """
    known = _known(name)
    if (path := _local(name)) is not None:
        return path
    import pooch

    target = Path(pooch.os_cache("robustid"), name)
    _log.info("%s", describe(name))
    try:
        # Verified on every use; a damaged file in the cache is fetched again.
        return Path(pooch.retrieve(known.url, f"sha256:{known.sha256}", fname=target.name, path=target.parent))
    except Exception as error:  # requests, urllib3, pooch and the operating system each have their own
        if type(error) is ValueError:  # pooch's word for another hash; those of the network derive from OSError
            raise FileFormatError(
                f"{name}: what came from {known.url} isn't the published file (SHA-256); get it from {known.origin}"
            ) from None
        raise DatasetNotFoundError(
            f"{_where(name, known)}. The download from {known.url} failed: {said(error)}"
        ) from None


def describe(name: str) -> str:
    """Description of a data set: what it is, where it comes from, under which licence, and what to cite.

    Parameters
    ----------
    name : str
        One of `NAMES`, or a key of `DATASETS`.

    Returns
    -------
    str
        One line a fact; files of one origin together.

    Examples
    --------
    >>> from robustid.formats import datasets
    >>> print(datasets.describe("fsm"))
    fsm: fine steering mirror, 3 voltages, 3 displacements, measured, random-phase multisine
      origin: github merijnfloren/fsm-benchmark-data @539a12fe, folder data
      licence: CC BY 4.0
      cite: Floren et al., Data-driven state-space identification and nonlinearity assessment of the CubeSpec Fine
    Steering Mirror, ISMA-USD 2024, pp. 2042-2052
    """
    known = _known(_files(name)[0])
    return f"{name}: {known.title}\n  origin: {known.origin}\n  licence: {known.licence}\n  cite: {known.citation}"


def load(name: str, **options: Any) -> Any:
    """Load published data with the signals and the sample time that their documentation gives.

    Parameters
    ----------
    name : str
        ``"two_mass"``, ``"cdplayer"``, ``"hairdryer"``: one record; the sample time of the CD player is not known, it is given
        as 1. ``"beam_ring"``: the symmetric and the antisymmetric sweep. ``"fsm"`` or ``"fsm/train"``, ``"fsm/test"``, and the
        same at two thirds of the voltage, ``"fsm_200mV/train"``, ``"fsm_200mV/test"``: one record a realisation of the
        excitation, each with its two steady periods of 8192 samples.
        ``"CDplayer"``, ``"beam"``, ``"build"``, ``"iss1R"``: models. Or a single file, by its key of `DATASETS`.
    **options
        As for `robustid.load`, for records in ``.mat`` files, in place of what is known about them.

    Returns
    -------
    TimeRecord, list of TimeRecord, or control.StateSpace
        Offsets of the sensors are left in. Models are in continuous time, A, B, C as in the file, D = 0.

    Raises
    ------
    InputError, DatasetNotFoundError, FileFormatError
        As `fetch`; or the file is no record of one experiment.

    Examples
    --------
    >>> from robustid.formats import datasets
    >>> print(*datasets.NAMES)
    CDplayer beam beam_ring build cdplayer fsm fsm/test fsm/train fsm_200mV/test fsm_200mV/train hairdryer iss1R two_mass
    """
    if name in _SETS:
        _, read = _SETS[name]
        return read(_files(name), options)
    known = _known(name)
    if known.options:
        return _record([name], options)
    if name.startswith("slicot/"):
        return _model([name], options)
    if name.startswith("daisy/"):
        return _short([name], options)
    raise InputError(f"`name` = {name!r} is no record of one experiment; load 'fsm/train' or 'fsm/test'")


def _record(files: list[str], options: Options) -> object:
    return read_file(fetch(files[0]), **{**DATASETS[files[0]].options, **options})


def _records(files: list[str], options: Options) -> object:
    return [_record([file], options) for file in files]


def _mirror(files: list[str], options: Options) -> object:
    """Arrays of (samples a period, signals, realisations, periods)."""
    _no_options(files, {name: value for name, value in options.items() if name != "bound"})
    arrays = {role: np.load(fetch(file), allow_pickle=False) for role, file in zip("uy", files, strict=True)}
    inputs, outputs = (
        [f"{name} {k + 1} [{unit}]" for k in range(3)] for name, unit in (("piezo", "V"), ("sensor", "m"))
    )
    axes = "time,signal,realisation,period"
    return read_file(arrays, axes=axes, dt=_FSM_STEP, inputs=inputs, outputs=outputs, **options)


def _short(files: list[str], options: Options) -> object:
    """One matrix whose columns are the signals, inputs first; the record begins in the middle of the experiment."""
    name = Path(files[0]).stem
    dt, inputs, outputs = _SHORT[name]
    fields = {"u": f"{name}[:,:{len(inputs)}]", "y": f"{name}[:,{len(inputs)}:]"}
    known = {"fields": fields, "dt": dt, "initial": "free", "inputs": inputs, "outputs": outputs}
    return read_file(fetch(files[0]), **{**known, **options})


def _model(files: list[str], options: Options) -> object:
    _no_options(files, options)
    model = read_file(fetch(files[0]), kind="model")
    model.name = Path(files[0]).stem
    return model


def _no_options(files: list[str], options: Options) -> None:
    if options:
        raise InputError(f"{files[0]} is read in one way; leave out {', '.join(sorted(options))}")


_SETS: dict[str, tuple[tuple[str, ...], Callable[[list[str], Options], object]]] = {
    "two_mass": ((TWO_MASS,), _record),
    "beam_ring": (BEAM_RING, _records),
    "fsm": (FSM["fsm/train"], _mirror),
    **{part: (files, _mirror) for part, files in FSM.items()},
    **{name: ((file,), _short) for name, file in DAISY.items()},
    **{name: ((file,), _model) for name, file in MODELS.items()},
}
NAMES = tuple(sorted(_SETS))


def _files(name: str) -> list[str]:
    return list(_SETS[name][0]) if name in _SETS else [name]


def _known(name: str) -> Dataset:
    if name not in DATASETS:
        raise InputError(f"`name` must be one of {list(NAMES)}, or a file of {sorted(DATASETS)}; got {name!r}")
    return DATASETS[name]


def _local(name: str) -> Path | None:
    folder = os.environ.get(VARIABLE)
    path = Path(folder or ".", name)
    return path if folder and path.is_file() else None


def _where(name: str, known: Dataset) -> str:
    folder = os.environ.get(VARIABLE)
    where = f"is not in {folder}" if folder else f"is looked for in the folder that {VARIABLE} names, not set now"
    return (
        f"{name} {where}: get it from {known.origin} ({known.licence}), put it at {name} in a folder of"
        f" your choice and set {VARIABLE} to that folder"
    )


explain(__name__, __all__)
