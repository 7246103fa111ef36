"""Files that a run file names: addresses, axes, decimal marks and frequencies by start and step, and refusals as its keys."""

import tomllib

import numpy as np
import pytest

from robustid.app.run.measurements import measured
from robustid.app.run.run_file import read_run_file
from robustid.app.run.run_folder import Surroundings
from robustid.errors import RobustIdError

pytestmark = pytest.mark.quick

TIME, SIGNALS = np.arange(40) * 0.5, np.random.default_rng(3).standard_normal((40, 2))
G = np.exp(-1j * np.arange(1, 9))


@pytest.fixture
def read(tmp_path):
    def read(text):
        said = []
        _, data = measured(
            read_run_file(tomllib.loads(text)), tmp_path, Surroundings(lambda words, *_: said.append(words))
        )
        return data, said

    return read


def test_a_record_and_a_response_of_foreign_files(tmp_path, read):
    np.save(tmp_path / "rig.npy", SIGNALS)
    (tmp_path / "frf.txt").write_text("".join(f"{z.real};{z.imag}\n" for z in G).replace(".", ","))
    head = '[delay]\nseconds = 0.0\n[[record]]\nfile = "rig.npy"\nuse = "samples"\nbound = 0.1\n'
    with pytest.raises(RobustIdError, match=r'rig\.npy: .*`fields = \{ u = "\[:,0\]", y = "\[:,1\]" \}; dt = 1\.0`'):
        read(head)
    data, said = read(
        f'{head}fields = {{ u = "[:,0]", y = "[:,1]" }}\nrate = 2.0\n[[frequency]]\nfile = "frf.txt"\n'
        'fields = { real = "[:,0]", imag = "[:,1]" }\nstart = 0.05\nstep = 0.1\nunit = "Hz"\ndt = 0.5\nbound = 0.1\n'
    )
    np.testing.assert_array_equal(data.records[0].y[:, 0], SIGNALS[:, 1])
    assert data.dt == 0.5
    np.testing.assert_allclose(data.responses[0].values[:, 0, 0], G, rtol=1e-14)
    np.testing.assert_allclose(data.responses[0].freq_hz, 0.05 + 0.1 * np.arange(8), rtol=1e-14)
    assert "read rig.npy: 1 record, 40 samples used as samples; NumPy array" in said
    assert any(
        words.startswith("read frf.txt: 8 frequency points; text, 2 columns separated by semicolons") for words in said
    )


def test_every_realisation_is_a_record(tmp_path, read):
    np.savez(tmp_path / "runs.npz", u=SIGNALS, y=2 * SIGNALS)
    data, _ = read(
        '[delay]\nseconds = 0.0\n[[record]]\nfile = "runs.npz"\nuse = "samples"\naxes = "time,realisation"\ndt = 0.5\nbound = 0.1\n'
    )
    assert len(data.records) == 2
    np.testing.assert_array_equal(data.records[1].y[:, 0], 2 * SIGNALS[:, 1])
