"""Damping gain: the derivative gain of the drive's loop is another one than the log or the robot file tells."""

from __future__ import annotations

from elid_cli.model.effects.loop_gain import LoopGain


class DampingGain(LoopGain):
    """A derivative gain that is off by a factor, while the proportional gain and the torque constant are right."""

    name = "damping_gain"
    summary = "kd of the drive's loop off by a factor, its kp right"
    equation = "drive: kd / (1 + gain) (dq_des - dq), in place of kd (dq_des - dq)"
    fingerprint = "one drive: torque that follows the commanded velocity, and viscous friction off by as much of kd"
    record = "fast motion with commanded velocities: without these kd is as good as viscous friction"
    of_drive = "kd"
