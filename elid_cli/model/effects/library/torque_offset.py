"""Torque offset: a constant torque in the motor's channel."""

from __future__ import annotations

import numpy as np

from elid_cli.model.effects.effect import Columns, Effect, Parameter
from elid_cli.model.effects.rows import motor_row
from elid_cli.model.effects.scene import Scene


class TorqueOffset(Effect):
    """A constant torque on the motor side, moving or not."""

    name = "torque_offset"
    summary = "constant torque on the motor side (current offset, cable)"
    equation = "motor equation: offset"
    physics = (
        "The current sensor or the amplifier reads a constant too much, or a cable bundle pulls the motor one way."
    )
    typical = "0.5-3 % of the rated torque"
    fingerprint = "motor side and whole joint, constant in everything"
    record = "rests as well as motion in both directions: asymmetric friction vanishes at rest, an offset does not"
    place = "motor"
    either_sign = "A zero is off either way."
    acts_as = "torque"
    of_channel = True
    amplitudes = (Parameter("offset", "N·m", "torque that the log holds beyond what the joint needs"),)
    nuisance = "offset"
    example = {"offset": 0.9}
    twins = ("asymmetric_coulomb", "encoder_offset")

    def columns(self, scene: Scene) -> Columns:
        """Return the column of the offset in the motor row."""
        return motor_row(self.joint, np.ones(scene.samples))
