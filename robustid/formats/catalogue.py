"""Catalogue of the published data sets: addresses at fixed commits, checksums, licences, citations."""

from __future__ import annotations

import dataclasses

from robustid.formats.table import Options


@dataclasses.dataclass(frozen=True)
class Dataset:
    """One published file: what it is, where it comes from, its licence, what to cite, and its checksum."""

    title: str
    repository: str
    commit: str
    path: str
    licence: str
    citation: str
    sha256: str
    options: Options = dataclasses.field(default_factory=Options)

    @property
    def url(self) -> str:
        """Address of the file itself."""
        return f"https://raw.githubusercontent.com/{self.repository}/{self.commit}/{self.path}"

    @property
    def origin(self) -> str:
        """Repository, commit and folder, for people."""
        folder = self.path.rpartition("/")[0]
        return f"github {self.repository} @{self.commit[:8]}{f', folder {folder}' if folder else ''}"


TWO_MASS = "two_mass/MultisineTypeA.mat"
_SWEEPS = {
    "symexc_1": ("symmetric", "a242c65ee10540883db08e94e1eefb41dcd6264f23ff1724abc66d74ce45a43f"),
    "asymexc_1": ("antisymmetric", "3e5943a8596541aaaa01511f2135f996ad9434030c91c62f548048c83ed84803"),
}
_MIRROR = {
    "u_200mV_test": "0053438fb9c6ae8ee46e0dd18838febe3183996f3ad3ae9eb8dfc3bdbaba7d18",
    "u_200mV_train": "59356f9b403b839231cf903acf6c99df33e0f4fbc820f4edd44dc169ac38dd3e",
    "u_300mV_test": "2bc566ae64d9000e69fbbc95092ac9c04c083bb398e4f16f2eb105645844e401",
    "u_300mV_train": "0436437998307e8f8c86f824c1fee4e225f212861878bf58d42b2a5e2ecd0cb5",
    "y_200mV_test": "7935a6b7251d9a87f1351a3cb71b6282c414b3156c227813bb1cb3ebde2cb7b4",
    "y_200mV_train": "b25b16b07fdbc7980bab4e98906ddaf2eaee41be0957c8911a469c3c426479d1",
    "y_300mV_test": "b46edea962a149b7a5abd89f819e6f1ec03ba4d68b0ac83e2a8fc84c2b0ebaf3",
    "y_300mV_train": "38acb224027e728d7a3c44a0ce5538fcb74c836be585a1b318a6728c8a6820fb",
}
_MODELS = {
    "CDplayer": ("CDplayer.mat", "1fa167d1b6d7e1a8c332d21debcd28333f1dc20f322fc38ebbb920fdcce35192"),
    "beam": ("beam.mat", "b7b4e710a044796dd60e2a480d0d6c8f5ca0d0ad5bcf35bb6cf5721aa4f24234"),
    "build": ("build.mat", "8a74156b8706f9f2c9d1d5ec31ab40ce5f7ea5ddffaff062f4cf6d99331c219f"),
    "iss1R": ("models/iss1R.mat", "39c25c3148c51ded9012c2b063a0569dc77fff1bf2883e124af6054773936c51"),
}
BEAM_RING = tuple(f"beam_ring/{name}.mat" for name in _SWEEPS)
FSM = {
    f"{folder}/{part}": tuple(f"fsm_cubespec/{signal}_{millivolts}mV_{part}.npy" for signal in "uy")
    for folder, millivolts in (("fsm", 300), ("fsm_200mV", 200))
    for part in ("train", "test")
}
_DAISY = {
    "cdplayer": (
        "arm of a CD player, 2 inputs, 2 outputs, measured, one record of 2048 samples",
        "506d0357eb3fb1b0eeb1817593ac766eafa6764e208c97752be469c693104194",
    ),
    "hairdryer": (
        "hair dryer, heater voltage to air temperature, measured, one record of 1000 samples",
        "7afafda4c6c027476c94429d7f8c08cbe95d5175ed7ccbff1d3b7c51e93d97d9",
    ),
}
DAISY = {name: f"daisy/{name}.mat" for name in _DAISY}
MODELS = {name: f"slicot/{name}.mat" for name in _MODELS}

DATASETS = {
    TWO_MASS: Dataset(
        "motor bench with flexible coupling, measured, multisine: 20 periods of 2500 samples",
        "HoriFujimotoLab/FdiTools",
        "5925fae7",
        "Examples/private/MultisineTypeA.mat",
        "MIT",
        "Hori-Fujimoto Lab, FdiTools: Frequency Domain System Identification Matlab Toolbox",
        "a15dadc2e756ceddd927935f9c4c547cdcaef95c8611fc39087c848b3a8acb26",
        {
            "fields": {"u": "iq_adx", "y": ["theta_mx", "theta_my"], "reference": "iq_refx"},
            "dt": 1 / 2500,
            "initial": "free",  # periodic, but its first periods hold a transient
        },
    ),
    **{
        f"beam_ring/{name}.mat": Dataset(
            f"aluminium beam, 2 piezo patches, 2 accelerometers, measured, {shape} swept sine",
            "flavioluiz/MIMO-FRF",
            "d66b3c4cdbc2e08adaefd99aa60be2d146b71520",
            f"sample_data/{name}.mat",
            "BSD-2-Clause",
            "github flavioluiz/MIMO-FRF: tools for MIMO frequency response obtaining and analysis",
            sha256,
            {"fields": {"u": "inputvalues", "y": "outputvalues"}, "dt": 1e-3},
        )
        for name, (shape, sha256) in _SWEEPS.items()
    },
    **{
        f"fsm_cubespec/{name}.npy": Dataset(
            "fine steering mirror, 3 voltages, 3 displacements, measured, random-phase multisine",
            "merijnfloren/fsm-benchmark-data",
            "539a12fef384b086a8562b500498b2fa3899ef70",
            f"data/{name}.npy",
            "CC BY 4.0",
            "Floren et al., Data-driven state-space identification and nonlinearity assessment of the CubeSpec Fine Steering"
            " Mirror, ISMA-USD 2024, pp. 2042-2052",
            sha256,
        )
        for name, sha256 in _MIRROR.items()
    },
    **{
        f"daisy/{name}.mat": Dataset(
            title,
            "robotsorcerer/FARNN",
            "3dac80fd71d3c60a7372cedcf5d51b89ba32b2f4",
            f"data/{name}.mat",
            "DaISy collection, free for use with citation",
            "De Moor et al., DaISy: A database for identification of systems, Journal A 38(3), 1997, pp. 4-5",
            sha256,
        )
        for name, (title, sha256) in _DAISY.items()
    },
    **{
        f"slicot/{name}.mat": Dataset(
            "model-reduction benchmark (a model, not a measurement)",
            "elizqian/balancing-bayesian-inference",
            "dcb3d3d6",
            path,
            "SLICOT collection",
            "Chahlaoui and Van Dooren, A collection of benchmark examples for model reduction of linear time invariant"
            " dynamical systems, SLICOT Working Note 2002-2",
            sha256,
        )
        for name, (path, sha256) in _MODELS.items()
    },
}
