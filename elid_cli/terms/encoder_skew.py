"""Encoder skew: link and motor encoders read at different instants."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from elid_cli.motion import Motion
from elid_cli.robot import Robot
from elid_cli.terms.effect import Columns, Effect, Parameter, RowKey, Scene
from elid_cli.terms.rigid_torque import rigid_torque
from elid_cli.terms.rows import derivative
from elid_cli.terms.shifted import shifted

Array = NDArray[np.float64]

STEP = 1e-4
"""s; shift by which the derivative of the model's torques is taken."""


class EncoderSkew(Effect):
    """A time shift of one joint's link encoder against every other channel.

    To first order the true link angle is q + skew q'. That changes the spring's torque by K skew q', which is most
    of it, and what the bodies need in every row a little; both are in the columns.
    """

    name = "encoder_skew"
    summary = "link encoder sampled at another instant than the motor encoder"
    equation = "link row: +K skew q', motor row: the same with -; bodies' torques at q + skew q'"
    physics = "Two encoders on two buses, or one with a filter: the difference of their readings follows the speed."
    typical = "a tenth of a sample to 5 ms"
    fingerprint = "motor row high with the sum row low, along the link's velocity, not its deflection"
    record = "fast, lightly loaded motion next to slow, loaded motion"
    place = "encoder"
    elastic_only = True
    amplitudes = (
        Parameter("skew", "s", "age of the link encoder's reading beyond the motor encoder's", low=-0.1, high=0.1),
    )
    twins = ()
    simulated = "log"

    def named(self, scene: Scene, coefficients: Array) -> dict[str, float]:
        """Return the skew: the coefficient is K times it."""
        return {"skew": float(coefficients[0]) / float(scene.stiffness[self.joint])}

    @classmethod
    def coefficients(cls, scene: Scene, joint: int, values: Mapping[str, float]) -> tuple[Array, tuple[float, ...]]:
        """Invert `named`."""
        return np.array([values["skew"] * float(scene.stiffness[joint])]), ()

    def columns(self, scene: Scene) -> Columns:
        """Return the link's velocity in both rows of the transmission, and the bodies' share in all rows."""
        j, samples = self.joint, scene.samples
        columns = {row: value[None] for row, value in self._bodies(scene).items()}
        rate = scene.motion.dq[:, j]
        for row, sign in ((RowKey("link", j), 1.0), (RowKey("motor", j), -1.0)):
            columns[row] = columns.get(row, np.zeros((1, samples))) + sign * rate
        return columns

    def _bodies(self, scene: Scene) -> dict[RowKey, Array]:
        """Return d(bodies' torques)/d(shift of this joint's link) / K per row, (N,); nothing where K is unknown."""
        stiffness = float(scene.stiffness[self.joint])
        if not stiffness > 0 or scene.samples < 3:
            return {}
        rows = _rows(scene.robot)
        still = ("rigid torque",)
        if still not in scene.cache:
            scene.cache[still] = _stacked(scene, scene.motion)
        moved = _stacked(scene, self._moved(scene))
        change = (moved - scene.cache[still]) / (STEP * stiffness)
        return {row: value for row, value in zip(rows, change, strict=True) if np.any(value)}

    def _moved(self, scene: Scene) -> Motion:
        motion, j = scene.motion, self.joint
        jerk = derivative(motion.ddq[:, j], scene.dt, scene.starts)
        q, dq, ddq = np.array(motion.q), np.array(motion.dq), np.array(motion.ddq)
        q[:, j] += STEP * motion.dq[:, j]
        dq[:, j] += STEP * motion.ddq[:, j]
        ddq[:, j] += STEP * jerk
        return replace(motion, q=q, dq=dq, ddq=ddq)

    def logged(self, signals: Mapping[str, Array], dt: float, values: Mapping[str, float]) -> dict[str, Array]:
        """Return the link's channels as logged: each reading is `skew` old."""
        changed = {name: np.array(signals[name]) for name in ("q", "dq") if name in signals}
        for channel in changed.values():
            channel[:, self.joint] = shifted(channel[:, self.joint], -values["skew"] / dt)
        return changed


def _rows(robot: Robot) -> list[RowKey]:
    return [RowKey(side, joint) for side in ("link", "motor") for joint in range(robot.n)]


def _stacked(scene: Scene, motion: Motion) -> Array:
    torque = rigid_torque(scene.robot, motion, scene.parameters)
    nothing = np.zeros(motion.samples)
    return np.stack([torque.get(row, nothing) for row in _rows(scene.robot)])
