"""Files, readers and writers."""

from robustid.data.io.contents import Contents, Item, contents
from robustid.data.io.files import Origin, origin, read_file, read_said
from robustid.data.io.model_files import load_model, save_model
from robustid.data.io.names import FREQUENCY, NAMES, TIME
from robustid.data.io.networks import is_network, scattering_model, scattering_of, write_spice, write_touchstone
from robustid.data.io.readers import read_table
from robustid.data.io.saved import WRITERS, flat_fields, from_fields
from robustid.data.io.table import Table

__all__ = [
    "FREQUENCY",
    "NAMES",
    "TIME",
    "WRITERS",
    "Contents",
    "Item",
    "Origin",
    "Table",
    "contents",
    "flat_fields",
    "from_fields",
    "is_network",
    "load_model",
    "origin",
    "read_file",
    "read_said",
    "read_table",
    "save_model",
    "scattering_model",
    "scattering_of",
    "write_spice",
    "write_touchstone",
]
