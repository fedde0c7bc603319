"""Velocity coupling: another joint's motion drags on this joint's motor."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from elid_cli.model.effects.effect import Columns, Effect, Parameter
from elid_cli.model.effects.rows import motor_row
from elid_cli.model.effects.scene import DIRECTION_WIDTH, Scene
from elid_cli.robot.robot import Robot


class VelocityCoupling(Effect):
    """Friction in this joint's gear that another motor's speed causes (wrist gears, belts through hollow shafts)."""

    name = "velocity_coupling"
    summary = "friction caused by another joint's motion (coupled wrist)"
    equation = "motor equation: viscous θ'_other + coulomb sign(θ'_other)"
    physics = "In a wrist whose gears run through each other, turning one motor also turns gears and seals of the next."
    typical = "10-50 % of the joint's own friction"
    fingerprint = "motor side and whole joint, follows another joint's speed or direction, however this joint moves"
    record = "each joint moved alone, then both together"
    place = "motor"
    either_sign = "The other motor drags one way or the other, as the gears run."
    amplitudes = (
        Parameter("viscous", "N·m·s/rad", "torque per speed of the other motor"),
        Parameter("coulomb", "N·m", "torque that follows the other motor's direction"),
    )
    shapes = (Parameter("other", "1", "number of the other joint, from 1", low=1.0, fixed=True, of_joint=True),)
    example = {"viscous": 0.4, "coulomb": 0.6, "other": 2.0}

    @classmethod
    def unfit(cls, robot: Robot, joint: int) -> str:
        """Return that there is no other joint, if so."""
        return "" if robot.n > 1 else "it comes from another joint's motion, and the robot has only one"

    @classmethod
    def grid(cls, scene: Scene, joint: int) -> list[tuple[float, ...]]:
        """Return the numbers of the other joints."""
        return [(float(k + 1),) for k in range(scene.robot.n) if k != joint]

    @classmethod
    def plausible(cls, scene: Scene, joint: int, values: Mapping[str, float]) -> bool:
        """Whether the other joint exists and is another one."""
        other = values["other"]
        return other == int(other) and 1 <= other <= scene.robot.n and other != joint + 1

    def columns(self, scene: Scene) -> Columns:
        """Return the columns of the viscous and the dry part in the motor row."""
        speed = scene.motion.dtheta[:, int(self.shape[0]) - 1]
        return motor_row(self.joint, speed, np.tanh(speed / DIRECTION_WIDTH))
