"""Whatever the library hands out prints in at most a screen, however large it is."""

import dataclasses
import importlib
import pkgutil

import control
import numpy as np
import pytest

import robustid as rid
from robustid.core import Frozen

LINES, COLUMNS = 24, 160
OMEGA = np.linspace(1, 9, 500)
PLANT = control.ss([[0, 1], [-16, -0.2]], [[0, 0], [1, 2]], [[1, 0], [3, 1]], 0)


@dataclasses.dataclass(frozen=True, eq=False)
class Everything(Frozen):
    few: np.ndarray
    many: np.ndarray
    items: tuple
    table: dict
    text: str
    model: control.StateSpace
    status: rid.Status


def fits_a_screen(thing):
    lines = repr(thing).splitlines()
    return len(lines) <= LINES and max(map(len, lines)) <= COLUMNS


def test_small_values_stand_as_they_are_and_large_ones_by_their_size():
    status = next(iter(rid.Status))
    many, table = np.ones((500, 2, 2)), dict.fromkeys(range(50))
    shown = repr(Everything(np.arange(3.0), many, (1, 2), table, "x" * 500, PLANT, status))
    assert shown.splitlines() == [
        "Everything(",
        "  few=[0., 1., 2.],",
        "  many=<(500, 2, 2) float64 array>,",
        "  items=(1, 2),",
        "  table=<dict of 50>,",
        "  text=<str>,",
        "  model=<StateSpace: 2 states, 2x2, continuous>,",
        f"  status=Status.{status.name}",
        ")",
    ]


def test_no_class_keeps_the_repr_of_dataclasses():
    for module in pkgutil.walk_packages(rid.__path__, "robustid."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
    todo, seen = [Frozen], set()
    while todo:
        new = {cls for cls in todo.pop().__subclasses__() if cls.__module__.startswith("robustid.")} - seen
        seen |= new
        todo += new
    assert len(seen) > 60
    assert not [cls.__qualname__ for cls in seen if hasattr(cls.__repr__, "__wrapped__")]


@pytest.fixture(scope="module")
def results():
    frf = rid.FrequencyResponse.from_control(control.frequency_response(PLANT, OMEGA))
    noisy = dataclasses.replace(frf, values=frf.values * (1 + 0.01 * np.cos(7 * OMEGA))[:, None, None], bound=0.1)
    fit = rid.fit_mfd(noisy, order=2, restart=False)
    sweep = rid.fits.suggest_order(noisy.select(slice(None, None, 5)), orders=[1, 2])
    model = control.ss(np.diag(np.linspace(-1, -9, 60)), np.ones((60, 2)), np.ones((2, 60)), 0)
    return {
        "response": noisy,
        "bound": noisy.bound,
        "fit": fit,
        "realisation": fit.fraction,
        "problem": fit.problem,
        "nodes": fit.nodes,
        "polynomials": fit.fraction.basis,
        "sweep": sweep,
        "weight": fit.problem.weight,
        "deviations": rid.fits.fit_covariance(fit),
        "modal form": rid.fits.modal_form(model),
        "reduction": rid.balanced_truncation(model, order=3),
        "validation": rid.validate(fit, noisy),
        "record": rid.TimeRecord(np.ones(5000), np.ones((5000, 3)), dt=0.1),
        "excitation": rid.prepare.multisine(period=4096, dt=1e-3, band_hz=(1, 20)),
        "structure": rid.datasets.flexible_structure(),
        "basis": rid.kautz(np.linspace(1, 20, 30), 0.01, dt=0.01),
        "continuous": rid.to_continuous(control.sample_system(PLANT, 0.1)),
    }


def test_results_print_in_a_screen(results):
    assert not [name for name, result in results.items() if not fits_a_screen(result)]


def test_a_fit_says_what_matters_in_a_line(results):
    text = repr(results["fit"])
    assert text.startswith("<MatrixFraction: order 2, 2x2, continuous, stable; cost ")
    assert repr(results["sweep"]) == "<OrderSweep: 2 orders from 1 to 2; suggested 2>"
