"""Asymmetric viscous friction: it grows faster with speed in one direction than in the other."""

from __future__ import annotations

import numpy as np

from elid_cli.model.effects.effect import Columns, Effect, Parameter
from elid_cli.model.effects.rows import motor_row
from elid_cli.model.effects.scene import Scene


class AsymmetricViscous(Effect):
    """The part of viscous friction that does not change sign with the direction of motion."""

    name = "asymmetric_viscous"
    title = "asymmetric viscous friction"
    summary = "viscous friction that differs between the two directions"
    equation = "motor equation: difference |θ'|"
    physics = (
        "Worm gears, lip seals and helical teeth carry their load on other flanks in the two directions, so that the"
        " friction grows by fv + difference per speed forwards and by fv - difference backwards."
    )
    typical = "5-30 % of the viscous friction"
    fingerprint = "motor side and whole joint, even in velocity: one sign both ways, largest at top speed"
    record = "motion in both directions at several speeds, in the same poses"
    place = "motor"
    takes_energy = True
    of_motor_speed = True
    acts_as = "torque"
    amplitudes = (
        Parameter("difference", "N·m·s/rad", "half the difference between forward and backward viscous friction"),
    )
    example = {"difference": -0.3}
    twins = ("torque_offset",)

    def columns(self, scene: Scene) -> Columns:
        """Return the column of the difference in the motor row."""
        return motor_row(self.joint, np.abs(scene.motion.dtheta[:, self.joint]))
