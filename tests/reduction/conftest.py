"""Fixtures of the tests of the reduction."""

import os
import pathlib

import control
import numpy as np
import pytest
import scipy.io
import scipy.sparse

from support.reduction_models import SLICOT


@pytest.fixture(params=SLICOT)
def benchmark_model(request):
    folder = os.environ.get("ROBUSTID_DATA")
    path = pathlib.Path(folder or ".", "slicot", f"{request.param}.mat")
    if not folder or not path.exists():
        pytest.skip("ROBUSTID_DATA does not name a folder with slicot/*.mat")
    matrices = scipy.io.loadmat(path)
    a, b, c = (np.asarray(scipy.sparse.csc_array(matrices[k]).todense(), dtype=float) for k in "ABC")
    assert a.shape[0] == SLICOT[request.param]
    return control.StateSpace(a, b, c, 0, 0)
