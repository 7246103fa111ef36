"""Guarantees about every consistent plant: worst-case errors and responses with certificates, weights, margins."""

from robustid.guarantees import loop_storage as loop_storage  # registers the results that can be saved
from robustid.guarantees import storage as storage
from robustid.guarantees.band import band
from robustid.guarantees.band_result import Band
from robustid.guarantees.bilinear import ControlPair
from robustid.guarantees.cells import Pieces
from robustid.guarantees.circle import CircleBound, Peak
from robustid.guarantees.consistent_set import Sample, consistent_set
from robustid.guarantees.contradictions import Contradiction, contradiction
from robustid.guarantees.coverage import coverage, on_lines
from robustid.guarantees.coverage_result import Coverage
from robustid.guarantees.diameter import Diameter, diameter
from robustid.guarantees.drift import Drift, drift
from robustid.guarantees.family import family, frequencies_of
from robustid.guarantees.family_result import Driver, Family
from robustid.guarantees.fleet import QUANTITIES, Fleet, FleetRow, FleetState, Outlier, fleet_of
from robustid.guarantees.interconnection import interconnection
from robustid.guarantees.interconnection_result import Interconnection, InterconnectionStatus
from robustid.guarantees.linear.error_sets import ErrorSets
from robustid.guarantees.linear.functions import has_box
from robustid.guarantees.linear.pole_discs import told_apart_of
from robustid.guarantees.linear.predictions import SampleCheck, check_samples
from robustid.guarantees.loop_axis import BandAxis, LoopMargins, margins_of
from robustid.guarantees.loop_bounds import LoopBounds, LoopStatus, loop_bounds
from robustid.guarantees.loop_by_loop import MarginsByLoop, margins_by_loop
from robustid.guarantees.loop_distance import CoprimeFactors, LoopDistance, coprime, ncf_margin, nu_gap
from robustid.guarantees.loop_placement import limiting_polygons
from robustid.guarantees.loop_steps import STEPS, StepTube, settled, step_tube, step_tubes
from robustid.guarantees.loop_values import Balls, LoopValues, worst_of
from robustid.guarantees.member import Member, called_otherwise, otherwise_words
from robustid.guarantees.next_record import Ranked, band_of_others, chance_of_order, ranked
from robustid.guarantees.nominal import as_frequencies, default_grid, narrow_band
from robustid.guarantees.outputs import output_errors
from robustid.guarantees.over_poles import WorstCaseOverPoles, worst_case_over_poles
from robustid.guarantees.parameters import ParameterIntervals
from robustid.guarantees.pole_cells import PoleCell, box_of
from robustid.guarantees.power import Judgement, shown
from robustid.guarantees.proof_file import proof_text, proof_texts
from robustid.guarantees.refute import Refutation, refute
from robustid.guarantees.response_discs import ResponseDiscs
from robustid.guarantees.scope import in_box, real_poles, scope_of
from robustid.guarantees.stability_margin import MarginStatus, RobustStabilityMargin, robust_stability_margin
from robustid.guarantees.stated_box import checked_box
from robustid.guarantees.tubes import ResponseTube, response_tube
from robustid.guarantees.unstable_plant import UnstablePlant
from robustid.guarantees.value_set import ValueSet, norm_of_bounds
from robustid.guarantees.watch import watch
from robustid.guarantees.watch_result import Place, Sensitivity, Watch, Watched
from robustid.guarantees.weight import UncertaintyWeight, entry_weights, magnitude_weight, uncertainty_weight
from robustid.guarantees.weight_structures import (
    StructuredPlant,
    StructuredWeight,
    structured_weight,
    structured_weights,
)
from robustid.guarantees.whole_axis import largest_error
from robustid.guarantees.widening import bounds_of_entries
from robustid.guarantees.worst_case import LEAST, MOST, error_in_time, growing_error, worst_case_error
from robustid.guarantees.worst_case_result import WorstCaseError

__all__ = [
    "LEAST",
    "MOST",
    "QUANTITIES",
    "STEPS",
    "Balls",
    "Band",
    "BandAxis",
    "CircleBound",
    "Contradiction",
    "ControlPair",
    "CoprimeFactors",
    "Coverage",
    "Diameter",
    "Drift",
    "Driver",
    "ErrorSets",
    "Family",
    "Fleet",
    "FleetRow",
    "FleetState",
    "Interconnection",
    "InterconnectionStatus",
    "Judgement",
    "LoopBounds",
    "LoopDistance",
    "LoopMargins",
    "LoopStatus",
    "LoopValues",
    "MarginStatus",
    "MarginsByLoop",
    "Member",
    "Outlier",
    "ParameterIntervals",
    "Peak",
    "Pieces",
    "Place",
    "PoleCell",
    "Ranked",
    "Refutation",
    "ResponseDiscs",
    "ResponseTube",
    "RobustStabilityMargin",
    "Sample",
    "SampleCheck",
    "Sensitivity",
    "StepTube",
    "StructuredPlant",
    "StructuredWeight",
    "UncertaintyWeight",
    "UnstablePlant",
    "ValueSet",
    "Watch",
    "Watched",
    "WorstCaseError",
    "WorstCaseOverPoles",
    "as_frequencies",
    "band",
    "band_of_others",
    "bounds_of_entries",
    "box_of",
    "called_otherwise",
    "chance_of_order",
    "check_samples",
    "checked_box",
    "consistent_set",
    "contradiction",
    "coprime",
    "coverage",
    "default_grid",
    "diameter",
    "drift",
    "entry_weights",
    "error_in_time",
    "family",
    "fleet_of",
    "frequencies_of",
    "growing_error",
    "has_box",
    "in_box",
    "interconnection",
    "largest_error",
    "limiting_polygons",
    "loop_bounds",
    "magnitude_weight",
    "margins_by_loop",
    "margins_of",
    "narrow_band",
    "ncf_margin",
    "norm_of_bounds",
    "nu_gap",
    "on_lines",
    "otherwise_words",
    "output_errors",
    "proof_text",
    "proof_texts",
    "ranked",
    "real_poles",
    "refute",
    "response_tube",
    "robust_stability_margin",
    "scope_of",
    "settled",
    "shown",
    "step_tube",
    "step_tubes",
    "structured_weight",
    "structured_weights",
    "told_apart_of",
    "uncertainty_weight",
    "watch",
    "worst_case_error",
    "worst_case_over_poles",
    "worst_of",
]
