"""Position delay: a joint's positions are read at another instant than the other joints' positions and the torques."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from elid_cli._types import Array
from elid_cli.model.effects.bodies import body_torque
from elid_cli.model.effects.effect import Columns, Effect, Parameter
from elid_cli.model.effects.rows import derivative, motor_row, spring_rows
from elid_cli.model.effects.scene import EquationRow, Scene
from elid_cli.robot.parameter import StandardParameter
from elid_cli.robot.robot import Robot
from elid_cli.signals.motion import Motion
from elid_cli.signals.time_shift import shifted

LEAST = 0.01
"""Part of the sample time below which a delay is none."""
STEP = 1e-4
"""s; shift by which the derivative of the bodies' torques is taken."""


class PositionDelay(Effect):
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
    record = "fast motion of this joint while the others rest, and the other way round"
    place = "encoder"
    either_sign = "The joint may be read before or after the others."
    twins = ("torque_delay",)
    amplitudes = (Parameter("delay", "s", "age of the joint's positions beyond the other channels'", -0.05, 0.05),)
    corrects = "position"
    example = {"delay": 0.004}
    simulated = "log"

    @classmethod
    def unfit(cls, robot: Robot, joint: int) -> str:
        """Return that there is no other joint, if so: its torque's delay says the same then."""
        return "" if robot.n > 1 else "it is a delay against other joints, and the robot has only one"

    @classmethod
    def plausible(cls, scene: Scene, joint: int, values: Mapping[str, float]) -> bool:
        """Whether it is a delay that a log can have: one of nanoseconds stands for something else."""
        large = "delay" not in values or abs(values["delay"]) >= LEAST * scene.dt
        return large and super().plausible(scene, joint, values)

    def columns(self, scene: Scene) -> Columns:
        """Return the rate of the torques with this joint's motion: of bodies and spring, and of rotor and friction."""
        j, motion = self.joint, scene.motion
        known = dict(zip(scene.robot.parameter_names(), np.nan_to_num(scene.parameters).tolist(), strict=True))
        jerk = derivative(motion.ddtheta[:, j], scene.dt, scene.starts)
        own = known[StandardParameter("Jm", j)] * jerk + known[StandardParameter("fv", j)] * motion.ddtheta[:, j]
        columns = dict(motor_row(j, own))
        if scene.robot.joints[j].elastic:
            rate = float(np.nan_to_num(scene.stiffness[j])) * (motion.dq[:, j] - motion.dtheta[:, j])
            spring = spring_rows(j, rate)
            columns = {row: values + spring[row] for row, values in columns.items()} | {
                row: values for row, values in spring.items() if row not in columns
            }
        for joint, change in enumerate(self._bodies(scene)):
            if np.any(change):
                row = EquationRow("link", joint)
                columns[row] = columns.get(row, np.zeros((1, scene.samples))) + change
        return columns

    def _bodies(self, scene: Scene) -> Array:
        """Return d(bodies' torques)/d(shift of this joint's positions), (n, N)."""
        if scene.samples < 3:
            return np.zeros((scene.robot.n, scene.samples))
        still = ("body torque",)
        if still not in scene.cache:
            scene.cache[still] = body_torque(scene.robot, scene.motion, scene.parameters)
        moved = body_torque(scene.robot, self._moved(scene), scene.parameters)
        change: Array = (moved - scene.cache[still]) / STEP
        return change

    def _moved(self, scene: Scene) -> Motion:
        motion, j = scene.motion, self.joint
        q, dq, ddq = np.array(motion.q), np.array(motion.dq), np.array(motion.ddq)
        q[:, j] += STEP * motion.dq[:, j]
        dq[:, j] += STEP * motion.ddq[:, j]
        ddq[:, j] += STEP * derivative(motion.ddq[:, j], scene.dt, scene.starts)
        return Motion(motion.t, q, dq, ddq, motion.theta, motion.dtheta, motion.ddtheta)

    def logged(self, signals: Mapping[str, Array], dt: float, values: Mapping[str, float]) -> dict[str, Array]:
        """Return the joint's position and speed channels as logged: each reading is `delay` old."""
        changed = {name: np.array(signals[name]) for name in ("q", "theta", "dq", "dtheta") if name in signals}
        for channel in changed.values():
            channel[:, self.joint] = shifted(channel[:, self.joint], -values["delay"] / dt)
        return changed
