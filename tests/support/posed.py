"""Problems that the program poses about data."""

from robustid.app.run.measurements import Measured
from robustid.app.run.posing import posed
from robustid.app.run.run_file import RunFile
from robustid.app.run.run_folder import Surroundings
from robustid.app.run.settings import Withheld


def proposed(frequency=(), time=(), **sections):
    """The problem that `robustid identify` poses, and the choices that were made."""
    asked = RunFile(withheld=Withheld(every=0), **sections)
    run, problem, _ = posed(asked, Measured(tuple(frequency), tuple(time)), Surroundings(), reference=False)
    return problem, run.choices
