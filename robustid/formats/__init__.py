"""Files, readers and writers; data sets."""

from robustid.formats import datasets
from robustid.formats.contents import Contents, Item, contents
from robustid.formats.excitation_files import load_excitation
from robustid.formats.files import Origin, origin, read_file, read_said
from robustid.formats.model_files import load_model, save_model
from robustid.formats.names import FREQUENCY, NAMES, TIME
from robustid.formats.networks import is_network, scattering_model, scattering_of, write_spice, write_touchstone
from robustid.formats.saved import WRITERS, flat_fields, from_fields

__all__ = [
    "FREQUENCY",
    "NAMES",
    "TIME",
    "WRITERS",
    "Contents",
    "Item",
    "Origin",
    "contents",
    "datasets",
    "flat_fields",
    "from_fields",
    "is_network",
    "load_excitation",
    "load_model",
    "origin",
    "read_file",
    "read_said",
    "save_model",
    "scattering_model",
    "scattering_of",
    "write_spice",
    "write_touchstone",
]
