"""What drives were told between the samples of a log, judged again once what the motion lacked is there.

It was decided beside all that was missing: a drive whose filter of velocity nobody knows yet is late, as one is that
commands of a sample reach half of it later.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from elid_cli.diagnosis.by_motion.found import Found
from elid_cli.diagnosis.by_motion.timed_again import tuned
from elid_cli.estimation.smooth_commands import EARLIEST, as_read
from elid_cli.estimation.trajectory.held_loops import clearly_nearer, refitted
from elid_cli.model.runs import Run
from elid_cli.signals.signals import Signals
from elid_cli.signals.stepping_commands import commands_step


def told_otherwise(signals: Signals, runs: Sequence[Run], whole: Found) -> Signals | None:
    """Return a log with its commands read the other way, held or smooth, where the motion is clearly nearer so.

    None where it is not, or where the log or its user says which.

    Parameters
    ----------
    signals
        The log, with its commands as they were taken to be.
    runs
        Its stretches as they were searched.
    whole
        What was found.
    """
    taken, after = signals.recording, whole.done.after
    something = whole.changes or whole.done.named or whole.scaled.any() or whole.done.limits
    if taken is None or not taken.inferred or not something or commands_step(taken):
        return None
    smooth, z = not taken.smooth, after.z.copy()
    z[after.unknowns.delays] += (0.5 if smooth else -0.5) * taken.dt
    other = refitted(after, [replace(item.run, smooth=smooth) for item in after.tracked], z)
    other = None if other is None else tuned(whole, other, [replace(run, smooth=smooth) for run in runs])
    # with a delay that is free in one of both alone, that one takes up a simulator's short steps as well
    free = after if after.delays.any() else refitted(after, [item.run for item in after.tracked], after.z)
    after = after if free is None else free
    if other is None or clearly_nearer(after, other):
        return None
    # no drive is ahead of its commands
    early = -EARLIEST * taken.dt
    ahead = float(after.delays.mean()) < early < float(other.delays.mean())
    if not (ahead or clearly_nearer(other, after)):
        return None
    return as_read(replace(signals, recording=replace(taken, inferred=False, doubted=False)), smooth=smooth)
