# The public names, by task. Result types and helpers are in the rooms: robustid.guarantees.ResponseTube.
from . import errors as errors
from ._version import __version__ as __version__

# What to choose, change and measure next
from .advice import diagnose as diagnose
from .advice import improve_kautz as improve_kautz
from .advice import prior_weight as prior_weight
from .advice import sensitivity as sensitivity
from .advice import suggest_class as suggest_class
from .advice import suggest_kautz as suggest_kautz
from .advice import suggest_next as suggest_next
from .advice import suggest_prior as suggest_prior
from .advice import suggest_roll_off as suggest_roll_off
from .advice import suggest_scaling as suggest_scaling
from .app.files import load as load
from .app.files import save as save
from .app.look import look as look

# The whole way, reports and figures
from .app.pipeline import identify_reduced as identify_reduced
from .app.pipeline import run as run

# The class, the question and its answer
from .bases import integrators as integrators
from .bases import kautz as kautz
from .bases import passive_modes as passive_modes
from .core import Signal as Signal
from .core import show_progress as show_progress

# Measurements and their bounds
from .data import Bound as Bound
from .data import FrequencyResponse as FrequencyResponse
from .data import TangentialResponse as TangentialResponse
from .data import TimeRecord as TimeRecord
from .data import decimate as decimate
from .data import detrend as detrend
from .data import flexible_structure as flexible_structure
from .data import multisine as multisine
from .data import nonlinear_records as nonlinear_records
from .data import sample_time as sample_time

# What goes wrong; more kinds in errors
from .errors import InconsistentDataError as InconsistentDataError
from .errors import InputError as InputError
from .errors import RobustIdError as RobustIdError
from .errors import Status as Status
from .estimation import bounds_from_noise_floor as bounds_from_noise_floor
from .estimation import correct as correct
from .estimation import estimate_bound as estimate_bound
from .estimation import estimate_delay as estimate_delay
from .estimation import estimate_frf as estimate_frf
from .estimation import record_problems as record_problems
from .estimation import response_problems as response_problems
from .estimation import with_delay as with_delay

# Matrix fractions
from .fitting import MatrixFraction as MatrixFraction
from .fitting import Modal as Modal
from .fitting import RecordFit as RecordFit
from .fitting import RigidBody as RigidBody
from .fitting import RollOff as RollOff
from .fitting import StaticGain as StaticGain
from .fitting import Weight as Weight
from .fitting import Zero as Zero
from .fitting import ZeroEntries as ZeroEntries
from .fitting import fit_covariance as fit_covariance
from .fitting import fit_mfd as fit_mfd
from .fitting import fit_records as fit_records
from .fitting import modal_form as modal_form
from .fitting import mode_table as mode_table
from .fitting import suggest_order as suggest_order
from .formats import datasets as datasets

# What holds for every consistent system
from .guarantees import Band as Band
from .guarantees import Contradiction as Contradiction
from .guarantees import Family as Family
from .guarantees import Member as Member
from .guarantees import WorstCaseError as WorstCaseError
from .guarantees import band as band
from .guarantees import contradiction as contradiction
from .guarantees import coverage as coverage
from .guarantees import diameter as diameter
from .guarantees import family as family
from .guarantees import refute as refute
from .guarantees import response_tube as response_tube
from .guarantees import robust_stability_margin as robust_stability_margin
from .guarantees import structured_weight as structured_weight
from .guarantees import structured_weights as structured_weights
from .guarantees import uncertainty_weight as uncertainty_weight
from .guarantees import worst_case_error as worst_case_error
from .guarantees import worst_case_over_poles as worst_case_over_poles
from .identification import BoundedReal as BoundedReal
from .identification import Identification as Identification
from .identification import MixedProblem as MixedProblem
from .identification import NegativeImaginary as NegativeImaginary
from .identification import PositiveReal as PositiveReal
from .identification import Prior as Prior
from .identification import identify as identify
from .identification import validate as validate
from .passivity import make_passive as make_passive
from .passivity import prove_passive as prove_passive
from .passivity import reduce_passive as reduce_passive

# Small models
from .reduction import balanced_truncation as balanced_truncation
from .reduction import reduce_within_bounds as reduce_within_bounds
from .reduction import to_continuous as to_continuous
from .report import plot as plot
from .report import write_report as write_report
