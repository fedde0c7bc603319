"""Torque offset: a constant torque in the motor's channel."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from elid_cli.model.effects.bodies import POSES, SAME, same_everywhere, tilt_torques
from elid_cli.model.effects.effect import Columns, Effect, Parameter, Same
from elid_cli.model.effects.rows import motor_row
from elid_cli.model.effects.scene import Scene
from elid_cli.signals.motion import random_motion


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

    @classmethod
    def same_here(cls, scene: Scene, joint: int, values: Mapping[str, float]) -> tuple[Same, ...]:
        """Return that a base that is not level pulls at a slide with the same force in every pose.

        By which angle hangs on the weight of all that slides, which such a joint does not tell from its rotor.
        """
        robot = scene.robot
        if robot.joints[joint].revolute or not any(robot.gravity):
            return ()
        pulls = tilt_torques(robot, random_motion(robot.n, robot.elastic, samples=POSES).q, scene.parameters)
        same = same_everywhere(pulls)[joint] & (np.abs(pulls[joint, :, 0]) > SAME * np.max(np.abs(pulls)))
        return (Same("gravity_direction", 0, {}),) if same.any() else ()

    def columns(self, scene: Scene) -> Columns:
        """Return the column of the offset in the motor row."""
        return motor_row(self.joint, np.ones(scene.samples))
