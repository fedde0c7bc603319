"""Torque ripple and cogging: a motor torque that varies with the angle."""

from __future__ import annotations

from elid_cli.model.effects.effect import Columns, Parameter
from elid_cli.model.effects.harmonics import ORDER, PHASE, Harmonic
from elid_cli.model.effects.rows import motor_row
from elid_cli.model.effects.scene import Scene


class TorqueRipple(Harmonic):
    """A torque on the rotor that repeats with the motor's angle."""

    name = "torque_ripple"
    summary = "motor torque that ripples with the angle (cogging)"
    equation = "motor equation: amplitude sin(order θ + phase)"
    physics = (
        "Rotor magnets snap to the stator's teeth (cogging); slots and current scaling errors modulate the torque."
    )
    typical = "0.5-5 % of the rated torque; order = gear ratio times pole pairs, or a multiple"
    fingerprint = "motor side and whole joint, periodic in the motor's angle whatever the direction of motion"
    record = "slow steady motion in both directions, slow enough that the ripple stays below the filter's cut-off"
    place = "motor"
    acts_as = "torque"
    amplitudes = (Parameter("amplitude", "N·m", "height of the ripple", low=0.0), PHASE)
    shapes = (ORDER,)
    example = {"amplitude": 0.8, "phase": 2.5, "order": 12.0}

    def columns(self, scene: Scene) -> Columns:
        """Return the sine and the cosine column in the motor row."""
        return motor_row(self.joint, *self.waves(scene))
