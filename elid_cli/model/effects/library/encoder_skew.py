"""Encoder skew: link and motor encoders read at different instants."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from elid_cli._types import Array
from elid_cli.model.effects.bodies import body_torque
from elid_cli.model.effects.effect import Columns, Effect, Parameter
from elid_cli.model.effects.rows import derivative, spring_rows
from elid_cli.model.effects.scene import EquationRow, Scene
from elid_cli.signals.motion import Motion
from elid_cli.signals.time_shift import shifted

LEAST = 0.01
"""Part of the sample time below which a skew is none."""
STEP = 1e-4
"""s; shift by which the derivative of the bodies' torques is taken."""


class EncoderSkew(Effect):
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
    elastic_only = True
    amplitudes = (
        Parameter("skew", "s", "age of the link encoder's reading beyond the motor encoder's", low=-0.1, high=0.1),
    )
    corrects = "link"
    in_deflection = "velocity"
    example = {"skew": 0.002}
    simulated = "log"

    def named(self, scene: Scene, coefficients: Array) -> dict[str, float]:
        """Return the skew: the coefficient is K times it."""
        return {"skew": float(coefficients[0]) / float(scene.stiffness[self.joint])}

    @classmethod
    def coefficients(cls, scene: Scene, joint: int, values: Mapping[str, float]) -> tuple[Array, tuple[float, ...]]:
        """Invert `named`."""
        return np.array([values["skew"] * float(scene.stiffness[joint])]), ()

    @classmethod
    def plausible(cls, scene: Scene, joint: int, values: Mapping[str, float]) -> bool:
        """Whether it is a skew that a log can have: one of nanoseconds stands for something else."""
        large = "skew" not in values or abs(values["skew"]) >= LEAST * scene.dt
        return large and super().plausible(scene, joint, values)

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
            scene.cache[still] = body_torque(scene.robot, scene.motion, scene.parameters)
        moved = body_torque(scene.robot, self._moved(scene), scene.parameters)
        change: Array = (moved - scene.cache[still]) / (STEP * stiffness)
        return change

    def _moved(self, scene: Scene) -> Motion:
        motion, j = scene.motion, self.joint
        q, dq, ddq = np.array(motion.q), np.array(motion.dq), np.array(motion.ddq)
        q[:, j] += STEP * motion.dq[:, j]
        dq[:, j] += STEP * motion.ddq[:, j]
        ddq[:, j] += STEP * derivative(motion.ddq[:, j], scene.dt, scene.starts)
        return Motion(motion.t, q, dq, ddq, motion.theta, motion.dtheta, motion.ddtheta)

    def logged(self, signals: Mapping[str, Array], dt: float, values: Mapping[str, float]) -> dict[str, Array]:
        """Return the link's channels as logged: each reading is `skew` old."""
        changed = {name: np.array(signals[name]) for name in ("q", "dq") if name in signals}
        for channel in changed.values():
            channel[:, self.joint] = shifted(channel[:, self.joint], -values["skew"] / dt)
        return changed
