"""Nonlinear viscous friction: a power of speed other than one."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from elid_cli.model.effects.effect import Columns, Effect, Parameter
from elid_cli.model.effects.rows import motor_row
from elid_cli.model.effects.scene import Scene

FLAT = (0.75, 1.3)
"""Powers that cannot be told from viscous friction."""


class QuadraticViscous(Effect):
    """Friction that grows with a power of speed: churning above one, shear thinning below one."""

    name = "quadratic_viscous"
    summary = "viscous friction that bends with speed (quadratic, cubic, square root)"
    equation = "motor equation: amplitude sign(θ') |θ'|^power"
    physics = (
        "Churned oil and windage grow with the square of speed or faster; grease that thins under shear, or warms in"
        " the contact, makes friction grow slower than speed."
    )
    typical = "10-50 % of the viscous friction at top speed; power 0.5, 2 or 3"
    fingerprint = "motor side and whole joint, odd in velocity and curved, largest at top speed"
    record = "speeds that differ three times or more, the highest held for a while; else the power stays unknown"
    place = "motor"
    takes_energy = True
    of_motor_speed = True
    acts_as = "torque"
    amplitudes = (Parameter("amplitude", "N·m·(s/rad)^power", "friction at 1 rad/s"),)
    shapes = (Parameter("power", "1", "power of speed", low=0.3, high=4.0),)
    example = {"amplitude": 0.6, "power": 2.0}

    @classmethod
    def grid(cls, scene: Scene, joint: int) -> list[tuple[float, ...]]:
        """Return the three powers that occur in practice."""
        return [(2.0,), (3.0,), (0.5,)]

    @classmethod
    def plausible(cls, scene: Scene, joint: int, values: Mapping[str, float]) -> bool:
        """Whether it is friction of a film: what falls with speed by less than its first power is Stribeck's."""
        falling = values["power"] < 1 and values["amplitude"] < 0
        # near the first power it is the viscous friction of the model, and its amplitude means nothing
        bent = not FLAT[0] < values["power"] < FLAT[1]
        return super().plausible(scene, joint, values) and not falling and bent

    def columns(self, scene: Scene) -> Columns:
        """Return the column of the amplitude in the motor row."""
        speed = np.abs(scene.motion.dtheta[:, self.joint])
        return motor_row(self.joint, scene.direction(self.joint) * speed ** self.shape[0])
