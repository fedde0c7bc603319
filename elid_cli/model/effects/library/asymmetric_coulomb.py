"""Asymmetric Coulomb friction: more friction in one direction than in the other."""

from __future__ import annotations

import numpy as np

from elid_cli.model.effects.effect import Columns, Effect, Parameter
from elid_cli.model.effects.rows import motor_row
from elid_cli.model.effects.scene import Scene


class AsymmetricCoulomb(Effect):
    """The part of Coulomb friction that does not change sign with the direction of motion."""

    name = "asymmetric_coulomb"
    summary = "Coulomb friction that differs between the two directions"
    equation = "motor equation: difference |sign(θ')|"
    physics = (
        "Tooth flanks, seals and preloaded bearings are loaded differently in the two directions, so that the friction"
        " is fs + difference forwards and fs - difference backwards."
    )
    typical = "5-30 % of the Coulomb friction"
    fingerprint = "motor side and whole joint, a constant while the joint moves in either direction, gone at rest"
    record = "motion in both directions at several speeds, and a rest that holds the joint without load"
    place = "motor"
    takes_energy = True
    of_motor_speed = True
    acts_as = "directed friction"
    amplitudes = (Parameter("difference", "N·m", "half the difference between forward and backward Coulomb friction"),)
    example = {"difference": -0.4}
    twins = ("torque_offset",)

    def columns(self, scene: Scene) -> Columns:
        """Return the column of the difference in the motor row."""
        return motor_row(self.joint, np.abs(scene.direction(self.joint)))
