"""Position gain: the proportional gain of the drive's loop is another one than the log or the robot file tells."""

from __future__ import annotations

from elid_cli.model.effects.effect import Columns, Effect, Parameter
from elid_cli.model.effects.scene import Scene


class PositionGain(Effect):
    """A proportional gain that is off by a factor, while the derivative gain and the torque constant are right.

    It acts in the simulated motion, and in the torque that is computed from the log (`of_drives.with_loop_gains`);
    it has no column.
    """

    name = "position_gain"
    summary = "kp of the drive's loop off by a factor, its kd right"
    equation = "drive: kp / (1 + gain) (q_des - q), in place of kp (q_des - q)"
    physics = (
        "Gains are set in the drive's own units, one by one, and a log or a configuration file holds what somebody"
        " believed them to be."
    )
    typical = "±5-50 %"
    fingerprint = "one drive: errors of the position under load off by the factor, damping right"
    record = (
        "known loads held still, and fast motion with commanded velocities: without these kd is as good as viscous"
        " friction, and a torque gain looks the same"
    )
    place = "torque"
    searched = False
    either_sign = "A gain is off either way."
    of_drive = "kp"
    amplitudes = (Parameter("gain", "1", "share by which the logged kp is too large", low=-0.8, high=3.0),)
    example = {"gain": 0.2}
    simulated = "loop"

    def columns(self, scene: Scene) -> Columns:
        """Return nothing: a declared gain is in the computed torque, and the motion finds others."""
        return {}
