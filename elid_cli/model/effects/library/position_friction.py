"""Friction that varies with the angle of the joint."""

from __future__ import annotations

import math

from elid_cli.model.effects.effect import Columns, Parameter
from elid_cli.model.effects.harmonics import ORDER, PHASE, Harmonic
from elid_cli.model.effects.rows import motor_row
from elid_cli.model.effects.scene import Scene


class PositionFriction(Harmonic):
    """Coulomb friction with a part that repeats with the joint's angle."""

    name = "position_friction"
    summary = "Coulomb friction that varies with the joint's angle"
    equation = "motor equation: amplitude sin(order θ + phase) sign(θ')"
    physics = "An eccentric gear, a bent shaft or a worn stretch presses harder at some angles than at others."
    typical = "5-20 % of the Coulomb friction; order 1 to a few, or that of a gear stage"
    fingerprint = "motor side and whole joint, periodic in the angle, and its sign flips with the direction of motion"
    record = "whole turns of the joint, or its full range, in both directions at low speed"
    place = "motor"
    takes_energy = True
    acts_as = "friction"
    amplitudes = (Parameter("amplitude", "N·m", "how far Coulomb friction swings about its mean", low=0.0), PHASE)
    shapes = (ORDER,)
    example = {"amplitude": 0.5, "phase": -2.0, "order": 3.0}
    highest = 30
    periods = 0.3  # it flips with the direction of motion, which no other bend does; of less, all orders are a line

    @classmethod
    def least(cls, span: float) -> tuple[float, ...]:
        """Return the order whose periods the angle covered just holds: nothing else has lower ones' change of sign."""
        return (max(2 * math.pi * cls.periods / max(span, 1e-9), ORDER.low),)

    def columns(self, scene: Scene) -> Columns:
        """Return the sine and the cosine column in the motor row."""
        direction = scene.direction(self.joint)
        sine, cosine = self.waves(scene)
        return motor_row(self.joint, sine * direction, cosine * direction)
