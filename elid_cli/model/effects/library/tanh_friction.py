"""Coulomb friction that is smoothed by the hyperbolic tangent of the speed."""

from __future__ import annotations

import numpy as np

from elid_cli.model.effects.effect import Columns, Parameter
from elid_cli.model.effects.gradual_friction import GradualFriction
from elid_cli.model.effects.rows import motor_row
from elid_cli.model.effects.scene import Scene


class TanhFriction(GradualFriction):
    """Coulomb friction that turns gradually with the speed, over a width that the tangent gives.

    A simulated motion under commands takes dry friction for itself: it finds `softens` there.
    """

    name = "tanh_friction"
    title = "tanh friction"
    summary = "Coulomb friction that turns gradually with the speed, as tanh of it"
    equation = "motor equation: friction (tanh(θ'/velocity) - sign(θ'))"
    physics = (
        "Simulators and friction compensators make friction smooth by tanh of the speed over a width. Lubricated"
        " contacts and cables, which give a little before they slide, look much the same."
    )
    typical = "velocity 0.005-0.2 rad/s at the joint"
    fingerprint = "motor side and whole joint, at the reversals of the motion, over a range of speeds"
    record = "many reversals, slow and fast ones; a joint that rests under a constant load shows whether it creeps"
    place = "motor"
    takes_energy = True
    of_motor_speed = True
    by_motion = False
    amplitudes = (Parameter("friction", "N·m", "Coulomb friction that turns gradually; all that fs has", low=0.0),)
    shapes = (Parameter("velocity", "rad/s", "speed at which three quarters of friction act", low=3e-4),)
    example = {"friction": 0.3, "velocity": 0.05}

    def columns(self, scene: Scene) -> Columns:
        """Return the column of the amplitude in the motor row."""
        speed = scene.motion.dtheta[:, self.joint]
        return motor_row(self.joint, np.tanh(speed / self.shape[0]) - scene.direction(self.joint))
