"""Controllers that are tried in the loop of every consistent plant: the step of a run, and its sentences."""

from __future__ import annotations

from robustid.app.run.work import Work
from robustid.core import Budget
from robustid.guarantees import LoopBounds, loop_bounds

_SHARE = 0.3  # of the time that is left, for each


def tried(work: Work) -> None:
    """The step that tries other controllers: proved for every consistent plant, refuted by one, or neither."""
    if work.looped is None:
        return
    for name, controller in work.controllers.items():
        with work.around.step(f"trying the controller {name}", _SHARE) as limit:
            budget = Budget(limit)
            found = loop_bounds(work.looped.band, work.looped.loop, controller, time_limit=budget.share(0.5).seconds)
            work.tried[name] = found.refuted(work.identification, time_limit=budget.seconds)


def candidate_words(name: str, found: LoopBounds) -> str:
    """Sentence on a controller that was tried."""
    words = f"Controller {name}: {found.status.value}"
    if (plant := found.refuted_by) is not None:
        return f"{words}; its closed loop has a {plant.pole_words}."
    if found.unbounded:
        return f"{words}; {found.unbounded}."
    return f"{words}; the sensitivity is at most {found.peaks['sensitivity'].value:.4g} (zone {found.zone} of ISO 14839-3:2006)."
