"""Gravity direction: the robot's base is not level."""

from __future__ import annotations

import numpy as np

from elid_cli._types import Array
from elid_cli.model.effects.bodies import POSES, horizontal_axes, same_everywhere, tilt_torques, turned, with_gravity
from elid_cli.model.effects.effect import Alteration, Columns, Effect, Parameter
from elid_cli.model.effects.scene import EquationRow, Scene
from elid_cli.robot.robot import Robot
from elid_cli.signals.motion import random_motion


class GravityDirection(Effect):
    """Gravity turned about the two base axes that are most nearly horizontal.

    The columns are the derivatives of the links' gravity torques with respect to the two angles, at the present
    parameters. What an angle does to second order scales gravity by its cosine, which the masses absorb. An angle that
    pulls at slides alone, with the same force in every pose, is an offset of their torque: its column is zero.
    """

    name = "gravity_direction"
    summary = "base not level: gravity points elsewhere than described"
    equation = (
        "link equations: roll dG/d(roll) + pitch dG/d(pitch),  G = gravity torques of the present model;"
        " large ones are one rotation, about the axis and by the size of (roll, pitch)"
    )
    physics = "A robot bolted to a sloping floor, a wall or a cart, or a base frame that was never measured."
    typical = "0.5-5 degrees"
    fingerprint = "whole joint only, of several joints; static, as weight in another direction leaves it"
    record = "rests in many poses, with links on all sides of the base"
    place = "chain"
    either_sign = "A base leans either way."
    whole_robot = True
    from_model = True
    amplitudes = (
        Parameter("roll", "rad", "turn of gravity about the first horizontal base axis (x, or y)", low=-0.5, high=0.5),
        Parameter("pitch", "rad", "turn about the second horizontal base axis (y, or z)", low=-0.5, high=0.5),
    )
    turns_gravity = True
    example = {"roll": 0.01, "pitch": -0.02}
    twins = ("link_spring",)
    simulated = "robot"

    @classmethod
    def unfit(cls, robot: Robot, joint: int) -> str:
        """Return that there is no gravity, or that the joint is not the first: the effect is the whole robot's."""
        return super().unfit(robot, joint) or ("" if any(robot.gravity) else "the robot file says that there is none")

    def columns(self, scene: Scene) -> Columns:
        """Return the derivatives of gravity torques with respect to both angles in the link rows."""
        key = ("gravity tilt",)
        if key not in scene.cache:
            anywhere = random_motion(scene.robot.n, scene.robot.elastic, samples=POSES).q
            felt = ~np.all(same_everywhere(tilt_torques(scene.robot, anywhere, scene.parameters)), axis=0)
            scene.cache[key] = tilt_torques(scene.robot, scene.motion.q, scene.parameters) * felt[:, None]
        return {EquationRow("link", j): rows.copy() for j, rows in enumerate(scene.cache[key]) if np.any(rows)}

    def named(self, scene: Scene, coefficients: Array) -> dict[str, float]:
        """Return the angles that the torques show."""
        values = super().named(scene, coefficients)
        if all(values.values()):
            return values
        felt = np.zeros(len(self.amplitudes), dtype=bool)
        for rows in self.columns(scene).values():
            felt |= np.any(rows, axis=1)
        return {name: value for (name, value), shown in zip(values.items(), felt, strict=True) if shown or value}

    def altered(self, robot: Robot, parameters: Array, coefficients: Array) -> Alteration:
        """Return the robot in the turned field of gravity."""
        first, second = horizontal_axes(robot)
        field = turned(np.array(robot.gravity), coefficients[0] * first + coefficients[1] * second)
        return Alteration(0.0, with_gravity(robot, field.tolist()), parameters)
