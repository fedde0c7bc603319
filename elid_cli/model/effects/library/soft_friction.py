"""Coulomb friction that fades in over a speed, and may act ahead of it: how simulators make friction smooth."""

from __future__ import annotations

import numpy as np

from elid_cli.model.effects.effect import Columns, Parameter
from elid_cli.model.effects.gradual_friction import GradualFriction
from elid_cli.model.effects.rows import motor_row
from elid_cli.model.effects.scene import Scene

LATEST = 0.1
"""s; a friction that acts farther ahead is none."""


class SoftFriction(GradualFriction):
    """Coulomb friction that is proportional to speed below one, in place of holding a joint at rest.

    With a lead it is that of MuJoCo's constraint: a joint whose friction is not used up comes to rest exponentially,
    with the lead as time constant, half of ``solreffriction``'s first number over the last of ``solimpfriction``'s two.
    """

    name = "soft_friction"
    summary = "Coulomb friction that fades in over a speed, as simulators smooth it"
    equation = (
        "motor equation: friction (sat((θ' + lead θ'')/velocity) - sign(θ')),  sat(u) = u within ±1, its sign beyond"
    )
    physics = (
        "Simulators make friction smooth, so that it can be integrated: by sat or tanh of the speed over a width, or,"
        " as MuJoCo's default constraint, so that a joint comes to rest exponentially; friction then turns before the"
        " joint does. Such joints creep where dry friction would hold them."
    )
    typical = "velocity 0.001-0.1 rad/s at the joint; lead 0, or 9.5 ms as MuJoCo's default"
    fingerprint = "motor side and whole joint, at the reversals of the motion"
    record = "many reversals, slow and fast ones; a joint that rests under a constant load shows whether it creeps"
    place = "motor"
    twins = ("stribeck",)
    softens = True
    takes_energy = True
    amplitudes = (Parameter("friction", "N·m", "Coulomb friction that fades in; all that fs has", low=0.0),)
    shapes = (
        Parameter("velocity", "rad/s", "speed from which friction is whole", low=3e-4),
        Parameter("lead", "s", "time by which it acts ahead of the speed; 0 when not given", low=0.0, high=LATEST,
                  default=0.0),
    )  # fmt: skip
    example = {"friction": 0.3, "velocity": 0.05}

    def columns(self, scene: Scene) -> Columns:
        """Return the column of the amplitude in the motor row."""
        velocity, lead = self.shape
        motion = scene.motion
        ahead = motion.dtheta[:, self.joint] + lead * motion.ddtheta[:, self.joint]
        return motor_row(self.joint, np.clip(ahead / velocity, -1.0, 1.0) - scene.direction(self.joint))
