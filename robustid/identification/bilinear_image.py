"""A continuous identification as one of discrete time: the same numbers on the circle of z, without any sampling."""

from __future__ import annotations

import dataclasses

from robustid.bases import ParametricBasis
from robustid.core import Model, Plane, SPlane, StateMatrices, ZPlane
from robustid.data import FrequencyResponse, TangentialResponse
from robustid.identification.problem import MixedProblem
from robustid.identification.region import Region, region_of
from robustid.identification.result import Identification
from robustid.identification.weighting import Weighting

_DT = 1.0  # s: frequencies in rad/s are angles


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class ImageProblem(MixedProblem):
    """A problem of continuous time in z = (corner + s)/(corner - s), as one of sample time 1 s."""

    corner: float  # that of its plane; the prior, with its decay in 1/s, is that of continuous time

    def _region(self) -> Region:
        return region_of(self.prior, SPlane(self.corner))

    def _weighting(self) -> Weighting:
        plane = SPlane(self.corner)
        return Weighting(self.prior.weight_in(plane), plane)


def image_of(identification: Identification) -> Identification:
    """The same identification with frequencies, functions and model in z."""
    problem, plane = identification.problem, identification.problem.plane
    if not isinstance(plane, SPlane):
        return identification
    basis, z = problem.parametric, ZPlane(_DT)
    if basis is not None:
        basis = ParametricBasis(basis.A, basis.B, basis.C, basis.D, _DT, basis.functions, basis.poles)
    fields = {field.name: getattr(problem, field.name) for field in dataclasses.fields(MixedProblem) if field.init}
    fields |= {"frequency": tuple(_moved(one, plane, z) for one in problem.frequency), "parametric": basis}
    image = ImageProblem(**fields, corner=plane.corner)
    return dataclasses.replace(
        identification, formulation=identification.formulation.of(image), model=in_image(identification.model, plane)
    )


def _moved(
    frf: FrequencyResponse | TangentialResponse, plane: SPlane, z: ZPlane
) -> FrequencyResponse | TangentialResponse:
    return dataclasses.replace(frf, omega=z.omega(plane.angles(frf.omega)), dt=z.dt)


def in_image(model: Model, plane: Plane) -> Model:
    """A model of a plane in the image of its identification: one in z of a continuous model, else itself."""
    return _model(model, plane.in_z(StateMatrices.of(model)), _DT) if isinstance(plane, SPlane) else model


def from_image(model: Model, plane: Plane) -> Model:
    """The inverse of `in_image`."""
    return _model(model, plane.from_z(StateMatrices.of(model)), 0.0) if isinstance(plane, SPlane) else model


def _model(like: Model, states: StateMatrices, dt: float) -> Model:
    import control

    labels = {"inputs": like.input_labels, "outputs": like.output_labels}
    return control.StateSpace(*states, dt, remove_useless_states=False, **labels)
