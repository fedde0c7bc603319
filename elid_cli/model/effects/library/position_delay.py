"""Position delay: a joint's positions are read at another instant than the other joints' positions and the torques."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from elid_cli._types import Array
from elid_cli.model.effects.bodies import SIDES, Moved, model_torque
from elid_cli.model.effects.effect import Columns, Parameter, Same
from elid_cli.model.effects.late_positions import STEP, LatePositions
from elid_cli.model.effects.rows import motor_row
from elid_cli.model.effects.scene import EquationRow, Scene
from elid_cli.robot.parameter import StandardParameter
from elid_cli.robot.robot import Robot


class PositionDelay(LatePositions):
    """A time shift of all of one joint's position channels against every other channel.

    To first order each true position is what was read plus delay times its speed. The columns hold what that changes
    in the torques of the bodies, the rotor and the spring; it is put right by moving the channels once it is known.
    """

    name = "position_delay"
    summary = "a joint's positions read at another instant than the other joints'"
    equation = "all equations that hold the joint's motion: delay times the rate of their torque with this motion alone"
    physics = (
        "Drives that are asked one after the other, or on a bus of their own, answer at different instants, and a"
        " filter in one drive makes all its positions old."
    )
    typical = "a sample to 20 ms"
    fingerprint = "whole joint, of every joint whose torque depends on this joint's motion, along the torque's rate"
    record = (
        "fast motion of the joint that may be late while the others rest, and the other way round; of two joints, how"
        " late the drives' torques are logged, measured by itself: no motion tells it from the joint that is read late"
    )
    place = "encoder"
    either_sign = "The joint may be read before or after the others."
    twins = ("torque_delay",)
    amplitudes = (Parameter("delay", "s", "age of the joint's positions beyond the other channels'", -0.05, 0.05),)
    corrects = "position"
    late = ("q", "theta")
    example = {"delay": 0.004}
    simulated = "log"

    @classmethod
    def unfit(cls, robot: Robot, joint: int) -> str:
        """Return that there is no other joint, if so: its torque's delay says the same then."""
        return "" if robot.n > 1 else "it is a delay against other joints, and the robot has only one"

    @classmethod
    def same_here(cls, scene: Scene, joint: int, values: Mapping[str, float]) -> tuple[Same, ...]:
        """Return the other joint of two, read as much earlier: with later torques, that is a shift of all clocks."""
        return (Same(cls.name, 1 - joint, {"delay": -values["delay"]}),) if scene.robot.n == 2 else ()

    def columns(self, scene: Scene) -> Columns:
        """Return the rate of all torques of the model with this joint's motion alone."""
        if scene.samples < 3:
            return motor_row(self.joint, np.zeros(scene.samples))
        key = ("model torques",)
        if key not in scene.cache:
            scene.cache[key] = self._torques(scene)
        change = (self._torques(scene, (self.joint, self.moved(scene))) - scene.cache[key]) / STEP
        rows = (EquationRow(side, k) for side in SIDES for k in range(scene.robot.n))
        return {row: values[None] for row, values in zip(rows, change, strict=True) if np.any(values)}

    @staticmethod
    def _torques(scene: Scene, moved: Moved | None = None) -> Array:
        """Return the torques of motor and link equations, (2n, N); friction keeps its direction: it is left out."""
        values = np.array(scene.parameters)
        place = {name: k for k, name in enumerate(scene.robot.parameter_names())}
        for k, stiffness in enumerate(np.nan_to_num(scene.stiffness).tolist()):
            if (name := StandardParameter("K", k)) in place:
                values[place[name]] = stiffness
        return model_torque(scene, values, moved)
