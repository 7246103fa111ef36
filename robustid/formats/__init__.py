"""Files, readers and writers; data sets."""

from robustid.formats import datasets
from robustid.formats.contents import Contents, Item, contents
from robustid.formats.excitation_files import load_excitation
from robustid.formats.headings import heading
from robustid.formats.load_example import names_axis
from robustid.formats.measurement_files import Origin, kind_of_file, origin, read_file, read_said
from robustid.formats.model_files import StoredModel, load_model, save_model
from robustid.formats.networks import is_network, scattering_model, scattering_of, write_spice, write_touchstone
from robustid.formats.readers import read_table
from robustid.formats.record_pairs import record_pairs
from robustid.formats.role_lookup import seconds_in
from robustid.formats.role_names import FREQUENCY, NAMES, TIME, axis_role
from robustid.formats.saved import WRITERS
from robustid.formats.table import Table
from robustid.formats.universal import write_universal

__all__ = [
    "FREQUENCY",
    "NAMES",
    "TIME",
    "WRITERS",
    "Contents",
    "Item",
    "Origin",
    "StoredModel",
    "Table",
    "axis_role",
    "contents",
    "datasets",
    "heading",
    "is_network",
    "kind_of_file",
    "load_excitation",
    "load_model",
    "names_axis",
    "origin",
    "read_file",
    "read_said",
    "read_table",
    "record_pairs",
    "save_model",
    "scattering_model",
    "scattering_of",
    "seconds_in",
    "write_spice",
    "write_touchstone",
    "write_universal",
]
