"""When drives act, judged again once what the motion lacked is there: either bends the other.

Loops that hold their torque, steps of a simulator and limits of torques were looked for beside all that was missing.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elid_cli.diagnosis.by_motion.found import Found
from elid_cli.diagnosis.by_motion.limits_in_steps import runs_in_steps
from elid_cli.estimation.trajectory.changes import retuned
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.estimation.trajectory.held_loops import at_all_times, clearly_nearer, refitted
from elid_cli.estimation.trajectory.simulator_steps import is_timed, retimed
from elid_cli.model.runs import Run
from elid_cli.signals.signals import Signals


def timed_again(
    signals: Signals, bare: Sequence[Run], runs: Sequence[Run], timed: TrajectoryFit | None, whole: Found
) -> tuple[list[Run], TrajectoryFit | None]:
    """Return stretches as drives act in time beside what a search found, and the fit that judged it.

    Parameters
    ----------
    signals
        The log.
    bare, runs
        Its stretches as they are described, and as they were searched.
    timed
        The fit that judged these, without what was found.
    whole
        What was found.
    """
    after = whole.done.after
    changed = bool(whole.changes or whole.scaled.any() or whole.done.limits)
    if changed and runs[0].drives.held is not None and bare[0].drives.held is None:
        # loops may have been found in the place of what was missing, such as a filter of velocity
        free = at_all_times(after)
        free = None if free is None else tuned(whole, free, bare)
        if free is not None and clearly_nearer(free, after):
            return list(bare), free
    if not is_timed(timed, signals):
        other = runs_in_steps(runs, after, whole.done.limits)
        if other[0] is not runs[0] or not is_timed(after, signals):
            return other, timed
        # filters of velocity were found where loops that hold had not been looked for, and imitate them
        kinds = {change.by.kind.of_drive for change in whole.changes}
        filtered = "filter" in kinds and kinds <= {"", "filter"} and not whole.scaled.any()
        free = refitted(after, runs, after.z) if filtered else after
        return (list(runs), timed) if free is None else retimed(runs, free, signals)
    if _alike(runs[0], bare[0]):
        return list(runs), timed
    if changed or not whole.done.named:
        return list(runs), timed
    free = refitted(after, bare, after.z)
    if free is None or not is_timed(free, signals):
        return list(runs), timed
    other, again = retimed(bare, free, signals)
    return (list(runs), timed) if _alike(other[0], runs[0]) else (other, again)


def tuned(whole: Found, fit: TrajectoryFit, plain: Sequence[Run]) -> TrajectoryFit:
    """Return a fit with the last of the changes that were found as it is beside drives that act otherwise.

    `plain` are the stretches with these, without what was found.
    """
    if not whole.changes:
        return fit
    for change in whole.changes[:-1]:
        plain = change.runs(plain)
    again = retuned(whole.changes[-1], fit, plain)
    return fit if again is None else again.fit


def _alike(one: Run, other: Run) -> bool:
    """Whether the drives of two stretches compute their torques at the same instants, in the same steps."""
    mine, its = one.drives, other.drives
    held = [np.zeros(1) if drives.held is None else drives.held for drives in (mine, its)]
    steps = [len(run.drives.told) if run.drives.stepped else 0 for run in (one, other)]
    return mine.stepped == its.stepped and steps[0] == steps[1] and np.array_equal(held[0], held[1])
