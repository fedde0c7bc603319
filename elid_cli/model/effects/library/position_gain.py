"""Position gain: the proportional gain of the drive's loop is another one than the log or the robot file tells."""

from __future__ import annotations

from elid_cli.model.effects.loop_gain import LoopGain


class PositionGain(LoopGain):
    """A proportional gain that is off by a factor, while the derivative gain and the torque constant are right."""

    name = "position_gain"
    summary = "kp of the drive's loop off by a factor, its kd right"
    equation = "drive: kp / (1 + gain) (q_des - q), in place of kp (q_des - q)"
    fingerprint = "one drive: errors of the position under load off by the factor, damping right"
    record = (
        "known loads held still, and fast motion with commanded velocities: without these kd is as good as viscous"
        " friction, and a torque gain looks the same"
    )
    of_drive = "kp"
