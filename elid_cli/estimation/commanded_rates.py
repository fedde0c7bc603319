"""Commanded velocities that a log does not hold: none, or the rate of the commanded positions.

Small servos damp the error: what they are told is a position, and its rate is theirs. Others damp the velocity. A log
that holds no `dq_des` may be of either, and taken for the other one friction and delays make up for kd times that rate.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elid_cli.estimation.trajectory.nearer import Known, Nearer, nearer_by_motion
from elid_cli.logs.checks.commanded import UNTOLD, commanded_torque
from elid_cli.logs.mapping.resolve import RATE
from elid_cli.robot.robot import Robot
from elid_cli.signals.command_torque import command_torque, rates_of
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import Signals

BY_FAR = 2.0
"""Logarithm, per joint, by which the error's size falls where that cannot be what else a model lacks. Measured: 0.4 at
most for springs, quadratic friction and integral terms of drives that are told none; 0.7 to 4 for rates with these."""
TOLD = "no dq_des is logged: the drives are taken to be told the rate of q_des, with which the motion is clearly nearer"
NONE = "no dq_des is logged: no commanded velocity is assumed, with which the motion is clearly nearer"
UNSURE = (
    "no dq_des is logged: no commanded velocity is assumed; the motion is nearer with the rate of q_des, but more "
    "than that is missing (--map dq_des=rate takes the rate)"
)


def with_rates(robot: Robot, signals: Signals) -> Signals:
    """Return a log of commands whose drives are told the rate of their positions, where the motion shows that.

    It does where it is clearly nearer then and only about noise is left, or where it is nearer by far: what else a
    model lacks may look so. Else they are told none. A log that holds commanded velocities, or not all of whose torques
    are computed from commands, is returned as it is.
    """
    recording = signals.recording
    if recording is None or "dq_des" in recording.commands or not recording.commanded.all():
        return signals
    if not np.nan_to_num(recording.commands["kd"]).any():
        return signals
    told = rated(robot, recording)
    torque, delayed = command_torque(told)
    other = replace(signals, recording=told, tau=torque, command_torque=delayed)
    known: Known = {}
    nearer = nearer_by_motion(robot, signals, other, known=known)
    if _is_told(robot, nearer):
        if not _as_near_without(robot, signals, other, known):
            return other
        nearer = None
    none = {**recording.commands, "dq_des": np.zeros_like(recording.commands["q_des"])}
    notes = tuple(_none(nearer) if note == UNTOLD else note for note in recording.notes)
    return replace(signals, recording=replace(recording, commands=none, notes=notes))


def _is_told(robot: Robot, nearer: Nearer | None) -> bool:
    return nearer is not None and nearer.by > (0.0 if nearer.at_noise else BY_FAR * robot.n)


def _as_near_without(robot: Robot, plain: Signals, told: Signals, known: Known) -> bool:
    """Whether drives that are told no rate come as near where commands are smooth, or their loops hold their torque.

    Of such drives neither inertia nor viscous friction is left by a fit that lacks this, which rates and a delay of
    many samples make up for.
    """
    recording = plain.recording
    assert recording is not None
    if recording.smooth is None:
        smooth = replace(recording, smooth=True)
        torque, delayed = command_torque(smooth)
        one = replace(plain, recording=smooth, tau=torque, command_torque=delayed)
        if not _is_told(robot, nearer_by_motion(robot, one, told, known=known)):
            return True
    looped = None if recording.smooth else nearer_by_motion(robot, plain, told, loops=True, known=known)
    return not recording.smooth and not _is_told(robot, looped)


def rated(robot: Robot, recording: Recording) -> Recording:
    """Return a recording without commanded velocities as one of drives that are told the rate of their positions."""
    bounds = [(segment.start, segment.stop) for segment in recording.segments]
    commands = recording.commands
    measured = {name: values for name in ("q", "theta", "dq", "dtheta")
                if (values := recording.signal(name)) is not None}  # fmt: skip
    gains = {name: commands[name] for name in ("kp", "kd")}
    rate = rates_of(commands["q_des"], bounds, recording.dt)
    _, before = commanded_torque({**measured, **commands}, gains, bounds, recording.dt, robot)
    tau, after = commanded_torque({**measured, **commands, "dq_des": rate}, gains, bounds, recording.dt, robot)
    notes = [TOLD if note == UNTOLD else note.replace("- kd dq", "+ kd (dq_des - dq)")
             for note in recording.notes if note not in before or note in after]  # fmt: skip
    return replace(
        recording, tau=tau, commands={**commands, "dq_des": rate}, sources={**recording.sources, "dq_des": RATE},
        notes=(*notes, *(note for note in after if note not in notes)),
    )  # fmt: skip


def _none(nearer: Nearer | None) -> str:
    if nearer is None or nearer.by == 0:
        return UNTOLD
    return UNSURE if nearer.by > 0 else NONE
