"""Friction that changes while the log lasts, as a gear warms up."""

from __future__ import annotations

from elid_cli.terms.effect import Columns, Effect, Parameter, Scene
from elid_cli.terms.rows import motor_row


class FrictionDrift(Effect):
    """Coulomb and viscous friction that change linearly over the log."""

    name = "friction_drift"
    summary = "Coulomb and viscous friction that drift during the log (warm-up)"
    equation = "motor row: (t/T - 1/2) (coulomb sign(θ') + viscous θ'),  T = length of the log"
    physics = "Lubricant warms as it is sheared and gets thinner, seals soften, preload relaxes."
    typical = "viscous friction -30 to -60 % over 20-60 K, minutes to an hour"
    fingerprint = "motor and sum rows, the product of time and velocity or direction"
    record = "minutes of motion that repeat the first movement at the end; a temperature column"
    place = "motor"
    amplitudes = (
        Parameter("coulomb", "N·m", "change of Coulomb friction from the first to the last instant"),
        Parameter("viscous", "N·m·s/rad", "change of viscous friction from the first to the last instant"),
    )
    twins = ()

    def columns(self, scene: Scene) -> Columns:
        """Return the columns of both changes in the motor row."""
        time = scene.motion.t / scene.duration - 0.5
        return motor_row(self.joint, time * scene.direction(self.joint), time * scene.motion.dtheta[:, self.joint])
