"""A continuous identification as one of discrete time: the same numbers on the circle of z, without any sampling."""

from __future__ import annotations

import dataclasses
from typing import Any

from robustid.bases import ParametricBasis
from robustid.core import SPlane, StateMatrices, ZPlane
from robustid.data import FrequencyResponse, TangentialResponse
from robustid.identification.problem import MixedProblem
from robustid.identification.region import Region, region_of
from robustid.identification.result import Identification

_DT = 1.0  # s: frequencies in rad/s are angles


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class ImageProblem(MixedProblem):
    """A problem of continuous time in z = (corner + s)/(corner - s), as one of sample time 1 s.

    Parameters
    ----------
    corner : float, rad/s
        That of its plane; the prior, with its decay in 1/s, is that of continuous time.
    """

    corner: float

    def _region(self) -> Region:
        return region_of(self.prior, SPlane(self.corner))


def image_of(identification: Identification) -> Identification:
    """The same identification with frequencies, functions and model in z."""
    problem, plane = identification.problem, identification.problem.plane
    if not isinstance(plane, SPlane):
        return identification
    basis, z = problem.parametric, ZPlane(_DT)
    if basis is not None:
        basis = ParametricBasis(basis.A, basis.B, basis.C, basis.D, _DT, basis.labels, basis.poles)
    fields = {field.name: getattr(problem, field.name) for field in dataclasses.fields(MixedProblem) if field.init}
    fields |= {"frequency": tuple(_moved(one, plane, z) for one in problem.frequency), "parametric": basis}
    image = ImageProblem(**fields, corner=plane.corner)
    return dataclasses.replace(
        identification, formulation=identification.formulation.of(image), model=model_in_z(identification.model, plane)
    )


def _moved(frf: FrequencyResponse | TangentialResponse, plane: SPlane, z: ZPlane) -> Any:
    return dataclasses.replace(frf, omega=z.omega(plane.angles(frf.omega)), dt=z.dt)


def model_in_z(model: Any, plane: SPlane) -> Any:
    """A continuous model in z."""
    import control

    labels: dict[str, Any] = {"inputs": model.input_labels, "outputs": model.output_labels}
    states = plane.in_z(StateMatrices.of(model))
    return control.StateSpace(*states, _DT, remove_useless_states=False, **labels)


def model_in_s(model: Any, plane: SPlane) -> Any:
    """A model in z as a continuous one."""
    import control

    labels: dict[str, Any] = {"inputs": model.input_labels, "outputs": model.output_labels}
    states = plane.from_z(StateMatrices.of(model))
    return control.StateSpace(*states, 0.0, remove_useless_states=False, **labels)
