"""Damping gain: the derivative gain of the drive's loop is another one than the log or the robot file tells."""

from __future__ import annotations

from elid_cli.model.effects.effect import Columns, Effect, Parameter
from elid_cli.model.effects.scene import Scene


class DampingGain(Effect):
    """A derivative gain that is off by a factor, while the proportional gain and the torque constant are right.

    It acts in the simulated motion, and in the torque that is computed from the log (`of_drives.with_loop_gains`); it
    has no column.
    """

    name = "damping_gain"
    summary = "kd of the drive's loop off by a factor, its kp right"
    equation = "drive: kd / (1 + gain) (dq_des - dq), in place of kd (dq_des - dq)"
    physics = (
        "Gains are set in the drive's own units, one by one, and a log or a configuration file holds what somebody"
        " believed them to be."
    )
    typical = "±5-50 %"
    fingerprint = "one drive: torque that follows the commanded velocity, and viscous friction off by as much of kd"
    record = "fast motion with commanded velocities: without these kd is as good as viscous friction"
    place = "torque"
    searched = False
    either_sign = "A gain is off either way."
    of_drive = "kd"
    amplitudes = (Parameter("gain", "1", "share by which the logged kd is too large", low=-0.8, high=3.0),)
    example = {"gain": 0.2}
    simulated = "loop"

    def columns(self, scene: Scene) -> Columns:
        """Return nothing: a declared gain is in the computed torque, and the motion finds others."""
        return {}
