"""Integral action: the drive's position loop adds up its error, and the torque computed from commands does not."""

from __future__ import annotations

from elid_cli.model.effects.effect import Columns, Effect, Parameter
from elid_cli.model.effects.rows import motor_row
from elid_cli.model.effects.scene import Scene


class IntegralAction(Effect):
    """An integral term of a position loop, beside the proportional and derivative gains that the log holds.

    The column is the integral of the torque that the proportional gain gives. What the integrator held when the log
    began is a constant: a part of the torque offset.
    """

    name = "integral_action"
    summary = "integral term of the drive's position loop"
    equation = "motor equation: -rate times the integral of kp (q_des - q)"
    physics = (
        "Position loops of servos and industrial drives add up what is left of the error, so that the joint comes to"
        " the commanded position under load. Gains that are logged as kp and kd leave this torque out."
    )
    typical = "0.2-10 1/s: a time constant kp/ki of 0.1 to 5 s"
    fingerprint = "one joint, slow: the error of the position fades after every change of load"
    record = "rests after motion, in poses of unlike load: with it the position comes to the command, else it does not"
    place = "torque"
    searched = False
    of_drive = "integral"
    amplitudes = (Parameter("rate", "1/s", "integral over proportional gain, 1/Tᵢ", low=0.0, high=100.0),)
    example = {"rate": 1.0}
    simulated = "loop"

    def columns(self, scene: Scene) -> Columns:
        """Return minus the integral of the proportional torque in the motor row; nothing where the log holds none."""
        if scene.error_integral is None:
            return {}
        return motor_row(self.joint, -scene.error_integral[:, self.joint])
