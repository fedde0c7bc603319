"""Which periods loops that hold their torque may have beside a log, and how late they take its commands."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.estimation.trajectory.unseen_loops import SHORTEST

WHOLE = 0.25
"""Part of a period by which a delay may be off a whole number of periods: a loop that runs at the log's instants is
told its commands at these."""
OFTEN = 2, 4, 5, 8, 10
"""How often in a sample loops may run, beside once …"""
PERIODS = 2e-3, 2.5e-3, 4e-3, 5e-3, 8e-3, 1e-2
"""… and their usual periods, s, which need be no part of a sample."""
MOST, EXACTLY = 20, 2e-3
"""Most parts of a sample at which loops may run, and part by which their periods may be off these."""
SLIGHT, SURELY = 5e-4, 1.5e-4
"""s by which a delay may be off whole periods in any case, half a step of many simulators; and in these steps."""


def allowed_loops(dt: float) -> list[float]:
    """Return how often in a sample loops may run, the most often first."""
    parts = {1.0, *(float(often) for often in OFTEN if dt / often >= SHORTEST)}
    for period in PERIODS:
        often = Fraction(dt / period).limit_denominator(MOST)
        if often and abs(often * period / dt - 1) < EXACTLY and often.numerator <= MOST:
            parts.add(float(often))
    return sorted(parts, reverse=True)


def can_delay(fit: TrajectoryFit, period: float, part: float = WHOLE) -> bool:
    """Whether loops of a period, s, make commands as late as the motion has them: by whole periods, as they act."""
    late = fit.delays - late_commands(fit, period)
    apart = np.abs(late - np.maximum(np.round(late / period), 0.0) * period)
    stepped = any(item.run.drives.stepped is not None for item in fit.tracked)
    return bool((apart <= (SURELY if stepped else max(part * period, SLIGHT))).all())


def late_commands(fit: TrajectoryFit, period: float) -> Array:
    """Return by how much loops of a period, s, take commands later than these change, on average, s, (R,).

    Large changes count for more. Loops that run at every instant of the log take them at once.
    """
    late, weight = np.zeros((2, fit.unknowns.recordings))
    for item in fit.tracked:
        run = item.run
        if run.told is None:
            continue
        change = np.diff(run.told, axis=0)
        size = np.sum((change / np.maximum(np.sqrt(np.mean(change**2, axis=0)), 1e-300)) ** 2, axis=1)
        places = (run.begun + np.arange(1, len(run.t))) * run.dt / period
        late[run.source] += period * float(size @ (np.ceil(places - 1e-6) - places))
        weight[run.source] += float(size.sum())
    found: Array = np.maximum(late, 0.0) / np.maximum(weight, 1e-300)
    return found
