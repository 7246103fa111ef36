"""Measured data that others published: where they are on this machine, or where to get them."""

from __future__ import annotations

import dataclasses
import hashlib
import os
from pathlib import Path
from typing import Any

from robustid.data.files import load as load_file
from robustid.data.frequency_response import FrequencyResponse
from robustid.data.time_record import TimeRecord
from robustid.errors import DatasetNotFoundError, FileFormatError, InputError

VARIABLE = "ROBUSTID_DATA"


@dataclasses.dataclass(frozen=True)
class Dataset:
    """One published file: what it is, where it comes from, its licence and its checksum."""

    title: str
    origin: str
    licence: str
    sha256: str
    options: dict[str, Any] = dataclasses.field(default_factory=dict)


_BENCH = "github HoriFujimotoLab/FdiTools @5925fae7, folder Examples/private"
_BEAM = "github flavioluiz/MIMO-FRF @d66b3c4c, folder sample_data"
_MIRROR = "github merijnfloren/fsm-benchmark-data @539a12fe, folder data"
_SLICOT = "SLICOT Working Note 2002-2 (copy in github elizqian/balancing-bayesian-inference @dcb3d3d6)"
_BEAM_FIELDS = {"u": "inputvalues", "y": "outputvalues"}

DATASETS = {
    "two_mass/MultisineTypeA.mat": Dataset(
        "motor bench with flexible coupling, measured, multisine: 20 periods of 2500 samples",
        _BENCH,
        "MIT",
        "a15dadc2e756ceddd927935f9c4c547cdcaef95c8611fc39087c848b3a8acb26",
        {
            "fields": {"u": "iq_adx", "y": ["theta_mx", "theta_my"], "reference": "iq_refx"},
            "dt": 1 / 2500,
            "initial": "periodic",
        },
    ),
    "beam_ring/symexc_1.mat": Dataset(
        "aluminium beam, 2 piezo patches, 2 accelerometers, measured, symmetric swept sine",
        _BEAM,
        "BSD-2-Clause",
        "a242c65ee10540883db08e94e1eefb41dcd6264f23ff1724abc66d74ce45a43f",
        {"fields": _BEAM_FIELDS, "dt": 1e-3},
    ),
    "beam_ring/asymexc_1.mat": Dataset(
        "aluminium beam, 2 piezo patches, 2 accelerometers, measured, antisymmetric swept sine",
        _BEAM,
        "BSD-2-Clause",
        "3e5943a8596541aaaa01511f2135f996ad9434030c91c62f548048c83ed84803",
        {"fields": _BEAM_FIELDS, "dt": 1e-3},
    ),
    **{
        f"fsm_cubespec/{name}.npy": Dataset(
            "fine steering mirror, 3 voltages, 3 displacements, measured, random-phase multisine",
            _MIRROR,
            "CC BY 4.0, cite Floren et al., ISMA-USD 2024",
            sha256,
        )
        for name, sha256 in {
            "u_300mV_test": "2bc566ae64d9000e69fbbc95092ac9c04c083bb398e4f16f2eb105645844e401",
            "u_300mV_train": "0436437998307e8f8c86f824c1fee4e225f212861878bf58d42b2a5e2ecd0cb5",
            "y_300mV_test": "b46edea962a149b7a5abd89f819e6f1ec03ba4d68b0ac83e2a8fc84c2b0ebaf3",
            "y_300mV_train": "38acb224027e728d7a3c44a0ce5538fcb74c836be585a1b318a6728c8a6820fb",
        }.items()
    },
    **{
        f"slicot/{name}.mat": Dataset(
            "model-reduction benchmark (a model, not a measurement)", _SLICOT, "SLICOT collection", sha256
        )
        for name, sha256 in {
            "CDplayer": "1fa167d1b6d7e1a8c332d21debcd28333f1dc20f322fc38ebbb920fdcce35192",
            "beam": "b7b4e710a044796dd60e2a480d0d6c8f5ca0d0ad5bcf35bb6cf5721aa4f24234",
            "build": "8a74156b8706f9f2c9d1d5ec31ab40ce5f7ea5ddffaff062f4cf6d99331c219f",
            "iss1R": "39c25c3148c51ded9012c2b063a0569dc77fff1bf2883e124af6054773936c51",
        }.items()
    },
}


def find(name: str, *, verify: bool = False) -> Path:
    """Path of a published data file in the folder that the environment variable ROBUSTID_DATA names.

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
    >>> from robustid.data import datasets
    >>> datasets.DATASETS["two_mass/MultisineTypeA.mat"].licence
    'MIT'
    """
    if name not in DATASETS:
        raise InputError(f"`name` must be one of {sorted(DATASETS)}; got {name!r}")
    known = DATASETS[name]
    folder = os.environ.get(VARIABLE)
    path = Path(folder or ".", name)
    if not folder or not path.is_file():
        where = f"is not in {folder}" if folder else f"is looked for in the folder that {VARIABLE} names, not set now"
        raise DatasetNotFoundError(
            f"{name} {where}: get it from {known.origin} ({known.licence}), put it at {name} in a folder of"
            f" your choice and set {VARIABLE} to that folder"
        )
    if verify and hashlib.sha256(path.read_bytes()).hexdigest() != known.sha256:
        raise FileFormatError(
            f"{name} in {folder} differs from the published file (SHA-256); get it again from {known.origin}"
        )
    return path


def load(name: str, **options: Any) -> FrequencyResponse | TimeRecord:
    """Load a published record with the channels and the sample time that its documentation gives.

    Parameters
    ----------
    name : str
        See `find`; the model and mirror files are plain arrays: use `find` and read them yourself.
    **options
        As for `robustid.load`, in place of what is known about the file.

    Returns
    -------
    FrequencyResponse or TimeRecord

    Raises
    ------
    InputError, DatasetNotFoundError
        As `find`; or the file is no record.

    Examples
    --------
    >>> from robustid.data import datasets
    >>> datasets.DATASETS["two_mass/MultisineTypeA.mat"].options["fields"]["u"]
    'iq_adx'
    """
    path = find(name)
    if not DATASETS[name].options and not options:
        raise InputError(f"`name` = {name!r} is no record of one experiment; read datasets.find(name) yourself")
    return load_file(path, **{**DATASETS[name].options, **options})
