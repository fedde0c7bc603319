"""Friction that changes while the log lasts, as a gear warms up."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

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

    @classmethod
    def plausible(cls, scene: Scene, joint: int, values: Mapping[str, float]) -> bool:
        """Whether friction stays friction: neither part may turn around during the log (±half of it each way)."""
        known = dict(zip(scene.robot.parameter_names(), scene.parameters.tolist(), strict=True))
        coulomb, viscous = known[f"fs{joint + 1}"], known[f"fv{joint + 1}"]
        if coulomb <= 0 and viscous <= 0:
            return True
        speed = float(np.quantile(np.abs(scene.motion.dtheta[:, joint]), 0.9))
        whole = max(coulomb, 0.0) + max(viscous, 0.0) * speed
        return bool(abs(values["coulomb"]) + abs(values["viscous"]) * speed < 1.5 * whole)

    def columns(self, scene: Scene) -> Columns:
        """Return the columns of both changes in the motor row."""
        time = scene.motion.t / scene.duration - 0.5
        return motor_row(self.joint, time * scene.direction(self.joint), time * scene.motion.dtheta[:, self.joint])
