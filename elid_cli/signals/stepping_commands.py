"""Whether a log's commands step, as those of a policy or of a program that goes from pose to pose."""

from __future__ import annotations

import numpy as np

from elid_cli.signals.recording import Recording

KEPT, DIGITS = 0.8, 3.0
"""Part of the changes of commands after which these keep their values, and times the least change that the usual one
is, from which commands step and are not smooth."""


def commands_step(recording: Recording) -> bool:
    """Whether commands step, as those of a policy: after most of their changes they keep their values.

    Slow smooth ones of few digits do so as well; they change by one digit.
    """
    told = recording.commands["q_des"]
    steps = [np.diff(told[segment.start : segment.stop], axis=0) for segment in recording.segments]
    now, after = (np.concatenate([part[own] for part in steps]) for own in (slice(None, -1), slice(1, None)))
    sizes = np.abs(now[now != 0])
    if not len(sizes) or np.median(sizes) < DIGITS * sizes.min():
        return False
    return float(np.mean(after[now != 0] == 0)) > KEPT
