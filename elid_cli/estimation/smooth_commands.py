"""What drives were told between the samples of a log: the last command, or more commands than the log holds.

A log that is slower than its commands holds one of ten, say. Taken as held for a sample these act late by half of it:
the motion seems ahead of its commands, and inertia and friction make up for stairs that no drive was given.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from elid_cli.estimation.result import Identification
from elid_cli.model.effects import effect_that
from elid_cli.signals.command_torque import command_torque
from elid_cli.signals.signals import Signals

AHEAD = 0.25
"""Part of a sample by which the motion must seem ahead of held commands: half of one where they change all the time."""
EARLIEST = 0.1
"""The same by which it may seem ahead of smooth ones: drives that are told often act late by half of their own time."""
WORSE = 1.2
"""Times by which torques may be predicted worse, which noise of the positions is in."""
SMOOTH = "smooth"
"""What `settings["commands"]` of a fit says whose commands change smoothly from sample to sample."""
NOTE = (
    "commands are taken to change smoothly from sample to sample, not to be held: the motion is ahead of held ones, "
    "as where drives are told more often than is logged (give replay and validate --commands smooth)"
)


def smoothed(signals: Signals, found: Identification, fit: Callable[[Signals], Identification]) -> Signals | None:
    """Return a log with commands that change smoothly from sample to sample; None where they are held.

    Parameters
    ----------
    signals, found
        The log, and what least squares say of it with commands that are held for their sample.
    fit
        Least squares of a log.
    """
    recording = signals.recording
    if recording is None or recording.smooth or not recording.commanded.all():
        return None
    before = _delay(found)
    if not before < -AHEAD * signals.dt:
        return None
    smooth = as_smooth(signals)
    after = fit(smooth)
    late = _delay(after) > -EARLIEST * signals.dt
    return smooth if late and _error(after) <= WORSE * _error(found) else None


def as_smooth(signals: Signals) -> Signals:
    """Return a log of commands alone whose commands change smoothly from sample to sample."""
    assert signals.recording is not None
    recording = replace(signals.recording, smooth=True)
    tau, told = command_torque(recording)
    return replace(signals, tau=tau, command_torque=told, recording=recording)


def noted(found: Identification) -> Identification:
    """Return the fit of a log with such commands, which says so."""
    return replace(found, notes=(*found.notes, NOTE), settings={**found.settings, "commands": SMOOTH})


def _delay(found: Identification) -> float:
    """Return the median of the drives' delays, s; 0 where none was found."""
    name = effect_that(nuisance="delay").name
    delays = [item.parameters["delay"] for item in found.nuisances if item.effect == name]
    return float(np.median(delays)) if delays else 0.0


def _error(found: Identification) -> float:
    """Return the error of the predicted torques as a part of them, the mean over joints."""
    sizes = [max(item.relative, 1e-9) for item in found.error.values()]
    return float(np.exp(np.mean(np.log(sizes)))) if sizes else 0.0
