"""Coulomb friction on the link side of the transmission."""

from __future__ import annotations

import numpy as np

from elid_cli.model.effects.effect import Columns, Effect, Parameter
from elid_cli.model.effects.rows import link_row
from elid_cli.model.effects.scene import DIRECTION_WIDTH, Scene


class LinkCoulomb(Effect):
    """Dry friction of the link's bearings and seals."""

    name = "link_coulomb"
    summary = "Coulomb friction on the link side (bearings, seals)"
    equation = "link equation: friction sign(q')"
    physics = "Output bearing and lip seal sit behind the elastic gear: their friction bends the transmission."
    typical = "5-30 % of the motor's Coulomb friction"
    fingerprint = "whole joint only, along the sign of the link's velocity"
    record = "slow reversals with link and motor encoders; at a rigid joint it is one with the motor's friction"
    place = "link"
    acts_as = "friction"
    elastic_only = True
    amplitudes = (Parameter("friction", "N·m", "friction torque while the link moves", low=0.0),)
    example = {"friction": 1.5}

    def columns(self, scene: Scene) -> Columns:
        """Return the column of the friction in the link row."""
        return link_row(self.joint, np.tanh(scene.motion.dq[:, self.joint] / DIRECTION_WIDTH))
