"""Commanded velocities that a log does not hold: none, or the rate of the commanded positions.

Small servos damp the error: what they are told is a position, and its rate is theirs. Others damp the velocity. A log
that holds no `dq_des` may be of either, and taken for the other one friction and delays make up for kd times that rate.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elid_cli.estimation.trajectory.nearer import nearer_by_motion
from elid_cli.logs.mapping.resolve import RATE
from elid_cli.robot.robot import Robot
from elid_cli.signals.command_torque import command_torque, held_mean, rates_of
from elid_cli.signals.signals import Signals

NOTE = (
    "no dq_des is logged: the drives are taken to be told the rate of q_des, with which the motion is clearly nearer "
    "than with none"
)


def with_rates(robot: Robot, signals: Signals) -> Signals:
    """Return a log of commands whose drives are told the rate of their positions, where the motion is clearly nearer.

    Else they are told none. A log that holds commanded velocities, or not all of whose torques are computed from
    commands, is returned as it is.
    """
    recording = signals.recording
    if recording is None or "dq_des" in recording.commands or not recording.commanded.all():
        return signals
    kd = np.nan_to_num(recording.commands["kd"])
    if not kd.any():
        return signals
    bounds = [(segment.start, segment.stop) for segment in recording.segments]
    rate = rates_of(recording.commands["q_des"], bounds, recording.dt)
    limits = robot.torque_limits
    tau = np.clip(recording.tau + kd * held_mean(rate, bounds), -limits, limits)
    told = replace(
        recording, tau=tau, commands={**recording.commands, "dq_des": rate},
        sources={**recording.sources, "dq_des": RATE}, notes=(*recording.notes, NOTE),
    )  # fmt: skip
    torque, delayed = command_torque(told)
    other = replace(signals, recording=told, tau=torque, command_torque=delayed)
    none = replace(recording, commands={**recording.commands, "dq_des": np.zeros_like(rate)})
    return other if nearer_by_motion(robot, signals, other) > 0 else replace(signals, recording=none)
