"""Sound files: channels in parts of full scale, and broken ones."""

import numpy as np
import pytest
import scipy.io.wavfile

import robustid as rid
from robustid.errors import FileFormatError

U, Y = 0.4 * np.random.default_rng(0).standard_normal((2, 500)).clip(-2, 2)


@pytest.mark.parametrize(
    ("form", "full", "middle", "step"),
    [("u1", 127, 128, 1 / 127), ("i2", 32767, 0, 1e-4), ("i4", 2**31 - 1, 0, 1e-8), ("f4", 1, 0, 1e-6)],
)
def test_channels_of_any_width_are_parts_of_full_scale(tmp_path, form, full, middle, step):
    path = tmp_path / "shaker.wav"
    scipy.io.wavfile.write(path, 8000, (np.column_stack([U, Y]) * full + middle).astype(form))
    record = rid.load(path, fields={"u": "channel 1", "y": "channel 2"})
    assert record.dt == 1 / 8000
    assert record.u[:, 0] == pytest.approx(U, abs=2 * step)
    assert record.y[:, 0] == pytest.approx(Y, abs=2 * step)
    assert rid.look(path).arguments["fields"] == {"u": "channel 1", "y": "channel 2"}


@pytest.mark.parametrize("kept", [13, 30, 44])
def test_a_broken_file_is_said_to_be_one(tmp_path, kept):
    path = tmp_path / "cut.wav"
    scipy.io.wavfile.write(path, 8000, (U * 3e4).astype("i2"))
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(
        FileFormatError, match=r"cut\.wav (can't be read as a sound file|is a sound file without a sample)"
    ):
        rid.load(path)
