"""Commands that may be held for their sample or change smoothly between samples: what the motion does not tell apart.

Held ones act late by half a sample, so that a delay is half a sample longer with smooth ones; where drives are stiff
the stairs move inertia and friction as well.
"""

from __future__ import annotations

from dataclasses import replace

from elid_cli.estimation.trajectory.changes import nearer_by
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.estimation.trajectory.held_loops import refitted
from elid_cli.estimation.trajectory.timing_doubts import counting
from elid_cli.signals.signals import Signals

LITTLE = 0.01
"""Logarithm per joint by which the error's size may be larger with smooth commands for these to count."""


def with_doubted_commands(fit: TrajectoryFit, signals: Signals) -> TrajectoryFit:
    """Return the fit to held commands with errors that count what smooth ones would change, where these may be."""
    recording = signals.recording
    if recording is None or not recording.doubted or recording.smooth:
        return fit
    z = fit.z.copy()
    z[fit.unknowns.delays] += 0.5 * recording.dt
    other = refitted(fit, [replace(item.run, smooth=True) for item in fit.tracked], z)
    if other is None or nearer_by(other, fit) < -LITTLE * fit.unknowns.robot.n:
        return fit
    later, drives = float((other.delays - fit.delays).mean()), fit.unknowns.drives
    return replace(counting(fit, [other.z[:drives] - fit.z[:drives]]), smoother=later)
