"""Encoder skew: link and motor encoders read at different instants."""

from __future__ import annotations

import numpy as np

from elid_cli._types import Array
from elid_cli.model.effects.bodies import body_torque
from elid_cli.model.effects.effect import Columns, Parameter
from elid_cli.model.effects.late_positions import STEP, LatePositions
from elid_cli.model.effects.rows import spring_rows
from elid_cli.model.effects.scene import EquationRow, Scene


class EncoderSkew(LatePositions):
    """A time shift of one joint's link encoder against every other channel.

    To first order the true link angle is q + skew q', which changes the spring's torque by K skew q'. The column holds
    that; what the bodies need changes too, and is put right by moving the channel in time once the skew is known.
    """

    name = "encoder_skew"
    summary = "link encoder sampled at another instant than the motor encoder"
    equation = "link equation: +K skew q', motor equation: the same with -; the link's channels moved by the skew"
    physics = "Two encoders on two buses, or one with a filter: the difference of their readings follows the speed."
    typical = "a tenth of a sample to 5 ms"
    fingerprint = "motor side more than whole joint, along the link's velocity, not its deflection"
    record = "fast, lightly loaded motion next to slow, loaded motion"
    place = "encoder"
    either_sign = "Either encoder may be read first."
    twins = ("link_viscous", "transmission_damping")
    elastic_only = strains_spring = True
    amplitudes = (
        Parameter("skew", "s", "age of the link encoder's reading beyond the motor encoder's", low=-0.1, high=0.1),
    )
    corrects = "link"
    late = ("q",)
    in_deflection = "velocity"
    example = {"skew": 0.002}
    simulated = "log"

    def columns(self, scene: Scene) -> Columns:
        """Return the link's velocity in both rows of the transmission, and what the bodies need more in link rows."""
        columns = dict(spring_rows(self.joint, scene.motion.dq[:, self.joint]))
        for joint, change in enumerate(self._bodies(scene)):
            if np.any(change):
                row = EquationRow("link", joint)
                columns[row] = columns.get(row, np.zeros((1, scene.samples))) + change
        return columns

    def _bodies(self, scene: Scene) -> Array:
        """Return d(bodies' torques)/d(shift of this joint's link) / K, (n, N); nothing where K is unknown."""
        stiffness = float(scene.stiffness[self.joint])
        if not stiffness > 0 or scene.samples < 3:
            return np.zeros((scene.robot.n, scene.samples))
        still = ("body torque",)
        if still not in scene.cache:
            scene.cache[still] = body_torque(scene, scene.parameters)
        moved = body_torque(scene, scene.parameters, (self.joint, self.moved(scene)))
        return np.asarray((moved - scene.cache[still]) / (STEP * stiffness))
