# The names that most work needs, by task; the others stand in groups, and types of results in the rooms.
from . import advise as advise
from . import design as design
from . import errors as errors
from . import fits as fits
from . import guarantee as guarantee
from . import passive as passive
from . import prepare as prepare
from ._version import __version__ as __version__

# What to choose, change and measure next
from .advice import diagnose as diagnose
from .advice import suggest_kautz as suggest_kautz
from .advice import suggest_next as suggest_next
from .advice import suggest_prior as suggest_prior
from .app.load_save import load as load
from .app.load_save import save as save
from .app.look import look as look

# The whole way, reports and figures
from .app.run.pipeline import identify_reduced as identify_reduced
from .app.run.pipeline import run as run

# The class, the question and its answer
from .bases import integrators as integrators
from .bases import kautz as kautz

# Controllers
from .controllers import design_controller as design_controller
from .core import show_progress as show_progress

# Measurements and their bounds
from .data import Bound as Bound
from .data import FrequencyResponse as FrequencyResponse
from .data import TangentialResponse as TangentialResponse
from .data import TimeRecord as TimeRecord

# What goes wrong; more kinds in errors
from .errors import InputError as InputError
from .errors import RobustIdError as RobustIdError
from .errors import Status as Status
from .estimation import estimate_bound as estimate_bound
from .estimation import estimate_frf as estimate_frf

# Matrix fractions
from .fitting import RigidBody as RigidBody
from .fitting import fit_mfd as fit_mfd
from .fitting import fit_records as fit_records
from .formats import datasets as datasets

# What holds for every consistent system
from .guarantees import band as band
from .guarantees import coverage as coverage
from .guarantees import family as family
from .guarantees import interconnection as interconnection
from .guarantees import loop_bounds as loop_bounds
from .guarantees import refute as refute
from .guarantees import watch as watch
from .guarantees import worst_case_error as worst_case_error
from .identification import BoundedReal as BoundedReal
from .identification import Identification as Identification
from .identification import Loop as Loop
from .identification import MixedProblem as MixedProblem
from .identification import NegativeImaginary as NegativeImaginary
from .identification import PositiveReal as PositiveReal
from .identification import Prior as Prior
from .identification import compare as compare
from .identification import identify as identify
from .identification import validate as validate
from .passivity import prove_passive as prove_passive

# Small models
from .reduction import balanced_truncation as balanced_truncation
from .reduction import reduce_plant as reduce_plant
from .reduction import reduce_within_bounds as reduce_within_bounds
from .reduction import to_continuous as to_continuous
from .report import plot as plot
from .report import write_report as write_report
