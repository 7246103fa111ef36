"""Shared by the tests: matlab files."""

import h5py
import numpy as np
import scipy.io

RNG = np.random.default_rng(3)
G = RNG.standard_normal((2, 3, 5)) + 1j * RNG.standard_normal((2, 3, 5))  # ny, nu, F
W = np.arange(1.0, 6.0)
FRD = {
    "ResponseData": G,
    "Frequency": W[:, None],
    "FrequencyUnit": "Hz",
    "Ts": 0.01,
    "TimeUnit": "seconds",
    "InputName": np.array(["force", "moment", "volt"], object)[:, None],
    "InputUnit": np.array(["N", "Nm", "V"], object)[:, None],
    "OutputName": np.array(["x", "y"], object)[:, None],
    "InputDelay": np.zeros((3, 1)),
}


def write5(path, structure, name="G"):
    scipy.io.savemat(path, {name: structure} if name else structure)


def write73(path, structure, name="G"):
    """As MATLAB does: user block with a text, axes reversed, texts as numbers, cells as references, dots as groups."""
    with h5py.File(path, "w", userblock_size=512) as file:
        top = file.create_group(name) if name else file
        if name:
            top.attrs["MATLAB_class"] = np.bytes_("struct")
        for field, value in structure.items():
            field = field.replace(".", "/")
            if isinstance(value, str):
                write_text(top, field, value)
            elif np.asarray(value).dtype == object:
                store = file.require_group("#refs#")
                texts = np.asarray(value)
                cells = np.empty(texts.T.shape, h5py.ref_dtype)
                for index, text in np.ndenumerate(texts):
                    cells[index[::-1]] = write_text(store, f"{field}{index[0]}", text).ref
                top.create_dataset(field, data=cells, dtype=h5py.ref_dtype).attrs["MATLAB_class"] = np.bytes_("cell")
            else:
                array = np.atleast_2d(value).T
                if np.iscomplexobj(array):
                    pair = np.empty(array.shape, [("real", float), ("imag", float)])
                    pair["real"], pair["imag"] = array.real, array.imag
                    array = pair
                top.create_dataset(field, data=array).attrs["MATLAB_class"] = np.bytes_("double")
    with open(path, "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64")


def write_text(group, name, text):
    data = group.create_dataset(name, data=np.array([[ord(c)] for c in text], np.uint16))
    data.attrs["MATLAB_class"] = np.bytes_("char")
    return data
