"""Viscous friction on the link side of the transmission."""

from __future__ import annotations

from elid_cli.model.effects.effect import Columns, Effect, Parameter
from elid_cli.model.effects.rows import link_row
from elid_cli.model.effects.scene import Scene


class LinkViscous(Effect):
    """Viscous friction of the link's bearings and seals, or of the medium it moves in."""

    name = "link_viscous"
    summary = "viscous friction on the link side"
    equation = "link equation: friction q'"
    physics = "Grease in the output bearing, drag in cables and hoses, a damper mounted on the link."
    typical = "5-30 % of the motor's viscous friction"
    fingerprint = "whole joint only, along the link's velocity"
    record = "fast motion with link and motor encoders; at a rigid joint it is one with the motor's friction"
    place = "link"
    acts_as = "torque"
    elastic_only = True
    amplitudes = (Parameter("friction", "N·m·s/rad", "friction torque per link velocity", low=0.0),)
    example = {"friction": 0.8}

    def columns(self, scene: Scene) -> Columns:
        """Return the column of the friction in the link row."""
        return link_row(self.joint, scene.motion.dq[:, self.joint])
